"""History of a specimen's test: times of readings, lagging responses, dryness of the room."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Conditions

Floats = NDArray[np.float64]


def filled(values: Floats, first: float) -> Floats:
    """Return values along the last axis with nan replaced by the value before it.

    Parameters
    ----------
    values : array, shape (n_specimens, n_points)
        nan where not recorded.
    first : float
        Used where values are missing at the beginning.

    Examples
    --------
    >>> filled(np.array([[np.nan, 3.0, np.nan, 5.0]]), 0.0).tolist()
    [[0.0, 3.0, 3.0, 5.0]]
    """
    known = np.array(values, dtype=np.float64)
    known[..., 0] = np.where(np.isnan(known[..., 0]), first, known[..., 0])
    last = np.where(np.isnan(known), 0, np.arange(known.shape[-1]))
    return np.take_along_axis(known, np.maximum.accumulate(last, axis=-1), axis=-1)


def known_time(conditions: Conditions) -> Floats:
    """Return the time of each reading since the specimen's first [s], (n_specimens, n_points).

    A reading without a time is assigned that of the reading before it, so specimens whose times
    were not recorded do not age.
    """
    return filled(conditions.time, 0.0)


def lagging(steps: Floats, time: Floats, time_constant: Floats) -> Floats:
    r"""Return a linear response that follows steps of its cause with a lag.

    .. math:: r(t_j) = \sum_{i \le j} \Delta_i \left(1 - e^{-(t_j - t_{i-1})/\tau}\right)

    The step of a reading is made right after the previous reading and held until it is read; the
    first step's hold is not recorded and counts as zero.

    Parameters
    ----------
    steps : array, shape (..., n_specimens, n_points)
        Δ, in any unit.
    time : array, shape (n_specimens, n_points)
        Of the readings [s].
    time_constant : array, shape (walkers, 1, 1)
        τ [s].

    Returns
    -------
    array, shape (walkers, n_specimens, n_points)

    References
    ----------
    Boltzmann (1878), Ann. Phys. 241:430; doi:10.1002/andp.18782411107.

    Examples
    --------
    >>> time = np.array([[0.0, 10.0, 20.0]])
    >>> lagging(np.array([[0.0, 1.0, 0.0]]), time, np.full((1, 1, 1), 10.0)).round(3)
    array([[[0.   , 0.632, 0.865]]])
    """
    if np.all(time == time[:1]):
        time = time[:1]  # one schedule for all specimens: the memory is computed once
    begun = np.concatenate([time[:, :1], time[:, :-1]], axis=-1)
    # future steps have no age
    age = np.maximum(time[:, :, None] - begun[:, None, :], 0.0)
    memory = -np.expm1(-age / time_constant[..., None])
    if len(time) == 1:  # a product of matrices for each walker
        shared: Floats = steps @ np.swapaxes(memory[..., 0, :, :], -1, -2)
        return shared
    response: Floats = (memory @ steps[..., None])[..., 0]
    return response


STORED_HUMIDITY = 67.0
"""Relative humidity in which films and parts are stored [%]."""
TESTED_HUMIDITY = 60.0
"""Relative humidity of the room where none was recorded [%]."""
SAME_HUMIDITY = 0.5
"""Humidities that differ by less are the same to a hygrometer [%]."""


def dryness(humidity: Floats) -> Floats:
    """Return (67 % − RH)/(67 % − 60 %) [–]: 0 in the storage air, 1 in the usual test air.

    Source of both humidities: Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> dryness(np.array([67.0, 60.0, 46.0])).tolist()
    [0.0, 1.0, 3.0]
    """
    return (STORED_HUMIDITY - humidity) / (STORED_HUMIDITY - TESTED_HUMIDITY)
