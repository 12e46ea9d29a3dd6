"""What was set aside, among the readings of the other specimens."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bayesdeg.pages.drawing import (
    BASE_COLOUR,
    MUTED,
    PageFigure,
    Shown,
    Sketch,
    key,
    legend_above,
    panels,
    styled,
)
from bayesdeg.pages.wording import words
from bayesdeg.quantities import axis_label


@styled
def suspects_figure(rows: pd.DataFrame) -> Figure:
    """Draw curvature against pressure, with what was set aside marked: a panel a specimen.

    Parameters
    ----------
    rows : pandas.DataFrame
        Table ``set_aside``.
    """
    names = list(dict.fromkeys(rows.loc[rows["set_aside"] > 0, "specimen_id"].astype(str)))
    figure, every_axes = panels(len(names), share_y="none")
    for axes, name in zip(every_axes, names, strict=True):
        own = rows["specimen_id"].astype(str) == name
        rate = float(rows.loc[own, "degradation_pct"].iloc[0])
        alike = ~own & (np.abs(rows["degradation_pct"] - rate) <= NEAR)
        near = rows[alike & (rows["set_aside"] == 0)]
        for _, other in near.groupby("specimen_id", sort=False):
            axes.plot(other["pressure_kPa"], other["curvature_per_m"], color=MUTED, linewidth=0.8)
        itself = rows[own]
        curve = (itself["pressure_kPa"], itself["curvature_per_m"])
        axes.plot(*curve, color=MUTED, linewidth=0.8, linestyle="--")
        odd = itself[itself["set_aside"] > 0]
        axes.plot(odd["pressure_kPa"], odd["curvature_per_m"], "o", color=BASE_COLOUR, markersize=3)
        axes.set_title(f"{name}, {rate:.3g} %")
    figure.supxlabel(axis_label("pressure_kPa"), fontsize=8.0)
    figure.supylabel(axis_label("curvature_per_m"), fontsize=8.0)
    entries = {
        "set aside": key(BASE_COLOUR, marker="o", line=False),
        "the specimen itself": key(MUTED, dashed=True),
        "others of the same rate": key(MUTED),
    }
    legend_above(figure, entries)
    return figure


NEAR = 1.5  # points of degradation between specimens that are drawn together


def _suspects(shown: Shown) -> Sketch | None:
    rows = shown.tables["set_aside"]
    if rows is None or not (rows["set_aside"] > 0).any():
        return None
    out = rows[rows["set_aside"] > 0]
    names = list(dict.fromkeys(out["specimen_id"].astype(str)))
    return Sketch(suspects_figure(rows), {"count": len(out), "names": list(map(words, names))})


FIGURES = (
    PageFigure(
        "suspects",
        "data",
        _suspects,
        "Curvature against pressure of specimens with readings set aside, and others of "
        "the same degradation rate: {{ count }} reading{{ 's' if count != 1 }} of "
        "{{ names | listed }} excluded from calibration and verdict.",
        ("set_aside", "suspects"),
        title="Readings that were set aside",
    ),
)
