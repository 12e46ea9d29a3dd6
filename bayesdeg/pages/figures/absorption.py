"""Figure of parameters against all other information."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bayesdeg.pages.drawing import (
    BASE_COLOUR,
    FINAL_COLOUR,
    FULL_WIDTH,
    INK,
    MUTED,
    PageFigure,
    Shown,
    Sketch,
    key,
    legend_above,
    of_table,
    single,
    styled,
)
from bayesdeg.pages.wording import MINUS, words

Floats = NDArray[np.float64]

NINETY = 1.645  # half-width of a 90 % interval of a normal law, in standard deviations
LINEAR = (
    3.0  # standard deviations up to which the axis is linear: beyond, parameters are in question
)
LINES = (0.3, 0.1, -0.1, -0.3)  # vertical positions within the row of a parameter
DRAWN = {
    "prior": ("prior", MUTED),
    "measured directly": ("measured", INK),
    "base model": ("base", BASE_COLOUR),
    "with the causes": ("after", FINAL_COLOUR),
}
ENDS = ("q05", "q50", "q95")


def in_widths(row: pd.Series, what: str) -> Floats:
    """Return quantiles of a parameter relative to all other information, in its sd, (3,).

    Parameters
    ----------
    row : pandas.Series
        Of table ``absorption``.
    what : {"prior", "all_else", "base", "after", "measured"}
        Whose quantiles; nan where there are none. Positive ones are taken by their logarithms.
    """
    groups = ("prior", "all_else", "base", "after")
    known = np.array([[row[f"{group}_{end}"] for end in ENDS] for group in groups], dtype=float)
    measured = float(row["measured"]) + np.array([-NINETY, 0.0, NINETY]) * float(row["measured_se"])
    every = np.vstack([known, measured])
    if np.all(every[np.isfinite(every)] > 0.0):
        with np.errstate(invalid="ignore"):
            every = np.log(every)
    low, middle, high = every[groups.index("all_else")]
    place = len(groups) if what == "measured" else groups.index(what)
    found: Floats = (every[place] - middle) / ((high - low) / (2.0 * NINETY))
    return found


@styled
def absorption_figure(parameters: pd.DataFrame) -> Figure:
    """Draw prior, other information, base and final posterior, one row per parameter.

    Parameters
    ----------
    parameters : pandas.DataFrame
        Rows of table ``absorption`` that were judged.
    """
    ordered = parameters.iloc[np.argsort(parameters["score_sd"].abs().to_numpy(), kind="stable")]
    figure, axes = single(width=FULL_WIDTH, height=0.8 + 0.42 * len(ordered))
    axes.axvspan(-NINETY, NINETY, color=MUTED, alpha=0.15, linewidth=0.0)
    there = set()
    for place, (_, row) in enumerate(ordered.iterrows()):
        for (what, colour), line in zip(DRAWN.values(), LINES, strict=True):
            ends = in_widths(row, what)
            if np.all(np.isfinite(ends)):
                axes.plot(ends[[0, 2]], [place + line, place + line], color=colour, linewidth=1.2)
                axes.plot(ends[1], place + line, "o", color=colour, markersize=3.5)
                there.add(what)
    axes.set_yticks(np.arange(len(ordered)), [words(name) for name in ordered["parameter"]])
    axes.set_ylim(-0.6, len(ordered) - 0.4)
    axes.set_xscale("symlog", linthresh=LINEAR)
    low, high = axes.get_xlim()
    ticks = [t for t in (-30, -10, -3, -2, -1, 0, 1, 2, 3, 10, 30) if low <= t <= high]
    axes.set_xticks(ticks, [f"{t:d}".replace("-", MINUS) for t in ticks])
    axes.minorticks_off()
    axes.set_xlabel("shift from all other information [its sd]")
    axes.grid(visible=False, axis="y")
    entries = {name: key(c, marker="o") for name, (what, c) in DRAWN.items() if what in there}
    legend_above(figure, entries)
    return figure


def _absorption(_: Shown, table: pd.DataFrame) -> Sketch | None:
    rows = table[table["p_value"].notna()]
    if rows.empty:
        return None
    count = int((rows["in_question"] > 0).sum())
    return Sketch(absorption_figure(rows), {"count": count})


FIGURES = (
    PageFigure(
        "absorption",
        "misfit",
        of_table("absorption", _absorption),
        "Shift of every parameter that the readings could move from all other information (prior, "
        "films, means of replicates; grey: its 90 % interval), in standard deviations of that: "
        "median and 90 % interval; the axis is logarithmic beyond 3. "
        "{{ count if count else 'None' }} of them {{ 'is' if count == 1 else 'are' }} in question.",
        ("absorption",),
    ),
)
