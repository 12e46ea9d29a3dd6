"""The inner loop of the likelihood: one pass along each path, compiled.

What a reading has in common with those before it depends on the path and the length ℓ alone, not
on what was read: the filter is worked out once for all specimens that follow one another on the
same path, and the pass along a specimen's readings is left with products and sums.
"""

import math

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

LOG_TWO_PI = math.log(2.0 * math.pi)
INDEPENDENT = 0.2
"""Share of the variance of an error that is the reading's own: rounding, picking of markers."""
MOST_DEVIATIONS = 2
"""Of a specimen; the normal equations are written out for so many."""


@compiled
def same_path(mask: Flags, gap: Floats) -> Flags:
    """Return whether each specimen's path is that of the specimen before it."""
    alike = np.zeros(len(mask), np.bool_)
    for s in range(1, len(mask)):
        same = True
        for j in range(mask.shape[1]):
            if mask[s, j] != mask[s - 1, j] or (mask[s, j] and gap[s, j] != gap[s - 1, j]):
                same = False
                break
        alike[s] = same
    return alike


@compiled
def filter_of(
    length: float,
    correlation: float,
    mask: Flags,
    gap: Floats,
    points: int,
    gains: Floats,
    order: Indices,
) -> tuple[int, float]:
    """Write the filter of one path; return how many readings it has, and its part of ln det.

    ``order`` receives which readings there are; ``gains`` for each of them, in that order, the
    decay since the last, the gain, and 1 over the standard deviation of the innovation. The part
    of ln det(2π R) is that of the correlations R, without the variances.
    """
    count, logs, product = 0, 0.0, 1.0
    step, decay, known = -1.0, 0.0, 0.0
    share = 1.0 - correlation * correlation
    for j in range(len(mask)):
        if j % points == 0:  # before the first reading of an output nothing is known
            known = 1.0 - INDEPENDENT
        if not mask[j]:
            continue
        if gap[j] != step:  # most steps of a path are alike
            step = gap[j]
            decay = math.exp(-step / length)
        ahead = decay * decay * known + (1.0 - decay * decay) * (1.0 - INDEPENDENT)
        total = ahead + INDEPENDENT
        known = ahead * INDEPENDENT / total
        gains[0, count], gains[1, count] = decay, ahead / total
        gains[2, count] = 1.0 / math.sqrt(total)
        order[count] = j
        count += 1
        product *= total * (share if j >= points else 1.0)
        if not 1e-200 < product < 1e200:  # also where it is not a number
            logs += math.log(product)
            product = 1.0
    return count, logs + math.log(product) + count * LOG_TWO_PI


@compiled
def specimen_density(
    residual: Floats,
    slope: Floats,
    variance: Floats,
    widths: tuple[float, float],
    correlation: float,
    constant: float,
    gains: Floats,
    order: Indices,
    scales: Floats,
    first: Floats,
) -> tuple[float, float, float]:
    """Return the log density of one specimen's readings and its most probable deviations.

    Parameters
    ----------
    residual, slope, variance : array, shape (n_readings,), (n_readings, n_deviations)
        As `bayesdeg.inference.likelihood.Linearised`.
    widths : tuple of float
        τ of the deviations; the second is not read where there is one.
    correlation : float
        c of the outputs.
    constant, gains, order
        From `filter_of`; ``order`` is cut to its count.
    scales, first : array, shape (n_readings,), (n_points, 3)
        Working space; the latter for all of the first output.

    Notes
    -----
    Each reading is whitened by those before it, with the Kalman filter of a process of
    Ornstein–Uhlenbeck that is read with errors; the same for the columns of J. What remains is the
    regression of the whitened readings on τ J with unit errors, whose normal equations have as many
    unknowns as a specimen has deviations.
    """
    points = len(first)
    two = slope.shape[1] == MOST_DEVIATIONS
    share = 1.0 / math.sqrt(1.0 - correlation * correlation)
    logs = constant + _scales(variance, order, scales)
    # of the process of the residual and of both slopes; an output's first gap is infinite
    last, one, other = 0.0, 0.0, 0.0
    g00, g10, g11, g20, g21, g22 = 1.0, 0.0, 1.0, 0.0, 0.0, 0.0
    for i in range(len(order)):
        j = order[i]
        decay, gain, narrowing = gains[0, i], gains[1, i], gains[2, i]
        x, y = residual[j] * scales[i], slope[j, 0] * (widths[0] * scales[i])
        z = slope[j, 1] * (widths[1] * scales[i]) if two else 0.0
        if j < points:
            first[j, 0], first[j, 1], first[j, 2] = x, y, z
        else:
            at = j - points
            x = (x - correlation * first[at, 0]) * share
            y = (y - correlation * first[at, 1]) * share
            z = (z - correlation * first[at, 2]) * share
        x, y, z = x - decay * last, y - decay * one, z - decay * other
        last = decay * last + gain * x
        one = decay * one + gain * y
        other = decay * other + gain * z
        x, y, z = x * narrowing, y * narrowing, z * narrowing
        g00, g10, g11 = g00 + y * y, g10 + y * z, g11 + z * z
        g20, g21, g22 = g20 + x * y, g21 + x * z, g22 + x * x
    left, u, v = _regression(g00, g10, g11, g20, g21, g22)
    return -0.5 * (logs + left), u * widths[0], v * widths[1]


@compiled
def _regression(
    g00: float, g10: float, g11: float, g20: float, g21: float, g22: float
) -> tuple[float, float, float]:
    """Return ln det plus the misfit that is left, and the solution, by Cholesky.

    g₀₀, g₁₀ and g₁₁ are those of the normal matrix, g₂₀ and g₂₁ of the right-hand side, and g₂₂ is
    the square of what is to be explained.
    """
    root = math.sqrt(g00)
    below = g10 / root
    rest = math.sqrt(g11 - below * below)
    u = g20 / root
    v = (g21 - u * below) / rest
    left = g22 - u * u - v * v
    if left < 0.0:  # what rounding leaves of an exact fit; what is no number stays none
        left = 0.0
    v /= rest
    return left + 2.0 * math.log(root * rest), (u - below * v) / root, v


@compiled
def _scales(variance: Floats, order: Indices, scales: Floats) -> float:
    """Write 1 over the standard deviations of the readings in order; return ln Π v."""
    logs, product = 0.0, 1.0
    for i in range(len(order)):
        v = variance[order[i]]
        scales[i] = v
        product *= v
        if not 1e-200 < product < 1e200:  # also where it is not a number
            logs += math.log(product)
            product = 1.0
    for i in range(len(order)):
        scales[i] = 1.0 / math.sqrt(scales[i])
    return logs + math.log(product)
