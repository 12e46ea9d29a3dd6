"""The load path; a failure is a value, never an exception."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.continuation import MEMORY, StepControl, extrapolate, interpolate
from bayesdeg.actuator.limit import locate_limit
from bayesdeg.actuator.linear import Factorization
from bayesdeg.actuator.material import is_elliptic
from bayesdeg.actuator.newton import Step, find_equilibrium
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.status import Effort, Status
from bayesdeg.actuator.system import Point, State

Floats = NDArray[np.float64]
Visit = Callable[[Step], None]

SAFE_MISMATCH = 1e-3  # strain of the paper that one step from rest bears
QUICK, QUICK_GROWTH = 3, 2.0  # a step of so few factorizations lets the next be longer


@dataclass(frozen=True)
class Path:
    """Equilibria at the wanted loads, in order, as far as there are any.

    Parameters
    ----------
    rest : Point, optional
        The equilibrium at zero pressure; None if there is none.
    points : tuple of Point
        State and d(state)/d(load) at each load reached.
    status : Status
        How the path ended.
    limit_load : float
        Load of the limit point, or where the shape buckles; inf if none was met.
    iterations : int
        Factorizations spent, cut steps included.
    """

    rest: Point | None
    points: tuple[Point, ...]
    status: Status
    limit_load: float
    iterations: int

    @property
    def states(self) -> tuple[State, ...]:
        """One for each load reached."""
        return tuple(point.state for point in self.points)


def follow(
    problem: Problem,
    solver: Factorization,
    *,
    loads: Sequence[float],
    effort: Effort | None = None,
    visit: Visit | None = None,
) -> Path:
    """Follow the equilibrium from rest through rising loads.

    Dead loads come first, at zero pressure. Each step starts from the polynomial through the
    last states and the path's tangents there, and is as long as that polynomial is good for one
    step of Newton's method. Between the ends of steps the same kind of polynomial is
    interpolated, unless ``effort.exact`` asks for an equilibrium at every load. A step that
    loses positive definiteness, turns an element inside out or does not converge is halved;
    when nothing is left to halve, the limit point is looked for.

    Parameters
    ----------
    problem : Problem
        Body, material and dead loads.
    solver : Factorization
        Direct solver opened on ``problem.system.upper``.
    loads : sequence of float
        Pressure over C1, rising, above 0 [–].
    effort : Effort, optional
        Tolerances and bounds.
    visit : callable, optional
        Called with each converged step while the solver holds its factors, rest first.

    Returns
    -------
    Path
        Never raises for a physical reason: look at ``status``.
    """
    effort = effort or Effort()
    if not is_elliptic(problem.material):
        return Path(None, (), Status.UNSTABLE_MATERIAL, 0.0, 0)
    visit = visit or (lambda step: None)
    deadline = time.monotonic() + effort.seconds
    rest, status, spent = _rest(problem, solver, effort=effort, visit=visit, deadline=deadline)
    if rest is None:
        limit = 0.0 if status == Status.BUCKLED else np.inf
        return Path(None, (), status, limit, spent)
    if len(loads) == 0:
        return Path(rest, (), Status.CONVERGED, np.inf, spent)
    points, status, tried = _climb(
        problem, solver, rest, loads, effort=effort, visit=visit, deadline=deadline
    )
    spent += tried
    limit_load = np.inf
    if status == Status.LIMIT_POINT:
        found = locate_limit(
            problem, points, effort=effort, highest=loads[-1], solver=solver.name, deadline=deadline
        )
        status, limit_load, spent = found.status, found.load, spent + found.factorizations
    reached = [load for load in loads if load <= points[-1].state.load]
    return Path(rest, tuple(interpolate(points, q) for q in reached), status, limit_load, spent)


def _climb(
    problem: Problem,
    solver: Factorization,
    rest: Point,
    loads: Sequence[float],
    *,
    effort: Effort,
    visit: Visit,
    deadline: float,
) -> tuple[list[Point], Status, int]:
    """Raise the load; return all points, how it ended, and the factorizations spent."""
    points, spent = [rest], 0
    control = StepControl.start(problem, rest, loads, effort)
    while points[-1].state.load < loads[-1]:
        if spent >= effort.total:
            return points, Status.EFFORT_EXHAUSTED, spent
        if time.monotonic() > deadline:
            return points, Status.TIMED_OUT, spent
        if control.is_stuck:
            return points, Status.LIMIT_POINT, spent
        end = control.next_load(points[-1].state.load, loads)
        guess = extrapolate(points, end)
        trial = find_equilibrium(problem, solver, guess=guess, effort=effort)
        spent += trial.factorizations
        if trial.rate is None:
            control = control.failed()
            if control.step < control.smallest:
                return points, Status.LIMIT_POINT, spent
            continue
        visit(trial)
        points.append(Point(trial.state, trial.rate))
        error = float(np.max(np.abs(trial.state.displacement - guess.displacement)))
        control = control.succeeded(error, len(points))
    return points, Status.CONVERGED, spent


def _rest(
    problem: Problem, solver: Factorization, *, effort: Effort, visit: Visit, deadline: float
) -> tuple[Point | None, Status, int]:
    """Find the equilibrium at zero pressure, the dead loads raised in steps.

    Each step starts from the polynomial through the last states.
    """
    states, shares, spent = [problem.system.rest()], [0.0], 0
    step = _first_share(problem)
    while True:
        aim = min(1.0, shares[-1] + step)
        guess = _extrapolated(states, shares, aim)
        trial = find_equilibrium(problem.with_share(aim), solver, guess=guess, effort=effort)
        spent += trial.factorizations
        if trial.rate is not None and aim == 1.0:
            visit(trial)
            return Point(trial.state, trial.rate), Status.CONVERGED, spent
        if time.monotonic() > deadline:
            return None, Status.TIMED_OUT, spent
        if spent > effort.total:
            return None, Status.EFFORT_EXHAUSTED, spent
        if trial.rate is None:
            step *= 0.5
        else:
            states, shares = [*states, trial.state][-MEMORY:], [*shares, aim][-MEMORY:]
            step *= QUICK_GROWTH if trial.factorizations <= QUICK else 1.0
        if step < 0.5 ** (effort.halvings + 1):
            return None, Status.BUCKLED, spent


def _first_share(problem: Problem) -> float:
    """Return a share of the dead loads that is safe to begin with."""
    if not problem.has_dead_load:
        return 1.0
    return min(1.0, SAFE_MISMATCH / max(abs(problem.material.paper_mismatch), SAFE_MISMATCH))


def _extrapolated(states: Sequence[State], shares: Sequence[float], aim: float) -> State:
    """Return the polynomial through states at shares of the dead load, beyond the last."""
    u, p = np.zeros_like(states[0].displacement), np.zeros_like(states[0].pressure)
    for k, (state, share) in enumerate(zip(states, shares, strict=True)):
        others = np.delete(np.array(shares), k)
        weight = float(np.prod((aim - others) / (share - others)))
        u += weight * state.displacement
        p += weight * state.pressure
    return State(u, p, 0.0)
