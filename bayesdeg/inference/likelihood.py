r"""Noise laws and the specimen hierarchy: log densities of whole paths of readings.

The readings of one specimen are

.. math:: y = f(m) + \varepsilon, \qquad m_k \sim N(0, \tau_k^2), \qquad
    \varepsilon_j = \sqrt{v_j}\, z_j

with m the specimen's own deviations (of ln stiffness, of its degradation rate) and z in part an
Ornstein–Uhlenbeck process along the path, in part each reading's own: cor(z_i, z_j) =
(1 − w) exp(−d_ij/ℓ), d the length of path between two readings and w = 0.2 (`INDEPENDENT`).  A
second output read from the same picture (the bend angle beside the curvature) has the same law and
the correlation c with the first at the same reading, its process being z₂ = c z₁ + √(1 − c²) u with
u independent of z₁.

f is nearly linear in m, so m is integrated out at the linearisation f(m) ≈ f(m̂) + J (m − m̂) about
its most probable value.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, log_ndtr

from bayesdeg.inference.innovations import path_innovations
from bayesdeg.inference.path_density import INDEPENDENT, LOG_TWO_PI
from bayesdeg.inference.paths import Paths

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

HELD = 300_000  # entries of covariance matrices that are held at a time: what a cache holds


class Linearised(NamedTuple):
    """Readings at the most probable deviations: all that their likelihood needs.

    Parameters
    ----------
    residual : array, shape (n, n_specimens, n_readings)
        y − f(m̂) + J m̂, the observation less the linear model's value at m = 0.
    slope : array, shape (n, n_specimens, n_readings, n_deviations)
        J.
    variance : array, shape (n, n_specimens, n_readings)
        v.
    spread : array, shape (n, n_specimens, n_deviations)
        τ².
    length, correlation : array, shape (n,)
        ℓ, in the unit of the paths' gaps, and c.
    paths : Paths
        Which readings there are.
    """

    residual: Floats
    slope: Floats
    variance: Floats
    spread: Floats
    length: Floats
    correlation: Floats
    paths: Paths

    def subset(self, rows: slice) -> "Linearised":
        """Return some of the draws."""
        return self._replace(
            residual=self.residual[rows],
            slope=self.slope[rows],
            variance=self.variance[rows],
            spread=self.spread[rows],
            length=self.length[rows],
            correlation=self.correlation[rows],
        )


def innovations(curves: Linearised) -> tuple[Floats, Floats]:
    """Return z and ln s of each reading given those before it on its specimen.

    The log density of a specimen is the sum of −z²/2 − ln s − ln(2π)/2 over its readings; those of
    the second output come after all of the first.

    Returns
    -------
    score, log_sd : array, shape (n, n_recorded)
        Of the readings that there are, specimen by specimen.
    """
    score, log_sd = np.empty_like(curves.residual), np.empty_like(curves.residual)
    path_innovations(
        np.ascontiguousarray(curves.residual),
        np.ascontiguousarray(curves.slope),
        np.ascontiguousarray(curves.variance),
        np.ascontiguousarray(curves.spread),
        np.ascontiguousarray(curves.length),
        np.ascontiguousarray(curves.correlation),
        np.ascontiguousarray(curves.paths.mask),
        np.ascontiguousarray(curves.paths.gap),
        curves.paths.points,
        score,
        log_sd,
    )
    return score[:, curves.paths.mask], log_sd[:, curves.paths.mask]


def covariance(curves: Linearised) -> Floats:
    """Return the covariance of the readings, shape (n, n_specimens, n_readings, n_readings).

    Rows and columns without a reading are those of the unit matrix.
    """
    correlation = noise_correlation(curves.paths, curves.length, curves.correlation)
    sd = np.sqrt(np.where(curves.paths.mask, curves.variance, 1.0))
    slope = np.where(curves.paths.mask[..., None], curves.slope, 0.0)
    scatter = np.einsum("nsik,nsk,nsjk->nsij", slope, curves.spread, slope)
    total: Floats = correlation * sd[..., :, None] * sd[..., None, :] + scatter
    return total


def noise_correlation(paths: Paths, length: Floats, correlation: Floats) -> Floats:
    """Return R, the correlation of the reading errors, (n, n_specimens, n_readings, n_readings)."""
    size = paths.mask.shape[-1]
    distance = np.abs(paths.place[:, :, None] - paths.place[:, None, :])
    output = np.arange(size) // paths.points
    same = output[:, None] == output[None, :]
    decay = np.exp(-distance / length[:, None, None, None])
    step = np.arange(size) % paths.points
    own = np.where(step[:, None] == step[None, :], 1.0, 1.0 - INDEPENDENT)
    read = paths.mask[:, :, None] & paths.mask[:, None, :]
    full: Floats = np.where(
        read, own * decay * np.where(same, 1.0, correlation[:, None, None, None]), np.eye(size)
    )
    return full


def sequential(curves: Linearised) -> Floats:
    """Return log densities of each reading given those before it, (n, n_specimens, n_readings).

    Readings of the second output come after all of the first. Their sum over a specimen is its
    density: the chain rule, by the Cholesky factor of the covariance.
    """
    mask = curves.paths.mask
    out = np.zeros(curves.residual.shape)
    size = max(1, HELD // (mask.size * mask.shape[1]))
    for start in range(0, len(out), size):
        rows = slice(start, start + size)
        part = curves.subset(rows)
        factor = np.linalg.cholesky(covariance(part))
        residual = np.where(mask, part.residual, 0.0)
        z = np.linalg.solve(factor, residual[..., None])[..., 0]
        scale = np.diagonal(factor, axis1=-2, axis2=-1)
        out[rows] = np.where(mask, -0.5 * (z**2 + LOG_TWO_PI) - np.log(scale), 0.0)
    return out


def correlated_normals(
    paths: Paths, length: Floats, correlation: Floats, generator: np.random.Generator
) -> Floats:
    """Draw z, shape (n, n_specimens, n_readings); independent where there is no reading."""
    shape = (len(length), *paths.mask.shape)
    common, own = generator.standard_normal((2, *shape))
    points = paths.points
    for start in range(0, shape[-1], points):
        last = np.zeros(shape[:-1])
        for j in range(start, start + points):
            decay = np.exp(-paths.gap[:, j] / length[:, None])
            common[..., j] = decay * last + np.sqrt(1.0 - decay**2) * common[..., j]
            last = np.where(paths.mask[:, j], common[..., j], last)
    z: Floats = np.sqrt(1.0 - INDEPENDENT) * common + np.sqrt(INDEPENDENT) * own
    if shape[-1] > points:
        share = correlation[:, None, None]
        first, second = z[..., :points], z[..., points:]
        z = np.concatenate([first, share * first + np.sqrt(1.0 - share**2) * second], axis=-1)
    return np.where(paths.mask, z, own)


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


def event_signal(log_probability: Floats) -> Floats:
    """Return 2 arcsin √P, whose slope squared is the information that an event gives.

    Of an event of probability P that is P'²/(P (1 − P)).

    Examples
    --------
    >>> event_signal(np.log([0.5])).round(4)  # π/2
    array([1.5708])
    """
    signal: Floats = 2.0 * np.arcsin(np.exp(np.minimum(0.5 * log_probability, 0.0)))
    return signal


def student_information(dof: float) -> float:
    """Return the square root of the expected information of a shift by one scale.

    That of Student's law is (ν + 1)/(ν + 3); of the normal law 1.

    Examples
    --------
    >>> student_information(float("inf")), round(student_information(3.0), 4)
    (1.0, 0.8165)
    """
    return 1.0 if np.isinf(dof) else float(np.sqrt((dof + 1.0) / (dof + 3.0)))


def log_normal(value: Floats, median: Floats, scatter: Floats) -> Floats:
    """Return the log-normal log density of values with this median and sd of the logarithm."""
    return normal(np.log(value), np.log(median), scatter) - np.log(value)


def log_interval(low: Floats, high: Floats) -> Floats:
    """Return ln(Φ(high) − Φ(low)) of standard scores, low < high, either infinite.

    Examples
    --------
    >>> round(float(log_interval(np.array(-np.inf), np.array(0.0))), 4)  # ln ½
    -0.6931
    """
    # in the tail on the left, where the difference of two logarithms is exact
    swap = low > 0.0
    low, high = np.where(swap, -high, low), np.where(swap, -low, high)
    upper = log_ndtr(high)
    with np.errstate(divide="ignore"):
        return np.asarray(upper + np.log1p(-np.exp(log_ndtr(low) - upper)))
