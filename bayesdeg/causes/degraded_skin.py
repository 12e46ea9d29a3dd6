"""Degraded skin: degradation starts at exposed surfaces, so the skin is stiffer than the mean.

Mechanism
    Microbial attack and loss of glycerol work inwards from the faces that touch the soil. Moisture
    content is a mean over the wall: the outer layer is more degraded and stiffer than the mean, the
    core less.

Equation
    ln(stiffness of a surface / mean) = s D/25 %, falling off inwards by e in 0.5 mm, with the
    volume mean of the logarithm kept.

Typical size
    Surfaces up to twice as stiff as the mean at 25 %, s = 0.7: curvature −4 % at 25 %. The emulator
    is trained up to s D/25 % = 1.2, where the prior ends. Diffusion with reaction that reaches 1 mm
    deep requires s = 2.4, of whose effect the rule misses 14 % (`benchmarks/rules.py`).

Revealed by
    A loss of curvature that grows with the degradation rate and is absent in fresh specimens; it is
    small, so only many specimens show it.

Refuted by
    The same stiffness in samples cut from the skin and from the core.

Source
    von Burkersroda, Schedl, Göpferich (2002), Biomaterials 23:4221,
    doi:10.1016/S0142-9612(02)00170-9, on when degradation starts at surfaces; the size is
    estimated from the published moduli, doi:10.3389/frobt.2021.760485.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_degraded
from bayesdeg.causes.cause import REFERENCE_DEGRADATION, Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def stiffen_skin(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the skin's contrast raised by s D/25 %."""
    contrast = effect["skin_stiffening"] * conditions.degradation / REFERENCE_DEGRADATION
    return replace(inputs, skin=contrast + (0.0 if inputs.skin is None else inputs.skin))


CAUSE = Cause(
    name="degraded_skin",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "skin_stiffening",
            TruncatedNormal(0.0, 0.7, 0.0, 1.2),
            "–",
            "ln of the ratio of surface to mean stiffness at a degradation rate of 25 %",
            0.0,
        ),
    ),
    mechanism="the exposed surfaces are more degraded, and stiffer, than the wall's mean",
    typical={"skin_stiffening": 0.7},
    revealed_by="a small loss of curvature that grows with the degradation rate; refuted by "
    "equal stiffness of samples from skin and core",
    confusable_with=("degradation_misread", "erosion", "paper_softening"),
    on_inputs=stiffen_skin,
    blind=without_degraded,
    of_degradation=True,
)
