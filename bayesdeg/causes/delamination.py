r"""Delamination: the paper detaches from the bottom, further at higher degradation.

Mechanism
    The paper is bonded by the material that degrades. The bond fails inwards from the free end, the
    clamp and the edges; there, the paper no longer holds the slots closed.

Equation
    Partly bonded paper acts like paper in series with a compliance,
    1/(E t)' = 1/(E t) + ρ (D/25 %)³/(C1 s h), with s the linear scale and h = 5 mm.

Typical size
    In the finite element model, ρ at 25 % is 0.2 to 0.3 where 30 % of the length is detached from
    one end, 0.9 to 1.0 at 50 % and 2.1 to 2.4 at 60 %; it is 0.5 where 60 % is detached from the
    edges. The end wall and the chamber next to it need no paper, hence the third power where the
    detached length grows with the degradation rate. At 25 % and ρ = 1 the default actuator bends
    some 8 % further at 40 kPa and 7 % at 200 kPa; a body without slots bends less instead. The
    emulator is trained down to E t/(C1 s) = 2.5 mm, where the prior ends: at 25 %, ρ = 1.7. Half
    of the prior has less than a third of the length detached, and 5 % more than half of it, ρ = 1:
    whoever mounts the actuator would see that.

Revealed by
    More curvature than simulated, growing steeply with the degradation rate and falling a little
    with pressure, none of it in fresh specimens. Softened paper has the same effect on every
    reading: only inspection of the bottom, or a test of the peeled paper, tells them apart.

Refuted by
    Paper of a degraded actuator that is fully bonded.

Source
    Hutchinson and Suo (1991), doi:10.1016/S0065-2156(08)70164-9, for layers that detach from their
    edges. The rule is fitted to the finite element model (docs/method/rules.md), the only
    source of the numbers above; how far paper detaches is estimated.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_degraded, without_membrane
from bayesdeg.causes.cause import REFERENCE_DEGRADATION, Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal

HALF_HELD = 5.0
"""E t/(C1 s) of paper that has half the effect of stiff paper on the default actuator [mm].

In the finite element model, soft paper changes a small curvature by h/(h + E t/(C1 s)) times what
stiff paper does, with h from 4.2 mm at 25 % to 5.1 mm fresh.
"""

GROWTH = 3.0
"""Power of the degradation rate with which the compliance grows [–].

The detached share f is proportional to the rate: it removes about (f − 0.2)/0.6 of the paper's
effect, and the compliance is the odds of that, which is steeper than a square.
"""


def loosen_paper(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the paper in series with a compliance ρ (D/25 %)³/(C1 s h)."""
    size = effect["looseness"] * (conditions.degradation / REFERENCE_DEGRADATION) ** GROWTH
    held = 1e3 * inputs.c1 * inputs.linear_scale * HALF_HELD  # N/m
    lost = 1.0 + size * inputs.paper_stiffness / held
    return replace(inputs, paper_stiffness=inputs.paper_stiffness / lost)


CAUSE = Cause(
    name="delamination",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "looseness",
            TruncatedNormal(0.0, 0.5, 0.0, 1.7),
            "–",
            "effect of stiff paper lost over that kept, at a degradation rate of 25 %",
            0.0,
        ),
    ),
    mechanism="the paper detaches from the bottom, further at higher degradation",
    typical={"looseness": 1.0},
    revealed_by="more curvature than simulated, growing steeply with the degradation rate; "
    "refuted by a degraded actuator whose paper is fully bonded",
    confusable_with=("paper_softening", "erosion", "degradation_misread"),
    twins=("paper_softening",),
    on_inputs=loosen_paper,
    blind=without_degraded,
    blind_in=without_membrane,
    of_degradation=True,
)
