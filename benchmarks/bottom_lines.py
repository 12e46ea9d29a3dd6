"""Bottom lines of the default actuator, for calibrating reading operators.

All curves, on the coarse mesh, into the file that ships with the package; half an hour:

    uv run python benchmarks/bottom_lines.py --out bayesdeg/actuator/lines.npz

The first curves again, against the lines that ship, or on the fine mesh against the ratios that are
fitted to them:

    uv run python benchmarks/bottom_lines.py --check 2
    uv run python benchmarks/bottom_lines.py --check 2 --fine

The first two curves are of gelatin, fresh and degraded; 14 are drawn with the seed 7 and 8 with 21.
"""

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.line import OPERATORS, read_line
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.reading import BottomLines, bottom_lines, evenly, operator_ratio
from bayesdeg.actuator.status import COARSE, FINE
from bayesdeg.data.settings import Dimensions

DRAWN = ((7, 14), (21, 8))  # seed, curves
STEPS = np.array([0.08, 0.2, 0.4, 0.6, 0.8, 1.0])
PAPER = 0.117  # mm, of a part that has shrunk to 62 % of its volume
# largest p/C1, C2/C1, C3/C1, E t/(C1 s) [mm]
GELATIN = ((0.8, -0.02, 0.004, 118.0), (0.16, -0.05, 0.05, 23.0))
POINTS = 50


def inputs() -> list[tuple[float, float, float, float]]:
    """Return largest load and groups of each curve; c2 stays in what makes a stable material."""
    found = list(GELATIN)
    for seed, count in DRAWN:
        generator = np.random.default_rng(seed)
        for _ in range(count):
            load = np.exp(generator.uniform(np.log(0.1), np.log(1.0)))
            c3 = np.exp(generator.uniform(np.log(1e-3), np.log(0.15)))
            c2 = generator.uniform(-0.5, 0.6) * np.sqrt(3.0 * c3)
            paper = np.exp(generator.uniform(np.log(8.0), np.log(500.0)))
            found.append((float(load), float(c2), float(c3), float(paper)))
    return found


def solved(mesh: ActuatorMesh, count: int) -> BottomLines:
    """Solve the first curves."""
    rows, lines = [], []
    actuator = Actuator(mesh)
    for i, (largest, c2, c3, paper) in enumerate(inputs()[:count]):
        material = MaterialGroups(
            c2_ratio=c2, c3_ratio=c3, paper_group=paper, paper_thickness=PAPER
        )
        moved, problem = actuator.problem(Curve(tuple(largest * STEPS), material))
        solver = open_factorization(problem.system.upper)
        path = follow(problem, solver, loads=[float(q) for q in largest * STEPS])
        solver.close()
        angle = 0.0
        for point in path.points:
            reading = read_state(moved, point.state, previous_angle=angle)
            angle = reading.bend_angle
            rows.append((i, angle, reading.arc_length, paper))
            placed = moved.body.nodes + point.state.displacement
            lines.append(placed[moved.bottom_line][:, (0, 2)])
        print(f"curve {i}: {path.status.name}, bent by {np.degrees(angle):.1f}°", flush=True)
    curve, angle_, length, group = np.array(rows).T
    return BottomLines(curve.astype(np.int64), angle_, length, group, np.array(lines).round(5))


def departures(found: BottomLines) -> dict[str, NDArray[np.float64]]:
    """Return by operator how far what it reads is from its ratio [%]."""
    contract = 1e3 * found.bend_angle / found.arc_length
    departure: dict[str, NDArray[np.float64]] = {}
    for operator in OPERATORS:
        ratio, _ = operator_ratio(operator, POINTS)(found.bend_angle, found.paper_group)
        read = [read_line(evenly(line, POINTS), operator).curvature for line in found.points]
        departure[operator] = 100.0 * (np.array(read) / (ratio * contract) - 1.0)
    return departure


def main() -> None:
    """Write the lines, or hold them against those that ship."""
    parser = argparse.ArgumentParser(description=__doc__)
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--out", type=Path, help="file for the lines of all curves")
    wanted.add_argument("--check", type=int, help="how many curves to solve again")
    parser.add_argument("--fine", action="store_true", help="on the fine mesh")
    asked = parser.parse_args()
    mesh = build_mesh(Geometry(Dimensions()), FINE if asked.fine else COARSE)
    found = solved(mesh, asked.check or len(inputs()))
    if asked.out is not None:
        np.savez_compressed(asked.out, **asdict(found))
    elif not asked.fine:
        kept = bottom_lines().points[: len(found.points)]
        print(f"largest difference {np.abs(found.points - kept).max():.1e} mm")
    for operator, percent in departures(found).items():
        print(f"{operator}: {percent.round(2)} % from its ratio")


if __name__ == "__main__":
    main()
