"""Curvature reading: a fibre other than the bottom line was traced, or the picture is distorted.

Mechanism
    The image tool fits a curve to a visible outline. A line at height y above the paper lies on
    the outer side of the bend, so its radius is larger by y; perspective scales every length in
    the picture.

Equation
    κ_read = (1 + m) κ / (1 + κ y).

Typical size
    y up to the height of the part (8 mm): a factor 0.75–0.80 at κ = 40 1/m; m of 1–3 %.

Revealed by
    A ratio that falls with curvature at any pressure and degradation rate; the bend
    angle, which does not depend on the fibre, fits.

Refuted by
    The same misfit in the bend angle.

Source
    Mary and Brouhard (2019), Kappa, doi:10.1101/852772, for how curvature is traced; the
    factor follows from concentric arcs.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Normal, Parameter, TruncatedNormal


def trace_other_fibre(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """Return the prediction as read on a fibre at height y, magnified by 1 + m."""
    spread = 1.0 + prediction.curvature * effect["fibre_height"] * 1e-3
    gain = (1.0 + effect["magnification"]) / spread
    change = gain / spread
    return replace(
        prediction,
        curvature=gain * prediction.curvature,
        slope=change * prediction.slope,
        sd=change * prediction.sd,
    )


CAUSE = Cause(
    name="curvature_reading",
    stage=Stage.READING,
    parameters=(
        Parameter(
            "fibre_height",
            TruncatedNormal(0.0, 5.0, 0.0, 15.0),
            "mm",
            "height of the traced line above the paper",
            0.0,
        ),
        Parameter("magnification", Normal(0.0, 0.02), "–", "error of the picture's scale", 0.0),
    ),
    mechanism="the curvature was traced along a line other than the bottom, or the picture's scale "
    "is off",
    typical={"fibre_height": 8.0, "magnification": 0.0},
    revealed_by="a ratio that falls with curvature at any pressure and degradation rate; refuted "
    "by the same misfit in the bend angle",
    confusable_with=("humidity_drift", "creep"),
    on_reading=trace_other_fibre,
)
