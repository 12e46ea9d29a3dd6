"""The inner loop of the likelihood: one pass along each path, compiled."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOG_TWO_PI = math.log(2.0 * math.pi)
INDEPENDENT = 0.2
"""Share of the variance of an error that is the reading's own: rounding, picking of markers."""


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def path_density(
    residual: Floats,
    slope: Floats,
    variance: Floats,
    spread: Floats,
    length: Floats,
    correlation: Floats,
    mask: Flags,
    gap: Floats,
    points: int,
    density: Floats,
    deviation: Floats,
) -> None:
    """Write the log density of each specimen's readings and its most probable deviations.

    Arguments as `bayesdeg.inference.likelihood.Linearised`; ``density`` (n, n_specimens) and
    ``deviation`` (n, n_specimens, n_deviations) are written.

    Notes
    -----
    Each reading is whitened by those before it, with the Kalman filter of a process of
    Ornstein–Uhlenbeck that is read with errors; the same for the columns of J. What remains is the
    regression of the whitened readings on τ J with unit errors, whose normal equations have as many
    unknowns as a specimen has deviations.
    """
    n, n_specimens, _ = residual.shape
    k = slope.shape[-1]
    row, last = np.empty(k + 1), np.empty(k + 1)
    first = np.empty((points, k + 1))
    gram = np.empty((k + 1, k + 1))
    width = np.empty(k)
    for b in range(n):
        for s in range(n_specimens):
            for i in range(k):
                width[i] = math.sqrt(spread[b, s, i])
            gram[:] = 0.0
            logs = _whiten(
                residual[b, s], slope[b, s], variance[b, s], width, length[b], correlation[b],
                mask[s], gap[s], row, last, first, gram,
            )  # fmt: skip
            density[b, s] = -0.5 * (logs + _solve(gram, k, deviation[b, s]))
            for i in range(k):
                deviation[b, s, i] *= width[i]


# fmt: off
@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _whiten(
    residual: Floats, slope: Floats, variance: Floats, width: Floats, length: float,
    correlation: float, mask: Flags, gap: Floats, row: Floats, last: Floats, first: Floats,
    gram: Floats,
) -> float:
    # fmt: on
    """Add the products of a path's whitened columns to ``gram``; return ln det(2π V^½ R V^½).

    ``row``, ``last`` and ``first`` are working space, the latter for all of the first output.
    """
    k, points = len(width), len(first)
    share = math.sqrt(1.0 - correlation * correlation)
    logs, product = 0.0, 1.0
    step, decay, known = -1.0, 0.0, 0.0
    for j in range(len(residual)):
        if j % points == 0:  # before the first reading of an output nothing is known
            last[:] = 0.0
            known = 1.0 - INDEPENDENT
        if not mask[j]:
            continue
        scale = 1.0 / math.sqrt(variance[j])
        row[k] = residual[j] * scale
        for i in range(k):
            row[i] = slope[j, i] * width[i] * scale
        if j < points:
            first[j] = row
        else:
            for i in range(k + 1):
                row[i] = (row[i] - correlation * first[j - points, i]) / share
            product *= share * share
        if gap[j] != step:  # most steps of a path are alike
            step = gap[j]
            decay = math.exp(-step / length)
        ahead = decay * decay * known + (1.0 - decay * decay) * (1.0 - INDEPENDENT)
        total = ahead + INDEPENDENT
        product *= total * variance[j]
        if not 1e-200 < product < 1e200:  # also where it is not a number
            logs += math.log(product)
            product = 1.0
        known = ahead * INDEPENDENT / total
        gain, narrowing = ahead / total, 1.0 / math.sqrt(total)
        for i in range(k + 1):
            innovation = row[i] - decay * last[i]
            last[i] = decay * last[i] + gain * innovation
            row[i] = innovation * narrowing
            for m in range(i + 1):
                gram[i, m] += row[i] * row[m]
        logs += LOG_TWO_PI
    return logs + math.log(product)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _solve(gram: Floats, k: int, mean: Floats) -> float:
    """Factorise I + the first k rows in place; return ln det and the quadratic form.

    ``gram`` holds the products of the whitened columns, the residual last, in its lower half;
    ``mean`` receives the solution, in units of τ.
    """
    logs = 0.0
    for i in range(k):
        gram[i, i] += 1.0
    for i in range(k + 1):  # Cholesky, row by row; the last row becomes the forward solution
        for j in range(min(i, k - 1) + 1):
            total = gram[i, j]
            for m in range(j):
                total -= gram[i, m] * gram[j, m]
            gram[i, j] = math.sqrt(total) if j == i else total / gram[j, j]
        if i < k:
            logs += 2.0 * math.log(gram[i, i])
    left: float = gram[k, k]
    for i in range(k):
        left -= gram[k, i] * gram[k, i]
    left = max(left, 0.0)  # what rounding leaves of an exact fit
    for i in range(k - 1, -1, -1):
        total = gram[k, i]
        for m in range(i + 1, k):
            total -= gram[m, i] * mean[m]
        mean[i] = total / gram[i, i]
    return logs + left
