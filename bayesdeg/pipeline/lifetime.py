"""The life of an actuator in the soil from a calibrated model: table and summary."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.observations.specimens import has_elongation
from bayesdeg.pipeline.experience import Experience
from bayesdeg.pipeline.forecast import (
    COURSE_STREAM,
    TIME,
    basis,
    cautions,
    ceiling_of,
    small_risk,
)
from bayesdeg.pipeline.posterior import Posterior, Range
from bayesdeg.pipeline.progress import Progress
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.control import INTERVAL
from bayesdeg.prediction.lifetime import DRAWS, STRATA, Duty, Life, live, specimens_in_soil
from bayesdeg.prediction.predictive import draw_specimens, not_below
from bayesdeg.prediction.soil import Level, Soil
from bayesdeg.report import tables as columns
from bayesdeg.report.wording import SPACE, sentences

Floats = NDArray[np.float64]

TIMES = 25  # number of default times
WITHOUT_FILMS = 24.0  # h, default duration if no film limits it
INTERVAL_OF_DRAWS = (0.05, 0.95)


def default_hours(measured: Mapping[str, Range]) -> Floats:
    """Return times from the beginning to the last at which films were taken out of the soil [h]."""
    last = measured.get(TIME, (0.0, WITHOUT_FILMS))[1]
    return np.linspace(0.0, float(last) or WITHOUT_FILMS, TIMES)


def lifetime_of(
    stored: Posterior,
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
    stored : Posterior
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
        In which they are used.
    experience : Experience, optional
        Above which no pressure is allowed; by default the risk alone bounds it.
    draws : int
        Of the posterior.
    """
    first, second = (np.random.default_rng(one) for one in seed.spawn(COURSE_STREAM + 2)[-2:])
    specimens = draw_specimens(
        *(stored.model, stored.chain, first), draws=draws, strata=STRATA, conditions=conditions
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


def life_table(stored: Posterior, life: Life, duty: Duty) -> pd.DataFrame:
    """Return a life as a table, ``lifetime.csv``; what is not finite is empty.

    No probability of rupture or failure is below one in the number of specimens that the model was
    checked on.
    """
    checks = stored.checks()
    burst, failed = (_with_interval(life, each, checks) for each in (life.burst, life.failed))
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


def _with_interval(life: Life, each: Floats, checks: int) -> list[Floats]:
    """Return the mean of a specimen's probability, and its quantiles over the posterior."""
    low, high = np.quantile(life.by_draw(each), INTERVAL_OF_DRAWS, axis=0)
    return [not_below(one, checks) for one in (each.mean(axis=0), low, high)]


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
        The times that were looked at [h].
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
        return sentences("answers", "life", s=self).replace(SPACE, " ")

    @property
    def facts(self) -> dict[str, float | None]:
        """Numbers by name; None if nothing fails or goes out of reach in time."""
        named = {"time_to_failure": self.failure, "last_reachable": self.reachable}
        return {
            f"{name}_q{round(100 * q):02d}_h": None if np.isinf(value) else value
            for name, values in named.items()
            for q, value in zip(INTERVAL, values, strict=True)
        }


def life_summary(stored: Posterior, life: Life, duty: Duty) -> LifeSummary:
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
        checks=stored.checks(),
    )


def lifetime_cautions(
    stored: Posterior,
    soil: Soil,
    life: Life,
    duty: Duty,
    conditions: ServiceConditions,
    *,
    beyond: bool,
) -> tuple[str, ...]:
    """Return warnings for a life in the soil, from its first and last time."""
    levels, strong = soil.levels(life.hours[[0, -1]]), has_elongation(stored.model.base)
    allowed = allowed_at_ends(life, levels)
    return (
        *cautions(stored, levels, np.array([duty.pressure]), conditions),
        *basis(stored.experience, allowed, beyond=beyond, strong=strong),
        *small_risk(stored, duty.risk),
    )


def allowed_at_ends(life: Life, levels: Sequence[Level]) -> dict[float, float]:
    """Return the allowed pressure [kPa] at the degradation rates of first and last time [%]."""
    ends = zip(levels, life.allowed[[0, -1]], strict=True)
    return {float(rate): float(pressure) for level, pressure in ends for rate in level.interval}
