"""Pressure offset: the sensor's zero is off, or a valve opens only above a threshold.

Mechanism
    The pressure in the chambers is the reading minus a constant, and never below zero. The
    curvature is zeroed at a reading of zero pressure, whatever the true pressure is.

Equation
    p_true = max(p − δ, 0); the curvature read is κ(p_true) − κ(max(−δ, 0)).

Typical size
    4–30 kPa: zero shifts of small gauge sensors and cracking pressures of check valves, estimated.

Revealed by
    A shift along the pressure axis that is the same at every degradation rate; the curve starts
    late (δ > 0) or with a jump (δ < 0).

Refuted by
    Curvature that is proportional to pressure from the first step on.

Source
    doi:10.3389/frobt.2021.760485 for the pneumatic setup (pump, solenoid valve, pressure sensor);
    the size is estimated, not published.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Normal, Parameter


def shift_pressure(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at p − δ, with curvature zeroed at the true pressure of a zero reading."""
    offset = effect["offset"]
    return replace(
        inputs,
        pressure=np.maximum(inputs.pressure - offset, 0.0),
        reference_pressure=np.maximum(-offset, 0.0),
    )


CAUSE = Cause(
    name="pressure_offset",
    stage=Stage.LOAD,
    parameters=(
        Parameter("offset", Normal(0.0, 10.0), "kPa", "pressure read minus that in chambers", 0.0),
    ),
    mechanism="the pressure in the chambers is lower (or higher) than the reading by a constant: "
    "a zero error of the sensor, or the threshold of a valve",
    typical={"offset": 14.0},
    revealed_by="the curve starts late or with a jump, by the same pressure at every degradation "
    "rate; refuted by curvature proportional to pressure from the first step on",
    confusable_with=("humidity_drift",),
    on_inputs=shift_pressure,
)
