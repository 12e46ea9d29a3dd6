"""Statistics of actuators: what curves of curvature against pressure can show of a wrong model.

Curvatures and bend angles are looked at together but where they are compared. Sizes in percent are
relative to the prediction; beside every one of them a ratio common to all readings is fitted.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.linear import Linear
from bayesdeg.criticism.model_readings import ACTUATOR, ANGLE, CURVATURE
from bayesdeg.criticism.statistics_of_residuals import (
    Statistic,
    between_specimens,
    functional,
    regression,
)
from bayesdeg.criticism.subject import Places

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

PERCENT = 0.01
TOGETHER = 0.05
"""Share of the trend with time that pressure must leave for time to be a cause of its own."""


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
            shift[own], bend[own] = _shift_and_bend(places.along[own], size[own], largest)
        return cls(linear, rows, size, shift, bend)

    @property
    def places(self) -> Places:
        """Where all readings stand."""
        return self.linear.subject.places

    @cached_property
    def histories(self) -> NDArray[np.str_]:
        """Branch, cycle and mount of each reading, (n, 3); empty where it is no actuator's."""
        split = np.full((len(self.rows), 3), "", dtype=np.array(self.places.history).dtype)
        split[self.rows] = [history.split() for history in self.places.history[self.rows]]
        return split

    def excess(self, share: Floats | Flags) -> Floats:
        """Return the direction in which readings exceed the prediction by these shares [%]."""
        return PERCENT * self.size * share


def actuator_statistics(linear: Linear) -> tuple[Statistic, ...]:
    """Return the statistics of actuators; none where there are none."""
    if not np.any(linear.subject.places.family == ACTUATOR):
        return ()
    bench = Bench.of(linear)
    return (
        _offset(bench),
        _slopes(bench),
        _hysteresis(bench),
        _time(bench),
        _degradation(bench),
        _scatter(bench),
        _angle(bench),
        _cycles(bench),
        *_mounts(bench),
    )


def _offset(bench: Bench) -> Statistic:
    return Statistic(
        "offset at low pressure",
        "kPa",
        "curves start late: as with a pressure offset or the threshold of a valve",
        "curves start early: as with slack paper, or a sensor that reads too little pressure",
        regression(bench.linear, bench.shift, bench.size, bench.bend),
        "the pressures are too few to tell it from a ratio",
    )


def _slopes(bench: Bench) -> Statistic:
    return Statistic(
        "ratio of slopes at high and low pressure, over the simulated",
        "–",
        "curves steepen more with pressure than simulated: as with creep in a slow test, or with "
        "walls softer at large stretch",
        "curves flatten with pressure: as with drying while testing, with a trace along an outer "
        "fibre, or with walls stiffer at large stretch",
        regression(bench.linear, bench.bend, bench.size, bench.shift),
        "the pressures are too few to tell it from a ratio",
        neutral=1.0,
    )


def _hysteresis(bench: Bench) -> Statistic:
    weights = _area(bench)
    unloading = bench.histories[:, 0] == "unloading"
    found = Statistic(
        "hysteresis area between branches",
        "kPa/m",
        "unloading lies above loading more than simulated: as with creep or damage",
        "unloading lies below loading: as with drying or a leak while testing",
        None,
        "needs readings of unloading: column branch of actuator.csv",
    )
    largest = float(bench.places.along[bench.rows].max())
    share = bench.places.along / largest
    lens = np.where(unloading & (bench.places.kind == CURVATURE), share * (1.0 - share), 0.0)
    area = float(weights @ lens)
    if area <= 0.0:
        return found
    return replace(found, projections=functional(bench.linear, weights, lens / area))


def _area(bench: Bench) -> Floats:
    """Return weights that sum residuals to the area of a loop, in the mean over loops, (n,).

    The loop closes from the last reading of unloading to the first of loading; its area is
    −∮ κ dp by the trapezoidal rule.
    """
    places = bench.places
    weights, loops = np.zeros(len(bench.rows)), 0
    keys = np.stack([places.specimen, bench.histories[:, 1], places.kind])
    for key in np.unique(keys[:, bench.rows], axis=1).T:
        own = np.flatnonzero(np.all(keys == key[:, None], axis=0))
        both = len(np.unique(bench.histories[own, 0])) > 1
        if key[2] == CURVATURE and both:
            pressure = places.along[own]
            weights[own] = -0.5 * (np.roll(pressure, -1) - np.roll(pressure, 1))
            loops += 1
    return weights / max(loops, 1)


