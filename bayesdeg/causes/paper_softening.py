"""Paper softening: paper buried in wet soil becomes extensible.

Mechanism
    The paper on the bottom is assumed as stiff as when it was bonded. When wet, its fibre bonds
    loosen and microbes cut the fibres, so the bottom stretches with the rest of the actuator.

Equation
    E t = (E t)_0 exp(−a (D/25 %)^n), n = 1 if paper and gel degrade together.

Typical size
    Wet paper keeps 2–5 % of its dry stiffness, a = 3–4; after drying most returns, a = 0–2. The
    default actuator bends by its slots alone: its curvature gets *larger* by 9–11 % at 25 % for
    a = 2.1, a little more at low pressure. A body without slots bends only because of the paper and
    loses most of its curvature instead. The emulator is trained down to E t/(C1 s) = 2.5 mm: at
    25 % and the nominal paper that is a = 2.1; a specimen beyond it is refused. Fibres cut at a
    constant rate, while the degradation rate tends to some 30 %, soften as with n = 1.4 to 2.1;
    bonds opened by water within hours, as with n near 0.

Revealed by
    A misfit that grows with the degradation rate and is absent in fresh specimens; unlike that of
    thinner walls, it falls a little with pressure.

Refuted by
    A tensile test of paper peeled off a degraded actuator.

Source
    Alava and Niskanen (2006), Rep. Prog. Phys. 69:669, doi:10.1088/0034-4885/69/3/R03, for paper
    and water.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_degraded, without_membrane
from bayesdeg.causes.cause import GROWTH, Cause, Conditions, Effect, Stage, grown
from bayesdeg.priors import Parameter, TruncatedNormal


def soften_paper(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the paper's stiffness times exp(−a (D/25 %)^n)."""
    exponent = effect["softening"] * grown(conditions, effect)
    return replace(inputs, paper_stiffness=inputs.paper_stiffness * np.exp(-exponent))


CAUSE = Cause(
    name="paper_softening",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "softening",
            TruncatedNormal(0.0, 0.8, 0.0, 4.0),
            "–",
            "ln of the ratio of fresh to degraded paper stiffness at a degradation rate of 25 %",
            0.0,
        ),
        GROWTH,
    ),
    mechanism="the paper on the bottom softens in the wet soil and stretches",
    typical={"softening": 1.5, "growth": 1.0},
    revealed_by="a misfit that grows with the degradation rate and falls a little with pressure; "
    "refuted by a tensile test of the peeled paper",
    confusable_with=("delamination", "degradation_misread", "degraded_skin", "erosion"),
    twins=("delamination",),
    on_inputs=soften_paper,
    blind=without_degraded,
    blind_in=without_membrane,
    of_degradation=True,
)
