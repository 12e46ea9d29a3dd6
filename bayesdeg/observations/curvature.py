"""Curvature against pressure of actuators, with the bend angle where recorded.

The inner loop computes densities of whole specimens from predictions in one compiled pass.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, Protocol, Self, override

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.status import Status
from bayesdeg.causes.cause import Conditions, Degradation
from bayesdeg.causes.fold import applied
from bayesdeg.compiled import compiled
from bayesdeg.data.batches import batch_numbers, batch_order, recorded_batches
from bayesdeg.data.plausibility import computed_angles
from bayesdeg.data.study import Study
from bayesdeg.observations.arrays import (
    PathReadings,
    chosen,
    histories,
    places_of_tests,
    rows_of_specimens,
)
from bayesdeg.observations.kinds import (
    Deviations,
    Observations,
    Parts,
    Places,
    Rows,
    State,
    Stored,
)
from bayesdeg.observations.noise import (
    LANES,
    Linearised,
    Paths,
    correlated_normals,
    filter_of,
    innovations,
    paths_of,
    same_path,
    sequential,
    specimen_density,
)
from bayesdeg.observations.specimens import (
    FilmsAndActuators,
    Material,
    layer_stiffness,
    linear_scale,
    shared,
    stiffness_spread,
)
from bayesdeg.priors import (
    HalfNormal,
    LogNormal,
    Named,
    Normal,
    Parameter,
    TruncatedNormal,
    Uniform,
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

CURVATURE, ANGLE, ACTUATOR = "curvature", "bend angle", "actuator"


_ACTUATOR = (
    Parameter(
        "volume_ratio",
        TruncatedNormal(0.62, 0.07, 0.1, 1.0),
        "–",
        "volume of the part over that of its mould, α",
    ),
    Parameter("paper_stiffness", LogNormal(3e4, 0.7), "N/m", "Young's modulus times thickness"),
    Parameter("curvature_noise", HalfNormal(0.05), "–", "proportional reading error of curvature"),
    Parameter(
        "curvature_noise_floor", HalfNormal(0.3), "1/m", "constant reading error of curvature"
    ),
)
LONGEST_NOISE = 0.15  # of the pressure range: longer correlations are effects to name, not noise
BEND_ANGLE = (
    Parameter("bend_angle_noise", HalfNormal(0.05), "–", "proportional reading error of angle"),
    Parameter("bend_angle_noise_floor", HalfNormal(0.7), "°", "constant reading error of angle"),
    Parameter(
        "reading_correlation",
        TruncatedNormal(0.0, 0.5, -0.98, 0.98),
        "–",
        "correlation of the reading errors of curvature and angle in a picture",
    ),
)
#: For lines of points: curvature is angle over a length of relatively small error.
_OF_ONE_LINE = TruncatedNormal(0.95, 0.1, -0.98, 0.98)
_ERROR_MEANING = "emulator error common to all curves, {}, in standard errors"
EMULATOR = (
    Parameter("emulator_error_level", Normal(0.0, 1.0), "–", _ERROR_MEANING.format("on average")),
    Parameter(
        "emulator_error_pressure", Normal(0.0, 1.0), "–", _ERROR_MEANING.format("with pressure")
    ),
    Parameter(
        "emulator_error_degradation",
        Normal(0.0, 1.0),
        "–",
        _ERROR_MEANING.format("with degradation"),
    ),
)

OF_DEGRADATION = ("volume_ratio", "emulator_error_degradation")
"""Parameters of actuators that a study without degradation and shrinkage lacks."""


def actuator_parameters(largest_pressure: float) -> tuple[Parameter, ...]:
    """Return the parameters of actuators tested up to a pressure [kPa]."""
    length = Parameter(
        "curvature_noise_length",
        Uniform(0.005 * largest_pressure, LONGEST_NOISE * largest_pressure),
        "kPa",
        "correlation length of reading errors in pressure",
    )
    return (*_ACTUATOR, length)


class Ruptures(NamedTuple):
    """Readings between which actuators burst, or which they survived, (n_specimens,).

    Parameters
    ----------
    survived : array of int
        Row of the largest survived pressure below the rupture; −1 if none.
    burst : array of int
        Row at whose pressure the specimen burst; −1 if it did not.
    """

    survived: NDArray[np.int64]
    burst: NDArray[np.int64]


@dataclass(frozen=True)
class ActuatorCurves:
    """Curvature–pressure curves, with the bend angle where recorded.

    Parameters
    ----------
    specimens : tuple of str
        One per curve.
    degradation, degradation_sd : array, shape (n_specimens, 1)
        D_R as measured and its standard error [%]; (n, n_specimens, 1) for predictions of new
        specimens with their own rate in each draw.
    pressure, curvature : array, shape (n_specimens, n_points)
        As read [kPa], [1/m].
    curvature_sd, angle_sd : array, shape (n_specimens, n_points)
        Recorded reading errors; 0 where there is none [1/m], [°].
    mask : array of bool, shape (n_specimens, n_points)
        Where there is an observation; readings at zero pressure, zero by definition, do not count.
    bend_angle : array, shape (n_specimens, n_points)
        As read [°].
    angle_mask : array of bool, shape (n_specimens, n_points)
        Where there is a bend angle. Angles without a curvature, or computed from it, are not
        used; see `bayesdeg.data.plausibility.computed_angles`.
    recorded, ruptured : array of bool, shape (n_specimens, n_points)
        Existing rows, and those at whose pressure the specimen burst.
    cycle : array of int, branch : array of str, shape (n_specimens, n_points)
        Loading cycle and branch.
    time, humidity : array, shape (n_specimens, n_points)
        Time since the specimen's first row [s], humidity of the room [%]; nan where not recorded.
    mount : array of str, shape (n_specimens, n_points)
        Mount of the specimen.
    temperature : array, shape (n_specimens, n_points), optional
        Of the room [°C]; nan where not recorded, the default.
    batch : array of int, shape (n_specimens, 1), optional
        Number of its batch, see `bayesdeg.data.batches.batch_numbers`; by default 0.
    batch_name : array of str, shape (n_specimens, 1), optional
        Name of its batch; empty where none is recorded.
    """

    specimens: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    curvature: Floats
    curvature_sd: Floats
    angle_sd: Floats
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
    temperature: Floats = field(default_factory=lambda: np.array(np.nan))
    batch: NDArray[np.int64] = field(default_factory=lambda: np.array(0))
    batch_name: NDArray[np.str_] = field(default_factory=lambda: np.array(""))

    @cached_property
    def conditions(self) -> Conditions:
        """Set and recorded conditions of the experiment."""
        return Conditions(
            self.pressure,
            self.degradation,
            time=self.time,
            cycle=self.cycle,
            unloading=self.branch == "unloading",
            humidity=self.humidity,
            mount=self.mount,
            temperature=self.temperature,
            batch=self.batch,
        )

    @cached_property
    def with_angle(self) -> bool:
        """Whether any bend angle was recorded."""
        return bool(self.angle_mask.any())

    @cached_property
    def readings(self) -> Floats:
        """Curvatures [1/m], then bend angles [°] if any, (n_specimens, n_readings)."""
        both = (self.curvature, self.bend_angle) if self.with_angle else (self.curvature,)
        return np.concatenate(both, axis=1)

    @cached_property
    def readings_sd(self) -> Floats:
        """Recorded errors of the readings, (n_specimens, n_readings); 0 where there is none."""
        both = (self.curvature_sd, self.angle_sd) if self.with_angle else (self.curvature_sd,)
        shape = self.pressure.shape
        return np.concatenate([np.broadcast_to(sd, shape) for sd in both], axis=1)

    @cached_property
    def paths(self) -> Paths:
        """The readings of each specimen as a path of pressure."""
        both = (self.mask, self.mask & self.angle_mask) if self.with_angle else (self.mask,)
        travelled = np.abs(np.diff(self.pressure, axis=1, prepend=0.0))
        return paths_of(np.stack(both, axis=1), np.cumsum(travelled, axis=1))

    @cached_property
    def ruptures(self) -> Ruptures:
        """Readings between which each specimen burst, or which it survived."""
        any_burst = self.ruptured.any(axis=1)
        burst = np.where(any_burst, np.argmax(self.ruptured, axis=1), -1)
        at_burst = np.where(any_burst, self.pressure[np.arange(len(burst)), burst], np.inf)
        below = self.recorded & ~self.ruptured & (self.pressure < at_burst[:, None])
        below &= self.pressure > 0.0
        highest = np.argmax(np.where(below, self.pressure, -1.0), axis=1)
        return Ruptures(np.where(below.any(axis=1), highest, -1), burst)

    def subset(self, rows: Rows) -> "ActuatorCurves":
        """Return the curves of some specimens."""
        return chosen(self, rows)

    def with_readings(self, readings: Floats) -> Self:
        """Return the same tests with different readings, (n_specimens, n_readings)."""
        points = self.pressure.shape[1]
        curvature = np.where(self.mask, readings[:, :points], 0.0)
        if not self.with_angle:
            return replace(self, curvature=curvature)
        angle = np.where(self.angle_mask & self.mask, readings[:, points:], 0.0)
        return replace(self, curvature=curvature, bend_angle=angle)


def no_actuators() -> ActuatorCurves:
    """Return tests of no actuator."""
    none, never, words = np.empty((0, 1)), np.empty((0, 1), bool), np.empty((0, 1), np.str_)
    whole = np.empty((0, 1), np.int64)
    return ActuatorCurves(
        (), *(none,) * 6, never, none, *(never,) * 3, whole, words, none, none, words
    )  # fmt: skip


def actuator_curves(study: Study) -> ActuatorCurves | None:
    """Return the actuators' curves in the order of reading."""
    table = study.actuator
    if table is None:
        return None
    if study.line_points is None:
        computed = computed_angles(table)
        table = table.assign(bend_angle_deg=table["bend_angle_deg"].mask(computed))
    rows = rows_of_specimens(table)
    pressure = rows.numbers("pressure_kPa", 0.0)
    curvature = rows.numbers("curvature_per_m", np.nan)
    mask = np.isfinite(curvature) & (pressure > 0.0)
    angle = rows.numbers("bend_angle_deg", np.nan)
    angle_mask = np.isfinite(angle) & mask
    if not mask.any():
        return None
    batches = recorded_batches(table)
    return ActuatorCurves(
        specimens=rows.specimens,
        degradation=rows.first("degradation_pct")[:, None],
        degradation_sd=rows.first("degradation_sd_pct")[:, None],
        pressure=pressure,
        curvature=np.where(mask, curvature, 0.0),
        curvature_sd=np.nan_to_num(rows.numbers("curvature_sd_per_m", 0.0)),
        angle_sd=np.nan_to_num(rows.numbers("bend_angle_sd_deg", 0.0)),
        mask=mask,
        bend_angle=np.where(angle_mask, angle, 0.0),
        angle_mask=angle_mask,
        recorded=rows.recorded,
        ruptured=rows.numbers("ruptured", 0.0) > 0.5,
        cycle=rows.numbers("cycle", 1.0).astype(np.int64),
        time=rows.numbers("time_s", np.nan),
        humidity=rows.numbers("humidity_pct", np.nan),
        mount=rows.words("mount"),
        branch=rows.words("branch", "loading"),
        temperature=rows.numbers("temperature_C", np.nan),
        batch=batch_numbers(table, batch_order(study.tensile, table))[:, None],
        batch_name=np.array([[batches.get(name, "")] for name in rows.specimens]),
    )


