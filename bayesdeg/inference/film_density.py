"""The inner loop of the films' likelihood: all linearisations of a film in one compiled pass."""

import math

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled
from bayesdeg.inference.path_density import filter_of, same_path, specimen_density

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled
def film_density(
    stress: Floats,
    at_rest: Floats,
    by_rate: Floats,
    noise: Floats,
    spread: Floats,
    length: Floats,
    mask: Flags,
    gap: Floats,
    passes: int,
    density: Floats,
    deviation: Floats,
) -> None:
    """Write the log density of each film's readings and its most probable deviations.

    Parameters
    ----------
    stress : array, shape (n_specimens, n_points)
        As read [MPa].
    at_rest, by_rate : array, shape (n, n_specimens, n_points)
        As `bayesdeg.inference.films.Stresses`.
    noise : array, shape (n, 2)
        Constant [MPa] and proportional [–] reading error.
    spread, length : array, shape (n, n_specimens, 2), (n,)
        As `bayesdeg.inference.likelihood.Linearised`.
    mask, gap : array, shape (n_specimens, n_points)
        As `bayesdeg.inference.likelihood.Paths`.
    passes : int
        Linearisations, the first at no deviation.
    density, deviation : array, shape (n, n_specimens), (n, n_specimens, 2)
        Written: of the last linearisation, and what follows from it.
    """
    n, n_specimens, n_points = at_rest.shape
    alike = same_path(mask, gap)
    gains, order = np.empty((3, n_points)), np.empty(n_points, np.int64)
    scales, first = np.empty(n_points), np.empty((n_points, 3))
    residual, slope = np.empty(n_points), np.empty((n_points, 2))
    variance = np.empty(n_points)
    for b in range(n):
        count, constant = 0, 0.0
        for s in range(n_specimens):
            if not alike[s]:
                count, constant = filter_of(length[b], 0.0, mask[s], gap[s], n_points, gains, order)
            widths = (math.sqrt(spread[b, s, 0]), math.sqrt(spread[b, s, 1]))
            log_stiffness, rate, found = 0.0, 0.0, 0.0
            for _ in range(passes):
                _linearise(
                    stress[s], at_rest[b, s], by_rate[b, s], noise[b], log_stiffness, rate,
                    residual, slope, variance,
                )  # fmt: skip
                found, log_stiffness, rate = specimen_density(
                    residual, slope, variance, widths, 0.0, constant, gains, order[:count],
                    scales, first,
                )  # fmt: skip
            density[b, s] = found
            deviation[b, s, 0], deviation[b, s, 1] = log_stiffness, rate


@compiled
def _linearise(
    stress: Floats,
    at_rest: Floats,
    by_rate: Floats,
    noise: Floats,
    log_stiffness: float,
    rate: float,
    residual: Floats,
    slope: Floats,
    variance: Floats,
) -> None:
    """Linearise the stresses of one film about its deviations, as ``films.film_readings``."""
    factor = math.exp(log_stiffness)
    for j in range(len(stress)):
        change = factor * by_rate[j]
        expected = factor * at_rest[j] + change * rate
        slope[j, 0], slope[j, 1] = expected, change
        residual[j] = stress[j] - expected + expected * log_stiffness + change * rate
        error = noise[1] * expected
        variance[j] = noise[0] * noise[0] + error * error
