"""Which readings of a specimen follow one another."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Paths(NamedTuple):
    """Which readings follow one another, n_readings = n_outputs × n_points a specimen.

    Parameters
    ----------
    mask : array of bool, shape (n_specimens, n_readings)
        Where there is a reading; one of the second output needs one of the first beside it.
    gap : array, shape (n_specimens, n_readings)
        Length of path since the reading before it of the same output; infinite for the first.
    place : array, shape (n_specimens, n_readings)
        Length of path up to it.
    points : int
        Readings of the first output; those of the second follow them.
    """

    mask: Flags
    gap: Floats
    place: Floats
    points: int


def paths_of(mask: Flags, place: Floats) -> Paths:
    """Return the paths of readings at places along them.

    Parameters
    ----------
    mask : array of bool, shape (n_specimens, n_outputs, n_points)
        Where there is a reading.
    place : array, shape (n_specimens, n_points)
        Length of path up to each reading, not falling.

    Examples
    --------
    >>> paths = paths_of(np.array([[[True, False, True]]]), np.array([[20.0, 40.0, 60.0]]))
    >>> paths.gap[0, [0, 2]]
    array([inf, 40.])
    """
    n_specimens, n_outputs, n_points = mask.shape
    read = mask & mask[:, :1]
    gap = np.full(mask.shape, np.inf)
    last = np.full((n_specimens, n_outputs), -np.inf)
    for j in range(n_points):
        here = place[:, None, j]
        gap[..., j] = here - last
        last = np.where(read[..., j], here, last)
    return Paths(
        read.reshape(n_specimens, -1),
        gap.reshape(n_specimens, -1),
        np.tile(place, n_outputs),
        n_points,
    )
