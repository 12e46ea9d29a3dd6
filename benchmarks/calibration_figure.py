"""ECDFs of ranks less the uniform one, with simultaneous bands, one panel per parameter."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from calibration_ranks import band, ecdf, leaves
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

COLUMNS = 6
INSIDE, OUTSIDE, BAND = "#1f4e79", "#b3261e", "#c9d8e6"


def draw(path: Path, ranks: Mapping[str, NDArray[np.int64]], largest: int) -> None:
    """Write the figure, PNG or SVG by its ending.

    Parameters
    ----------
    path : Path
        Where.
    ranks : mapping of str to array
        Ranks of the replicates by parameter.
    largest : int
        Largest rank possible.
    """
    rows = -(-len(ranks) // COLUMNS)
    figure = Figure(figsize=(2.1 * COLUMNS, 1.5 * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    for axis in axes[len(ranks) :]:
        axis.set_visible(False)
    for axis, (name, some) in zip(axes, ranks.items(), strict=False):
        _panel(axis, name, some, largest)
    count = len(next(iter(ranks.values())))
    figure.supxlabel("rank of the true value, over the largest", fontsize=9)
    figure.supylabel("ECDF less that of uniform ranks", fontsize=9)
    figure.suptitle(
        f"{count} replicates; the band holds 95 % of all ECDFs of uniform ranks", fontsize=9
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    # the same bytes of the same figures
    with mpl.rc_context({"svg.hashsalt": "calibration"}):
        figure.savefig(path, dpi=140, metadata={"Date": None} if path.suffix == ".svg" else None)


def _panel(axis: Axes, name: str, ranks: NDArray[np.int64], largest: int) -> None:
    points = np.arange(1, largest + 1) / (largest + 1.0)
    lower, upper = band(len(ranks), largest)
    colour = OUTSIDE if leaves(ranks, largest) else INSIDE
    axis.fill_between(points, lower - points, upper - points, color=BAND, linewidth=0.0)
    axis.plot(points, ecdf(ranks, largest) - points, color=colour, linewidth=1.0)
    axis.axhline(0.0, color="black", linewidth=0.4)
    axis.set_title(name, fontsize=7)
    axis.tick_params(labelsize=6)
