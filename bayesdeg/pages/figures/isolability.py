"""The isolability matrix of a scored method as a heat map: what is hidden against what is said."""

import io

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from bayesdeg.laboratory.score import SAID, Score
from bayesdeg.pages.drawing import PageFigure
from bayesdeg.pages.wording import words

FIGURES: tuple[PageFigure, ...] = ()
"""No report of a run has it."""

CELL = 0.24  # of a row or a column [in]
LABELS = (2.0, 2.1)  # room for the names beside and below the matrix [in]
DARK = 0.55  # share from which a number on its cell is white
FONT = 6.5


def isolability_svg(score: Score) -> str:
    """Return the matrix as an SVG file: a row for each thing hidden, shares as shades and counts.

    Parameters
    ----------
    score : Score
        Of a method.
    """
    columns = [said for said in SAID if any(row.get(said) for row in score.matrix.values())]
    counts = np.array([[row.get(said) or 0.0 for said in columns] for row in score.matrix.values()])
    shares = counts / counts.sum(axis=1, keepdims=True)
    size = (LABELS[0] + CELL * len(columns), LABELS[1] + CELL * len(counts))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for row, column in np.argwhere(counts > 0):
        colour = "white" if shares[row, column] > DARK else "black"
        text = f"{counts[row, column]:.0f}"
        axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=FONT)
    axes.set_xticks(range(len(columns)), [words(name) for name in columns], rotation=90)
    axes.set_yticks(range(len(counts)), [words(name) for name in score.matrix])
    axes.tick_params(labelsize=FONT)
    axes.set_xlabel("said", fontsize=FONT + 1.0)
    axes.set_ylabel("hidden", fontsize=FONT + 1.0)
    buffer = io.StringIO()
    with rc_context({"svg.hashsalt": "isolability", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n"
