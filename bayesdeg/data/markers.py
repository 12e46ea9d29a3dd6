"""The table of points along the bottom line, which tools that find points write.

Points are numbered from the clamped to the free end. They are in millimetres, or in pixels with the
millimetres that a pixel shows; a picture of either has x to the right along the clamped end and y
up.
"""

import pandas as pd
import pandera.pandas as pa

from bayesdeg.data.tables import (
    NOT_NEGATIVE,
    ONE_DEGRADATION,
    POSITIVE,
    TIME_PROCEEDS,
    WHOLE,
    number,
    of_actuators,
    row_check,
)

_PLACE = ("x_mm", "y_mm", "x_px", "y_px", "scale_mm_per_px")
FEWEST = 4
"""Points of a line: a cubic spline needs as many."""
PICTURE = ("specimen_id", "cycle", "branch", "pressure_kPa", "time_s")


def _placed(frame: pd.DataFrame) -> pd.Series:
    in_mm = frame[["x_mm", "y_mm"]].notna().all(axis=1)
    in_pixels = frame[["x_px", "y_px", "scale_mm_per_px"]].notna().all(axis=1)
    return in_mm ^ in_pixels


def _in_order(frame: pd.DataFrame) -> pd.Series:
    keys = [frame[key].fillna(-1.0) if key == "time_s" else frame[key] for key in PICTURE]
    return ~(frame.groupby(keys, sort=False)["point"].diff() <= 0.0)


def _enough(frame: pd.DataFrame) -> pd.Series:
    keys = [frame[key].fillna(-1.0) if key == "time_s" else frame[key] for key in PICTURE]
    points = frame.groupby(keys, sort=False)["point"]
    return ~((points.transform("size") < FEWEST) & (points.cumcount() == 0))


MARKERS = pa.DataFrameSchema(
    of_actuators(
        {
            "point": number(POSITIVE, WHOLE),
            "x_mm": number(optional=True),
            "y_mm": number(optional=True),
            "x_error_mm": number(NOT_NEGATIVE, optional=True),
            "y_error_mm": number(NOT_NEGATIVE, optional=True),
            "x_px": number(optional=True),
            "y_px": number(optional=True),
            "scale_mm_per_px": number(POSITIVE, optional=True),
            "sd_mm": number(NOT_NEGATIVE, optional=True),
        }
    ),
    [
        ONE_DEGRADATION,
        TIME_PROCEEDS,
        row_check(
            "x_mm",
            "is no place, or two",
            "give x_mm and y_mm, or x_px, y_px and scale_mm_per_px",
            _PLACE,
            _placed,
        ),
        row_check(
            "point",
            "does not follow the point before",
            "number the points of a line from the clamped end: 1, 2, …",
            (*PICTURE, "point"),
            _in_order,
        ),
        row_check(
            "point",
            f"is of a line of fewer than {FEWEST} points",
            "give more points along the line, or leave it out",
            (*PICTURE, "point"),
            _enough,
        ),
    ],
    name="markers.csv",
)
