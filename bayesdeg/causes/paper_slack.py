"""Paper slack: cockled or partly debonded paper carries load late.

Mechanism
    Paper that dried together with the gel is wavy, or has detached in places. It must be pulled
    straight before it carries load.

Equation
    Hardly any load at strains below ε_s, the full stiffness far beyond:
    energy k (q²/2 − ε_s² ln cosh(q/ε_s)), q the strain of the paper, in the finite element model.

Typical size
    Waves of amplitude A and length L have the excess length (π A/L)²: 0.1 mm on 3 mm make 1 %,
    0.2 mm 4 %. Curvature of the default actuator changes by +13 % at 20 kPa, +1 % at 240 kPa in a
    fresh specimen, +18 % to +8 % at a degradation rate of 25 %. The emulator is trained up to 5 %.

Revealed by
    A misfit that is largest at low pressure and fades as the paper is pulled straight, later in
    stiff specimens than in soft ones.

Refuted by
    Flat, fully bonded paper; a misfit that grows with pressure.

Source
    Alava and Niskanen (2006), Rep. Prog. Phys. 69:669, doi:10.1088/0034-4885/69/3/R03, for paper
    that cockles; the size is estimated.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_membrane
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def slacken_paper(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the paper's slack increased by ε_s."""
    before = 0.0 if inputs.paper_slack is None else inputs.paper_slack
    return replace(inputs, paper_slack=before + effect["slack"])


CAUSE = Cause(
    name="paper_slack",
    stage=Stage.GEOMETRY,
    parameters=(
        Parameter(
            "slack",
            TruncatedNormal(0.0, 0.015, 0.0, 0.05),
            "–",
            "strain below which the paper carries hardly any load",
            0.0,
        ),
    ),
    mechanism="the paper is cockled or partly debonded and carries load only once pulled straight",
    typical={"slack": 0.01},
    revealed_by="a misfit that is largest at low pressure and fades, later in stiff specimens; "
    "refuted by flat, fully bonded paper",
    confusable_with=("pressure_offset", "film_mismatch"),
    on_inputs=slacken_paper,
    blind_in=without_membrane,
)
