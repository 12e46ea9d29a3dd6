"""Photographs instead of readings: the columns of ``photos.csv``.

Each is traced, and its line of points is read like one of ``markers.csv``; see
`bayesdeg_camera.photographs`.
"""

import pandera.pandas as pa

from bayesdeg.data.photographs import FILE
from bayesdeg.data.tables import ONE_DEGRADATION, Table, of_actuators, once, text

TABLE = Table(
    "photos",
    pa.DataFrameSchema(
        of_actuators({"file": text()}),
        [ONE_DEGRADATION, once("file", "give each photograph one row")],
        name=FILE,
    ),
    supports="verdict, gain, curvature bands",
)
