"""The tables of a study as padded arrays: specimens by observations."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.causes.cause import Conditions, FilmConditions
from bayesdeg.data.shrinkage import mean_of_replicates, volume_ratio
from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.material.hyperelastic import yeoh_basis

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Paths(NamedTuple):
    """Which readings follow one another, n_readings = n_outputs × n_points a specimen.

    Parameters
    ----------
    mask : array of bool, shape (n_specimens, n_readings)
        Where there is a reading; one of the second output needs one of the first beside it.
    gap : array, shape (n_specimens, n_readings)
        Length of path since the reading before it of the same output; infinite for the first.
    place : array, shape (n_specimens, n_readings)
        Length of path up to it.
    points : int
        Readings of the first output; those of the second follow them.
    """

    mask: Flags
    gap: Floats
    place: Floats
    points: int


def paths_of(mask: Flags, place: Floats) -> Paths:
    """Return the paths of readings at places along them.

    Parameters
    ----------
    mask : array of bool, shape (n_specimens, n_outputs, n_points)
        Where there is a reading.
    place : array, shape (n_specimens, n_points)
        Length of path up to each reading, not falling.

    Examples
    --------
    >>> paths = paths_of(np.array([[[True, False, True]]]), np.array([[20.0, 40.0, 60.0]]))
    >>> paths.gap[0, [0, 2]]
    array([inf, 40.])
    """
    n_specimens, n_outputs, n_points = mask.shape
    read = mask & mask[:, :1]
    gap = np.full(mask.shape, np.inf)
    last = np.full((n_specimens, n_outputs), -np.inf)
    for j in range(n_points):
        here = place[:, None, j]
        gap[..., j] = here - last
        last = np.where(read[..., j], here, last)
    return Paths(
        read.reshape(n_specimens, -1),
        gap.reshape(n_specimens, -1),
        np.tile(place, n_outputs),
        n_points,
    )


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


@dataclass(frozen=True)
class Statistic:
    """A published or replicate mean that is used as one observation.

    The mean of n replicates less the truth, over its standard error, follows Student's law with
    n − 1 degrees of freedom, since the scatter was estimated from the same few replicates.

    Parameters
    ----------
    quantity : {"young_modulus", "elongation_at_break", "volume_ratio"}
        What it is of.
    degradation : float
        D_R at which it holds [%].
    value, se : float
        Mean and its standard error, in the quantity's unit.
    source : str
        Where it stands.
    dof : float
        Degrees of freedom, n − 1; inf if n is not known.
    """

    quantity: str
    degradation: float
    value: float
    se: float
    source: str
    dof: float = float("inf")


def tensile_curves(study: Study, *, fitted: bool) -> TensileCurves | None:
    """Return the tensile curves of the modes that are fitted, or of those that are held out."""
    table = study.tensile
    if table is None:
        return None
    table = table[table["mode"].isin(study.settings.fit_modes) == fitted]
    if table.empty:
        return None
    # by stretch, so that the order of rows does not matter
    table = table.sort_values("stretch", kind="stable")
    order = table.groupby(["specimen_id", "mode"], sort=False)
    groups = sorted(order, key=lambda item: int(item[1].index.min()))
    size = max(len(g) for _, g in groups)
    modes = tuple(str(key[1]) for key, _ in groups)
    stretch = _pad([g["stretch"] for _, g in groups], size, fill=1.0)
    is_cauchy = [(g["stress_measure"] == "cauchy").astype(np.float64) for _, g in groups]
    cauchy = _pad(is_cauchy, size, fill=0.0) > 0.5
    measure = np.where(cauchy, "cauchy", "nominal")
    basis = yeoh_basis(stretch, np.array(modes)[:, None], measure)
    return TensileCurves(
        specimens=tuple(str(key[0]) for key, _ in groups),
        modes=modes,
        degradation=np.array([float(g["degradation_pct"].iloc[0]) for _, g in groups]),
        degradation_sd=np.array([float(g["degradation_sd_pct"].iloc[0]) for _, g in groups]),
        basis=basis,
        stretch=stretch,
        stress=_pad([g["stress_MPa"] for _, g in groups], size, fill=0.0),
        cauchy=cauchy,
        mask=np.arange(size) < np.array([len(g) for _, g in groups])[:, None],
    )


def actuator_curves(study: Study) -> ActuatorCurves | None:
    """Return the actuator's curves, in the order in which they were taken."""
    table = study.actuator
    if table is None:
        return None
    groups = [g for _, g in table.groupby("specimen_id", sort=False)]
    size = max(len(g) for g in groups)
    pressure = _pad([g["pressure_kPa"] for g in groups], size, fill=0.0)
    curvature = _pad([g["curvature_per_m"] for g in groups], size, fill=np.nan)
    mask = np.isfinite(curvature) & (pressure > 0.0)
    angle = _pad([g["bend_angle_deg"] for g in groups], size, fill=np.nan)
    angle_mask = np.isfinite(angle) & mask
    if not mask.any():
        return None
    return ActuatorCurves(
        specimens=tuple(str(g["specimen_id"].iloc[0]) for g in groups),
        degradation=np.array([[float(g["degradation_pct"].iloc[0])] for g in groups]),
        degradation_sd=np.array([[float(g["degradation_sd_pct"].iloc[0])] for g in groups]),
        pressure=pressure,
        curvature=np.where(mask, curvature, 0.0),
        curvature_sd=np.nan_to_num(_pad([g["curvature_sd_per_m"] for g in groups], size, fill=0.0)),
        mask=mask,
        bend_angle=np.where(angle_mask, angle, 0.0),
        angle_mask=angle_mask,
        recorded=np.arange(size) < np.array([len(g) for g in groups])[:, None],
        ruptured=_pad([g["ruptured"] for g in groups], size, fill=0.0) > 0.5,
        cycle=_pad([g["cycle"] for g in groups], size, fill=1.0).astype(np.int64),
        time=_pad([g["time_s"] for g in groups], size, fill=np.nan),
        humidity=_pad([g["humidity_pct"] for g in groups], size, fill=np.nan),
        # rows that are not there are held as those that are
        mount=np.array([[*g["mount"], *[g["mount"].iloc[-1]] * (size - len(g))] for g in groups]),
        branch=np.array([[*g["branch"], *["loading"] * (size - len(g))] for g in groups]),
    )


