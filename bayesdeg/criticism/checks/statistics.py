r"""Statistics of residuals that reveal specific faults of a model.

Curvatures and bend angles are used together unless they are compared. Sizes in percent are relative
to the prediction; a ratio common to all readings is fitted jointly with each of them.

Each statistic is computed in the same way for the data and for data sets simulated from the
posterior, from residuals that allow for a refit of the parameters (`statistics_of`).
With T₀ the median of them all,

.. math:: p = \frac{1 + \#\{|T_k - T_0| \ge |T - T_0|\}}{1 + n}

is two-sided and needs no distribution of T. Among many statistics one will be small by chance: the
adjusted p-values keep the probability of any false one at their level, by stepping down from the
largest as Holm does, but with the simulated dependence of the statistics (Westfall & Young
1993; Ge, Dudoit & Speed 2003, doi:10.1007/BF02595811). So they can be as small as 1/(1 + n),
whatever the number of statistics.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.checks.discrepancy import complete_sets
from bayesdeg.criticism.checks.residuals import (
    ResidualStatistic,
    between_specimens,
    functional,
    histories_of,
    regression,
)
from bayesdeg.criticism.fit.linear import Linear
from bayesdeg.observations.curvature import ACTUATOR, ANGLE, CURVATURE
from bayesdeg.observations.kinds import Places
from bayesdeg.observations.tensile import FILM

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

PERCENT = 0.01
TOGETHER = 0.05
"""Share of the trend with time that must be independent of pressure to be attributed to time."""


@dataclass(frozen=True)
class Bench:
    """Actuators' readings among all readings, arrays of shape (n,).

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    rows : array of bool
        Which readings are of actuators.
    size : array
        Predicted readings; 0 elsewhere.
    shift : array
        Change of the readings where the true pressure is 1 kPa below that read.
    bend : array
        Change of the readings where the slope in the highest third of the pressures is larger by
        its whole size, relative to that in the lowest.
    """

    linear: Linear
    rows: Flags
    size: Floats
    shift: Floats
    bend: Floats

    @classmethod
    def of(cls, linear: Linear) -> Self:
        """Return the actuators' readings of a linearised model."""
        places = linear.subject.places
        rows = places.family == ACTUATOR
        size = np.where(rows, linear.prediction, 0.0)
        shift, bend = np.zeros(len(rows)), np.zeros(len(rows))
        largest = float(places.along[rows].max(initial=0.0))
        keys = np.stack([places.specimen, places.kind, places.history])
        for key in np.unique(keys[:, rows], axis=1).T:
            own = np.flatnonzero(np.all(keys == key[:, None], axis=0))
            grid, place = np.unique(np.append(0.0, places.along[own]), return_inverse=True)
            counts = np.bincount(place)
            curve = np.bincount(place, weights=np.append(0.0, size[own])) / counts
            slope = np.gradient(curve, grid, edge_order=2 if len(grid) > 2 else 1)
            # ∫ κ' g dp with g = 3/2 (p/p_max − ½), the relative excess of slope: its middles in the
            # highest and the lowest third differ by 1
            excess = 1.5 * (grid / largest - 0.5)
            steps = 0.5 * (excess[1:] + excess[:-1]) * np.diff(curve)
            shift[own] = -slope[place[1:]]
            bend[own] = np.append(0.0, np.cumsum(steps))[place[1:]]
        return cls(linear, rows, size, shift, bend)

    @property
    def places(self) -> Places:
        """Return the places of all readings."""
        return self.linear.subject.places

    @cached_property
    def histories(self) -> NDArray[np.str_]:
        """Branch, cycle and mount of each reading, (n, 3); empty for other readings."""
        return histories_of(self.places, self.rows)

    def excess(self, share: Floats | Flags) -> Floats:
        """Return the direction in which readings exceed the prediction by these shares [%]."""
        return PERCENT * self.size * share


