"""Stress–stretch curves of films in the eyes of a model."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.curves import TensileCurves
from bayesdeg.inference.likelihood import Linearised, density_and_mode
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.specimens import Material

Floats = NDArray[np.float64]

PASSES = 3
"""Linearisations, the first at no deviation."""


def linearise_films(data: TensileCurves, values: Named, material: Material) -> Linearised:
    r"""Linearise stresses at the films' most probable deviations.

    .. math:: \sigma = e^m \sum_i \phi_i(\lambda) (C_i + d\, C_i')

    with m the deviation of ln stiffness and d that of the degradation rate [%], φ Yeoh's basis.
    """
    at_rest = _stress(data.basis, material.constants)
    per_point = _stress(data.basis, material.slope)
    spread = np.empty((len(at_rest), len(data.specimens), 2))
    spread[..., 0] = values["stiffness_scatter"][:, None] ** 2
    spread[..., 1] = data.degradation_sd**2
    deviation = np.zeros_like(spread)
    for number in range(PASSES):
        at_mode = _linearised(data, values, (at_rest, per_point), spread, deviation)
        if number + 1 < PASSES:
            _, deviation = density_and_mode(at_mode)
    return at_mode


def film_readings(
    data: TensileCurves, material: Material, deviation: Floats
) -> tuple[Floats, Floats]:
    """Return stresses of films with these deviations, and their slopes by them.

    Parameters
    ----------
    data : TensileCurves
        Stretches and modes.
    material : Material
        Median material.
    deviation : array, shape (n, n_specimens, 2)
        Of ln stiffness [–] and of the degradation rate [%].

    Returns
    -------
    stress : array, shape (n, n_specimens, n_points)
        [MPa].
    slope : array, shape (n, n_specimens, n_points, 2)
        [MPa], [MPa/%].
    """
    return _deviating(
        _stress(data.basis, material.constants), _stress(data.basis, material.slope), deviation
    )


def stress_variance(values: Named, stress: Floats) -> Floats:
    """Return the variance of the reading error of stresses (n, n_specimens, n_points) [MPa²]."""
    floor, share = (
        values[name][:, None, None] for name in ("tensile_noise_floor", "tensile_noise")
    )
    variance: Floats = floor**2 + (share * stress) ** 2
    return variance


def _linearised(
    data: TensileCurves,
    values: Named,
    stresses: tuple[Floats, Floats],
    spread: Floats,
    deviation: Floats,
) -> Linearised:
    stress, slope = _deviating(*stresses, deviation)
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


def _deviating(at_rest: Floats, per_point: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    factor = np.exp(deviation[..., None, 0])
    by_rate = factor * per_point
    stress = factor * at_rest + by_rate * deviation[..., None, 1]
    return stress, np.stack([stress, by_rate], axis=-1)


def _stress(basis: Floats, constants: Floats) -> Floats:
    stress: Floats = (
        basis[..., 0] * constants[..., None, 0]
        + basis[..., 1] * constants[..., None, 1]
        + basis[..., 2] * constants[..., None, 2]
    )
    return stress
