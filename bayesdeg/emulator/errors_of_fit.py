"""The emulator's own error, from runs left out: how large it is where."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from sklearn.linear_model import GammaRegressor

from bayesdeg.emulator.families import Family, features
from bayesdeg.emulator.terms import Terms

Floats = NDArray[np.float64]

# quadratic in load, material and each cause
FAMILY = Family((2, 1, 1, 1), (1, 0, 0, 0), (2, 2, 0, 2, 2, 2, 2, 2, 2))
SMALLEST = 2e-4  # relative error that is taken for rounding of the path
PENALTY = 1e-3
INSIDE = 0.9


def fit_errors(points: Floats, left_out: Floats) -> Terms:
    """Return ln of the squared relative errors as terms.

    Their mean square is fitted by a gamma regression; then its level is set so that nine tenths
    of the errors lie within the 90 % interval of a normal law.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    left_out : array, shape (n, n_outputs)
        Relative errors of runs left out [–].
    """
    orders = FAMILY.orders()
    matrix = features(orders, points)
    coefficients = []
    for column in left_out.T:
        squares = np.maximum(column**2, SMALLEST**2)
        scale = float(np.mean(squares))
        model = GammaRegressor(alpha=PENALTY, max_iter=2000, tol=1e-6)
        model.fit(matrix[:, 1:], squares / scale)
        level = np.concatenate([[model.intercept_ + np.log(scale)], model.coef_])
        spread = np.abs(column) / np.exp(0.5 * matrix @ level)
        level[0] += 2.0 * np.log(np.quantile(spread, INSIDE) / norm.ppf(0.5 * (1.0 + INSIDE)))
        coefficients.append(level)
    return Terms(orders, np.array(coefficients))


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
