"""Effects outside the catalogue that imitate its entries: rubbing, drift, leaks, cameras, contact.

Each is simple physics of a laboratory, applied to what was set or read of the fine finite element
curves, and has a form in `bayesdeg.causes.cause.Cause`, so that studies hide it as they hide
others. No function of an entry is called, and the course of each over pressure, time or specimens
differs from that of the entry that it imitates.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Normal, Parameter

Floats = NDArray[np.float64]

TOUCHING = 20.0  # curvature at which chambers touch, where they do [1/m]
ATMOSPHERE = 101.3  # kPa
FINE = 40  # parts of a step between two readings, in each of which a valve sticks or slips
GOLDEN = 0.618  # multiples of it, less their whole parts, are spread evenly
WARMING_UP = 600.0  # s, of a gauge
READING = 30.0  # s, between readings where no time is recorded
MELTING, COOL = 80.0, 22.0  # °C, of the helices, and of the room on other days
SPELL = 17.5  # %: parts of higher rates were tested on the warm days
HOUR = 3600.0  # s
EDGE = 14.0  # mm, of the table from the tip of the unloaded part


def outside_effect(name: str, unit: str, size: float, stage: Stage) -> dict[str, Any]:
    """Return what the form of a cause asks for and an outside effect has no use for."""
    parameter = Parameter(name, Normal(0.0, 10.0 * size), unit, "of a made-up effect", 0.0)
    return {"stage": stage, "parameters": (parameter,), "typical": {name: size}}


def bent(prediction: Prediction, factor: Floats) -> Prediction:
    """Return readings of a part that bends less or more by a factor, along the same line."""
    return replace(
        prediction,
        curvature=prediction.curvature * factor,
        bend_angle=prediction.bend_angle * factor,
    )


def _elapsed(conditions: Conditions) -> Floats:
    """Return the time since a specimen's first reading [s]; every `READING` where none is known."""
    places = np.arange(conditions.pressure.shape[-1])
    return np.where(np.isfinite(conditions.time), conditions.time, READING * places)