def actuator_statistics(linear: Linear) -> tuple[ResidualStatistic, ...]:
    """Return the statistics of actuators; empty without actuators."""
    if not np.any(linear.subject.places.family == ACTUATOR):
        return ()
    bench = Bench.of(linear)
    degraded = np.where(bench.rows, bench.places.level, 0.0) / 10.0
    one_rate, misread, at_one_rate = _of_one_rate(linear)
    angle = bench.places.kind == ANGLE
    later = (bench.histories[:, 1] != "1") & bench.rows
    offset = ResidualStatistic(
        "offset at low pressure",
        "kPa",
        "curves start late: as with a pressure offset or the threshold of a valve",
        "curves start early: as with slack paper, or a sensor that reads too little pressure",
        regression(linear, bench.shift, bench.size, bench.bend),
        "the pressures are too few to tell it from a ratio",
    )
    slopes = ResidualStatistic(
        "ratio of slopes at high and low pressure, over the simulated",
        "–",
        "curves steepen more with pressure than simulated: as with creep in a slow test, or with "
        "walls softer at large stretch",
        "curves flatten with pressure: as with drying while testing, with a trace along an outer "
        "fibre, or with walls stiffer at large stretch",
        regression(linear, bench.bend, bench.size, bench.shift),
        "the pressures are too few to tell it from a ratio",
        neutral=1.0,
    )
    degradation = []
    if linear.subject.world.degrades:
        trend = ResidualStatistic(
            "trend of the residual with degradation",
            "% per 10 points",
            "degraded actuators bend more than simulated: as with eroded walls, or with "
            "degradation rates read too high",
            "degraded actuators bend less than simulated: as with a stiff degraded skin, or with "
            "degradation rates read too low",
            regression(linear, bench.excess(degraded), bench.size),
            "needs actuators at several degradation rates",
        )
        degradation = [trend]
    scatter = ResidualStatistic(
        "variance between specimens, over the model's",
        "–",
        f"specimens{one_rate} differ more than the model allows: as with uneven walls{misread}",
        f"specimens{one_rate} differ less than the model allows: its scatter of stiffness is too "
        "large for them",
        between_specimens(linear, bench.size, alike=bench.histories[:, 2]),
        f"needs several actuators{at_one_rate}",
        neutral=1.0,
        squares=True,
    )
    against_angle = ResidualStatistic(
        "curvature beyond what the bend angle says",
        "%",
        "the arc is shorter than simulated: as with a part that shrank more",
        "the arc is longer than simulated: as with a trace along an outer fibre, or with a part "
        "that shrank less",
        regression(linear, bench.excess(np.where(angle, -0.5, 0.5)), bench.size)
        if angle.any()
        else None,
        "needs the column bend_angle_deg of actuator.csv",
    )
    cycles = ResidualStatistic(
        "later cycles against the first",
        "%",
        "later cycles bend further than simulated: as with softening by the first loading",
        "later cycles bend less than simulated: as with drying or a leak while testing",
        regression(linear, bench.excess(later), bench.size) if later.any() else None,
        "needs readings of the first and of later cycles: column cycle of actuator.csv",
    )
    return (
        offset,
        slopes,
        _hysteresis(bench),
        _time(bench),
        *degradation,
        scatter,
        against_angle,
        cycles,
        *_mounts(bench),
    )


def _hysteresis(bench: Bench) -> ResidualStatistic:
    # weights that sum residuals to the area of a loop, in the mean over loops: each closes from the
    # last reading of unloading to the first of loading; its area is −∮ κ dp (trapezoidal rule)
    places, unloading = bench.places, bench.histories[:, 0] == "unloading"
    weights, loops = np.zeros(len(bench.rows)), 0
    keys = np.stack([places.specimen, bench.histories[:, 1], places.kind])
    for key in np.unique(keys[:, bench.rows], axis=1).T:
        own = np.flatnonzero(np.all(keys == key[:, None], axis=0))
        both = len(np.unique(bench.histories[own, 0])) > 1
        if key[2] == CURVATURE and both:
            pressure = places.along[own]
            weights[own] = -0.5 * (np.roll(pressure, -1) - np.roll(pressure, 1))
            loops += 1
    weights /= max(loops, 1)
    share = places.along / float(places.along[bench.rows].max())
    lens = np.where(unloading & (places.kind == CURVATURE), share * (1.0 - share), 0.0)
    area = float(weights @ lens)
    return ResidualStatistic(
        "hysteresis area between branches",
        "kPa/m",
        "unloading lies above loading more than simulated: as with creep, damage or friction",
        "unloading lies below loading: as with drying or a leak while testing",
        functional(bench.linear, weights, lens / area) if area > 0.0 else None,
        "needs readings of unloading: column branch of actuator.csv",
    )


