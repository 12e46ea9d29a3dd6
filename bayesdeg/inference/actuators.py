"""The inner loop of the actuators' likelihood: from predictions to densities in one pass."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.causes.cause import Cause, Conditions, Degradation, Strength
from bayesdeg.compiled import compiled
from bayesdeg.inference.data import ActuatorCurves
from bayesdeg.inference.likelihood import (
    Linearised,
    filter_of,
    log_interval,
    same_path,
    specimen_density,
)
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.specimens import Material, elongation_at, elongation_spread, shared
from bayesdeg.material.degradation import Nodes

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Curves(NamedTuple):
    """What a forward map with its causes predicts of actuators, (n, n_specimens, n_points).

    Parameters
    ----------
    curvature, slope, curvature_sd : array
        With causes [1/m]; the slope is p ∂κ/∂p.
    angle, angle_sd : array
        With causes [°]; not read where no angle was read.
    unread_curvature, unread_slope : array
        Before causes that act on the reading [1/m]; not read where no angle was read.
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
        Curvatures [1/m], then angles [°] if they were read.
    reading_sd : array, shape (n_specimens, n_points)
        Standard error of each curvature by itself [1/m].
    curves : Curves
        At the deviations ``mode``.
    noise : array, shape (n, 4)
        Constant and proportional reading error of curvature [1/m], [–] and of angle [°], [–].
    mode, spread : array, shape (n, n_specimens)
        Deviation of ln stiffness at which the curves are, and its variance τ².
    length, correlation : array, shape (n,)
        As `bayesdeg.inference.likelihood.Linearised`.
    mask, gap : array, shape (n_specimens, n_readings)
        As `bayesdeg.inference.likelihood.Paths`.
    density, deviation : array, shape (n, n_specimens)
        Written.
    """
    n, n_specimens, points = curves.curvature.shape
    n_readings = mask.shape[1]
    alike = same_path(mask, gap)
    gains, order = np.empty((3, n_readings)), np.empty(n_readings, np.int64)
    scales, first = np.empty(n_readings), np.empty((points, 3))
    residual, slope = np.empty(n_readings), np.empty((n_readings, 1))
    variance = np.empty(n_readings)
    for b in range(n):
        count, constant = 0, 0.0
        for s in range(n_specimens):
            if not alike[s]:
                count, constant = filter_of(
                    length[b], correlation[b], mask[s], gap[s], points, gains, order
                )
            _curvatures(
                readings[s], reading_sd[s], curves.curvature[b, s], curves.slope[b, s],
                curves.curvature_sd[b, s], noise[b], mode[b, s], residual, slope, variance,
            )  # fmt: skip
            if n_readings > points:
                _angles(
                    readings[s], curves.angle[b, s], curves.angle_sd[b, s],
                    curves.unread_curvature[b, s], curves.unread_slope[b, s], noise[b],
                    mode[b, s], residual, slope, variance,
                )  # fmt: skip
            density[b, s], deviation[b, s], _ = specimen_density(
                residual, slope, variance, (math.sqrt(spread[b, s]), 0.0), correlation[b],
                constant, gains, order[:count], scales, first,
            )  # fmt: skip


@compiled
def _curvatures(
    readings: Floats,
    reading_sd: Floats,
    curvature: Floats,
    growth: Floats,
    sd: Floats,
    noise: Floats,
    mode: float,
    residual: Floats,
    slope: Floats,
    variance: Floats,
) -> None:
    """Linearise the curvatures of one specimen about its deviation."""
    for j in range(len(curvature)):
        error = noise[1] * curvature[j]
        slope[j, 0] = -growth[j]
        residual[j] = readings[j] - curvature[j] - growth[j] * mode
        variance[j] = noise[0] * noise[0] + error * error + sd[j] * sd[j]
        variance[j] += reading_sd[j] * reading_sd[j]


@compiled
def _angles(
    readings: Floats,
    angle: Floats,
    sd: Floats,
    curvature: Floats,
    growth: Floats,
    noise: Floats,
    mode: float,
    residual: Floats,
    slope: Floats,
    variance: Floats,
) -> None:
    """Linearise the bend angles of one specimen, which grow as the curvature does."""
    points = len(angle)
    for j in range(points):
        relative = growth[j] / (math.inf if curvature[j] == 0.0 else curvature[j])
        error = noise[3] * angle[j]
        slope[points + j, 0] = -angle[j] * relative
        residual[points + j] = readings[points + j] - angle[j] + slope[points + j, 0] * mode
        variance[points + j] = noise[2] * noise[2] + error * error + sd[j] * sd[j]


PASSES = 2
"""Linearisations, the first at no deviation."""


@dataclass(frozen=True)
class Rig:
    """The actuators' tests and how they are predicted.

    Parameters
    ----------
    data : ActuatorCurves
        Readings.
    forward : ForwardMap
        The mechanics.
    causes : tuple of Cause
        Active causes, in order.
    paper_thickness : float
        [mm].
    largest_pressure, largest_degradation : float
        By which the emulator's common error is scaled [kPa], [%].
    """

    data: ActuatorCurves
    forward: ForwardMap
    causes: tuple[Cause, ...]
    paper_thickness: float
    largest_pressure: float
    largest_degradation: float

    @property
    def conditions(self) -> Conditions:
        """What the experiment set or recorded."""
        return self.data.conditions


class Predicted(NamedTuple):
    """Readings of actuators with given deviations of ln stiffness.

    Parameters
    ----------
    prediction : Prediction
        With causes and the emulator's common error, (n, n_specimens, n_points).
    mean, slope, variance : array, shape (n, n_specimens, n_readings)
        Readings expected [1/m, °], their derivative by the deviation, and the variance of their
        errors.
    """

    prediction: Prediction
    mean: Floats
    slope: Floats
    variance: Floats


def believed_degradation(rig: Rig, values: Named) -> Degradation:
    """Return degradation rates and their standard errors [%], each (n, n_specimens)."""
    data = rig.data
    state = Degradation(data.degradation, data.degradation_sd)
    for cause in rig.causes:
        if cause.on_degradation is not None:
            state = cause.on_degradation(state, rig.conditions, cause.effect(values))
    shape = (len(values["volume_ratio"]), len(data.specimens))
    level, sd = (np.broadcast_to(v[..., 0], shape) for v in (state.value, state.sd))
    return Degradation(level, sd)


def predict(rig: Rig, values: Named, material: Material, deviation: Floats) -> Predicted:
    """Return what actuators with these deviations of ln stiffness, (n, n_specimens, 1), read."""
    return _readings(rig.data, values, *_predictions(rig, values, material, deviation))


def _predictions(
    rig: Rig, values: Named, material: Material, deviation: Floats
) -> tuple[Prediction, Prediction]:
    """Return predictions before and after causes that act on the reading."""
    factor = np.exp(deviation)
    c1, c2, c3 = (material.constants[..., i, None] * factor for i in range(3))
    inputs = Inputs(
        pressure=rig.data.pressure,
        c1=c1,
        c2=c2,
        c3=c3,
        linear_scale=np.cbrt(values["volume_ratio"])[:, None, None],
        paper_stiffness=values["paper_stiffness"][:, None, None],
        paper_thickness=np.full((1, 1, 1), rig.paper_thickness),
    )
    for cause in rig.causes:
        if cause.on_inputs is not None:
            inputs = cause.on_inputs(inputs, rig.conditions, cause.effect(values))
    mechanics = _with_common_error(rig, values, rig.forward(inputs))
    prediction = mechanics
    for cause in rig.causes:
        if cause.on_reading is not None:
            prediction = cause.on_reading(prediction, rig.conditions, cause.effect(values))
    return mechanics, prediction


def linearise_actuators(
    rig: Rig, values: Named, material: Material, spread: Floats
) -> tuple[Linearised, Predicted]:
    """Linearise readings at the actuators' most probable deviations of ln stiffness.

    Parameters
    ----------
    rig : Rig
        Tests and mechanics.
    values : mapping
        Named values, (n,).
    material : Material
        Median material at the specimens' degradation rates.
    spread : array, shape (n, n_specimens)
        τ² of the deviations.
    """
    mode, _, _ = _mode_and_density(rig, values, material, spread, passes=PASSES - 1)
    predicted = predict(rig, values, material, mode[..., None])
    linearised = Linearised(
        rig.data.readings - predicted.mean + predicted.slope * mode[..., None],
        predicted.slope[..., None],
        predicted.variance,
        spread[..., None],
        values["curvature_noise_length"],
        _correlation(rig, values),
        rig.data.paths,
    )
    return linearised, predicted


def log_density(
    rig: Rig, values: Named, material: Material, spread: Floats
) -> tuple[Floats, Prediction]:
    """Return log densities of whole specimens, (n, n_specimens), and their prediction.

    It is that of the readings as `linearise_actuators`, whose arguments it has, linearises them.
    """
    _, density, prediction = _mode_and_density(rig, values, material, spread, passes=PASSES)
    return density, prediction


def _mode_and_density(
    rig: Rig, values: Named, material: Material, spread: Floats, *, passes: int
) -> tuple[Floats, Floats, Prediction]:
    """Return the most probable deviations, and density and prediction of the last pass.

    The mode that the last pass finds comes after its density, which is at the mode before it.
    """
    data = rig.data
    names = ["curvature_noise_floor", "curvature_noise"]
    names += ["bend_angle_noise_floor", "bend_angle_noise"] if data.with_angle else names
    noise = np.stack([values[name] for name in names], axis=-1)
    density, mode = np.empty(spread.shape), np.zeros(spread.shape)
    for _ in range(passes):
        at = mode
        mode = np.empty(spread.shape)
        mechanics, prediction = _predictions(rig, values, material, at[..., None])
        curve_density(
            np.ascontiguousarray(data.readings),
            np.ascontiguousarray(np.broadcast_to(data.curvature_sd, data.pressure.shape)),
            _curves(mechanics, prediction),
            noise,
            at,
            np.ascontiguousarray(spread),
            np.ascontiguousarray(values["curvature_noise_length"]),
            np.ascontiguousarray(_correlation(rig, values)),
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
    return Curves(*(np.ascontiguousarray(np.broadcast_to(c, curves[0].shape)) for c in curves))


def _correlation(rig: Rig, values: Named) -> Floats:
    """Return the correlation of the errors of both outputs, (n,); 0 where there is one."""
    if rig.data.with_angle:
        return values["reading_correlation"]
    return np.zeros(len(values["curvature_noise_length"]))


def range_excess(data: ActuatorCurves, prediction: Prediction) -> Floats:
    """Return how far outside the forward map's range readings of each specimen lie, (n, S).

    The root of the sum of squares over the readings that there are; 0 of maps that do not go on.
    """
    if prediction.excess is None:
        return np.zeros((len(prediction.curvature), len(data.specimens)))
    shape = (len(prediction.curvature), *data.mask.shape)
    each = np.where(data.mask, np.broadcast_to(prediction.excess, shape), 0.0)
    excess: Floats = np.sqrt(np.sum(each**2, axis=-1))
    return excess


def strength_of(rig: Rig, values: Named, believed: Degradation, *, nodes: Nodes) -> Strength:
    """Return the elongation limit of actuators believed to be degraded so far, (n, n_specimens)."""
    level = believed.value
    spread = elongation_spread(values, shared(level), believed.sd, nodes=nodes)
    strength = Strength(elongation_at(values, shared(level), nodes) / 100.0, np.sqrt(spread))
    for cause in rig.causes:
        if cause.on_strength is not None:
            effect = {name: size[..., 0] for name, size in cause.effect(values).items()}
            strength = cause.on_strength(strength, level, effect)
    return strength


def log_rupture(data: ActuatorCurves, prediction: Prediction, strength: Strength) -> Floats:
    r"""Return log probabilities that each specimen burst where it did, or survived, (n, S).

    A specimen bursts where the stretch that its pressure demands passes its own limit, ln ε_b ~
    N(ln ε̃, s²) with ε = λ − 1: survived up to p, burst at p' it has
    :math:`\Phi(z(p')) - \Phi(z(p))`, and one that did not burst :math:`1 - \Phi(z(p))`. A pressure
    at which the forward map has no answer demands an infinite stretch of the specimen that burst
    there, and says nothing of one that survived it; without strain nothing bursts. Of earlier
    cycles only what was survived below the pressure of the rupture counts: fatigue is not modelled.

    Parameters
    ----------
    data : ActuatorCurves
        Which pressures were survived.
    prediction : Prediction
        At the specimens' most probable stiffness.
    strength : Strength
        ε̃ [–] and s of the specimens, (n, n_specimens).
    """
    ruptures = data.ruptures
    rows = np.arange(len(data.specimens))

    def score(at: NDArray[np.int64], *, refused: float) -> Floats:
        strain = prediction.peak_stretch[:, rows, at] - 1.0
        if np.isinf(refused) and refused > 0.0 and prediction.excess is not None:
            strain = np.where(prediction.excess[:, rows, at] > 0.0, np.nan, strain)
        share = prediction.peak_stretch_sd[:, rows, at] / np.maximum(strain, 1e-12)
        stretched = strain > 0.0
        spread = np.hypot(strength.scatter, share)
        safe = np.log(np.where(stretched, strain, 1.0) / strength.median) / spread
        return np.where(stretched, safe, np.where(np.isfinite(strain), -np.inf, refused))

    low = np.where(ruptures.survived < 0, -np.inf, score(ruptures.survived, refused=-np.inf))
    high = np.where(ruptures.burst < 0, np.inf, score(ruptures.burst, refused=np.inf))
    return np.where(high > low, log_interval(np.minimum(low, high), high), -np.inf)


def _with_common_error(rig: Rig, values: Named, prediction: Prediction) -> Prediction:
    """Shift a prediction by the emulator's error, which all curves share.

    The error in its standard errors is g = u₀/√3 + u₁ (2 p/p_max − 1) + u₂ (2 D/D_max − 1), of unit
    variance on average over pressures and degradation rates.
    """
    if "emulator_error_level" not in values:
        return prediction
    level, by_pressure, by_degradation = (
        values[f"emulator_error_{name}"][:, None, None]
        for name in ("level", "pressure", "degradation")
    )
    g = (
        level / np.sqrt(3.0)
        + by_pressure * (2.0 * rig.data.pressure / rig.largest_pressure - 1.0)
        + by_degradation * (2.0 * rig.data.degradation / rig.largest_degradation - 1.0)
    )
    nothing = np.zeros_like(prediction.sd)
    with np.errstate(invalid="ignore"):  # what is refused may be infinite
        return replace(
            prediction,
            curvature=prediction.curvature + g * prediction.sd,
            bend_angle=prediction.bend_angle + g * prediction.bend_angle_sd,
            sd=nothing,
            bend_angle_sd=nothing,
        )


def _readings(
    data: ActuatorCurves, values: Named, mechanics: Prediction, prediction: Prediction
) -> Predicted:
    noise = values["curvature_noise"][:, None, None] * prediction.curvature
    floor = values["curvature_noise_floor"][:, None, None]
    mean, slope = prediction.curvature, -prediction.slope
    variance = floor**2 + noise**2 + prediction.sd**2 + data.curvature_sd**2
    if not data.with_angle:
        return Predicted(prediction, mean, slope, variance)
    angle = prediction.bend_angle
    # the length of the bottom line hardly depends on pressure: angle and curvature grow alike
    growth = mechanics.slope / np.where(mechanics.curvature == 0.0, np.inf, mechanics.curvature)
    noise = values["bend_angle_noise"][:, None, None] * angle
    floor = values["bend_angle_noise_floor"][:, None, None]
    return Predicted(
        prediction,
        np.concatenate([mean, angle], axis=-1),
        np.concatenate([slope, -angle * growth], axis=-1),
        np.concatenate([variance, floor**2 + noise**2 + prediction.bend_angle_sd**2], axis=-1),
    )
