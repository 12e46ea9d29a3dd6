"""The course of degradation by generalised least squares: an independent estimate."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import curve_fit

from bayesdeg.data.moisture import saturating


class LeastSquares(NamedTuple):
    """D_∞ [%] and τ [h] with the covariance of both."""

    limit_pct: float
    time_constant_h: float
    covariance: np.ndarray


def least_squares_course(films):
    """Fit D_∞ (1 − exp(−t/τ)) to degradation rates of films with correlated errors."""
    time, rate = films.time_h[1:], films.degradation_pct[1:]  # at time 0 the rate is exactly 0
    found, errors = curve_fit(
        saturating,
        time,
        rate,
        p0=(max(1.5 * rate.max(), 1.0), np.median(time)),
        sigma=films.covariance[1:, 1:],
        absolute_sigma=True,
        bounds=([0.0, 1e-3 * time[0]], [np.inf, 100.0 * time[-1]]),
    )
    return LeastSquares(*found, errors)
