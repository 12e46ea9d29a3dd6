"""Curvatures read by another operator than stated: what is named.

    uv run python benchmarks/operator_studies.py --json

draws studies anew, as `hidden_studies.py` does, with the readings of the second surrogate of the
fine finite element model. What a laboratory reads by another operator is then put in their place:
of bottom lines of actuators that are solved on the fine mesh, sampled at as many points as it would
set, by fits that are written here and not those of the package. All state ``angle_over_arc``. Each
is judged from its folder alone, as ``bayesdeg run`` does at quick effort, once with bend angles of
the end faces and once without. Half a minute a study and operator.

The lines are kept in ``operator_lines.npz`` beside this script; ``--solve`` makes them anew, a
minute each.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fine_library import shipped_library
from hidden_effects import visible
from hidden_studies import HiddenStudy, designs, experimented, write_folder
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, RBFInterpolator
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction, paper_group_of
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import FINE, build_mesh
from bayesdeg.actuator.outputs import read_state
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import JUDGE_EFFORTS, judge
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import find
from bayesdeg.data.settings import Dimensions, ReadingOptions, Settings
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.truth import HiddenEffect, drawn_truth
from bayesdeg.laboratory.writing import Provenance
from bayesdeg.progress import Silent

Floats = NDArray[np.float64]
Json = dict[str, Any]

LINES = Path(__file__).with_name("operator_lines.npz")
SEED, SOLVED, LARGEST = 13, 10, 200.0  # of the lines; actuators; kPa
STEPS = np.array([0.06, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0])
POINTS = (12, 20, 50)  # that a laboratory sets along a line
CAUSE = "curvature_operator"
#: Standard deviations by which a circle must show after a refit, for its share to count.
SEEN = 5.0


def fitted_circle(line: Floats) -> float:
    """Return 1/R of the circle that is nearest to all points [1/mm]."""
    chord = line[-1] - line[0]
    normal = np.array([chord[1], -chord[0]]) / np.hypot(*chord)
    middle = line.mean(axis=0)
    sag = float(np.max(np.abs((line - line[0]) @ normal))) + 1e-6
    start = float(chord @ chord) / (8.0 * sag)

    def off(centre: Floats) -> Floats:
        distance = np.hypot(*(line - middle - centre).T)
        return np.asarray(distance - distance.mean(), dtype=np.float64)

    found = least_squares(off, start * normal, x_scale=start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return float(1.0 / np.hypot(*(line - middle - found.x).T).mean())


def base_and_tip(line: Floats) -> float:
    """Return the curvature of the arc from base to tip that leaves the base along x [1/mm]."""
    along, down = line[-1] - line[0]
    return float(2.0 * abs(down) / (along**2 + down**2))


def through_all(line: Floats) -> float:
    """Return the turning of a cubic spline between its ends over its length [1/mm]."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    spline = CubicSpline(arc, line)
    ends = spline(arc[[0, -1]], 1)
    fine = spline(np.linspace(0.0, arc[-1], 2000))
    turned = np.diff(np.unwrap(np.arctan2(-ends[:, 1], ends[:, 0])))[0]
    return float(turned / np.hypot(*np.diff(fine, axis=0).T).sum())


OPERATORS: dict[str, Callable[[Floats], float]] = {
    "circle": fitted_circle,
    "base_tip": base_and_tip,
    "spline": through_all,
}


@dataclass(frozen=True)
class FineLines:
    """Bottom lines on the fine mesh: bend angle [rad], arc length and paper's group [mm]."""

    angle: Floats
    length: Floats
    group: Floats
    points: Floats


