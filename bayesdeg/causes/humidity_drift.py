"""Humidity drift: the part dries and stiffens during its test.

Mechanism
    Parts are stored at 67 % relative humidity and tested at about 60 %. From the specimen's first
    reading on, it loses water, which softens the gel.

Equation
    ln stiffness grows by a m(t) with τ dm/dt = (67 % − RH)/(67 % − 60 %) − m and m(0) = 0. Where
    the humidity of the room was recorded, RH is that, held from the previous reading to its own;
    where it was not, RH = 60 % and m = 1 − exp(−t/τ). Gel and paper are assumed to stiffen alike,
    so the actuator bends as under p exp(−a m).

Typical size
    Stiffness 1.02–1.13 times within 10–30 minutes, assumed; a is the final effect of 7 points of
    humidity. It lowers the load, so typical sizes stay within the emulator's range. Diffusion
    through the walls of the default actuator, at 1e-11 m²/s, adds 0.02 to ln stiffness within
    50 min where 0.15 is reached in the end, with τ = 955 s; the rule misses 15 % of that effect
    (`benchmarks/rules.py`). A larger drift points to thin parts or to a different cause.

Revealed by
    Loss of curvature that grows with the time since the first reading, in fresh specimens too; less
    bending when a pressure is read again later; a larger effect in a drier room.

Refuted by
    The same curvature at the same pressure half an hour later; a room as humid as the storage.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, for the humidities; Lim, Mine,
    Tung (1999), J. Food Sci. 64:616, for gelatin films against humidity.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_time
from bayesdeg.causes.cause import Cause, Conditions, Effect, Floats, Stage
from bayesdeg.causes.history import (
    SAME_HUMIDITY,
    STORED_HUMIDITY,
    TESTED_HUMIDITY,
    filled,
    known_time,
    lagging,
)
from bayesdeg.causes.history import dryness as dryness_at
from bayesdeg.priors import LogNormal, Parameter, TruncatedNormal


def dry_out(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at p exp(−a m): stiffening of gel and paper alike."""
    steps = np.diff(dryness(conditions), axis=-1, prepend=0.0)
    dried = lagging(steps, known_time(conditions), effect["time_constant"])
    return replace(inputs, pressure=inputs.pressure * np.exp(-effect["stiffening"] * dried))


def dryness(conditions: Conditions) -> Floats:
    """Return (67 % − RH)/(67 % − 60 %) at each reading [–], (n_specimens, n_points).

    Examples
    --------
    >>> pressure, fresh = np.array([[20.0, 40.0]]), np.array([[0.0]])
    >>> dryness(Conditions(pressure, fresh, humidity=np.array([[67.0, 46.0]]))).tolist()
    [[0.0, 3.0]]
    """
    return dryness_at(filled(conditions.humidity, TESTED_HUMIDITY))


def never_drier(conditions: Conditions) -> str | None:
    """Say so where no time was recorded, or the room was always as humid as the storage."""
    if np.all(np.abs(dryness(conditions)) * (STORED_HUMIDITY - TESTED_HUMIDITY) < SAME_HUMIDITY):
        return f"the room was as humid as the storage, {STORED_HUMIDITY:g} %"
    return without_time(conditions)


CAUSE = Cause(
    name="humidity_drift",
    stage=Stage.RESPONSE,
    parameters=(
        Parameter(
            "stiffening",
            TruncatedNormal(0.0, 0.1, 0.0, 1.0),
            "–",
            "final gain in ln stiffness where the humidity fell from 67 to 60 %",
            0.0,
        ),
        Parameter("time_constant", LogNormal(900.0, 0.7), "s", "time constant of drying", 900.0),
    ),
    mechanism="the part dries and stiffens during its test",
    typical={"stiffening": 0.15, "time_constant": 900.0},
    revealed_by="loss of curvature that grows with time, in fresh specimens too; refuted by the "
    "same curvature at the same pressure half an hour later",
    confusable_with=("creep", "pressure_offset", "curvature_reading"),
    needs=("time_s",),
    on_inputs=dry_out,
    blind=never_drier,
)
