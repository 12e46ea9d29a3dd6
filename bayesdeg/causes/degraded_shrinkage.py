"""Degraded shrinkage: a part shrinks as it degrades, which the simulation ignores.

Mechanism
    Degradation removes dry mass, and what is left holds less water. If the loss is uniform, the
    part keeps its shape and gets smaller. Mass lost from the faces alone thins the walls instead
    (``erosion``): both draw on the same lost mass. The paper is assumed to follow, as in the
    shrinkage after moulding; it keeps its stiffness per width and its thickness.

Equation
    V = V_0 (1 − v D/25 %), so the linear scale is s (1 − v D/25 %)^(1/3), with v the share of the
    volume that is lost at 25 %. A part of the same shape bends by the same angle over a shorter
    length: the curvature scales with 1/s; the angle is unchanged but for the paper's share.

Typical size
    v = 0.31, nearly known. In a part with moisture content M_0 = 20 % (wet basis) a rate of 25 %
    leaves M_C = 15 %, in dry matter X = M/(1 − M): 0.25 → 0.176. On that basis the rate is 29.4 %,
    of which Eq. 6 takes 0.8574 as dry mass: 25.2 %. With ρ = 1.32 g/cm³ for the dry matter (2 parts
    gelatin, 1 part glycerol) V = m (1/ρ + X/ρ_w) falls by 30.7 %, the linear scale to 0.885, and
    curvature grows by 13 %. M_0 = 10–30 % gives 26–36 %; rates already on the dry basis
    give 24–28 %. Uniform loss is an assumption, so the prior is 0.3 ± 0.15 and reaches 0.

Revealed by
    More curvature than simulated, growing with the degradation rate and equal at all pressures,
    while the bend angle fits; none of it in fresh specimens. A calliper shows it.

Refuted by
    The same misfit in the bend angle; degraded parts as long as fresh ones.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485: Eqs 3–6 for mass and moisture,
    Eq. 7 for the volume that follows; densities of dry gelatin 1.27–1.44 and glycerol 1.26 g/cm³.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_degraded
from bayesdeg.causes.cause import REFERENCE_DEGRADATION, Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal

LEAST_VOLUME = 0.1
"""Lower bound on the remaining volume fraction; it matters far beyond the films' rates only [–]."""


def shrink_as_degraded(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the linear scale times (1 − v D/25 %)^(1/3).

    Rates below 0, which are scatter, do not enlarge the part.
    """
    rate = np.maximum(conditions.degradation, 0.0) / REFERENCE_DEGRADATION
    kept = np.maximum(1.0 - effect["lost_volume"] * rate, LEAST_VOLUME)
    return replace(inputs, linear_scale=inputs.linear_scale * np.cbrt(kept))


CAUSE = Cause(
    name="degraded_shrinkage",
    stage=Stage.GEOMETRY,
    parameters=(
        Parameter(
            "lost_volume",
            TruncatedNormal(0.3, 0.15, 0.0, 0.6),
            "–",
            "share of the volume lost at a degradation rate of 25 %",
            0.0,
        ),
    ),
    mechanism="a part shrinks as it degrades, which the simulation ignores",
    typical={"lost_volume": 0.31},
    revealed_by="more curvature than simulated, growing with the degradation rate, that the bend "
    "angle does not show; refuted by degraded parts as long as fresh ones",
    confusable_with=("degradation_misread", "degradation_scale", "erosion", "delamination"),
    on_inputs=shrink_as_degraded,
    blind=without_degraded,
    of_degradation=True,
)