def _time(bench: Bench) -> ResidualStatistic:
    known = bench.rows & np.isfinite(bench.places.time)
    minutes = np.where(known, bench.places.time, 0.0) / 60.0
    direction = bench.excess(minutes)
    found = ResidualStatistic(
        "trend of the residual with time",
        "%/min",
        "curvature grows with time at the same pressure: as with creep",
        "curvature falls with time at the same pressure: as with drying or a growing leak",
        None,
        "needs the column time_s of actuator.csv",
    )
    if not known.any():
        return found
    projection = regression(bench.linear, direction, bench.size, bench.size * known)
    if projection is None:
        return replace(found, why="all readings were taken at the same time")
    beside = regression(
        bench.linear, direction, bench.size, bench.size * known, bench.shift, bench.bend
    )
    if beside is None or np.sum(projection**2) < TOGETHER * np.sum(beside**2):
        also = "; time and pressure rise together in these tests, so it may be one or the other"
        found = replace(found, more=found.more + also, less=found.less + also)
    return replace(found, projections=projection)


def _of_one_rate(linear: Linear) -> tuple[str, str, str]:
    """Return the words for specimens of one rate: empty if nothing degrades."""
    if not linear.subject.world.degrades:
        return "", "", ""
    rate = "one degradation rate"
    return f" of {rate}", " or misread degradation rates", f" at {rate}"


def _mounts(bench: Bench) -> list[ResidualStatistic]:
    mounts, number = np.unique(bench.histories[bench.rows, 2], return_counts=True)
    first = str(mounts[np.argmax(number)])
    if len(mounts) == 1:
        why = "needs a second mount: column mount of actuator.csv"
        return [ResidualStatistic("difference between mounts", "%", "", "", None, why)]
    other = {str(m): bench.histories[:, 2] == m for m in mounts if m != first}
    return [
        ResidualStatistic(
            f"mount {name} against {first}".replace("_", " "),
            "%",
            f"actuators bend further {name} than {first}, more than simulated: as by their weight",
            f"actuators bend less {name} than {first}, more than simulated: as by their weight",
            regression(
                bench.linear,
                bench.excess(rows),
                bench.size,
                *(bench.excess(others) for rest, others in other.items() if rest != name),
            ),
            "the mounts differ as the specimens do",
        )
        for name, rows in other.items()
    ]


def film_statistics(linear: Linear) -> tuple[ResidualStatistic, ...]:
    """Return the statistics of films in tension; empty without films."""
    places = linear.subject.places
    rows = places.family == FILM
    if not rows.any():
        return ()
    size = np.where(rows, linear.prediction, 0.0)
    stretch = np.where(rows, places.along - 1.0, 0.0)
    one_rate, misread, at_one_rate = _of_one_rate(linear)
    also = misread.replace(" misread", "")
    trend = ResidualStatistic(
        "trend of the films' residual with stretch",
        "% per unit of stretch",
        "stresses rise faster with stretch than simulated: as with Cauchy stress recorded as "
        "nominal, or with a law that stiffens too late",
        "stresses rise slower with stretch than simulated: as with nominal stress recorded as "
        "Cauchy, or with damage while stretching",
        regression(linear, PERCENT * size * stretch, size),
        "needs films at several stretches",
    )
    scatter = ResidualStatistic(
        "variance between films, over the model's",
        "–",
        f"films{one_rate} differ more than the model allows: as with misread thickness{also}",
        f"films{one_rate} differ less than the model allows: its scatter of stiffness is too large "
        "for them",
        between_specimens(linear, size, alike=places.history),
        f"needs several films{at_one_rate}",
        neutral=1.0,
        squares=True,
    )
    return (*_modes(linear, size), trend, scatter)


