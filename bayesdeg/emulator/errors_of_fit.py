"""The emulator's own error, from runs left out: how large it is where."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from sklearn.linear_model import GammaRegressor

from bayesdeg.emulator.families import Family, features
from bayesdeg.emulator.terms import N_CHEBYSHEV, Terms

Floats = NDArray[np.float64]

# cubic in load and material, quadratic in each cause
FAMILY = Family((3, 3, 3, 3), (1, 0, 0, 0), (2, 2, 0, 2, 2, 2, 2, 2, 2))
SMALLEST = 2e-4  # relative error that is taken for rounding of the path
PENALTY = 1e-3
INSIDE = 0.9
# runs count by how near their material is to those that studies meet: over how many standard
# deviations, and how much at least
REACH, LEAST = 2.0, 0.02


def fit_errors(points: Floats, left_out: Floats, weights: Floats) -> Terms:
    """Return ln of the squared relative errors as terms.

    Their mean square is fitted by a gamma regression; then its level is set so that nine tenths
    of the errors lie within the 90 % interval of a normal law.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    left_out : array, shape (n, n_outputs)
        Relative errors of runs left out [–].
    weights : array, shape (n,)
        How much each counts, see ``nearness``.
    """
    orders = FAMILY.orders
    matrix = features(orders, points)
    coefficients = []
    for column in left_out.T:
        squares = np.maximum(column**2, SMALLEST**2)
        scale = float(np.average(squares, weights=weights))
        model = GammaRegressor(alpha=PENALTY, max_iter=2000, tol=1e-6)
        model.fit(matrix[:, 1:], squares / scale, sample_weight=weights)
        level = np.concatenate([[model.intercept_ + np.log(scale)], model.coef_])
        spread = np.sqrt(squares) / np.exp(0.5 * matrix @ level)
        inside = _weighted_quantile(spread, weights, INSIDE)
        level[0] += 2.0 * np.log(inside / norm.ppf(0.5 * (1.0 + INSIDE)))
        coefficients.append(level)
    return Terms(orders, np.array(coefficients))


def nearness(points: Floats, usual: Floats) -> Floats:
    """Return exp(−d²/8) + 0.02 with d the distance from usual materials, (n,).

    d is Mahalanobis's, over the mean and the covariance of the usual ones. So the error is known
    best where it is asked for, and next to the edges of the range it is rather too large.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    usual : array, shape (m, 13)
        Coordinates of materials that studies meet.
    """
    material = slice(1, N_CHEBYSHEV)
    centre, spread = usual[:, material].mean(axis=0), np.cov(usual[:, material].T)
    away = points[:, material] - centre
    square = np.einsum("ni,ij,nj->n", away, np.linalg.inv(spread), away)
    near: Floats = np.exp(-0.5 * square / REACH**2) + LEAST
    return near


def _weighted_quantile(values: Floats, weights: Floats, share: float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, share * total[-1])])


def coverage(errors: Terms, points: Floats, left_out: Floats) -> list[float]:
    """Return which share of errors lies within the 90 % interval, one an output."""
    sd = np.exp(0.5 * features(errors.orders, points) @ errors.coefficients.T)
    within = np.abs(left_out) <= norm.ppf(0.5 * (1.0 + INSIDE)) * sd
    return [float(share) for share in within.mean(axis=0)]


def summary(worst: Sequence[float]) -> dict[str, float]:
    """Return rms, 95th percentile and largest of errors, one a curve [%]."""
    size = 100.0 * np.abs(np.asarray(worst, dtype=np.float64))
    if len(size) == 0:
        return {}
    return {
        "rms_pct": float(np.sqrt(np.mean(size**2))),
        "median_pct": float(np.median(size)),
        "p95_pct": float(np.quantile(size, 0.95)),
        "max_pct": float(np.max(size)),
    }