class Curves(NamedTuple):
    """Predictions of a forward map with causes for actuators, (n, n_specimens, n_points).

    Parameters
    ----------
    curvature, slope, curvature_sd : array
        With causes [1/m]; the slope is p ∂κ/∂p.
    angle, angle_sd : array
        With causes [°]; unused without recorded angles.
    unread_curvature, unread_slope : array
        Before causes that act on the reading [1/m]; unused without recorded angles.
    """

    curvature: Floats
    slope: Floats
    curvature_sd: Floats
    angle: Floats
    angle_sd: Floats
    unread_curvature: Floats
    unread_slope: Floats


@compiled
def curve_density(
    readings: Floats,
    reading_sd: Floats,
    curves: Curves,
    noise: Floats,
    mode: Floats,
    spread: Floats,
    length: Floats,
    correlation: Floats,
    mask: Flags,
    gap: Floats,
    density: Floats,
    deviation: Floats,
) -> None:
    """Write the log density of each specimen's readings and its most probable deviation.

    Parameters
    ----------
    readings : array, shape (n_specimens, n_readings)
        Curvatures [1/m], then angles [°] if recorded.
    reading_sd : array, shape (n_specimens, n_readings)
        Recorded standard error of each [1/m], [°].
    curves : Curves
        At the deviations ``mode``.
    noise : array, shape (n, 4)
        Constant and proportional reading error of curvature [1/m], [–] and of angle [°], [–].
    mode, spread : array, shape (n, n_specimens)
        Deviation of ln stiffness at which the curves are evaluated, and its variance τ².
    length, correlation : array, shape (n,)
        As in `bayesdeg.observations.noise.Linearised`.
    mask, gap : array, shape (n_specimens, n_readings)
        As in `bayesdeg.observations.noise.Paths`.
    density, deviation : array, shape (n, n_specimens)
        Output.
    """
    n, n_specimens, points = curves.curvature.shape
    alike, count, n_readings = same_path(mask, gap), 0, mask.shape[1]
    rows, white = np.empty((n_readings, 4 * LANES)), np.empty((n_readings, 3 * LANES))
    gains, order = np.empty((n_readings, 3 * LANES)), np.empty(n_readings, np.int64)
    lengths, both, constant = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    found = np.empty((3, LANES))
    for first in range(0, n, LANES):
        here = min(LANES, n - first)
        for lane in range(LANES):
            b = first + min(lane, here - 1)
            lengths[lane], both[lane] = length[b], correlation[b]
        for s in range(n_specimens):
            if not alike[s]:
                count = filter_of(lengths, both, mask[s], gap[s], points, gains, order, constant)
            for lane in range(LANES):
                b = first + min(lane, here - 1)
                width = math.sqrt(spread[b, s])
                _curvatures(
                    readings[s], reading_sd[s], curves.curvature[b, s], curves.slope[b, s],
                    curves.curvature_sd[b, s], noise[b], mode[b, s], width, rows[:, lane::LANES],
                )  # fmt: skip
                if n_readings > points:
                    _angles(
                        readings[s], reading_sd[s], curves.angle[b, s], curves.angle_sd[b, s],
                        curves.unread_curvature[b, s], curves.unread_slope[b, s], noise[b],
                        mode[b, s], width, rows[:, lane::LANES],
                    )  # fmt: skip
            specimen_density(rows, gains, order[:count], points, both, constant, white, found)
            for lane in range(here):
                density[first + lane, s] = found[0, lane]
                deviation[first + lane, s] = found[1, lane] * math.sqrt(spread[first + lane, s])


