"""Figures of any kind of readings: bands against what was read, and what is left over."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.pages.drawing import (
    COLOURS,
    FINAL_COLOUR,
    MUTED,
    PageFigure,
    Shown,
    Sketch,
    band,
    key,
    legend_above,
    model_keys,
    of_table,
    panels,
    points,
    points_key,
    styled,
)
from bayesdeg.pages.summaries import BASE, FINAL, MOST_LEVELS
from bayesdeg.pages.wording import words
from bayesdeg.quantities import DIMENSIONLESS

type Panel = tuple[str, pd.DataFrame]


@styled
def readings_figure(fitted: pd.DataFrame) -> Figure:
    """Draw readings with the bands of the final model and the means of both, a panel a test.

    Parameters
    ----------
    fitted : pandas.DataFrame
        Table ``fitted``; what was read at the same place of a path is drawn as its mean.
    """
    figure = _drawn(fitted, _bands, "")
    entries = {"reading of a new specimen: 50 % and 90 % band": key(FINAL_COLOUR)}
    entries["measured"] = points_key()
    legend_above(figure, entries | model_keys(fitted, dashed=True))
    return figure


@styled
def residuals_figure(fitted: pd.DataFrame) -> Figure:
    """Draw readings less the means of both models, a panel a test."""
    figure = _drawn(fitted, _residuals, "measured − predicted")
    legend_above(figure, model_keys(fitted, marker="o"))
    return figure


def _drawn(fitted: pd.DataFrame, draw: Callable[[Axes, pd.DataFrame], None], what: str) -> Figure:
    found = list(_panels(fitted))
    figure, every_axes = panels(len(found), share_y="none")
    for axes, (title, chosen) in zip(every_axes, found, strict=True):
        draw(axes, chosen)
        first = chosen.iloc[0]
        unit = "" if first["unit"] == DIMENSIONLESS else f" [{first['unit']}]"
        axes.set(xlabel=first["axis"], ylabel=f"{what or words(first['kind'])}{unit}")
        axes.set_title(title)
    return figure


def _panels(fitted: pd.DataFrame) -> Iterator[Panel]:
    """Yield each kind of readings, level by level where there are several, but not too many."""
    for kind, rows in fitted.groupby("kind", sort=False):
        levels = np.unique(rows["level"].to_numpy(float))
        if not 1 < len(levels) <= MOST_LEVELS:
            yield words(str(kind)), rows
            continue
        for level in levels:
            chosen = rows[rows["level"] == level]
            unit = chosen["level_unit"].fillna("").iloc[0]  # an empty cell is read as missing
            yield f"{words(str(kind))} at {level:.3g} {unit}".strip(), chosen


def _by_place(rows: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    return rows.groupby("along")[list(names)].mean().reset_index()


def _bands(axes: Axes, chosen: pd.DataFrame) -> None:
    final = _by_place(chosen[chosen["model"] == FINAL], ["q05", "q25", "q75", "q95"])
    band(axes, final["along"], final["q05"], final["q95"], FINAL_COLOUR, 0.18)
    band(axes, final["along"], final["q25"], final["q75"], FINAL_COLOUR, 0.28)
    for model in (BASE, FINAL):
        means = _by_place(chosen[chosen["model"] == model], ["mean"])
        axes.plot(
            means["along"],
            means["mean"],
            color=COLOURS[model],
            linewidth=0.9,
            linestyle=(0, (4, 2)),
        )
    readings = chosen[chosen["model"] == BASE]
    points(axes, readings["along"], readings["measured"])


def _residuals(axes: Axes, chosen: pd.DataFrame) -> None:
    axes.axhline(0.0, color=MUTED, linewidth=0.9)
    for model in (BASE, FINAL):
        rows = chosen[chosen["model"] == model]
        left = rows["measured"] - rows["mean"]
        axes.plot(rows["along"], left, "o", color=COLOURS[model], markersize=2.6, alpha=0.85)


def _sketch(draw: Callable[[pd.DataFrame], Figure]) -> Callable[[Shown], Sketch | None]:
    def sketch(_: Shown, fitted: pd.DataFrame) -> Sketch:
        return Sketch(draw(fitted), {"kinds": list(map(words, dict.fromkeys(fitted["kind"])))})

    return of_table("fitted", sketch)


FIGURES = (
    PageFigure(
        "readings",
        "curvature",
        _sketch(readings_figure),
        "Readings of {{ kinds | join(' and ') }}, what both models predict on average, and the "
        "band in which the final model expects a reading of a new specimen in the same test, "
        "including its error.",
        ("fitted",),
    ),
    PageFigure(
        "reading-residuals",
        "misfit",
        _sketch(residuals_figure),
        "Readings of {{ kinds | join(' and ') }} less the mean predictions of the models. If a "
        "model is right, they scatter about zero.",
        ("fitted",),
    ),
)
