"""Moisture of films: degradation rate with its errors, and its course over time.

The degradation rate D_R is a proxy: the loss of retained water, not of mass. Eq. 4 divides by the
moist mass (wet basis), the control experiment behind Eq. 6 by the dry mass (dry basis). D_R is on
the wet basis throughout; code that needs the dry basis converts it here.
"""

import importlib
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
import pandas as pd

Floats = npt.NDArray[np.float64]

#: Slope of Eq. 6: mass loss over degradation rate, dry basis [–].
MASS_LOSS_SLOPE = 0.8574


def moisture_content(mass_equilibrated: npt.ArrayLike, mass_dry: npt.ArrayLike) -> Floats:
    r"""Compute the moisture content on the wet basis, Eq. 4.

    .. math:: M_C = 100 (M_0 - M_d) / M_0

    Parameters
    ----------
    mass_equilibrated, mass_dry : array_like, broadcastable
        M_0 and M_d, both above 0, in the same unit.

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    1.00 g of film that dries to 0.80 g held 20 % moisture.

    >>> round(float(moisture_content(1.0, 0.8)), 12)
    20.0
    """
    moist, dry = np.asarray(mass_equilibrated, float), np.asarray(mass_dry, float)
    return np.asarray(100.0 * (moist - dry) / moist, float)


def moisture_content_dry_basis(mass_equilibrated: npt.ArrayLike, mass_dry: npt.ArrayLike) -> Floats:
    r"""Compute the moisture content on the dry basis, as in the control experiment.

    .. math:: M_C = 100 (M_{e} - M') / M'

    Parameters
    ----------
    mass_equilibrated, mass_dry : array_like, broadcastable
        M_e and M', both above 0, in the same unit.

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    The same film holds 0.20 g of water on 0.80 g.

    >>> round(float(moisture_content_dry_basis(1.0, 0.8)), 12)
    25.0
    """
    moist, dry = np.asarray(mass_equilibrated, float), np.asarray(mass_dry, float)
    return np.asarray(100.0 * (moist - dry) / dry, float)


def degradation_rate(moisture: npt.ArrayLike, moisture_initial: npt.ArrayLike) -> Floats:
    r"""Compute the degradation rate, Eq. 3.

    .. math:: D_R = -100 (M_C - M_{C0}) / M_{C0}

    Parameters
    ----------
    moisture, moisture_initial : array_like, broadcastable
        Mean moisture contents after and before degradation, on the same basis [%].

    Returns
    -------
    numpy.ndarray
        [%]; scatter may make it slightly negative.

    Examples
    --------
    A fall from 20 % to 15 % moisture is a degradation rate of 25 %.

    >>> float(degradation_rate(15.0, 20.0))
    25.0
    """
    after, before = np.asarray(moisture, float), np.asarray(moisture_initial, float)
    return np.asarray(100.0 * (before - after) / before, float)


def to_dry_basis(degradation_pct: npt.ArrayLike, *, moisture_initial_pct: npt.ArrayLike) -> Floats:
    r"""Convert a degradation rate from the wet to the dry basis.

    With w_0 the wet-basis moisture fraction before degradation and w = w_0 (1 − D/100) after,

    .. math:: D_{dry} = 100 \left(1 - \frac{w (1 - w_0)}{w_0 (1 - w)}\right)

    Parameters
    ----------
    degradation_pct : array_like
        Wet basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis, between 0 and 100 [%].

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    At 20 % moisture, 25 % is 1 − (0.15 × 0.80)/(0.20 × 0.85) = 29.4 %.

    >>> round(float(to_dry_basis(25.0, moisture_initial_pct=20.0)), 3)
    29.412
    """
    before = np.asarray(moisture_initial_pct, float) / 100.0
    left = 1.0 - np.asarray(degradation_pct, float) / 100.0
    return np.asarray(100.0 * (1.0 - left * (1.0 - before) / (1.0 - before * left)), float)


