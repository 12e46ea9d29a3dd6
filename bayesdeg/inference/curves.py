"""Readings of a study as padded arrays: specimens by observations."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Conditions, FilmConditions
from bayesdeg.inference.paths import Paths, paths_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class TensileCurves:
    """Stress–stretch curves.

    Parameters
    ----------
    specimens : tuple of str
        One a curve.
    modes : tuple of str
        Mode of loading of each curve.
    degradation, degradation_sd : array, shape (n_specimens,)
        D_R of the film and its standard error [%].
    basis : array, shape (n_specimens, n_points, 3)
        Yeoh's design matrix for the stress measure that was recorded.
    stretch, stress : array, shape (n_specimens, n_points)
        [–], [MPa].
    cauchy : array of bool, shape (n_specimens, n_points)
        Whether the stress recorded is Cauchy's.
    mask : array of bool, shape (n_specimens, n_points)
        Where there is an observation.
    """

    specimens: tuple[str, ...]
    modes: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    basis: Floats
    stretch: Floats
    stress: Floats
    cauchy: Flags
    mask: Flags

    @cached_property
    def conditions(self) -> FilmConditions:
        """What the tests set."""
        return FilmConditions(self.stretch, np.array(self.modes), self.cauchy, self.degradation)

    @cached_property
    def paths(self) -> Paths:
        """The readings of each film as a path of stretch."""
        travelled = np.abs(np.diff(self.stretch, axis=1, prepend=1.0))
        return paths_of(self.mask[:, None, :], np.cumsum(travelled, axis=1))

    def subset(self, rows: Rows) -> "TensileCurves":
        """Return the curves of some specimens."""
        return _chosen(self, rows)


class Ruptures(NamedTuple):
    """Between which readings actuators burst, or which they survived, (n_specimens,).

    Parameters
    ----------
    survived : array of int
        The row of the largest pressure that was survived, below that of the rupture; −1 if none.
    burst : array of int
        The row at whose pressure the specimen burst; −1 if it did not.
    """

    survived: NDArray[np.int64]
    burst: NDArray[np.int64]


@dataclass(frozen=True)
class ActuatorCurves:
    """Curvature–pressure curves, with the bend angle where it was read too.

    Parameters
    ----------
    specimens : tuple of str
        One a curve.
    degradation, degradation_sd : array, shape (n_specimens, 1)
        D_R as measured and its standard error [%].
    pressure, curvature : array, shape (n_specimens, n_points)
        As read [kPa], [1/m].
    curvature_sd : array, shape (n_specimens, n_points)
        Reading error that was recorded; 0 where there is none [1/m].
    mask : array of bool, shape (n_specimens, n_points)
        Where there is an observation; a reading at zero pressure is zero by definition and none.
    bend_angle : array, shape (n_specimens, n_points)
        As read [°].
    angle_mask : array of bool, shape (n_specimens, n_points)
        Where there is a bend angle; one without a curvature beside it is not used.
    recorded, ruptured : array of bool, shape (n_specimens, n_points)
        Rows that are there, and those at whose pressure the specimen burst.
    cycle : array of int, branch : array of str, shape (n_specimens, n_points)
        Loading cycle and branch.
    time, humidity : array, shape (n_specimens, n_points)
        Since the specimen's first row [s], of the room [%]; nan where not recorded.
    mount : array of str, shape (n_specimens, n_points)
        How it was held.
    """

    specimens: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    curvature: Floats
    curvature_sd: Floats
    mask: Flags
    bend_angle: Floats
    angle_mask: Flags
    recorded: Flags
    ruptured: Flags
    cycle: NDArray[np.int64]
    branch: NDArray[np.str_]
    time: Floats
    humidity: Floats
    mount: NDArray[np.str_]

    @cached_property
    def conditions(self) -> Conditions:
        """What the experiment set or recorded."""
        return Conditions(
            self.pressure,
            self.degradation,
            time=self.time,
            cycle=self.cycle,
            unloading=self.branch == "unloading",
            humidity=self.humidity,
            mount=self.mount,
        )

    @cached_property
    def with_angle(self) -> bool:
        """Whether there is a bend angle at all."""
        return bool(self.angle_mask.any())

    @cached_property
    def readings(self) -> Floats:
        """Curvatures [1/m], then bend angles [°] if there are any, (n_specimens, n_readings)."""
        both = (self.curvature, self.bend_angle) if self.with_angle else (self.curvature,)
        return np.concatenate(both, axis=1)

    @cached_property
    def paths(self) -> Paths:
        """The readings of each specimen as a path of pressure."""
        both = (self.mask, self.mask & self.angle_mask) if self.with_angle else (self.mask,)
        travelled = np.abs(np.diff(self.pressure, axis=1, prepend=0.0))
        return paths_of(np.stack(both, axis=1), np.cumsum(travelled, axis=1))

    @cached_property
    def ruptures(self) -> Ruptures:
        """Between which readings each specimen burst, or which it survived."""
        any_burst = self.ruptured.any(axis=1)
        burst = np.where(any_burst, np.argmax(self.ruptured, axis=1), -1)
        at_burst = np.where(any_burst, self.pressure[np.arange(len(burst)), burst], np.inf)
        below = self.recorded & ~self.ruptured & (self.pressure < at_burst[:, None])
        below &= self.pressure > 0.0
        highest = np.argmax(np.where(below, self.pressure, -1.0), axis=1)
        return Ruptures(np.where(below.any(axis=1), highest, -1), burst)

    def subset(self, rows: Rows) -> "ActuatorCurves":
        """Return the curves of some specimens."""
        return _chosen(self, rows)

    def with_readings(self, readings: Floats) -> Self:
        """Return the same tests with other readings, (n_specimens, n_readings)."""
        points = self.pressure.shape[1]
        curvature = np.where(self.mask, readings[:, :points], 0.0)
        if not self.with_angle:
            return replace(self, curvature=curvature)
        angle = np.where(self.angle_mask & self.mask, readings[:, points:], 0.0)
        return replace(self, curvature=curvature, bend_angle=angle)


@dataclass(frozen=True)
class Breaks:
    """Elongations at break.

    Parameters
    ----------
    specimens : tuple of str
        One a specimen.
    degradation, degradation_sd : array, shape (n,)
        D_R of the film and its standard error [%].
    elongation : array, shape (n,)
        [%].
    """

    specimens: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    elongation: Floats

    def subset(self, rows: Rows) -> "Breaks":
        """Return some of the specimens."""
        return _chosen(self, rows)


def _chosen[T: (TensileCurves, ActuatorCurves, Breaks)](data: T, rows: Rows) -> T:
    """Return some specimens, of whatever is held for each."""
    chosen: dict[str, Any] = {}
    for field in fields(data):
        value = getattr(data, field.name)
        is_tuple = isinstance(value, tuple)
        chosen[field.name] = tuple(value[i] for i in rows) if is_tuple else value[rows]
    return replace(data, **chosen)
