"""Load path: Newton's method, continuation, limit point; failures are returned, not raised."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import KroghInterpolator

from bayesdeg.actuator.linear import Factorization, LostDefinitenessError, open_factorization
from bayesdeg.actuator.material import is_elliptic
from bayesdeg.actuator.problem import DiscreteEquations, Linearisation, MechanicalState, Point
from bayesdeg.actuator.status import PathEffort, Status

Floats = NDArray[np.float64]

LARGEST_STEP = 0.2  # of the body's size; beyond it the iteration has diverged
CORRECTIONS = 8
ROUNDING = 1e-7  # of the body's size: smaller corrections need not decrease
SHRINKAGE = 0.7  # required ratio of each correction to the previous one


@dataclass(frozen=True)
class LoadStep:
    """An equilibrium at one load, or the last iterate of a failed search.

    Parameters
    ----------
    state : MechanicalState
        The last iterate.
    rate : MechanicalState, optional
        d(state)/d(load); None if the method failed.
    factors : Linearisation, optional
        Linearisation whose tangent the solver holds.
    factorizations : int
        Number of factorizations.
    """

    state: MechanicalState
    rate: MechanicalState | None
    factors: Linearisation | None
    factorizations: int


def find_equilibrium(
    problem: DiscreteEquations, solver: Factorization, *, guess: MechanicalState, effort: PathEffort
) -> LoadStep:
    """Iterate from a guess to the equilibrium at its load.

    The remaining error is proportional to the square of the last step, bounded by the tolerance.
    The path's tangent comes from the last factors, corrected until it is that of the last state.
    """
    state, size = guess, float(np.ptp(problem.system.body.nodes, axis=0).max())
    for count in range(1, effort.iterations + 1):
        now = problem.linearise(state)
        if not now.smallest_jacobian > 0.0:
            return LoadStep(state, None, None, count)
        try:
            solver.factorize(now.tangent)
        except LostDefinitenessError:
            return LoadStep(state, None, None, count)
        pushed = problem.system.on_free(problem.cavity_gradient(state))
        solution = solver.solve(np.column_stack([-now.residual, pushed]))
        increment, velocity = (problem.system.expand(column) for column in solution.T)
        largest = float(np.max(np.abs(increment)))
        if not largest < LARGEST_STEP * size:
            return LoadStep(state, None, None, count)
        change = problem.pressure_increment(now, increment, now.volume_residual)
        state = state.moved(increment, change)
        if largest < effort.tolerance * size:
            rate = MechanicalState(velocity, problem.pressure_increment(now, velocity), 1.0)
            point = polished(problem, solver, Point(state, rate), now, effort)
            if point is not None:
                return LoadStep(point.state, point.rate, now, count)
    return LoadStep(state, None, None, effort.iterations)


def polished(
    problem: DiscreteEquations,
    solver: Factorization,
    point: Point,
    factors: Linearisation,
    effort: PathEffort,
) -> Point | None:
    """Return an equilibrium and the path's tangent from approximate ones and nearby factors.

    Each correction takes a step of the modified Newton method of the mixed problem, in which the
    couplings of the volume equation are as old as the factors, so that a large K does no harm, and
    removes the defect of the linear equation of the rate. It ends when a correction changes less
    than ``effort.rate_tolerance`` of the largest velocity. None if the corrections do not decrease:
    the factors are too old.
    """
    size = float(np.ptp(problem.system.body.nodes, axis=0).max())
    least = ROUNDING * size
    largest_move, largest_change = max(effort.tolerance * size, least), np.inf
    for _ in range(CORRECTIONS):
        state, rate = point.state, point.rate
        now = problem.linearise(state, tangent=False)
        residuals = [(now.force, now.volume_residual), *problem.products(state, [rate])]
        right = [problem.condensed(force, volume, factors) for force, volume in residuals]
        solution = solver.solve(np.column_stack(right))
        moves = []
        for column, (_, volume) in zip(solution.T, residuals, strict=True):
            displacement = problem.system.expand(-column)
            moves.append((displacement, problem.pressure_increment(factors, displacement, volume)))
        move, change = (float(np.max(np.abs(u))) for u, _ in moves)
        if not (move <= largest_move and change <= largest_change):
            return None
        point = Point(state.moved(*moves[0]), rate.moved(*moves[1]))
        whole = float(np.max(np.abs(rate.displacement)))
        if change <= effort.rate_tolerance * whole:
            return point
        largest_move = max(SHRINKAGE * move, least)
        largest_change = max(SHRINKAGE * change, ROUNDING * whole)
    return None


MEMORY = 3  # points from which the next guess is extrapolated
LONGEST_EXTRAPOLATION = 4.0  # largest step over the shortest distance between them
LARGEST_GROWTH = 2.5
STUCK = 1e-5  # of the last load: shorter steps are hopeless


def extrapolate(points: Sequence[Point], load: float) -> MechanicalState:
    """Return the Hermite polynomial through the latest points, at a load beyond them."""
    loads = np.array([point.state.load for point in points[-MEMORY:]])
    count = len(loads)
    # extrapolation from close points is dominated by rounding
    while count > 1 and load - loads[-1] > LONGEST_EXTRAPOLATION * np.min(np.diff(loads[-count:])):
        count -= 1
    return hermite(points[-count:], load).state


def interpolate(points: Sequence[Point], load: float) -> Point:
    """Return the Hermite polynomial through the points next to a load."""
    loads = np.array([point.state.load for point in points])
    at = int(np.searchsorted(loads, load))
    if loads[at] == load:
        return points[at]
    first = int(np.clip(at - MEMORY // 2 - 1, 0, max(0, len(points) - MEMORY)))
    return hermite(points[first : first + MEMORY], load)


def hermite(points: Sequence[Point], place: float, *, at: Sequence[float] | None = None) -> Point:
    """Return the polynomial through states and tangents, and its derivative, at a place.

    Σ (1 − 2 (t − tₖ) Lₖ'(tₖ)) Lₖ²(t) uₖ + (t − tₖ) Lₖ²(t) u̇ₖ with the Lagrange polynomials Lₖ. The
    points are ``at`` these parameters, by which their rates are; by default their loads.
    """
    loads = [point.state.load for point in points]
    places = np.array(loads if at is None else at, dtype=np.float64)
    # factors of states and of tangents, for the polynomial and for its derivative
    value, slope = np.empty((len(places), 2)), np.empty((len(places), 2))
    for k, own in enumerate(places):
        others = np.delete(places, k)
        lagrange = float(np.prod((place - others) / (own - others)))
        here = float(np.sum(1.0 / (own - others)))
        # L' = Σ_j Π_{i≠j} (t − t_i) / Π (t_k − t_i)
        parts = [np.prod(place - np.delete(others, j)) for j in range(len(others))]
        change = float(np.sum(parts) / np.prod(own - others)) if len(others) else 0.0
        t = place - own
        value[k] = (1.0 - 2.0 * t * here) * lagrange**2, t * lagrange**2
        double = 2.0 * lagrange * change
        slope[k] = (
            -2.0 * here * lagrange**2 + (1.0 - 2.0 * t * here) * double,
            lagrange**2 + t * double,
        )
    fields = []
    for factors in (value, slope):
        u, p = np.zeros_like(points[0].state.displacement), np.zeros_like(points[0].state.pressure)
        load = 0.0
        for (on_state, on_rate), point in zip(factors, points, strict=True):
            u += on_state * point.state.displacement + on_rate * point.rate.displacement
            p += on_state * point.state.pressure + on_rate * point.rate.pressure
            load += on_state * point.state.load + on_rate * point.rate.load
        fields.append(MechanicalState(u, p, load))
    state, rate = fields
    return Point(replace(state, load=place) if at is None else state, rate)  # without rounding


@dataclass(frozen=True)
class StepControl:
    """Control of the load step.

    Parameters
    ----------
    step : float
        Desired length of the next step [–].
    smallest : float
        A failed step is not retried below it [–].
    end : float
        The last load [–].
    longest : float
        Maximum step [–].
    target : float
        Desired error of the guess [mm].
    exact : bool
        Whether every load must be met.
    memory : int
        Maximum number of points used for extrapolation.
    """

    step: float
    smallest: float
    end: float
    longest: float
    target: float
    exact: bool
    memory: int = MEMORY

    @classmethod
    def start(
        cls, problem: DiscreteEquations, rest: Point, loads: Sequence[float], effort: PathEffort
    ) -> Self:
        """Return the control at the beginning of a path: a first step with little bending."""
        size = float(np.ptp(problem.system.body.nodes, axis=0).max())
        speed = float(np.max(np.abs(rest.rate.displacement)))
        first = effort.first_step * size / max(speed, 1e-300)
        gaps = np.diff(np.concatenate([[0.0], loads]))
        smallest = min(float(np.min(gaps)), float(loads[-1]) / len(loads)) / 2**effort.halvings
        target = effort.tolerance * size
        end = float(loads[-1])
        longest = end / effort.steps
        return cls(min(first, longest), smallest, end, longest, target, effort.exact)

    def next_load(self, here: float, loads: Sequence[float]) -> float:
        """Return where the next step ends; never just short of the last load."""
        wanted = [load for load in loads if load > here]
        aim = wanted[0] if self.exact else wanted[-1]
        left = aim - here
        if self.step >= 0.999 * left:
            return aim
        return here + (0.5 * left if self.step > 0.6 * left else self.step)

    @property
    def is_stuck(self) -> bool:
        """Whether steps are so short, without any failure, that the end is out of reach."""
        return self.step < STUCK * self.end

    def failed(self, trial: LoadStep) -> Self:
        """Return the control after a step that failed.

        A guess that is itself impossible was extrapolated across a kink, as where paper begins to
        wrinkle: there the last tangent alone is a better guess than half the step.
        """
        if trial.factorizations == 1 and self.memory > 1:
            return replace(self, memory=1)
        return replace(self, step=0.5 * self.step, memory=MEMORY)

    def succeeded(self, error: float, points: int) -> Self:
        """Return the control after a step whose guess was off by ``error`` [mm]."""
        order = 2 * min(points, self.memory) - 1
        growth = (0.5 * self.target / max(error, 1e-300)) ** (1.0 / order)
        step = self.step * float(np.clip(growth, 0.4, LARGEST_GROWTH))
        return replace(self, step=min(step, self.longest), memory=min(self.memory + 1, MEMORY))


Visit = Callable[[LoadStep, Factorization], None]
"""Called with a converged step and the solver that holds its factors."""

STEPS = 60
ITERATIONS = 12
CLOSE = 0.03  # of the tolerance: a step under volume control ends with the factors of its own state
DROP = 0.02  # of the largest load
LONG = 3.0  # error of the guess over that of a load step: one more iteration, but fewer steps


@dataclass(frozen=True)
class Limit:
    """End of a path that cannot be followed further by its load, and why.

    Parameters
    ----------
    status : Status
        LIMIT_POINT, BUCKLED, EFFORT_EXHAUSTED or TIMED_OUT; CONVERGED at the highest load
        of interest.
    load : float
        Largest load; inf if not found [–].
    factorizations : int
        Number of factorizations.
    """

    status: Status
    load: float
    factorizations: int


@dataclass(frozen=True)
class _Place:
    """An equilibrium of a given volume; ``point`` has d(state)/d(volume) as its rate."""

    point: Point
    volume: float
    factors: Linearisation
    negative: int  # eigenvalues of the tangent

    @property
    def load(self) -> float:
        return self.point.state.load

    @property
    def is_rising(self) -> bool:
        return self.point.rate.load > 0.0

    @property
    def step(self) -> LoadStep:
        """The equilibrium with d(state)/d(load)."""
        by, d = 1.0 / self.point.rate.load, self.point.rate
        rate = MechanicalState(by * d.displacement, by * d.pressure, 1.0)
        return LoadStep(self.point.state, rate, self.factors, 0)


def follow_volume(
    problem: DiscreteEquations,
    solver: Factorization,
    points: Sequence[Point],
    *,
    effort: PathEffort,
    highest: float,
    deadline: float = np.inf,
    visit: Visit = lambda step, solver: None,
) -> Limit:
    """Follow a path by its cavity volume to the load at which the pressure no longer rises.

    The volume is raised in steps with the pressure as an unknown: where d(load)/dV changes sign
    the actuator balloons. From there the path is followed until the volume has grown by the share
    ``effort.beyond``, or the load has fallen by `DROP`: further on the volume may turn back too.
    If the tangent becomes indefinite while the pressure still rises, the shape buckles instead.

    The path ends where it passes the ``highest`` load of interest [–], or at ``deadline``, a time
    of ``time.monotonic`` [s]. ``solver`` is for definite tangents; another one takes over where
    they no longer are.
    """
    size = float(np.ptp(problem.system.body.nodes, axis=0).max())
    with closing(_Solvers(problem.system.upper, solver)) as solvers:
        start = problem.cavity_volume(points[-1].state)
        here, spent = _settle(problem, solvers, points[-1].state, start, effort)
        if here is None:
            return Limit(Status.EFFORT_EXHAUSTED, np.inf, spent)
        speed = float(np.max(np.abs(here.point.rate.displacement)))
        step = effort.first_step * size / speed
        if len(points) > 1:
            step = min(step, start - problem.cavity_volume(points[-2].state))
        places, top, end = [here], np.inf, np.inf
        for _ in range(STEPS):
            here, is_past = places[-1], bool(np.isfinite(top))
            if here.volume >= end or (is_past and here.load < (1.0 - DROP) * top):
                return Limit(Status.LIMIT_POINT, top, spent)
            # twice, as rounding decides just below a limit point
            if not is_past and all(place.negative > 0 for place in places[-2:]):
                return Limit(Status.BUCKLED, places[-2:][0].load, spent)
            if here.load >= highest and not is_past:
                return Limit(Status.CONVERGED, np.inf, spent)
            if time.monotonic() > deadline:
                return Limit(Status.TIMED_OUT, np.inf, spent)
            if spent > effort.total:
                break
            if not is_past and np.isfinite(highest) and here.is_rising:
                step = min(step, highest / effort.steps / here.point.rate.load)
            aim = min(here.volume + step, end)
            at = [place.volume for place in places[-MEMORY:]]
            guess = hermite([place.point for place in places[-MEMORY:]], aim, at=at).state
            there, count = _settle(problem, solvers, guess, aim, effort)
            spent += count
            if there is None:
                step *= 0.5
                continue
            error = float(np.max(np.abs(there.point.state.displacement - guess.displacement)))
            allowed = LONG * effort.tolerance * size
            growth = (0.5 * allowed / max(error, 1e-300)) ** (1.0 / (2 * len(at) - 1))
            step = (aim - here.volume) * float(np.clip(growth, 0.4, LARGEST_GROWTH))
            places.append(there)
            visit(there.step, solvers.used)
            if not (there.is_rising or is_past):
                top, place = _top(places[-MEMORY:])
                end = place * (1.0 + effort.beyond)
    return Limit(Status.EFFORT_EXHAUSTED, top, spent)


class _Solvers:
    """A solver for definite tangents, and one for others, opened where the first is lost."""

    def __init__(self, upper: sp.csr_array, definite: Factorization) -> None:
        self._upper, self.used = upper, definite
        self._other: Factorization | None = None

    def factorize(self, data: Floats) -> int:
        """Factorize, see `Factorization`; return the number of negative eigenvalues."""
        if self._other is None:
            try:
                return self.used.factorize(data)
            except LostDefinitenessError:
                name = self.used.name
                self._other = open_factorization(self._upper, name, is_definite=False)
                self.used = self._other
        return self._other.factorize(data)

    def close(self) -> None:
        """Release the memory of the second solver."""
        if self._other is not None:
            self._other.close()


def _settle(
    problem: DiscreteEquations,
    solvers: _Solvers,
    guess: MechanicalState,
    volume: float,
    effort: PathEffort,
) -> tuple[_Place | None, int]:
    """Find the equilibrium of a given volume by Newton's method; count the factorizations."""
    state, size, spent = guess, float(np.ptp(problem.system.body.nodes, axis=0).max()), 0
    for _ in range(ITERATIONS):
        lin = problem.linearise(state)
        if not lin.smallest_jacobian > 0.0:
            break
        spent += 1
        try:
            negative = solvers.factorize(lin.tangent)
        except LostDefinitenessError:
            break
        gradient = problem.system.on_free(problem.cavity_gradient(state))
        a, b = solvers.used.solve(np.column_stack([-lin.residual, gradient])).T
        compliance = float(gradient @ b)
        change = (volume - lin.cavity_volume - float(gradient @ a)) / compliance
        increment = problem.system.expand(a + change * b)
        largest = float(np.max(np.abs(increment)))
        if not largest < LARGEST_STEP * size:
            break
        pressure = problem.pressure_increment(lin, increment, lin.volume_residual)
        state = state.moved(increment, pressure, change)
        if largest < CLOSE * effort.tolerance * size:
            along = problem.system.expand(b / compliance)
            within = problem.pressure_increment(lin, along)
            rate = MechanicalState(along, within, 1.0 / compliance)
            return _Place(Point(state, rate), volume, lin, negative), spent
    return None, spent


def _top(places: Sequence[_Place]) -> tuple[float, float]:
    """Return the largest load between the last two places, and its volume."""
    known = np.array([(place.load, place.point.rate.load) for place in places])
    at = [place.volume for place in places]
    volume = np.linspace(at[-2], at[-1], 2001)
    load = KroghInterpolator(np.repeat(at, 2), known.ravel())(volume)
    top = int(np.argmax(load))
    return float(load[top]), float(volume[top])


SAFE_MISMATCH = 1e-3  # mismatch strain of the paper that one step from rest can take
QUICK, QUICK_GROWTH = 3, 2.0  # a step with this few factorizations lengthens the next


@dataclass(frozen=True)
class Path:
    """Equilibria at the requested loads, in order, as far as reached.

    Parameters
    ----------
    rest : Point, optional
        The equilibrium at zero pressure; None if there is none.
    points : tuple of Point
        State and d(state)/d(load) at each load reached.
    status : Status
        Status of the path.
    limit_load : float
        Load of the limit point, or of buckling; inf if none was reached.
    iterations : int
        Number of factorizations, including rejected steps.
    """

    rest: Point | None
    points: tuple[Point, ...]
    status: Status
    limit_load: float
    iterations: int

    @property
    def states(self) -> tuple[MechanicalState, ...]:
        """One for each load reached."""
        return tuple(point.state for point in self.points)


def follow(
    problem: DiscreteEquations,
    solver: Factorization,
    *,
    loads: Sequence[float],
    effort: PathEffort | None = None,
    visit: Visit | None = None,
) -> Path:
    """Follow the equilibrium from rest through increasing loads.

    Dead loads come first, at zero pressure. Each step starts from the polynomial through the last
    states and the path's tangents there, and is as long as that polynomial is accurate enough for
    one Newton step. Between the ends of steps the same kind of polynomial interpolates, unless
    ``effort.exact`` requests an equilibrium at every load. A step that loses positive definiteness,
    inverts an element or does not converge is retried with a guess by the last tangent alone, or
    halved; when it cannot be halved further, the limit point is searched.

    ``loads`` are the pressures over C1, increasing, above 0 [–]; ``visit`` is called with each
    converged step, rest first, also those beyond a limit point (``effort.beyond``). Nothing
    is raised for a physical reason: check the path's status.
    """
    effort = effort or PathEffort()
    if not is_elliptic(problem.material):
        return Path(None, (), Status.UNSTABLE_MATERIAL, 0.0, 0)
    visit = visit or (lambda step, solver: None)
    deadline = time.monotonic() + effort.seconds
    rest, status, spent = _rest(problem, solver, effort=effort, visit=visit, deadline=deadline)
    if rest is None:
        limit = 0.0 if status == Status.BUCKLED else np.inf
        return Path(None, (), status, limit, spent)
    if len(loads) == 0:
        return Path(rest, (), Status.CONVERGED, np.inf, spent)
    if effort.beyond > 0.0:
        found = follow_volume(
            *(problem, solver, [rest]),
            effort=effort,
            highest=loads[-1],
            deadline=deadline,
            visit=visit,
        )
        spent += found.factorizations
        return Path(rest, (), found.status, found.load, spent)
    points, status, tried = _climb(
        problem, solver, rest, loads, effort=effort, visit=visit, deadline=deadline
    )
    spent += tried
    limit_load = np.inf
    if status == Status.LIMIT_POINT:
        found = follow_volume(
            *(problem, solver, points), effort=effort, highest=2.0 * loads[-1], deadline=deadline
        )
        status, limit_load, spent = found.status, found.load, spent + found.factorizations
        if status == Status.CONVERGED:  # far beyond the last load without any limit point
            status = Status.EFFORT_EXHAUSTED
    reached = [load for load in loads if load <= points[-1].state.load]
    return Path(rest, tuple(interpolate(points, q) for q in reached), status, limit_load, spent)


def _climb(
    problem: DiscreteEquations,
    solver: Factorization,
    rest: Point,
    loads: Sequence[float],
    *,
    effort: PathEffort,
    visit: Visit,
    deadline: float,
) -> tuple[list[Point], Status, int]:
    """Raise the load; return all points, the status, and the number of factorizations."""
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
        guess = extrapolate(points[-control.memory :], end)
        trial = find_equilibrium(problem, solver, guess=guess, effort=effort)
        spent += trial.factorizations
        if trial.rate is None:
            control = control.failed(trial)
            if control.step < control.smallest:
                return points, Status.LIMIT_POINT, spent
            continue
        visit(trial, solver)
        points.append(Point(trial.state, trial.rate))
        error = float(np.max(np.abs(trial.state.displacement - guess.displacement)))
        control = control.succeeded(error, len(points))
    return points, Status.CONVERGED, spent


def _rest(
    problem: DiscreteEquations,
    solver: Factorization,
    *,
    effort: PathEffort,
    visit: Visit,
    deadline: float,
) -> tuple[Point | None, Status, int]:
    """Find the equilibrium at zero pressure by raising the dead loads in steps."""
    states, shares, spent = [problem.system.rest()], [0.0], 0
    step = 1.0
    if problem.has_dead_load:  # a safe initial share
        mismatch = abs(problem.material.paper_mismatch)
        step = min(1.0, SAFE_MISMATCH / max(mismatch, SAFE_MISMATCH))
    while True:
        aim = min(1.0, shares[-1] + step)
        u, p = np.zeros_like(states[0].displacement), np.zeros_like(states[0].pressure)
        for k, (state, share) in enumerate(zip(states, shares, strict=True)):
            others = np.delete(np.array(shares), k)
            weight = float(np.prod((aim - others) / (share - others)))
            u += weight * state.displacement
            p += weight * state.pressure
        guess = MechanicalState(u, p, 0.0)
        trial = find_equilibrium(problem.with_share(aim), solver, guess=guess, effort=effort)
        spent += trial.factorizations
        if trial.rate is not None and aim == 1.0:
            visit(trial, solver)
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
