"""The load path; a failure is a value, never an exception."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.continuation import StepControl, extrapolate, interpolate
from bayesdeg.actuator.limit import locate_limit
from bayesdeg.actuator.linear import Factorization
from bayesdeg.actuator.material import is_elliptic
from bayesdeg.actuator.newton import Step, find_equilibrium
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.status import Effort, Status
from bayesdeg.actuator.system import Point, State

Floats = NDArray[np.float64]
Visit = Callable[[Step], None]


@dataclass(frozen=True)
class Path:
    """Equilibria at the wanted loads, in order, as far as there are any.

    Parameters
    ----------
    rest : State, optional
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
    rest, spent = _rest(problem, solver, effort, visit)
    if rest is None:
        exhausted = spent > effort.total
        status = Status.EFFORT_EXHAUSTED if exhausted else Status.BUCKLED
        return Path(None, (), status, np.inf if exhausted else 0.0, spent)
    if len(loads) == 0:
        return Path(rest, (), Status.CONVERGED, np.inf, spent)
    points, status, tried = _climb(problem, solver, rest, loads, effort=effort, visit=visit)
    spent += tried
    limit_load = np.inf
    if status == Status.LIMIT_POINT:
        found = locate_limit(problem, points, effort=effort, highest=loads[-1])
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
) -> tuple[list[Point], Status, int]:
    """Raise the load; return all points, how it ended, and the factorizations spent."""
    points, spent = [rest], 0
    control = StepControl.start(problem, rest, loads, effort)
    while points[-1].state.load < loads[-1]:
        if spent >= effort.total:
            return points, Status.EFFORT_EXHAUSTED, spent
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
    problem: Problem, solver: Factorization, effort: Effort, visit: Visit
) -> tuple[Point | None, int]:
    """Find the equilibrium at zero pressure, the dead loads raised in steps."""
    state, share, step, spent = problem.system.rest(), 0.0, 1.0, 0
    while True:
        aim = min(1.0, share + step) if problem.has_dead_load else 1.0
        trial = find_equilibrium(problem.with_share(aim), solver, guess=state, effort=effort)
        spent += trial.factorizations
        if trial.rate is None:
            step *= 0.5
        if step < 0.5 ** (effort.halvings + 1) or spent > effort.total:
            return None, spent
        if trial.rate is None:
            continue
        state, share = trial.state, aim
        if share == 1.0:
            visit(trial)
            return Point(state, trial.rate), spent
