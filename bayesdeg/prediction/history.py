"""What is done to new specimens up to their readings, in the conditions of their service."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.observations.curvature import ActuatorCurves
from bayesdeg.prediction.conditions import ServiceConditions
from bayesdeg.quantities import LOADING, UNLOADING

Floats = NDArray[np.float64]


class LoadHistory(NamedTuple):
    """What is done to specimens up to their readings.

    Parameters
    ----------
    pressure : array, shape (n_specimens, n_points)
        [kPa]
    cycle, time, unloading : array, shape (n_points,)
        Loading cycle, time since the first point [s], whether the pressure is on its way down.
    """

    pressure: Floats
    cycle: NDArray[np.int64]
    time: Floats
    unloading: NDArray[np.bool_]


def history(conditions: ServiceConditions, pressure: Floats, largest: float) -> LoadHistory:
    """Return what is done to specimens of which each is read at its own pressure.

    All but the last step is prompt. Since prompt cycles are all alike, one stands for those before.

    Parameters
    ----------
    conditions : ServiceConditions
        Hold, cycle and branch.
    pressure : array, shape (n_specimens,)
        At which each is read, held for the time of the conditions [kPa].
    largest : float
        To which earlier cycles and the way up went, where that is above the pressure [kPa].

    Examples
    --------
    >>> up_and_down = ServiceConditions(hold_s=60.0, cycle=2, branch="unloading")
    >>> path = history(up_and_down, np.array([40.0]), 240.0)
    >>> path.pressure.tolist(), path.time.tolist()
    ([[240.0, 0.0, 240.0, 40.0]], [0.0, 0.0, 0.0, 60.0])
    """
    top, nothing = np.maximum(pressure, largest), np.zeros_like(pressure)
    steps = list(_steps(conditions, top, nothing))
    steps.append((pressure, conditions.cycle, conditions.branch == UNLOADING))
    reached, cycle, down = zip(*steps, strict=True)
    time = np.zeros(len(steps))
    time[-1] = conditions.hold_s
    return LoadHistory(np.stack(reached, axis=-1), np.array(cycle), time, np.array(down))


def _steps(
    conditions: ServiceConditions, top: Floats, nothing: Floats
) -> Iterator[tuple[Floats, int, bool]]:
    """Yield pressure, cycle and whether it is on its way down, before the last step."""
    if conditions.cycle > 1:
        yield top, conditions.cycle - 1, False
        yield nothing, conditions.cycle - 1, True
    elif conditions.branch == LOADING:
        yield nothing, 1, False
    if conditions.branch == UNLOADING:
        yield top, conditions.cycle, False


def tests_in(
    conditions: ServiceConditions, degradation: Floats, pressure: Floats, *, largest: float
) -> ActuatorCurves:
    """Return tests of new specimens, without readings.

    Parameters
    ----------
    conditions : ServiceConditions
        Without a history there is one specimen for each degradation rate, over all pressures;
        with one there is a specimen for each rate and pressure, rates first.
    degradation : array, shape (n_levels,) or (n, n_levels)
        The same for all draws, or that of each draw [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor [kPa].
    largest : float
        See `history` [kPa].
    """
    if conditions.has_history:
        levels = degradation.shape[-1]
        path = history(conditions, np.tile(pressure, levels), largest)
        degradation = np.repeat(degradation, len(pressure), axis=-1)
    else:
        shape = (degradation.shape[-1], len(pressure))
        path = LoadHistory(
            np.broadcast_to(pressure, shape).copy(),
            np.array(1),
            np.array(np.nan),
            np.array(False),
        )
    return _tests(conditions, degradation, path)


def _tests(conditions: ServiceConditions, degradation: Floats, path: LoadHistory) -> ActuatorCurves:
    shape = path.pressure.shape
    rates = degradation if degradation.ndim == 1 else np.mean(degradation, axis=0)
    humidity, temperature = (
        np.nan if value is None else value
        for value in (conditions.humidity_pct, conditions.temperature_c)
    )
    return ActuatorCurves(
        specimens=tuple(f"{level:g} %" for level in rates),
        degradation=degradation[..., None],
        degradation_sd=np.full((shape[0], 1), conditions.degradation_sd),
        pressure=path.pressure,
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        angle_sd=np.zeros(shape),
        mask=np.ones(shape, dtype=bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.zeros(shape, dtype=bool),
        recorded=np.ones(shape, dtype=bool),
        ruptured=np.zeros(shape, dtype=bool),
        cycle=np.broadcast_to(path.cycle, shape).copy(),
        branch=np.where(np.broadcast_to(path.unloading, shape), UNLOADING, LOADING),
        time=np.broadcast_to(path.time, shape).copy(),
        humidity=np.full(shape, humidity),
        mount=np.full(shape, conditions.mount),
        temperature=np.full(shape, temperature),
    )
