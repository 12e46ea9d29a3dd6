"""Compiled element kernels that assemble nothing: products with the tangent, rates by constants."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator.kernels import add_force, gather
from bayesdeg.actuator.law import elasticity, invert, stress

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@njit(cache=True)
def solid_products(
    displacement: Floats,
    pressure: Floats,
    elements: Indices,
    gradients: Floats,
    weights: Floats,
    modes: Floats,
    constants: Floats,
    bulk: float,
    directions: Floats,
    pressure_directions: Floats,
    forces: Floats,
    volume_rates: Floats,
) -> None:  # pragma: no cover - compiled
    """Add the mixed problem's tangent times several directions, without assembling it.

    ``directions`` and ``forces`` are (n_nodes, 3 k), the latter added to; ``pressure_directions``
    and ``volume_rates`` are (n_elements, k, n_modes), the latter overwritten. The other arguments
    are those of ``solid``.
    """
    n_local, n_points, count = elements.shape[1], weights.shape[1], pressure_directions.shape[1]
    rows = np.empty((3 * count, 3 * n_points))
    local = np.empty((n_local, 3 + 3 * count))
    for e in range(weights.shape[0]):
        for n in range(n_local):
            for i in range(3):
                local[n, i] = displacement[elements[e, n], i]
            for i in range(3 * count):
                local[n, 3 + i] = directions[elements[e, n], i]
        gradient = gradients[e].reshape((3 * n_points, n_local))
        volume_rates[e] = 0.0
        _evaluate_products(
            gradient @ local,
            pressure[e],
            pressure_directions[e],
            weights[e],
            modes,
            constants[e],
            bulk,
            rows,
            volume_rates[e],
        )
        products = rows @ gradient
        add_force(products, elements[e], forces)


@njit(cache=True)
def _evaluate_products(
    slope: Floats,
    pressure: Floats,
    pressure_directions: Floats,
    weights: Floats,
    modes: Floats,
    constants: Floats,
    bulk: float,
    rows: Floats,
    volume_rates: Floats,
) -> None:  # pragma: no cover - compiled
    """Overwrite ``rows`` with weighted changes of stress at an element's points, 3 a direction.

    ``volume_rates`` (k, n_modes) is added to.
    """
    f, g = np.empty((3, 3)), np.empty((3, 3))
    df, change = np.empty((3, 3)), np.empty((3, 3))
    a = np.empty((6, 3, 3))
    for q in range(weights.shape[0]):
        for i in range(3):
            for j in range(3):
                f[i, j] = slope[3 * q + j, i]
            f[i, i] += 1.0
        jacobian = invert(f, g)
        w, p = weights[q], np.dot(pressure, modes[q])
        elasticity(f, g, jacobian, p, constants[q], a)
        for k in range(pressure_directions.shape[0]):
            for i in range(3):
                for j in range(3):
                    df[i, j] = slope[3 * q + j, 3 + 3 * k + i]
            dp = np.dot(pressure_directions[k], modes[q])
            apply_elasticity(a, df, change)
            grown = 0.0
            for i in range(3):
                for j in range(3):
                    rows[3 * k + i, 3 * q + j] = w * (change[i, j] + dp * jacobian * g[i, j])
                    grown += jacobian * g[i, j] * df[i, j]
            for m in range(modes.shape[1]):
                volume_rates[k, m] += w * (grown - dp / bulk) * modes[q, m]


@njit(cache=True)
def constant_rates(
    displacement: Floats,
    elements: Indices,
    gradients: Floats,
    weights: Floats,
    constants: Floats,
    profile: Floats,
    forces: Floats,
) -> None:  # pragma: no cover - compiled
    """Add the internal force's derivatives by C2, C3, r and the skin's contrast.

    The first three are by the logarithm-free ratios: the local constants are the ratios times
    the local C1. ``profile`` (n_elements, n_points) is that of the skin, ``forces`` (n_nodes, 12)
    holds the four derivatives side by side.
    """
    n_local, n_points = elements.shape[1], weights.shape[1]
    rows = np.empty((12, 3 * n_points))
    f, g, p_stress = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    local, unit = np.empty((n_local, 3)), np.empty(4)
    for e in range(weights.shape[0]):
        gather(displacement, elements[e], local)
        gradient = gradients[e].reshape((3 * n_points, n_local))
        slope = gradient @ local
        for q in range(n_points):
            for i in range(3):
                for j in range(3):
                    f[i, j] = slope[3 * q + j, i]
                f[i, i] += 1.0
            jacobian = invert(f, g)
            for k in range(4):
                unit[:] = 0.0
                if k < 3:
                    unit[k + 1] = weights[e, q] * constants[e, q, 0]
                else:
                    unit[:] = weights[e, q] * profile[e, q] * constants[e, q]
                stress(f, g, jacobian, 0.0, unit, p_stress)
                for i in range(3):
                    for j in range(3):
                        rows[3 * k + i, 3 * q + j] = p_stress[i, j]
        products = rows @ gradient
        add_force(products, elements[e], forces)


@njit(cache=True)
def apply_elasticity(a: Floats, df: Floats, out: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` with A : dF."""
    out[:] = 0.0
    pair = 0
    for i in range(3):
        for k in range(i, 3):
            for j in range(3):
                for m in range(3):
                    out[i, j] += a[pair, j, m] * df[k, m]
                    if i != k:
                        out[k, m] += a[pair, j, m] * df[i, j]
            pair += 1
