"""Rupture: the elongation limit against D_R, its scatter between specimens, and the size effect.

Elongation means λ − 1.  The scatter s is one number for all laws, the standard deviation of the
log elongation (exactly for the log-normal and Weibull laws, to first order for the normal one),
and every law has the same median, so that laws can be compared at equal parameters.
"""

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import special

from bayesdeg.material.degradation import Nodes, polynomial
from bayesdeg.material.modes import FloatArray

type ScatterLaw = Literal["normal", "lognormal", "weibull"]

SCATTER_LAWS: tuple[ScatterLaw, ...] = ("normal", "lognormal", "weibull")
_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


def limit_stretch(
    log_elongation_at_nodes: npt.ArrayLike, degradation: npt.ArrayLike, nodes: Nodes
) -> FloatArray:
    r"""Return the median stretch at which a specimen breaks in uniaxial tension.

    .. math:: \lambda_b(D_R) = 1 + \exp \sum_i w_i(D_R) \ln \varepsilon_i

    Parameters
    ----------
    log_elongation_at_nodes : array_like, shape (..., n_nodes)
        Logarithm of the median elongation at break ε = λ_b − 1 at the nodes [–].
    degradation : array_like, shape (), (S,) or (..., S)
        Degradation rate D_R [%].
    nodes : tuple of float
        Distinct nodes [%].

    Returns
    -------
    ndarray, shape (...) or (..., S)
        Above 1 always.

    Raises
    ------
    ValueError
        If two nodes coincide or their number is not that of the values.

    Examples
    --------
    >>> limit_stretch(np.log([2.1, 0.525]), [0.0, 12.5, 25.0], (0.0, 25.0)).round(3)
    array([3.1  , 2.05 , 1.525])
    """
    return 1.0 + np.exp(polynomial(log_elongation_at_nodes, degradation, nodes))


def weibull_modulus(limit_scatter: npt.ArrayLike) -> FloatArray:
    r"""Return Weibull's modulus with the given standard deviation of the log elongation.

    .. math:: m = \frac{\pi}{\sqrt 6 \, s}

    Examples
    --------
    >>> round(float(weibull_modulus(0.1)), 2)
    12.83
    """
    return math.pi / (math.sqrt(6.0) * np.asarray(limit_scatter, dtype=np.float64))


def log_survival(
    stretch: npt.ArrayLike,
    limit_median: npt.ArrayLike,
    limit_scatter: npt.ArrayLike,
    law: ScatterLaw = "lognormal",
) -> FloatArray:
    r"""Return the log probability that a specimen is whole at a stretch.

    With the elongation relative to its median, :math:`r = (\lambda - 1) / (\lambda_b - 1)`:

    .. math:: S = \Phi\!\left(\frac{1 - r}{s}\right), \quad
        S = \Phi\!\left(-\frac{\ln r}{s}\right), \quad
        S = \exp(-r^m \ln 2), \; m = \frac{\pi}{\sqrt 6 \, s}

    for the normal, log-normal and Weibull laws.  The normal law leaves Φ(−1/s) below stretch 1.

    Parameters
    ----------
    stretch : array_like
        Uniaxial stretch, or its equivalent by `criteria` [–].
    limit_median : array_like
        Median stretch at break λ_b [–], above 1.
    limit_scatter : array_like
        Relative scatter s of the elongation at break [–], above 0.
    law : str
        ``normal``, ``lognormal`` or ``weibull``.

    Returns
    -------
    ndarray
        In the shape of the arguments, broadcast.

    Raises
    ------
    ValueError
        If the law is unknown, a median is not above 1 or a scatter not above 0.

    References
    ----------
    Weibull (1951), J. Appl. Mech. 18, 293; doi:10.1115/1.4010337.

    Examples
    --------
    >>> round(float(np.exp(log_survival(3.1, 3.1, 0.05, "weibull"))), 3)
    0.5
    """
    ratio, _, scatter = _relative(stretch, limit_median, limit_scatter, law)
    if law == "normal":
        return np.asarray(special.log_ndtr((1.0 - ratio) / scatter))
    with np.errstate(divide="ignore"):
        log_ratio = np.log(np.maximum(ratio, 0.0))
    if law == "lognormal":
        return np.asarray(special.log_ndtr(-log_ratio / scatter))
    with np.errstate(over="ignore", under="ignore"):
        return -math.log(2.0) * np.exp(weibull_modulus(scatter) * log_ratio)


