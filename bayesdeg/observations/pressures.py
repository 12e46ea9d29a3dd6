"""Tests of actuators at pressures, with any kind of reading, as padded arrays.

`ReadAtPressures` is the base of kinds with one reading at each pressure: everything follows from
the readings linearised about the specimens' deviations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Further
from bayesdeg.causes.cause import Conditions
from bayesdeg.data.batches import batch_numbers
from bayesdeg.errors import BayesdegError
from bayesdeg.observations.arrays import (
    PathReadings,
    chosen,
    histories,
    places_of_tests,
    rows_of_specimens,
)
from bayesdeg.observations.curvature import LONGEST_NOISE, mechanics_inputs
from bayesdeg.observations.kinds import Places, Rows, Scale, State, Stored
from bayesdeg.observations.noise import (
    LOG_TWO_PI,
    Linearised,
    Paths,
    correlated_normals,
    innovations,
    paths_of,
    sequential,
)
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.priors import Named, Parameter, Uniform
from bayesdeg.quantities import QUANTITIES, axis_label

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

SHORTEST_NOISE = 0.005  # of the pressure range, as for curvature


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

    @property
    def readings(self) -> Floats:
        """The readings, (n_specimens, n_points)."""
        return self.read

    def with_readings(self, readings: Floats) -> Self:
        """Return the same tests with different readings."""
        return replace(self, read=np.where(self.mask, readings, 0.0))


def pressure_tests(
    table: pd.DataFrame | None, column: str, batches: Sequence[str] = ()
) -> PressureTests | None:
    r"""Return the readings in one column of tests at pressures; None if there are none.

    Parameters
    ----------
    table : DataFrame, optional
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
    if table is None or column not in table:
        return None
    rows = rows_of_specimens(table)
    pressure, read = rows.numbers("pressure_kPa", 0.0), rows.numbers(column, np.nan)
    mask = np.isfinite(read) & (pressure > 0.0)
    if not mask.any():
        return None
    degradation = rows.first("degradation_pct")[:, None]
    conditions = Conditions(
        pressure,
        degradation,
        time=rows.numbers("time_s", np.nan),
        cycle=rows.numbers("cycle", 1.0).astype(np.int64),
        unloading=rows.words("branch", "loading") == "unloading",
        humidity=rows.numbers("humidity_pct", np.nan),
        # missing rows get the most common mount
        mount=rows.words("mount", "horizontal"),
        temperature=rows.numbers("temperature_C", np.nan),
        batch=batch_numbers(table, batches)[:, None],
    )
    return PressureTests(
        rows.specimens,
        degradation,
        rows.first("degradation_sd_pct")[:, None],
        conditions,
        np.where(mask, read, 0.0),
        mask,
    )


@dataclass(frozen=True)
class ReadAtPressures(PathReadings[PressureTests]):
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

    def length_parameter(self) -> Parameter:
        """Return the correlation length of reading errors in pressure [kPa], with its prior."""
        largest = float(self.tests.conditions.pressure.max())
        law = Uniform(SHORTEST_NOISE * largest, LONGEST_NOISE * largest)
        meaning = f"correlation length of reading errors of {self.name} in pressure"
        return Parameter(f"{self.name}_noise_length", law, "kPa", meaning)

    def of_mean(self, values: Named, mean: Floats, slope: Floats, spread: Floats) -> Linearised:
        """Return the law of readings about their mean.

        Parameters
        ----------
        values : mapping
            Named values, (n,).
        mean, slope : array, which broadcast to (n, n_specimens, n_points)
            And its derivative with respect to the specimens' deviations of ln stiffness.
        spread : array, shape (n, n_specimens)
            τ² of the deviations.
        """
        noise, floor = (values[f"{self.name}_noise{end}"][:, None, None] for end in ("", "_floor"))
        shape = (*spread.shape, self.tests.mask.shape[1])
        mean, slope = np.broadcast_to(mean, shape), np.broadcast_to(slope, shape)
        return Linearised(
            self.tests.read - mean,
            slope[..., None],
            floor**2 + (noise * mean) ** 2,
            spread[..., None],
            values[f"{self.name}_noise_length"],
            np.zeros(len(mean)),
            self.tests.paths,
        )

    def answered(self, state: State[FilmsAndActuators], deviation: Floats) -> Further:
        """Return what the forward map predicts beyond the shape.

        Deviations of the specimens' ln stiffness have shape (n, n_specimens, 1).

        Raises
        ------
        BayesdegError
            If it does not predict this quantity.
        """
        met = mechanics_inputs(state, self.tests, deviation)
        found = state.world.forward(replace(met, asked=self.asks)).further
        if found is None:
            raise BayesdegError(f"the forward map of this model does not predict {self.reading}s")
        return found

    def common_error(self, values: Named) -> Floats:
        """Return the emulator error common to all readings, in standard errors, (n, 1, 1)."""
        none = np.zeros(len(next(iter(values.values()))))
        return values.get(f"emulator_error_{self.name}", none)[:, None, None]

    def drawn_deviations(
        self, state: State[FilmsAndActuators], generator: np.random.Generator
    ) -> Floats:
        """Draw deviations of new specimens' ln stiffness, (n, n_specimens, 1)."""
        sd = np.sqrt(self.linearised(state).spread)
        deviation: Floats = sd * generator.standard_normal(sd.shape)
        return deviation

    @override
    def drawn(self, state: State[FilmsAndActuators], generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens, (n, n_specimens, n_points)."""
        found = self.linearised(state)
        moved = self.drawn_deviations(state, generator) * found.slope[..., 0]
        z = correlated_normals(found.paths, found.length, found.correlation, generator)
        mean = self.tests.read - found.residual
        drawn: Floats = mean + moved + np.sqrt(found.variance) * z
        return drawn

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        score, log_sd = innovations(self.conditioned(state))
        each = np.zeros((len(state), *self.tests.mask.shape))
        each[:, self.tests.mask] = -0.5 * (score**2 + LOG_TWO_PI) - log_sd
        total: Floats = each.sum(axis=-1)
        return total

    @property
    @override
    def places(self) -> Places:
        set_to, kind = self.tests.conditions, self.reading
        return places_of_tests(
            self.tests, (kind,), kind, set_to.pressure, histories(set_to), time=set_to.time
        )

    @property
    @override
    def scales(self) -> Mapping[str, Scale]:
        unit = QUANTITIES[self.column].unit
        return {self.reading: Scale(unit, axis_label("pressure_kPa"), "%")}

    @override
    def expected(self, state: State[FilmsAndActuators]) -> Floats:
        return (self.tests.read - self.linearised(state).residual)[:, self.tests.mask]

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
                self.drawn(tests, generator)[:, mask],
                labels,
                {},
            )
        ]
