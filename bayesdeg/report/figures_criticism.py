"""Figures of what is wrong with a model: statistics, held-out prediction, how much to explain."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bayesdeg.criticism.checks.residuals import levels as levels_of
from bayesdeg.quantities import axis_label
from bayesdeg.report.figures import (
    BASE_COLOUR,
    FINAL_COLOUR,
    FULL_WIDTH,
    INK,
    MUTED,
    PAPER,
    Sketch,
    band,
    key,
    legend_above,
    panels,
    points_key,
    single,
    styled,
)
from bayesdeg.report.figures_curvature import COLOURS
from bayesdeg.report.figures_residuals import marker_of, path_keys
from bayesdeg.report.summaries import BASE, FINAL, MOST_LEVELS, nearest_level, panel_levels
from bayesdeg.report.wording import SPACE, level_words, model_words, number, p_value, unbroken

Floats = NDArray[np.float64]

FURTHEST = 6.0
"""Half-widths of the simulated band beyond which a value is drawn at the edge."""
SIGNIFICANT = 0.05
CURVATURE, STRESS = "curvature", "stress"


def statistics_sketch(statistics: pd.DataFrame) -> Sketch:
    """Draw table ``statistics``, with a caption that reads what is remarkable."""
    found = statistics[statistics["p_adjusted"] <= SIGNIFICANT]
    caption = (
        "Statistics of the residuals against those of data simulated from the fitted base model. "
        "Filled ones would be rare even as the most remarkable of all."
    )
    for _, row in found.iterrows():
        value = unbroken(f"{number(float(row['value']))} {row['unit']}".removesuffix(" –"))
        caption += f" {str(row['statistic']).capitalize()} {value}: {row['reading']}."
    return Sketch("statistics", statistics_figure(statistics), caption)


def loo_pit_sketch(curves: pd.DataFrame) -> Sketch:
    """Draw table ``loo_pit``, with a caption that says what each model's curve means."""
    caption = (
        "Where held-out readings lie in their predictions: a curve inside the band is as it should "
        "be; above zero readings are lower than predicted."
    )
    for model, rows in curves.groupby("model", sort=False):
        caption += f" {model_words(str(model)).capitalize()}: {rows['sentence'].iloc[0]}"
    return Sketch("loo-pit", loo_pit_figure(curves), caption)


def discrepancy_sketch(discrepancy: pd.DataFrame) -> Sketch:
    """Draw table ``discrepancy``, with a caption."""
    caption = (
        "How much there is to explain: the smooth discrepancy of the base model, fitted beside its "
        "parameters, and the readings about it."
    )
    if (discrepancy["model"] == FINAL).any():
        caption += " What the same measure finds once the named cause has joined the model is left."
    return Sketch("discrepancy", discrepancy_figure(discrepancy), caption)


@styled
def statistics_figure(statistics: pd.DataFrame) -> Figure:
    """Draw each statistic against what simulated data show, the most remarkable on top.

    A value is placed in half-widths of the band from 5 to 95 % of the simulated data, so that
    statistics of different units stand in one panel; its own unit is in the label.

    Parameters
    ----------
    statistics : pandas.DataFrame
        Table ``statistics``: columns ``statistic``, ``value``, ``unit``, ``simulated_q05``,
        ``simulated_q95``, ``p_value``, ``p_adjusted``, ``reading``. Rows without a value are left
        out.
    """
    chosen = statistics[statistics["value"].notna()].sort_values(["p_adjusted", "p_value"])[::-1]
    figure, axes = single(width=FULL_WIDTH, height=0.8 + 0.28 * max(len(chosen), 1))
    place = np.arange(len(chosen))
    position = band_position(chosen)
    shown = np.clip(position, -FURTHEST, FURTHEST)
    found = chosen["p_adjusted"].to_numpy(float) <= SIGNIFICANT
    axes.axvspan(-1.0, 1.0, color=MUTED, alpha=0.22, linewidth=0)
    axes.hlines(place, 0.0, shown, color=MUTED, linewidth=0.8)
    for chosen_rows, filled in ((found, True), (~found, False)):
        _draw_positions(axes, shown[chosen_rows], place[chosen_rows], position[chosen_rows], filled)
    axes.set_yticks(place, [_label(row) for _, row in chosen.iterrows()])
    axes.set_ylim(-0.6, len(chosen) - 0.4)
    axes.set_xlim(-FURTHEST - 0.5, FURTHEST + 0.5)
    axes.set_xlabel("distance from the middle of the simulated 5–95 % band, in half its width [–]")
    axes.grid(visible=False, axis="y")
    _write_values(axes, chosen)
    hollow = key(FINAL_COLOUR, marker="o", line=False)
    hollow.set(markerfacecolor=PAPER)
    filled_key = key(BASE_COLOUR, marker="o", line=False)
    simulated = key(MUTED)
    simulated.set(linewidth=6, alpha=0.3)
    legend_above(
        figure,
        {
            "remarkable among all": filled_key,
            "as the model would show": hollow,
            "simulated, 5–95 %": simulated,
        },
    )
    return figure


