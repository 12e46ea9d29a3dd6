"""Figures of the checks of a posterior: leave-one-out, prior sensitivity, prior predictions."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.pages.drawing import (
    BASE_COLOUR,
    FINAL_COLOUR,
    FULL_WIDTH,
    INK,
    MUTED,
    PAPER,
    PageFigure,
    Shown,
    Sketch,
    band,
    key,
    legend_above,
    panels,
    points,
    points_key,
    rate_title,
    single,
    styled,
)
from bayesdeg.pages.summaries import MOST_LEVELS, nearest_level, panel_levels
from bayesdeg.pages.tables import present
from bayesdeg.pages.wording import level_words
from bayesdeg.quantities import axis_label

RELIABLE_K = 0.7
NOTICEABLE = 0.05
PRIOR = "prior: median, 50 % and 90 % band"


@styled
def leave_one_out_figure(specimens: pd.DataFrame) -> Figure:
    """Draw reliability and influence of every specimen.

    Parameters
    ----------
    specimens : pandas.DataFrame
        Table ``leave_one_out``.
    """
    figure, (shape, influence) = panels(2, columns=1, share_y="none", height=1.7)
    place = np.arange(len(specimens))
    refitted = specimens["refitted"].to_numpy() > 0.5
    k = np.minimum(specimens["pareto_k"].to_numpy(float), 1.5)
    shape.axhline(RELIABLE_K, color=MUTED, linestyle="--", linewidth=0.9)
    points(shape, place[~refitted], k[~refitted])
    shape.plot(place[refitted], k[refitted], "o", color=BASE_COLOUR, markersize=4.5)
    shape.set_ylabel("Pareto k [–]")
    influence.bar(place, specimens["influence"], color=FINAL_COLOUR, width=0.62)
    influence.set_ylabel("influence [–]")
    influence.set_xticks(place, specimens["specimen_id"].astype(str), rotation=90, fontsize=6.0)
    influence.set_xlim(-0.7, len(specimens) - 0.3)
    for axes in (shape, influence):
        axes.grid(visible=False, axis="x")
    return figure


@styled
def sensitivity_figure(sensitivity: pd.DataFrame) -> Figure:
    """Draw the sensitivity of conclusions to priors and likelihood.

    Parameters
    ----------
    sensitivity : pandas.DataFrame
        Table ``prior_sensitivity``, of which only the conclusions are drawn if there are any.
    """
    stated = sensitivity["kind"] == "conclusion"
    chosen = (sensitivity[stated] if stated.any() else sensitivity).iloc[::-1]
    figure, axes = single(width=FULL_WIDTH, height=0.7 + 0.26 * len(chosen))
    place = np.arange(len(chosen))
    axes.axvline(NOTICEABLE, color=MUTED, linestyle="--", linewidth=0.9)
    axes.hlines(place, chosen["prior"], chosen["likelihood"], color=MUTED, linewidth=0.8)
    axes.plot(chosen["prior"], place, "o", color=BASE_COLOUR, markersize=5.0)
    axes.plot(
        chosen["likelihood"],
        place,
        "o",
        color=FINAL_COLOUR,
        markersize=5.0,
        markerfacecolor=PAPER,
    )
    axes.set_yticks(place, chosen["quantity"].astype(str))
    axes.set_ylim(-0.6, len(chosen) - 0.4)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("change of the posterior per doubling [–]")
    axes.grid(visible=False, axis="y")
    hollow = key(FINAL_COLOUR, marker="o", line=False)
    hollow.set(markerfacecolor=PAPER)
    legend_above(figure, {"priors": key(BASE_COLOUR, marker="o", line=False), "likelihood": hollow})
    return figure


@styled
def prior_curvature_figure(
    prior: pd.DataFrame, observations: pd.DataFrame | None, *, degrades: bool = True
) -> Figure:
    """Draw the prior predictive curvature and the readings, one panel per degradation rate.

    Parameters
    ----------
    prior : pandas.DataFrame
        Rows of table ``prior_predictive`` for the curvature.
    observations : pandas.DataFrame, optional
        Table ``observations``.
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
    """
    levels = panel_levels(prior)
    figure, every_axes = panels(len(levels))
    for axes, level in zip(every_axes, levels, strict=True):
        _draw_prior(axes, prior[prior["degradation_pct"] == level], "pressure_kPa")
        axes.set_title(rate_title(level, degrades=degrades))
    if observations is not None:
        readings = observations.drop_duplicates(["specimen_id", "pressure_kPa", "cycle", "branch"])
        panel = nearest_level(readings["degradation_pct"], levels)
        for axes, level in zip(every_axes, levels, strict=True):
            here = readings[panel == level]
            points(axes, here["pressure_kPa"], here["curvature_per_m"])
    figure.supxlabel(axis_label("pressure_kPa"), fontsize=8.0)
    figure.supylabel(axis_label("curvature_per_m"), fontsize=8.0)
    entries = {PRIOR: key(MUTED)}
    legend_above(figure, entries | ({} if observations is None else {"measured": points_key()}))
    return figure


@styled
def prior_stress_figure(
    prior: pd.DataFrame, tensile: pd.DataFrame | None, *, degrades: bool = True
) -> Figure:
    """Draw the prior predictive stress and the readings, one panel per mode and degradation rate.

    Parameters
    ----------
    prior : pandas.DataFrame
        Rows of table ``prior_predictive`` for the stress.
    tensile : pandas.DataFrame, optional
        Table ``tensile``.
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
    """
    pairs = prior[["mode", "degradation_pct"]].drop_duplicates()
    kinds = [(str(row["mode"]), float(row["degradation_pct"])) for _, row in pairs.iterrows()]
    kept = np.linspace(0, len(kinds) - 1, min(len(kinds), MOST_LEVELS)).round().astype(int)
    shown = [kinds[i] for i in kept]
    figure, every_axes = panels(len(shown), height=2.2)
    for axes, (mode, level) in zip(every_axes, shown, strict=True):
        here = prior[(prior["mode"] == mode) & (prior["degradation_pct"] == level)]
        _draw_prior(axes, here, "stretch")
        axes.set_title(f"{mode}, {level_words(level)}" if degrades else mode)
        if tensile is not None:
            _draw_films(
                axes, tensile, mode, level, [rate for other, rate in kinds if other == mode]
            )
    figure.supxlabel(f"{axis_label('stretch')} [–]", fontsize=8.0)
    figure.supylabel("nominal stress [MPa]", fontsize=8.0)
    entries = {PRIOR: key(MUTED)}
    legend_above(figure, entries | ({"measured": key(INK)} if tensile is not None else {}))
    return figure


def _draw_prior(axes: Axes, here: pd.DataFrame, along: str) -> None:
    curve = here.sort_values(along)
    band(axes, curve[along], curve["q05"], curve["q95"], MUTED, 0.18)
    band(axes, curve[along], curve["q25"], curve["q75"], MUTED, 0.28)
    axes.plot(curve[along], curve["q50"], color=MUTED)


def _draw_films(
    axes: Axes, tensile: pd.DataFrame, mode: str, level: float, levels: list[float]
) -> None:
    films = tensile[(tensile["mode"] == mode) & (tensile["fitted"] > 0.5)]
    films = films.drop_duplicates(["specimen_id", "stretch", "stress_MPa"])
    here = films[nearest_level(films["degradation_pct"], levels) == level]
    for _, curve in here.groupby("specimen_id", sort=False):
        axes.plot(curve["stretch"], curve["stress_MPa"], color=INK, linewidth=0.9)


def _leave_one_out(shown: Shown) -> Sketch | None:
    specimens = shown.tables["leave_one_out"]
    return None if specimens is None else Sketch(leave_one_out_figure(specimens))


def _sensitivity(shown: Shown) -> Sketch | None:
    sensitivity = shown.tables["prior_sensitivity"]
    return None if sensitivity is None else Sketch(sensitivity_figure(sensitivity))


def _prior_curvature(shown: Shown) -> Sketch | None:
    curvature = _of_priors(shown, "curvature")
    if curvature is None:
        return None
    observations, degrades = shown.tables["observations"], shown.run.degrades
    return Sketch(prior_curvature_figure(curvature, observations, degrades=degrades))


def _prior_stress(shown: Shown) -> Sketch | None:
    stress = _of_priors(shown, "nominal_stress")
    if stress is None:
        return None
    tensile, degrades = shown.tables["tensile"], shown.run.degrades
    return Sketch(prior_stress_figure(stress, tensile, degrades=degrades))


def _of_priors(shown: Shown, quantity: str) -> pd.DataFrame | None:
    prior = shown.tables["prior_predictive"]
    return None if prior is None else present(prior[prior["quantity"] == quantity])


FIGURES = (
    PageFigure(
        "leave-one-out",
        "posterior",
        _leave_one_out,
        "Every specimen left out in turn. Above: shape k of the importance weights. From 0.7 on "
        "they are unreliable, and the model was calibrated again without that specimen "
        "(filled). Below: what its own readings add to its log density.",
        ("leave_one_out",),
    ),
    PageFigure(
        "prior-sensitivity",
        "posterior",
        _sensitivity,
        "How much the posterior of each conclusion changes when the weight of all priors, or of "
        "the likelihood, is doubled. Right of the dashed line the priors matter noticeably, if "
        "that is more than the noise of the draws (table).",
        ("prior_sensitivity",),
    ),
    PageFigure(
        "prior-curvature",
        "posterior",
        _prior_curvature,
        "Prior predictive curvature against pressure: 50 % and 90 % bands of the draws that have "
        "an equilibrium, median, and the readings.",
        ("prior_predictive", "observations"),
    ),
    PageFigure(
        "prior-stress",
        "posterior",
        _prior_stress,
        "Prior predictive nominal stress against stretch: 50 % and 90 % bands, median, and the "
        "readings.",
        ("prior_predictive", "tensile"),
    ),
)
