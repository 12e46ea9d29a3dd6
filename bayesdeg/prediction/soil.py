"""Degradation rates for predictions: known, or after a time in the soil."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.course import degradation_at
from bayesdeg.priors import Named

Floats = NDArray[np.float64]

ENDS = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Level:
    """A degradation rate.

    Parameters
    ----------
    rates : array, shape (1,) or (k,)
        Known, or that of each of k draws of the posterior [%].
    hours : float, optional
        Time in the soil, where the rates follow from it [h].
    """

    rates: Floats
    hours: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether it is one rate, the same in all draws."""
        return self.hours is None

    @property
    def interval(self) -> Floats:
        """Quantiles `ENDS` over the draws [%], (3,)."""
        quantiles: Floats = np.quantile(self.rates, ENDS)
        return quantiles

    def of_draws(self, count: int) -> float | Floats:
        """Return the rate, or those of the first draws [%].

        Raises
        ------
        ValueError
            If it has fewer draws.
        """
        if self.is_known:
            return float(self.rates[0])
        if count > len(self.rates):
            raise ValueError(f"the course has {len(self.rates)} draws, but {count} are requested")
        return self.rates[:count]

    def column(self, count: int) -> Floats:
        """Return the rate as one level of a grid, (1,), or of each draw, (count, 1) [%]."""
        rates = np.atleast_1d(self.of_draws(count))
        return rates if self.is_known else rates[:, None]

    def __str__(self) -> str:
        """Return the level in words."""
        if self.hours is None:
            return f"degraded by {self.rates[0]:g} %"
        return f"{self.hours:g} h in the soil"


def known_levels(degradation: Iterable[float]) -> tuple[Level, ...]:
    """Return degradation rates that are known [%]."""
    return tuple(Level(np.array([float(rate)])) for rate in degradation)


@dataclass(frozen=True)
class Soil:
    """The course of degradation in the soil, one for each draw of its posterior.

    Parameters
    ----------
    values : mapping
        ``degradation_limit`` [%] and ``degradation_time_constant`` [h] of the mean film,
        ``fresh_moisture`` and ``moisture_scatter`` [%], each (k,).
    """

    values: Named

    def drawn(self, generator: np.random.Generator, count: int) -> "Soil":
        """Return random draws of it."""
        known = next(iter(self.values.values()))
        rows = generator.integers(len(known), size=count)
        return Soil({name: values[rows] for name, values in self.values.items()})

    def rates(self, hours: Floats) -> Floats:
        """Return D_R of the mean film at times (n_times,), (k, n_times) [%]."""
        return degradation_at(self.values, hours)

    @property
    def film_scatter(self) -> Floats:
        """Return the standard deviation of D_R from film to film, (k,) [%].

        The scatter of moisture over the fresh moisture, so it includes weighing errors.

        Examples
        --------
        >>> course = {"fresh_moisture": np.array([20.0]), "moisture_scatter": np.array([0.4])}
        >>> Soil(course).film_scatter
        array([2.])
        """
        scatter: Floats = 100.0 * self.values["moisture_scatter"] / self.values["fresh_moisture"]
        return scatter

    def levels(self, hours: Floats) -> tuple[Level, ...]:
        """Return the degradation rates after times in the soil [h], draw by draw."""
        rates = self.rates(hours)
        return tuple(Level(rates[:, i], float(time)) for i, time in enumerate(hours))
