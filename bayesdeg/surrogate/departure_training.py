"""Train the departure of a map with dimensions: choice of curves, and their fit.

Curves of the study's design are solved with a dimension changed by moving the mesh. The difference
to the unmoved curve on the same mesh, at the same swelling, hardly depends on the mesh; a few dozen
coarse curves with derivatives determine it, and few fine ones correct it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.demand import MEASURES
from bayesdeg.actuator.families import with_dimensions
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.surrogate.departure import Departure
from bayesdeg.surrogate.kept import PAIRED
from bayesdeg.surrogate.regression import (
    ANGLES,
    EQUIVALENT,
    INSIDE,
    INSIDE_SD,
    LOADS,
    STRETCH,
    WEIBULL,
    Equations,
    Observed,
    Prior,
    fit_scaled,
    rows_of,
)
from bayesdeg.surrogate.scaling import CAUSES
from bayesdeg.surrogate.surrogate import OUTPUTS
from bayesdeg.surrogate.terms import Family, Terms, stacked

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LEVELS = (1.0, 2.0, 3.0)
"""Steps by which a dimension is moved in successive curves, within its range."""
MORE_DEPARTING, MORE_DEPARTING_FINE = 4, 1  # of the curves added where a posterior lies

_NO_CAUSE, _ONCE = len(CAUSES) * (0,), len(CAUSES) * (1,)
BY_POWER = {
    1: Family((5, 2, 2, 2), (2, 1, 1, 1), _ONCE),
    2: Family((4, 1, 1, 1), (0, 0, 0, 0), _NO_CAUSE),
    3: Family((3, 1, 0, 0), (0, 0, 0, 0), _NO_CAUSE),
}
"""Terms of a power of a dimension."""
OF_PAIRS = Family((3, 1, 1, 1), (0, 0, 0, 0), _NO_CAUSE)
OF_FINE = Family((1, 0, 0, 0), (0, 0, 0, 0), _NO_CAUSE)  # terms of the fine mesh's difference
PRIOR = Prior(0.7, 0.5, 0.4, 3e-3)
A_POWER = 0.4  # expected decay of coefficients per power
LEAST_ERROR = 1e-4  # per step: rounding of the paths of two curves

BLOCKS = ((ANGLES, True), (STRETCH, False), (WEIBULL, True), (EQUIVALENT, False), (LOADS, True))
"""Outputs fitted together, and whether with derivatives."""


@dataclass(frozen=True)
class MovedCurve:
    """A curve solved with changed dimensions.

    Parameters
    ----------
    curve : Curve
        Curve of a design.
    is_fine : bool
        Whether it is on the fine mesh.
    away : tuple of float
        Number of steps by which each uncertain dimension is moved.
    """

    curve: Curve
    is_fine: bool
    away: tuple[float, ...]

    def geometry(self, nominal: Moulded, dimensions: Sequence[UncertainDimension]) -> Moulded:
        """Return the actuator of this curve."""
        return with_dimensions(
            nominal,
            {
                one.name: round(one.median + away * one.step, 9)
                for one, away in zip(dimensions, self.away, strict=True)
                if away != 0.0
            },
        )


def moved_curves(
    dimensions: Sequence[UncertainDimension], coarse: Sequence[Curve], fine: Sequence[Curve]
) -> list[MovedCurve]:
    """Return the curves with moved dimensions, grouped by actuator.

    Examples
    --------
    >>> from bayesdeg.actuator.material import MaterialGroups
    >>> from bayesdeg.priors import Normal
    >>> curve = Curve((1.0,), MaterialGroups(0.0, 0.01, 100.0))
    >>> length = UncertainDimension("length", Normal(50.0, 1.0), 47.0, 52.0)
    >>> [one.away for one in moved_curves([length], 3 * [curve], [])]
    [(-3.0,), (-2.0,), (-1.0,), (1.0,), (2.0,), (2.0,)]
    """
    found = []
    for k, one in enumerate(dimensions):
        low, high = one.range
        for sign in (-1.0, 1.0):
            for is_fine, curves in ((False, coarse), (True, fine)):
                for j, curve in enumerate(curves):
                    step = float(np.clip(sign * LEVELS[j % len(LEVELS)], low, high))
                    away = [step if i == k else 0.0 for i in range(len(dimensions))]
                    found.append(MovedCurve(curve, is_fine, tuple(away)))
    for first, second in combinations(range(len(dimensions)), 2):
        for j, curve in enumerate(coarse[:PAIRED]):
            signs = {first: 1.0 - 2.0 * (j % 2), second: 1.0 - 2.0 * (j // 2 % 2)}
            away = [
                float(np.clip(signs.get(i, 0.0), *one.range)) for i, one in enumerate(dimensions)
            ]
            found.append(MovedCurve(curve, is_fine=False, away=tuple(away)))
    return sorted(found, key=lambda one: (one.is_fine, one.away))


def departed(nominal: Observed, moved: Observed) -> Observed | None:
    """Return the departure of a moved curve at its swelling; None if there are fewer than two.

    Readings of the unmoved curve in between are interpolated from its readings, and from their
    derivatives where known.
    """
    low, high = nominal.along[[0, -1]]
    inside = (moved.along >= low) & (moved.along <= high)
    if np.count_nonzero(inside) < 2:
        return None
    at = moved.along[inside]
    values, gradients = moved.values[inside].copy(), moved.gradients[inside].copy()
    for k in range(values.shape[1]):
        value, slope = _between(nominal, k)
        values[:, k] -= value(at)
        gradients[:, k] -= slope(at)
    known = np.isfinite(moved.first) & np.isfinite(nominal.first)
    first = np.where(known, moved.first, np.nan) - np.where(known, nominal.first, np.nan)
    parts = {name: part[inside] for name, part in vars(moved.coordinates).items()}
    return Observed(
        replace(moved.coordinates, **parts),
        at,
        moved.load[inside],
        values,
        gradients,
        moved.weights[inside],
        first,
        tight=moved.tight,
    )


Course = Callable[[Floats], Floats]


def _unknown(along: Floats) -> Floats:
    """Return nan."""
    return np.full((1,), np.nan)


def _between(run: Observed, k: int) -> tuple[Course, Course]:
    """Return an output and its gradient between the readings of a run; nan where not known."""
    values, gradients = run.values[:, k], run.gradients[:, k]
    if not np.all(np.isfinite(values)):
        return _unknown, _unknown
    if not np.all(np.isfinite(gradients)):
        return PchipInterpolator(run.along, values), _unknown
    smooth = CubicHermiteSpline(run.along, values, gradients[:, 0])
    return smooth, PchipInterpolator(run.along, gradients)


@dataclass(frozen=True)
class _Part:
    """A power of one dimension, or a product of two, with its terms."""

    powers: tuple[int, ...]
    orders: Indices
    is_of_fine: bool = False

    def size(self, away: tuple[float, ...]) -> float:
        return float(np.prod(np.power(away, self.powers)))

    @property
    def scales(self) -> Floats:
        scales: Floats = A_POWER ** (sum(self.powers) - 1.0) * PRIOR.scales(self.orders)
        return scales


Differences = Sequence[tuple[MovedCurve, Observed]]


@dataclass(frozen=True)
class _Fitted:
    """A fit of some outputs: coefficients of all parts, and errors of held-out curves.

    ``left_out`` has a row per value: its relative error of each output; ``of`` is the index of its
    difference, ``weight`` its weight.
    """

    parts: Sequence[_Part]
    coefficients: Floats
    left_out: Floats
    of: Indices
    weight: Floats

    def terms(self) -> list[tuple[tuple[int, ...], Terms]]:
        """Return the terms of each part on the fine mesh."""
        ends = np.cumsum([0, *(len(part.orders) for part in self.parts)])
        by_powers: dict[tuple[int, ...], list[tuple[Indices, Floats]]] = {}
        for part, a, b in zip(self.parts, ends[:-1], ends[1:], strict=True):
            found = (part.orders, self.coefficients[:, a:b])
            by_powers.setdefault(part.powers, []).append(found)
        return [
            (powers, Terms(np.vstack([o for o, _ in found]), np.hstack([c for _, c in found])))
            for powers, found in by_powers.items()
        ]

    @property
    def rms(self) -> float:
        """Weighted root mean square error of held-out values [–]."""
        return float(np.sqrt(np.mean((self.weight[:, None] * self.left_out) ** 2)))


def _fit_block(
    found: Differences,
    outputs: Sequence[int],
    *,
    derivatives: bool,
    highest: int,
) -> _Fitted:
    """Fit some outputs with powers up to the highest, holding out each curve in turn."""
    count = len(found[0][0].away)
    singles = [tuple(int(i == k) for i in range(count)) for k in range(count)]
    parts = [
        _Part(tuple(power * k for k in single), BY_POWER[power].orders)
        for power in range(1, highest + 1)
        for single in singles
    ]
    parts += [
        _Part(tuple(a + b for a, b in zip(*pair, strict=True)), OF_PAIRS.orders)
        for pair in combinations(singles, 2)
    ]
    parts += [_Part(single, OF_FINE.orders, is_of_fine=True) for single in singles]
    orders, scales = (np.concatenate([getattr(p, n) for p in parts]) for n in ("orders", "scales"))
    equations = []
    for one, run in found:
        rows = [
            rows_of(run, part.orders, outputs=list(outputs), derivatives=derivatives)
            for part in parts
        ]
        columns = [
            (0.0 if part.is_of_fine and not one.is_fine else part.size(one.away)) * each.matrix
            for part, each in zip(parts, rows, strict=True)
        ]
        equations.append(Equations(np.hstack(columns), rows[-1].targets, rows[-1].n_values))
    best = fit_scaled(equations, orders, scales, noise=PRIOR.noise, outputs=len(outputs))
    curves = list(dict.fromkeys(one.curve for one, _ in found))
    left_out, of, weight = [], [], []
    for curve in curves:
        members = [k for k, (one, _) in enumerate(found) if one.curve == curve]
        matrices, targets = (
            [getattr(equations[k], n) for k in members] for n in ("matrix", "targets")
        )
        coefficients = best.without(Equations(np.vstack(matrices), np.vstack(targets), 0))
        for k in members:
            one_run, weights = equations[k], found[k][1].weights_of(outputs)
            gap = one_run.targets - one_run.matrix @ coefficients.T
            error = gap[: one_run.n_values]
            left_out.append(error / weights[:, None])
            of.append(np.full(len(error), k))
            weight.append(weights)
    return _Fitted(
        parts, best.coefficients, np.vstack(left_out), np.concatenate(of), np.concatenate(weight)
    )


@dataclass(frozen=True)
class TrainedDeparture:
    """A departure, and facts for the record of the emulator with its errors at held-out curves."""

    departure: Departure
    facts: dict[str, object]


def fit_departure(
    dimensions: Sequence[UncertainDimension],
    free: Differences,
    held: Differences,
) -> TrainedDeparture:
    """Fit the departure of outputs with dimensions.

    ``free`` and ``held`` are departures of the shape, and of the force at a held tip. The highest
    power minimises held-out errors of curvature.
    """
    tried = {power: _fit_block(free, (0,), derivatives=True, highest=power) for power in BY_POWER}
    highest = min(tried, key=lambda power: tried[power].rms)
    blocks: list[tuple[Sequence[int], _Fitted, Differences]] = []
    for outputs, smooth in BLOCKS:
        fitted = _fit_block(free, outputs, derivatives=smooth, highest=highest)
        blocks.append((outputs, fitted, free))
    if held:
        fitted = _fit_block(held, (0,), derivatives=True, highest=highest)
        blocks.append(((0,), fitted, held))
    powers = [p for p, _ in blocks[0][1].terms()]
    error = np.hstack([_errors(powers, fitted, of) for _, fitted, of in blocks])
    departure = Departure(
        names=tuple(one.name for one in dimensions),
        ranges=np.array([(one.median, one.step, one.low, one.high) for one in dimensions]),
        powers=np.array(powers, dtype=np.int64),
        parts=tuple(
            stacked([fitted.terms()[k][1] for _, fitted, _ in blocks]) for k in range(len(powers))
        ),
        error=error,
    )
    return TrainedDeparture(departure, _facts(dimensions, blocks, highest))


def _errors(powers: Sequence[tuple[int, ...]], fitted: _Fitted, found: Differences) -> Floats:
    """Return standard errors for a δ^p of 1, (n_parts, n_outputs).

    Nine tenths of the held-out errors lie within the 90 % interval, on the mesh where they are
    larger: the few fine curves show the errors of the coarse ones. Errors are assumed to grow with
    distance; those of products are added.
    """
    count = fitted.left_out.shape[1]
    error = np.zeros((len(powers), count))
    away = np.array([found[k][0].away for k in fitted.of])
    is_fine = np.array([found[k][0].is_fine for k in fitted.of])
    for p, power in enumerate(powers):
        acting = [k for k, size in enumerate(power) if size]
        rows = np.all((away != 0.0) == (np.array(power) != 0), axis=1)
        if sum(power) > len(acting) or not np.any(rows):  # of one dimension the first power alone
            continue
        size = np.abs(np.prod(away[:, acting], axis=1))
        each = np.full(count, LEAST_ERROR)
        for of_mesh in (rows & is_fine, rows & ~is_fine):
            if np.any(of_mesh):
                missed = np.abs(fitted.left_out[of_mesh]) / size[of_mesh, None]
                each = np.maximum(each, np.quantile(missed, INSIDE, axis=0) / INSIDE_SD)
        if len(acting) > 1:
            firsts = [powers.index(tuple(int(i == k) for i in range(len(power)))) for k in acting]
            each = np.sqrt(np.maximum(each**2 - np.sum(error[firsts] ** 2, axis=0), 0.0))
        error[p] = each
    return error


def _facts(
    dimensions: Sequence[UncertainDimension],
    blocks: Sequence[tuple[Sequence[int], _Fitted, Differences]],
    highest: int,
) -> dict[str, object]:
    """Return facts for the record: ranges, and the largest error of each held-out curve [%]."""
    names = [*OUTPUTS, *MEASURES, "load", "tip_force"]
    worst = [
        (found[k][0].away, np.max(np.abs(fitted.left_out * fitted.weight[:, None])[rows], axis=0))
        for _, fitted, found in blocks
        for k in np.unique(fitted.of)
        for rows in [fitted.of == k]
    ]
    by_block = [len(np.unique(fitted.of)) for _, fitted, _ in blocks]
    starts = np.cumsum([0, *by_block])
    facts: dict[str, object] = {}
    for d, one in enumerate(dimensions):
        accuracy, at = dict[str, dict[str, float]](), 0
        for (outputs, _, _), a, b in zip(blocks, starts[:-1], starts[1:], strict=True):
            of_one = [sizes for away, sizes in worst[a:b] if away[d] != 0.0]
            for k in range(len(outputs)):
                size = 100.0 * np.array([sizes[k] for sizes in of_one])
                accuracy[names[at]] = {
                    "rms_pct": float(np.sqrt(np.mean(size**2))),
                    "p95_pct": float(np.quantile(size, 0.95)),
                    "max_pct": float(np.max(size)),
                }
                at += 1
        facts[one.name] = {
            "median_mm": one.median,
            "step_mm": one.step,
            "range_mm": [one.low, one.high],
            "highest_power": highest,
            "curves": sum(found[0].away[d] != 0.0 for found in blocks[0][2]),
            "accuracy": accuracy,
        }
    return facts
