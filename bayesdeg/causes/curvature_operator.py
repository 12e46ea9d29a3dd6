r"""Curvature operator: curvature declared as angle over arc is that of a fitted circle.

Mechanism
    The floor of a chambered actuator bulges under each chamber, between stiff ends. A circle fitted
    to all points of the bottom line follows the bulges; the rotation of the end face over the arc
    length, which defines ``curvature_per_m``, does not.

Equation
    κ_read = R(κ L)^x κ, with R the curvature of a circle fitted to the model's bottom line over
    angle over arc, at the bend angle κ L of a usual arc length L = 43 mm, and x = 1.

Typical size
    R = 1.17 to 1.20 on the default actuator for lines of 50 points; the angle does not change. Few
    points give less, 1.12 for five of them: x from 0.7 to 1.1.

Revealed by
    Curvatures larger by this factor while the bend angle shows no misfit.

Refuted by
    The same misfit in the bend angle; a different factor; points of the line. The factor
    hardly depends on pressure, so a part that is 15 % smaller than α says, `shrinkage_reading`,
    looks the same unless α is known. Where curvature alone is recorded it also looks like a softer
    material or a lost pressure. Other operators differ by up to 8 % and are not covered.

Source
    The ratio is computed from finite element lines, `bayesdeg.actuator.reading`; the fit of the
    circle is that of doi:10.1145/37402.37420.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.actuator.reading import operator_ratio
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.data.study import Study
from bayesdeg.priors import Normal, Parameter

POINTS = 50
USUAL_GROUP = np.array(50.0)
"""Of the paper [mm]; the material changes the ratio by up to 1.1 %, within the prior."""

ARC = 0.043
"""L, of the bottom line of a part of usual volume ratio [m]; with it the slope in stiffness
follows from that in curvature."""


def fit_circle(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """Return the prediction as a fitted circle reads it, to the power x."""
    angle, share = ARC * prediction.curvature, effect["circle_share"]
    ratio, change = operator_ratio("circle", POINTS)(angle, USUAL_GROUP)
    gain = ratio**share
    growth = gain * (1.0 + share * angle * change / ratio)
    return replace(
        prediction,
        curvature=gain * prediction.curvature,
        slope=growth * prediction.slope,
        sd=growth * prediction.sd,
    )


def unstated(study: Study) -> str | None:
    """Say why no declared curvature operator can be contradicted; None where one can."""
    settings = study.settings
    if study.line_points is not None:
        return "the bottom line is recorded as points, which are read as the model's are"
    if settings.reading.operator is None:
        return "study.toml does not state [reading] operator"
    if settings.reading.operator != "angle_over_arc":
        return "it concerns only curvatures declared as angle_over_arc"
    return None if settings.is_default_mould else "it is available for the default actuator only"


CAUSE = Cause(
    name="curvature_operator",
    stage=Stage.READING,
    parameters=(
        Parameter(
            "circle_share",
            Normal(1.0, 0.1),
            "–",
            "exponent x of the fitted circle's factor on the curvature",
            0.0,
        ),
    ),
    mechanism="the curvature, declared as bend angle over arc length, was read from a fitted "
    "circle",
    typical={"circle_share": 1.0},
    revealed_by="curvatures a fifth too large at all pressures and degradation rates while the "
    "bend angle fits; refuted by the same misfit in the bend angle",
    confusable_with=("shrinkage_reading", "curvature_reading", "pressure_loss"),
    on_reading=fit_circle,
    blind_in=unstated,
)
