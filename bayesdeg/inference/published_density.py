"""Log densities of published R² and counts of ruptures, given what the forward map answers.

R² = 1 − SSE/SST says how far n specimens were from the simulation of their publication. A specimen
s differs from it, to first order, by

    d_sj = J_j (m_s − m_0) + ε_sj,   J = ∂κ/∂ ln(stiffness),

with m_s ~ N(0, τ²) its own stiffness, error of its degradation rate included, m_0 ~ N(0, τ_0²) the
error of the constants which that simulation took from a few films, and ε the noise of reading. So
SSE is a weighted sum of chi-squares; a scaled chi-square stands for it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, log_ndtr, logsumexp

Floats = NDArray[np.float64]

SMALLEST_MISFIT = 2.5e-4
"""R² is published to three decimals: 1.000 means a misfit between 0 and 5e-4."""
SMALLEST_ELONGATION = 1e-6

STIFFNESS_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
"""Gauss–Hermite rule for the specimen's own stiffness, in standard deviations."""
_LOG_WEIGHTS = np.log(_WEIGHTS / np.sum(_WEIGHTS))


class Differences(NamedTuple):
    """What the differences of specimens to the published simulation are made of.

    ``slope`` is J [1/m], of either sign, (n, n_levels, n_pressures). ``spread`` and
    ``common_spread`` are τ² and τ_0², (n, n_levels) or (n, 1). ``noise`` is the covariance V of
    the noise along a path [1/m²], (n, n_levels, n_pressures, n_pressures). ``specimens`` is n,
    (n_levels,) or a number.
    """

    slope: Floats
    spread: Floats
    common_spread: Floats
    noise: Floats
    specimens: Floats | float


class Moments(NamedTuple):
    """Mean and variance of SSE, each (n, n_levels), [1/m²] and its square."""

    mean: Floats
    variance: Floats


def misfit_moments(differences: Differences) -> Moments:
    r"""Return mean and variance of the sum of squared differences, SSE.

    All readings of all specimens have covariance
    :math:`\Sigma = I_n \otimes (V + \tau^2 J J^T) + 1 1^T \otimes \tau_0^2 J J^T`; with it
    :math:`E = tr\,\Sigma` and :math:`Var = 2\,tr\,\Sigma^2`.

    Examples
    --------
    One specimen, one reading of noise 0.5 and scatter 1 × 2: SSE is (4 + 0.25) χ².

    >>> one = np.ones((1, 1))
    >>> some = Differences(2.0 * one[..., None], one, 0.0 * one, 0.25 * one[..., None, None], 1.0)
    >>> misfit_moments(some)
    Moments(mean=array([[4.25]]), variance=array([[36.125]]))
    """
    slope, spread, common_spread, noise, specimens = differences
    size = np.sum(slope**2, axis=-1)
    both = (spread + common_spread) * size
    across = np.sum(slope * np.matmul(noise, slope[..., None])[..., 0], axis=-1)
    mean = specimens * (np.trace(noise, axis1=-2, axis2=-1) + both)
    within = np.sum(noise**2, axis=(-2, -1)) + 2.0 * (spread + common_spread) * across + both**2
    between = (specimens - 1.0) * (common_spread * size) ** 2
    return Moments(mean, 2.0 * specimens * (within + between))


def expected_total(curvature: Floats, differences: Differences) -> Floats:
    """Return the mean of SST over all readings, those of zero at 0 kPa included, (n, n_levels).

    Scatter and noise of the readings add to the sum of squares of the mean curve.

    Examples
    --------
    One exact specimen with readings 0, 3, 3 about their mean of 2:

    >>> one, curve = np.ones((1, 1)), np.array([[[3.0, 3.0]]])
    >>> exact = Differences(0.0 * curve, 0.0 * one, 0.0 * one, np.zeros((1, 1, 2, 2)), 1.0)
    >>> float(expected_total(curve, exact)[0, 0])
    6.0
    """
    slope, spread, _, noise, specimens = differences
    count = curvature.shape[-1] + 1
    curve = np.sum(curvature**2, axis=-1) - np.sum(curvature, axis=-1) ** 2 / count
    squares = np.trace(noise, axis1=-2, axis2=-1) + spread * np.sum(slope**2, axis=-1)
    of_mean = np.sum(noise, axis=(-2, -1)) + spread * np.sum(slope, axis=-1) ** 2
    total: Floats = specimens * (curve + squares) - of_mean / count
    return total