@compiled
def _curvatures(
    readings: Floats,
    reading_sd: Floats,
    curvature: Floats,
    growth: Floats,
    sd: Floats,
    noise: Floats,
    mode: float,
    width: float,
    rows: Floats,
) -> None:
    """Linearise the curvatures of one specimen about its deviation."""
    for j in range(len(curvature)):
        error = noise[1] * curvature[j]
        rows[j, 0] = readings[j] - curvature[j] - growth[j] * mode
        rows[j, 1], rows[j, 2] = -growth[j] * width, 0.0
        variance = noise[0] * noise[0] + error * error + sd[j] * sd[j]
        rows[j, 3] = variance + reading_sd[j] * reading_sd[j]


@compiled
def _angles(
    readings: Floats,
    reading_sd: Floats,
    angle: Floats,
    sd: Floats,
    curvature: Floats,
    growth: Floats,
    noise: Floats,
    mode: float,
    width: float,
    rows: Floats,
) -> None:
    """Linearise the bend angles of one specimen, which are proportional to curvature."""
    points = len(angle)
    for j in range(points):
        relative = growth[j] / (math.inf if curvature[j] == 0.0 else curvature[j])
        error, slope = noise[3] * angle[j], -angle[j] * relative
        rows[points + j, 0] = readings[points + j] - angle[j] + slope * mode
        rows[points + j, 1], rows[points + j, 2] = slope * width, 0.0
        variance = noise[2] * noise[2] + error * error + sd[j] * sd[j]
        rows[points + j, 3] = variance + reading_sd[points + j] * reading_sd[points + j]


