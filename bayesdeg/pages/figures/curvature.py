"""Figures of the actuator: curvature, residuals, what was set aside, rupture, null misfit."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.stats import beta

from bayesdeg.criticism.checks.count_misfit import PUBLISHED
from bayesdeg.criticism.findings import RuptureCountsEntry
from bayesdeg.data.levels import LEVEL_WIDTH
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
    area_key,
    band,
    intervals,
    key,
    label_rates,
    legend_above,
    level_colour,
    model_keys,
    of_table,
    panels,
    points,
    points_key,
    quantile_bands,
    rate_title,
    single,
    styled,
)
from bayesdeg.pages.summaries import BASE, FINAL, by_level, nearest_level, panel_levels
from bayesdeg.pages.wording import level_words, words
from bayesdeg.quantities import UNLOADING, axis_label


@styled
def bands_figure(
    bands: pd.DataFrame,
    observations: pd.DataFrame | None,
    levels: Sequence[float],
    *,
    degrades: bool = True,
) -> Figure:
    """Draw the curvature bands with the measured readings, one panel per degradation rate.

    Parameters
    ----------
    bands : pandas.DataFrame
        Table ``bands``.
    observations : pandas.DataFrame, optional
        Table ``observations``: readings as points, what the models say of them as dashed lines.
    levels : sequence of float
        Degradation rates of the bands that get a panel [%].
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
    """
    figure, every_axes = panels(len(levels))
    for axes, level in zip(every_axes, levels, strict=True):
        chosen = bands[bands["degradation_pct"] == level].sort_values("pressure_kPa")
        quantile_bands(axes, "pressure_kPa", chosen, FINAL_COLOUR)
        axes.set_title(rate_title(level, degrades=degrades))
    entries = {"new specimen: median, 50 % and 90 % band": key(FINAL_COLOUR)}
    if observations is not None:
        panel = nearest_level(observations["degradation_pct"], levels)
        for axes, level in zip(every_axes, levels, strict=True):
            here = observations[panel == level]
            for model in (BASE, FINAL):
                _draw_means(axes, here[here["model"] == model], COLOURS[model])
            readings = here[here["model"] == BASE]
            points(axes, readings["pressure_kPa"], readings["curvature_per_m"])
        entries["measured"] = points_key()
        entries |= model_keys(observations, dashed=True)
    figure.supxlabel(axis_label("pressure_kPa"))
    figure.supylabel(axis_label("curvature_per_m"))
    legend_above(figure, entries)
    return figure


@styled
def rupture_figure(
    rupture: pd.DataFrame,
    counts: Sequence[RuptureCountsEntry] = (),
    tested: float | None = None,
    *,
    degrades: bool = True,
) -> Figure:
    """Draw the probability of rupture against pressure, one curve per degradation rate.

    Parameters
    ----------
    rupture : DataFrame
        The columns of ``rupture.csv``.
    counts : sequence of RuptureCountsEntry
        How many burst: a point with its interval where they were tested to.
    tested : float, optional
        Largest pressure of the tests [kPa]; beyond, curves are dashed.
    degrades : bool
        Whether anything of the study does, so that a legend tells the rates apart.
    """
    figure, axes = single()
    levels = np.unique(rupture["degradation_pct"].to_numpy(float))
    for index, level in enumerate(levels):
        curve = rupture[rupture["degradation_pct"] == level].sort_values("pressure_kPa")
        colour, pressure = level_colour(index, levels.size), curve["pressure_kPa"]
        band(axes, pressure, curve["probability_q05"], curve["probability_q95"], colour, 0.16)
        within = np.ones(len(curve), bool) if tested is None else (pressure <= tested).to_numpy()
        axes.plot(pressure[within], curve["probability"][within], color=colour)
        axes.plot([], [], color=colour, label=level_words(level))
        beyond = ~within | np.append(~within[1:], False)
        if not within.all():
            axes.plot(pressure[beyond], curve["probability"][beyond], color=colour, ls="--")
        _draw_counts(axes, counts, level, colour, index - 0.5 * (levels.size - 1))
    axes.set(ylim=(-0.02, 1.02), xlabel=axis_label("pressure_kPa"))
    axes.set_ylabel("probability of rupture [–]")
    if degrades:
        axes.legend(title="degradation", loc="best", handlelength=1.2)
    return figure


NEAR = 1.5  # points of degradation between specimens that are drawn together
APART = 4.0  # kPa between counts of several degradation rates that were tested to one pressure
INTERVAL = (0.05, 0.95)


def _draw_counts(
    axes: Axes,
    counts: Sequence[RuptureCountsEntry],
    level: float,
    colour: str,
    place: float,
) -> None:
    """Draw the shares of a level that burst, published ones filled, with 90 % intervals."""
    for one in counts:
        for row in one.levels:
            if not (abs(row.degradation_pct - level) <= LEVEL_WIDTH and row.tested > 0):
                continue
            burst, tested = float(row.ruptured), float(row.tested)
            low, high = share_interval(burst, tested)
            at = row.pressure_kPa + APART * place
            axes.plot([at, at], [low, high], color=colour, lw=0.8)
            fill = colour if one.source == PUBLISHED else PAPER
            axes.plot([at], [burst / tested], "o", ms=3.5, mec=colour, mfc=fill)


def share_interval(burst: float, tested: float) -> tuple[float, float]:
    """Return the 90 % interval of a binomial share.

    That of Jeffreys, with an end at 0 or 1 if none or all burst.

    References
    ----------
    Brown, Cai and DasGupta (2001), Statistical Science 16:101; doi:10.1214/ss/1009213286.

    Examples
    --------
    >>> [round(end, 2) for end in share_interval(2.0, 3.0)]
    [0.24, 0.94]
    """
    law = beta(burst + 0.5, tested - burst + 0.5)
    low = 0.0 if burst == 0.0 else float(law.ppf(INTERVAL[0]))
    return low, 1.0 if burst == tested else float(law.ppf(INTERVAL[1]))


@styled
def elongation_figure(elongation: pd.DataFrame, *, degrades: bool = True) -> Figure:
    """Draw the elongation limit against the degradation rate, with measurements.

    If nothing degrades, there is one position on an axis without a label.
    """
    figure, axes = single()
    limit = elongation[elongation["kind"] == "band"].sort_values("degradation_pct")
    measured = elongation[elongation["kind"] == "measured"]
    if np.unique(limit["degradation_pct"]).size == 1:
        only = limit[["degradation_pct", "q05", "q50", "q95"]].iloc[0]
        intervals(axes, float(only["degradation_pct"]), only, FINAL_COLOUR)
        axes.plot([], [], "o-", color=FINAL_COLOUR, label="median, 90 % interval")
    else:
        band(axes, limit["degradation_pct"], limit["q05"], limit["q95"], FINAL_COLOUR, 0.22)
        label = "median, 90 % band"
        axes.plot(limit["degradation_pct"], limit["q50"], color=FINAL_COLOUR, label=label)
    points(axes, measured["degradation_pct"], measured["value"], "measured")
    label_rates(figure, [axes], degrades=degrades)
    axes.set_ylabel("elongation at break [%]")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return figure


@styled
def null_figure(null: pd.DataFrame, *, observed: float | None, name: str) -> Figure:
    """Draw the misfit statistic of data simulated from the base model, and the observed one."""
    figure, axes = single(height=2.4)
    axes.hist(null["statistic"].dropna(), bins="auto", color=MUTED, alpha=0.55)
    entries = {"if the base model were right": area_key(width=5, alpha=0.55)}
    if observed is not None:
        axes.axvline(observed, color=BASE_COLOUR, linewidth=2)
        entries["this study"] = key(BASE_COLOUR)
    axes.set(xlabel=f"{name or 'misfit statistic'} [–]", ylabel="simulated studies [–]")
    legend_above(figure, entries)
    return figure


def _draw_means(axes: Axes, chosen: pd.DataFrame, colour: str) -> None:
    """Draw a model's predictions for the measured specimens."""
    for _, curve in chosen.groupby(["specimen_id", "branch", "cycle"], sort=False, dropna=False):
        axes.plot(
            curve["pressure_kPa"],
            curve["mean_per_m"],
            color=colour,
            linewidth=0.9,
            linestyle=(0, (4, 2)),
        )