def log_density(
    stretch: npt.ArrayLike,
    limit_median: npt.ArrayLike,
    limit_scatter: npt.ArrayLike,
    law: ScatterLaw = "lognormal",
) -> FloatArray:
    """Return the log probability density of the stretch at break, that of `log_survival`.

    Arguments and errors as `log_survival`; −∞ where a specimen cannot break.

    Examples
    --------
    >>> round(float(log_density(3.1, 3.1, 0.05, "lognormal")), 3)
    1.335
    """
    ratio, elongation, scatter = _relative(stretch, limit_median, limit_scatter, law)
    if law == "normal":
        return _normal_log_density((ratio - 1.0) / scatter) - np.log(scatter * elongation)
    possible = ratio > 0.0
    log_ratio = np.log(np.where(possible, ratio, 1.0))
    if law == "lognormal":
        density = _normal_log_density(log_ratio / scatter) - np.log(scatter) - log_ratio
    else:
        modulus = weibull_modulus(scatter)
        with np.errstate(over="ignore", under="ignore"):
            hazard = math.log(2.0) * np.exp(modulus * log_ratio)
        density = np.log(modulus * math.log(2.0)) + (modulus - 1.0) * log_ratio - hazard
    return np.where(possible, density - np.log(elongation), -math.inf)


def rupture_probability(
    demand_stretch: npt.ArrayLike,
    limit_median: npt.ArrayLike,
    limit_scatter: npt.ArrayLike,
    law: ScatterLaw = "lognormal",
) -> FloatArray:
    """Return the probability that the limit stretch lies below the stretch demanded.

    Arguments and errors as `log_survival`.

    Examples
    --------
    >>> round(float(rupture_probability(1.52, 1.52, 0.1)), 3)
    0.5
    """
    return -np.expm1(log_survival(demand_stretch, limit_median, limit_scatter, law))


def weakest_link_limit(
    limit_median: npt.ArrayLike, modulus: npt.ArrayLike, volume_ratio: npt.ArrayLike
) -> FloatArray:
    r"""Return the median stretch at break of a larger or smaller volume under the same stretch.

    A body of volume V is a chain of V/V₀ specimens and breaks with its weakest:
    :math:`S_V = S_{V_0}^{V/V_0}`, for Weibull's law

    .. math:: \lambda_{b,V} - 1 = (\lambda_b - 1) \left(\frac{V}{V_0}\right)^{-1/m}

    Parameters
    ----------
    limit_median : array_like
        Median stretch at break of the volume tested, V₀ [–], above 1.
    modulus : array_like
        Weibull's modulus m [–], see `weibull_modulus`.
    volume_ratio : array_like
        Volume under stretch over the volume tested, V/V₀ [–], above 0.

    Returns
    -------
    ndarray

    Raises
    ------
    ValueError
        If a median is not above 1, or a modulus or volume ratio not above 0.

    References
    ----------
    Weibull (1951), J. Appl. Mech. 18, 293; doi:10.1115/1.4010337.

    Examples
    --------
    >>> float(weakest_link_limit(3.0, 10.0, 1024.0))
    2.0
    """
    median, modulus, ratio = (
        np.asarray(value, dtype=np.float64) for value in (limit_median, modulus, volume_ratio)
    )
    if np.any(median <= 1.0) or np.any(modulus <= 0.0) or np.any(ratio <= 0.0):
        raise ValueError("the limit must be above 1, modulus and volume ratio above 0")
    return 1.0 + (median - 1.0) * ratio ** (-1.0 / modulus)


def _relative(
    stretch: npt.ArrayLike, limit_median: npt.ArrayLike, limit_scatter: npt.ArrayLike, law: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    if law not in SCATTER_LAWS:
        raise ValueError(f"unknown scatter law {law!r}; one of {', '.join(SCATTER_LAWS)}")
    elongation = np.asarray(limit_median, dtype=np.float64) - 1.0
    scatter = np.asarray(limit_scatter, dtype=np.float64)
    if np.any(elongation <= 0.0) or np.any(scatter <= 0.0):
        raise ValueError("the limit stretch must be above 1 and its scatter above 0")
    return (np.asarray(stretch, dtype=np.float64) - 1.0) / elongation, elongation, scatter


def _normal_log_density(standard: FloatArray) -> FloatArray:
    return -0.5 * np.square(standard) - _LOG_ROOT_TWO_PI
