"""Tests of actuators at pressures, whatever was read in them: what was set, as padded arrays."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.causes.cause import Conditions
from bayesdeg.observations.arrays import chosen, padded
from bayesdeg.observations.kinds import Places, Rows
from bayesdeg.observations.noise import Paths, paths_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class PressureTests:
    """Readings of one quantity at pressures.

    Parameters
    ----------
    specimens : tuple of str
        One a test.
    degradation, degradation_sd : array, shape (n_specimens, 1)
        D_R as measured and its standard error [%].
    conditions : Conditions
        What was set or recorded, (n_specimens, n_points).
    read : array, shape (n_specimens, n_points)
        The readings; 0 where there is none.
    mask : array of bool, shape (n_specimens, n_points)
        Where there is one; a reading at zero pressure is zero by definition and none.
    """

    specimens: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    conditions: Conditions
    read: Floats
    mask: Flags

    @cached_property
    def paths(self) -> Paths:
        """The readings of each specimen as a path of pressure."""
        travelled = np.abs(np.diff(self.conditions.pressure, axis=1, prepend=0.0))
        return paths_of(self.mask[:, None], np.cumsum(travelled, axis=1))

    def subset(self, rows: Rows) -> Self:
        """Return the tests of some specimens."""
        return chosen(self, rows)

    def places(self, kind: str) -> Places:
        """Return where the readings stand, of this kind and of a family of their own."""
        set_to, read = self.conditions, self.mask

        def each[T: np.generic](values: NDArray[T]) -> NDArray[T]:
            return np.broadcast_to(values, read.shape)[read]

        branch = np.where(set_to.unloading, "unloading", "loading")
        history = np.char.add(np.char.add(branch, " "), set_to.cycle.astype(np.str_))
        count = int(read.sum())
        return Places(
            np.full(count, kind),
            np.full(count, kind),
            each(set_to.pressure),
            each(self.degradation),
            each(np.array(self.specimens)[:, None]),
            each(np.char.add(np.char.add(history, " "), set_to.mount)),
            each(set_to.time),
        )


def pressure_tests(table: pd.DataFrame, column: str) -> PressureTests | None:
    r"""Return what was read in a column of a file of tests at pressures; None if nothing was.

    Examples
    --------
    >>> from bayesdeg.data.study import check_table
    >>> from bayesdeg.data.tables import number, of_actuators
    >>> import pandera.pandas as pa
    >>> volume = pa.DataFrameSchema(of_actuators({"bend_angle_deg": number()}), name="volume.csv")
    >>> rows = b"specimen_id,degradation_pct,pressure_kPa,bend_angle_deg\na,0,20,4\na,0,40,9\n"
    >>> table = check_table(rows, volume, degradation_sd_pct=1.0).frame
    >>> pressure_tests(table, "bend_angle_deg").read
    array([[4., 9.]])
    """
    groups = [group for _, group in table.groupby("specimen_id", sort=False)]
    size = max(map(len, groups))

    def filled(name: str, fill: float) -> Floats:
        return padded([group[name] for group in groups], size, fill=fill)

    def words(name: str, rest: str) -> NDArray[np.str_]:
        return np.array([[*group[name], *[rest] * (size - len(group))] for group in groups])

    pressure, read = filled("pressure_kPa", 0.0), filled(column, np.nan)
    mask = np.isfinite(read) & (pressure > 0.0)
    degradation = filled("degradation_pct", 0.0)[:, :1]
    found = Conditions(
        pressure,
        degradation,
        time=filled("time_s", np.nan),
        cycle=filled("cycle", 1.0).astype(np.int64),
        unloading=words("branch", "loading") == "unloading",
        humidity=filled("humidity_pct", np.nan),
        # rows that are not there are held as most are
        mount=words("mount", "horizontal"),
    )
    names = tuple(str(group["specimen_id"].iloc[0]) for group in groups)
    sd = filled("degradation_sd_pct", 0.0)[:, :1]
    tests = PressureTests(names, degradation, sd, found, np.where(mask, read, 0.0), mask)
    return tests if mask.any() else None
