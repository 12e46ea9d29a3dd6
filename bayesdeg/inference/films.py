"""The inner loop of the films' likelihood: all linearisations of a film in one compiled pass."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.compiled import compiled
from bayesdeg.inference.data import TensileCurves
from bayesdeg.inference.likelihood import Linearised, filter_of, same_path, specimen_density
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.specimens import Material

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


PASSES = 3
"""Linearisations, the first at no deviation."""


class Stresses(NamedTuple):
    """Stresses of the median material with the effects of causes, (n, n_specimens, n_points).

    Parameters
    ----------
    at_rest : array
        Of films without deviations [MPa].
    by_rate : array
        Derivative by the degradation rate [MPa/%].
    """

    at_rest: Floats
    by_rate: Floats


def median_stresses(
    data: TensileCurves, values: Named, material: Material, causes: tuple[Cause, ...] = ()
) -> Stresses:
    """Return what films of the median material read."""
    parts = []
    for constants in material:
        stress = _stress(data.basis, constants)
        for cause in causes:
            if cause.on_stress is not None:
                stress = cause.on_stress(stress, data.conditions, cause.effect(values), constants)
        parts.append(stress)
    return Stresses(*parts)


def linearise_films(data: TensileCurves, values: Named, median: Stresses) -> Linearised:
    r"""Linearise stresses at the films' most probable deviations.

    .. math:: \sigma = e^m \sum_i \phi_i(\lambda) (C_i + d\, C_i')

    with m the deviation of ln stiffness and d that of the degradation rate [%], φ Yeoh's basis.
    """
    deviation = _density_and_mode(data, values, median, passes=PASSES - 1)[1]
    return _linearised(data, values, median, _spread(data, values), deviation)


def log_density(data: TensileCurves, values: Named, median: Stresses) -> Floats:
    """Return log densities of whole films, (n, n_specimens).

    It is that of the readings as `linearise_films` linearises them.
    """
    return _density_and_mode(data, values, median, passes=PASSES)[0]


def film_readings(median: Stresses, deviation: Floats) -> tuple[Floats, Floats]:
    """Return stresses of films with these deviations, and their slopes by them.

    Parameters
    ----------
    median : Stresses
        Of films without deviations.
    deviation : array, shape (n, n_specimens, 2)
        Of ln stiffness [–] and of the degradation rate [%].

    Returns
    -------
    stress : array, shape (n, n_specimens, n_points)
        [MPa].
    slope : array, shape (n, n_specimens, n_points, 2)
        [MPa], [MPa/%].
    """
    factor = np.exp(deviation[..., None, 0])
    by_rate = factor * median.by_rate
    stress = factor * median.at_rest + by_rate * deviation[..., None, 1]
    return stress, np.stack([stress, by_rate], axis=-1)


def stress_variance(values: Named, stress: Floats) -> Floats:
    """Return the variance of the reading error of stresses (n, n_specimens, n_points) [MPa²]."""
    floor, share = (
        values[name][:, None, None] for name in ("tensile_noise_floor", "tensile_noise")
    )
    variance: Floats = floor**2 + (share * stress) ** 2
    return variance


def _density_and_mode(
    data: TensileCurves, values: Named, median: Stresses, *, passes: int
) -> tuple[Floats, Floats]:
    """Return the density at the last of the linearisations, and the deviations found there."""
    spread = _spread(data, values)
    density, deviation = np.empty(spread.shape[:2]), np.empty(spread.shape)
    film_density(
        np.ascontiguousarray(data.stress),
        np.ascontiguousarray(median.at_rest),
        np.ascontiguousarray(median.by_rate),
        np.stack([values["tensile_noise_floor"], values["tensile_noise"]], axis=-1),
        spread,
        np.ascontiguousarray(values["tensile_noise_length"]),
        np.ascontiguousarray(data.paths.mask),
        np.ascontiguousarray(data.paths.gap),
        passes,
        density,
        deviation,
    )
    return density, deviation


def _spread(data: TensileCurves, values: Named) -> Floats:
    """Return τ² of ln stiffness [–] and of the degradation rate [%²], (n, n_specimens, 2)."""
    scatter = values["stiffness_scatter"]
    spread = np.empty((len(scatter), len(data.stress), 2))
    spread[..., 0] = scatter[:, None] ** 2
    spread[..., 1] = data.degradation_sd**2
    return spread


def _linearised(
    data: TensileCurves,
    values: Named,
    median: Stresses,
    spread: Floats,
    deviation: Floats,
) -> Linearised:
    stress, slope = film_readings(median, deviation)
    residual = data.stress - stress
    residual += slope[..., 0] * deviation[..., None, 0]
    residual += slope[..., 1] * deviation[..., None, 1]
    return Linearised(
        residual,
        slope,
        stress_variance(values, stress),
        spread,
        values["tensile_noise_length"],
        np.zeros(len(residual)),
        data.paths,
    )


def _stress(basis: Floats, constants: Floats) -> Floats:
    stress: Floats = (
        basis[..., 0] * constants[..., None, 0]
        + basis[..., 1] * constants[..., None, 1]
        + basis[..., 2] * constants[..., None, 2]
    )
    return stress