FARTHEST = 1.0
"""Largest excess over the forward map's range at which data are simulated: it costs half a nat."""
PASSES = 2
"""Number of linearisations, the first at zero deviation."""


class Predicted(NamedTuple):
    """Readings of actuators with given deviations of ln stiffness.

    Parameters
    ----------
    prediction : Prediction
        With causes and the emulator's common error, (n, n_specimens, n_points).
        Expected readings [1/m, °], their derivative with respect to the deviation, and the
        variance of their errors.
    """

    prediction: Prediction
    mean: Floats
    slope: Floats
    variance: Floats


class AtPressures(Protocol):
    """Tests of actuators at pressures, with any kind of reading, as `PressureTests`."""

    @property
    def specimens(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def degradation(self) -> Floats: ...  # noqa: D102
    @property
    def degradation_sd(self) -> Floats: ...  # noqa: D102
    @property
    def conditions(self) -> Conditions: ...  # noqa: D102


def estimated_degradation(state: State[FilmsAndActuators], data: AtPressures) -> Degradation:
    """Return estimated degradation rates and their standard errors [%], each (n, n_specimens)."""
    recorded = Degradation(data.degradation, data.degradation_sd)
    believed = applied("on_degradation", recorded, data.conditions, state.acting())
    shape = (len(state), len(data.specimens))
    level, sd = (np.broadcast_to(v[..., 0], shape) for v in (believed.value, believed.sd))
    return Degradation(level, sd)


class ActuatorMaterial(NamedTuple):
    """The actuators' median material, and τ² of their deviations of ln stiffness, (n, S)."""

    material: Material
    spread: Floats


def parts_of(state: State[FilmsAndActuators], data: AtPressures) -> ActuatorMaterial:
    """Return the actuators' material."""
    believed = state.once(estimated_degradation, data)
    material = state.world.material(state.values, shared(believed.value))
    return ActuatorMaterial(material, stiffness_spread(state.values, material, believed.sd))


def predict(state: State[FilmsAndActuators], data: ActuatorCurves, deviation: Floats) -> Predicted:
    """Predict readings at these deviations of ln stiffness, (n, n_specimens, 1)."""
    values, (mechanics, prediction) = state.values, _predictions(state, data, deviation)
    noise = values["curvature_noise"][:, None, None] * prediction.curvature
    floor = values["curvature_noise_floor"][:, None, None]
    mean, slope = prediction.curvature, -prediction.slope
    variance = floor**2 + noise**2 + prediction.sd**2 + data.curvature_sd**2
    if not data.with_angle:
        return Predicted(prediction, mean, slope, variance)
    angle = prediction.bend_angle
    # the bottom line's length hardly depends on pressure: angle and curvature are proportional
    growth = mechanics.slope / np.where(mechanics.curvature == 0.0, np.inf, mechanics.curvature)
    noise = values["bend_angle_noise"][:, None, None] * angle
    floor = values["bend_angle_noise_floor"][:, None, None]
    of_angle = floor**2 + noise**2 + prediction.bend_angle_sd**2 + data.angle_sd**2
    return Predicted(
        prediction,
        np.concatenate([mean, angle], axis=-1),
        np.concatenate([slope, -angle * growth], axis=-1),
        np.concatenate([variance, of_angle], axis=-1),
    )


def mechanics_inputs(
    state: State[FilmsAndActuators], data: AtPressures, deviation: Floats
) -> Inputs:
    """Return the inputs of the mechanics under causes.

    The deviations of the specimens' ln stiffness have shape (n, n_specimens, 1).
    """
    constants = state.once(parts_of, data).material.constants
    factor = np.exp(deviation)
    c1, c2, c3 = (constants[..., i, None] * factor for i in range(3))
    inputs = inputs_without_causes(state, data.conditions.pressure, (c1, c2, c3))
    return applied("on_inputs", inputs, data.conditions, state.acting())


def inputs_without_causes(
    state: State[FilmsAndActuators], pressure: Floats, constants: tuple[Floats, Floats, Floats]
) -> Inputs:
    """Return the inputs of the mechanics at pressures [kPa] and Yeoh constants [MPa]."""
    values, world = state.values, state.world
    return Inputs(
        pressure,
        *constants,
        linear_scale=linear_scale(values)[:, None, None],
        paper_stiffness=layer_stiffness(values)[:, None, None],
        paper_thickness=np.full((1, 1, 1), world.paper_thickness),
        dimensions=world.sizes(values),
    )


def _predictions(
    state: State[FilmsAndActuators],
    data: ActuatorCurves,
    deviation: Floats,
    *,
    with_strain: bool = True,
) -> tuple[Prediction, Prediction]:
    """Return predictions before and after causes that act on the reading.

    Without the criterion's strain measure, which takes as long as the rest, the peak stretch is
    that of the forward map.
    """
    causes, met = state.acting(), mechanics_inputs(state, data, deviation)
    world = state.world
    answer = world.answer(met, state.values) if with_strain else world.forward(met)
    mechanics = _with_common_error(state, data, answer)
    return mechanics, applied("on_reading", mechanics, data.conditions, causes)


def linearise_actuators(
    state: State[FilmsAndActuators], data: ActuatorCurves
) -> tuple[Linearised, Predicted]:
    """Linearise readings at the actuators' most probable deviations of ln stiffness."""
    mode, _, _ = _mode_and_density(state, data, passes=PASSES - 1, with_strain=False)
    predicted = predict(state, data, mode[..., None])
    linearised = Linearised(
        data.readings - predicted.mean + predicted.slope * mode[..., None],
        predicted.slope[..., None],
        predicted.variance,
        state.once(parts_of, data).spread[..., None],
        state.values["curvature_noise_length"],
        reading_correlation(state.values, data),
        data.paths,
    )
    return linearised, predicted


def log_density(state: State[FilmsAndActuators], data: ActuatorCurves) -> tuple[Floats, Prediction]:
    """Return log densities of whole specimens, (n, n_specimens), and their prediction.

    The readings are linearised by `linearise_actuators`.
    """
    _, density, prediction = _mode_and_density(state, data, passes=PASSES)
    return density, prediction


def _mode_and_density(
    state: State[FilmsAndActuators],
    data: ActuatorCurves,
    *,
    passes: int,
    with_strain: bool = True,
) -> tuple[Floats, Floats, Prediction]:
    """Return the most probable deviations, and density and prediction of the last pass.

    The density of the last pass is evaluated at the previous mode.
    """
    values, spread = state.values, state.once(parts_of, data).spread
    names = ["curvature_noise_floor", "curvature_noise"]
    names += ["bend_angle_noise_floor", "bend_angle_noise"] if data.with_angle else names
    noise = np.stack([values[name] for name in names], axis=-1)
    density, mode = np.empty(spread.shape), np.zeros(spread.shape)
    for left in reversed(range(passes)):
        at = mode
        mode = np.empty(spread.shape)
        mechanics, prediction = _predictions(
            state, data, at[..., None], with_strain=with_strain and left == 0
        )
        curve_density(
            np.ascontiguousarray(data.readings),
            np.ascontiguousarray(data.readings_sd),
            _curves(mechanics, prediction),
            noise,
            at,
            np.ascontiguousarray(spread),
            np.ascontiguousarray(values["curvature_noise_length"]),
            np.ascontiguousarray(reading_correlation(values, data)),
            np.ascontiguousarray(data.paths.mask),
            np.ascontiguousarray(data.paths.gap),
            density,
            mode,
        )
    return mode, density, prediction


def _curves(mechanics: Prediction, prediction: Prediction) -> Curves:
    curves = (
        prediction.curvature,
        prediction.slope,
        prediction.sd,
        prediction.bend_angle,
        prediction.bend_angle_sd,
        mechanics.curvature,
        mechanics.slope,
    )
    shape = curves[0].shape
    # a broadcast view is read-only, of which kernels would be compiled again
    whole = (c if c.shape == shape else np.broadcast_to(c, shape) for c in curves)
    return Curves(*map(np.ascontiguousarray, whole))


def reading_correlation(values: Named, data: ActuatorCurves) -> Floats:
    """Return the correlation of the errors of both outputs, (n,); 0 if there is only one."""
    if data.with_angle:
        return values["reading_correlation"]
    return np.zeros(len(values["curvature_noise_length"]))


def range_excess(data: ActuatorCurves, prediction: Prediction) -> Floats:
    """Return how far each specimen's readings lie outside the forward map's range, (n, S).

    Root of the sum of squares over existing readings; 0 for maps that do not extrapolate.
    """
    if prediction.excess is None or not prediction.excess.any():
        return np.zeros((len(prediction.curvature), len(data.specimens)))
    shape = (len(prediction.curvature), *data.mask.shape)
    each = np.where(data.mask, np.broadcast_to(prediction.excess, shape), 0.0)
    excess: Floats = np.sqrt(np.sum(each**2, axis=-1))
    return excess


def _with_common_error(
    state: State[FilmsAndActuators], data: ActuatorCurves, prediction: Prediction
) -> Prediction:
    """Shift a prediction by the emulator error common to all curves."""
    if "emulator_error_level" not in state.values:
        return prediction
    g = state.once(common_error, data)
    nothing = np.zeros_like(prediction.sd)
    with np.errstate(invalid="ignore"):  # refused values may be infinite
        return replace(
            prediction,
            curvature=prediction.curvature + g * prediction.sd,
            bend_angle=prediction.bend_angle + g * prediction.bend_angle_sd,
            sd=nothing,
            bend_angle_sd=nothing,
        )


def common_error(state: State[FilmsAndActuators], data: ActuatorCurves) -> Floats:
    """Return the emulator's error in its standard errors, (n, n_specimens, n_points).

    g = u₀/√3 + u₁ (2 p/p_max − 1) + u₂ (2 D/D_max − 1), of unit variance on average over pressures
    and degradation rates; without u₂, g = u₀ √(2/3) + u₁ (2 p/p_max − 1).
    """
    names = ("emulator_error_level", "emulator_error_pressure", "emulator_error_degradation")
    given = {n: state.values[n][:, None, None] for n in names if n in state.values}
    level, by_pressure, *rest = given.values()
    pressures = 2.0 * data.pressure / state.world.largest_pressure - 1.0
    if not rest:
        alone: Floats = level * np.sqrt(2.0 / 3.0) + by_pressure * pressures
        return alone
    [by_degradation] = rest
    rates = 2.0 * data.degradation / max(state.world.nodes[-1], 1.0) - 1.0
    error: Floats = (level / np.sqrt(3.0) + by_degradation * rates) + by_pressure * pressures
    return error


@dataclass(frozen=True)
class Curvature(PathReadings[ActuatorCurves]):
    """Curvatures of actuators, and bend angles where recorded.

    Parameters
    ----------
    tests : ActuatorCurves
        The readings.
    of_lines : bool
        Whether curvature and angle were read from the same points.
    """

    name: ClassVar[str] = "actuator"
    order: ClassVar[int] = 20
    priority: ClassVar[int] = 2
    is_criticised: ClassVar[bool] = True
    uses_forward: ClassVar[bool] = True
    floors: ClassVar[Mapping[str, str]] = {
        "curvature_noise_floor": "curvature_per_m",
        "bend_angle_noise_floor": "bend_angle_deg",
    }

    tests: ActuatorCurves = field(default_factory=no_actuators)
    of_lines: bool = False

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        own = actuator_parameters(float(self.tests.pressure.max()))
        if not self.tests.with_angle:
            return own
        *errors, correlation = BEND_ANGLE
        law = _OF_ONE_LINE if self.of_lines else correlation.law
        return (*own, *errors, replace(correlation, law=law))

    @property
    @override
    def error_parameters(self) -> tuple[Parameter, ...]:
        return EMULATOR

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        density, prediction = state.once(log_density, self.tests)
        found: Floats = density - 0.5 * range_excess(self.tests, prediction) ** 2
        return found

    @override
    def factors(self, state: State[FilmsAndActuators]) -> Parts:
        curves, predicted = state.once(linearise_actuators, self.tests)
        excess = range_excess(self.tests, predicted.prediction)
        return Parts((innovations(curves),), ((-0.5 * excess**2, excess),))

    @cached_property
    @override
    def places(self) -> Places:
        data = self.tests
        return places_of_tests(
            data,
            (CURVATURE, ANGLE) if data.with_angle else (CURVATURE,),
            ACTUATOR,
            data.pressure,
            histories(data.conditions),
            time=data.time,
            humidity=data.humidity,
        )

    @override
    def expected(self, state: State[FilmsAndActuators]) -> Floats:
        return self.predicted(state).mean[:, self.tests.paths.mask]

    @override
    def simulate(self, state: State[FilmsAndActuators], generator: np.random.Generator) -> Floats:
        readings = state.recomputed(draw_readings, self.tests, generator).readings.copy()
        readings[self.range_excess(state).max(axis=1) > FARTHEST] = np.nan
        return readings[:, self.tests.paths.mask]

    @override
    def replicated(
        self,
        state: State[FilmsAndActuators],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        readings = state.once(draw_readings, self.tests, generator).readings
        return (*drawn, replace(self, tests=self.tests.with_readings(readings[0])))

    @override
    def deviations(self, state: State[FilmsAndActuators]) -> Deviations:
        return self.of_own_deviations(state)

    @override
    def refused(self, state: State[FilmsAndActuators]) -> Flags:
        status = self.predicted(state).prediction.status
        outside: Flags = np.any((status != Status.CONVERGED) & self.tests.mask, axis=(-2, -1))
        return outside

    @override
    def watched(
        self, world: FilmsAndActuators, report: Callable[[Flags], None]
    ) -> FilmsAndActuators:
        return world.watched(self.tests.mask, report)

    def predicted(
        self, state: State[FilmsAndActuators], deviation: Floats | None = None
    ) -> Predicted:
        """Return expected readings of the actuators, with error variances.

        Deviations of the specimens' ln stiffness, (n, n_specimens, 1), are 0 by default.
        """
        if deviation is None:
            deviation = np.zeros((*state.once(parts_of, self.tests).spread.shape, 1))
        return predict(state, self.tests, deviation)

    def map_error_ratio(self, state: State[FilmsAndActuators]) -> float:
        """Return the rms error of the map over that of the readings themselves, at a state [–]."""
        found, points = self.predicted(state), self.tests.mask.shape[-1]
        own = found.prediction.sd**2
        read = found.variance[..., :points] - own
        mask = np.broadcast_to(self.tests.mask, own.shape)
        return float(np.sqrt(np.nanmean(own[mask]) / np.nanmean(read[mask])))

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        """Linearise the readings at the actuators' most probable deviations."""
        return state.once(linearise_actuators, self.tests)[0]

    def range_excess(self, state: State[FilmsAndActuators]) -> Floats:
        """Return how far outside the forward map's range each actuator lies, (n, S).

        At the most probable deviations of the specimens, as in the density: the log likelihood
        falls with half its square; 0 inside.
        """
        return range_excess(self.tests, state.once(linearise_actuators, self.tests)[1].prediction)

    def deviation_sd(self, state: State[FilmsAndActuators]) -> Floats:
        """Return τ of each actuator, shape (n, n_specimens, 1)."""
        return deviation_sd(state, self.tests)

    def drawn_deviations(
        self, state: State[FilmsAndActuators], generator: np.random.Generator
    ) -> Floats:
        """Draw deviations of new specimens' ln stiffness, (n, n_specimens, 1)."""
        sd = self.deviation_sd(state)
        return sd * generator.standard_normal(sd.shape)

    @override
    def drawn(self, state: State[FilmsAndActuators], generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens, (n, n_specimens, n_readings).

        Curvatures [1/m], then bend angles [°]; nan where the forward map has no solution.
        """
        return draw_readings(state, self.tests, generator, survived=False).readings

    @override
    def stored(
        self,
        state: State[FilmsAndActuators],
        tests: State[FilmsAndActuators],
        generator: np.random.Generator,
    ) -> list[Stored]:
        data = self.tests
        pointwise = sequential(self.linearised(state))
        replicates = self.drawn(tests, generator)
        points, found = data.pressure.shape[1], []
        outputs = {"curvature": (data.mask, slice(0, points))}
        if data.with_angle:
            outputs["bend_angle"] = (data.mask & data.angle_mask, slice(points, 2 * points))
        everywhere = {
            "specimen_id": np.broadcast_to(np.array(data.specimens)[:, None], data.mask.shape),
            "pressure_kPa": data.pressure,
            "degradation_pct": np.broadcast_to(data.degradation, data.mask.shape),
        }
        for output, (mask, columns) in outputs.items():
            first = output == "curvature"
            found.append(
                Stored(
                    output,
                    "observation" if first else f"{output}_observation",
                    data.readings[:, columns][mask],
                    pointwise[..., columns][:, mask],
                    replicates[..., columns][:, mask],
                    {("" if first else f"{output}_") + n: v[mask] for n, v in everywhere.items()},
                    {"pressure": data.pressure[data.mask]} if first else {},
                )
            )
        return found


def deviation_sd(state: State[FilmsAndActuators], data: AtPressures) -> Floats:
    """Return τ of each actuator's ln stiffness, (n, n_specimens, 1)."""
    return np.sqrt(state.once(parts_of, data).spread)[..., None]


class DrawnCurves(NamedTuple):
    """Readings of new specimens.

    Parameters
    ----------
    readings : array, shape (n, n_specimens, n_readings)
        Curvatures [1/m], then bend angles [°].
    predicted : Predicted
        Predictions without reading errors.
    deviation : array, shape (n, n_specimens, 1)
        Of each specimen's ln stiffness.
    """

    readings: Floats
    predicted: Predicted
    deviation: Floats


REDRAWS = 12
"""Further draws of a specimen that would not have survived its readings, as the real one did."""


def draw_readings(
    state: State[FilmsAndActuators],
    data: ActuatorCurves,
    generator: np.random.Generator,
    *,
    survived: bool = True,
) -> DrawnCurves:
    """Draw readings of new specimens, see `Curvature.drawn`, and their predictions.

    With ``survived``, a specimen without a solution at one of its readings, as beyond ballooning,
    is redrawn on its own, since the real specimen was read there.
    """
    sd = deviation_sd(state, data)
    deviation = sd * generator.standard_normal(sd.shape)
    predicted = predict(state, data, deviation)
    for _ in range(REDRAWS if survived else 0):
        known = np.isfinite(predicted.prediction.curvature) | ~data.mask
        lost = ~np.all(known, axis=-1, keepdims=True)
        if not lost.any():
            break
        deviation = np.where(lost, sd * generator.standard_normal(sd.shape), deviation)
        predicted = predict(state, data, deviation)
    length = state.values["curvature_noise_length"]
    correlation = reading_correlation(state.values, data)
    z = correlated_normals(data.paths, length, correlation, generator)
    return DrawnCurves(predicted.mean + np.sqrt(predicted.variance) * z, predicted, deviation)


def from_study(study: Study) -> tuple[Curvature, ...]:
    """Return the curves of a study, if any."""
    curves = actuator_curves(study)
    return () if curves is None else (Curvature(curves, study.line_points is not None),)
