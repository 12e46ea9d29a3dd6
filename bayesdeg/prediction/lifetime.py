r"""Service life of an actuator in the soil: curvature, rupture and pressure against time.

The degradation rate D(t) of the mean film follows from the moisture of films, draw by draw. That
of a specimen deviates from it in proportion,

.. math:: D_i(t) = D(t) (1 + z_i s / D_\infty), \qquad z_i \sim N(0, 1),

with s the scatter of films, so that specimens scatter by s where the course levels off, and not at
all while fresh. Each has its own stiffness and elongation limit, with a quantile that is constant
in time: it has burst by t if its strain exceeded its limit at any time up to t. So the probability
that it has burst is the largest so far.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.prediction.control import INTERVAL, largest_allowed, needed_by
from bayesdeg.prediction.predictive import Specimens, respond_each
from bayesdeg.prediction.soil import Level, Soil

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

DRAWS, STRATA = 250, 12


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
    share = drawn.film_scatter / drawn.values["degradation_limit"]
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
