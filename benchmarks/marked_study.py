"""Whether a pressure offset is found in points that were set along bottom lines by hand.

    uv run python benchmarks/marked_study.py --json

solves 18 actuators on the fine mesh (a quarter of an hour on one core; the lines are kept in
``--lines``), with 14 kPa that the sensor reads and the chambers do not have. Of every shape 15
points are set near its bottom line, unevenly and with 0.08 mm of error, and written to
``markers.csv``; beside it stands the same study from exact curvatures and angles, ``exact/``. Both
are run at standard effort. No function of the tool that reads points or explains an offset takes
part in making them.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.status import FINE, Resolution
from bayesdeg.data.settings import Dimensions
from bayesdeg.laboratory.experiment import Design, tear_films, weigh_shrinkage
from bayesdeg.laboratory.truth import Truth

OFFSET = 14.0  # kPa
LEVELS, COPIES = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0), 3
PRESSURES = np.arange(20.0, 241.0, 20.0)
POINTS, NOISE, UNEVEN = 15, 0.08, 0.25  # mm; share of the distance between points
READING = 0.1, 0.25  # 1/m and degrees, of the exact study
SEED = 31


class Solved(NamedTuple):
    """One actuator at one pressure: its true reading, and where its nodes are [mm]."""

    name: str
    level: float
    pressure: float
    angle: float  # rad
    length: float
    mesh: ActuatorMesh
    nodes: np.ndarray


def solved(seed: int, resolution: Resolution) -> Iterator[Solved]:
    """Solve every actuator of the study, with the offset in its pressures."""
    truth, generator = Truth(), np.random.default_rng(seed)
    scale = np.cbrt(truth.volume_ratio)
    actuator = Actuator(build_mesh(Geometry(Dimensions()), resolution))
    for number, level in enumerate(np.repeat(LEVELS, COPIES)):
        rate = max(0.0, level + truth.degradation_sd * generator.standard_normal())
        stiffer = np.exp(truth.stiffness_scatter * generator.standard_normal())
        c1, c2, c3 = stiffer * truth.constants([rate])[0]
        material = MaterialGroups(
            c2_ratio=c2 / c1,
            c3_ratio=c3 / c1,
            paper_group=1e-3 * truth.paper_stiffness / (c1 * scale),
            paper_thickness=truth.paper_thickness / scale,
        )
        loads = 1e-3 * (PRESSURES - OFFSET) / c1
        mesh, problem = actuator.problem(Curve(tuple(loads), material))
        solver = open_factorization(problem.system.upper)
        path = follow(problem, solver, loads=[float(q) for q in loads])
        solver.close()
        angle, name = 0.0, f"A{level:02.0f}-{number}"
        for pressure, point in zip(PRESSURES, path.points, strict=False):
            reading = read_state(mesh, point.state, previous_angle=angle)
            angle = reading.bend_angle
            nodes = scale * (mesh.body.nodes + point.state.displacement)
            yield Solved(name, level, pressure, angle, scale * reading.arc_length, mesh, nodes)
        print(f"{name}: {len(path.points)} shapes, {np.degrees(angle):.1f}°", file=sys.stderr)


def shapes(seed: int) -> pd.DataFrame:
    """Return a row a node of each bottom line [mm], [rad]."""
    columns = ["specimen_id", "degradation_pct", "pressure_kPa", "angle", "length", "x", "y"]
    rows = [
        (*one[:5], *node)
        for one in solved(seed, FINE)
        for node in one.nodes[one.mesh.bottom_line][:, ::2]
    ]
    return pd.DataFrame(rows, columns=columns)


def by_hand(line: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Return points that a person sets along a line, both ends among them."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, arc[-1], POINTS)
    at[1:-1] += UNEVEN * at[1] * generator.uniform(-1.0, 1.0, POINTS - 2)
    return CubicSpline(arc, line)(at) + NOISE * generator.standard_normal((POINTS, 2))


def tables(found: pd.DataFrame, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return markers.csv, and actuator.csv as exact readings with small errors."""
    generator = np.random.default_rng([seed, 1])
    marked, exact = [], []
    keys = ["specimen_id", "degradation_pct", "pressure_kPa"]
    for about, shape in found.groupby(keys, sort=False):
        angle, length = shape.iloc[0][["angle", "length"]]
        errors = generator.standard_normal(2) * READING
        exact.append((*about, 1e3 * angle / length + errors[0], np.degrees(angle) + errors[1]))
        points = by_hand(shape[["x", "y"]].to_numpy(), generator).round(3)
        marked += [(*about, j + 1, x, y, NOISE) for j, (x, y) in enumerate(points)]
    return (
        pd.DataFrame(marked, columns=[*keys, "point", "x_mm", "y_mm", "sd_mm"]),
        pd.DataFrame(exact, columns=[*keys, "curvature_per_m", "bend_angle_deg"]).round(4),
    )


def write_studies(out: Path, found: pd.DataFrame, seed: int) -> None:
    """Write both studies, with the same films."""
    truth, generator, design = Truth(), np.random.default_rng([seed, 2]), Design()
    tensile, breaks, _ = tear_films(design, truth, generator)
    shrinkage = weigh_shrinkage(design.shrinkage, truth, generator, design.mixture)
    films = {"tensile.csv": tensile, "break.csv": breaks, "shrinkage.csv": shrinkage}
    marked, exact = tables(found, seed)
    for name, table in (("marked", {"markers.csv": marked}), ("exact", {"actuator.csv": exact})):
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        settings = f'title = "Virtual: {name}"\nseed = 7\nvirtual = true\n'
        (folder / "study.toml").write_text(settings, encoding="utf-8")
        for file, rows in (films | table).items():
            rows.to_csv(folder / file, index=False)


def verdict(study: Path, effort: str = "standard") -> dict[str, Any]:
    """Run a study; return what is named, and the offset with its 90 % interval [kPa]."""
    report = study.parent / "reports" / study.name
    command = [sys.executable, "-m", "bayesdeg", "run", study, "--out", report, "--quiet"]
    command += ["--effort", effort]
    subprocess.run([str(word) for word in command], check=True)
    found = json.loads((report / "verdict.json").read_text(encoding="utf-8"))
    entry = next(c for c in found["candidates"] if c["cause"] == "pressure_offset")
    offset = next(iter((entry.get("effect") or {"": {}}).values()))
    inside = bool(offset) and offset["q05"] <= OFFSET <= offset["q95"]
    return {
        "outcome": found["outcome"],
        "causes": found["causes"],
        "offset_kPa": offset.get("mean"),
        "q05": offset.get("q05"),
        "q95": offset.get("q95"),
        "inside": inside,
    }


def main() -> None:
    """Make the studies, run them, and say what was named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--lines", type=Path, help="CSV of shapes: read if there, else written")
    parser.add_argument("--out", type=Path, help="folder for the studies; else a temporary one")
    asked = parser.parse_args()
    if asked.lines is not None and asked.lines.exists():
        found = pd.read_csv(asked.lines)
    else:
        found = shapes(asked.seed)
        if asked.lines is not None:
            found.to_csv(asked.lines, index=False)
    out = asked.out or Path(tempfile.mkdtemp())
    write_studies(out, found, asked.seed)
    results = {name: verdict(out / name) for name in ("marked", "exact")}
    if asked.json:
        print(json.dumps(results))
    else:
        print(pd.DataFrame(results).T)


if __name__ == "__main__":
    main()
