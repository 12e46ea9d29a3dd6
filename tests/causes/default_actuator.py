"""The default actuator as the shipped emulator sees it, for causes at their typical sizes."""

from functools import cache

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Conditions
from bayesdeg.surrogate.trained import default_surrogate

LOADING = np.arange(20.0, 241.0, 20.0)
THERE_AND_BACK = np.concatenate([LOADING, LOADING[-2::-1]])
LEVELS = np.array([[0.0], [5.0], [10.0], [15.0], [20.0], [25.0]])
FRESH, DEGRADED = np.array([0.288, -0.004, 0.0012]), np.array([1.588, -0.149, 0.1175])
SCALE, PAPER = 0.853, 3e4


@cache
def surrogate():
    return default_surrogate()


def constants_at(degradation):
    """C1 and C3 by their logarithms, C2/√(3 C1 C3) linearly, between 0 and 25 %; (..., 3)."""
    share = np.asarray(degradation, float) / 25.0
    c1, c3 = (FRESH[i] ** (1.0 - share) * DEGRADED[i] ** share for i in (0, 2))
    fresh, degraded = (c[1] / np.sqrt(3.0 * c[0] * c[2]) for c in (FRESH, DEGRADED))
    softening = (1.0 - share) * fresh + share * degraded
    return np.stack([c1, softening * np.sqrt(3.0 * c1 * c3), c3], axis=-1)


def inputs_of(pressure=LOADING, degradation=LEVELS):
    """Inputs of a base model for one walker: (1, specimens, pressures)."""
    c1, c2, c3 = np.moveaxis(constants_at(degradation), -1, 0)[:, None]
    one = np.ones((1, 1, 1))
    return Inputs(
        np.broadcast_to(pressure, (1, 1, np.shape(pressure)[-1])),
        c1,
        c2,
        c3,
        SCALE * one,
        PAPER * one,
        paper_thickness=0.1 * one,
    )


def conditions_of(pressure=LOADING, degradation=LEVELS, hold=30.0, **recorded):
    """A reading every ``hold`` seconds."""
    pressure = np.broadcast_to(pressure, (len(degradation), np.shape(pressure)[-1]))
    time = hold * np.arange(pressure.shape[1])
    return Conditions(pressure, degradation, time=time, **recorded)


def effect(**values):
    return {name: np.reshape(value, (-1, 1, 1)) for name, value in values.items()}


def typical(cause):
    return effect(**cause.typical)


def change(cause, inputs, conditions, values=None):
    """Change of the curvature in percent, (specimens, pressures)."""
    before = surrogate()(inputs).curvature
    after = surrogate()(cause.on_inputs(inputs, conditions, values or typical(cause))).curvature
    return (100.0 * (after / before - 1.0))[0]
