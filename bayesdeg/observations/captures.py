"""Motion capture recordings instead of readings: the columns of ``captures.csv``.

A row is a hold: a recording's markers are averaged over its frames, and their line is read like one
of ``markers.csv``; see `bayesdeg_camera.captures`.
"""

import pandera.pandas as pa

from bayesdeg.data.captures import FILE
from bayesdeg.data.tables import (
    NO_VACUUM,
    NOT_NEGATIVE,
    ONE_DEGRADATION,
    WHOLE,
    Table,
    at_most,
    number,
    of_actuators,
    text,
)

FRAMES = ("first_frame", "last_frame")
TABLE = Table(
    "captures",
    pa.DataFrameSchema(
        of_actuators(
            {"file": text(), **{one: number(NOT_NEGATIVE, WHOLE, optional=True) for one in FRAMES}}
        )
        | {"pressure_kPa": number(NO_VACUUM, optional=True)},
        [ONE_DEGRADATION, at_most(*FRAMES, "give the first and the last frame of the hold")],
        name=FILE,
    ),
    supports="verdict, gain, curvature bands",
)