@styled
def residual_figure(
    observations: pd.DataFrame,
    levels: Sequence[float],
    *,
    noise_per_m: float | None,
    specimens: Sequence[str] = (),
    degrades: bool = True,
) -> Figure:
    """Draw curvature residuals against pressure, one panel per degradation rate.

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
        Specimens with most of the misfit: drawn thick, with their names.
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
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
        axes.set_title(rate_title(level, degrades=degrades))
    figure.supxlabel(axis_label("pressure_kPa"))
    figure.supylabel("measured − simulated [1/m]")
    entries = model_keys(observations, marker="o")
    if noise_per_m is not None:
        entries["± one standard deviation of the noise"] = area_key()
    unloading = (observations["branch"] == UNLOADING).to_numpy(bool)
    later = (observations["cycle"] > 1).to_numpy(bool)
    legend_above(figure, entries | path_keys(unloading, later))
    return figure


@styled
def suspects_figure(rows: pd.DataFrame) -> Figure:
    """Draw curvature against pressure, with what was set aside marked: a panel a specimen.

    Parameters
    ----------
    rows : pandas.DataFrame
        Table ``set_aside``.
    """
    names = list(dict.fromkeys(rows.loc[rows["set_aside"] > 0, "specimen_id"].astype(str)))
    figure, every_axes = panels(len(names), share_y="none")
    for axes, name in zip(every_axes, names, strict=True):
        own = rows["specimen_id"].astype(str) == name
        rate = float(rows.loc[own, "degradation_pct"].iloc[0])
        alike = ~own & (np.abs(rows["degradation_pct"] - rate) <= NEAR)
        near = rows[alike & (rows["set_aside"] == 0)]
        for _, other in near.groupby("specimen_id", sort=False):
            axes.plot(other["pressure_kPa"], other["curvature_per_m"], color=MUTED, linewidth=0.8)
        itself = rows[own]
        curve = (itself["pressure_kPa"], itself["curvature_per_m"])
        axes.plot(*curve, color=MUTED, linewidth=0.8, linestyle="--")
        odd = itself[itself["set_aside"] > 0]
        axes.plot(odd["pressure_kPa"], odd["curvature_per_m"], "o", color=BASE_COLOUR, markersize=3)
        axes.set_title(f"{name}, {rate:.3g} %")
    figure.supxlabel(axis_label("pressure_kPa"))
    figure.supylabel(axis_label("curvature_per_m"))
    entries = {
        "set aside": key(BASE_COLOUR, marker="o", line=False),
        "the specimen itself": key(MUTED, dashed=True),
        "others of the same rate": key(MUTED),
    }
    legend_above(figure, entries)
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


def _residuals(shown: Shown, observations: pd.DataFrame) -> Sketch:
    misfit = shown.verdict.misfit
    levels = panel_levels(by_level(shown.tables["levels"]), shown.tables["bands"], observations)
    figure = residual_figure(
        observations,
        levels,
        noise_per_m=misfit.noise_per_m,
        specimens=misfit.specimens,
        degrades=shown.run.degrades,
    )
    facts = {
        "unloading": bool((observations["branch"] == UNLOADING).any()),
        "later_cycles": bool((observations["cycle"] > 1).any()),
        "specimens": misfit.specimens,
    }
    return Sketch(figure, facts)


def _suspects(_: Shown, rows: pd.DataFrame) -> Sketch | None:
    out = rows[rows["set_aside"] > 0]
    if out.empty:
        return None
    names = dict.fromkeys(out["specimen_id"].astype(str))
    return Sketch(suspects_figure(rows), {"count": len(out), "names": list(map(words, names))})


def _null(shown: Shown, null: pd.DataFrame) -> Sketch:
    statistic = shown.run.misfit
    figure = null_figure(null, observed=statistic.observed, name=statistic.name)
    return Sketch(figure, {"studies": len(null), "observed": statistic.observed})


def _bands(shown: Shown, bands: pd.DataFrame) -> Sketch:
    observations, levels = shown.tables["observations"], panel_levels(bands)
    facts = {"levels": levels, "measured": observations is not None}
    figure = bands_figure(bands, observations, levels, degrades=shown.run.degrades)
    return Sketch(figure, facts)


def _rupture(shown: Shown, rupture: pd.DataFrame) -> Sketch:
    model, counts = shown.run.model, shown.verdict.rupture_counts
    measured = () if model is None else model.measured.get("pressure_kPa", ())
    tested = measured[-1] if measured else None
    within = rupture if tested is None else rupture[rupture["pressure_kPa"] <= tested]
    facts = {
        "largest": float(within["probability"].max()),
        "checks": None if model is None else model.rupture_checks,
        "beyond": len(within) < len(rupture),
        "tested": tested,
        "counts": any(one.levels for one in counts),
    }
    figure = rupture_figure(rupture, counts, tested, degrades=shown.run.degrades)
    return Sketch(figure, facts)


def _elongation(shown: Shown, elongation: pd.DataFrame) -> Sketch:
    return Sketch(elongation_figure(elongation, degrades=shown.run.degrades))


FIGURES = (
    PageFigure(
        "residuals",
        "misfit",
        of_table("observations", _residuals),
        "Measured less simulated curvature against pressure: "
        "{% if degrades %}a panel for each degradation rate, {% endif %}a line for each specimen. "
        "If the model is right, readings scatter about zero within the noise. "
        "{% if unloading %}Unloading is dashed, with hollow marks.{% endif %}"
        "{% if later_cycles %} Squares are of cycles after the first.{% endif %}"
        "{% if specimens %} Most of the misfit is in {{ specimens | join(' and ') }}: the thick "
        "lines.{% endif %}",
        ("observations",),
    ),
    PageFigure(
        "null",
        "misfit",
        of_table("misfit_null", _null),
        "The misfit statistic of {{ studies }} studies simulated from the fitted base model; in "
        "this study it is {{ observed | number }}.",
        ("misfit_null",),
        half=True,
    ),
    PageFigure(
        "bands",
        "curvature",
        of_table("bands", _bands),
        "Measured curvature against pressure, and the curvature predicted for new specimens"
        "{% if degrades %} at {{ levels | map('level') | join(', ') }} degradation. All panels "
        "have one scale{% endif %}."
        "{% if measured %} Dashed: what the models predict for the measured specimens themselves, "
        "{% if degrades %}at their own degradation rate and {% endif %}with their own history of "
        "loading.{% if degrades %} The bands are for a new specimen at the rate of the panel."
        "{% endif %}{% endif %}",
        ("bands", "observations"),
    ),
    PageFigure(
        "rupture",
        "rupture",
        of_table("rupture", _rupture),
        "Probability that the actuator bursts up to a pressure, with its 90 % interval."
        "{% if beyond %} Dashed: above the {{ tested | number }} kPa that were tested, up to the "
        "end of the forward map's range.{% endif %}"
        "{% if counts %} Points: shares that burst, with 90 % intervals, filled if published, "
        "moved apart along the pressure.{% endif %}"
        "{% if checks %} Less than 1 in {{ checks | count }}, the films broken and actuators "
        "loaded, is drawn as that bound.{% endif %}",
        ("rupture",),
        half=True,
    ),
    PageFigure(
        "elongation",
        "rupture",
        of_table("elongation", _elongation),
        "Elongation at break{% if degrades %} against degradation rate: 90 % band{% else %}: "
        "median, 90 % interval{% endif %} and measured specimens.",
        ("elongation",),
        half=True,
    ),
    PageFigure(
        "suspects",
        "data",
        of_table("set_aside", _suspects),
        "Curvature against pressure of specimens with readings set aside, and others of "
        "the same degradation rate: {{ count }} reading{{ 's' if count != 1 }} of "
        "{{ names | listed }} excluded from calibration and verdict.",
        ("set_aside", "suspects"),
        title="Readings that were set aside",
    ),
)
