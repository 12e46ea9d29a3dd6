"""Each reading given those before it on its specimen, in one compiled pass along the path."""

import math

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled
from bayesdeg.inference.path_density import INDEPENDENT

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled
def path_innovations(
    residual: Floats,
    slope: Floats,
    variance: Floats,
    spread: Floats,
    length: Floats,
    correlation: Floats,
    mask: Flags,
    gap: Floats,
    points: int,
    score: Floats,
    log_sd: Floats,
) -> None:
    """Write the standardised innovations of each specimen's readings and the logs of their sd's.

    Arguments as `bayesdeg.inference.likelihood.Linearised`; ``score`` and ``log_sd``, both of
    shape (n, n_specimens, n_readings), are written; they are 0 where there is no reading.

    Notes
    -----
    A Kalman filter whose state is the specimen's deviations m ~ N(0, τ²) and the common part x of
    the error, an Ornstein–Uhlenbeck process: readings over their errors' sd are
    u = J m/√v + x + e with e the reading's own error. Readings of the second output less c times
    those of the first, over √(1 − c²), have a process of their own.
    """
    n, n_specimens, n_readings = residual.shape
    k = slope.shape[-1]
    mean, cross, row = np.empty(k + 1), np.empty(k + 1), np.empty(k + 1)
    state, first = np.empty((k + 1, k + 1)), np.empty((points, k + 1))
    for b in range(n):
        share = math.sqrt(1.0 - correlation[b] * correlation[b])
        for s in range(n_specimens):
            mean[:] = 0.0
            state[:] = 0.0
            for i in range(k):
                state[i, i] = spread[b, s, i]
            for j in range(n_readings):
                if j % points == 0:
                    _begin_output(mean, state)
                score[b, s, j] = 0.0
                log_sd[b, s, j] = 0.0
                if not mask[s, j]:
                    continue
                sd = math.sqrt(variance[b, s, j])
                row[k] = residual[b, s, j] / sd
                for i in range(k):
                    row[i] = slope[b, s, j, i] / sd
                for i in range(k + 1):
                    if j < points:
                        first[j, i] = row[i]
                    else:
                        row[i] = (row[i] - correlation[b] * first[j - points, i]) / share
                _predict(mean, state, math.exp(-gap[s, j] / length[b]))
                score[b, s, j], total = _update(mean, state, row, cross)
                log_sd[b, s, j] = math.log(sd * (1.0 if j < points else share))
                log_sd[b, s, j] += 0.5 * math.log(total)


@compiled
def _begin_output(mean: Floats, state: Floats) -> None:
    """Let the process of an output begin anew, independent of what was before."""
    k = len(mean) - 1
    mean[k] = 0.0
    for i in range(k):
        state[i, k] = 0.0
        state[k, i] = 0.0
    state[k, k] = 1.0 - INDEPENDENT


@compiled
def _predict(mean: Floats, state: Floats, decay: float) -> None:
    """Let the process run to the next reading."""
    k = len(mean) - 1
    mean[k] *= decay
    for i in range(k):
        state[i, k] *= decay
        state[k, i] = state[i, k]
    square = decay * decay
    state[k, k] = square * state[k, k] + (1.0 - square) * (1.0 - INDEPENDENT)


@compiled
def _update(mean: Floats, state: Floats, row: Floats, cross: Floats) -> tuple[float, float]:
    """Learn from a reading u = J m + x + e, ``row`` being J and u.

    Returns the standardised innovation and the variance of u given what was before.
    """
    k = len(mean) - 1
    innovation, total = row[k] - mean[k], INDEPENDENT
    for i in range(k):
        innovation -= row[i] * mean[i]
    for i in range(k + 1):
        cross[i] = state[i, k]
        for m in range(k):
            cross[i] += state[i, m] * row[m]
    total = total + cross[k]
    for i in range(k):
        total += row[i] * cross[i]
    for i in range(k + 1):
        mean[i] += cross[i] * innovation / total
        for m in range(k + 1):
            state[i, m] -= cross[i] * cross[m] / total
    return innovation / math.sqrt(total), total
