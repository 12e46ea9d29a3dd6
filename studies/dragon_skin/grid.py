"""Quadratic shape functions on rows of nodes, whose products form a box of triquadratic bricks."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def graded(length: float, bricks: int, ratio: float) -> Floats:
    """Return nodes of a row of bricks that grow by a ratio from both ends to the middle.

    Parameters
    ----------
    length : float
        Of the row.
    bricks : int
        In it.
    ratio : float
        Length of a brick over that of its neighbour nearer to the end.

    Examples
    --------
    >>> graded(6.0, 3, 4.0).tolist()
    [0.0, 0.5, 1.0, 3.0, 5.0, 5.5, 6.0]
    """
    place = np.arange(bricks)
    sizes = ratio ** np.minimum(place, bricks - 1 - place)
    ends = length * np.concatenate([[0.0], np.cumsum(sizes) / np.sum(sizes)])
    return np.asarray(
        np.interp(0.5 * np.arange(2 * bricks + 1), np.arange(bricks + 1), ends), dtype=np.float64
    )


def weights_at(nodes: Floats, at: float) -> Floats:
    """Return the value at a point of each shape function of a row of nodes.

    Examples
    --------
    >>> weights_at(np.array([0.0, 0.5, 1.0]), 0.25).tolist()
    [0.375, 0.75, -0.125]
    """
    ends = nodes[::2]
    brick = min(max(int(np.searchsorted(ends, at)) - 1, 0), len(ends) - 2)
    t = (at - ends[brick]) / (ends[brick + 1] - ends[brick])
    weights = np.zeros(len(nodes))
    weights[2 * brick : 2 * brick + 3] = [
        (1.0 - t) * (1.0 - 2.0 * t),
        4.0 * t * (1.0 - t),
        t * (2.0 * t - 1.0),
    ]
    return weights


def mean_weights(nodes: Floats, low: float, high: float) -> Floats:
    """Return the mean of each shape function between two points of the row, exactly.

    Examples
    --------
    >>> mean_weights(np.array([0.0, 0.5, 1.0]), 0.0, 1.0).round(12).tolist()
    [0.166666666667, 0.666666666667, 0.166666666667]
    """
    inner = [x for x in nodes[::2] if low < x < high]
    cuts = [low, *inner, high]
    total = np.zeros(len(nodes))
    for a, b in pairwise(cuts):
        # two Gauss points integrate a quadratic exactly
        middle, half = 0.5 * (a + b), 0.5 * (b - a)
        for side in (-1.0, 1.0):
            total += half * weights_at(nodes, middle + side * half / np.sqrt(3.0))
    mean: Floats = total / (high - low)
    return mean