def solved_lines(seed: int, count: int) -> FineLines:
    """Solve actuators whose materials are drawn as those of studies are."""
    generator = np.random.default_rng(seed)
    actuator = Actuator(build_mesh(Geometry(Dimensions()), FINE))
    rows, lines = [], []
    for level in np.linspace(0.0, 25.0, count):
        truth = drawn_truth(generator)
        c1, c2, c3 = truth.constants([level])[0]
        scale = np.cbrt(truth.volume_ratio)
        group = 1e-3 * truth.paper_stiffness / (c1 * scale)
        material = MaterialGroups(
            c2_ratio=c2 / c1,
            c3_ratio=c3 / c1,
            paper_group=group,
            paper_thickness=truth.paper_thickness / scale,
        )
        loads = 1e-3 * LARGEST / c1 * STEPS
        mesh, problem = actuator.problem(Curve(tuple(loads), material))
        solver = open_factorization(problem.system.upper)
        path = follow(problem, solver, loads=[float(q) for q in loads])
        solver.close()
        angle = 0.0
        for point in path.points:
            reading = read_state(mesh, point.state, previous_angle=angle)
            angle = reading.bend_angle
            rows.append((angle, reading.arc_length, group))
            lines.append((mesh.body.nodes + point.state.displacement)[mesh.bottom_line][:, ::2])
        print(f"{level:.0f} %: {path.status.name}, {np.degrees(angle):.0f}°", file=sys.stderr)
    angles, lengths, groups = np.array(rows).T
    return FineLines(angles, lengths, groups, np.array(lines).round(5))


@cache
def fine_lines() -> FineLines:
    """Return the lines that are kept."""
    with np.load(LINES, allow_pickle=False) as kept:
        return FineLines(**{name: kept[name] for name in kept.files})


@dataclass(frozen=True)
class ReadOtherwise:
    """The readings of a map, with curvature as an operator reads it of so many points.

    What it reads over the contract's curvature is interpolated between the lines by thin plates in
    the bend angle and the logarithm of the paper's group.
    """

    mechanics: ForwardMap
    ratio: RBFInterpolator

    @classmethod
    def by(cls, mechanics: ForwardMap, operator: str, points: int) -> "ReadOtherwise":
        """Return the map that reads by an operator of `OPERATORS`."""
        lines = fine_lines()
        read = [OPERATORS[operator](sampled(line, points)) for line in lines.points]
        ratio = np.log(np.array(read) * lines.length / lines.angle)
        at = np.column_stack([lines.angle, np.log(lines.group)])
        return cls(mechanics, RBFInterpolator(at, ratio, smoothing=1e-6))

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the reading."""
        found, lines = self.mechanics(inputs), fine_lines()
        group = paper_group_of(inputs)
        angle, group = np.broadcast_arrays(np.radians(found.bend_angle), group)
        angle = np.clip(np.abs(angle), lines.angle.min(), lines.angle.max())
        group = np.clip(group, lines.group.min(), lines.group.max())
        at = np.column_stack([angle.ravel(), np.log(group.ravel())])
        known = np.isfinite(at).all(axis=1)
        gain = np.ones(len(at))
        gain[known] = np.exp(self.ratio(at[known]))
        whole = gain.reshape(angle.shape)
        return replace(found, curvature=whole * found.curvature, slope=whole * found.slope)


def sampled(line: Floats, count: int) -> Floats:
    """Return so many points of a line, evenly along it."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    return np.asarray(CubicSpline(arc, line)(np.linspace(0.0, arc[-1], count)))