def r_squared_log_density(
    one_minus_r2: Floats, curvature: Floats, differences: Differences
) -> Floats:
    r"""Return the log density of 1 − R² = SSE/SST at each level, shape (n, n_levels).

    SSE is taken as :math:`c\,\chi^2_\nu` with its own mean and variance,
    :math:`c = Var / (2 E)` and :math:`\nu = 2 E^2 / Var`, and SST as its mean. Between the 5 and
    the 95 % quantile the log density of SSE is then right to 0.3, for scatter of 2 to 10 %, errors
    of D_R up to 2 points and noise of 0.5 to 5 %; the probability of R² to fall below a value is
    right to 0.06, the simulation's response to stiffness not being linear included.

    Parameters
    ----------
    one_minus_r2 : array, shape (n_levels,)
        Published; nan gives nan.
    curvature : array, shape (n, n_levels, n_pressures)
        At the pressures above zero [1/m].
    differences : Differences
        Of the specimens to the simulation.

    References
    ----------
    Satterthwaite (1946), Biometrics Bulletin 2:110–114; doi:10.2307/3002019.

    Examples
    --------
    Two readings of one specimen with much noise of one and the same size: SSE is v χ² of 2 degrees
    of freedom, and SST = 6 + (2 − 2/3) v = 10 on average.

    >>> none, curve = np.zeros((1, 1)), np.array([[[3.0, 3.0]]])
    >>> noise = Differences(0.0 * curve, none, none, 3.0 * np.eye(2)[None, None], 1.0)
    >>> density = r_squared_log_density(np.array([0.5]), curve, noise)
    >>> bool(np.isclose(density[0, 0], np.log(0.5 * 10 / 3) - 0.5 * 0.5 * 10 / 3))
    True
    """
    mean, variance = misfit_moments(differences)
    scale, half_freedom = 0.5 * variance / mean, mean**2 / variance
    log_unit = np.log(expected_total(curvature, differences)) - np.log(scale)
    log_x = np.log(np.maximum(one_minus_r2, SMALLEST_MISFIT)) + log_unit
    density: Floats = (
        (half_freedom - 1.0) * log_x
        - 0.5 * np.exp(log_x)
        - half_freedom * np.log(2.0)
        - gammaln(half_freedom)
        + log_unit
    )
    return density


def rupture_log_density(
    ruptured: Floats, tested: Floats, peak_stretch: Floats, *, limit: Floats, scatter: Floats
) -> Floats:
    r"""Return the log probability that so many of the tested specimens burst, shape (n, n_levels).

    Binomial with

    .. math:: p = \sum_q w_q \Phi\left(\frac{1}{s} \ln \frac{\lambda_q - 1}{\lambda_b - 1}\right)

    over a Gauss–Hermite rule for the specimen's stiffness. In logarithms throughout, so that
    counts which the model holds for next to impossible get a very small probability and not zero.

    Parameters
    ----------
    ruptured, tested : array, shape (n_levels,)
        Counts.
    peak_stretch : array, shape (n, n_levels, 7)
        Largest stretch at the largest pressure at the nodes of the rule [–]. Nodes where it is nan
        are left out, and the rest reweighted; all is nan where the middle one, the mean specimen,
        is.
    limit : array, shape (n, n_levels)
        λ_b, median stretch at break [–].
    scatter : array, shape (n, n_levels) or (n, 1)
        s, sd of ln elongation at break [–].

    Examples
    --------
    Every specimen at its limit: 2 of 3 have probability 3/8.

    >>> density = rupture_log_density(np.array([2.0]), np.array([3.0]), np.full((1, 1, 7), 1.5),
    ...                               limit=np.array([[1.5]]), scatter=np.array([[0.1]]))
    >>> round(float(np.exp(density[0, 0])), 6)
    0.375
    """
    answered = np.isfinite(peak_stretch[..., len(STIFFNESS_NODES) // 2])
    known = np.isfinite(peak_stretch) | ~answered[..., None]
    elongation = np.maximum(
        np.where(np.isfinite(peak_stretch), peak_stretch, 2.0) - 1.0, SMALLEST_ELONGATION
    )
    z = (np.log(elongation) - np.log(limit - 1.0)[..., None]) / scatter[..., None]
    weight = np.where(known, _LOG_WEIGHTS, -np.inf)
    weight = weight - logsumexp(weight, axis=-1, keepdims=True)
    burst = logsumexp(weight + log_ndtr(z), axis=-1)
    whole = logsumexp(weight + log_ndtr(-z), axis=-1)
    ways = gammaln(tested + 1.0) - gammaln(ruptured + 1.0) - gammaln(tested - ruptured + 1.0)
    density = ways + ruptured * burst + (tested - ruptured) * whole
    return np.where(answered, density, np.nan)
