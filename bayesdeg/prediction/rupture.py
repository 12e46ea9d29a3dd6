"""Rupture probability: the stretch that a pressure demands against the elongation limit."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.inference.ensemble import Chain
from bayesdeg.inference.model import Model
from bayesdeg.material.strength import rupture_probability
from bayesdeg.prediction.bands import at_conditions, draw_values

Floats = NDArray[np.float64]

# Gauss–Hermite rule for the specimen's own stiffness
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)


def rupture_table(
    model: Model,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
    draws: int = 500,
) -> pd.DataFrame:
    """Return the probability that a specimen bursts up to a pressure.

    A specimen bursts where the largest principal stretch that 99 % of its volume stays below
    passes its uniaxial elongation limit (log-normal about a median that depends on D_R). The
    probability averages over specimens; its 5 and 95 % quantiles are over the posterior.

    Returns
    -------
    DataFrame
        Columns ``degradation_pct``, ``pressure_kPa``, ``probability``, ``probability_q05``,
        ``probability_q95`` [–]; a draw whose stretch lies outside the forward map's range counts
        as nan and is left out.
    """
    grid = at_conditions(model, degradation, pressure)
    values = draw_values(model, chain, generator, draws)
    strength = grid.strength(values)
    limit, scatter = 1.0 + strength.median[..., None], strength.scatter[..., None]
    sd = grid.deviation_sd(values)
    total = np.zeros((draws, len(degradation), len(pressure)))
    for node, weight in zip(_NODES, _WEIGHTS / np.sum(_WEIGHTS), strict=True):
        prediction = grid.curvature(values, node * sd)
        stretch = np.where(prediction.status == 0, np.maximum(prediction.peak_stretch, 1.0), np.nan)
        share = prediction.peak_stretch_sd / np.maximum(stretch - 1.0, 1e-12)
        total += weight * _probability(stretch, limit, np.hypot(scatter, share))
    levels, pressures = np.meshgrid(degradation, pressure, indexing="ij")
    usable = np.mean(np.isfinite(total), axis=0) > 0.5
    safe = np.where(usable, total, 0.0)
    low, high = np.where(usable, np.nanquantile(safe, [0.05, 0.95], axis=0), np.nan)
    return pd.DataFrame(
        {
            "degradation_pct": levels.ravel(),
            "pressure_kPa": pressures.ravel(),
            "probability": np.where(usable, np.nanmean(safe, axis=0), np.nan).ravel(),
            "probability_q05": low.ravel(),
            "probability_q95": high.ravel(),
        }
    )


def _probability(stretch: Floats, limit: Floats, scatter: Floats) -> Floats:
    known = np.isfinite(stretch)
    probability = rupture_probability(np.where(known, stretch, 1.0), limit, scatter, "lognormal")
    return np.where(known, probability, np.nan)
