"""Drag of the air. It has no hook: the function acts on it, by the name of its parameter."""

import bayesdeg as bd

CAUSE = bd.Cause(
    name="drag",
    stage=bd.Stage.LOAD,
    parameters=(
        bd.Parameter(
            "coefficient", bd.TruncatedNormal(0, 0.1, low=0), "1/m", "c of v' = g − c v²", 0.0
        ),
    ),
    mechanism="air slows the ball in proportion to the square of its speed",
    typical={"coefficient": 0.1},
    revealed_by="times that grow faster than √h; refuted by the ball's mass and diameter",
)
