"""Along the path: polynomials through states and tangents, and how long a step may be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.status import Effort
from bayesdeg.actuator.system import Point, State

Floats = NDArray[np.float64]

MEMORY = 3  # points that the next guess is extrapolated from
LONGEST_EXTRAPOLATION = 4.0  # step over the shortest distance between them
LARGEST_GROWTH = 2.5
STUCK = 1e-5  # of the last load: shorter steps lead nowhere


def extrapolate(points: Sequence[Point], load: float) -> State:
    """Return the Hermite polynomial through the latest points, at a load beyond them.

    Parameters
    ----------
    points : sequence of Point
        The path so far.
    load : float
        Where to.
    """
    loads = np.array([point.state.load for point in points[-MEMORY:]])
    count = len(loads)
    # from points close together extrapolation is all rounding error
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


def hermite(points: Sequence[Point], load: float) -> Point:
    """Return the polynomial through states and tangents, and its derivative, at a load.

    Σ (1 − 2 (t − tₖ) Lₖ'(tₖ)) Lₖ²(t) uₖ + (t − tₖ) Lₖ²(t) u̇ₖ with the Lagrange polynomials Lₖ.
    """
    at = np.array([point.state.load for point in points])
    value, slope = _hermite_factors(at, load)
    fields = []
    for factors in (value, slope):
        u, p = np.zeros_like(points[0].state.displacement), np.zeros_like(points[0].state.pressure)
        for (on_state, on_rate), point in zip(factors, points, strict=True):
            u += on_state * point.state.displacement + on_rate * point.rate.displacement
            p += on_state * point.state.pressure + on_rate * point.rate.pressure
        fields.append((u, p))
    (u, p), (du, dp) = fields
    return Point(State(u, p, load), State(du, dp, 1.0))


def _hermite_factors(at: Floats, load: float) -> tuple[Floats, Floats]:
    """Return factors of values and derivatives, (n, 2), for the value and for the slope."""
    value, slope = np.empty((len(at), 2)), np.empty((len(at), 2))
    for k, place in enumerate(at):
        others = np.delete(at, k)
        lagrange = float(np.prod((load - others) / (place - others)))
        here = float(np.sum(1.0 / (place - others)))
        # L' = Σ_j Π_{i≠j} (t − t_i) / Π (t_k − t_i)
        parts = [np.prod(load - np.delete(others, j)) for j in range(len(others))]
        change = float(np.sum(parts) / np.prod(place - others)) if len(others) else 0.0
        t = load - place
        value[k] = (1.0 - 2.0 * t * here) * lagrange**2, t * lagrange**2
        double = 2.0 * lagrange * change
        slope[k] = (
            -2.0 * here * lagrange**2 + (1.0 - 2.0 * t * here) * double,
            lagrange**2 + t * double,
        )
    return value, slope


@dataclass(frozen=True)
class StepControl:
    """How long the next step of the load may be.

    Parameters
    ----------
    step : float
        Wanted length of the next step [–].
    smallest : float
        A step that fails is not tried below it [–].
    end : float
        The last load [–].
    target : float
        Wanted error of the guess [mm].
    exact : bool
        Whether every load must be met.
    """

    step: float
    smallest: float
    end: float
    target: float
    exact: bool

    @classmethod
    def start(cls, problem: Problem, rest: Point, loads: Sequence[float], effort: Effort) -> Self:
        """Return the control at the beginning of a path: a first step that bends little."""
        size = float(np.ptp(problem.system.body.nodes, axis=0).max())
        speed = float(np.max(np.abs(rest.rate.displacement)))
        first = effort.first_step * size / max(speed, 1e-300)
        gaps = np.diff(np.concatenate([[0.0], loads]))
        smallest = min(float(np.min(gaps)), float(loads[-1]) / len(loads)) / 2**effort.halvings
        target = effort.tolerance * size
        end = float(loads[-1])
        return cls(min(first, end), smallest, end, target, effort.exact)

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
        """Whether steps have become so short, though none failed, that the end is out of reach."""
        return self.step < STUCK * self.end

    def failed(self) -> Self:
        """Return the control after a step that failed."""
        return replace(self, step=0.5 * self.step)

    def succeeded(self, error: float, points: int) -> Self:
        """Return the control after a step whose guess was off by ``error`` [mm]."""
        order = 2 * min(points, MEMORY) - 1
        growth = (0.5 * self.target / max(error, 1e-300)) ** (1.0 / order)
        return replace(self, step=self.step * float(np.clip(growth, 0.4, LARGEST_GROWTH)))
