"""Wall thickness: the walls are not as thick as drawn.

Mechanism
    Mould cores shift or bend, and walls shrink more across than along where the paper or the mould
    holds them. Roof and walls of the part are thinner or thicker than in the scaled drawing, while
    the outer faces are where they should be.

Equation
    Thickness of roof and walls = (1 + x) · nominal.

Typical size
    x up to ±0.1: curvature −19 % at +10 %, +23 % at −10 %. The emulator is trained for ±0.2, where
    the prior ends; below x = −0.065 a fresh default actuator is so near ballooning at 240 kPa that
    the emulator refuses this step.

Revealed by
    A ratio of curvatures that is nearly constant in pressure and the same at every degradation
    rate; it differs from that of stiffness only near the largest pressures of soft specimens. The
    cavity volume falls by half as much again as the curvature, which no stiffness does; a cut
    through the part.

Refuted by
    Walls that measure as drawn.

Source
    Mosadegh et al. (2014), Adv. Funct. Mater. 24:2163, doi:10.1002/adfm.201303288, for how much
    walls matter in such actuators; the size is estimated.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def thicken_walls(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with roof and walls 1 + x times as thick."""
    before = 1.0 if inputs.wall_factor is None else inputs.wall_factor
    return replace(inputs, wall_factor=before * (1.0 + effect["excess"]))


CAUSE = Cause(
    name="wall_thickness",
    stage=Stage.GEOMETRY,
    parameters=(
        Parameter(
            "excess",
            TruncatedNormal(0.0, 0.08, -0.2, 0.2),
            "–",
            "true over nominal thickness of roof and walls, minus 1",
            0.0,
        ),
    ),
    mechanism="roof and walls are thinner or thicker than drawn",
    typical={"excess": 0.08},
    revealed_by="a ratio nearly constant in pressure, at every degradation rate; refuted by walls "
    "that measure as drawn",
    confusable_with=("film_mismatch", "pressure_loss", "shrinkage_reading"),
    on_inputs=thicken_walls,
)