def breaks(study: Study) -> Breaks | None:
    """Return the elongations at break."""
    table = study.breaks
    if table is None:
        return None
    return Breaks(
        tuple(str(s) for s in table["specimen_id"]),
        table["degradation_pct"].to_numpy(np.float64),
        table["degradation_sd_pct"].to_numpy(np.float64),
        table["elongation_pct"].to_numpy(np.float64),
    )


def statistics(study: Study) -> tuple[Statistic, ...]:
    """Return published means with their standard errors, and α from the films' masses.

    The standard error is sd/√n; without n it is the sd itself.
    """
    found = []
    if study.summary is not None:
        known = ("young_modulus", "elongation_at_break", "volume_ratio")
        rows = study.summary[study.summary["quantity"].isin(known)]
        for row in rows.to_dict("records"):
            count = float(row["n"]) if pd.notna(row["n"]) else 1.0
            dof = count - 1.0 if count > 1.0 else float("inf")
            if pd.notna(row["sd"]):
                level = float(row["degradation_pct"]) if pd.notna(row["degradation_pct"]) else 0.0
                se = float(row["sd"]) / np.sqrt(max(count, 1.0))
                found.append(
                    Statistic(
                        str(row["quantity"]),
                        level,
                        float(row["value"]),
                        se,
                        str(row["source"]),
                        dof,
                    )
                )
    if study.shrinkage is not None and len(study.shrinkage) > 1:
        poured, cured, conditioned = (
            study.shrinkage[f"mass_{name}_g"].to_numpy(np.float64)
            for name in ("poured", "cured", "conditioned")
        )
        mean = mean_of_replicates(volume_ratio(poured, cured, conditioned))
        source = f"shrinkage.csv, {mean.count} films"
        dof = mean.count - 1.0
        found.append(Statistic("volume_ratio", 0.0, mean.value, mean.standard_error, source, dof))
    _refuse_zero_errors(found)
    return tuple(found)


def _refuse_zero_errors(found: list[Statistic]) -> None:
    faults = [
        Fault(
            s.source if s.source.startswith("shrinkage.csv") else "summary.csv",
            f"{s.quantity} at {s.degradation:g} % has a standard error of 0",
            "give the scatter that was observed, or leave sd empty to show the value only",
        )
        for s in found
        if not s.se > 0.0
    ]
    if faults:
        raise StudyError(faults)


def _pad(columns: list["pd.Series[float]"], size: int, *, fill: float) -> Floats:
    out = np.full((len(columns), size), fill)
    for row, column in enumerate(columns):
        out[row, : len(column)] = column.to_numpy(np.float64)
    return out
