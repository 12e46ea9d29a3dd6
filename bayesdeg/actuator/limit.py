"""The limit point: volume control past the largest pressure that an actuator can bear."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.linear import Indefinite, LostDefinitenessError, open_indefinite
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.status import Effort, Status
from bayesdeg.actuator.system import Point, State

Floats = NDArray[np.float64]

STEPS = 40
ITERATIONS = 12
LARGEST_STEP = 0.2
WIDEST = 2e-3  # relative width of the bracket, in load, within which a cubic gives the limit


@dataclass(frozen=True)
class Limit:
    """Where a path cannot be followed further, and why.

    Parameters
    ----------
    status : Status
        LIMIT_POINT, BUCKLED, EFFORT_EXHAUSTED or TIMED_OUT.
    load : float
        Largest load; inf if it was not found [–].
    factorizations : int
        Spent.
    """

    status: Status
    load: float
    factorizations: int


@dataclass(frozen=True)
class _Place:
    """An equilibrium under volume control."""

    state: State
    volume: float
    load_rate: float  # d(load)/d(volume)
    direction: State  # d(state)/d(volume)
    negative: int  # eigenvalues of the tangent


def locate_limit(
    problem: Problem,
    points: Sequence[Point],
    *,
    effort: Effort,
    highest: float,
    solver: str | None = None,
    deadline: float = np.inf,
) -> Limit:
    """Return the load at which the pressure no longer rises with the volume.

    The volume of the cavity is raised in steps with the pressure as an unknown: where d(load)/dV
    changes its sign the actuator balloons. If the tangent becomes indefinite while the pressure
    still rises, the shape buckles instead.

    Parameters
    ----------
    problem : Problem
        As it was followed.
    points : sequence of Point
        The path as far as it was followed under pressure control.
    effort : Effort
        Tolerances and bounds.
    highest : float
        Largest load of interest [–]; beyond twice that the search ends.
    solver : str, optional
        Name of the direct solver; by default the best that this machine has.
    deadline : float
        Of ``time.monotonic``, after which the search is given up [s].
    """
    opened = open_indefinite(problem.system.upper, solver)
    search = _Search(problem, opened, effort)
    try:
        return search.run(points, highest, deadline)
    finally:
        opened.close()


class _Search:
    def __init__(self, problem: Problem, solver: Indefinite, effort: Effort) -> None:
        self.problem, self.solver, self.effort = problem, solver, effort
        self.size = float(np.ptp(problem.system.body.nodes, axis=0).max())
        self.spent = 0

    def run(self, points: Sequence[Point], highest: float, deadline: float) -> Limit:
        last = points[-1]
        here = self._settle(last.state, self._volume(last.state))
        if here is None:
            return Limit(Status.EFFORT_EXHAUSTED, np.inf, self.spent)
        step = self._first_step(points, here)
        for _ in range(STEPS):
            if time.monotonic() > deadline:
                return Limit(Status.TIMED_OUT, np.inf, self.spent)
            if here.negative > 0 and here.load_rate > 0.0:
                return Limit(Status.BUCKLED, here.state.load, self.spent)
            if here.state.load > 2.0 * highest or self.spent > self.effort.total:
                break
            there = self._settle(self._ahead(here, step), here.volume + step)
            if there is None:
                step *= 0.5
                continue
            if there.load_rate <= 0.0:
                top, width = _top(here, there)
                if width < WIDEST:
                    return Limit(Status.LIMIT_POINT, top, self.spent)
                step *= 0.5
                continue
            here, step = there, 1.5 * step
        return Limit(Status.EFFORT_EXHAUSTED, np.inf, self.spent)

    def _first_step(self, points: Sequence[Point], here: _Place) -> float:
        back = points[-2].state if len(points) > 1 else self.problem.system.rest()
        return 0.5 * max(here.volume - self._volume(back), 1e-3 * abs(here.volume))

    def _volume(self, state: State) -> float:
        return self.problem.cavity_volume(state)

    def _ahead(self, here: _Place, step: float) -> State:
        d = here.direction
        return here.state.moved(step * d.displacement, step * d.pressure, step * here.load_rate)

    def _settle(self, guess: State, volume: float) -> _Place | None:
        """Newton's method with the load as an unknown and the volume given."""
        state, problem = guess, self.problem
        for _ in range(ITERATIONS):
            lin = problem.linearise(state)
            if not lin.smallest_jacobian > 0.0:
                return None
            self.spent += 1
            try:
                negative = self.solver.factorize(lin.tangent)
            except LostDefinitenessError:
                return None
            gradient = problem.on_free(problem.cavity_gradient(state))
            a, b = self.solver.solve(np.column_stack([-lin.residual, gradient])).T
            compliance = float(gradient @ b)
            change = (volume - lin.cavity_volume - float(gradient @ a)) / compliance
            increment = problem.system.expand(a + change * b)
            largest = float(np.max(np.abs(increment)))
            if not largest < LARGEST_STEP * self.size:
                return None
            pressure = problem.pressure_increment(lin, increment, lin.volume_residual)
            state = state.moved(increment, pressure, change)
            if largest < self.effort.tolerance * self.size:
                along = problem.system.expand(b / compliance)
                direction = State(along, problem.pressure_increment(lin, along), 1.0)
                return _Place(state, volume, 1.0 / compliance, direction, negative)
        return None


def _top(here: _Place, there: _Place) -> tuple[float, float]:
    """Return the largest load of the cubic between two places, and the bracket's width."""
    width = there.volume - here.volume
    rise = there.state.load - here.state.load
    # load(t) on [0, 1]: c0 + c1 t + c2 t² + c3 t³
    c1, end = here.load_rate * width, there.load_rate * width
    c2, c3 = 3.0 * rise - 2.0 * c1 - end, c1 + end - 2.0 * rise
    t = np.linspace(0.0, 1.0, 2001)
    load = here.state.load + t * (c1 + t * (c2 + t * c3))
    top = float(np.max(load))
    return top, (top - max(here.state.load, 0.0)) / top
