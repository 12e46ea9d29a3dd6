"""Time profile of one curve, and gains of the path's predictor and interpolation."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, cast

import numpy as np
from forward_case import LINEAR_SCALE, Floats, curvature_of, curve_of, largest_deviation_pct

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.linear import Factorization, open_factorization
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import Linearisation, MechanicalState, Problem, System
from bayesdeg.actuator.status import PathEffort

SMALLEST_STEP = 1.0 / 64.0  # share of the distance between two loads


@dataclass
class Stopwatch:
    """Wall times [s] of named parts of a calculation."""

    times: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    @contextmanager
    def on(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.times[name].append(time.perf_counter() - start)


@dataclass(frozen=True, eq=False)
class TimedProblem(Problem):
    """The equations with a stopwatch on assembly and on what the rates along the path take."""

    watch: Stopwatch = field(default_factory=Stopwatch)

    def linearise(self, state: MechanicalState, *, tangent: bool = True) -> Linearisation:
        with self.watch.on("assembly" if tangent else "rates"):
            return super().linearise(state, tangent=tangent)

    def products(
        self, state: MechanicalState, directions: Sequence[MechanicalState]
    ) -> list[tuple[Floats, Floats]]:
        with self.watch.on("rates"):
            return super().products(state, directions)


@dataclass
class TimedFactorization:
    """A direct solver with a stopwatch."""

    solver: Factorization
    watch: Stopwatch

    @property
    def name(self) -> str:
        return self.solver.name

    def factorize(self, data: Floats) -> int:
        with self.watch.on("factorization"):
            return self.solver.factorize(data)

    def solve(self, right: Floats) -> Floats:
        with self.watch.on("triangular_solves"):
            return self.solver.solve(right)

    def close(self) -> None:
        self.solver.close()


def profile(mesh: ActuatorMesh, curve: Curve) -> dict[str, Any]:
    """Solve one curve as ``Actuator.solve`` does, with a stopwatch on every part."""
    watch = Stopwatch()
    start = time.perf_counter()
    with watch.on("numbering"):
        system = System(mesh.body)
    solver = TimedFactorization(open_factorization(system.upper), watch)
    problem = TimedProblem(system, curve.material, watch=watch)
    path = follow(problem, cast(Factorization, solver), loads=curve.loads)
    solver.close()
    assert path.rest is not None
    for point in (path.rest, *path.points):
        with watch.on("readings"):
            read_state(mesh, point.state, rate=point.rate)
    total = time.perf_counter() - start
    seconds = {name: sum(times) for name, times in watch.times.items()}
    return {
        "seconds": {**seconds, "other": total - sum(seconds.values()), "total": total},
        "counts": {name: len(times) for name, times in watch.times.items()},
        "first_factorization_with_symbolic_analysis": watch.times["factorization"][0],
        "note": "a triangular solve has two right-hand sides: a Newton step and a rate",
    }


class Run(NamedTuple):
    """Curvatures [1/m] of one way to climb the path, and the factorizations it took."""

    curvatures: Floats
    factorizations: int


def plain_newton(mesh: ActuatorMesh, curve: Curve, *, effort: PathEffort) -> Run:
    """Solve a curve by Newton's method from the state of the load before, nothing predicted.

    Its iterates pass through states whose tangent is not definite, hence LDLᵀ; a step of the load
    is halved only where an element turns inside out or the iteration does not end.
    """
    system = System(mesh.body)
    solver = open_factorization(system.upper, is_definite=False)
    problem, state, spent = Problem(system, curve.material), system.rest(), 0
    curvatures: list[float] = []
    for load in curve.loads:
        gap = step = load - state.load
        while state.load < load:
            guess = replace(state, load=min(load, state.load + step))
            reached, count = _iterate(problem, solver, guess, effort)
            spent += count
            if reached is None:
                step *= 0.5
                if step < SMALLEST_STEP * gap:
                    raise RuntimeError(f"no equilibrium at a load of {load:g}")
            else:
                state = reached
        curvatures.append(read_state(mesh, state).curvature * 1e3 / LINEAR_SCALE)
    solver.close()
    return Run(np.array(curvatures), spent)


def _iterate(
    problem: Problem, solver: Factorization, state: MechanicalState, effort: PathEffort
) -> tuple[MechanicalState | None, int]:
    size = float(np.ptp(problem.system.body.nodes, axis=0).max())
    for count in range(1, effort.iterations + 1):
        now = problem.linearise(state)
        if not now.smallest_jacobian > 0.0:
            return None, count
        solver.factorize(now.tangent)
        step = problem.system.expand(solver.solve(-now.residual))
        state = state.moved(step, problem.pressure_increment(now, step, now.volume_residual))
        if float(np.max(np.abs(step))) < effort.tolerance * size:
            return state, count
    return None, effort.iterations


def climbed(mesh: ActuatorMesh, curve: Curve, *, effort: PathEffort) -> Run:
    """Solve a curve as ``Actuator`` does."""
    solution = Actuator(mesh).solve(curve, effort=effort)
    return Run(curvature_of(solution), solution.iterations)


# ways to the same twelve curvatures, at the same tolerance of Newton's method
WAYS: dict[str, Callable[[ActuatorMesh], Run]] = {
    "newton_from_the_load_before": lambda mesh: plain_newton(
        mesh, curve_of("fresh"), effort=PathEffort(iterations=30)
    ),
    "predictor_and_every_load": lambda mesh: climbed(
        mesh, curve_of("fresh"), effort=PathEffort(exact=True)
    ),
    "adaptive_and_interpolated": lambda mesh: climbed(mesh, curve_of("fresh"), effort=PathEffort()),
}


def deviations_pct(mesh: ActuatorMesh) -> dict[str, dict[str, float]]:
    """Return of each way the factorizations and the deviation from a tight solution [%]."""
    truth = climbed(mesh, curve_of("fresh"), effort=PathEffort(tolerance=1e-8, exact=True))
    runs = {name: way(mesh) for name, way in WAYS.items()}
    return {
        name: {
            "factorizations": run.factorizations,
            "error_pct": largest_deviation_pct(run.curvatures, truth.curvatures),
        }
        for name, run in runs.items()
    }