def _time(bench: Bench) -> Statistic:
    known = bench.rows & np.isfinite(bench.places.time)
    minutes = np.where(known, bench.places.time, 0.0) / 60.0
    direction = bench.excess(minutes)
    found = Statistic(
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


def _degradation(bench: Bench) -> Statistic:
    share = np.where(bench.rows, bench.places.level, 0.0) / 10.0
    return Statistic(
        "trend of the residual with degradation",
        "% per 10 points",
        "degraded actuators bend more than simulated: as with eroded walls, or with degradation "
        "rates read too high",
        "degraded actuators bend less than simulated: as with a stiff degraded skin, or with "
        "degradation rates read too low",
        regression(bench.linear, bench.excess(share), bench.size),
        "needs actuators at several degradation rates",
    )


def _scatter(bench: Bench) -> Statistic:
    return Statistic(
        "variance between specimens, over the model's",
        "–",
        "specimens of one degradation rate differ more than the model allows: as with uneven walls "
        "or misread degradation rates",
        "specimens of one degradation rate differ less than the model allows: its scatter of "
        "stiffness is too large for them",
        between_specimens(bench.linear, bench.size, alike=bench.histories[:, 2]),
        "needs several actuators at one degradation rate",
        neutral=1.0,
        squares=True,
    )


def _angle(bench: Bench) -> Statistic:
    angle = bench.places.kind == ANGLE
    found = Statistic(
        "curvature beyond what the bend angle says",
        "%",
        "the arc is shorter than simulated: as with a part that shrank more",
        "the arc is longer than simulated: as with a trace along an outer fibre, or with a part "
        "that shrank less",
        None,
        "needs the column bend_angle_deg of actuator.csv",
    )
    if not angle.any():
        return found
    share = np.where(angle, -0.5, 0.5)
    return replace(found, projections=regression(bench.linear, bench.excess(share), bench.size))


def _cycles(bench: Bench) -> Statistic:
    later = (bench.histories[:, 1] != "1") & bench.rows
    return Statistic(
        "later cycles against the first",
        "%",
        "later cycles bend further than simulated: as with softening by the first loading",
        "later cycles bend less than simulated: as with drying or a leak while testing",
        regression(bench.linear, bench.excess(later), bench.size) if later.any() else None,
        "needs readings of the first and of later cycles: column cycle of actuator.csv",
    )


def _mounts(bench: Bench) -> list[Statistic]:
    mounts, number = np.unique(bench.histories[bench.rows, 2], return_counts=True)
    first = str(mounts[np.argmax(number)])
    if len(mounts) == 1:
        why = "needs a second mount: column mount of actuator.csv"
        return [Statistic("difference between mounts", "%", "", "", None, why)]
    other = {str(m): bench.histories[:, 2] == m for m in mounts if m != first}
    return [
        Statistic(
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


def _shift_and_bend(pressure: Floats, size: Floats, largest: float) -> tuple[Floats, Floats]:
    """Return −dκ/dp and ∫ κ' g dp at readings of one curve, with g the relative excess of slope.

    g = 3/2 (p/p_max − ½): its middles in the highest and the lowest third differ by 1.
    """
    grid, place = np.unique(np.append(0.0, pressure), return_inverse=True)
    counts = np.bincount(place)
    curve = np.bincount(place, weights=np.append(0.0, size)) / counts
    slope = np.gradient(curve, grid, edge_order=2 if len(grid) > 2 else 1)
    excess = 1.5 * (grid / largest - 0.5)
    steps = 0.5 * (excess[1:] + excess[:-1]) * np.diff(curve)
    bend = np.append(0.0, np.cumsum(steps))
    return -slope[place[1:]], bend[place[1:]]
