"""Tests of actuators at pressures, with any kind of reading, as padded arrays.

`ReadAtPressures` is the base of kinds with one reading at each pressure: everything follows from
the readings linearised about the specimens' deviations.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.causes.cause import Conditions
from bayesdeg.data.batches import batch_numbers
from bayesdeg.observations.arrays import chosen, padded
from bayesdeg.observations.kinds import (
    Observations,
    Parts,
    Places,
    Rows,
    Scale,
    State,
    Stored,
)
from bayesdeg.observations.noise import (
    LOG_TWO_PI,
    Linearised,
    Paths,
    blocks_of_covariance,
    correlated_normals,
    innovations,
    paths_of,
    sequential,
)
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.quantities import QUANTITIES, axis_label

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class PressureTests:
    """Readings of one quantity at pressures.

    Parameters
    ----------
    specimens : tuple of str
        One per test.
    degradation, degradation_sd : array, shape (n_specimens, 1)
        D_R as measured and its standard error [%].
    conditions : Conditions
        Set and recorded conditions, (n_specimens, n_points).
    read : array, shape (n_specimens, n_points)
        The readings; 0 where there is none.
    mask : array of bool, shape (n_specimens, n_points)
        Where there is a reading; those at zero pressure are zero by definition and do not count.
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
        """Return the places of the readings, of this kind and their own family."""
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


def pressure_tests(
    table: pd.DataFrame, column: str, batches: Sequence[str] = ()
) -> PressureTests | None:
    r"""Return the readings in one column of tests at pressures; None if there are none.

    Parameters
    ----------
    table : DataFrame
        The table as read.
    column : str
        The column of the readings.
    batches : sequence of str
        From `bayesdeg.data.batches.batch_order`.

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
    if column not in table:
        return None
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
        # missing rows get the most common mount
        mount=words("mount", "horizontal"),
        temperature=filled("temperature_C", np.nan),
        batch=batch_numbers(table, batches)[:, None],
    )
    names = tuple(str(group["specimen_id"].iloc[0]) for group in groups)
    sd = filled("degradation_sd_pct", 0.0)[:, :1]
    tests = PressureTests(names, degradation, sd, found, np.where(mask, read, 0.0), mask)
    return tests if mask.any() else None


@dataclass(frozen=True)
class ReadAtPressures(Observations):
    """One quantity read on actuators at pressures.

    Parameters
    ----------
    reading : str
        Name of the reading, in words.
    column : str
        Column of the file, a key of `bayesdeg.quantities.QUANTITIES`.
    output : str
        Name of the variables of a posterior file.
    tests : PressureTests
        The readings.
    """

    is_criticised: ClassVar[bool] = True
    reading: ClassVar[str]
    column: ClassVar[str]
    output: ClassVar[str]

    tests: PressureTests

    @abstractmethod
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        """Linearise readings at zero deviation of the specimens' ln stiffness."""

    def conditioned(self, state: State[FilmsAndActuators]) -> Linearised:
        """Linearise readings given other readings of the same specimens."""
        return self.linearised(state)

    def drawn_deviations(
        self, state: State[FilmsAndActuators], generator: np.random.Generator
    ) -> Floats:
        """Draw deviations of new specimens' ln stiffness, (n, n_specimens, 1)."""
        sd = np.sqrt(self.linearised(state).spread)
        deviation: Floats = sd * generator.standard_normal(sd.shape)
        return deviation

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return self.tests.specimens

    @property
    @override
    def levels(self) -> Floats:
        return self.tests.degradation.ravel()

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        score, log_sd = innovations(self.conditioned(state))
        each = np.zeros((len(state), *self.tests.mask.shape))
        each[:, self.tests.mask] = -0.5 * (score**2 + LOG_TWO_PI) - log_sd
        total: Floats = each.sum(axis=-1)
        return total

    @override
    def factors(self, state: State[FilmsAndActuators]) -> Parts:
        return Parts(normal=(innovations(self.conditioned(state)),))

    @override
    def subset(self, rows: Rows) -> Self:
        return replace(self, tests=self.tests.subset(rows))

    @property
    @override
    def places(self) -> Places:
        return self.tests.places(self.reading)

    @property
    @override
    def scales(self) -> Mapping[str, Scale]:
        unit = QUANTITIES[self.column].unit
        return {self.reading: Scale(unit, axis_label("pressure_kPa"), "%")}

    @property
    @override
    def observed(self) -> Floats:
        return self.tests.read[self.tests.mask]

    @override
    def expected(self, state: State[FilmsAndActuators]) -> Floats:
        return self._mean(self.linearised(state))[:, self.tests.mask]

    @override
    def covariance(self, state: State[FilmsAndActuators]) -> list[Floats]:
        return blocks_of_covariance(self.linearised(state))

    @override
    def simulate(self, state: State[FilmsAndActuators], generator: np.random.Generator) -> Floats:
        return self._drawn(state, generator)[:, self.tests.mask]

    @override
    def replicated(
        self,
        state: State[FilmsAndActuators],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        read = np.where(self.tests.mask, self._drawn(state, generator)[0], 0.0)
        return (*drawn, replace(self, tests=replace(self.tests, read=read)))

    @override
    def stored(
        self,
        state: State[FilmsAndActuators],
        tests: State[FilmsAndActuators],
        generator: np.random.Generator,
    ) -> list[Stored]:
        mask, places = self.tests.mask, self.places
        labels = {
            f"{self.name}_specimen_id": places.specimen,
            f"{self.name}_pressure_kPa": places.along,
            f"{self.name}_degradation_pct": places.level,
        }
        return [
            Stored(
                self.output,
                f"{self.name}_observation",
                self.observed,
                sequential(self.conditioned(state))[:, mask],
                self._drawn(tests, generator)[:, mask],
                labels,
                {},
            )
        ]

    def _mean(self, found: Linearised) -> Floats:
        mean: Floats = self.tests.read - found.residual
        return mean

    def _drawn(self, state: State[FilmsAndActuators], generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens, (n, n_specimens, n_points)."""
        found = self.linearised(state)
        moved = self.drawn_deviations(state, generator) * found.slope[..., 0]
        z = correlated_normals(found.paths, found.length, found.correlation, generator)
        drawn: Floats = self._mean(found) + moved + np.sqrt(found.variance) * z
        return drawn
