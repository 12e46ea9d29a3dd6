"""A ball that falls slower than t = √(2h/g) says: real fall times, g known.

Readings from 21 heights in three rounds; readings of one height are held out together. Drag of the
air and a watch that is started late are the candidates. The forward map is asked for drag by the
name of the cause, and the watch adds to what is read.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import bayesdeg as bd

type Floats = NDArray[np.float64]
type Values = Mapping[str, Floats]

GRAVITY = 9.81  # m/s²


def fall_time(values: Values, height: Floats) -> Floats:
    """Return times [s] of v' = g − c v² from rest, arcosh(exp(c h))/√(c g), to second order."""
    drag = values["drag.coefficient"][:, None] if "drag.coefficient" in values else 0.0
    shape = (len(next(iter(values.values()))), len(height))
    longer = 1.0 + drag * height / 6.0 + (drag * height) ** 2 / 120.0
    return np.broadcast_to(np.sqrt(2.0 * height / GRAVITY) * longer, shape)


def late(time: Floats, recorded: Floats, effect: Values) -> Floats:
    return time + effect["delay"]


DRAG = bd.Cause(
    name="drag",
    stage=bd.Stage.LOAD,
    parameters=(
        bd.Parameter("coefficient", bd.TruncatedNormal(0, 0.1, low=0), "1/m", "c of c v²", 0.0),
    ),
    mechanism="air slows the ball in proportion to the square of its speed",
    typical={"coefficient": 0.1},
    revealed_by="times that grow faster than √h",
)
LATE = bd.Cause(
    name="late_watch",
    stage=bd.Stage.READING,
    parameters=(bd.Parameter("delay", bd.Normal(0, 0.1), "s", "added to all times", 0.0),),
    mechanism="the watch is stopped late, or started early",
    typical={"delay": 0.05},
    revealed_by="the same delay at every height",
    on_reading=late,
)

table = pd.read_csv("studies/data/falling_ball.csv", comment="#")
height, time = table["height_m"].to_numpy(), table["time_s"].to_numpy()
timed = bd.Readings(
    height, time, specimen=height.astype(str), name="time", unit="s", error=bd.HalfNormal(0.1)
)
base = bd.calibrate(bd.Model([timed], fall_time), effort="quick", seed=1)
print(bd.criticise(base, causes=[DRAG, LATE], seed=1))
