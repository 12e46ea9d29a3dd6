"""Figure of five material laws: how each follows the films, and how well it predicts others."""

from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

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
    rates = laws.loc[laws["degradation_pct"] != ALL_LEVELS, "degradation_pct"]
    every = sorted({float(rate) for rate in rates})
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
    grid = list(figure.subplots(rows, COLUMNS, squeeze=False).flat)
    if judged:
        _draw_errors(grid.pop(0), laws, degrades=degrades)
    every = sorted({float(r) for r in laws["degradation_pct"] if r != ALL_LEVELS})
    for axes, (level, mode) in zip(grid, chosen, strict=False):
        films = _films(tensile, every, level, mode)
        _draw_laws(axes, _of_level(laws, level), mode, films["stretch"].to_numpy(float))
        points(axes, films["stretch"], films["stress_MPa"])
        axes.set_ylim(0.0 if films["stress_MPa"].min() >= 0.0 else None,
                      1.15 * films["stress_MPa"].max())  # fmt: skip
        axes.set_title(f"{mode}, {level_words(level)}" if degrades else mode)
        axes.set_xlabel(f"{axis_label('stretch')} [–]")
        axes.set_ylabel("nominal stress [MPa]")
    for axes in grid[len(chosen) :]:
        axes.set_axis_off()
    names = dict.fromkeys(laws["law"])
    legend_above(figure, {"measured": points_key()} | {words(n): _key(n) for n in names})
    return figure


def _films(tensile: pd.DataFrame, every: list[float], level: float, mode: str) -> pd.DataFrame:
    """Return the readings of a mode whose degradation rate is nearest to a level."""
    here = tensile[(tensile["fitted"] == 1) & (tensile["mode"] == mode)]
    here = here.drop_duplicates(["specimen_id", "stretch", "stress_MPa"])
    rates = here["degradation_pct"].to_numpy(float)
    nearest = np.abs(rates[:, None] - np.array(every)).argmin(axis=1)
    found: pd.DataFrame = here[nearest == every.index(level)]
    return found


def _of_level(laws: pd.DataFrame, level: float) -> pd.DataFrame:
    rates = laws["degradation_pct"].map(lambda r: np.nan if r == ALL_LEVELS else float(r))
    here: pd.DataFrame = laws[rates == level]
    return here


def _colour(name: str) -> str:
    return level_colour(list(FORMS).index(name), len(FORMS))


def _key(name: str) -> Line2D:
    entry = key(_colour(name))
    entry.set_linestyle(DASHES[list(FORMS).index(name)])
    return entry


def _draw_laws(axes: Axes, laws: pd.DataFrame, mode: str, stretch: NDArray[np.float64]) -> None:
    grid = np.linspace(min(1.0, stretch.min()), stretch.max(), POINTS)
    for row in laws.to_dict("records"):
        name = str(row["law"])
        constants = {one: float(row[one]) for one in CONSTANTS}
        stress = nominal_stress(FORMS[name].solid(constants), grid, mode=mode)
        axes.plot(
            grid,
            stress,
            color=_colour(name),
            linestyle=DASHES[list(FORMS).index(name)],
            linewidth=2.2 if row["used"] else 1.2,
        )


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
        axis_format(FuncFormatter(_plain))
    axes.set_xticks(range(len(names)), [words(name) for name in names], rotation=30, ha="right")
    axes.set_xlim(-0.5, len(names) - 0.5)
    axes.set_ylabel("rms error of held-out films [MPa]")
    axes.set_title("films left out in turn", color=INK)


def _plain(value: float, _place: int | None = None) -> str:
    """Word a tick of a logarithmic axis: 1, 2 and 5 in each decade."""
    return f"{value:g}" if f"{value:e}"[0] in "125" else ""


def _laws(shown: Shown) -> Sketch | None:
    laws, tensile = shown.tables["material_laws"], shown.tables["tensile"]
    if laws is None or tensile is None:
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
        _laws,
        "{% if judged %}First panel: error of films predicted from the others "
        "{% if degrades %}of their degradation rate, at each rate (dashes) and of all (points)"
        "{% else %}(points){% endif %}. {% endif %}Curves: five laws fitted to all films"
        "{% if degrades %} of a rate{% endif %}; the thick one, {{ used }}, is that of the model.",
        ("material_laws", "tensile"),
    ),
)
