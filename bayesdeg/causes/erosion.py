"""Erosion: walls get thinner as the material is lost to the soil.

Mechanism
    Degradation removes dry mass, about 0.86 points of it for each point of D_R, part of it from the
    outer faces and the slots, while the simulation keeps the geometry of the fresh part.

Equation
    Thickness lost from every exposed face, at moulded size: e · 2 mm · (D/25 %)^n, with e the share
    of a nominal wall of 2 mm lost at 25 %, and n = 1 if loss and degradation proceed together; on
    the part itself, that times the linear scale. The face under the paper and the clamped end lose
    nothing.

Typical size
    e = 0.05–0.15: curvature +11 … +36 % at 25 % (8–30 % were estimated from 21 % of lost mass).
    The emulator is trained up to 0.4 mm, e (D/25 %)^n = 0.2, where the prior ends. That removes
    20.5 % of the default actuator's gel. Eq. 6 would remove more if all lost mass left from the
    exposed faces: its 21–25 % of dry mass are e = 0.21–0.25, with their water 0.31. A posterior at
    the end of the prior indicates this; uniform loss is ``degraded_shrinkage``, within its range.
    Faces eroded at a constant rate, while the degradation rate tends to some 30 %, lose thickness
    as with n = 1.4 to 2.1.

Revealed by
    More curvature than simulated, growing with the degradation rate, none of it in fresh
    specimens; mass or wall thickness of the degraded part shows it outright.

Refuted by
    Walls of degraded parts that measure as thick as those of fresh ones.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, Eq. 6, for the loss of mass;
    von Burkersroda, Schedl, Göpferich (2002), doi:10.1016/S0142-9612(02)00170-9, for erosion from
    the surface.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_degraded
from bayesdeg.causes.cause import GROWTH, Cause, Conditions, Effect, Stage, grown
from bayesdeg.priors import Parameter, TruncatedNormal

NOMINAL_WALL = 2.0  # mm, as moulded


def thin_walls(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with e · 2 mm · (D/25 %)^n, scaled to the part, lost from exposed faces."""
    share = effect["lost_share"] * grown(conditions, effect)
    lost = share * NOMINAL_WALL * inputs.linear_scale
    return replace(inputs, erosion=lost + (0.0 if inputs.erosion is None else inputs.erosion))


CAUSE = Cause(
    name="erosion",
    stage=Stage.GEOMETRY,
    parameters=(
        Parameter(
            "lost_share",
            TruncatedNormal(0.0, 0.1, 0.0, 0.2),
            "–",
            "share of a 2 mm wall lost at a degradation rate of 25 %",
            0.0,
        ),
        GROWTH,
    ),
    mechanism="exposed walls lose thickness in the soil, which the simulation ignores",
    typical={"lost_share": 0.1, "growth": 1.0},
    revealed_by="more curvature than simulated, growing with the degradation rate; refuted by "
    "walls of degraded parts as thick as fresh ones",
    confusable_with=(
        "degradation_misread",
        "degraded_shrinkage",
        "degraded_skin",
        "paper_softening",
    ),
    on_inputs=thin_walls,
    blind=without_degraded,
    of_degradation=True,
)