def to_wet_basis(degradation_pct: npt.ArrayLike, *, moisture_initial_pct: npt.ArrayLike) -> Floats:
    r"""Convert a degradation rate from the dry to the wet basis; inverse of `to_dry_basis`.

    With d_0 = w_0/(1 − w_0) and d = d_0 (1 − D/100) the dry-basis moisture fractions,

    .. math:: D_{wet} = 100 \left(1 - \frac{d}{w_0 (1 + d)}\right)

    Parameters
    ----------
    degradation_pct : array_like
        Dry basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis, between 0 and 100 [%].

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    >>> round(float(to_wet_basis(29.4117647, moisture_initial_pct=20.0)), 6)
    25.0
    """
    before = np.asarray(moisture_initial_pct, float) / 100.0
    dry = before / (1.0 - before) * (1.0 - np.asarray(degradation_pct, float) / 100.0)
    return np.asarray(100.0 * (1.0 - dry / (before * (1.0 + dry))), float)


def mass_loss(mass: npt.ArrayLike, mass_initial: npt.ArrayLike) -> Floats:
    r"""Compute the mass loss, Eq. 5.

    .. math:: M_{loss} = -100 (M' - M'_0) / M'_0

    Parameters
    ----------
    mass, mass_initial : array_like, broadcastable
        Dry masses M' and M'_0 after and before degradation, in the same unit.

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    >>> round(float(mass_loss(0.45, 0.60)), 12)
    25.0
    """
    after, before = np.asarray(mass, float), np.asarray(mass_initial, float)
    return np.asarray(100.0 * (before - after) / before, float)


def mass_loss_from_degradation(
    degradation_pct: npt.ArrayLike,
    *,
    moisture_initial_pct: npt.ArrayLike,
    slope: float = MASS_LOSS_SLOPE,
) -> Floats:
    r"""Estimate the mass loss from the degradation rate of a film, Eq. 6.

    .. math:: M_{loss} = 0.8574 \, D_{R, dry}

    The slope was fitted with both moisture contents on the dry basis, so a film's degradation rate
    is converted first. It was measured in a bromelain solution, not in soil.

    Parameters
    ----------
    degradation_pct : array_like
        Wet basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis [%].
    slope : float
        Mass loss over degradation rate, dry basis [–].

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    0.8574 × 29.41 %:

    >>> round(float(mass_loss_from_degradation(25.0, moisture_initial_pct=20.0)), 2)
    25.22
    """
    dry = to_dry_basis(degradation_pct, moisture_initial_pct=moisture_initial_pct)
    return slope * dry


@dataclass(frozen=True)
class MassLossSlope:
    """Mass loss over degradation rate, from a control experiment.

    Parameters
    ----------
    dry, wet : float
        Slope with both moisture contents on the dry basis, as in Eq. 6, and on the wet basis [–].
    dry_se, wet_se : float
        Their standard errors; nan for a single sample.
    samples : int
        Samples weighed before and after.
    """

    dry: float
    dry_se: float
    wet: float
    wet_se: float
    samples: int


def mass_loss_slope(control: pd.DataFrame) -> MassLossSlope:
    r"""Fit the slope of Eq. 6 to the control experiment, by least squares through the origin.

    .. math:: k = \frac{\sum D M}{\sum D^2}, \quad
        \sigma_k^2 = \frac{\sum (M - k D)^2}{(n - 1) \sum D^2}

    with each sample's mass loss M of Eq. 5 and degradation rate D of Eq. 3, relative to its own
    moisture before degradation. Scatter of D lowers k by its share of ΣD².

    Parameters
    ----------
    control : pandas.DataFrame
        ``mass_loss.csv``.

    Raises
    ------
    ValueError
        If no sample's moisture changed.

    Examples
    --------
    Moisture on the dry basis falls from 25 to 20 %, D = 20 %, while 17 % of the mass is lost:

    >>> masses = {"mass_dry_before_g": [1.0], "mass_equilibrated_before_g": [1.25]}
    >>> masses |= {"mass_dry_after_g": [0.83], "mass_equilibrated_after_g": [0.83 * 1.2]}
    >>> round(mass_loss_slope(pd.DataFrame(masses)).dry, 4)
    0.85
    """
    before, after = (
        (control[f"mass_equilibrated_{state}_g"], control[f"mass_dry_{state}_g"])
        for state in ("before", "after")
    )
    lost = mass_loss(after[1], before[1])
    dry, wet = (
        _through_origin(degradation_rate(content(*after), content(*before)), lost)
        for content in (moisture_content_dry_basis, moisture_content)
    )
    return MassLossSlope(*dry, *wet, len(lost))


