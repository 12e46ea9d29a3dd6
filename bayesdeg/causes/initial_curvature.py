"""Initial curvature: drying against the paper bent the actuator before it was pressurised.

Mechanism
    The gel keeps shrinking after the paper was bonded; the paper does not. At rest the part is bent
    away from the paper and under stress. Readings are relative to that shape, so only the changed
    stiffness of a bent and stressed part remains.

Equation
    The body's stress-free lengths are 1/(1 + ε_m) of the paper's, in the finite element model; the
    curvature read is κ(p) − κ(0).

Typical size
    The shape at rest has −3.0 1/m for each percent of ε_m in a fresh, −2.3 1/m in a 25 % degraded
    specimen (default actuator), so the observed 1–10 1/m are ε_m = 0.3–3 %. The readings change by
    0.5–0.9 % for each percent only: hardly visible without a reading at rest. The emulator is
    trained from −2 to 3 %, where the prior ends.

Revealed by
    A picture of the actuator at rest; otherwise a slope that differs by a percent, at every
    degradation rate.

Refuted by
    An actuator that is straight at rest.

Source
    Timoshenko (1925), J. Opt. Soc. Am. 11:233, doi:10.1364/JOSA.11.000233, for bending of layers
    that shrink differently; the factors are those of the finite element model.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_membrane
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def shrink_on_paper(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs whose body shrank by ε_m more after the paper was bonded."""
    before = 0.0 if inputs.paper_mismatch is None else inputs.paper_mismatch
    return replace(inputs, paper_mismatch=before + effect["mismatch"])


CAUSE = Cause(
    name="initial_curvature",
    stage=Stage.GEOMETRY,
    parameters=(
        Parameter(
            "mismatch",
            TruncatedNormal(0.0, 0.015, -0.02, 0.03),
            "–",
            "shrinkage strain of the gel after the paper was bonded",
            0.0,
        ),
    ),
    mechanism="the gel shrank against the paper: the actuator is bent and stressed at rest",
    typical={"mismatch": 0.02},
    revealed_by="a picture at rest; readings change by a percent or so; refuted by an actuator "
    "that is straight at rest",
    confusable_with=("film_mismatch", "wall_thickness", "shrinkage_reading"),
    on_inputs=shrink_on_paper,
    blind_in=without_membrane,
)
