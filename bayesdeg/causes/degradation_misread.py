"""Degradation misread: the recorded degradation rates of the actuators are wrong.

Mechanism
    The degradation rate is measured on a film or an offcut, not on the actuator itself. Degraded
    specimens may all be more (or less) degraded than recorded, and scatter by more than the stated
    error. Fresh specimens were never buried: their rate is zero by definition and is not changed.

Equation
    D = D_recorded + Δ and sd(D) = √(sd² + σ²) where D_recorded > 0.5 %.

Typical size
    1–4 points; stiffness changes by 5–9 % per point (the published moduli at 0 and 25 %).

Revealed by
    A ratio of curvatures that is constant in pressure at small strain, of either sign, absent in
    fresh specimens; a scatter between specimens that grows with the slope of stiffness.

Refuted by
    The same misfit in fresh specimens; moisture of the actuators' own material; specimens of one
    level that deviate together, as in a batch (`bayesdeg.criticism.checks.shared_scatter`).

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, who name it as the cause.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.causes.blindness import FRESH, without_degraded
from bayesdeg.causes.cause import Cause, Conditions, Degradation, Effect, Stage
from bayesdeg.priors import Normal, Parameter, TruncatedNormal


def misread(degradation: Degradation, conditions: Conditions, effect: Effect) -> Degradation:
    """Return degradation rates shifted by Δ and scattered by σ, except of fresh specimens."""
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
        Parameter("shift", Normal(0.0, 2.5), "%", "true minus recorded degradation rate", 0.0),
        Parameter(
            "scatter",
            TruncatedNormal(0.0, 1.5, 0.0, np.inf),
            "%",
            "scatter between specimens beyond the stated error",
            0.0,
        ),
    ),
    mechanism="the degraded actuators are more (or less) degraded than recorded",
    typical={"shift": 3.0, "scatter": 1.0},
    revealed_by="a ratio constant in pressure, absent in fresh specimens; refuted by the same "
    "misfit in fresh specimens or by moisture of the actuators' own material",
    confusable_with=("degradation_scale", "degraded_skin", "erosion", "film_mismatch"),
    on_degradation=misread,
    blind=without_degraded,
    of_degradation=True,
)
