"""What the uncertainty of a prediction is made of."""

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bayesdeg.pages.drawing import (
    PAPER,
    PageFigure,
    Shown,
    Sketch,
    key,
    legend_above,
    level_colour,
    of_table,
    panels,
    styled,
)
from bayesdeg.quantities import axis_label

WORDS: Final = {
    "material": "material constants",
    "degradation": "error of the degradation rate",
    "scatter": "scatter of specimens",
    "paper": "paper",
    "scale": "volume ratio",
    "dimensions": "dimensions of the actuator",
    "causes": "causes",
    "emulator": "error of the emulator",
    "reading": "reading errors",
}
"""Sources in words, in stacking order."""

LARGEST = 3  # sources that the caption names


@styled
def shares_figure(shares: pd.DataFrame, *, degrades: bool = True) -> Figure:
    """Draw the shares of the variance as stacked bars, a panel a pressure.

    Where nothing degrades a pressure is a bar, and they are all in one panel.

    Parameters
    ----------
    shares : pandas.DataFrame
        Table ``shares``.
    degrades : bool
        Whether anything of the study does.
    """
    there = [source for source in WORDS if (shares["source"] == source).any()]
    over, along = ("pressure_kPa", "degradation_pct")[:: 1 if degrades else -1]
    panes = np.unique(shares[over].to_numpy(float))
    figure, every_axes = panels(len(panes), columns=2)
    table = shares.pivot_table(index=[over, along], columns="source", values="share")
    bars = np.unique(shares[along].to_numpy(float))
    place = np.arange(len(bars))
    for axes, pane in zip(every_axes, panes, strict=True):
        rows, below = table.loc[pane].reindex(index=bars, columns=there), np.zeros(len(bars))
        for index, source in enumerate(there):
            share = rows[source].to_numpy(float)
            # rounding may leave a share a little below nothing
            height = np.maximum(np.nan_to_num(share), 0.0)
            colour = level_colour(index, len(there))
            axes.bar(place, height, 0.8, bottom=below, color=colour, edgecolor=PAPER, linewidth=0.4)
            below += height
        axes.set_xticks(place, [f"{bar:.3g}" for bar in bars])
        axes.set_ylim(0.0, 1.0)
        axes.grid(visible=False, axis="x")
        axes.set_title(f"{pane:g} kPa" if degrades else "")
    figure.supxlabel(axis_label(along))
    figure.supylabel("share of the variance [–]")
    entries = {WORDS[source]: key(level_colour(i, len(there))) for i, source in enumerate(there)}
    for entry in entries.values():
        entry.set(linewidth=6)
    legend_above(figure, entries)
    return figure


def largest_of(shares: pd.DataFrame) -> dict[str, object]:
    """Return what the caption says of the largest pressure at the highest degradation rate.

    Parameters
    ----------
    shares : pandas.DataFrame
        Table ``shares``.
    """
    level = float(shares["degradation_pct"].max())
    there = shares[shares["degradation_pct"] == level]
    pressure = float(there["pressure_kPa"].max())
    there = there[there["pressure_kPa"] == pressure].nlargest(LARGEST, "share")
    named = zip(there["source"].astype(str), there["share"].astype(float), strict=True)
    return {
        "level": level,
        "pressure": pressure,
        "sd": float(there["sd_per_m"].iloc[0]),
        "largest": [(WORDS.get(source, source), share) for source, share in named],
    }


def _shares(shown: Shown, shares: pd.DataFrame) -> Sketch:
    return Sketch(shares_figure(shares, degrades=shown.run.degrades), largest_of(shares))


FIGURES = (
    PageFigure(
        "shares",
        "curvature",
        of_table("shares", _shares),
        "Shares of the variance of a curvature read on a new actuator, by source: a bar "
        "for each {% if degrades %}degradation rate, a panel for each pressure. At "
        "{{ level | level }} and {% else %}pressure. At {% endif %}"
        "{{ pressure | number }} kPa its standard deviation is {{ sd | number(2) }} 1/m; the "
        "largest shares are {% for name, share in largest %}{{ ', ' if not loop.first }}{{ name }} "
        "({{ share | percent }}){% endfor %}. Correlated parameters split their "
        "common part evenly (Shapley effects), so that shares add up to 1.",
        ("shares",),
        title="Sources of uncertainty",
    ),
)