def judged(number: int, operator: str, design: str, *, seed: int, forward: ForwardMap) -> Json:
    """Make one study and judge it; all operators and designs of a number share its specimens."""
    points = int(np.random.default_rng([seed, number, 1]).choice(POINTS))
    hidden = HiddenStudy(number, "single", design, (), 1.0)
    reading = ReadOtherwise.by(forward, operator, points)
    made = experimented(hidden, forward=reading, seed=seed, design=designs()[design])
    settings = Settings(
        title=f"read otherwise {number}",
        seed=number,
        priors=made.priors,
        reading=ReadingOptions("angle_over_arc"),
    )
    start = time.perf_counter()
    with TemporaryDirectory() as place, threadpool_limits(limits=1):
        folder = Path(place)
        provenance = Provenance(
            command="benchmarks/operator_studies.py", seed=seed, mesh=vars(FINE)
        )
        write_folder(made.experiment, settings, folder, provenance=provenance)
        (folder / "truth.json").unlink()
        assembly = assemble(read_study(folder))
        fitting, judging = np.random.SeedSequence(number).spawn(2)
        base = base_without_chain(assembly.model, fitting)
        found = judge(
            assembly, base, effort=JUDGE_EFFORTS["quick"], seed=judging, progress=Silent()
        )
    cause = find(CAUSE)
    planted = HiddenEffect(cause, {"circle_share": 1.0})
    sizes = visible(found.search.base, (planted,), made.truth)
    return {
        "number": number,
        "operator": operator,
        "design": design,
        "points": points,
        "visible": sizes[CAUSE],
        "outcome": str(found.decision.outcome),
        "causes": list(found.decision.causes),
        "one_of": [list(names) for names in found.decision.one_of],
        "sets": [list(names) for names in found.decision.sets],
        "supported": [one.cause for one in found.supported],
        "factors": {
            c.cause: c.log_bayes_factor
            for c in [c for c in found.candidates if c.log_bayes_factor is not None][:6]
        },
        "effects": {
            c.cause: {name: [size.mean, size.q05, size.q95] for name, size in c.effect.items()}
            for c in found.candidates
            if c.cause in found.decision.causes
        },
        "p_value": found.misfit.p_value,
        "p_left": found.left.p_value,
        "seconds": time.perf_counter() - start,
    }


def summary(records: list[Json]) -> Json:
    """Return what was said, by operator and design; shares are of studies."""
    found: Json = {}
    for operator in OPERATORS:
        for design in ("angle", "curvature"):
            own = [r for r in records if (r["operator"], r["design"]) == (operator, design)]
            if own:
                found[f"{operator}_{design}"] = _of_design(own)
    return found


def _of_design(records: list[Json]) -> Json:
    single = [r["causes"][0] if r["outcome"] == "named" else "" for r in records]
    seen = [r["visible"] >= SEEN for r in records]
    among = [CAUSE in r["causes"] for r in records]
    margins = [_margin(r["factors"]) for r in records]
    outcomes = [str(r["outcome"]) for r in records]
    return {
        "studies": len(records),
        "seen": sum(seen),
        "named": float(np.mean([name == CAUSE for name in single])),
        "possible": float(np.mean(among)),
        "possible_where_seen": float(np.mean(np.array(among)[seen])) if any(seen) else None,
        "first": float(np.mean(np.array(margins) > 0.0)),
        "log_odds_median": float(np.median(margins)),
        "log_odds_largest": float(np.max(margins)),
        "named_shrinkage_reading": single.count("shrinkage_reading"),
        "named_other": {n: single.count(n) for n in sorted({*single} - {"", CAUSE})},
        "outcomes": {name: outcomes.count(name) for name in sorted(set(outcomes))},
    }


def _margin(factors: dict[str, float]) -> float:
    """Return the logarithm of the odds of the planted cause against the best other one."""
    others = [value for name, value in factors.items() if name != CAUSE]
    return factors.get(CAUSE, 0.0) - max(others, default=0.0)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--operators", nargs="+", choices=OPERATORS, default=list(OPERATORS))
    parser.add_argument("--solve", action="store_true", help="solve the lines anew, and end")
    parser.add_argument("--each", action="store_true", help="a line a study, as JSON")
    parser.add_argument("--json", action="store_true", help="print nothing but the result")
    asked = parser.parse_args()
    if asked.solve:
        np.savez_compressed(LINES, **vars(solved_lines(SEED, SOLVED)))
        return
    forward, records = shipped_library(), []
    for number in range(asked.first, asked.first + asked.studies):
        for operator in asked.operators:
            for design in ("angle", "curvature"):
                record = judged(number, operator, design, seed=asked.seed, forward=forward)
                records.append(record)
                if asked.each:
                    print(json.dumps(record), file=sys.stderr, flush=True)
    found = summary(records)
    print(json.dumps(found, indent=None if asked.json else 1))


if __name__ == "__main__":
    main()
