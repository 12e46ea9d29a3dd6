"""Figure of the course of degradation: moisture of films and degradation rate against time."""

import pandas as pd
from matplotlib.figure import Figure

from bayesdeg.quantities import axis_label
from bayesdeg.report.figures import (
    FINAL_COLOUR,
    INK,
    Sketch,
    band,
    key,
    legend_above,
    points,
    points_key,
    side_by_side,
    styled,
)
from bayesdeg.report.tables import Tables


def course_sketch(tables: Tables) -> Sketch | None:
    """Draw the course of degradation, if the run has one."""
    if tables.course is None:
        return None
    caption = (
        "Left: moisture content of films taken out of the soil, with the 90 % band of a film. "
        "Right: their degradation rate against the mean fresh moisture, with the 50 % and 90 % "
        "bands of the mean film."
    )
    return Sketch("course", course_figure(tables.course), caption)


@styled
def course_figure(course: pd.DataFrame) -> Figure:
    """Draw moisture and degradation rate against time.

    Parameters
    ----------
    course : pandas.DataFrame
        Table ``course``.
    """
    figure, left, right = side_by_side(height=2.8)
    curve = course[course["kind"] == "band"].sort_values("time_h")
    films = course[course["kind"] == "film"]
    time = curve["time_h"]
    band(left, time, curve["moisture_q05"], curve["moisture_q95"], FINAL_COLOUR, 0.18)
    left.plot(time, curve["moisture_q50"], color=FINAL_COLOUR)
    points(left, films["time_h"], films["moisture_pct"])
    band(right, time, curve["q05"], curve["q95"], FINAL_COLOUR, 0.18)
    band(right, time, curve["q25"], curve["q75"], FINAL_COLOUR, 0.28)
    right.plot(time, curve["q50"], color=FINAL_COLOUR)
    points(right, films["time_h"], films["degradation_pct"])
    right.axhline(0.0, color=INK, linewidth=0.6, alpha=0.5)
    left.set_ylabel(axis_label("moisture_content_pct"))
    right.set_ylabel(axis_label("degradation_pct"))
    for axes in (left, right):
        axes.set_xlabel(axis_label("time_h"))
    legend_above(figure, {"median and band": key(FINAL_COLOUR), "films": points_key()})
    return figure
