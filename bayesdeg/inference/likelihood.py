"""Noise laws and the specimen hierarchy: pointwise and marginal log densities of curves.

A curve of one specimen is y_j = f_j(m) + ε_j with m ~ N(0, τ²) the specimen's own deviation of ln
stiffness and ε_j ~ N(0, v_j) the reading error. f is nearly linear in m, so m is integrated out at
the linearisation f(m) ≈ f_j + J_j m.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOG_TWO_PI = float(np.log(2.0 * np.pi))


class Linearised(NamedTuple):
    """Curves at the most probable deviations: all that their likelihood needs.

    ``residual`` is the observation less f + J (0 − m̂), the linear model's value at m = 0.
    """

    residual: Floats
    slope: Floats
    variance: Floats
    spread: Floats
    mask: Flags
    deviation: Floats


def deviation(
    residual: Floats, slope: Floats, *, variance: Floats, spread: Floats, mask: Flags
) -> Floats:
    """Return the most probable deviation m of each specimen, shape (..., 1).

    m = τ² Σ J r/v / (1 + τ² Σ J²/v).

    Parameters
    ----------
    residual, slope, variance : array, shape (..., n_points)
        Observation less f at m = 0, J and v.
    spread : array, shape (..., 1)
        τ².
    mask : array of bool
        Where there is an observation.
    """
    weight = np.where(mask, 1.0 / variance, 0.0)
    gain = np.sum(weight * slope * residual, axis=-1, keepdims=True)
    information = np.sum(weight * slope**2, axis=-1, keepdims=True)
    mode: Floats = spread * gain / (1.0 + spread * information)
    return mode


def marginal(
    residual: Floats, slope: Floats, *, variance: Floats, spread: Floats, mask: Flags
) -> Floats:
    """Return the log density of each curve with m integrated out, shape (...).

    The normal law with covariance diag(v) + τ² J Jᵀ, by the determinant lemma and the
    Sherman–Morrison formula; arguments as ``deviation``.

    Examples
    --------
    >>> one = np.ones(1)
    >>> float(marginal(0 * one, one, variance=one, spread=3 * one, mask=one > 0)) # N(0, 1 + 3)
    -1.612085713764618
    """
    weight = np.where(mask, 1.0 / variance, 0.0)
    plain = np.sum(weight * residual**2, axis=-1)
    gain = np.sum(weight * slope * residual, axis=-1)
    information = 1.0 + spread[..., 0] * np.sum(weight * slope**2, axis=-1)
    determinant = np.sum(np.where(mask, np.log(variance), 0.0), axis=-1) + np.log(information)
    quadratic = plain - spread[..., 0] * gain**2 / information
    count = np.sum(mask, axis=-1)
    total: Floats = -0.5 * (quadratic + determinant + count * LOG_TWO_PI)
    return total


def sequential(
    residual: Floats, slope: Floats, *, variance: Floats, spread: Floats, mask: Flags
) -> Floats:
    """Return log densities of each observation given those before it, shape (..., n_points).

    Their sum over a curve is ``marginal``: the chain rule, by a scalar Kalman filter for m.
    """
    shape = np.broadcast_shapes(residual.shape, variance.shape)
    out = np.zeros(shape)
    mean = np.zeros(shape[:-1])
    spread_now = np.broadcast_to(spread[..., 0], shape[:-1]).copy()
    for j in range(shape[-1]):
        r = residual[..., j] - slope[..., j] * mean
        total = variance[..., j] + slope[..., j] ** 2 * spread_now
        gain = spread_now * slope[..., j] / total
        seen = np.broadcast_to(mask[..., j], shape[:-1])
        out[..., j] = np.where(seen, -0.5 * (r**2 / total + np.log(total) + LOG_TWO_PI), 0.0)
        mean = mean + np.where(seen, gain * r, 0.0)
        spread_now = np.where(seen, spread_now * variance[..., j] / total, spread_now)
    return out


def normal(value: Floats | float, mean: Floats, sd: Floats | float) -> Floats:
    """Return the normal log density."""
    z = (value - mean) / sd
    density: Floats = -0.5 * (z**2 + LOG_TWO_PI) - np.log(sd)
    return density


def student(value: float, mean: Floats, scale: float, dof: float) -> Floats:
    """Return the log density of Student's law; the normal one for infinite degrees of freedom.

    Examples
    --------
    >>> round(float(student(0.0, np.array(0.0), 1.0, 3.0)), 4)
    -1.0009
    """
    if np.isinf(dof):
        return normal(value, mean, scale)
    z = (value - mean) / scale
    constant = gammaln(0.5 * (dof + 1.0)) - gammaln(0.5 * dof) - 0.5 * np.log(dof * np.pi)
    density: Floats = constant - np.log(scale) - 0.5 * (dof + 1.0) * np.log1p(z**2 / dof)
    return density


def log_normal(value: Floats, median: Floats, scatter: Floats) -> Floats:
    """Return the log-normal log density of values with this median and sd of the logarithm."""
    return normal(np.log(value), np.log(median), scatter) - np.log(value)


def marginal_of(curves: Linearised) -> Floats:
    """Return ``marginal`` of linearised curves, shape (..., n_specimens)."""
    return marginal(
        curves.residual,
        curves.slope,
        variance=curves.variance,
        spread=curves.spread,
        mask=curves.mask,
    )


def sequential_of(curves: Linearised) -> Floats:
    """Return ``sequential`` of linearised curves, shape (..., n_specimens, n_points)."""
    return sequential(
        curves.residual,
        curves.slope,
        variance=curves.variance,
        spread=curves.spread,
        mask=curves.mask,
    )
