"""A ball that falls from higher, or lower, than recorded."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import bayesdeg as bd

type Values = Mapping[str, NDArray[np.float64]]


def higher(x: Values, recorded: Values, effect: Values) -> Values:
    """Change the height [m] that the function is asked."""
    return {**x, "height_m": x["height_m"] + effect["error"]}


CAUSE = bd.Cause(
    name="release_height",
    stage=bd.Stage.GEOMETRY,
    parameters=(bd.Parameter("error", bd.Normal(0, 0.05), "m", "true less recorded height", 0.0),),
    mechanism="the ball falls from higher, or lower, than recorded",
    typical={"error": 0.05},
    revealed_by="lateness from small heights alone",
    on_inputs=higher,
)
