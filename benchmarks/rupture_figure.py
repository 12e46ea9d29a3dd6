"""Reliability of probabilities of rupture, and where ruptures lie in their predicted laws."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import norm

COLOUR, BAND, TWO_SIDED = "#1f4e79", "#c9d8e6", float(norm.ppf(0.975))


def draw(
    path: Path,
    expected: NDArray[np.float64],
    observed: NDArray[np.float64],
    error: NDArray[np.float64],
    place: NDArray[np.float64],
) -> None:
    """Write the figure, PNG or SVG by its ending.

    Parameters
    ----------
    path : Path
        Where.
    expected, observed, error : array
        Mean predicted probability, observed share, and its standard error over studies, by tenth.
    place : array
        Of each rupture in its predicted law, uniform if that is right.
    """
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.fill_between([0, 1], [-0.05, 0.95], [0.05, 1.05], color=BAND, linewidth=0.0)
    left.plot([0, 1], [0, 1], color="black", linewidth=0.6)
    left.errorbar(expected, observed, yerr=TWO_SIDED * error, color=COLOUR, marker="o", capsize=2)
    left.set(xlabel="predicted probability of rupture [–]", ylabel="share that burst [–]")
    left.set(xlim=(0, 1), ylim=(0, 1), title="reliability, ±0.05 shaded")
    right.hist(place, bins=20, range=(0, 1), density=True, color=COLOUR)
    right.axhline(1.0, color="black", linewidth=0.6)
    right.set(xlabel="place of a rupture in its predicted law [–]", ylabel="density [–]")
    right.set(title="pressures of rupture; uniform if right")
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"svg.hashsalt": "rupture"}):
        figure.savefig(path, dpi=140, metadata={"Date": None} if path.suffix == ".svg" else None)
