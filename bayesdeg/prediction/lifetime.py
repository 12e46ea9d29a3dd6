r"""Service life of an actuator in the soil: curvature, rupture and pressure against time.

The degradation rate D(t) of the mean film follows from the moisture of films, draw by draw. That
of a specimen deviates from it in proportion,

.. math:: D_i(t) = D(t) (1 + z_i s / D_\infty), \qquad z_i \sim N(0, 1),

with s the scatter of films, so that specimens scatter by s where the course levels off, and not at
all while fresh. Each has its own stiffness and elongation limit, with a quantile that is constant
in time: it has burst by t if its strain exceeded its limit at any time up to t. So the probability
that it has burst is the largest so far.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.pages import tables as columns
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.control import INTERVAL, largest_allowed, needed_by
from bayesdeg.prediction.experience import Experience
from bayesdeg.prediction.forecast import (
    COURSE_STREAM,
    Forecast,
    basis,
    cautions,
    ceiling_of,
    said,
    small_risk,
    stream_of,
)
from bayesdeg.prediction.posterior import TIME, Posterior, Range
from bayesdeg.prediction.predictive import Specimens, draw_specimens, not_below, respond_each
from bayesdeg.prediction.soil import Level, Soil
from bayesdeg.progress import Progress

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

DRAWS, STRATA = 250, 12
TIMES = 25  # number of default times
WITHOUT_FILMS = 24.0  # h, default duration if no film limits it
INTERVAL_OF_DRAWS = (0.05, 0.95)
UNITS = {column.name: column.unit for column in columns.TABLES[columns.LIFETIME].columns}


@dataclass(frozen=True)
class Duty:
    """Duty of an actuator in the soil.

    Parameters
    ----------
    pressure : float
        Service pressure [kPa].
    curvature : float
        Required curvature [1/m].
    risk : float
        Largest acceptable probability of rupture if the pressure is raised to keep the curvature,
        between 0 and 1 [–].
    """

    pressure: float
    curvature: float
    risk: float


@dataclass(frozen=True)
class Life:
    """Life of specimens in the soil.

    Parameters
    ----------
    hours : array, shape (n_times,)
        Rising [h].
    degradation : array, shape (n, n_times)
        Of each specimen [%].
    curvature : array, shape (n, n_times)
        At the pressure of the duty [1/m]; nan where the forward map has no answer.
    burst : array, shape (n, n_times)
        Probability that it has burst at that pressure by the time [–].
    lost : array of bool, shape (n, n_times)
        Whether it bent by less than the duty asks at any time so far.
    needed : array, shape (n, n_times)
        Pressure that it needs for the curvature [kPa]; inf of those that never reach it.
    allowed : array, shape (n_times,)
        Largest pressure that the risk allows [kPa].
    strata : int
        Specimens of a draw.
    """

    hours: Floats
    degradation: Floats
    curvature: Floats
    burst: Floats
    lost: Flags
    needed: Floats
    allowed: Floats
    strata: int

    @property
    def failed(self) -> Floats:
        """Probability that each has burst or bends too little by the time, (n, n_times)."""
        failed: Floats = np.where(self.lost, 1.0, self.burst)
        return failed

    def by_draw(self, each: Floats) -> Floats:
        """Return means over the specimens of each draw, (n_draws, n_times)."""
        means: Floats = each.reshape(-1, self.strata, len(self.hours)).mean(axis=1)
        return means

    @property
    def time_to_failure(self) -> Floats:
        """Quantiles `INTERVAL` over new specimens of the time at which one fails [h], (3,).

        inf of those that do not fail within the times.
        """
        return passed_at(self.hours, self.failed.mean(axis=0), np.array(INTERVAL))

    @property
    def last_reachable(self) -> Floats:
        """Quantiles `INTERVAL` of the last time at which the allowed pressure suffices [h], (3,).

        inf of specimens that reach the curvature at all times; 0 of those that never do.
        """
        out = np.maximum.accumulate(self.needed > self.allowed, axis=1)
        return passed_at(self.hours, out.mean(axis=0), np.array(INTERVAL))


def passed_at(hours: Floats, share: Floats, quantiles: Floats) -> Floats:
    """Return when a share that never falls passes quantiles, linear between times [h].

    Parameters
    ----------
    hours, share : array, shape (n_times,)
        [h] and [–].
    quantiles : array, shape (k,)
        [–].

    Returns
    -------
    array, shape (k,)
        [h]; inf of quantiles that are not reached, the first time of those passed from the outset.

    Examples
    --------
    >>> passed_at(np.array([0.0, 10.0, 20.0]), np.array([0.0, 0.5, 0.8]), np.array([0.25, 0.9]))
    array([ 5., inf])
    """
    after = np.argmax(share >= quantiles[:, None], axis=1)
    before = np.maximum(after - 1, 0)
    rise = share[after] - share[before]
    part = np.where(rise > 0.0, (quantiles - share[before]) / np.where(rise > 0.0, rise, 1.0), 0.0)
    found = hours[before] + part * (hours[after] - hours[before])
    return np.where(quantiles <= share[-1], found, np.inf)


def specimens_in_soil(
    soil: Soil, specimens: Specimens, generator: np.random.Generator
) -> Callable[[float], Floats]:
    """Return a function for the degradation rate of each specimen after a time in the soil [h].

    Parameters
    ----------
    soil : Soil
        Of which the course of each draw is drawn.
    specimens : Specimens
        Those in the soil.
    generator : Generator
        Draws the courses, and how specimens differ from the mean film.
    """
    draws = len(specimens.score) // specimens.strata
    drawn = soil.drawn(generator, draws)
    apart = generator.standard_normal((draws, specimens.strata))
    share = drawn.film_scatter / drawn.values["degradation_limit"]  # noqa: PD011
    # degradation cannot become negative
    factor = np.maximum(1.0 + share[:, None] * apart, 0.0)

    def rates(hours: float) -> Floats:
        mean = drawn.rates(np.array([hours]))
        return np.minimum(mean * factor, 100.0).ravel()

    return rates


def live(
    specimens: Specimens,
    rates: Callable[[float], Floats],
    duty: Duty,
    hours: Floats,
    *,
    ceiling: Callable[[Level], float],
    shown: Callable[[float], None] = lambda _: None,
) -> Life:
    """Return the life of specimens in the soil.

    Parameters
    ----------
    specimens : Specimens
        Drawn once.
    rates : callable
        Degradation rate of each specimen [%] after a time in the soil [h].
    duty : Duty
        What they have to do.
    hours : array, shape (n_times,)
        Rising, from the time at which they are put to use [h].
    ceiling : callable
        The pressure above which nothing is allowed at a level, whatever the risk [kPa].
    shown : callable
        Called with each time that is done.
    """
    first = specimens.model.world.largest_pressure
    found = []
    for time in hours:
        level = Level(rates(float(time)), float(time))
        bent, burst = respond_each(specimens, level.rates, np.array([duty.pressure]))
        needed = needed_by(specimens, level.rates, duty.curvature, first=first)
        most = ceiling(level)
        allowed = largest_allowed(specimens, level.rates, duty.risk, first=first, ceiling=most)
        found.append((level.rates, bent[:, 0], burst[:, 0], needed, allowed.pressure))
        shown(float(time))
    rate, bent, burst, needed = (np.stack([row[i] for row in found], axis=1) for i in range(4))
    with np.errstate(invalid="ignore"):
        short = bent < duty.curvature
    return Life(
        hours=hours,
        degradation=rate,
        curvature=bent,
        burst=np.maximum.accumulate(burst, axis=1),
        lost=np.maximum.accumulate(short, axis=1),
        needed=needed,
        allowed=np.array([row[4] for row in found]),
        strata=specimens.strata,
    )


# ---- the life of new actuators from a posterior


def default_hours(measured: Mapping[str, Range]) -> Floats:
    """Return times from the beginning to the last at which films were taken out of the soil [h]."""
    last = measured.get(TIME, (0.0, WITHOUT_FILMS))[1]
    return np.linspace(0.0, float(last) or WITHOUT_FILMS, TIMES)


def lifetime(
    posterior: Posterior,
    soil: Soil,
    duty: Duty,
    hours: Floats,
    *,
    beyond: bool,
    seed: int,
    progress: Progress,
    conditions: ServiceConditions = PROMPT,
) -> Forecast:
    """Forecast how long new actuators do their duty in the soil; parameters as of `lifetime_of`.

    ``beyond`` allows pressures above those tested. The messages are those for the first and the
    last time.
    """
    life = lifetime_of(
        *(posterior, soil, duty, hours),
        seed=stream_of(seed),
        progress=progress,
        conditions=conditions,
        experience=None if beyond else posterior.experience,
    )
    summary, ends = life_summary(posterior, life, duty), soil.levels(life.hours[[0, -1]])
    allowed = {
        float(rate): float(pressure)
        for level, pressure in zip(ends, life.allowed[[0, -1]], strict=True)
        for rate in level.interval
    }
    messages = (
        *cautions(posterior, ends, np.array([duty.pressure]), conditions),
        *basis(posterior, allowed, beyond=beyond),
        *small_risk(posterior, duty.risk),
    )
    table = life_table(posterior, life, duty)
    return Forecast(table, UNITS, messages, headline=str(summary), summary=summary.facts)


def lifetime_of(
    posterior: Posterior,
    soil: Soil,
    duty: Duty,
    hours: Floats,
    *,
    seed: np.random.SeedSequence,
    progress: Progress,
    conditions: ServiceConditions = PROMPT,
    experience: Experience | None = None,
    draws: int = DRAWS,
) -> Life:
    """Return the life of new specimens in the soil.

    Parameters
    ----------
    posterior : Posterior
        Of a model with actuators.
    soil : Soil
        The course of degradation.
    duty : Duty
        What they have to do.
    hours : array, shape (n_times,)
        Rising [h].
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows the times.
    conditions : ServiceConditions
        Of the specimens.
    experience : Experience, optional
        Bounds the pressure; by default the risk alone does.
    draws : int
        Of the posterior.
    """
    first, second = (np.random.default_rng(one) for one in seed.spawn(COURSE_STREAM + 2)[-2:])
    specimens = draw_specimens(
        *(posterior.model, posterior.chain, first),
        draws=draws,
        strata=STRATA,
        conditions=conditions,
    )
    progress.stage("life in the soil", total=len(hours))
    return live(
        specimens,
        specimens_in_soil(soil, specimens, second),
        duty,
        hours,
        ceiling=lambda level: np.inf if experience is None else ceiling_of(experience, level),
        shown=lambda time: progress.advance(1, f"{time:g} h"),
    )


def life_table(posterior: Posterior, life: Life, duty: Duty) -> pd.DataFrame:
    """Return a life as a table, ``lifetime.csv``; what is not finite is empty.

    No probability of rupture or failure is below one in the number of specimens that the model was
    checked on; intervals are of the mean over a draw's specimens, over the posterior.
    """
    checks = posterior.checks()
    burst, failed = (
        [
            not_below(one, checks)
            for one in (
                each.mean(axis=0),
                *np.quantile(life.by_draw(each), INTERVAL_OF_DRAWS, axis=0),
            )
        ]
        for each in (life.burst, life.failed)
    )
    bent = np.nan_to_num(life.curvature, nan=np.inf, posinf=np.inf)
    found = [
        life.hours,
        *(np.full(len(life.hours), v) for v in (duty.pressure, duty.curvature, duty.risk)),
        *np.quantile(life.degradation, INTERVAL, axis=0),
        *np.quantile(bent, INTERVAL, axis=0, method="inverted_cdf"),
        *(*burst, life.lost.mean(axis=0), *failed),
        *np.quantile(life.needed, INTERVAL, axis=0, method="inverted_cdf"),
        *(life.allowed, np.mean(life.needed <= life.allowed, axis=0)),
    ]
    headings = columns.TABLES[columns.LIFETIME].headings
    table = pd.DataFrame(dict(zip(headings, found, strict=True)))
    return table.replace([np.inf, -np.inf], np.nan)


@dataclass(frozen=True)
class LifeSummary:
    """The summary of a life.

    Parameters
    ----------
    duty : Duty
        What was asked.
    failure : (float, float, float)
        Time after which 5, 50 and 95 % of new specimens have failed [h]; inf beyond the times.
    reachable : (float, float, float)
        Last time at which the allowed pressure suffices, in the same way [h].
    first, last : float
        The first and the last time [h].
    failed, burst : float
        Probability of having failed, and of having burst, by the last time [–].
    allowed : float
        Pressure that is allowed at the last time [kPa].
    checks : int
        N, one in which is the least probability that is known.
    """

    duty: Duty
    failure: tuple[float, float, float]
    reachable: tuple[float, float, float]
    first: float
    last: float
    failed: float
    burst: float
    allowed: float
    checks: int

    def __str__(self) -> str:
        """Return it in words."""
        return said("life", s=self)

    @property
    def facts(self) -> dict[str, float | None]:
        """Numbers by name; None if nothing fails or goes out of reach in time."""
        named = {"time_to_failure": self.failure, "last_reachable": self.reachable}
        return {
            f"{name}_q{round(100 * q):02d}_h": None if np.isinf(value) else value
            for name, values in named.items()
            for q, value in zip(INTERVAL, values, strict=True)
        }


def life_summary(posterior: Posterior, life: Life, duty: Duty) -> LifeSummary:
    """Summarize a life."""
    failure, reachable = (
        (float(v[0]), float(v[1]), float(v[2])) for v in (life.time_to_failure, life.last_reachable)
    )
    return LifeSummary(
        duty=duty,
        failure=failure,
        reachable=reachable,
        first=float(life.hours[0]),
        last=float(life.hours[-1]),
        failed=float(life.failed[:, -1].mean()),
        burst=float(life.burst[:, -1].mean()),
        allowed=float(life.allowed[-1]),
        checks=posterior.checks(),
    )
