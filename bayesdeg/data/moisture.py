"""Moisture of films: degradation rate with its errors, and its course over time.

The degradation rate D_R is a proxy: the loss of retained water, not of mass. Eq. 4 divides by the
moist mass (wet basis), the control experiment behind Eq. 6 by the dry mass (dry basis). D_R is on
the wet basis throughout; code that needs the dry basis converts it here.

Arguments broadcast. Masses are above 0 and in one unit, moisture contents in percent and on one
basis; those called initial are before degradation.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

Floats = npt.NDArray[np.float64]

#: Slope of Eq. 6: mass loss over degradation rate, dry basis [–].
MASS_LOSS_SLOPE = 0.8574


def moisture_content(mass_equilibrated: npt.ArrayLike, mass_dry: npt.ArrayLike) -> Floats:
    r"""Compute the moisture content on the wet basis, Eq. 4 [%].

    .. math:: M_C = 100 (M_0 - M_d) / M_0

    Examples
    --------
    1.00 g of film that dries to 0.80 g held 20 % moisture.

    >>> round(float(moisture_content(1.0, 0.8)), 12)
    20.0
    """
    moist, dry = np.asarray(mass_equilibrated, float), np.asarray(mass_dry, float)
    return np.asarray(100.0 * (moist - dry) / moist, float)


def moisture_content_dry_basis(mass_equilibrated: npt.ArrayLike, mass_dry: npt.ArrayLike) -> Floats:
    r"""Compute the moisture content on the dry basis, as in the control experiment [%].

    .. math:: M_C = 100 (M_{e} - M') / M'

    Examples
    --------
    The same film holds 0.20 g of water on 0.80 g.

    >>> round(float(moisture_content_dry_basis(1.0, 0.8)), 12)
    25.0
    """
    moist, dry = np.asarray(mass_equilibrated, float), np.asarray(mass_dry, float)
    return np.asarray(100.0 * (moist - dry) / dry, float)


def degradation_rate(moisture: npt.ArrayLike, moisture_initial: npt.ArrayLike) -> Floats:
    r"""Compute the degradation rate from mean moisture contents, Eq. 3 [%].

    Scatter may make it slightly negative.

    .. math:: D_R = -100 (M_C - M_{C0}) / M_{C0}

    Examples
    --------
    A fall from 20 % to 15 % moisture is a degradation rate of 25 %.

    >>> float(degradation_rate(15.0, 20.0))
    25.0
    """
    after, before = np.asarray(moisture, float), np.asarray(moisture_initial, float)
    return np.asarray(100.0 * (before - after) / before, float)


def to_dry_basis(degradation_pct: npt.ArrayLike, *, moisture_initial_pct: npt.ArrayLike) -> Floats:
    r"""Convert a degradation rate from the wet to the dry basis [%].

    With w_0 the wet-basis moisture fraction before degradation and w = w_0 (1 − D/100) after,

    .. math:: D_{dry} = 100 \left(1 - \frac{w (1 - w_0)}{w_0 (1 - w)}\right)

    Parameters
    ----------
    degradation_pct : array_like
        Wet basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis, between 0 and 100 [%].

    Examples
    --------
    At 20 % moisture, 25 % is 1 − (0.15 × 0.80)/(0.20 × 0.85) = 29.4 %.

    >>> round(float(to_dry_basis(25.0, moisture_initial_pct=20.0)), 3)
    29.412
    """
    before = np.asarray(moisture_initial_pct, float) / 100.0
    left = 1.0 - np.asarray(degradation_pct, float) / 100.0
    return np.asarray(100.0 * (1.0 - left * (1.0 - before) / (1.0 - before * left)), float)


def mass_loss(mass: npt.ArrayLike, mass_initial: npt.ArrayLike) -> Floats:
    r"""Compute the mass loss from dry masses, Eq. 5 [%].

    .. math:: M_{loss} = -100 (M' - M'_0) / M'_0

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
    r"""Estimate the mass loss from the degradation rate of a film, Eq. 6 [%].

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
    """

    time_h: Floats
    degradation_pct: Floats
    covariance: Floats
    films: npt.NDArray[np.int64]

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
    )


def saturating(
    time_h: Floats, limit_pct: Floats | float, time_constant_h: Floats | float
) -> Floats:
    """Evaluate D_∞ (1 − exp(−t/τ)) [%]; arguments broadcast."""
    return np.asarray(-limit_pct * np.expm1(-time_h / time_constant_h), float)
