"""A watch that is stopped later, or earlier, than it was started."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import bayesdeg as bd

type Floats = NDArray[np.float64]
type Values = Mapping[str, Floats]


def late(time: Floats, recorded: Values, effect: Values) -> Floats:
    """Add the delay [s] to what is read."""
    return time + effect["delay"]


CAUSE = bd.Cause(
    name="reaction_time",
    stage=bd.Stage.READING,
    parameters=(
        bd.Parameter("delay", bd.Normal(0, 0.1), "s", "stop of the watch less its start", 0.0),
    ),
    mechanism="the watch is stopped later, or earlier, than it was started",
    typical={"delay": 0.1},
    revealed_by="the same lateness from every height",
    on_reading=late,
)
