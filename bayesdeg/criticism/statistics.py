r"""Statistics with a physical reading, calibrated by data simulated from the fitted model.

Each statistic is computed alike of the data and of data sets simulated from the posterior, from
residuals that know what a refit of the parameters would take up (`statistics_of_residuals`).
With T₀ the median of them all,

.. math:: p = \frac{1 + \#\{|T_k - T_0| \ge |T - T_0|\}}{1 + n}

is two-sided and needs no law of T. Where many are looked at one will be small by chance: the
adjusted p-values keep the chance of any false one at their level, by stepping down from the
largest as Holm does, but with the dependence of the statistics as simulated (Westfall & Young
1993; Ge, Dudoit & Speed 2003, doi:10.1007/BF02595811). So they can be as small as 1/(1 + n), and
not only as the number of statistics over that.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.discrepancy import too_few
from bayesdeg.criticism.linear import Linear
from bayesdeg.criticism.statistics_of_actuators import actuator_statistics
from bayesdeg.criticism.statistics_of_films import film_statistics, other_statistics
from bayesdeg.criticism.statistics_of_residuals import Statistic

Floats = NDArray[np.float64]

FEWEST = 19
"""Simulated data sets below which no p-value could reach 0.05."""
SIGNIFICANT = 0.05
UNREMARKABLE = "as the model itself would show"


@dataclass(frozen=True)
class Physical:
    """One statistic of a study.

    Parameters
    ----------
    name, unit : str
        What it is, as in the report.
    value : float
        Of the data; nan where it is not available.
    low, high : float
        5 and 95 % of it in simulated data.
    p_value : float
        Share of simulated data at least as far from their median, (1 + #)/(1 + n).
    p_adjusted : float
        The same for the most remarkable of all statistics looked at.
    reading : str
        What a value on this side of the simulated ones means, were it significant.
    unavailable : str
        What the study lacks for it, or why it could not be calibrated; empty where it could.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    p_value: float
    p_adjusted: float
    reading: str
    unavailable: str = ""

    @property
    def finding(self) -> str:
        """The reading where it is significant among all statistics; else that it is not."""
        if self.unavailable:
            return f"not available: {self.unavailable}"
        return self.reading if self.p_adjusted <= SIGNIFICANT else UNREMARKABLE


def statistics_table(
    linear: Linear, simulated: Floats, drawn: int | None = None
) -> tuple[Physical, ...]:
    """Compute every statistic and calibrate it, in the order of the catalogue.

    Fewer than 19 finite data sets calibrate nothing: no p-value could reach 0.05. All statistics
    are unavailable then, and say why.

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    simulated : array, shape (k, n)
        Readings of data sets simulated from the fitted model; nan where it had no answer.
    drawn : int, optional
        How many were simulated, where those without an answer were left out already.
    """
    known = simulated[np.all(np.isfinite(simulated), axis=1)]
    every = statistics_of(linear)
    if len(known) < FEWEST:
        why = too_few(len(known), len(simulated) if drawn is None else drawn)
        return tuple(_missing(s, s.why if s.projections is None else why) for s in every)
    there = [s for s in every if s.projections is not None]
    null = linear.whiten(known)
    replicated = np.stack([s.of(null) for s in there]) if there else np.empty((0, len(known)))
    value = np.array([float(s.of(linear.observed)) for s in there])
    far = _distance(
        np.column_stack([value, replicated]), np.array([s.squares for s in there], dtype=bool)
    )
    p_value = (1.0 + np.sum(far[:, 1:] >= far[:, :1], axis=1)) / (1.0 + len(known))
    adjusted = adjusted_p_values(far[:, 0], far[:, 1:])
    calibrated = iter(zip(value, replicated, p_value, adjusted, strict=True))
    return tuple(
        _missing(s, s.why) if s.projections is None else _physical(s, *next(calibrated))
        for s in every
    )


def statistics_of(linear: Linear) -> tuple[Statistic, ...]:
    """Return every statistic of the readings of a linearised model."""
    return (*actuator_statistics(linear), *film_statistics(linear), *other_statistics(linear))


def frame(table: tuple[Physical, ...]) -> pd.DataFrame:
    """Return the statistics as a table, the most remarkable first, those not available last.

    Columns: ``statistic``, ``value``, ``unit``, ``simulated_q05``, ``simulated_q95``, ``p_value``,
    ``p_adjusted``, ``reading``. The reading is that of the sign where the adjusted p-value is at
    most 0.05; else it says that the value is unremarkable, or what it would need.

    Examples
    --------
    >>> late = Physical("offset", "kPa", 9.0, -1.0, 1.0, 0.002, 0.01, "curves start late")
    >>> frame((late,))[["statistic", "unit", "reading"]].iloc[0].tolist()
    ['offset', 'kPa', 'curves start late']
    """
    rows = pd.DataFrame(
        {
            "statistic": [one.name for one in table],
            "value": [one.value for one in table],
            "unit": [one.unit for one in table],
            "simulated_q05": [one.low for one in table],
            "simulated_q95": [one.high for one in table],
            "p_value": [one.p_value for one in table],
            "p_adjusted": [one.p_adjusted for one in table],
            "reading": [one.finding for one in table],
        }
    )
    return rows.sort_values(["p_adjusted", "p_value"], na_position="last").reset_index(drop=True)


def adjusted_p_values(observed: Floats, simulated: Floats) -> Floats:
    """Return p-values that hold for all statistics together, by stepping down, (m,).

    Parameters
    ----------
    observed : array, shape (m,)
        Distances from what is expected, in the same measure for every statistic.
    simulated : array, shape (m, k)
        The same of simulated data.

    Examples
    --------
    >>> null = np.arange(99.0)  # the second statistic is a copy of the first
    >>> adjusted_p_values(np.array([98.0, 97.0]), np.stack([null, null])).tolist()
    [0.02, 0.03]
    """
    order = np.argsort(-observed)
    if len(order) == 0:
        return np.empty(0)
    # of each rank: the largest distance among the statistics that are not more remarkable
    largest = np.maximum.accumulate(simulated[order][::-1], axis=0)[::-1]
    count = np.sum(largest >= observed[order][:, None], axis=1)
    stepped = np.maximum.accumulate((1.0 + count) / (1.0 + simulated.shape[1]))
    adjusted = np.empty(len(order))
    adjusted[order] = stepped
    return adjusted


def _distance(values: Floats, squares: NDArray[np.bool_]) -> Floats:
    """Return distances from the median over the spread, (m, 1 + k).

    The first column is of the data. It counts among the others for the median and the spread: so
    data from the model are exchangeable with simulated ones, and p-values are exact. Mean squares
    are compared by their cube roots, which are nearly normal (Wilson & Hilferty 1931).
    """
    scaled = values.copy()
    scaled[squares] = np.cbrt(values[squares])
    middle = np.median(scaled, axis=1, keepdims=True)
    low, high = np.quantile(scaled, [0.05, 0.95], axis=1)
    distance: Floats = np.abs(scaled - middle) / (high - low)[:, None]
    return distance


def _physical(
    statistic: Statistic, value: float, drawn: Floats, p_value: float, p_adjusted: float
) -> Physical:
    low, middle, high = (float(q) for q in np.quantile(drawn, [0.05, 0.5, 0.95]))
    return Physical(
        statistic.name,
        statistic.unit,
        float(value),
        low,
        high,
        float(p_value),
        float(p_adjusted),
        statistic.more if value >= middle else statistic.less,
    )


def _missing(statistic: Statistic, why: str) -> Physical:
    nan = float("nan")
    return Physical(statistic.name, statistic.unit, nan, nan, nan, nan, nan, "", unavailable=why)
