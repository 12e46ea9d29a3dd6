"""Mesh-converged curvature by Richardson extrapolation.

Every interval between planes of a base mesh is cut into n, for n = 2, 3, 4, …, evenly or smaller
towards re-entrant edges by one smooth map; the curvatures of these families are kept in
converged_curvature.json. With h = 1/n and κ(h) = κ₀ + a hᵖ the three finest meshes give the
observed order p and the limit κ₀ at each pressure. Re-entrant edges of 270° let the order fall to
2 λ = 1.089 in the end (sin(3π/2 λ) = λ for a free corner, doi:10.1115/1.4010553), so an observed
order below that is no order yet and is replaced by it; and since a higher one need not last, the
limit with 2 λ is given beside it. The graded family, whose errors are smaller, is the reference;
how far the limit of the even one is from it says how far to trust both.

    uv run python benchmarks/converged_curvature.py --pieces 2 3 4 --gradings 0.6 0 \
        --out benchmarks/converged_curvature.json

A mesh that the file has already is not solved again. On one core n = 4 has 0.5 million unknowns
and takes a quarter of an hour, n = 3 three minutes.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from forward_case import (
    CONSTANTS,
    LINEAR_SCALE,
    PAPER_STIFFNESS,
    PRESSURES,
    Floats,
    curvature_of,
    curve_of,
    say,
)
from scipy.optimize import brentq

from bayesdeg.actuator.curve import MODEL_VERSION, Actuator
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh, graded
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.trained import default_surrogate

STORE = Path(__file__).with_suffix(".json")
BASE = (3.0, 2.0, 2.0)  # largest brick of the base mesh along, across and up [mm]
SINGULAR_ORDER, HIGHEST_ORDER = 2 * 0.544484, 4.0
GRADING = 0.6  # of the family of reference
WHOLE = Resolution(along=np.inf, across=np.inf, up=np.inf)


@dataclass(frozen=True)
class Subdivided(Geometry):
    """A geometry with more planes between which bricks stand: those of the base mesh, cut."""

    pieces: int = 1
    grading: float = GRADING

    def planes(self) -> tuple[Floats, Floats, Floats]:
        """Return the planes of the geometry and those that cut its bricks [mm]."""
        x, y, z = (
            _cut(planes, size, pieces=self.pieces, grading=self.grading)
            for planes, size in zip(super().planes(), BASE, strict=True)
        )
        return x, y, z


def _cut(planes: Floats, size: float, *, pieces: int, grading: float) -> Floats:
    last = len(planes) - 2
    parts = []
    for place, (low, high) in enumerate(pairwise(planes)):
        count = pieces * int(np.ceil((high - low) / size - 1e-9))
        share = graded(count, grading, first=place > 0, last=place < last)
        parts.append(low + (high - low) * share[:-1])
    return np.concatenate([*parts, planes[-1:]])


def family_mesh(pieces: int, grading: float) -> ActuatorMesh:
    """Return the base mesh with every interval cut into ``pieces``."""
    return build_mesh(Subdivided(Dimensions(), pieces=pieces, grading=grading), WHOLE)


@dataclass(frozen=True)
class Member:
    """One mesh of a family and its curvatures [1/m]."""

    grading: float
    pieces: int
    elements: int
    unknowns: int
    seconds: float
    fresh: list[float]
    degraded: list[float]


def solve_member(grading: float, pieces: int) -> Member:
    """Solve both curves on one mesh of a family."""
    start = time.perf_counter()
    actuator = Actuator(family_mesh(pieces, grading))
    curvatures = {
        name: curvature_of(actuator.solve(curve_of(name))).tolist()
        for name in ("fresh", "degraded")
    }
    seconds = time.perf_counter() - start
    elements, unknowns = len(actuator.mesh.body.elements), len(actuator.system.free)
    return Member(grading, pieces, elements, unknowns, seconds, **curvatures)


def read_members(path: Path = STORE) -> list[Member]:
    """Return the stored meshes, coarsest first; none if they belong to another model."""
    if not path.exists():
        return []
    document = json.loads(path.read_text(encoding="utf-8"))
    if document["model_version"] != MODEL_VERSION or document["base"] != list(BASE):
        return []
    return [Member(**entry) for entry in document["meshes"]]


def write_members(members: Sequence[Member], path: Path) -> None:
    """Store the curvatures of all meshes solved so far."""
    ordered = sorted(members, key=lambda m: (m.grading, m.pieces))
    pieces, gradings = ({getattr(m, key) for m in members} for key in ("pieces", "grading"))
    document = {
        "model_version": MODEL_VERSION,
        "command": "uv run python benchmarks/converged_curvature.py"
        f" --pieces {' '.join(map(str, sorted(pieces)))}"
        f" --gradings {' '.join(map(str, sorted(gradings)))}",
        "base": list(BASE),
        "pressures_kPa": PRESSURES.tolist(),
        "meshes": [asdict(member) for member in ordered],
    }
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


@dataclass(frozen=True)
class Estimate:
    """The limit of a family at each pressure.

    ``order`` is the observed one, nan where differences change their sign; ``limit`` is
    extrapolated with it, kept between 2 λ and 4, and ``singular_limit`` with 2 λ.
    """

    pieces: tuple[int, int, int]
    order: Floats
    limit: Floats
    singular_limit: Floats


def richardson(pieces: Sequence[int], values: Floats) -> Estimate:
    """Extrapolate values (3, n_pressures) on three meshes, coarsest first."""
    h = 1.0 / np.asarray(pieces, dtype=np.float64)
    steps = np.diff(values, axis=0)
    order = np.array([_observed_order(h, *pair) for pair in steps.T])
    used = np.clip(np.where(np.isfinite(order), order, 0.0), SINGULAR_ORDER, HIGHEST_ORDER)

    def limit(p: Floats | float) -> Floats:
        rest: Floats = values[2] + steps[1] * h[2] ** p / (h[1] ** p - h[2] ** p)
        return rest

    first, second, third = pieces
    return Estimate((first, second, third), order, limit(used), limit(SINGULAR_ORDER))


def _observed_order(h: Floats, first: float, second: float) -> float:
    """Solve (h₁ᵖ − h₂ᵖ) / (h₂ᵖ − h₃ᵖ) = first / second for p."""
    if not first * second > 0.0:
        return np.nan

    def excess(p: float) -> float:
        return float((h[0] ** p - h[1] ** p) / (h[1] ** p - h[2] ** p) - first / second)

    low, high = -8.0 + 1e-3, 12.0  # not through p = 0, where both differences vanish
    if excess(low) * excess(high) > 0.0:
        return np.nan
    return float(brentq(excess, low, high))


def estimates(members: Sequence[Member], grading: float = GRADING) -> dict[str, Estimate]:
    """Return the limits of both curves from a family's three finest meshes; empty without them."""
    family = [member for member in members if member.grading == grading]
    finest = sorted(family, key=lambda m: m.pieces)[-3:]
    if len(finest) < 3:
        return {}
    pieces = [member.pieces for member in finest]
    return {
        name: richardson(pieces, np.array([getattr(member, name) for member in finest]))
        for name in ("fresh", "degraded")
    }


