"""Figure of five material laws: how each follows the films, and how well it predicts others."""

from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from bayesdeg.material.hyperelastic import nominal_stress
from bayesdeg.material.laws import CONSTANTS, FORMS
from bayesdeg.pages.drawing import (
    FULL_WIDTH,
    INK,
    MUTED,
    PAPER,
    PageFigure,
    Shown,
    Sketch,
    key,
    legend_above,
    level_colour,
    of_table,
    points,
    points_key,
    styled,
)
from bayesdeg.pages.tables import ALL_LEVELS
from bayesdeg.pages.wording import level_words, words
from bayesdeg.quantities import axis_label

COLUMNS, MOST_PANELS = 3, 5
type Dashes = tuple[float, tuple[float, ...]]
DASHES: tuple[Dashes, ...] = (
    (0.0, (1.0, 0.0)),
    (0.0, (5.0, 2.0)),
    (0.0, (1.0, 1.5)),
    (0.0, (6.0, 1.5, 1.0, 1.5)),
    (0.0, (6.0, 1.0, 1.0, 1.0, 1.0, 1.0)),
)
"""Line styles of the laws, in the order of `FORMS`, distinguishable without colours."""
POINTS = 80  # of a curve


def drawn_panels(laws: pd.DataFrame, tensile: pd.DataFrame) -> list[tuple[float, str]]:
    """Return the level [%] and the mode of each panel of curves, evenly chosen if there are many.

    Parameters
    ----------
    laws, tensile : pandas.DataFrame
        Tables ``material_laws`` and ``tensile``.
    """
    every = sorted({float(rate) for rate in laws["degradation_pct"] if rate != ALL_LEVELS})
    modes = list(dict.fromkeys(tensile.loc[tensile["fitted"] == 1, "mode"]))
    found = [one for one in product(every, modes) if len(_films(tensile, every, *one))]
    kept = np.linspace(0, len(found) - 1, min(len(found), MOST_PANELS)).round().astype(int)
    return [found[k] for k in kept]


@styled
def laws_figure(laws: pd.DataFrame, tensile: pd.DataFrame, *, degrades: bool = True) -> Figure:
    """Draw the errors of films that were left out, by law, and the curves of the laws.

    Parameters
    ----------
    laws, tensile : pandas.DataFrame
        Tables ``material_laws`` and ``tensile``.
    degrades : bool
        Whether anything of the study does, so that panels say of which rate they are.
    """
    chosen = drawn_panels(laws, tensile)
    judged = laws["held_out_rmse_MPa"].notna().any()
    rows = -(-(len(chosen) + int(judged)) // COLUMNS)
    figure = Figure(figsize=(FULL_WIDTH, 2.2 * rows + 0.45), layout="constrained")
    every_axes = list(figure.subplots(rows, COLUMNS, squeeze=False).flat)
    if judged:
        _draw_errors(every_axes.pop(0), laws, degrades=degrades)
    rates = laws["degradation_pct"].map(lambda r: np.nan if r == ALL_LEVELS else float(r))
    every = sorted(set(rates.dropna()))
    for axes, (level, mode) in zip(every_axes, chosen, strict=False):
        films = _films(tensile, every, level, mode)
        stretch = films["stretch"].to_numpy(float)
        grid = np.linspace(min(1.0, stretch.min()), stretch.max(), POINTS)
        for row in laws[rates == level].to_dict("records"):
            name = str(row["law"])
            constants = {one: float(row[one]) for one in CONSTANTS}
            axes.plot(
                grid,
                nominal_stress(FORMS[name].solid(constants), grid, mode=mode),
                color=_colour(name),
                linestyle=_dashes(name),
                linewidth=2.2 if row["used"] else 1.2,
            )
        points(axes, films["stretch"], films["stress_MPa"])
        axes.set_ylim(0.0 if films["stress_MPa"].min() >= 0.0 else None,
                      1.15 * films["stress_MPa"].max())  # fmt: skip
        axes.set_title(f"{mode}, {level_words(level)}" if degrades else mode)
        axes.set_xlabel(f"{axis_label('stretch')} [–]")
        axes.set_ylabel("nominal stress [MPa]")
    for axes in every_axes[len(chosen) :]:
        axes.set_axis_off()
    entries = {"measured": points_key()}
    for name in dict.fromkeys(laws["law"]):
        entries[words(name)] = key(_colour(name))
        entries[words(name)].set_linestyle(_dashes(name))
    legend_above(figure, entries)
    return figure


def _films(tensile: pd.DataFrame, every: list[float], level: float, mode: str) -> pd.DataFrame:
    """Return the readings of a mode whose degradation rate is nearest to a level."""
    here = tensile[(tensile["fitted"] == 1) & (tensile["mode"] == mode)]
    here = here.drop_duplicates(["specimen_id", "stretch", "stress_MPa"])
    rates = here["degradation_pct"].to_numpy(float)
    nearest = np.abs(rates[:, None] - np.array(every)).argmin(axis=1)
    found: pd.DataFrame = here[nearest == every.index(level)]
    return found


def _colour(name: str) -> str:
    return level_colour(list(FORMS).index(name), len(FORMS))


def _dashes(name: str) -> Dashes:
    return DASHES[list(FORMS).index(name)]


def _draw_errors(axes: Axes, laws: pd.DataFrame, *, degrades: bool) -> None:
    """Draw the error of films that were left out: at each rate, and of all."""
    names = list(dict.fromkeys(laws["law"]))
    for k, name in enumerate(names):
        here = laws[laws["law"] == name]
        pooled = here["degradation_pct"] == ALL_LEVELS
        if degrades:
            each = here.loc[~pooled, "held_out_rmse_MPa"]
            axes.plot(np.full(len(each), k), each, "_", color=MUTED, markersize=9)
        axes.plot([k], here.loc[pooled, "held_out_rmse_MPa"], "o", color=_colour(name),
                  markersize=6, markeredgecolor=PAPER)  # fmt: skip
    axes.set_yscale("log")
    for axis_format in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        # 1, 2 and 5 in each decade
        axis_format(FuncFormatter(lambda x, _=None: f"{x:g}" if f"{x:e}"[0] in "125" else ""))
    axes.set_xticks(range(len(names)), [words(name) for name in names], rotation=30, ha="right")
    axes.set_xlim(-0.5, len(names) - 0.5)
    axes.set_ylabel("rms error of held-out films [MPa]")
    axes.set_title("films left out in turn", color=INK)


def _laws(shown: Shown, laws: pd.DataFrame) -> Sketch | None:
    tensile = shown.tables["tensile"]
    if tensile is None:
        return None
    facts = {
        "judged": bool(laws["held_out_rmse_MPa"].notna().any()),
        "used": words(str(laws.loc[laws["used"] == 1, "law"].iloc[0])),
    }
    return Sketch(laws_figure(laws, tensile, degrades=shown.run.degrades), facts)


FIGURES = (
    PageFigure(
        "material-laws",
        "tensile",
        of_table("material_laws", _laws),
        "{% if judged %}First panel: error of films predicted from the others "
        "{% if degrades %}of their degradation rate, at each rate (dashes) and of all (points)"
        "{% else %}(points){% endif %}. {% endif %}Curves: five laws fitted to all films"
        "{% if degrades %} of a rate{% endif %}; the thick one, {{ used }}, is that of the model.",
        ("material_laws", "tensile"),
    ),
)
