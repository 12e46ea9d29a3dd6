"""What a posterior of a user's forward map says of new specimens."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.own_map import Readings, as_inputs, columns_of, own_map_of
from bayesdeg.prediction.forecast import BAND_COLUMNS, Forecast, stream_of
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.prediction.predictive import QUANTILES

Floats = NDArray[np.float64]

PREDICTIVE = 2000  # draws


def _new_specimens(
    posterior: Posterior, block: Readings, x: Any, generator: np.random.Generator
) -> Floats:
    """Draw what new specimens would show at x, without reading error, (k, n)."""
    draws = posterior.chain.vectors.reshape(-1, posterior.chain.vectors.shape[-1])
    vectors = draws[generator.integers(len(draws), size=PREDICTIVE)]
    mean = own_map_of(posterior.model).at(posterior.model, block, x).expected(vectors)
    values = posterior.model.table.named(vectors)
    if f"{block.name}_scatter" not in values:
        return mean
    shift = values[f"{block.name}_scatter"] * generator.standard_normal(len(vectors))
    found: Floats = mean + shift[:, None]
    return found


def predict(posterior: Posterior, x: Any, seed: int) -> Forecast:
    """Return quantiles of what a new specimen would show, without reading error, a row for each x.

    ``x`` is an array, a DataFrame or a mapping of names to arrays.
    """
    generator, at, frames = np.random.default_rng(stream_of(seed)), as_inputs(x), []
    blocks = own_map_of(posterior.model).readings
    for block in blocks:
        draws = _new_specimens(posterior, block, at, generator)
        inputs = {n: np.asarray(column) for n, column in columns_of(at) if np.ndim(column) == 1}
        low = {
            name: np.nanquantile(draws, q, axis=0)
            for name, q in zip(BAND_COLUMNS, QUANTILES, strict=True)
        }
        numbers = {"mean": np.nanmean(draws, axis=0), "sd": np.nanstd(draws, axis=0)}
        answered = np.mean(np.isfinite(draws), axis=0)
        frames.append(
            pd.DataFrame(inputs).assign(
                kind=block.name, unit=block.unit, **numbers, **low, answered=answered
            )
        )
    units = dict.fromkeys(("mean", "sd", *BAND_COLUMNS), blocks[0].unit)
    return Forecast(pd.concat(frames, ignore_index=True), units)


def control(posterior: Posterior, wanted: ArrayLike, x: Any, seed: int) -> Forecast:
    """Return the input at which readings reach wanted values.

    Each draw of a new specimen is followed along the inputs in their order until it first passes
    the value; between two of them it is taken as linear. Of several inputs the first is returned,
    and the others go along with it. The table has a row for each value: ``reached`` for half of new
    specimens or not, the input that 5, 50 and 95 % of them need (empty where they do not reach it),
    and the share that reach it.

    Raises
    ------
    BayesdegError
        If there are several kinds of readings, or fewer than two inputs.
    """
    blocks = own_map_of(posterior.model).readings
    if len(blocks) > 1:
        raise BayesdegError("control needs a model of one kind of readings; give one at a time")
    at, block = as_inputs(x), blocks[0]
    name, column = next(columns_of(at))
    if len(np.atleast_1d(column)) < 2:
        raise BayesdegError("control needs at least two inputs, between which it can look")
    along = np.asarray(column, dtype=np.float64)
    draws = _new_specimens(posterior, block, at, np.random.default_rng(stream_of(seed)))
    rows = []
    for value in np.unique(np.atleast_1d(np.asarray(wanted, dtype=np.float64))):
        needed = np.sort(_first_passage(along, draws, float(value)))
        ends = np.quantile(needed, [0.05, 0.5, 0.95], method="inverted_cdf")
        share = float(np.mean(np.isfinite(needed)))
        rows.append(
            {"wanted": value, "unit": block.unit, "input": name, "reached": bool(share >= 0.5)}
            | {
                f"needed_{quantile}": end if np.isfinite(end) else np.nan
                for quantile, end in zip(("q05", "q50", "q95"), ends, strict=True)
            }
            | {"share": share}
        )
    return Forecast(pd.DataFrame(rows), {"wanted": block.unit, "reached": "", "share": ""})


def _first_passage(along: Floats, draws: Floats, wanted: float) -> Floats:
    """Return where each draw (k, n) first passes a value; infinite where it does not."""
    gap = draws - wanted
    with np.errstate(invalid="ignore"):
        crossed = (gap[:, :-1] * gap[:, 1:] <= 0.0) & np.isfinite(gap[:, :-1] + gap[:, 1:])
    first = np.argmax(crossed, axis=1)
    own = np.arange(len(draws))
    before, after = gap[own, first], gap[own, first + 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(before == after, 0.0, before / (before - after))
    found: Floats = along[first] + share * (along[first + 1] - along[first])
    return np.where(crossed.any(axis=1), found, np.inf)