def band_position(statistics: pd.DataFrame) -> Floats:
    """Return how far values lie from the middle of their bands, in half the bands' widths.

    Examples
    --------
    >>> row = {"value": [9.0], "simulated_q05": [-1.0], "simulated_q95": [3.0]}
    >>> band_position(pd.DataFrame(row)).tolist()
    [4.0]
    """
    low = statistics["simulated_q05"].to_numpy(float)
    high = statistics["simulated_q95"].to_numpy(float)
    return np.asarray(
        (statistics["value"].to_numpy(float) - 0.5 * (low + high)) / (0.5 * (high - low))
    )


@styled
def loo_pit_figure(curves: pd.DataFrame) -> Figure:
    """Draw how the transforms of held-out readings depart from uniform, a panel a model.

    Parameters
    ----------
    curves : pandas.DataFrame
        Table ``loo_pit``: columns ``model``, ``probability``, ``difference``, ``low``, ``high``,
        ``p_value``, ``sentence``; the last two are the same in all rows of a model.
    """
    models = list(dict.fromkeys(curves["model"].astype(str)))
    figure, every_axes = panels(len(models), columns=2, height=2.4)
    for axes, model in zip(every_axes, models, strict=True):
        chosen = curves[curves["model"] == model].sort_values("probability")
        colour = COLOURS.get(model, FINAL_COLOUR)
        band(axes, chosen["probability"], chosen["low"], chosen["high"], MUTED, 0.22)
        axes.axhline(0.0, color=MUTED, linewidth=0.9)
        axes.plot(chosen["probability"], chosen["difference"], color=colour)
        axes.set_title(f"{model_words(model)}, {_chance(chosen.iloc[0])}")
        axes.set_xlim(0.0, 1.0)
    figure.supxlabel("predicted probability of a smaller reading [–]", fontsize=8.0)
    figure.supylabel("share of readings below it, less it [–]", fontsize=8.0)
    entries = {model_words(m): key(COLOURS.get(m, FINAL_COLOUR)) for m in models}
    inside = key(MUTED)
    inside.set(linewidth=6, alpha=0.3)
    legend_above(figure, entries | {"95 % of simulated data sets stay inside": inside})
    return figure


@styled
def discrepancy_figure(discrepancy: pd.DataFrame) -> Figure:
    """Draw how much there is to explain, and what is left after the named cause.

    Curvature against pressure, a panel a degradation rate; of studies without actuators, stress
    against stretch, a panel a mode of tension.

    Parameters
    ----------
    discrepancy : pandas.DataFrame
        Table ``discrepancy``: columns ``model`` (``base``, and ``final`` where a cause was named),
        ``kind``, ``history``, ``specimen_id``, ``degradation_pct``, ``along`` (pressure [kPa] or
        stretch), ``discrepancy`` and ``residual`` in the unit of the kind (1/m, MPa).
    """
    kinds = set(discrepancy["kind"].astype(str))
    kind = next((k for k in (CURVATURE, STRESS) if k in kinds), sorted(kinds)[0])
    chosen = discrepancy[discrepancy["kind"] == kind]
    rows, titles = _panels_of(chosen, kind)
    figure, every_axes = panels(len(titles))
    for number_of, (axes, title) in enumerate(zip(every_axes, titles, strict=True)):
        here = chosen[rows == number_of]
        axes.axhline(0.0, color=MUTED, linewidth=0.9)
        _draw_points(axes, here[here["model"] == BASE])
        for model in (BASE, FINAL):
            _draw_discrepancy(axes, here[here["model"] == model], COLOURS[model])
        axes.set_title(title)
    x, y = _axes_of(kind)
    figure.supxlabel(x, fontsize=8.0)
    figure.supylabel(y, fontsize=8.0)
    legend_above(figure, _discrepancy_keys(chosen))
    return figure


