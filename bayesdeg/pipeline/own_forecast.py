"""Predictions with a user's forward map, and a finished run of it, from its folder and study."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.sampling import Chain
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.formula import Readings, UserMap, as_inputs, cause_of, columns_of
from bayesdeg.pipeline.output import owner_of
from bayesdeg.pipeline.posterior import Posterior
from bayesdeg.pipeline.reading import read_study
from bayesdeg.prediction.predictive import QUANTILES
from bayesdeg.report.folder import POSTERIOR, POSTERIOR_BASE, RunFolder

Floats = NDArray[np.float64]

PREDICTIVE = 2000  # draws


def user_map(posterior: Posterior) -> UserMap:
    """Return the user's forward map.

    Raises
    ------
    BayesdegError
        If the posterior is of films or actuators.
    """
    if posterior.own is None:
        raise BayesdegError(
            "a model of a study requires pressure=... or curvature=..., and degradation=..."
        )
    return posterior.own


def new_specimens(
    posterior: Posterior, block: Readings, x: Any, generator: np.random.Generator
) -> Floats:
    """Draw what new specimens would show at x, without reading error, (k, n)."""
    draws = posterior.chain.vectors.reshape(-1, posterior.chain.vectors.shape[-1])
    vectors = draws[generator.integers(len(draws), size=PREDICTIVE)]
    mean = user_map(posterior).at(posterior.model, block, x).expected(vectors)
    scatter = posterior.model.table.named(vectors).get(f"{block.name}_scatter")
    if scatter is None:
        return mean
    shift: Floats = scatter * generator.standard_normal(len(vectors))
    return mean + shift[:, None]


def predict(posterior: Posterior, x: Any, seed: np.random.SeedSequence) -> pd.DataFrame:
    """Return quantiles of what a new specimen would show at x, without reading error.

    Parameters
    ----------
    posterior : Posterior
        Of the user's forward map.
    x : array, DataFrame or mapping of names to arrays
        What the forward map is asked.
    seed : SeedSequence
        Everything random comes from it.
    """
    generator, at = np.random.default_rng(seed), as_inputs(x)
    frames = [
        _bands(block, at, new_specimens(posterior, block, at, generator))
        for block in user_map(posterior).readings
    ]
    return pd.concat(frames, ignore_index=True)


def control(
    posterior: Posterior, wanted: ArrayLike, x: Any, seed: np.random.SeedSequence
) -> pd.DataFrame:
    """Return the input at which readings reach wanted values.

    Each draw of a new specimen is followed along the inputs in their order until it first passes
    the value; between two of them it is taken as linear.

    Parameters
    ----------
    posterior : Posterior
        Of the user's forward map, with one kind of readings.
    wanted : array
        Readings, in their unit.
    x : array, DataFrame or mapping of names to arrays
        Inputs to be tried; of several, the first is given back and the others go along with it.
    seed : SeedSequence
        Everything random comes from it.

    Returns
    -------
    DataFrame
        A row for each value: ``reached`` for half of new specimens or not, the input that 5, 50
        and 95 % of them need (empty where they do not reach it), and the share that reach it.

    Raises
    ------
    BayesdegError
        If there are several kinds of readings, or fewer than two inputs.
    """
    own = user_map(posterior)
    if len(own.readings) > 1:
        raise BayesdegError("control needs a model of one kind of readings; give one at a time")
    at, block = as_inputs(x), own.readings[0]
    name, along = next(columns_of(at))
    if len(np.atleast_1d(along)) < 2:
        raise BayesdegError("control needs at least two inputs, between which it can look")
    draws = new_specimens(posterior, block, at, np.random.default_rng(seed))
    rows = []
    for value in np.unique(np.atleast_1d(np.asarray(wanted, dtype=np.float64))):
        needed = np.sort(_first_passage(np.asarray(along, dtype=np.float64), draws, float(value)))
        low, middle, high = np.quantile(needed, [0.05, 0.5, 0.95], method="inverted_cdf")
        ends = {"needed_q05": low, "needed_q50": middle, "needed_q95": high}
        share = float(np.mean(np.isfinite(needed)))
        rows.append(
            {"wanted": value, "unit": block.unit, "input": name, "reached": bool(share >= 0.5)}
            | {key: end if np.isfinite(end) else np.nan for key, end in ends.items()}
            | {"share": share}
        )
    return pd.DataFrame(rows)


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


def _bands(block: Readings, x: Any, draws: Floats) -> pd.DataFrame:
    """Return quantiles of predictions (k, n), a row for each x."""
    columns = {name: np.asarray(column) for name, column in columns_of(x) if np.ndim(column) == 1}
    low = {f"q{round(100 * q):02d}": np.nanquantile(draws, q, axis=0) for q in QUANTILES}
    numbers = {"mean": np.nanmean(draws, axis=0), "sd": np.nanstd(draws, axis=0)}
    answered = np.mean(np.isfinite(draws), axis=0)
    return pd.DataFrame(columns).assign(
        kind=block.name, unit=block.unit, **numbers, **low, answered=answered
    )


def is_own(path: Path) -> bool:
    """Return whether a folder is of a run with a user's forward map."""
    return bool(RunFolder(path).read_run().forward) if path.is_dir() else False


def read_own(path: Path, *, base: bool = False) -> Posterior:
    """Read a finished run's posterior and its function.

    Parameters
    ----------
    path : Path
        The run folder.
    base : bool
        The base model instead of the final one.

    Raises
    ------
    BayesdegError
        If the study is not where it was, has changed since, or was none but a script.
    """
    folder = RunFolder(path)
    run, verdict = folder.read_run(), folder.read_verdict()
    if ":" not in run.forward:
        raise BayesdegError(
            f"{path} was written from Python and its forward map is not stored: predict from "
            "Python with bayesdeg.predict or bayesdeg.control"
        )
    owner = owner_of(path)
    study = read_study(path / ("" if owner is None else owner.folder))
    changed = sorted(n for n, h in run.hashes.items() if study.hashes.get(n) != h)
    if changed:
        raise BayesdegError(
            f"{', '.join(changed)} of {study.name} changed since the run; run it again, so that "
            "the posterior belongs to the current function"
        )
    found = assemble(study)
    assert found.own is not None
    tree = folder.read_posterior(POSTERIOR_BASE if base else POSTERIOR)
    draws = {str(n): v.to_numpy() for n, v in tree["posterior"].to_dataset().items()}
    names = dict.fromkeys(name.split(".")[0] for name in draws if "." in name)
    model = found.model.extended(*(cause_of(name, found.candidates) for name in names))
    if set(model.table.names) != set(draws):
        raise BayesdegError(f"{path}: the posterior is of a different model; run the study again")
    vectors = model.table.vectors(draws)[:, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(len(vectors)))
    return Posterior(model, chain, own=found.own, run=run, verdict=verdict)