def other_statistics(linear: Linear) -> tuple[ResidualStatistic, ...]:
    """Return statistics of readings on neither actuators nor films."""
    places = linear.subject.places
    found: list[ResidualStatistic] = []
    for family in dict.fromkeys(places.family.tolist()):
        if family in (ACTUATOR, FILM):
            continue
        size = np.where(places.family == family, linear.prediction, 0.0)
        for along, values in (
            ("the path", places.along),
            ("the level", places.level),
            ("time", places.time),
        ):
            rows = (size != 0.0) & np.isfinite(values)
            extent = float(np.ptp(values[rows])) if rows.any() else 0.0
            projection = None
            if extent > 0.0:
                share = np.where(rows, values - np.min(values[rows]), 0.0) / extent
                projection = regression(linear, PERCENT * size * share, size, size * rows)
            found.append(
                ResidualStatistic(
                    f"trend of the residual with {along} ({family})",
                    "% over all",
                    f"readings exceed the prediction more and more with {along}",
                    f"readings fall short of the prediction more and more with {along}",
                    projection,
                    f"needs readings at several values of {along}",
                )
            )
        found.append(
            ResidualStatistic(
                f"variance between specimens, over the model's ({family})",
                "–",
                "specimens of one level differ more than the model allows",
                "specimens of one level differ less than the model allows",
                between_specimens(linear, size, alike=places.family),
                "needs several specimens at one level",
                neutral=1.0,
                squares=True,
            )
        )
    return tuple(found)


def _modes(linear: Linear, size: Floats) -> list[ResidualStatistic]:
    """Return the mean excess of stress in each mode of tension over the first."""
    places = linear.subject.places
    modes = list(dict.fromkeys(places.history[size != 0.0].tolist()))
    if len(modes) == 1:
        why = "needs a second mode of tension: column mode of tensile.csv"
        return [ResidualStatistic("difference between modes of tension", "MPa", "", "", None, why)]
    first = "uniaxial" if "uniaxial" in modes else modes[0]
    rest = [mode for mode in modes if mode != first]
    scaled = {}  # each of mean 1 over its own readings
    for mode in rest:
        own = places.history == mode
        mean = np.mean(np.abs(size[own & (size != 0.0)]))
        scaled[mode] = np.where(own, size, 0.0) / mean
    return [
        ResidualStatistic(
            f"{mode} against {first} tension",
            "MPa",
            f"stress in {mode} tension is higher than {first} curves lead to expect: as with "
            "a law that depends on the second invariant",
            f"stress in {mode} tension is lower than {first} curves lead to expect: as with "
            "a law that depends on the second invariant",
            regression(
                linear, scaled[mode], size, *(scaled[other] for other in rest if other != mode)
            ),
            "the modes differ as the films do",
        )
        for mode in rest
    ]


FEWEST = 19
"""Fewest simulated data sets with which a p-value can reach 0.05."""
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
    replicates : int
        Simulated data sets behind the p-values.
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
    replicates: int = 0

    @property
    def finding(self) -> str:
        """The interpretation if it is significant among all statistics; else that it is not."""
        if self.unavailable:
            return f"not available: {self.unavailable}"
        return self.reading if self.p_adjusted <= SIGNIFICANT else UNREMARKABLE


