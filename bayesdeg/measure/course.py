"""Replicate films → degradation rate with its errors, and its course in time."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import curve_fit
from scipy.stats import norm

from bayesdeg.measure.moisture import degradation_rate

Floats = npt.NDArray[np.float64]

#: In units of the last time; beyond it the course is straight and tells nothing of a limit.
LONGEST_TIME_CONSTANT = 100.0


@dataclass(frozen=True)
class FilmDegradation:
    """Degradation rates at the times at which films were taken out of the soil.

    Parameters
    ----------
    time_h : numpy.ndarray, shape (n_times,)
        Rising, beginning with 0 [h].
    degradation_pct : numpy.ndarray, shape (n_times,)
        Wet basis if the moisture contents are [%].
    covariance : numpy.ndarray, shape (n_times, n_times)
        Of their errors; all of them share the mean of the undegraded films [%²].
    films : numpy.ndarray of int, shape (n_times,)
        Number of films.
    moisture_initial_pct : float
        Mean moisture content of the undegraded films [%].
    """

    time_h: Floats
    degradation_pct: Floats
    covariance: Floats
    films: npt.NDArray[np.int64]
    moisture_initial_pct: float

    @property
    def standard_error(self) -> Floats:
        """Standard error of each degradation rate [%]."""
        return np.sqrt(np.diag(self.covariance))


def degradation_of_films(time_h: npt.ArrayLike, moisture_pct: npt.ArrayLike) -> FilmDegradation:
    r"""Average replicate films and compute their degradation rates, Eq. 3, with errors.

    With m and m_0 the mean moisture contents, D = 100 (1 − m/m_0), and by the delta method

    .. math:: C_{ij} = (100/m_0)^2 \left[\delta_{ij} s_i^2 + m_i m_j s_0^2 / m_0^2\right]

    where s² is the variance of a mean. The second term is common to all times but the first: at
    time 0 the two means are one, so D is 0 without error. The scatter of single films is pooled
    over all times, since a few films give no reliable variance of their own.

    Parameters
    ----------
    time_h : array_like, shape (n_films,)
        Time in the soil [h].
    moisture_pct : array_like, shape (n_films,)
        Moisture contents, all on one basis [%].

    Returns
    -------
    FilmDegradation

    Raises
    ------
    ValueError
        If there is no undegraded film, or no time with a second film.

    Examples
    --------
    Means 20 and 15 %, pooled variance of a film 2, of a mean 1: the variance of the second rate is
    (100/20)² (1 + (15/20)²) = 39.06.

    >>> films = degradation_of_films([0, 0, 8, 8], [19.0, 21.0, 14.0, 16.0])
    >>> films.degradation_pct.tolist(), films.standard_error.tolist()
    ([0.0, 25.0], [0.0, 6.25])
    """
    time, moisture = np.asarray(time_h, float), np.asarray(moisture_pct, float)
    times, which, films = np.unique(time, return_inverse=True, return_counts=True)
    if times.size == 0 or times[0] != 0.0:
        raise ValueError("no film was measured at time 0, so there is no M_C0 to compare with")
    freedom = moisture.size - times.size
    if freedom < 1:
        raise ValueError("no time has a second film, so the scatter of films is unknown")
    mean = np.bincount(which, moisture) / films
    variance_of_mean = np.sum((moisture - mean[which]) ** 2) / freedom / films
    slope = mean / mean[0]
    covariance = np.diag(variance_of_mean) + np.outer(slope, slope) * variance_of_mean[0]
    covariance[0, :] = covariance[:, 0] = 0.0
    return FilmDegradation(
        times,
        degradation_rate(mean, mean[0]),
        (100.0 / mean[0]) ** 2 * covariance,
        films.astype(np.int64),
        float(mean[0]),
    )


@dataclass(frozen=True)
class SaturatingCourse:
    r"""The degradation rate as a function of time, levelling off.

    .. math:: D(t) = D_\infty (1 - e^{-t/\tau})

    Parameters
    ----------
    limit_pct : float
        D_∞ [%].
    time_constant_h : float
        τ [h].
    covariance : numpy.ndarray, shape (2, 2)
        Of (D_∞, τ).
    """

    limit_pct: float
    time_constant_h: float
    covariance: Floats

    def degradation(self, time_h: npt.ArrayLike) -> Floats:
        """Compute the degradation rate at the given times [%]."""
        return saturating(np.asarray(time_h, float), self.limit_pct, self.time_constant_h)

    def standard_error(self, time_h: npt.ArrayLike) -> Floats:
        """Compute the standard error of the curve at the given times, by the delta method [%]."""
        reduced = np.asarray(time_h, float) / self.time_constant_h
        by_limit = -np.expm1(-reduced)
        by_time_constant = -self.limit_pct * reduced * np.exp(-reduced) / self.time_constant_h
        gradient = np.stack([by_limit, by_time_constant], axis=-1)
        variance = np.einsum("...i,ij,...j->...", gradient, self.covariance, gradient)
        return np.asarray(np.sqrt(variance), float)

    def band(
        self, time_h: npt.ArrayLike, *, probability: float = 0.9, scatter_sd_pct: float = 0.0
    ) -> tuple[Floats, Floats]:
        """Compute the lower and upper edge of the band of the curve, or of a new measurement.

        Parameters
        ----------
        time_h : array_like
            [h]
        probability : float
            What the band holds.
        scatter_sd_pct : float
            Standard deviation of a new measurement about the curve; 0 for the curve itself [%].

        Returns
        -------
        lower, upper : numpy.ndarray
            [%]
        """
        sd = np.hypot(self.standard_error(time_h), scatter_sd_pct)
        reach = float(norm.ppf(0.5 + probability / 2.0)) * sd
        centre = self.degradation(time_h)
        return centre - reach, centre + reach


def saturating(
    time_h: Floats, limit_pct: Floats | float, time_constant_h: Floats | float
) -> Floats:
    """Evaluate D_∞ (1 − exp(−t/τ)) [%]; arguments broadcast."""
    return np.asarray(-limit_pct * np.expm1(-time_h / time_constant_h), float)


def fit_saturating_course(films: FilmDegradation) -> SaturatingCourse:
    """Fit the saturating law by generalised least squares, errors and their correlation included.

    Parameters
    ----------
    films : FilmDegradation
        At least two times after 0; time 0 itself is met by the law and carries no information.

    Returns
    -------
    SaturatingCourse

    Raises
    ------
    ValueError
        If there are too few times, or if the rates do not level off or do not rise.

    Examples
    --------
    >>> time = np.array([0.0, 4.0, 8.0, 16.0, 24.0])
    >>> rate = saturating(time, 30.0, 10.0)
    >>> films = FilmDegradation(time, rate, np.diag([0, 1, 1, 1, 1.0]), np.full(5, 9), 20.0)
    >>> course = fit_saturating_course(films)
    >>> round(course.limit_pct, 4), round(course.time_constant_h, 4)
    (30.0, 10.0)
    """
    time, rate = films.time_h[1:], films.degradation_pct[1:]
    if time.size < 2:
        raise ValueError("fewer than two times after 0: the saturating law cannot be fitted")
    covariance = films.covariance[1:, 1:]
    if not time @ np.linalg.solve(covariance, rate) > 0.0:
        raise ValueError("the degradation rates do not rise with time")
    longest = LONGEST_TIME_CONSTANT * float(time[-1])
    found, errors = curve_fit(
        saturating,
        time,
        rate,
        p0=(max(1.5 * float(rate.max()), 1.0), float(np.median(time))),
        sigma=covariance,
        absolute_sigma=True,
        bounds=([0.0, 1e-3 * time[0]], [np.inf, longest]),
    )
    if found[1] > 0.99 * longest:
        raise ValueError("the degradation rates do not rise towards a limit")
    return SaturatingCourse(float(found[0]), float(found[1]), errors)
