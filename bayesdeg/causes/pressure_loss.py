"""Pressure loss: a leak between sensor and chambers.

Mechanism
    Air flows through a leak, and the tubing between sensor and actuator takes a share of the
    pressure, so that the chambers get a fraction of what is read.

Equation
    p_true = (1 − φ) p.

Typical size
    0–20 %: estimated from the flow resistance of thin tubing against a slow leak. A leak only takes
    away; a gauge that is off either way is ``gauge_gain``.

Revealed by
    A loss of curvature that is a constant ratio in pressure, at every degradation rate. From
    curvature alone it cannot be told from a stiffer casting (``film_mismatch``), since the
    curvature depends on p/C1 alone; blocked force or a second pressure sensor can.

Refuted by
    A pressure sensor at the far end of the chambers that reads the same.

Source
    doi:10.3389/frobt.2021.760485 for the pneumatic setup; the size is estimated, not published.
"""

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage, scaled_pressure
from bayesdeg.priors import Parameter, TruncatedNormal


def lose_pressure(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at (1 − φ) p."""
    return scaled_pressure(inputs, 1.0 - effect["fraction"])


CAUSE = Cause(
    name="pressure_loss",
    stage=Stage.LOAD,
    parameters=(
        Parameter(
            "fraction",
            TruncatedNormal(0.0, 0.1, 0.0, 0.9),
            "–",
            "fraction of the pressure read that is lost before the chambers",
            0.0,
        ),
    ),
    mechanism="a leak: the pressure in the chambers is a fraction of that read",
    typical={"fraction": 0.1},
    revealed_by="a loss of curvature in constant ratio to pressure at every degradation rate; "
    "refuted by a second sensor at the far end",
    confusable_with=("film_mismatch", "gauge_gain", "wall_thickness", "shrinkage_reading"),
    on_inputs=lose_pressure,
)
