"""Figures of the checks of a posterior: ranks of chains, leave-one-out, influence of priors."""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

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
    hollow_key,
    key,
    legend_above,
    level_colour,
    of_table,
    panels,
    points,
    points_key,
    quantile_bands,
    rate_title,
    single,
    styled,
)
from bayesdeg.pages.folder import POSTERIOR
from bayesdeg.pages.summaries import MOST_LEVELS, nearest_level, panel_levels
from bayesdeg.pages.tables import present
from bayesdeg.pages.wording import level_words, words
from bayesdeg.quantities import axis_label

BINS = 10  # bins of ranks: 50 draws each at quick effort, or noise dominates
CHANCE = 3.0  # standard deviations of the number of draws in a bin: the band
MOST = 12  # parameters, those that mix worst
RELIABLE_K = 0.7
NOTICEABLE = 0.05
PRIOR = "prior: median, 50 % and 90 % band"


def rank_counts(draws: NDArray[np.float64], bins: int = BINS) -> NDArray[np.float64]:
    """Return the rank histogram of each chain, over the expected count of a bin.

    Chains that sample the same law have uniform ranks, so all counts are near 1. A shifted chain
    has a slope, one that is too narrow a hump.

    Parameters
    ----------
    draws : array, shape (n_chains, n_draws)
        Of one parameter.
    bins : int
        Into which the ranks of all draws together are divided.

    Returns
    -------
    array, shape (n_chains, bins)

    References
    ----------
    Vehtari, Gelman, Simpson, Carpenter and Bürkner (2021), doi:10.1214/20-BA1221

    Examples
    --------
    >>> rank_counts(np.array([[0.0, 1.0], [2.0, 3.0]]), bins=2)
    array([[2., 0.],
           [0., 2.]])
    """
    ranks = rankdata(draws, method="average").reshape(draws.shape) - 0.5
    place = np.minimum((ranks * bins / draws.size).astype(int), bins - 1)
    counts = np.stack([np.bincount(row, minlength=bins) for row in place])
    return np.asarray(counts * bins / draws.shape[1], np.float64)


@styled
def rank_figure(posterior: xr.Dataset) -> Figure:
    """Draw the ranks of the draws of each chain, one panel per parameter.

    Parameters
    ----------
    posterior : xarray.Dataset
        Draws by parameter, (chain, draw).
    """
    every = {str(name): rank_counts(values.to_numpy()) for name, values in posterior.items()}
    worst = sorted(every, key=lambda name: -float(np.abs(every[name] - 1.0).max()))[:MOST]
    figure, every_axes = panels(len(worst), columns=4, height=1.5)
    # draws of a chain are thinned, and so nearly independent
    width = CHANCE * np.sqrt(BINS / posterior.sizes["draw"])
    middle = (np.arange(BINS) + 0.5) / BINS
    for axes, name in zip(every_axes, [n for n in every if n in worst], strict=True):
        axes.axhspan(1.0 - width, 1.0 + width, color=MUTED, alpha=0.22, linewidth=0)
        for index, counts in enumerate(every[name]):
            colour = level_colour(index, len(every[name]))
            axes.step(middle, counts, where="mid", color=colour, linewidth=0.9)
        axes.set_title(words(name), fontsize=7.0)
        axes.set_xlim(0.0, 1.0)
        axes.set_ylim(bottom=0.0)
    figure.supxlabel("rank among the draws of all chains, normalised [–]")
    figure.supylabel("draws, over their expected number [–]")
    return figure


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
    priors = key(BASE_COLOUR, marker="o", line=False)
    legend_above(figure, {"priors": priors, "likelihood": hollow_key(FINAL_COLOUR)})
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
        here = prior[prior["degradation_pct"] == level].sort_values("pressure_kPa")
        quantile_bands(axes, "pressure_kPa", here, MUTED)
        axes.set_title(rate_title(level, degrades=degrades))
    if observations is not None:
        readings = observations.drop_duplicates(["specimen_id", "pressure_kPa", "cycle", "branch"])
        panel = nearest_level(readings["degradation_pct"], levels)
        for axes, level in zip(every_axes, levels, strict=True):
            here = readings[panel == level]
            points(axes, here["pressure_kPa"], here["curvature_per_m"])
    figure.supxlabel(axis_label("pressure_kPa"))
    figure.supylabel(axis_label("curvature_per_m"))
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
        quantile_bands(axes, "stretch", here.sort_values("stretch"), MUTED)
        axes.set_title(f"{mode}, {level_words(level)}" if degrades else mode)
        if tensile is not None:
            levels = [rate for other, rate in kinds if other == mode]
            films = tensile[(tensile["mode"] == mode) & (tensile["fitted"] > 0.5)]
            films = films.drop_duplicates(["specimen_id", "stretch", "stress_MPa"])
            films = films[nearest_level(films["degradation_pct"], levels) == level]
            for _, curve in films.groupby("specimen_id", sort=False):
                axes.plot(curve["stretch"], curve["stress_MPa"], color=INK, linewidth=0.9)
    figure.supxlabel(f"{axis_label('stretch')} [–]")
    figure.supylabel("nominal stress [MPa]")
    entries = {PRIOR: key(MUTED)}
    legend_above(figure, entries | ({"measured": key(INK)} if tensile is not None else {}))
    return figure


