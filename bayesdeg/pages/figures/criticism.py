"""Figures of model criticism, and of the gain on held-out data."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bayesdeg.data.levels import levels as levels_of
from bayesdeg.pages.drawing import (
    BASE_COLOUR,
    COLOURS,
    FINAL_COLOUR,
    FULL_WIDTH,
    INK,
    MUTED,
    PAPER,
    PageFigure,
    Shown,
    Sketch,
    area_key,
    band,
    hollow_key,
    key,
    legend_above,
    of_table,
    panels,
    points_key,
    rate_title,
    side_by_side,
    single,
    styled,
)
from bayesdeg.pages.figures.curvature import marker_of, path_keys
from bayesdeg.pages.summaries import (
    BASE,
    FINAL,
    MOST_LEVELS,
    extended_model,
    models_of,
    nearest_level,
    panel_levels,
    pooled,
    rows_of,
    several_levels,
)
from bayesdeg.pages.wording import (
    SPACE,
    level_words,
    model_words,
    number,
    p_value,
    words,
)
from bayesdeg.quantities import BRANCHES, axis_label

Floats = NDArray[np.float64]

FURTHEST = 6.0
"""Half-widths of the simulated band beyond which a value is drawn at the edge."""
SIGNIFICANT = 0.05
CURVATURE, STRESS = "curvature", "stress"


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
    labels = [f"{row['statistic']} [{row['unit']}]" for _, row in chosen.iterrows()]
    axes.set_yticks(place, [label.replace(" [", f"{SPACE}[") for label in labels])
    axes.set_ylim(-0.6, len(chosen) - 0.4)
    axes.set_xlim(-FURTHEST - 0.5, FURTHEST + 0.5)
    axes.set_xlabel("distance from the middle of the simulated 5–95 % band, in half-widths [–]")
    axes.grid(visible=False, axis="y")
    values = axes.secondary_yaxis("right")
    texts = [f"{number(float(row['value']))}, {_chance(row)}" for _, row in chosen.iterrows()]
    values.set_yticks(place, texts)
    values.tick_params(length=0.0)
    values.spines["right"].set_visible(False)
    entries = {
        "remarkable among all": key(BASE_COLOUR, marker="o", line=False),
        "as the model would show": hollow_key(FINAL_COLOUR),
        "simulated, 5–95 %": area_key(),
    }
    legend_above(figure, entries)
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
    figure.supxlabel("predicted probability of a smaller reading [–]")
    figure.supylabel("share of readings below, less that probability [–]")
    entries = {model_words(m): key(COLOURS.get(m, FINAL_COLOUR)) for m in models}
    legend_above(figure, entries | {"95 % of simulated data sets stay inside": area_key()})
    return figure


@styled
def discrepancy_figure(
    discrepancy: pd.DataFrame,
    *,
    degrades: bool = True,
    line: str = "to explain",
    points: str = "measured less base model",
) -> Figure:
    """Draw the discrepancy of the base model, and that left after the named cause.

    Curvature against pressure, a panel a degradation rate; of studies without actuators, stress
    against stretch, a panel a mode of tension.

    Parameters
    ----------
    discrepancy : pandas.DataFrame
        Table ``discrepancy``: columns ``model`` (``base``, and ``final`` where a cause was named),
        ``kind``, ``history``, ``specimen_id``, ``degradation_pct``, ``along`` (pressure [kPa] or
        stretch), ``discrepancy`` and ``residual`` in the unit of the kind (1/m, MPa).
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
    line, points : str
        What line and points of the base model are.
    """
    kinds = set(discrepancy["kind"].astype(str))
    kind = next((k for k in (CURVATURE, STRESS) if k in kinds), sorted(kinds)[0])
    chosen = discrepancy[discrepancy["kind"] == kind]
    rows, titles = _panels_of(chosen, kind, degrades=degrades)
    figure, every_axes = panels(len(titles))
    for number_of, (axes, title) in enumerate(zip(every_axes, titles, strict=True)):
        here = chosen[rows == number_of]
        axes.axhline(0.0, color=MUTED, linewidth=0.9)
        _draw_points(axes, here[here["model"] == BASE])
        for model in (BASE, FINAL):
            curves = here[here["model"] == model]
            for _, curve in curves.groupby(["specimen_id", "history"], sort=False, dropna=False):
                axes.plot(curve["along"], curve["discrepancy"], color=COLOURS[model], linewidth=1.2)
        axes.set_title(title)
    if kind == CURVATURE:
        figure.supxlabel(axis_label("pressure_kPa"))
        figure.supylabel("measured − simulated [1/m]")
    elif kind == STRESS:
        figure.supxlabel(f"{axis_label('stretch')} [–]")
        figure.supylabel("measured − simulated [MPa]")
    else:
        figure.supxlabel("along the path")
        figure.supylabel(f"{kind}, measured − simulated")
    entries = {line: key(BASE_COLOUR)}
    if (chosen["model"] == FINAL).any():
        entries["left after the named cause"] = key(FINAL_COLOUR)
    entries[points] = points_key()
    for name, entry in path_keys(*_paths(chosen)).items():
        entry.set_linestyle("")
        entries[name] = entry
    legend_above(figure, entries)
    return figure


def _panels_of(
    chosen: pd.DataFrame, kind: str, *, degrades: bool
) -> tuple[NDArray[np.int64], list[str]]:
    """Return the panel of each row, and the titles of the panels."""
    if kind != CURVATURE:
        names = sorted(set(chosen["history"].astype(str)))[:MOST_LEVELS]
        place = {name: index for index, name in enumerate(names)}
        return np.array([place.get(str(h), -1) for h in chosen["history"]]), names
    rates = np.unique(chosen["degradation_pct"].to_numpy(float))
    levels = panel_levels(pd.DataFrame({"degradation_pct": levels_of(rates)[0]}))
    nearest = nearest_level(chosen["degradation_pct"], levels)
    titles = [rate_title(level, degrades=degrades) for level in levels]
    return np.searchsorted(levels, nearest), titles


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
    """Return masks of readings on unloading, and of cycles after the first."""
    words = [str(history).split() for history in here["history"]]
    unloading = np.array([word[:1] == ["unloading"] for word in words], bool)
    later = [len(word) > 1 and word[0] in BRANCHES and word[1] != "1" for word in words]
    return unloading, np.array(later, bool)


def _draw_positions(
    axes: Axes, shown: Floats, place: NDArray[np.int64], position: Floats, filled: bool
) -> None:
    """Draw values, with arrows for those beyond the edge."""
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
    """Format the p-value of a row; runs before 0.2 lack the number of data sets."""
    replicates = float(row.get("replicates", np.nan))
    return p_value(float(row["p_value"]), replicates if np.isfinite(replicates) else None)


@styled
def gain_figure(
    pooled: pd.DataFrame | None,
    by_level: pd.DataFrame | None,
    final: str,
    by_mode: pd.DataFrame | None = None,
) -> Figure:
    """Draw the gain of the extended model on held-out specimens or modes of tension.

    Parameters
    ----------
    pooled : pandas.DataFrame, optional
        Rows of table ``gain`` over all degradation rates: gain in elpd of each model, drawn beside
        the errors where several are compared.
    by_level : pandas.DataFrame, optional
        Rows of table ``gain`` by degradation rate: error of base and extended model.
    final : str
        The model that is set against the base model.
    by_mode : pandas.DataFrame, optional
        Table ``gain_modes``, drawn where there are no rows by degradation rate.
    """
    has_errors = by_level is not None or by_mode is not None
    has_gains = pooled is not None and (not has_errors or (pooled["model"] != BASE).sum() > 1)
    if has_errors and has_gains:
        figure, left, right = side_by_side(height=2.9)
    else:
        figure, left = single(width=FULL_WIDTH, height=2.9)
        right = left
    if by_level is not None:
        errors = by_level.pivot_table(index="degradation_pct", columns="model", values="rmse_per_m")
        _draw_errors(left, errors, [level_words(float(level)) for level in errors.index], final)
        left.set_xlabel("error on held-out specimens, rms [1/m]")
        left.set_ylabel(axis_label("degradation_pct"))
        left.set_title("error by degradation rate")
    elif by_mode is not None:
        errors = by_mode.pivot_table(index="mode", columns="model", values="rmse_MPa")
        _draw_errors(left, errors, [str(mode) for mode in errors.index], final)
        left.set_xlabel("error of nominal stress, rms [MPa]")
        left.set_title("error on held-out modes of tension")
    if pooled is not None and has_gains:
        _draw_elpd(right, pooled, final)
    if has_errors:
        models = {BASE: BASE_COLOUR, final: FINAL_COLOUR}
        keys = {model_words(m): key(c, marker="o", line=False) for m, c in models.items()}
        legend_above(figure, keys)
    return figure


def _draw_errors(axes: Axes, errors: pd.DataFrame, labels: list[str], final: str) -> None:
    place = np.arange(len(errors))
    if final in errors and BASE in errors:
        axes.hlines(place, errors[BASE], errors[final], color=MUTED, alpha=0.6, linewidth=1.6)
    for model, colour in ((BASE, BASE_COLOUR), (final, FINAL_COLOUR)):
        if model in errors:
            axes.plot(errors[model], place, "o", color=colour, markersize=5)
    axes.set_yticks(place, labels)
    axes.set_xlim(left=0.0)
    axes.margins(y=0.12)
    axes.grid(visible=False, axis="y")
    axes.invert_yaxis()


def _draw_elpd(axes: Axes, pooled: pd.DataFrame, final: str) -> None:
    extended = pooled[pooled["model"] != BASE].head(8)
    place = np.arange(len(extended))[::-1]
    for y, (_, row) in zip(place, extended.iterrows(), strict=True):
        colour = FINAL_COLOUR if row["model"] == final else MUTED
        axes.errorbar(
            row["elpd_diff"], y, xerr=row["elpd_diff_se"], fmt="o", color=colour, markersize=5
        )
    axes.axvline(0.0, color=BASE_COLOUR, linewidth=1.2)
    added = [str(model).split("+") for model in extended["model"]]
    names = ["\n".join(f"+ {words(one)}" for one in parts if one != BASE) for parts in added]
    axes.set_yticks(place, names)
    axes.set_xlabel("gain in elpd over the base model ± se [–]")
    axes.margins(x=0.1, y=0.25)
    axes.grid(visible=False, axis="y")
    axes.set_title("gain in held-out prediction")


def _statistics(_: Shown, statistics: pd.DataFrame) -> Sketch | None:
    if statistics["value"].isna().all():
        return None
    found = rows_of(statistics[statistics["p_adjusted"] <= SIGNIFICANT])
    return Sketch(statistics_figure(statistics), {"found": found})


def _loo_pit(_: Shown, curves: pd.DataFrame) -> Sketch:
    said = curves.groupby("model", sort=False)["sentence"].first()
    return Sketch(loo_pit_figure(curves), {"said": said.to_dict()})


def _discrepancy(shown: Shown, discrepancy: pd.DataFrame) -> Sketch:
    final = bool((discrepancy["model"] == FINAL).any())
    figure = discrepancy_figure(discrepancy, degrades=shown.run.degrades)
    return Sketch(figure, {"final": final})


def _missing_terms(shown: Shown, readings: pd.DataFrame) -> Sketch | None:
    terms = shown.tables["missing_terms"]
    if terms is None:
        return None
    rows = readings.rename(columns={"term": "discrepancy"}).assign(model=BASE)
    taken = terms.loc[terms["behind"].notna() & terms["share"].notna(), "formula"].astype(str)
    figure = discrepancy_figure(
        rows,
        degrades=shown.run.degrades,
        line="the term" if len(taken) == 1 else "both terms",
        points="measured less model",
    )
    return Sketch(figure, {"terms": list(taken)})


def _gain(shown: Shown, gain: pd.DataFrame) -> Sketch | None:
    """Draw errors by degradation rate, and of studies with one rate by mode of tension."""
    by_mode = shown.tables["gain_modes"]
    others = [model for model in models_of(gain) if model != BASE]
    if not others:
        return None
    final = extended_model(gain, shown.verdict) or others[0]
    by_level = several_levels(gain)
    per = "degradation rate" if by_level is not None else "mode" if by_mode is not None else ""
    facts = {"final": final, "per": per, "several": len(others) > 1}
    return Sketch(gain_figure(pooled(gain), by_level, final, by_mode), facts)


FIGURES = (
    PageFigure(
        "discrepancy",
        "misfit",
        of_table("discrepancy", _discrepancy),
        "The misfit to explain: the smooth discrepancy of the base model, fitted together "
        "with its parameters, and the readings about it.{% if final %} “Left”: the same with the "
        "named cause in the model.{% endif %}",
        ("discrepancy",),
    ),
    PageFigure(
        "statistics",
        "misfit",
        of_table("statistics", _statistics),
        "Statistics of the residuals against those of data simulated from the fitted base model. "
        "Filled marks are significant after adjustment for all statistics."
        "{% for row in found %} {{ row.statistic | capitalize }} "
        "{{ (row.value | number ~ ' ' ~ row.unit).removesuffix(' –') | unbroken }}: "
        "{{ row.reading }}.{% endfor %}",
        ("statistics",),
    ),
    PageFigure(
        "loo-pit",
        "gain",
        of_table("loo_pit", _loo_pit),
        "Where held-out readings lie in their predictions. A curve inside the band is as expected; "
        "above zero, readings are lower than predicted."
        "{% for model, sentence in said.items() %} {{ model | model | capitalize }}: "
        "{{ sentence }}{% endfor %}",
        ("loo_pit",),
    ),
    PageFigure(
        "gain",
        "gain",
        of_table("gain", _gain),
        "Prediction of {{ 'modes of tension' if per == 'mode' else 'specimens' }} that the model "
        "has not seen. {% if per and several %}Left: error of the base model and of "
        "{{ final | model }} by {{ per }}. Right: gain in expected log predictive density."
        "{% elif per %}Error of the base model and of {{ final | model }} by {{ per }}."
        "{% else %}Gain in expected log predictive density.{% endif %}",
        ("gain", "gain_modes"),
    ),
    PageFigure(
        "missing-terms",
        "misfit",
        of_table("missing_terms_readings", _missing_terms),
        "Residuals of the model, fitted jointly with the terms that would remove them: "
        "{{ terms | join(' and ') }}.",
        ("missing_terms_readings", "missing_terms"),
    ),
)
