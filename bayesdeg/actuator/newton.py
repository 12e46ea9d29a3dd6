"""Newton's method at one load, and the tangent of the path there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.linear import Factorization, LostDefinitenessError
from bayesdeg.actuator.problem import Linearisation, Problem
from bayesdeg.actuator.status import Effort
from bayesdeg.actuator.system import Point, State

Floats = NDArray[np.float64]

LARGEST_STEP = 0.2  # of the body's size; beyond it the iteration has lost its way
CORRECTIONS = 8
ROUNDING = 1e-7  # of the body's size: smaller corrections need not shrink
SHRINKAGE = 0.7  # of each correction against the one before


@dataclass(frozen=True)
class Step:
    """An equilibrium at one load, or where the search for one stopped.

    Parameters
    ----------
    state : State
        The last iterate.
    rate : State, optional
        d(state)/d(load); None where the method failed.
    factors : Linearisation, optional
        Whose tangent the solver holds.
    factorizations : int
        How many were made.
    """

    state: State
    rate: State | None
    factors: Linearisation | None
    factorizations: int


def find_equilibrium(
    problem: Problem, solver: Factorization, *, guess: State, effort: Effort
) -> Step:
    """Iterate from a guess to the equilibrium at its load.

    The error left is in proportion to the square of the last step, which the tolerance bounds.
    The path's tangent comes from the last factors, corrected until it is that of the last state.
    """
    state, size = guess, float(np.ptp(problem.system.body.nodes, axis=0).max())
    for count in range(1, effort.iterations + 1):
        now = problem.linearise(state)
        if not now.smallest_jacobian > 0.0:
            return Step(state, None, None, count)
        try:
            solver.factorize(now.tangent)
        except LostDefinitenessError:
            return Step(state, None, None, count)
        pushed = problem.on_free(problem.cavity_gradient(state))
        solution = solver.solve(np.column_stack([-now.residual, pushed]))
        increment, velocity = (problem.system.expand(column) for column in solution.T)
        largest = float(np.max(np.abs(increment)))
        if not largest < LARGEST_STEP * size:
            return Step(state, None, None, count)
        change = problem.pressure_increment(now, increment, now.volume_residual)
        state = state.moved(increment, change)
        if largest < effort.tolerance * size:
            rate = State(velocity, problem.pressure_increment(now, velocity), 1.0)
            point = polished(problem, solver, Point(state, rate), now, effort)
            if point is not None:
                return Step(point.state, point.rate, now, count)
    return Step(state, None, None, effort.iterations)


def polished(
    problem: Problem, solver: Factorization, point: Point, factors: Linearisation, effort: Effort
) -> Point | None:
    """Return an equilibrium and the path's tangent from approximate ones and factors near by.

    Each correction takes a step of the modified Newton method of the mixed problem, in which the
    couplings of the volume equation are as old as the factors, so that a large K does no harm,
    and removes the defect of the linear equation of the rate. It ends where one changes less
    than ``effort.rate_tolerance`` of the largest velocity. None if the corrections do not shrink:
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
