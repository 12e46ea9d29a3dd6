"""Shrinkage reading: the volume ratio is of a different state, or was taken for a linear factor.

Mechanism
    The part is smaller (or larger) than the linear scale α^(1/3): α may be the ratio of cured to
    conditioned volume rather than of mould to part, or may have been meant as a linear factor. A
    part of the same shape but different size bends by the same angle at the same pressure, over a
    different length.

Equation
    s = (1 + x) α^(1/3); the curvature scales with 1/s, the bend angle is unchanged.

Typical size
    The interpretations of α differ by x = −0.18 … −0.27 (s = 0.62–0.70 instead of 0.853): curvature
    up to 1.38 times. The angle changes by the paper's share only, 0.1–0.3 %.

Revealed by
    A ratio of curvatures that is constant in pressure and degradation rate, while the bend angle
    fits.

Refuted by
    The same misfit in the bend angle; a part whose length agrees with α^(1/3).

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485: Eqs 10–11, 17 and the text
    define α in three ways.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def resize(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the linear scale times 1 + x."""
    return replace(inputs, linear_scale=inputs.linear_scale * (1.0 + effect["scale_error"]))


CAUSE = Cause(
    name="shrinkage_reading",
    stage=Stage.GEOMETRY,
    parameters=(
        Parameter(
            "scale_error",
            TruncatedNormal(0.0, 0.12, -0.4, 0.4),
            "–",
            "true linear scale of the part over α^(1/3), minus 1",
            0.0,
        ),
    ),
    mechanism="the part is smaller or larger than the recorded volume ratio implies",
    typical={"scale_error": -0.15},
    revealed_by="a ratio constant in pressure and degradation rate that the bend angle does not "
    "show; refuted by the same misfit in the bend angle",
    confusable_with=("film_mismatch", "wall_thickness", "pressure_loss"),
    on_inputs=resize,
    of_degradation=True,
    corrects=("volume_ratio",),
)
