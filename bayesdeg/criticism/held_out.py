"""Held-out specimens: what a model predicts of those that took no part in its calibration."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.residuals import levels
from bayesdeg.criticism.subject import Subject
from bayesdeg.inference.ensemble import EFFORTS, sample
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, approximate, surrounding

Floats = NDArray[np.float64]
Folds = NDArray[np.int64]

DRAWS = 400


@dataclass(frozen=True)
class HeldOut:
    """Predictions of groups of readings by a model that was calibrated without them.

    Parameters
    ----------
    log_density : array, shape (n_groups,)
        Log predictive density of all that was read on each group.
    draws : array, shape (n_draws, n_readings)
        Predictive draws; nan of readings that are never held out.
    """

    log_density: Floats
    draws: Floats

    @property
    def mean(self) -> Floats:
        """Predictive mean of the readings, (n_readings,)."""
        known = np.isfinite(self.draws)
        total: Floats = np.where(known, self.draws, 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def group_levels(subject: Subject) -> Floats:
    """Return the degradation rate of each group [%], the mean over its readings."""
    return np.array(
        [float(np.mean(subject.places.level[subject.group == g])) for g in subject.groups]
    )


def folds(degradation: Floats) -> Folds:
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


def by_specimen(subject: Subject) -> Folds:
    """Return folds that leave out one specimen of every level, or one of few groups."""
    count = len(subject.groups)
    return np.arange(count) if count <= 3 else folds(group_levels(subject))


def by_level(subject: Subject) -> Folds:
    """Return folds that leave out all specimens of one level of degradation."""
    member: Folds = levels(group_levels(subject))[1]
    return member


def predict_held_out(
    subject: Subject,
    start: Floats,
    fold: Folds,
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
    subject : Subject
        With all readings.
    start : array, shape (n_parameters,)
        Mode of the full posterior.
    fold : array of int, shape (n_groups,)
        When each group is left out.
    seed : SeedSequence
        A child for each fold.
    executor : Executor, optional
        Runs the folds side by side.
    on_fold : callable, optional
        Called after each fold.
    """
    log_density = np.empty(len(subject.groups))
    draws = np.full((DRAWS, len(subject.places)), np.nan)
    jobs = [
        (np.flatnonzero(fold == k), child)
        for k, child in enumerate(seed.spawn(int(fold.max()) + 1))
    ]
    apply = map if executor is None else executor.map
    for groups, density, simulated in apply(partial(_predict_fold, subject, start), jobs):
        log_density[groups] = density
        names = [subject.groups[g] for g in groups]
        draws[:, np.isin(subject.group, names)] = simulated
        if on_fold is not None:
            on_fold()
    return HeldOut(log_density, draws)


def difference(held_out: HeldOut, base: HeldOut) -> tuple[float, float]:
    """Return the gain in log predictive density over all groups and its standard error."""
    gap = held_out.log_density - base.log_density
    return float(np.sum(gap)), standard_error(gap)


def standard_error(values: Floats) -> float:
    """Return the standard error of a sum over groups; nan for a single one."""
    return float(np.sqrt(len(values)) * np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _predict_fold(
    subject: Subject, start: Floats, job: tuple[NDArray[np.intp], np.random.SeedSequence]
) -> tuple[NDArray[np.intp], Floats, Floats]:
    groups, seed = job
    generator = np.random.default_rng(seed)
    vectors = _draws(subject.without(groups), start, seed, generator)
    testing = subject.only(groups)
    density = logsumexp(testing.group_density(vectors), axis=0) - np.log(DRAWS)
    simulated = testing.simulated(vectors, generator)
    return groups, density, simulated[:, testing.group != ""]


def _draws(
    subject: Subject, start: Floats, seed: np.random.SeedSequence, generator: np.random.Generator
) -> Floats:
    """Draw from the posterior: an importance sample, or emcee where that has too few draws."""
    laplace = approximate(subject, generator, start=start)
    posterior = about_mode(subject, laplace, generator, enough=DRAWS)
    if posterior.effective >= FEWEST_EFFECTIVE:
        return posterior.resample(generator, DRAWS)
    near = surrounding(subject, start, laplace.covariance, generator)
    chain = sample(subject, near, effort=EFFORTS["quick"], seed=seed)
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return flat[generator.integers(len(flat), size=DRAWS)]
