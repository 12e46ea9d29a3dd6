"""Film mismatch: the cast actuator is stiffer or softer than the cast films.

Mechanism
    A thick wall gels, cures and dries more slowly than a film of half a millimetre, and its chains
    are oriented less. Its stiffness differs from that of the films at the same degradation rate.

Equation
    All constants of the actuator are exp(x) times those of the films.

Typical size
    x of ±0.1, an assumption: moduli of gelatin films vary by tens of percent with gelling and
    drying, and films and actuators of one mixture, cured and conditioned alike, are taken to
    differ by less. Three standard deviations, and evidence, cover larger differences. Below
    x = −0.05 a fresh default actuator is so near ballooning at 240 kPa that the emulator refuses
    this step.

Revealed by
    A ratio of curvatures that is the same at every pressure (except for the paper's
    share) and degradation rate; a film cut from an actuator.

Refuted by
    Films cut from an actuator's wall that agree with cast ones. Curvature alone cannot tell it from
    a gauge that is off by a factor, since curvature depends on p/C1 only, nor, at low pressure,
    from a leak.

Source
    Bigi, Panzavolta, Rubini (2004), Biomaterials 25:5675, for stiffness of gelatin films against
    their structure after drying; doi:10.3389/frobt.2021.760485 for how films and actuators were
    made.
"""

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage, scaled_stiffness
from bayesdeg.priors import Normal, Parameter


def stiffen_casting(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with all constants times exp(x)."""
    return scaled_stiffness(inputs, np.exp(effect["log_ratio"]))


CAUSE = Cause(
    name="film_mismatch",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "log_ratio",
            Normal(0.0, 0.1),
            "–",
            "ln of the ratio of the actuator's stiffness to that of the films",
            0.0,
        ),
    ),
    mechanism="the cast actuator is stiffer or softer than the films",
    typical={"log_ratio": 0.12},
    revealed_by="a constant ratio at every pressure and degradation rate; refuted by films cut "
    "from an actuator that agree with cast ones",
    confusable_with=("pressure_loss", "gauge_gain", "wall_thickness", "shrinkage_reading"),
    twins=("gauge_gain",),
    on_inputs=stiffen_casting,
)
