r"""Delamination: the paper comes off the bottom, further where more has degraded.

Mechanism
    What bonds the paper is the material that degrades. It lets go from the free end, the clamp and
    the edges inwards, and over that part of the bottom the paper no longer holds the slots.

Equation
    Paper that is bonded in part is as paper in series with a compliance,
    1/(E t)' = 1/(E t) + ρ (D/25 %)³/(C1 s h), with s the linear scale and h = 5 mm.

Typical size
    In the finite element model ρ at 25 % is 0.2 to 0.3 where 30 % of the length is off, from one
    end, 0.9 to 1.0 at 50 % and 2.1 to 2.4 at 60 %, and 0.5 at 60 % off from the edges. The end
    wall and the chamber next to it need no paper, hence the third power where the part that is off
    grows with the degradation rate. At 25 % and ρ = 1 the default actuator bends some 8 % further
    at 40 kPa and 7 % at 200 kPa; a body without slots bends less instead. The emulator is trained
    down to E t/(C1 s) = 2.5 mm, where the prior ends: at 25 %, ρ = 1.7. By the prior half of what
    comes off is less than a third of the length, and 5 % more than half of it, ρ = 1: who mounts
    an actuator would see that.

Revealed by
    More curvature than simulated, growing steeply with the degradation rate and falling a little
    with pressure, none of it in fresh specimens. Paper that has softened does the same to any
    reading: only a look at the bottom, or a test of the paper peeled off, can tell them apart.

Refuted by
    Paper of a degraded actuator that is bonded all over.

Source
    Hutchinson and Suo (1991), doi:10.1016/S0065-2156(08)70164-9, for layers that come off from
    their edges. The rule is fitted to the finite element model (docs/method/rules.md), the only
    source of the numbers above; how far paper comes off is estimated.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_degraded, without_membrane
from bayesdeg.causes.cause import REFERENCE_DEGRADATION, Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal

HALF_HELD = 5.0
"""E t/(C1 s) of paper that holds the default actuator half as much as stiff paper does [mm].

In the finite element model the change of a small curvature by soft paper is that of stiff paper
times h/(h + E t/(C1 s)), with h from 4.2 mm at 25 % to 5.1 mm fresh.
"""

GROWTH = 3.0
"""Power of the degradation rate with which the compliance grows [–].

Of the part that is off, f, in proportion to the rate: what it takes from the paper is about
(f − 0.2)/0.6, and the compliance has the odds of that, which is steeper than a square.
"""


def loosen_paper(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the paper in series with a compliance of ρ (D/25 %)³/(C1 s h)."""
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
            "hold of the paper lost over hold kept, of stiff paper at a degradation rate of 25 %",
            0.0,
        ),
    ),
    mechanism="the paper comes off the bottom, further where more has degraded",
    typical={"looseness": 1.0},
    revealed_by="more curvature than simulated, growing steeply with the degradation rate; "
    "refuted by paper that is bonded all over a degraded actuator",
    confusable_with=("paper_softening", "erosion", "degradation_misread"),
    twins=("paper_softening",),
    on_inputs=loosen_paper,
    blind=without_degraded,
    blind_in=without_membrane,
    of_degradation=True,
)
