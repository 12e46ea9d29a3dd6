"""Figures of the page, as PNG."""

import io
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dragon_skin.published import MODULI
from dragon_skin.record import CASES
from dragon_skin.words import label

Floats = NDArray[np.float64]

COLOURS = {
    "as stated": "#7a7f87",
    "supported": "#1f6fb2",
    "supported + load point": "#14724f",
    "everything": "#c2561a",
}
SHORT = ("self-weight", "+ 0.510 N", "+ 1.001 N")


def modulus_figure(draws: dict[str, Floats]) -> bytes:
    """Draw the posterior of E of each model, and the published values.

    Parameters
    ----------
    draws : dict of array
        E by model [kPa].
    """
    figure = Figure(figsize=(8.5, 3.4), layout="constrained")
    axes = figure.subplots()
    edges = np.arange(195.0, 346.0, 3.0).tolist()
    for name, modulus in draws.items():
        axes.hist(
            modulus, edges, density=True, histtype="stepfilled", alpha=0.35, color=COLOURS[name]
        )
        axes.hist(modulus, edges, density=True, histtype="step", color=COLOURS[name], label=name)
    top = axes.get_ylim()[1]
    for name, value in MODULI.items():
        axes.axvline(value, color="#1c2127", ls="--", lw=1)
        axes.text(value + 1.0, 0.97 * top, name, rotation=90, va="top", fontsize=8)
    axes.set(xlabel="Young's modulus E = 6 C1  [kPa]", ylabel="posterior density  [1/kPa]")
    axes.legend(frameon=False, fontsize=8)
    _finish(axes)
    return _png(figure)


def causes_figure(one_by_one: dict[str, Any], supported: tuple[float, float]) -> bytes:
    """Draw what each cause is worth in log evidence, and what it does to E.

    Parameters
    ----------
    one_by_one : dict
        Results of taking away and adding.
    supported : tuple of float
        Mean and standard deviation of E with the supported causes [kPa].
    """
    rows = [(f"without {label(n)}", r, "#1f6fb2") for n, r in one_by_one["removed"].items()]
    rows += [(f"with {label(n)}", a, "#c2561a") for n, a in one_by_one["added"].items()]
    figure = Figure(figsize=(9.5, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    for i, (_, values, colour) in enumerate(rows):
        left.barh(i, values["gain"], color=colour, height=0.65)
        right.errorbar(
            values["modulus_kPa"], i, xerr=values["modulus_sd_kPa"], fmt="o", color=colour, ms=4
        )
    left.set_yticks(range(len(rows)), [words for words, *_ in rows], fontsize=8)
    left.invert_yaxis()
    left.set_xscale("symlog", linthresh=3.0)
    left.axvspan(-3.0, 3.0, color="#7a7f87", alpha=0.15, lw=0)
    left.set(xlabel="Δ ln evidence  [–]")
    left.set_title("worth (grey: within a factor of 20)", fontsize=10)
    mean, sd = supported
    right.axvspan(mean - sd, mean + sd, color="#1f6fb2", alpha=0.15, lw=0)
    right.set(xlabel="E  [kPa]")
    right.set_title("E with it (band: supported model)", fontsize=10)
    _finish(left, right)
    return _png(figure)


def residual_figure(residuals: dict[str, Floats]) -> bytes:
    """Draw what is left at rest by marker, load case and direction.

    Parameters
    ----------
    residuals : dict of array, shape (6 takes, 3 markers, 3)
        Observed less predicted by model [mm].
    """
    figure = Figure(figsize=(9.5, 5.0), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    for row, (axis, words) in enumerate(((0, "along the beam"), (2, "vertical"))):
        for marker in range(3):
            axes = panels[row, marker]
            axes.axhline(0.0, color="#1c2127", lw=0.8)
            for shift, (name, values) in zip((-0.1, 0.1), residuals.items(), strict=True):
                at = np.repeat(np.arange(3), 2) + shift
                axes.plot(at, values[:, marker, axis], "o", ms=5, color=COLOURS[name], label=name)
            axes.set_xticks(range(3), SHORT, fontsize=8)
            axes.set_xlim(-0.5, 2.5)
            if row == 0:
                axes.set_title(f"marker {marker}")
        panels[row, 0].set_ylabel(f"residual, {words}  [mm]")
    for axes in panels[1]:
        axes.set_xlabel("load case  [N at the tip]")
    panels[0, 2].legend(frameon=False, fontsize=8)
    _finish(*panels.ravel())
    return _png(figure)


def held_out_figure(held_out: dict[str, Any]) -> bytes:
    """Draw the tip's height in held-out load cases, seen less predicted."""
    figure = Figure(figsize=(8.5, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.axhline(0.0, color="#1c2127", lw=0.8)
    for i, (name, cases) in enumerate(held_out.items()):
        at = np.arange(3) + 0.15 * (i - 0.5 * (len(held_out) - 1))
        error = [cases[words]["height_error_mm"] for words in CASES]
        sd = np.array([cases[words]["height_sd_mm"] for words in CASES])
        axes.errorbar(
            at, error, 1.645 * sd, fmt="o", capsize=3, color=COLOURS[name], ms=5, label=name
        )
    axes.set_xticks(range(3), CASES)
    axes.set(xlabel="load case held out  [N at the tip]")
    axes.set_ylabel("height, seen less predicted  [mm]")
    axes.legend(frameon=False, fontsize=8, ncols=2)
    _finish(axes)
    return _png(figure)


def _finish(*panels: Axes) -> None:
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.2)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
