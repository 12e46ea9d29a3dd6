"""Nominal degradation levels: which degradation rates count as one."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEVEL_WIDTH = 2.0  # degradation rates closer than this count as one level [%]


def levels(degradation: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Group degradation rates into nominal levels.

    In ascending order, a new level begins where the next rate is more than `LEVEL_WIDTH` higher.

    Parameters
    ----------
    degradation : array, shape (S,)
        Degradation rates of specimens [%].

    Returns
    -------
    centres : array, shape (L,)
        Mean rate of each level [%], ascending.
    member : array of int, shape (S,)
        The level of each specimen.

    Examples
    --------
    >>> centres, member = levels(np.array([0.0, 4.8, 5.3, 10.0]))
    >>> centres.round(2).tolist(), member.tolist()
    ([0.0, 5.05, 10.0], [0, 1, 1, 2])
    """
    order = np.argsort(degradation)
    steps = np.diff(degradation[order]) > LEVEL_WIDTH
    member = np.empty(len(degradation), dtype=np.int64)
    member[order] = np.concatenate([[0], np.cumsum(steps)])
    centres = np.array([degradation[member == k].mean() for k in range(member.max() + 1)])
    return centres, member
