"""Are ranks uniform? χ² and simultaneous bands of the ECDF, and coverage of intervals.

In simulation-based calibration (Talts et al. 2018, arXiv:1804.06788) the rank of the true value
among L independent posterior draws is uniform on 0, …, L if all is right.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]
Ranks = NDArray[np.int64]

BINS = 20


def chi_square(ranks: Ranks, largest: int, *, bins: int = BINS) -> float:
    """Return the p-value of Pearson's χ² test of uniformity on 0, …, largest.

    Bins need not hold equally many ranks: the expected counts say how many they do.

    >>> round(chi_square(np.arange(100).repeat(2), 99), 3)
    1.0
    """
    edges = np.linspace(0.0, largest + 1.0, bins + 1).round()
    observed = np.histogram(ranks, edges)[0]
    expected = len(ranks) * np.diff(edges) / (largest + 1.0)
    return float(stats.chi2.sf(np.sum((observed - expected) ** 2 / expected), bins - 1))


def ecdf(ranks: Ranks, largest: int) -> Floats:
    """Return the share of ranks below 1, …, largest."""
    return np.mean(ranks[:, None] < np.arange(1, largest + 1), axis=0)


@cache
def band(count: int, largest: int, probability: float = 0.95) -> tuple[Floats, Floats]:
    """Return bounds within which the whole ECDF of uniform ranks stays with this probability.

    Säilynoja et al. (2022), doi:10.1007/s11222-022-10090-6: at each point the central interval of
    the binomial law, at one level γ for all, chosen so that together they hold. The probability of
    a path to stay inside is summed exactly, from point to point, since the counts are a Markov
    chain.
    """
    points = np.arange(1, largest + 1) / (largest + 1.0)
    steps = _steps(count, largest)
    low, high = 1e-7, 1.0 - probability
    for _ in range(40):
        middle = np.sqrt(low * high)
        inside = _stays(steps, *_bounds(count, points, middle))
        low, high = (middle, high) if inside >= probability else (low, middle)
    bounds = _bounds(count, points, low)
    return bounds[0] / count, bounds[1] / count


def _bounds(count: int, points: Floats, level: float) -> tuple[Floats, Floats]:
    lower, upper = (stats.binom.ppf(q, count, points) for q in (0.5 * level, 1.0 - 0.5 * level))
    return np.asarray(lower), np.asarray(upper)


@cache
def _steps(count: int, largest: int) -> tuple[Floats, ...]:
    """Return, point by point, the probabilities from i ranks below the last to j below this."""
    counts = np.arange(count + 1)
    gained, left = counts[None, :] - counts[:, None], count - counts[:, None]
    points = np.arange(largest + 1) / (largest + 1.0)
    shares = np.diff(points) / (1.0 - points[:-1])
    return tuple(np.asarray(stats.binom.pmf(gained, left, share)) for share in shares)


def _stays(steps: tuple[Floats, ...], lower: Floats, upper: Floats) -> float:
    counts = np.arange(len(steps[0]))
    state = np.where(counts == 0, 1.0, 0.0)
    for step, least, most in zip(steps, lower, upper, strict=True):
        state = np.where((counts >= least) & (counts <= most), state @ step, 0.0)
    return float(state.sum())


def leaves(ranks: Ranks, largest: int, probability: float = 0.95) -> bool:
    """Tell whether the ECDF leaves its band anywhere."""
    lower, upper = band(len(ranks), largest, probability)
    found = ecdf(ranks, largest)
    return bool(np.any((found < lower - 1e-12) | (found > upper + 1e-12)))


def coverage(ranks: Ranks, largest: int, probability: float) -> float:
    """Return the share of true values inside the central interval of their draws.

    With L draws a rank of r stands for probabilities between r/(L + 1) and (r + 1)/(L + 1); one
    that holds a bound of the interval counts for the part inside.

    >>> round(coverage(np.arange(100), 99, 0.5), 6)
    0.5
    """
    low, high = 0.5 - 0.5 * probability, 0.5 + 0.5 * probability
    first, last = ranks / (largest + 1.0), (ranks + 1.0) / (largest + 1.0)
    part = np.clip(np.minimum(last, high) - np.maximum(first, low), 0.0, None) * (largest + 1.0)
    return float(np.mean(part))
