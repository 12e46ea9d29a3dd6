"""A spring whose scale does not begin at zero: a forward map and a cause of one's own.

The forward map is Hooke's law, the readings are made up here, and a length of 0.4 mm is added to
all of them. The catalogue has two causes: an offset of the scale, and a spring that stiffens. The
verdict must name the first with its size.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import bayesdeg as bd

type Floats = NDArray[np.float64]
type Values = Mapping[str, Floats]


def hooke(values: Values, force: Floats) -> Floats:
    """Return lengths (draws, readings) for stiffnesses ``values["k"]`` (draws,)."""
    return values["k"][:, None] * force


def shifted(length: Floats, force: Floats, effect: Values) -> Floats:
    return length + effect["length"]


def stiffened(force: Floats, recorded: Floats, effect: Values) -> Floats:
    return force * np.exp(-effect["rate"] * force)


OFFSET = bd.Cause(
    name="offset",
    stage=bd.Stage.READING,
    parameters=(bd.Parameter("length", bd.Normal(0, 0.5), "mm", "added to all lengths", 0.0),),
    mechanism="the scale does not begin at zero",
    typical={"length": 0.3},
    revealed_by="a length without a force",
    on_reading=shifted,
)
STIFFENING = bd.Cause(
    name="stiffening",
    stage=bd.Stage.MATERIAL,
    parameters=(bd.Parameter("rate", bd.Normal(0, 0.05), "1/N", "loss of compliance", 0.0),),
    mechanism="the coils touch",
    typical={"rate": 0.03},
    revealed_by="a curve that bends down",
    on_inputs=stiffened,
)

generator = np.random.default_rng(1)
force = np.linspace(0.5, 5.0, 24)
length = 2.3 * force + 0.4 + 0.05 * generator.standard_normal(24)
readings = bd.Readings(force, length, specimen=np.repeat(list("abcdefgh"), 3), unit="mm")
model = bd.Model([readings], hooke, parameters=[bd.Parameter("k", bd.LogNormal(2, 1), "mm/N")])

base = bd.calibrate(model, effort="quick", seed=1)
verdict = bd.criticise(base, causes=[OFFSET, STIFFENING], seed=1)
final = bd.calibrate(model.with_verdict(verdict), effort="quick", seed=1)
print(verdict, final, sep="\n\n")