def statistics_table(linear: Linear, simulated: Floats, drawn: int = 0) -> tuple[Physical, ...]:
    """Compute every statistic and calibrate it, in the order of the catalogue.

    With fewer than 19 finite data sets no p-value could reach 0.05. All statistics are then
    unavailable, with the reason.

    Readings (k, n) simulated from the fitted model are nan where it had no answer; `drawn` is how
    many were simulated, where those were left out already.
    """
    known = complete_sets(simulated)
    every = statistics_of(linear)
    if len(known) < FEWEST:
        why = f"{len(known)} of {drawn or len(simulated)} simulated data sets are too few"
        return tuple(_missing(s, s.why if s.projections is None else why) for s in every)
    there = [s for s in every if s.projections is not None]
    null = linear.whiten(known)
    replicated = np.stack([s.of(null) for s in there]) if there else np.empty((0, len(known)))
    value = np.array([float(s.of(linear.observed)) for s in there])
    # The first column is of the data. It is included in the median and the spread, so data from
    # the model are exchangeable with simulated ones and p-values are exact. Mean squares are
    # compared by their cube roots, which are nearly normal (Wilson & Hilferty 1931).
    values = np.column_stack([value, replicated])
    squares = np.array([s.squares for s in there], dtype=bool)
    scaled = values.copy()
    scaled[squares] = np.cbrt(values[squares])
    middle = np.median(scaled, axis=1, keepdims=True)
    low, high = np.quantile(scaled, [0.05, 0.95], axis=1)
    far: Floats = np.abs(scaled - middle) / (high - low)[:, None]
    p_value = chance_of(far[:, 0], far[:, 1:])
    adjusted = adjusted_p_values(far[:, 0], far[:, 1:])
    calibrated = iter(zip(value, replicated, p_value, adjusted, strict=True))
    table = []
    for one in every:
        if one.projections is None:
            table.append(_missing(one, one.why))
            continue
        own, drawn_values, p_own, p_adjusted = next(calibrated)
        q05, q50, q95 = (float(q) for q in np.quantile(drawn_values, [0.05, 0.5, 0.95]))
        table.append(
            Physical(
                one.name,
                one.unit,
                float(own),
                q05,
                q95,
                float(p_own),
                float(p_adjusted),
                one.more if own >= q50 else one.less,
                replicates=len(drawn_values),
            )
        )
    return tuple(table)


def statistics_of(linear: Linear) -> tuple[ResidualStatistic, ...]:
    """Return every statistic of the readings of a linearised model."""
    return (*actuator_statistics(linear), *film_statistics(linear), *other_statistics(linear))


def frame(table: tuple[Physical, ...]) -> pd.DataFrame:
    """Return the statistics as a table, the most remarkable first, unavailable ones last.

    Columns: ``statistic``, ``value``, ``unit``, ``simulated_q05``, ``simulated_q95``, ``p_value``,
    ``p_adjusted``, ``reading``, ``replicates``. The reading interprets the sign if the adjusted
    p-value is at most 0.05; else it says that the value is unremarkable, or what is missing.

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
            "replicates": [one.replicates for one in table],
        }
    )
    return rows.sort_values(["p_adjusted", "p_value"], na_position="last").reset_index(drop=True)


def adjusted_p_values(observed: Floats, simulated: Floats) -> Floats:
    """Return p-values adjusted for all statistics, by stepping down, (m,).

    From distances from what is expected, in the same measure for every statistic, (m,), and those
    of simulated data, (m, k).

    Examples
    --------
    >>> null = np.arange(99.0)  # the second statistic is a copy of the first
    >>> adjusted_p_values(np.array([98.0, 97.0]), np.stack([null, null])).tolist()
    [0.02, 0.03]
    """
    order = np.argsort(-observed)
    if len(order) == 0:
        return np.empty(0)
    # for each rank, the largest distance among the statistics that are not more remarkable
    largest = np.maximum.accumulate(simulated[order][::-1], axis=0)[::-1]
    stepped = np.maximum.accumulate(chance_of(observed[order], largest))
    adjusted = np.empty(len(order))
    adjusted[order] = stepped
    return adjusted


def _missing(statistic: ResidualStatistic, why: str) -> Physical:
    nan = float("nan")
    return Physical(statistic.name, statistic.unit, nan, nan, nan, nan, nan, "", unavailable=why)
