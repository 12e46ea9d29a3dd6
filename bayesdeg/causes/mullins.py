"""Mullins effect: after a large stretch the material is softer below it.

Mechanism
    The first loading breaks weak bonds. Up to the largest load so far the material is softer from
    then on; beyond it, it follows the curve of a first loading.

Equation
    With q the load that a specimen never stretched would need for the same shape and q_m the
    largest so far, p = η q with η = 1 − b (1 − q/q_m): softened by b at small loads and not at all
    at the largest, like the factor of Ogden and Roxburgh. Solved for q:
    q = 2 p / (1 − b + √((1 − b)² + 4 b p/q_m)). The paper is taken to soften alike.

Typical size
    b = 0.05–0.3 in weakly filled elastomers; assumed for the gel. q never exceeds q_m, so whatever
    the size the emulator's range is not left.

Revealed by
    Unloading and later cycles above the first loading, and back on it beyond its largest pressure,
    however long or short the holds.

Refuted by
    A second loading that repeats the first; a lag on unloading that a wait undoes.

Source
    Ogden and Roxburgh (1999), Proc. R. Soc. A 455:2861, doi:10.1098/rspa.1999.0431.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Floats, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def soften_below_largest(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at the load that material never stretched would need for the same shape."""
    ratio = ratio_to_largest(inputs.pressure)
    b = effect["softening"]
    gain = 2.0 / (1.0 - b + np.sqrt((1.0 - b) ** 2 + 4.0 * b * ratio))
    return replace(inputs, pressure=inputs.pressure * np.where(ratio < 1.0, gain, 1.0))


def ratio_to_largest(pressure: Floats) -> Floats:
    """Return pressures over the largest on the specimen so far; 1 where there was none yet.

    Examples
    --------
    >>> ratio_to_largest(np.array([[0.0, 40.0, 20.0, 80.0]])).tolist()
    [[1.0, 1.0, 0.5, 1.0]]
    """
    largest = np.maximum.accumulate(pressure, axis=-1)
    ratio: Floats = np.where(largest > 0.0, pressure / np.where(largest > 0.0, largest, 1.0), 1.0)
    return ratio


def first_loading_only(conditions: Conditions) -> str | None:
    """Say so where no actuator was read below a pressure that it had met before."""
    pressure = conditions.pressure
    again = (pressure > 0.0) & (ratio_to_largest(pressure) < 1.0)
    return None if np.any(again) else "no reading after the first loading"


CAUSE = Cause(
    name="mullins",
    stage=Stage.RESPONSE,
    parameters=(
        Parameter(
            "softening",
            TruncatedNormal(0.0, 0.15, 0.0, 0.9),
            "–",
            "share of the stiffness at small loads that a larger load takes away",
            0.0,
        ),
    ),
    mechanism="the first loading softens the material up to the largest pressure it reached",
    typical={"softening": 0.2},
    revealed_by="unloading and later cycles above the first loading, whatever the holds; refuted "
    "by a second loading that repeats the first",
    confusable_with=("creep",),
    on_inputs=soften_below_largest,
    blind=first_loading_only,
)