def _discrepancy_keys(chosen: pd.DataFrame) -> dict[str, Line2D]:
    entries: dict[str, Line2D] = {"to explain": key(BASE_COLOUR)}
    if (chosen["model"] == FINAL).any():
        entries["left after the named cause"] = key(FINAL_COLOUR)
    entries["measured less base model"] = points_key()
    for name, entry in path_keys(*_paths(chosen)).items():
        entry.set_linestyle("")
        entries[name] = entry
    return entries


def _axes_of(kind: str) -> tuple[str, str]:
    if kind == CURVATURE:
        return axis_label("pressure_kPa"), "measured − simulated [1/m]"
    if kind == STRESS:
        return f"{axis_label('stretch')} [–]", "measured − simulated [MPa]"
    return "along the path", f"{kind}, measured − simulated"


def _panels_of(chosen: pd.DataFrame, kind: str) -> tuple[NDArray[np.int64], list[str]]:
    """Return in which panel each row is drawn, and what stands over the panels."""
    if kind != CURVATURE:
        names = sorted(set(chosen["history"].astype(str)))[:MOST_LEVELS]
        place = {name: index for index, name in enumerate(names)}
        return np.array([place.get(str(h), -1) for h in chosen["history"]]), names
    rates = np.unique(chosen["degradation_pct"].to_numpy(float))
    levels = panel_levels(pd.DataFrame({"degradation_pct": levels_of(rates)[0]}))
    nearest = nearest_level(chosen["degradation_pct"], levels)
    return np.searchsorted(levels, nearest), [f"{level_words(v)} degradation" for v in levels]


def _draw_points(axes: Axes, here: pd.DataFrame) -> None:
    unloading, later = _paths(here)
    for down, again in ((False, False), (True, False), (False, True), (True, True)):
        chosen = here[(unloading == down) & (later == again)]
        if chosen.empty:
            continue
        axes.plot(
            chosen["along"],
            chosen["residual"],
            marker_of(later=again, unloading=down),
            color=INK,
            markersize=2.4,
            markerfacecolor=PAPER if down or not again else INK,
            markeredgewidth=0.6,
            alpha=0.7,
        )


def _paths(here: pd.DataFrame) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which readings are of unloading, and which of cycles after the first."""
    words = [str(history).split() for history in here["history"]]
    unloading = np.array([word[:1] == ["unloading"] for word in words], bool)
    return unloading, np.array([len(word) > 1 and word[1] != "1" for word in words], bool)


def _draw_discrepancy(axes: Axes, here: pd.DataFrame, colour: str) -> None:
    for _, curve in here.groupby(["specimen_id", "history"], sort=False, dropna=False):
        axes.plot(curve["along"], curve["discrepancy"], color=colour, linewidth=1.2)


def _draw_positions(
    axes: Axes, shown: Floats, place: NDArray[np.int64], position: Floats, filled: bool
) -> None:
    """Draw values; those beyond the edge as arrows that point there."""
    colour = BASE_COLOUR if filled else FINAL_COLOUR
    for marker, rows in (
        ("o", np.abs(position) <= FURTHEST),
        (">", position > FURTHEST),
        ("<", position < -FURTHEST),
    ):
        if rows.any():
            axes.plot(
                shown[rows],
                place[rows],
                marker,
                color=colour,
                markersize=5.0,
                markerfacecolor=colour if filled else PAPER,
            )


def _chance(row: "pd.Series[Any]") -> str:
    """Word the p-value of a row; runs before 0.2 do not say from how many data sets it is."""
    replicates = float(row.get("replicates", np.nan))
    return p_value(float(row["p_value"]), replicates if np.isfinite(replicates) else None)


def _write_values(axes: Axes, chosen: pd.DataFrame) -> None:
    """Write value and p-value beside the panel."""
    right = axes.secondary_yaxis("right")
    texts: Sequence[str] = [
        f"{number(float(row['value']))}, {_chance(row)}" for _, row in chosen.iterrows()
    ]
    right.set_yticks(np.arange(len(chosen)), texts)
    right.tick_params(length=0.0)
    right.spines["right"].set_visible(False)


def _label(row: pd.Series) -> str:
    return f"{row['statistic']} [{row['unit']}]".replace(" [", f"{SPACE}[")
