"""Figures of the actuator: curvature bands, rupture, the calibrated misfit."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.quantities import axis_label
from bayesdeg.report.figures import (
    BASE_COLOUR,
    FINAL_COLOUR,
    MUTED,
    band,
    intervals,
    key,
    legend_above,
    level_colour,
    panels,
    points,
    points_key,
    single,
    styled,
)
from bayesdeg.report.summaries import BASE, FINAL, nearest_level
from bayesdeg.report.wording import level_words, model_words

COLOURS = {BASE: BASE_COLOUR, FINAL: FINAL_COLOUR}


@styled
def bands_figure(
    bands: pd.DataFrame, observations: pd.DataFrame | None, levels: Sequence[float]
) -> Figure:
    """Draw the curvature bands with the measured readings, a panel a degradation rate.

    Parameters
    ----------
    bands : pandas.DataFrame
        Table ``bands``.
    observations : pandas.DataFrame, optional
        Table ``observations``: readings as points, what the models say of them as dashed lines.
    levels : sequence of float
        Degradation rates of the bands that get a panel [%].
    """
    figure, every_axes = panels(len(levels))
    for axes, level in zip(every_axes, levels, strict=True):
        chosen = bands[bands["degradation_pct"] == level].sort_values("pressure_kPa")
        pressure = chosen["pressure_kPa"]
        band(axes, pressure, chosen["q05"], chosen["q95"], FINAL_COLOUR, 0.18)
        band(axes, pressure, chosen["q25"], chosen["q75"], FINAL_COLOUR, 0.28)
        axes.plot(pressure, chosen["q50"], color=FINAL_COLOUR)
        axes.set_title(f"{level_words(level)} degradation")
    entries = {"new specimen: median, 50 % and 90 % band": key(FINAL_COLOUR)}
    if observations is not None:
        _draw_measured(every_axes, observations, levels)
        entries["measured"] = points_key()
        for model in (BASE, FINAL):
            if (observations["model"] == model).any():
                entries[model_words(model)] = key(COLOURS[model], dashed=True)
    _label(figure, axis_label("pressure_kPa"), axis_label("curvature_per_m"))
    legend_above(figure, entries)
    return figure


@styled
def rupture_figure(rupture: pd.DataFrame) -> Figure:
    """Draw the probability of rupture against pressure, a curve a degradation rate."""
    figure, axes = single()
    levels = np.unique(rupture["degradation_pct"].to_numpy(float))
    for index, level in enumerate(levels):
        curve = rupture[rupture["degradation_pct"] == level].sort_values("pressure_kPa")
        colour, pressure = level_colour(index, levels.size), curve["pressure_kPa"]
        band(axes, pressure, curve["probability_q05"], curve["probability_q95"], colour, 0.16)
        axes.plot(pressure, curve["probability"], color=colour, label=level_words(level))
    axes.set(ylim=(-0.02, 1.02), xlabel=axis_label("pressure_kPa"))
    axes.set_ylabel("probability of rupture [–]")
    axes.legend(title="degradation", loc="best", handlelength=1.2)
    return figure


@styled
def elongation_figure(elongation: pd.DataFrame) -> Figure:
    """Draw the elongation limit against the degradation rate, with what was measured."""
    figure, axes = single()
    limit = elongation[elongation["kind"] == "band"].sort_values("degradation_pct")
    measured = elongation[elongation["kind"] == "measured"]
    if np.unique(limit["degradation_pct"]).size == 1:
        intervals(axes, *_first(limit[["degradation_pct", "q05", "q50", "q95"]]), FINAL_COLOUR)
        axes.plot([], [], "o-", color=FINAL_COLOUR, label="median, 90 % interval")
    else:
        band(axes, limit["degradation_pct"], limit["q05"], limit["q95"], FINAL_COLOUR, 0.22)
        label = "median, 90 % band"
        axes.plot(limit["degradation_pct"], limit["q50"], color=FINAL_COLOUR, label=label)
    points(axes, measured["degradation_pct"], measured["value"], "measured")
    axes.set(xlabel=axis_label("degradation_pct"), ylabel="elongation at break [%]")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return figure


@styled
def null_figure(null: pd.DataFrame, *, observed: float | None, name: str) -> Figure:
    """Draw the misfit statistic of data simulated from the base model, and the observed one."""
    figure, axes = single(height=2.4)
    axes.hist(null["statistic"].dropna(), bins="auto", color=MUTED, alpha=0.55)
    entries = {"if the base model were right": key(MUTED)}
    entries["if the base model were right"].set(linewidth=5, alpha=0.55)
    if observed is not None:
        axes.axvline(observed, color=BASE_COLOUR, linewidth=2)
        entries["this study"] = key(BASE_COLOUR)
    axes.set(xlabel=f"{name or 'misfit statistic'} [–]", ylabel="simulated studies [–]")
    legend_above(figure, entries)
    return figure


def _first(limit: pd.DataFrame) -> tuple[float, pd.Series]:
    row = limit.iloc[0]
    return float(row["degradation_pct"]), row


def _draw_measured(
    every_axes: Sequence[Axes], observations: pd.DataFrame, levels: Sequence[float]
) -> None:
    panel = nearest_level(observations["degradation_pct"], levels)
    for axes, level in zip(every_axes, levels, strict=True):
        here = observations[panel == level]
        for model in (BASE, FINAL):
            _draw_means(axes, here[here["model"] == model], COLOURS[model])
        readings = here[here["model"] == BASE]
        points(axes, readings["pressure_kPa"], readings["curvature_per_m"])


def _draw_means(axes: Axes, chosen: pd.DataFrame, colour: str) -> None:
    """Draw what a model says of the measured specimens themselves."""
    for _, curve in chosen.groupby(["specimen_id", "branch", "cycle"], sort=False, dropna=False):
        axes.plot(
            curve["pressure_kPa"],
            curve["mean_per_m"],
            color=colour,
            linewidth=0.9,
            linestyle=(0, (4, 2)),
        )


def _label(figure: Figure, x: str, y: str) -> None:
    figure.supxlabel(x, fontsize=8.0)
    figure.supylabel(y, fontsize=8.0)
