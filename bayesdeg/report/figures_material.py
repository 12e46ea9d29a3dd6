"""Figures of the material: Yeoh constants against degradation, stress against stretch."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.quantities import axis_label
from bayesdeg.report.figures import (
    BASE_COLOUR,
    INK,
    MUTED,
    PAPER,
    band,
    intervals,
    key,
    legend_above,
    panels,
    points_key,
    styled,
)
from bayesdeg.report.figures_curvature import COLOURS
from bayesdeg.report.summaries import BASE, FINAL, MOST_LEVELS
from bayesdeg.report.wording import level_words, model_words, words

APART = 0.25  # between points of one degradation rate, where there is no other [%]

CONSTANT_ORDER = ("c1", "c2", "c3", "young_modulus")


@dataclass(frozen=True)
class TensilePanel:
    """One panel of the tensile figure: a mode of loading at a degradation rate."""

    mode: str
    degradation_pct: float
    fitted: bool

    @property
    def title(self) -> str:
        """What stands over the panel."""
        held = "" if self.fitted else " · held out"
        return f"{self.mode}, {level_words(self.degradation_pct)}{held}"


@styled
def constants_figure(constants: pd.DataFrame, measured: pd.DataFrame | None) -> Figure:
    """Draw the constants of Yeoh's law against the degradation rate, a panel a constant.

    Parameters
    ----------
    constants : pandas.DataFrame
        Table ``constants``.
    measured : pandas.DataFrame, optional
        Table ``measured``; values of the same quantities are drawn with their standard deviation.
    """
    names = [name for name in CONSTANT_ORDER if (constants["constant"] == name).any()]
    figure, every_axes = panels(len(names), columns=2, share_y="none", height=2.0)
    single_rate = has_one_rate(constants)
    for axes, name in zip(every_axes, names, strict=True):
        chosen = constants[constants["constant"] == name]
        values = None if measured is None else measured[measured["quantity"] == name]
        if single_rate:
            _draw_at_one_rate(axes, chosen, values)
        else:
            _draw_along_rates(axes, chosen, values)
        axes.set_title(words(name))
        axes.set_ylabel(f"{words(name)} [{chosen['unit'].iloc[0]}]")
    figure.supxlabel(axis_label("degradation_pct"), fontsize=8.0)
    entries = {
        model_words(model): key(COLOURS[model])
        for model in (BASE, FINAL)
        if (constants["model"] == model).any()
    }
    if measured is not None and measured["quantity"].isin(names).any():
        entries["measured ± sd"] = points_key()
    legend_above(figure, entries)
    return figure


def has_one_rate(constants: pd.DataFrame) -> bool:
    """Return whether the constants are known at a single degradation rate, where no curve is.

    Examples
    --------
    >>> has_one_rate(pd.DataFrame({"degradation_pct": [0.0, 0.0]}))
    True
    """
    return np.unique(constants["degradation_pct"]).size == 1


def tensile_panels(tensile: pd.DataFrame) -> list[TensilePanel]:
    """Return the panels of the tensile figure, held-out modes first, nine at most."""
    kinds = tensile[["fitted", "mode", "degradation_pct"]].drop_duplicates()
    ordered = kinds.sort_values(["fitted", "mode", "degradation_pct"])
    places = np.linspace(0, len(ordered) - 1, min(len(ordered), MOST_LEVELS)).round().astype(int)
    return [
        TensilePanel(str(row["mode"]), float(row["degradation_pct"]), bool(row["fitted"]))
        for _, row in ordered.iloc[places].iterrows()
    ]


@styled
def tensile_figure(tensile: pd.DataFrame) -> Figure:
    """Draw nominal stress against stretch with the predictions, a panel a mode and rate.

    Parameters
    ----------
    tensile : pandas.DataFrame
        Table ``tensile``.
    """
    chosen = tensile_panels(tensile)
    figure, every_axes = panels(len(chosen), height=2.2)
    for axes, panel in zip(every_axes, chosen, strict=True):
        here = tensile[
            (tensile["mode"] == panel.mode)
            & (tensile["degradation_pct"] == panel.degradation_pct)
            & (tensile["fitted"] == float(panel.fitted))
        ]
        for model in (BASE, FINAL):
            _draw_fit(axes, here[here["model"] == model], COLOURS[model])
        _draw_stress(axes, here)
        axes.set_title(panel.title, color=INK if panel.fitted else BASE_COLOUR)
    figure.supxlabel(f"{axis_label('stretch')} [–]", fontsize=8.0)
    figure.supylabel("nominal stress [MPa]", fontsize=8.0)
    entries = {"measured": points_key()} | {
        model_words(model): key(COLOURS[model])
        for model in (BASE, FINAL)
        if (tensile["model"] == model).any()
    }
    legend_above(figure, entries)
    return figure


def _draw_along_rates(axes: Axes, chosen: pd.DataFrame, values: pd.DataFrame | None) -> None:
    for model in (BASE, FINAL):
        _draw_constant(axes, chosen[chosen["model"] == model], COLOURS[model])
    if values is not None:
        _draw_values(axes, values)


def _draw_at_one_rate(axes: Axes, chosen: pd.DataFrame, values: pd.DataFrame | None) -> None:
    """Draw points with intervals beside one another, about the rate that they all have."""
    rate = float(chosen["degradation_pct"].iloc[0])
    models = [model for model in (BASE, FINAL) if (chosen["model"] == model).any()]
    places = rate + APART * (np.arange(len(models)) - 0.5 * (len(models) - 1))
    for place, model in zip(places, models, strict=True):
        intervals(axes, place, chosen[chosen["model"] == model].iloc[0], COLOURS[model])
    if values is not None and not values.empty:
        _draw_values(axes, values.assign(degradation_pct=places[-1] + APART))
    axes.set_xlim(rate - 3.0 * APART, rate + 3.0 * APART)
    axes.set_xticks([rate], [f"{rate:.3g}"])


def _draw_constant(axes: Axes, chosen: pd.DataFrame, colour: str) -> None:
    curve = chosen.sort_values("degradation_pct")
    rate = curve["degradation_pct"]
    band(axes, rate, curve["q05"], curve["q95"], colour, 0.16)
    band(axes, rate, curve["q25"], curve["q75"], colour, 0.22)
    axes.plot(rate, curve["q50"], color=colour)


def _draw_values(axes: Axes, measured: pd.DataFrame) -> None:
    axes.errorbar(
        measured["degradation_pct"],
        measured["value"],
        yerr=measured["sd"].fillna(0.0),
        fmt="o",
        color=INK,
        mfc=PAPER,
        markersize=4,
        linewidth=1,
    )


def _draw_fit(axes: Axes, here: pd.DataFrame, colour: str) -> None:
    curve = here.sort_values("stretch")
    band(axes, curve["stretch"], curve["q05_MPa"], curve["q95_MPa"], colour, 0.2)
    axes.plot(curve["stretch"], curve["mean_MPa"], color=colour)


def _draw_stress(axes: Axes, here: pd.DataFrame) -> None:
    readings = here.drop_duplicates(["specimen_id", "stretch", "stress_MPa"])
    for _, curve in readings.groupby("specimen_id", sort=False):
        many = len(curve) > 40
        axes.plot(
            curve["stretch"],
            curve["stress_MPa"],
            color=MUTED if many else INK,
            marker="" if many else "o",
            linestyle="-" if many else "",
            linewidth=0.9,
            markersize=3.0,
            markerfacecolor=PAPER,
            markeredgewidth=0.8,
        )
