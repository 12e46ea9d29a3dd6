"""Figures of the material: Yeoh constants, stress against stretch, the course of degradation."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.pages.drawing import (
    BASE_COLOUR,
    COLOURS,
    FINAL_COLOUR,
    INK,
    MUTED,
    PAPER,
    PageFigure,
    Shown,
    Sketch,
    band,
    intervals,
    key,
    label_rates,
    legend_above,
    model_keys,
    of_table,
    panels,
    points,
    points_key,
    quantile_bands,
    side_by_side,
    styled,
)
from bayesdeg.pages.summaries import BASE, FINAL, MOST_LEVELS
from bayesdeg.pages.wording import level_words, words
from bayesdeg.quantities import axis_label

APART = 0.25  # between points of one degradation rate, where there is no other [%]

CONSTANT_ORDER = ("c1", "c2", "c3", "young_modulus")


@dataclass(frozen=True)
class TensilePanel:
    """One panel of the tensile figure: a mode of loading at a degradation rate."""

    mode: str
    degradation_pct: float
    fitted: bool

    def title(self, *, degrades: bool) -> str:
        """Return what stands over the panel, with the rate where anything degrades."""
        held = "" if self.fitted else " · held out"
        rate = f", {level_words(self.degradation_pct)}" if degrades else ""
        return f"{self.mode}{rate}{held}"


@styled
def constants_figure(
    constants: pd.DataFrame, measured: pd.DataFrame | None, *, degrades: bool = True
) -> Figure:
    """Draw the constants of Yeoh's law against the degradation rate, a panel a constant.

    Parameters
    ----------
    constants : pandas.DataFrame
        Table ``constants``.
    measured : pandas.DataFrame, optional
        Table ``measured``; values of the same quantities are drawn with their standard deviation.
    degrades : bool
        Whether anything of the study does; else the axis has no label.
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
            for model in (BASE, FINAL):
                curve = chosen[chosen["model"] == model].sort_values("degradation_pct")
                quantile_bands(axes, "degradation_pct", curve, COLOURS[model], (0.16, 0.22))
            if values is not None:
                _draw_values(axes, values)
        axes.set_title(words(name))
        axes.set_ylabel(f"{words(name)} [{chosen['unit'].iloc[0]}]")
    label_rates(figure, every_axes, degrades=degrades)
    entries = model_keys(constants)
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
def tensile_figure(tensile: pd.DataFrame, *, degrades: bool = True) -> Figure:
    """Draw nominal stress against stretch with the predictions, a panel a mode and rate.

    Parameters
    ----------
    tensile : pandas.DataFrame
        Table ``tensile``.
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
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
            curve = here[here["model"] == model].sort_values("stretch")
            band(axes, curve["stretch"], curve["q05_MPa"], curve["q95_MPa"], COLOURS[model], 0.2)
            axes.plot(curve["stretch"], curve["mean_MPa"], color=COLOURS[model])
        _draw_stress(axes, here)
        axes.set_title(panel.title(degrades=degrades), color=INK if panel.fitted else BASE_COLOUR)
    figure.supxlabel(f"{axis_label('stretch')} [–]")
    figure.supylabel("nominal stress [MPa]")
    legend_above(figure, {"measured": points_key()} | model_keys(tensile))
    return figure


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
    quantile_bands(right, "time_h", curve, FINAL_COLOUR)
    points(right, films["time_h"], films["degradation_pct"])
    right.axhline(0.0, color=INK, linewidth=0.6, alpha=0.5)
    left.set_ylabel(axis_label("moisture_content_pct"))
    right.set_ylabel(axis_label("degradation_pct"))
    for axes in (left, right):
        axes.set_xlabel(axis_label("time_h"))
    legend_above(figure, {"median and band": key(FINAL_COLOUR), "films": points_key()})
    return figure


def _constants(shown: Shown, constants: pd.DataFrame) -> Sketch:
    rate = float(constants["degradation_pct"].iloc[0]) if has_one_rate(constants) else None
    figure = constants_figure(constants, shown.tables["measured"], degrades=shown.run.degrades)
    return Sketch(figure, {"rate": rate})


def _tensile(shown: Shown, tensile: pd.DataFrame) -> Sketch:
    drawn = tensile_panels(tensile)
    facts = {
        "held_out": any(not panel.fitted for panel in drawn),
        "drawn": len(drawn),
        "all": len(tensile[["fitted", "mode", "degradation_pct"]].drop_duplicates()),
    }
    return Sketch(tensile_figure(tensile, degrades=shown.run.degrades), facts)


FIGURES = (
    PageFigure(
        "constants",
        "posterior",
        of_table("constants", _constants),
        "Constants of Yeoh's law and Young's modulus{% if rate is none %} against degradation "
        "rate: posterior median with 50 % and 90 % bands{% else %}{% if degrades %} at "
        "{{ rate | level }} degradation, the only rate of the study{% endif %}: posterior median "
        "with 50 % (thick) and 90 % intervals{% endif %}, each constant on its own scale.",
        ("constants", "measured"),
    ),
    PageFigure(
        "tensile",
        "tensile",
        of_table("tensile", _tensile),
        "Nominal stress against stretch: measured, and predicted with 90 % intervals."
        "{% if held_out %} Panels marked as held out were not used in the fit.{% endif %}"
        "{% if drawn < all %} {{ drawn }} of {{ all }} combinations of mode and rate are drawn."
        "{% endif %}",
        ("tensile",),
    ),
    PageFigure(
        "course",
        "data",
        of_table("course", lambda _, course: Sketch(course_figure(course))),
        "Left: moisture content of films taken out of the soil, with the 90 % band of a film. "
        "Right: their degradation rate against the mean fresh moisture, with the 50 % and 90 % "
        "bands of the mean film.",
        ("course",),
    ),
)
