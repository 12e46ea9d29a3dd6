"""Drawings of what a cause does to the readings, for its page."""

from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
import matplotlib.pyplot as plt

CAPTION = (
    "What the cause changes at its typical size, by the shipped emulator: a virtual experiment "
    "with the cause less one without it, neither with scatter or noise."
)
CURVES = (
    " Dashed: unloading, where it differs. Thirty seconds at each pressure. A line ends where the "
    "emulator has no answer or the actuator bursts."
)
COLOURS = {"fresh": "#1b6ca8", "degraded by 25 %": "#b85c00"}
STYLE = {
    "svg.hashsalt": "bayesdeg",
    "svg.fonttype": "none",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "figure.facecolor": "white",
}
SAME = 1e-3  # of the largest change: less is not drawn as a line of its own


def caption(cause) -> str:
    """Return what a drawing shows."""
    return CAPTION + (CURVES if "actuator" in cause.acts_on else "")


def draw(cause, tables, file: Path) -> None:
    """Draw a panel for each kind of test that the cause acts on."""
    panels = [name for name in ("actuator", "tensile", "rupture") if name in cause.acts_on]
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            1, len(panels), figsize=(4.6 * len(panels), 2.9), layout="constrained", squeeze=False
        )
        for name, axis in zip(panels, axes[0], strict=True):
            PANELS[name](axis, tables)
        axes[0, 0].legend(frameon=False, fontsize=8)
        figure.savefig(file, metadata={"Date": None})
        plt.close(figure)


def _actuator(axis, tables) -> None:
    readings = tables["actuator"]
    largest = readings["change"].abs().max()
    for name, colour in COLOURS.items():
        test = readings[readings["specimen_id"] == name]
        up, down = (test[test["branch"] == b].sort_values("pressure_kPa") for b in BRANCHES)
        axis.plot(up["pressure_kPa"], up["change"], color=colour, label=name)
        both = up.merge(down, on="pressure_kPa")
        if (both["change_x"] - both["change_y"]).abs().max() > SAME * largest:
            axis.plot(down["pressure_kPa"], down["change"], color=colour, linestyle="--")
    axis.axhline(0.0, color="0.4", linewidth=0.8)
    axis.set(xlabel="pressure [kPa]", ylabel="change of curvature [1/m]")


BRANCHES = ("loading", "unloading")


def _tensile(axis, tables) -> None:
    readings = tables["tensile"]
    for name, colour in COLOURS.items():
        test = readings[readings["specimen_id"] == name]
        axis.plot(test["stretch"], test["change"], color=colour, label=name)
    axis.axhline(0.0, color="0.4", linewidth=0.8)
    axis.set(xlabel="stretch", ylabel="change of nominal stress [MPa]")


def _rupture(axis, tables) -> None:
    strength = tables["strength"].sort_values("degradation_pct")
    for column, label, style in (("before", "films", "--"), ("limit_stretch", "actuators", "-")):
        elongation = 100.0 * (strength[column] - 1.0)
        axis.plot(strength["degradation_pct"], elongation, style, color="0.2", label=label)
    axis.set(xlabel="degradation rate [%]", ylabel="median elongation limit [%]", ylim=(0.0, None))


PANELS = {"actuator": _actuator, "tensile": _tensile, "rupture": _rupture}