def _ranks(shown: Shown) -> Sketch | None:
    # updated draws do not come from chains
    posterior = shown.posterior(POSTERIOR) if shown.run.update is None else None
    if posterior is None or min(posterior.sizes.values(), default=0) < 2:
        return None
    facts = {
        "chains": posterior.sizes["chain"],
        "drawn": min(len(posterior), MOST),
        "parameters": len(posterior),
        "chance": CHANCE,
    }
    return Sketch(rank_figure(posterior), facts)


def _prior_curvature(shown: Shown, prior: pd.DataFrame) -> Sketch | None:
    curvature = present(prior[prior["quantity"] == "curvature"])
    if curvature is None:
        return None
    observations, degrades = shown.tables["observations"], shown.run.degrades
    return Sketch(prior_curvature_figure(curvature, observations, degrades=degrades))


def _prior_stress(shown: Shown, prior: pd.DataFrame) -> Sketch | None:
    stress = present(prior[prior["quantity"] == "nominal_stress"])
    if stress is None:
        return None
    tensile, degrades = shown.tables["tensile"], shown.run.degrades
    return Sketch(prior_stress_figure(stress, tensile, degrades=degrades))


FIGURES = (
    PageFigure(
        "ranks",
        "posterior",
        _ranks,
        "Ranks of the draws of each of {{ chains }} chains among those of "
        "all, for the final model. If all chains sample the same posterior, every line stays near "
        "1; the band is {{ chance | number(1) }} standard deviations of independent draws. A "
        "sloping chain is shifted against the others, one with a hump is too narrow."
        "{% if drawn < parameters %} The {{ drawn }} of {{ parameters }} parameters that depart "
        "most are drawn.{% endif %}",
        title="Do the chains agree?",
    ),
    PageFigure(
        "leave-one-out",
        "posterior",
        of_table("leave_one_out", lambda _, table: Sketch(leave_one_out_figure(table))),
        "Every specimen left out in turn. Above: shape k of the importance weights. From 0.7 on "
        "they are unreliable, and the model was calibrated again without that specimen "
        "(filled). Below: what its own readings add to its log density.",
        ("leave_one_out",),
    ),
    PageFigure(
        "prior-sensitivity",
        "posterior",
        of_table("prior_sensitivity", lambda _, table: Sketch(sensitivity_figure(table))),
        "How much the posterior of each conclusion changes when the weight of all priors, or of "
        "the likelihood, is doubled. Right of the dashed line the priors matter noticeably, if "
        "that is more than the noise of the draws (table).",
        ("prior_sensitivity",),
    ),
    PageFigure(
        "prior-curvature",
        "posterior",
        of_table("prior_predictive", _prior_curvature),
        "Prior predictive curvature against pressure: 50 % and 90 % bands of the draws that have "
        "an equilibrium, median, and the readings.",
        ("prior_predictive", "observations"),
    ),
    PageFigure(
        "prior-stress",
        "posterior",
        of_table("prior_predictive", _prior_stress),
        "Prior predictive nominal stress against stretch: 50 % and 90 % bands, median, and the "
        "readings.",
        ("prior_predictive", "tensile"),
    ),
)