def extend(
    pieces: Sequence[int], *, gradings: Sequence[float] = (GRADING,), path: Path = STORE
) -> list[Member]:
    """Solve the meshes that the file lacks, small ones first; store each as soon as it is done."""
    members = read_members(path)
    there = {(member.grading, member.pieces) for member in members}
    for n, grading in sorted({(n, g) for n in pieces for g in gradings if (g, n) not in there}):
        say(f"family of meshes with grading {grading:g}: every brick in {n}³")
        members.append(solve_member(grading, n))
        write_members(members, path)
        say(f"  {members[-1].unknowns} unknowns, {members[-1].seconds:.0f} s")
    return members


def emulator_deviation_pct(limits: dict[str, Estimate]) -> dict[str, list[float]]:
    """Return how far the shipped emulator's curvature is from the limits [%]."""
    forward, one = default_surrogate(), np.ones(1)
    deviations = {}
    for name, estimate in limits.items():
        c1, c2, c3 = (c * one for c in CONSTANTS[name])
        inputs = Inputs(PRESSURES, c1, c2, c3, LINEAR_SCALE * one, PAPER_STIFFNESS * one)
        curvature = forward(inputs).curvature
        deviations[name] = (100.0 * (curvature / np.asarray(estimate.limit) - 1.0)).tolist()
    return deviations


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pieces", type=int, nargs="+", default=[2, 3, 4])
    parser.add_argument("--gradings", type=float, nargs="+", default=[GRADING, 0.0])
    parser.add_argument("--out", type=Path, default=STORE)
    options = parser.parse_args()
    members = extend(options.pieces, gradings=options.gradings, path=options.out)
    tables = {
        f"grading {grading:g}": {
            name: {key: np.asarray(value).tolist() for key, value in vars(estimate).items()}
            for name, estimate in estimates(members, grading).items()
        }
        for grading in options.gradings
    }
    emulator = emulator_deviation_pct(estimates(members))
    answer = {"pressures_kPa": PRESSURES.tolist(), **tables, "emulator_deviation_pct": emulator}
    print(json.dumps(answer, indent=1))


if __name__ == "__main__":
    main()
