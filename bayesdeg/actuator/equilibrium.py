"""Newton's method and the load path; a failure is a value, never an exception."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.linear import Factorization, LostDefinitenessError
from bayesdeg.actuator.system import Linearisation, Material, State, System

Floats = NDArray[np.float64]

LONGEST_EXTRAPOLATION = 1e3  # steps over the step before


class Status(IntEnum):
    """How a solution ended; the member's ``advice`` says what it means and what to do."""

    CONVERGED = 0
    LIMIT_POINT = 1
    UNSTABLE_MATERIAL = 2
    EFFORT_EXHAUSTED = 3
    OUTSIDE_TRAINING = 4

    @property
    def advice(self) -> str:
        """What the status means, in plain words."""
        return _ADVICE[self]


_ADVICE = {
    Status.CONVERGED: "equilibrium found",
    Status.LIMIT_POINT: "the actuator balloons before this pressure; there is no stable "
    "equilibrium near by: lower the pressure, or stiffen walls or material",
    Status.UNSTABLE_MATERIAL: "the Yeoh constants soften without bound (C2 <= -sqrt(3 C1 C3) or "
    "C1 <= 0 or C3 < 0): use constants of a stable material",
    Status.EFFORT_EXHAUSTED: "not converged within the allowed iterations: refine the pressure "
    "steps or report the parameters",
    Status.OUTSIDE_TRAINING: "outside the range on which the emulator was trained: narrow the "
    "priors or train an emulator on a wider range",
}


@dataclass(frozen=True)
class Effort:
    """What a path may spend.

    Parameters
    ----------
    tolerance : float
        Largest displacement of the last Newton step over the length of the actuator [–].
    iterations : int
        Newton iterations a step.
    halvings : int
        How often a step may be halved.
    total : int
        Newton iterations a path.
    """

    tolerance: float = 2e-4
    iterations: int = 8
    halvings: int = 5
    total: int = 400


@dataclass(frozen=True)
class Path:
    """Equilibria at the wanted loads, in order, as far as there are any.

    Parameters
    ----------
    states : tuple of State
        One for each load reached.
    status : Status
        How the path ended.
    limit_load : float
        Midpoint between the last load reached and the first refused; inf if none was refused.
    iterations : int
        Newton iterations spent, cut steps included.
    """

    states: tuple[State, ...]
    status: Status
    limit_load: float
    iterations: int


@dataclass(frozen=True)
class _Step:
    state: State
    rate: State | None  # d(state)/d(load); None where Newton's method failed
    iterations: int


def is_elliptic(material: Material) -> bool:
    """Return whether ∂W/∂I₁ > 0 for all strains: C3 ≥ 0 and C2 > −√(3 C1 C3).

    Examples
    --------
    >>> is_elliptic(Material(c2_ratio=-0.5, c3_ratio=0.01, paper_group=100.0))
    False
    """
    c2, c3 = material.c2_ratio, material.c3_ratio
    if c3 > 0.0:
        return bool(c2 > -np.sqrt(3.0 * c3))
    return c3 == 0.0 and c2 >= 0.0


def follow(
    system: System,
    solver: Factorization,
    *,
    material: Material,
    loads: Sequence[float],
    effort: Effort | None = None,
) -> Path:
    """Follow the equilibrium from rest through rising loads.

    Each step starts from the second-order extrapolation that meets the last two states and the
    path's tangent, so that one or two Newton iterations suffice; a step that loses positive
    definiteness, turns an element inside out or does not converge is halved.

    Parameters
    ----------
    system : System
        Discrete equations.
    solver : Factorization
        Direct solver opened on ``system.upper``.
    material : Material
        In units of C1.
    loads : sequence of float
        Pressure over C1, rising, above 0 [–].
    effort : Effort, optional
        Tolerances and bounds.

    Returns
    -------
    Path
        Never raises for a physical reason: look at ``status``.
    """
    effort = effort or Effort()
    if not is_elliptic(material):
        return Path((), Status.UNSTABLE_MATERIAL, 0.0, 0)
    if len(loads) == 0:
        return Path((), Status.CONVERGED, np.inf, 0)
    states: list[State] = []
    here, before = _at_rest(system, solver, material), None
    spent = 1
    smallest = float(np.min(np.diff(np.concatenate([[0.0], loads])))) / 2**effort.halvings
    for target in loads:
        step = target - here.state.load
        while here.state.load < target:
            if spent >= effort.total:
                return Path(tuple(states), Status.EFFORT_EXHAUSTED, np.inf, spent)
            # the last piece ends on the target itself, not a rounding error before it
            end = target if here.state.load + 1.001 * step >= target else here.state.load + step
            guess = _extrapolate(here, before, end)
            trial = _newton(system, solver, material=material, guess=guess, effort=effort)
            spent += trial.iterations
            if trial.rate is not None:
                here, before = trial, here
                continue
            step *= 0.5
            if step < smallest:
                limit = here.state.load + step
                return Path(tuple(states), Status.LIMIT_POINT, limit, spent)
        states.append(here.state)
    return Path(tuple(states), Status.CONVERGED, np.inf, spent)


def _at_rest(system: System, solver: Factorization, material: Material) -> _Step:
    rest = system.rest()
    lin = system.linearise(rest, material)
    solver.factorize(lin.tangent)
    return _Step(rest, _rate(system, solver, lin, rest, material), 1)


def _extrapolate(here: _Step, before: _Step | None, load: float) -> State:
    """Parabola through the last two states that has the path's tangent at the last."""
    assert here.rate is not None  # failed steps never become the start of the next
    step = load - here.state.load
    u, p = step * here.rate.displacement, step * here.rate.pressure
    back = 0.0 if before is None else here.state.load - before.state.load
    # from two states close together the parabola's curvature is all rounding error
    if before is not None and step < LONGEST_EXTRAPOLATION * back:
        ratio = (step / back) ** 2
        u = u + ratio * (
            before.state.displacement - here.state.displacement + back * here.rate.displacement
        )
        p = p + ratio * (before.state.pressure - here.state.pressure + back * here.rate.pressure)
    return replace(here.state.moved(u, p), load=load)


def _newton(
    system: System, solver: Factorization, *, material: Material, guess: State, effort: Effort
) -> _Step:
    """Iterate to equilibrium; ``rate`` is None where it failed."""
    state, length = guess, float(np.ptp(system.mesh.nodes[:, 0]))
    for iteration in range(1, effort.iterations + 1):
        lin = system.linearise(state, material)
        if not lin.smallest_jacobian > 0.0:
            return _Step(state, None, iteration)
        try:
            solver.factorize(lin.tangent)
        except LostDefinitenessError:
            return _Step(state, None, iteration)
        increment = system.expand(-solver.solve(lin.residual))
        largest = float(np.max(np.abs(increment)))
        if not largest < 0.2 * length:
            return _Step(state, None, iteration)
        state = state.moved(increment, system.condensed_pressure(lin, increment, material))
        if largest < effort.tolerance * length:
            return _Step(state, _rate(system, solver, lin, state, material), iteration)
    return _Step(state, None, effort.iterations)


def _rate(
    system: System, solver: Factorization, lin: Linearisation, state: State, material: Material
) -> State:
    """Tangent of the path, du/d(load) and dp/d(load), with the factors at hand."""
    velocity = system.expand(solver.solve(system.cavity_force(state)))
    pressure = system.condensed_pressure(lin, velocity, material, rate=True)
    return State(velocity, pressure, 1.0)
