"""The life of an actuator in the soil: failure, curvature and pressure against time."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesdeg.pages.drawing import (
    BASE_COLOUR,
    FINAL_COLOUR,
    INK,
    PageFigure,
    Shown,
    Sketch,
    band,
    key,
    legend_above,
    of_table,
    panels,
    styled,
)
from bayesdeg.quantities import axis_label

HALF = 0.5


@styled
def lifetime_figure(lifetime: pd.DataFrame) -> Figure:
    """Draw the probability of failing, the curvature of the duty, and the pressure that keeps it.

    Parameters
    ----------
    lifetime : pandas.DataFrame
        Table ``lifetime``.
    """
    figure, (failing, bending, keeping) = panels(3, columns=3, share_y="none", height=2.4)
    table = lifetime.sort_values("time_h")
    time = table["time_h"]
    band(failing, time, table["failed_q05"], table["failed_q95"], FINAL_COLOUR, 0.22)
    failing.plot(time, table["failed_probability"], color=FINAL_COLOUR)
    failing.plot(time, table["burst_probability"], color=BASE_COLOUR, linestyle="--")
    failing.set_ylim(-0.02, 1.02)
    failing.set_ylabel("cumulative probability")
    _banded(bending, table, "_per_m", table["wanted_per_m"])
    bending.set_ylabel(axis_label("curvature_per_m"))
    _banded(keeping, table, "_kPa", table["allowed_kPa"], prefix="needed_")
    keeping.set_ylabel(axis_label("pressure_kPa"))
    titles = ("failed", "curvature at that pressure", "needed for the curvature")
    for axes, title in zip((failing, bending, keeping), titles, strict=True):
        axes.set_title(title)
        axes.set_xlabel(axis_label("time_h"))
    entries = {
        "median or probability, 90 % band": key(FINAL_COLOUR),
        "burst": key(BASE_COLOUR, dashed=True),
        "wanted, or allowed": key(INK, dashed=True),
    }
    legend_above(figure, entries)
    return figure


def _banded(
    axes: Axes, table: pd.DataFrame, suffix: str, bound: pd.Series, *, prefix: str = ""
) -> None:
    low, middle, high = (table[f"{prefix}q{q}{suffix}"] for q in ("05", "50", "95"))
    band(axes, table["time_h"], low, high, FINAL_COLOUR, 0.22)
    axes.plot(table["time_h"], middle, color=FINAL_COLOUR)
    axes.plot(table["time_h"], bound, color=INK, linestyle="--", linewidth=1.0)
    axes.set_ylim(bottom=0.0)


def _lifetime(shown: Shown, lifetime: pd.DataFrame) -> Sketch:
    first = lifetime.iloc[0]
    facts: dict[str, float | None] = {
        name: float(first[name]) for name in ("pressure_kPa", "wanted_per_m", "risk")
    }
    failed = lifetime[lifetime["failed_probability"] >= HALF]["time_h"]
    model = shown.run.model
    facts["checks"] = None if model is None else model.rupture_checks
    facts["half"] = float(failed.iloc[0]) if len(failed) else None
    return Sketch(lifetime_figure(lifetime), facts)


FIGURES = (
    PageFigure(
        "lifetime",
        "rupture",
        of_table("lifetime", _lifetime),
        "The life of a new actuator in the soil, by the films' course of degradation. Its duty is "
        "a curvature of {{ wanted_per_m | number }} 1/m at {{ pressure_kPa | number }} kPa. Left: "
        "probability of having failed, that is of bending less or having burst"
        "{% if checks %}; less than 1 in {{ checks | count }}, the films broken and actuators "
        "loaded, is drawn as that bound{% endif %}. Middle: curvature at that "
        "pressure. Right: the pressure that keeps the curvature, and the largest that was tested "
        "and that a risk of {{ '%g' | format(risk) }} allows. "
        "{% if half is not none %}Half of new actuators have failed after {{ half | number }} h."
        "{% endif %} Use `bayesdeg lifetime` for other duties.",
        ("lifetime",),
        title="Life in the soil",
    ),
)
