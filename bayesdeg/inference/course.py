"""Moisture of films against time in the soil: the posterior of the course of degradation.

A film that was taken out of the soil after t hours holds, by Eqs 3 and 4 of
doi:10.3389/frobt.2021.760485 (wet basis),

    M_C = M_C0 [1 − D_∞ (1 − exp(−t/τ)) / 100] + ε,   ε ~ N(0, s²),

with s the scatter of films in points of moisture. Its parameters appear in no other likelihood of a
study, so the joint posterior is a product and this factor is sampled separately.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.moisture import moisture_content, saturating
from bayesdeg.data.study import Study
from bayesdeg.inference.density import CustomDensity
from bayesdeg.observations.noise import normal
from bayesdeg.observations.specimens import COURSE
from bayesdeg.priors import Named, Parameter, ParameterTable, with_priors

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CourseModel:
    """The posterior density of the course of degradation, up to a constant.

    Parameters
    ----------
    films : tuple of str
        One per film.
    time_h : array, shape (n_films,)
        Time in the soil [h].
    moisture_pct : array, shape (n_films,)
        Moisture content, wet basis [%].
    parameters : tuple of Parameter
        With their priors.

    Examples
    --------
    >>> times, moisture = np.array([0.0, 24.0]), np.array([20.0, 15.0])
    >>> model = CourseModel(("a", "b"), times, moisture)
    >>> model.log_prob(np.zeros((3, 4))).shape
    (3,)
    """

    films: tuple[str, ...]
    time_h: Floats
    moisture_pct: Floats
    parameters: tuple[Parameter, ...] = COURSE

    @property
    def table(self) -> ParameterTable:
        """All parameters."""
        return ParameterTable(self.parameters)

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of each vector, shape (n,); −inf where impossible."""

        def of_all_films(values: Named) -> Floats:
            total: Floats = np.sum(self.log_likelihood(values)["moisture"], axis=-1)
            return total

        return CustomDensity(self.parameters, of_all_films).log_prob(vectors, truncate=truncate)

    def log_likelihood(self, values: Named) -> dict[str, Floats]:
        """Return the log density of each film under ``moisture``, shape (n, n_films)."""
        mean = moisture_at(values, self.time_h)
        return {"moisture": normal(self.moisture_pct, mean, values["moisture_scatter"][:, None])}


def course_model(study: Study) -> CourseModel | None:
    """Return the model of a study's moisture readings, with the study's priors.

    Returns
    -------
    CourseModel or None
        None if there are no films, or all were taken out at the same time.
    """
    table = study.moisture
    if table is None or table["time_h"].nunique() < 2:
        return None
    stated = study.settings.priors
    return CourseModel(
        films=tuple(str(film) for film in table["film_id"]),
        time_h=table["time_h"].to_numpy(np.float64),
        moisture_pct=moisture_content(
            table["mass_equilibrated_g"].to_numpy(np.float64),
            table["mass_dry_g"].to_numpy(np.float64),
        ),
        parameters=with_priors(COURSE, stated),
    )


def degradation_at(values: Named, time_h: Floats) -> Floats:
    """Return D_R of the mean film [%] at times (n_times,), shape (n, n_times).

    Examples
    --------
    >>> values = {"degradation_limit": np.array([30.0])}
    >>> values["degradation_time_constant"] = np.array([10.0])
    >>> degradation_at(values, np.array([0.0, 10.0])).round(2)
    array([[ 0.  , 18.96]])
    """
    limit, constant = values["degradation_limit"], values["degradation_time_constant"]
    return saturating(time_h, limit[:, None], constant[:, None])


def moisture_at(values: Named, time_h: Floats) -> Floats:
    """Return the moisture content of the mean film [%] at times (n_times,), (n, n_times)."""
    fresh = values["fresh_moisture"][:, None]
    moisture: Floats = fresh * (1.0 - degradation_at(values, time_h) / 100.0)
    return moisture


def time_to_reach(values: Named, degradation: float) -> Floats:
    r"""Return the time after which the mean film has reached a degradation rate.

    .. math:: t = -\tau \ln(1 - D / D_\infty)

    Parameters
    ----------
    values : mapping
        Named values, (n,).
    degradation : float
        D, above 0 [%].

    Returns
    -------
    array, shape (n,)
        [h]; inf if the limit is not above it.

    Examples
    --------
    >>> values = {"degradation_limit": np.array([30.0, 20.0])}
    >>> values["degradation_time_constant"] = np.array([10.0, 10.0])
    >>> time_to_reach(values, 25.0).round(2)
    array([17.92,   inf])
    """
    share = degradation / values["degradation_limit"]
    left = np.where(share < 1.0, 1.0 - share, 1.0)
    time = -values["degradation_time_constant"] * np.log(left)
    return np.where(share < 1.0, time, np.inf)


@dataclass(frozen=True)
class RateErrors:
    """Standard errors of degradation rates computed from weighed films.

    Parameters
    ----------
    common : array
        From the mean of the fresh films, shared by every rate of the study [%].
    own : array
        From the mean of its own films [%].
    """

    common: Floats
    own: Floats

    @property
    def total(self) -> Floats:
        """Both together [%]."""
        return np.hypot(self.common, self.own)


def rate_errors(
    values: Named, degradation: Floats, *, fresh_films: float, films: float
) -> RateErrors:
    r"""Return the errors of D_R = 100 (1 − m/m_0), m and m_0 means of films, by the delta method.

    .. math:: s_{common} = (100 - D) \frac{s}{M_{C0} \sqrt{n_0}}, \quad
              s_{own} = 100 \frac{s}{M_{C0} \sqrt{n}}

    The first is one error shared by all rates, so specimens cannot average it out: it acts like a
    degradation rate misread by nearly the same number of points everywhere. Undegraded specimens
    have neither.

    Parameters
    ----------
    values : mapping
        Named values, (n,); ``fresh_moisture`` M_C0 and ``moisture_scatter`` s.
    degradation : array, shape (n_levels,)
        D [%].
    fresh_films, films : float
        n_0 and n, the films weighed fresh and at the time in question.

    Returns
    -------
    RateErrors
        Each (n, n_levels).

    Examples
    --------
    >>> values = {"fresh_moisture": np.array([20.0]), "moisture_scatter": np.array([0.6])}
    >>> errors = rate_errors(values, np.array([25.0]), fresh_films=9, films=1)
    >>> errors.common.round(3), errors.own.round(3)
    (array([[0.75]]), array([[3.]]))
    """
    relative = (values["moisture_scatter"] / values["fresh_moisture"])[:, None]
    common = (100.0 - degradation) * relative / np.sqrt(fresh_films)
    return RateErrors(common, np.broadcast_to(100.0 * relative / np.sqrt(films), common.shape))
