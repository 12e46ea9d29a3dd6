"""Degradation misread: a specimen's degradation rate is not the one recorded.

Mechanism
    The degradation rate is read from the moisture of a film or an offcut, not from the actuator
    itself. Degraded specimens may all be further (or less far) degraded than recorded, and differ
    from one another by more than the stated error. Fresh specimens were never in the soil: their
    rate is zero by definition and is not touched.

Equation
    D = D_recorded + Δ and sd(D) = √(sd² + σ²) where D_recorded > 0.5 %.

Typical size
    1–4 points; the stiffness changes by 5–9 % a point (the published moduli at 0 and 25 %).

Revealed by
    A ratio of curvatures that is constant in pressure at small strain, of either sign, absent in
    fresh specimens; a scatter between specimens that grows with the slope of stiffness.

Refuted by
    The same misfit in fresh specimens, moisture of the actuators' own material, or specimens of one
    rate that deviate together, as those of a batch do (`bayesdeg.criticism.checks.shared_scatter`).

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, who name it as the cause.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.causes.blindness import FRESH, without_degraded
from bayesdeg.causes.cause import Cause, Conditions, Degradation, Effect, Stage
from bayesdeg.priors import Normal, Parameter, TruncatedNormal


def misread(degradation: Degradation, conditions: Conditions, effect: Effect) -> Degradation:
    """Return degradation rates shifted by Δ and scattered by σ, fresh specimens excepted."""
    degraded = (conditions.degradation > FRESH).astype(np.float64)
    return replace(
        degradation,
        value=degradation.value + effect["shift"] * degraded,
        sd=np.hypot(degradation.sd, effect["scatter"] * degraded),
    )


CAUSE = Cause(
    name="degradation_misread",
    stage=Stage.DEGRADATION,
    parameters=(
        Parameter("shift", Normal(0.0, 2.5), "%", "true less recorded degradation rate", 0.0),
        Parameter(
            "scatter",
            TruncatedNormal(0.0, 1.5, 0.0, np.inf),
            "%",
            "scatter beyond the stated error",
            0.0,
        ),
    ),
    mechanism="the degraded actuators are further (or less far) degraded than recorded",
    typical={"shift": 3.0, "scatter": 1.0},
    revealed_by="a ratio constant in pressure, absent in fresh specimens; refuted by the same "
    "misfit in fresh specimens or by moisture of the actuators' own material",
    confusable_with=("degradation_scale", "degraded_skin", "erosion", "film_mismatch"),
    on_degradation=misread,
    blind=without_degraded,
    of_degradation=True,
)
