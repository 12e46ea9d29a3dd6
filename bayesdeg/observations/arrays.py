"""Tests of specimens as padded arrays, and all that follows from them and a linearised law.

Rows are specimens, columns their readings along a path of pressure or stretch. `PathReadings` is
the base of the kinds of data that are read so: each adds its law.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Protocol, Self, override

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayesdeg.causes.cause import Conditions
from bayesdeg.observations.kinds import (
    Deviations,
    Grouped,
    Observations,
    Parts,
    Places,
    Pointwise,
    State,
)
from bayesdeg.observations.noise import Linearised, Paths, blocks_of_covariance, innovations

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class PaddedRows:
    """Rows of a table, specimen by specimen, as arrays of shape (n_specimens, n_points).

    Parameters
    ----------
    groups : list of DataFrame
        The rows of each specimen.
    """

    groups: list[pd.DataFrame]

    @property
    def lengths(self) -> NDArray[np.intp]:
        """Number of rows of each specimen."""
        return np.array([len(group) for group in self.groups])

    @property
    def specimens(self) -> tuple[str, ...]:
        """Name of each specimen."""
        return tuple(str(group["specimen_id"].iloc[0]) for group in self.groups)

    @property
    def recorded(self) -> Flags:
        """Where there is a row."""
        return np.arange(self.lengths.max()) < self.lengths[:, None]

    def first(self, name: str) -> Floats:
        """Return the numbers of a column in the first row of each specimen, (n_specimens,)."""
        return np.array([float(group[name].iloc[0]) for group in self.groups])

    def numbers(self, name: str, fill: float) -> Floats:
        """Return a column of numbers, filled where there is no row."""
        out = np.full((len(self.groups), self.lengths.max()), fill)
        for row, group in zip(out, self.groups, strict=True):
            row[: len(group)] = group[name].to_numpy(np.float64)
        return out

    def words(self, name: str, fill: str = "") -> NDArray[np.str_]:
        """Return a column of words, filled where there is no row, by default with the last word."""
        columns, size = [group[name] for group in self.groups], self.lengths.max()
        return np.array([[*one, *[fill or one.iloc[-1]] * (size - len(one))] for one in columns])


def rows_of_specimens(table: pd.DataFrame) -> PaddedRows:
    """Return the rows of each specimen, in order of first appearance."""
    return PaddedRows([group for _, group in table.groupby("specimen_id", sort=False)])


def histories(conditions: Conditions) -> NDArray[np.str_]:
    """Return branch, cycle and mount of each reading, such as ``loading 1 horizontal``."""
    branch = np.where(conditions.unloading, "unloading", "loading")
    path = np.char.add(np.char.add(branch, " "), conditions.cycle.astype(np.str_))
    return np.char.add(np.char.add(path, " "), conditions.mount)


def chosen[T](data: T, rows: Rows) -> T:
    """Select specimens from a frozen dataclass whose fields have one entry per specimen.

    A single value is that of all specimens.
    """
    found: dict[str, Any] = {}
    for field in fields(data):  # type: ignore[arg-type]
        value = getattr(data, field.name)
        if isinstance(value, tuple):
            found[field.name] = tuple(value[i] for i in rows)
        elif is_dataclass(value):
            found[field.name] = chosen(value, rows)
        elif value.ndim:
            found[field.name] = value[rows]
    changed: T = replace(data, **found)  # type: ignore[type-var]
    return changed


class SpecimenTests(Protocol):
    """Tests of specimens along a path, without or with readings: what every record offers."""

    @property
    def specimens(self) -> tuple[str, ...]:
        """Name of each specimen."""
        ...

    @property
    def degradation(self) -> Floats:
        """D_R of each specimen as measured [%]."""
        ...

    @property
    def readings(self) -> Floats:
        """The readings, output by output, (n_specimens, n_readings)."""
        ...

    @property
    def paths(self) -> Paths:
        """Sequence of the readings, and where there are any."""
        ...

    def subset(self, rows: Rows) -> Self:
        """Return the tests of some specimens."""
        ...

    def with_readings(self, readings: Floats) -> Self:
        """Return the same tests with different readings."""
        ...


def places_of_tests(
    tests: SpecimenTests,
    kinds: Sequence[str],
    family: str,
    along: Floats,
    history: NDArray[np.str_],
    *,
    time: ArrayLike = np.nan,
    humidity: ArrayLike = np.nan,
) -> Places:
    """Return the places of readings.

    Parameters
    ----------
    tests : SpecimenTests
        The tests.
    kinds, family : sequence of str, str
        Kind of each output, and the family of all.
    along, history, time, humidity : array
        As in `bayesdeg.observations.kinds.Places`, (n_specimens, n_points), or so broadcast.
    """
    read = tests.paths.mask
    shape = (len(read), tests.paths.points)

    def each[T: np.generic](values: NDArray[T]) -> NDArray[T]:
        return np.tile(np.broadcast_to(values, shape), len(kinds))[read]

    count = int(read.sum())
    return Places(
        np.broadcast_to(np.repeat(np.array(kinds), shape[1]), read.shape)[read],
        np.full(count, family),
        each(np.asarray(along, dtype=np.float64)),
        each(np.asarray(tests.degradation, dtype=np.float64).reshape(-1, 1)),
        each(np.array(tests.specimens, dtype=np.str_)[:, None]),
        each(history),
        each(np.asarray(time, dtype=np.float64)),
        each(np.asarray(humidity, dtype=np.float64)),
    )


@dataclass(frozen=True)
class PathReadings[T: SpecimenTests](Pointwise, Grouped):
    """Readings along paths, by a law that is linearised about the specimens' own deviations.

    Parameters
    ----------
    tests : SpecimenTests
        The readings.
    """

    tests: T

    @abstractmethod
    def linearised(self, state: State[Any]) -> Linearised:
        """Linearise the readings."""

    def conditioned(self, state: State[Any]) -> Linearised:
        """Linearise them given other readings of the same specimens."""
        return self.linearised(state)

    @abstractmethod
    def drawn(self, state: State[Any], generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (n, n_specimens, n_readings)."""

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return self.tests.specimens

    @property
    @override
    def levels(self) -> Floats:
        return self.tests.degradation.ravel()

    @override
    def factors(self, state: State[Any]) -> Parts:
        return Parts(normal=(innovations(self.conditioned(state)),))

    @override
    def subset(self, rows: Rows) -> Self:
        return replace(self, tests=self.tests.subset(rows))

    @property
    @override
    def observed(self) -> Floats:
        return self.tests.readings[self.tests.paths.mask]

    @override
    def covariance(self, state: State[Any]) -> list[Floats]:
        return blocks_of_covariance(self.linearised(state))

    @override
    def simulate(self, state: State[Any], generator: np.random.Generator) -> Floats:
        return self.drawn(state, generator)[:, self.tests.paths.mask]

    @override
    def replicated(
        self,
        state: State[Any],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        tests = self.tests.with_readings(self.drawn(state, generator)[0])
        return (*drawn, replace(self, tests=tests))

    def of_own_deviations(self, state: State[Any]) -> Deviations:
        """Return the effect of deviations of the specimens' ln stiffness."""
        found, read = self.linearised(state), self.tests.paths.mask
        slope, own = np.zeros((*read.shape, len(read))), np.arange(len(read))
        slope[own, :, own] = found.slope[0, :, :, 0]
        return Deviations(slope[read], found.spread[0, :, 0], self.levels)