def _through_origin(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of a line through the origin and its standard error."""
    told = (x != 0.0) | (y != 0.0)  # points at the origin carry no information
    x, y, square = x[told], y[told], float(x @ x)
    if not square > 0.0:
        raise ValueError("no sample's moisture changed, so the slope is undetermined")
    slope = float(x @ y) / square
    left = y - slope * x
    freedom = len(x) - 1
    return slope, float(np.sqrt(left @ left / freedom / square)) if freedom else float("nan")


#: In units of the last time; with a longer time constant the course is straight and shows no limit.
LONGEST_TIME_CONSTANT = 100.0


@dataclass(frozen=True)
class FilmDegradation:
    """Degradation rates at the times at which films were unearthed.

    Parameters
    ----------
    time_h : numpy.ndarray, shape (n_times,)
        Rising, beginning with 0 [h].
    degradation_pct : numpy.ndarray, shape (n_times,)
        Wet basis if the moisture contents are [%].
    covariance : numpy.ndarray, shape (n_times, n_times)
        Of their errors; all share the mean of the undegraded films [%²].
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
    r"""Average replicate films and compute degradation rates, Eq. 3, with errors.

    With m and m_0 the mean moisture contents, D = 100 (1 − m/m_0), and by the delta method

    .. math:: C_{ij} = (100/m_0)^2 \left[\delta_{ij} s_i^2 + m_i m_j s_0^2 / m_0^2\right]

    where s² is the variance of a mean. The second term is common to all times but the first: at
    time 0 both means coincide, so D is 0 without error. The scatter of single films is pooled over
    all times, since a few films give no reliable variance.

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
        If there is no undegraded film, or no time with two films.

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
        raise ValueError("no film was measured at time 0, so M_C0 is unknown; add a fresh film")
    freedom = moisture.size - times.size
    if freedom < 1:
        raise ValueError("no time has two films, so their scatter is unknown; add a replicate")
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
    r"""Degradation rate as a saturating function of time.

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
        """Compute the band of the curve, or of a new measurement.

        Parameters
        ----------
        time_h : array_like
            [h]
        probability : float
            Probability content of the band.
        scatter_sd_pct : float
            Standard deviation of a new measurement about the curve; 0 for the curve itself [%].

        Returns
        -------
        lower, upper : numpy.ndarray
            [%]
        """
        sd = np.hypot(self.standard_error(time_h), scatter_sd_pct)
        reach = NormalDist().inv_cdf(0.5 + probability / 2.0) * sd
        centre = self.degradation(time_h)
        return centre - reach, centre + reach


def saturating(
    time_h: Floats, limit_pct: Floats | float, time_constant_h: Floats | float
) -> Floats:
    """Evaluate D_∞ (1 − exp(−t/τ)) [%]; arguments broadcast."""
    return np.asarray(-limit_pct * np.expm1(-time_h / time_constant_h), float)


def fit_saturating_course(films: FilmDegradation) -> SaturatingCourse:
    """Fit the saturating law by generalised least squares with correlated errors.

    Parameters
    ----------
    films : FilmDegradation
        At least two times after 0; the law meets time 0 exactly, so it carries no information.

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
    optimize = importlib.import_module("scipy.optimize")  # slow to import; a check needs none
    found, errors = optimize.curve_fit(
        saturating,
        time,
        rate,
        p0=(max(1.5 * float(rate.max()), 1.0), float(np.median(time))),
        sigma=covariance,
        absolute_sigma=True,
        bounds=([0.0, 1e-3 * time[0]], [np.inf, longest]),
    )
    if found[1] > 0.99 * longest:
        raise ValueError("the degradation rates do not level off")
    return SaturatingCourse(float(found[0]), float(found[1]), errors)
