"""Stress–stretch curves of films in the eyes of a model."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.inference.curves import TensileCurves
from bayesdeg.inference.film_density import film_density
from bayesdeg.inference.likelihood import Linearised
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.specimens import Material, with_effects

Floats = NDArray[np.float64]

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
    parts = (
        with_effects(_stress(data.basis, c), data.conditions, values, c, causes) for c in material
    )
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
