"""Held-out specimens: what a model predicts of specimens that took no part in its calibration."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.residuals import levels, r_squared
from bayesdeg.inference.ensemble import EFFORTS, sample
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, approximate, surrounding
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

DRAWS = 400


@dataclass(frozen=True)
class HeldOut:
    """Predictions of specimens by a model that was calibrated without them.

    Parameters
    ----------
    log_density : array, shape (n_specimens,)
        Log predictive density of each specimen's whole curve.
    draws : array, shape (n_draws, n_specimens, n_points)
        Predictive draws of readings [1/m].
    mean : array, shape (n_specimens, n_points)
        Predictive mean [1/m].
    """

    log_density: Floats
    draws: Floats
    mean: Floats


def folds(degradation: Floats) -> NDArray[np.int64]:
    """Assign specimens to folds so that each fold leaves out one specimen of every level.

    Examples
    --------
    >>> folds(np.array([0.0, 0.0, 5.0, 5.0])).tolist()
    [0, 1, 0, 1]
    """
    _, member = levels(degradation)
    out = np.zeros(len(degradation), dtype=np.int64)
    for k in range(member.max() + 1):
        rows = np.flatnonzero(member == k)
        out[rows] = np.arange(len(rows))
    if out.max() == 0:  # one specimen a level: leave out every third
        out = np.arange(len(degradation)) % 3
    return out


def predict_held_out(
    model: Model,
    start: Floats,
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_fold: Callable[[], None] | None = None,
) -> HeldOut:
    """Calibrate without each fold in turn and predict it.

    The posteriors are importance samples from Laplace approximations, exact up to their Monte
    Carlo error, or chains of emcee where the approximation is too far off, as for a mode outside
    the bounds of a prior.

    Parameters
    ----------
    model : Model
        With all specimens.
    start : array, shape (n_parameters,)
        Mode of the full posterior.
    seed : SeedSequence
        A child for each fold.
    executor : Executor, optional
        Runs the folds side by side.
    on_fold : callable, optional
        Called after each fold.
    """
    assert model.actuator is not None
    fold = folds(model.actuator.degradation[:, 0])
    shape = model.actuator.mask.shape
    log_density, mean = np.empty(shape[0]), np.empty(shape)
    draws = np.empty((DRAWS, *shape))
    jobs = [
        (np.flatnonzero(fold == k), child)
        for k, child in enumerate(seed.spawn(int(fold.max()) + 1))
    ]
    apply = map if executor is None else executor.map
    for rows, density, simulated in apply(partial(_predict_fold, model, start), jobs):
        log_density[rows], draws[:, rows] = density, simulated
        mean[rows] = np.nanmean(simulated, axis=0)
        if on_fold is not None:
            on_fold()
    return HeldOut(log_density, draws, mean)


def _predict_fold(
    model: Model, start: Floats, job: tuple[NDArray[np.intp], np.random.SeedSequence]
) -> tuple[NDArray[np.intp], Floats, Floats]:
    assert model.actuator is not None
    rows, seed = job
    generator = np.random.default_rng(seed)
    kept = np.setdiff1d(np.arange(len(model.actuator.specimens)), rows)
    training = replace(model, actuator=model.actuator.subset(kept))
    values = model.table.named(_draws(training, start, seed, generator))
    testing = replace(model, actuator=model.actuator.subset(rows))
    blocks = testing.log_likelihood(values)["actuator"]
    density = logsumexp(np.nan_to_num(blocks, nan=-np.inf), axis=0) - np.log(DRAWS)
    return rows, density, testing.simulate_curvature(values, generator)


def _draws(
    model: Model, start: Floats, seed: np.random.SeedSequence, generator: np.random.Generator
) -> Floats:
    """Draw from the posterior: an importance sample, or emcee where that has too few draws."""
    laplace = approximate(model, generator, start=start)
    posterior = about_mode(model, laplace, generator, enough=DRAWS)
    if posterior.effective >= FEWEST_EFFECTIVE:
        return posterior.resample(generator, DRAWS)
    near = surrounding(model, start, laplace.covariance, generator)
    chain = sample(model, near, effort=EFFORTS["quick"], seed=seed)
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return flat[generator.integers(len(flat), size=DRAWS)]


def gain_table(model: Model, results: dict[str, HeldOut]) -> pd.DataFrame:
    """Return the scores of each model per level and over all, on held-out specimens.

    Parameters
    ----------
    model : Model
        With the data.
    results : mapping
        By name of the model; the first is the one that others are compared with.

    Returns
    -------
    DataFrame
        The columns of ``gain.csv``. Standard errors are over specimens.
    """
    assert model.actuator is not None
    centres, member = levels(model.actuator.degradation[:, 0])
    base = next(iter(results.values()))
    rows = []
    for name, held_out in results.items():
        for k, centre in enumerate(centres):
            rows.append(_scores(name, f"{centre:.4g}", model, held_out, base, member == k))
        rows.append(_scores(name, "all", model, held_out, base, member >= 0))
    return pd.DataFrame(rows)


def difference(held_out: HeldOut, base: HeldOut) -> tuple[float, float]:
    """Return the gain in log predictive density over all specimens and its standard error."""
    gap = held_out.log_density - base.log_density
    return float(np.sum(gap)), _error(gap)


def crps(draws: Floats, observed: Floats) -> Floats:
    """Return the continuous ranked probability score of draws (n, ...) for observations (...).

    E|X − y| − E|X − X'|/2, the second term from the sorted draws.

    Source: Gneiting and Raftery (2007), doi:10.1198/016214506000001437.

    Examples
    --------
    >>> float(crps(np.array([0.0, 2.0]), np.array(1.0)))
    0.5
    """
    count = len(draws)
    ordered = np.sort(draws, axis=0)
    weight = (2.0 * np.arange(1, count + 1) - count - 1.0) / count**2
    spread = np.tensordot(weight, ordered, axes=(0, 0))
    score: Floats = np.mean(np.abs(draws - observed), axis=0) - spread
    return score


def _scores(
    name: str,
    label: str,
    model: Model,
    held_out: HeldOut,
    base: HeldOut,
    rows: NDArray[np.bool_],
) -> dict[str, object]:
    assert model.actuator is not None
    mask = model.actuator.mask & rows[:, None]
    observed, draws, mean = (
        model.actuator.curvature[mask],
        held_out.draws[:, mask],
        held_out.mean[mask],
    )
    gap = (held_out.log_density - base.log_density)[rows]
    return {
        "model": name,
        "degradation_pct": label,
        "elpd": float(np.sum(held_out.log_density[rows])),
        "elpd_se": _error(held_out.log_density[rows]),
        "elpd_diff": float(np.sum(gap)),
        "elpd_diff_se": _error(gap),
        "rmse_per_m": float(np.sqrt(np.mean((observed - mean) ** 2))),
        "crps_per_m": float(np.mean(crps(np.nan_to_num(draws), observed))),
        "r_squared": r_squared(observed, mean),
        "coverage_50": _coverage(draws, observed, 0.5),
        "coverage_90": _coverage(draws, observed, 0.9),
    }


def _error(values: Floats) -> float:
    """Return the standard error of a sum over specimens; nan for a single one."""
    return float(np.sqrt(len(values)) * np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _coverage(draws: Floats, observed: Floats, share: float) -> float:
    low, high = np.nanquantile(draws, [0.5 - share / 2, 0.5 + share / 2], axis=0)
    return float(np.mean((observed >= low) & (observed <= high)))
