"""Where the misfit sits: residuals, R² as the paper gives it, one sentence."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.linear import Linear
from bayesdeg.inference.ensemble import Chain
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

LEVEL_WIDTH = 2.0  # degradation rates this close count as one level [%]


@dataclass(frozen=True)
class CurvatureFit:
    """Posterior predictions at the readings.

    Parameters
    ----------
    mean : array, shape (n_specimens, n_points)
        Posterior mean for a specimen of mean stiffness [1/m].
    low, high : array, shape (n_specimens, n_points)
        5 and 95 % of the posterior predictive law of a reading on another specimen [1/m].
    """

    mean: Floats
    low: Floats
    high: Floats


def predict_readings(
    model: Model, chain: Chain, generator: np.random.Generator, *, draws: int = 400
) -> CurvatureFit:
    """Return posterior predictions at the conditions of the data."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    values = model.table.named(flat[generator.integers(len(flat), size=draws)])
    mean = np.nanmean(model.curvature(values).curvature, axis=0)
    low, high = np.nanquantile(model.simulate_curvature(values, generator), [0.05, 0.95], axis=0)
    return CurvatureFit(mean, low, high)


def r_squared(measured: Floats, predicted: Floats) -> float:
    """Return R² = 1 − SSE/SST on pooled points; nan where all measured are the same.

    Examples
    --------
    >>> r_squared(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.0]))
    0.5
    """
    if len(measured) == 0 or np.ptp(measured) == 0.0:
        return float("nan")
    total = np.sum((measured - np.mean(measured)) ** 2)
    return float(1.0 - np.sum((measured - predicted) ** 2) / total)


def levels(degradation: Floats, width: float = LEVEL_WIDTH) -> tuple[Floats, NDArray[np.int64]]:
    """Return the levels of degradation that specimens were meant to have, and each one's level.

    Examples
    --------
    >>> centres, member = levels(np.array([0.0, 4.8, 5.3, 10.0]))
    >>> centres.round(2).tolist(), member.tolist()
    ([0.0, 5.05, 10.0], [0, 1, 1, 2])
    """
    order = np.argsort(degradation)
    steps = np.diff(degradation[order]) > width
    member = np.empty(len(degradation), dtype=np.int64)
    member[order] = np.concatenate([[0], np.cumsum(steps)])
    centres = np.array([degradation[member == k].mean() for k in range(member.max() + 1)])
    return centres, member


def level_table(model: Model, fit: CurvatureFit, published: dict[float, float]) -> pd.DataFrame:
    """Return R² and RMS of the residuals per level and over all, beside published R².

    Columns: ``degradation_pct``, ``n``, ``r_squared``, ``rms_per_m``, ``published_r_squared``.
    """
    assert model.actuator is not None
    data = model.actuator
    centres, member = levels(data.degradation[:, 0])
    rows = []
    for k, centre in enumerate(centres):
        near = [value for level, value in published.items() if abs(level - centre) <= LEVEL_WIDTH]
        rows.append(
            _level_row(f"{centre:.4g}", model, fit, member == k, near[0] if near else np.nan)
        )
    rows.append(_level_row("all", model, fit, member >= 0, np.nan))
    return pd.DataFrame(rows)


def _level_row(
    label: str, model: Model, fit: CurvatureFit, rows: NDArray[np.bool_], published: float
) -> dict[str, object]:
    assert model.actuator is not None
    mask = model.actuator.mask & rows[:, None]
    measured, predicted = model.actuator.curvature[mask], fit.mean[mask]
    return {
        "degradation_pct": label,
        "n": int(mask.sum()),
        "r_squared": r_squared(measured, predicted),
        "rms_per_m": float(np.sqrt(np.mean((measured - predicted) ** 2))),
        "published_r_squared": published,
    }


def where(model: Model, residual: Floats, noise: float) -> str:
    """Say in one sentence where the misfit is largest: pressures, degradation rates, specimens.

    Parameters
    ----------
    model : Model
        With actuator data.
    residual : array, shape (n_specimens, n_points)
        Measured less predicted [1/m].
    noise : float
        RMS of what no smooth discrepancy explains [1/m].

    Returns
    -------
    str
        Of the readings that can be predicted; empty if none can.
    """
    assert model.actuator is not None
    data = model.actuator
    known = data.mask & np.isfinite(residual)
    if not known.any():
        return ""
    relative = residual / np.maximum(np.abs(data.curvature - residual), noise)
    bands = np.quantile(data.pressure[known], [0.0, 1 / 3, 2 / 3, 1.0])
    centres, member = levels(data.degradation[:, 0])
    third = np.clip(np.searchsorted(bands[1:-1], data.pressure), 0, 2)
    means = np.array([_mean(relative, known & (third == k)) for k in range(3)])
    k = int(np.argmax(np.abs(means)))
    cell = known & (third == k)
    by_level = np.array(
        [_mean(relative, cell & (member == m)[:, None]) for m in range(len(centres))]
    )
    same = [
        f"{c:.3g}"
        for c, v in zip(centres, by_level, strict=True)
        if v * means[k] > 0 and abs(v) > 0.5 * abs(means[k])
    ]
    specimens = np.array([_mean(relative, cell[[i]], row=i) for i in range(len(data.specimens))])
    agreeing = int(np.sum(specimens * means[k] > 0))
    low, high = data.pressure[cell].min(), data.pressure[cell].max()
    sign = "below" if means[k] < 0 else "above"
    rates = (
        "every degradation rate"
        if len(same) == len(centres)
        else f"{', '.join(same)} % degradation"
    )
    return (
        f"Measured curvature lies {sign} the simulation by {100 * abs(means[k]):.0f} % on average "
        f"at {low:.0f}–{high:.0f} kPa, at {rates}, in {agreeing} of {len(specimens)} specimens."
    )


def where_films(linear: Linear) -> str:
    """Say in one sentence in which mode of tension stresses are off, and by how much."""
    places, residual = linear.subject.places, linear.subject.observed - linear.prediction
    modes = list(dict.fromkeys(places.history.tolist()))
    off = [float(np.sqrt(np.mean(residual[places.history == mode] ** 2))) for mode in modes]
    worst = int(np.argmax(off))
    rows = places.history == modes[worst]
    sign = "below" if np.mean(residual[rows]) < 0.0 else "above"
    others = ", ".join(f"{m} {o:.3g}" for m, o in zip(modes, off, strict=True) if m != modes[worst])
    return (
        f"Measured stress departs most in {modes[worst]} tension, {off[worst]:.3g} MPa in root "
        f"mean square and {sign} the law on average{f' ({others} MPa)' if others else ''}."
    )


def _mean(values: Floats, mask: NDArray[np.bool_], row: int | None = None) -> float:
    chosen = values[mask] if row is None else values[row][mask[0]]
    return float(np.mean(chosen)) if chosen.size else 0.0
