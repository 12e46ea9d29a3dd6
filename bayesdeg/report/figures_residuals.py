"""Figure of the residuals, with marks of their own for branches and cycles."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bayesdeg.quantities import axis_label
from bayesdeg.report.figures import (
    INK,
    MUTED,
    PAPER,
    key,
    legend_above,
    panels,
    styled,
)
from bayesdeg.report.figures_curvature import COLOURS
from bayesdeg.report.summaries import BASE, FINAL, nearest_level
from bayesdeg.report.wording import level_words, model_words

UNLOADING = "unloading"


@styled
def residual_figure(
    observations: pd.DataFrame,
    levels: Sequence[float],
    *,
    noise_per_m: float | None,
    specimens: Sequence[str] = (),
) -> Figure:
    """Draw measured less predicted curvature against pressure, a panel a degradation rate.

    Unloading is dashed with hollow marks, later cycles have squares.

    Parameters
    ----------
    observations : pandas.DataFrame
        Table ``observations``.
    levels : sequence of float
        Degradation rates that get a panel; specimens go to the nearest [%].
    noise_per_m : float, optional
        Standard deviation of the noise, drawn as a band about zero [1/m].
    specimens : sequence of str, optional
        Those in which most of the misfit sits: drawn thick, with their names.
    """
    figure, every_axes = panels(len(levels))
    panel = nearest_level(observations["degradation_pct"], levels)
    for axes, level in zip(every_axes, levels, strict=True):
        if noise_per_m is not None:
            axes.axhspan(-noise_per_m, noise_per_m, color=MUTED, alpha=0.22, linewidth=0)
        axes.axhline(0.0, color=MUTED, linewidth=0.9)
        for model in (BASE, FINAL):
            chosen = observations[(panel == level) & (observations["model"] == model)]
            _draw_curves(axes, chosen, COLOURS[model], specimens)
        axes.set_title(f"{level_words(level)} degradation")
    figure.supxlabel(axis_label("pressure_kPa"), fontsize=8.0)
    figure.supylabel("measured − simulated [1/m]", fontsize=8.0)
    legend_above(figure, _keys(observations, noise_per_m))
    return figure


def marker_of(*, later: bool, unloading: bool) -> str:
    """Return the mark of readings: circles, triangles of unloading, squares of later cycles.

    Examples
    --------
    >>> marker_of(later=False, unloading=True), marker_of(later=True, unloading=True)
    ('v', 's')
    """
    return "s" if later else "v" if unloading else "o"


def path_keys(unloading: NDArray[np.bool_], later: NDArray[np.bool_]) -> dict[str, Line2D]:
    """Return entries of a legend for the branches and cycles that there are."""
    entries = {}
    if unloading.any():
        entries["unloading"] = key(INK, marker=marker_of(later=False, unloading=True), dashed=True)
        entries["unloading"].set(markerfacecolor=PAPER)
    if later.any():
        entries["later cycles"] = key(INK, marker=marker_of(later=True, unloading=False))
    return entries


def _keys(observations: pd.DataFrame, noise_per_m: float | None) -> dict[str, Line2D]:
    entries = {
        model_words(model): key(COLOURS[model], marker="o")
        for model in (BASE, FINAL)
        if (observations["model"] == model).any()
    }
    if noise_per_m is not None:
        entries["± one standard deviation of the noise"] = key(MUTED)
        entries["± one standard deviation of the noise"].set(linewidth=6, alpha=0.3)
    unloading = (observations["branch"] == UNLOADING).to_numpy(bool)
    later = (observations["cycle"] > 1).to_numpy(bool)
    return entries | path_keys(unloading, later)


def _draw_curves(axes: Axes, chosen: pd.DataFrame, colour: str, specimens: Sequence[str]) -> None:
    groups = chosen.groupby(["specimen_id", "branch", "cycle"], sort=False, dropna=False)
    told: set[str] = set()
    for (specimen, branch, _), curve in groups:
        unloading, picked = branch == UNLOADING, str(specimen) in specimens
        axes.plot(
            curve["pressure_kPa"],
            curve["residual_per_m"],
            color=colour,
            marker=marker_of(later=bool((curve["cycle"] > 1).any()), unloading=unloading),
            markerfacecolor=PAPER if unloading else colour,
            markersize=2.2,
            linewidth=1.9 if picked else 0.8,
            linestyle=(0, (4, 2)) if unloading else "-",
            alpha=0.85,
        )
        if picked and str(specimen) not in told and colour == COLOURS[BASE]:
            told.add(str(specimen))
            _name(axes, str(specimen), curve)


def _name(axes: Axes, specimen: str, curve: pd.DataFrame) -> None:
    pressure, residual = (curve[c].to_numpy(float) for c in ("pressure_kPa", "residual_per_m"))
    known = np.flatnonzero(np.isfinite(residual))
    if not known.size:
        return
    last = known[np.argmax(pressure[known])]
    axes.annotate(
        specimen,
        (float(pressure[last]), float(residual[last])),
        xytext=(-2, 5),
        textcoords="offset points",
        ha="right",
        fontsize=7.0,
        fontweight="bold",
        color=INK,
    )