def _stick_slip(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A regulator sticks until the difference breaks it away, and slips until there is none.

    Between cycles its knob is turned to zero. Where in this sawtooth it is when a test begins
    differs from actuator to actuator.
    """
    breakaway = np.abs(effect["breakaway"])[..., 0]
    shape = np.broadcast_shapes(inputs.pressure.shape, conditions.pressure.shape, (1, 1, 1))
    path = np.broadcast_to(inputs.pressure, shape)
    begins = np.diff(conditions.cycle, axis=-1, prepend=1) != 0
    knob = np.zeros(shape[:-1])
    held = knob - breakaway * (GOLDEN * np.arange(shape[-2]) % 1.0)
    inside = []
    for place in range(shape[-1]):
        zero = np.where(begins[:, place], 0.0, knob)
        for setting in (zero, path[..., place]):
            last = knob
            for part in np.linspace(0.0, 1.0, FINE + 1)[1:]:
                knob = last + part * (setting - last)
                held = np.where(np.abs(knob - held) >= breakaway, knob, held)
        inside.append(np.maximum(held, 0.0))
    return replace(inputs, pressure=np.stack(inside, axis=-1))


def _gauge_drift(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A gauge's zero sinks while it warms up, from the first reading of each actuator on."""
    sunk = -np.expm1(-_elapsed(conditions) / WARMING_UP)
    return replace(inputs, pressure=np.maximum(inputs.pressure + effect["drift"] * sunk, 0.0))


def _growing_leak(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A crack that leaks grows with every rise of the pressure, and so with cycles.

    Air flows through the hose and out of the crack, each by the squares of absolute pressures.
    """
    rises = np.maximum(np.diff(conditions.pressure, axis=-1, prepend=0.0), 0.0)
    grown = np.cumsum(rises, axis=-1) / conditions.pressure.max()
    share = np.clip(effect["share"] * grown, 0.0, 0.9)
    supply = (inputs.pressure + ATMOSPHERE) ** 2
    inside = np.sqrt((1.0 - share) * supply + share * ATMOSPHERE**2)
    return replace(inputs, pressure=np.maximum(inside - ATMOSPHERE, 0.0))


def _turning_camera(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """A camera sags on its stand: ends of parts are read against its frame, and seem to turn."""
    turned = effect["rate"] * _elapsed(conditions) / HOUR
    angle = np.where(prediction.bend_angle > 0.0, prediction.bend_angle, 1.0)
    per_degree = np.where(prediction.bend_angle > 0.0, prediction.curvature / angle, 0.0)
    return replace(
        prediction,
        curvature=prediction.curvature + turned * per_degree,
        bend_angle=prediction.bend_angle + turned,
    )


def _fingertip(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """The tip of what bends far meets the table's edge, and a share of its further way is lost."""
    away = _tip(prediction)
    beyond = np.maximum(away - EDGE, 0.0)
    return bent(prediction, 1.0 - effect["lost"] * beyond / np.maximum(away, EDGE))


def _tip(prediction: Prediction) -> Floats:
    """Return how far the tip of an arc has moved away from its straight line [mm]."""
    curvature = np.where(np.abs(prediction.curvature) > 1e-9, prediction.curvature, 1e-9)
    away: Floats = 1e3 * (1.0 - np.cos(np.radians(prediction.bend_angle))) / curvature
    return away


def _contact(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """Neighbouring chambers touch: what bends beyond that is partly lost."""
    beyond = np.maximum(prediction.curvature - TOUCHING, 0.0)
    share = 1.0 - effect["lost"] * beyond / np.maximum(prediction.curvature, TOUCHING)
    return bent(prediction, share)


def _softer(inputs: Inputs, factor: Floats) -> Inputs:
    return replace(inputs, c1=inputs.c1 * factor, c2=inputs.c2 * factor, c3=inputs.c3 * factor)


def _warm_day(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """The first actuator of each degradation rate was inflated on a warm day, and was softer."""
    warm = np.arange(conditions.pressure.shape[-2])[:, None] % 3 == 0
    return _softer(inputs, np.exp(-effect["softer"] * warm))


def _warm_spell(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Parts that were dug up last were tested on warm days: a share of their helices had melted.

    A gel's modulus goes with the square of the share of helices, which falls to none at melting.
    """
    warmer = np.where(conditions.degradation > SPELL, effect["warmer"], 0.0)
    return _softer(inputs, ((MELTING - COOL - warmer) / (MELTING - COOL)) ** 2)


HISTORY, ANY, BENT_FAR = ("history",), ("history", "angle"), ("curvature", "angle", "careful")

CONTACT = Cause(
    name="outside_contact",
    mechanism="chambers touch when the actuator is bent far",
    revealed_by="nothing in the catalogue",
    on_reading=_contact,
    **outside_effect("lost", "–", 0.4, Stage.READING),
)
WARM_DAY = Cause(
    name="outside_warm_day",
    mechanism="the first actuator of each degradation rate was inflated on a warm day",
    revealed_by="nothing in the catalogue",
    on_inputs=_warm_day,
    **outside_effect("softer", "–", 0.15, Stage.MATERIAL),
)
IMITATIONS: tuple[tuple[Cause, tuple[str, ...]], ...] = (
    (
        Cause(
            name="outside_stick_slip",
            mechanism="the regulator sticks and slips along its range, as hysteresis with a "
            "sawtooth",
            revealed_by="nothing in the catalogue",
            on_inputs=_stick_slip,
            **outside_effect("breakaway", "kPa", 16.0, Stage.LOAD),
        ),
        ANY,
    ),
    (
        Cause(
            name="outside_gauge_drift",
            mechanism="the gauge's zero sinks while it warms up, as creep that adds a pressure",
            revealed_by="nothing in the catalogue",
            on_inputs=_gauge_drift,
            **outside_effect("drift", "kPa", 10.0, Stage.LOAD),
        ),
        HISTORY,
    ),
    (
        Cause(
            name="outside_growing_leak",
            mechanism="a crack that leaks grows with cycles, as drying does with time",
            revealed_by="nothing in the catalogue",
            on_inputs=_growing_leak,
            **outside_effect("share", "–", 0.1, Stage.LOAD),
        ),
        HISTORY,
    ),
    (
        Cause(
            name="outside_turning_camera",
            mechanism="the camera turns slowly, as creep that does not grow with the load",
            revealed_by="nothing in the catalogue",
            on_reading=_turning_camera,
            **outside_effect("rate", "°/h", 6.0, Stage.READING),
        ),
        HISTORY,
    ),
    (
        Cause(
            name="outside_fingertip",
            mechanism="the tip of what bends far meets the edge of a table",
            revealed_by="nothing in the catalogue",
            on_reading=_fingertip,
            **outside_effect("lost", "–", 0.5, Stage.READING),
        ),
        BENT_FAR,
    ),
    (
        Cause(
            name="outside_warm_spell",
            mechanism="parts that were dug up last were tested on warm days, as if they had lost "
            "more than their rates say",
            revealed_by="nothing in the catalogue",
            on_inputs=_warm_spell,
            **outside_effect("warmer", "K", 5.0, Stage.MATERIAL),
        ),
        BENT_FAR,
    ),
    (CONTACT, BENT_FAR),
    (WARM_DAY, BENT_FAR),
)
"""Each with the designs in which it can show."""
