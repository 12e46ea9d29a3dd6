"""Curvature bands: what a further specimen would show, at any degradation rate and pressure."""

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.inference.curves import ActuatorCurves
from bayesdeg.inference.ensemble import Chain
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def at_conditions(model: Model, degradation: Floats, pressure: Floats) -> Model:
    """Return the model for one specimen at each degradation rate, over all pressures.

    Parameters
    ----------
    model : Model
        A calibrated model.
    degradation : array, shape (n_levels,)
        Known exactly [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor [kPa].
    """
    shape = (len(degradation), len(pressure))
    curves = ActuatorCurves(
        specimens=tuple(f"{level:g} %" for level in degradation),
        degradation=degradation[:, None],
        degradation_sd=np.zeros((shape[0], 1)),
        pressure=np.broadcast_to(pressure, shape).copy(),
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        mask=np.ones(shape, dtype=bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.zeros(shape, dtype=bool),
        recorded=np.ones(shape, dtype=bool),
        ruptured=np.zeros(shape, dtype=bool),
        cycle=np.ones(shape, dtype=np.int64),
        branch=np.full(shape, "loading"),
        time=np.full(shape, np.nan),
        humidity=np.full(shape, np.nan),
        mount=np.full(shape, "horizontal"),
    )
    return replace(model, actuator=curves)


def draw_values(
    model: Model, chain: Chain, generator: np.random.Generator, draws: int
) -> dict[str, Floats]:
    """Return named values of random draws from a chain."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return model.table.named(flat[generator.integers(len(flat), size=draws)])


def curvature_bands(
    model: Model,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
    draws: int = 1000,
) -> pd.DataFrame:
    """Return quantiles of the curvature of a further specimen, without reading noise.

    Parameters
    ----------
    model, chain : Model, Chain
        Model and its posterior.
    generator : Generator
        Draws parameters and the specimen's own stiffness.
    degradation, pressure : array
        Levels [%] and pressures as read [kPa].
    draws : int
        Number of specimens drawn.

    Returns
    -------
    DataFrame
        Columns ``degradation_pct``, ``pressure_kPa``, ``q05`` … ``q95`` [1/m]; nan where more
        than half of the draws lie outside the range of the forward map.
    """
    grid = at_conditions(model, degradation, pressure)
    values = draw_values(model, chain, generator, draws)
    deviation = grid.draw_deviation(values, generator)
    curvature = grid.curvature(values, deviation).curvature
    usable = np.mean(np.isfinite(curvature), axis=0) > 0.5
    safe = np.where(usable, curvature, 0.0)
    bands = np.where(usable, np.nanquantile(safe, QUANTILES, axis=0), np.nan)
    levels, pressures = np.meshgrid(degradation, pressure, indexing="ij")
    columns = {f"q{round(100 * q):02d}": bands[i].ravel() for i, q in enumerate(QUANTILES)}
    return pd.DataFrame(
        {"degradation_pct": levels.ravel(), "pressure_kPa": pressures.ravel()} | columns
    )
