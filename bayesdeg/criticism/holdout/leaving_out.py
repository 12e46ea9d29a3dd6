"""Predictions of groups left out in turn, by reweighting or recalibration."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.fit.side_by_side import in_order
from bayesdeg.criticism.fit.trials import CandidateFit, firm, sharpened, wanted
from bayesdeg.criticism.holdout.held_out import (
    DRAWS,
    Folds,
    HeldOut,
    largest_k,
    recalibrated,
    smoothed,
)

Floats = NDArray[np.float64]
_Fold = tuple[NDArray[np.intp], Floats, Floats]
_Job = tuple[CandidateFit, NDArray[np.intp], np.random.SeedSequence]

KEPT = 1000
"""Draws of a first fit that are reweighted, some ten per effective one; of a settled fit all."""
FEW = 6  # groups


@dataclass(frozen=True)
class FoldPlan:
    """Predictions of held-out groups, some of which still need a recalibration.

    Parameters
    ----------
    trial : CandidateFit
        Fitted to all groups.
    known : HeldOut
        What weighting its draws gives already; nan of groups that were not weighted.
    parts : tuple of array
        Groups that are left out together, each needing a calibration.
    seeds : tuple of SeedSequence
        One for each part.
    """

    trial: CandidateFit
    known: HeldOut
    parts: tuple[NDArray[np.intp], ...]
    seeds: tuple[np.random.SeedSequence, ...]

    @property
    def jobs(self) -> list[_Job]:
        """Inputs of each calibration."""
        pairs = zip(self.parts, self.seeds, strict=True)
        return [(self.trial, groups, seed) for groups, seed in pairs]

    def with_found(self, found: Sequence[_Fold]) -> HeldOut:
        """Return the predictions with those of the calibrations, part by part."""
        subject = self.trial.subject
        log_density, draws = self.known.log_density.copy(), self.known.draws.copy()
        for groups, density, simulated in found:
            log_density[groups] = density
            draws[:, np.isin(subject.group, [subject.groups[g] for g in groups])] = simulated
        return HeldOut(log_density, draws)


def one_by_one(trial: CandidateFit, seed: np.random.SeedSequence) -> FoldPlan:
    """Plan to predict each group from all others.

    Draws of the posterior are weighted by 1/p(y_g | θ), smoothed by a Pareto law; if its shape
    shows that too few carry the weight, the model has to be calibrated again without that group.

    The seed has a child for each calibration.

    References
    ----------
    Vehtari, Gelman and Gabry (2017), doi:10.1007/s11222-016-9696-4.
    """
    generator = np.random.default_rng(seed)
    trial = firm(trial, generator)
    subject = trial.subject
    # one of few specimens is too much of the data to reweight; a measured mean is not
    if len(subject.groups) <= FEW and np.any(subject.group != ""):
        return in_folds(trial, np.arange(len(subject.groups)), seed)
    kept = trial.settled_by or KEPT
    vectors = trial.draws(generator, kept)
    density = subject.group_density(vectors)
    relative = float(np.clip(trial.posterior.effective / kept, 1e-3, 1.0))
    smooth = smoothed(density[None], relative)
    draws = np.full((DRAWS, len(subject.places)), np.nan)
    shown = np.any(subject.group != "") and not subject.is_beside
    simulated = subject.simulated(vectors, generator) if shown else np.empty((kept, 0))
    for g, name in enumerate(subject.groups if shown else ()):
        rows = subject.group == name
        weights = np.exp(smooth.log_weights[:, g])
        chosen = generator.choice(kept, DRAWS, p=weights / weights.sum())
        draws[:, rows] = simulated[np.ix_(chosen, rows)]
    again = np.flatnonzero(~(smooth.pareto_k <= largest_k(kept)))
    parts = tuple(np.array([g]) for g in again)
    known = HeldOut(smooth.elpd.copy(), draws)
    return FoldPlan(trial, known, parts, tuple(seed.spawn(len(parts))))


def in_folds(trial: CandidateFit, fold: Folds, seed: np.random.SeedSequence) -> FoldPlan:
    """Plan to calibrate without each fold of groups in turn and predict it.

    `fold` (n_groups,) says when each group is left out; the seed has a child for each fold.
    """
    trial = firm(trial, np.random.default_rng(seed))
    subject = trial.subject
    nothing = HeldOut(
        np.full(len(subject.groups), np.nan), np.full((DRAWS, len(subject.places)), np.nan)
    )
    parts = tuple(np.flatnonzero(fold == k) for k in range(int(fold.max()) + 1))
    return FoldPlan(trial, nothing, parts, tuple(seed.spawn(len(parts))))


def run_folds(
    plans: Iterable[FoldPlan],
    executor: Executor | None = None,
    on_plan: Callable[[int], None] | None = None,
) -> list[HeldOut]:
    """Run the calibrations of all plans in parallel.

    The first begin while later plans are still being made. `on_plan` is called with the place of
    each plan when it is done.
    """
    begun = [(plan, in_order(_predict_fold, plan.jobs, executor)) for plan in plans]
    done = []
    for place, (plan, folds) in enumerate(begun):
        done.append(plan.with_found(list(folds)))
        if on_plan is not None:
            on_plan(place)
    return done


def _predict_fold(job: _Job) -> _Fold:
    trial, groups, seed = job
    generator = np.random.default_rng(seed)
    training, testing = trial.subject.without(groups), trial.subject.only(groups)
    start = trial.mode if trial.is_near_mode else None
    rest = recalibrated(
        training, generator, seed, start=start, whole=trial.posterior, enough=wanted(training)
    )
    if trial.settled_by and np.isfinite(rest.log_evidence):
        rest = sharpened(training, rest, generator)
    vectors = rest.resample(generator, DRAWS)
    if len(groups) == 1 and np.isfinite(rest.log_evidence):
        # p(y_g | rest) is a ratio of evidences; few draws would miss the region of a whole curve
        density = np.array([trial.log_evidence - rest.log_evidence])
    else:
        density = logsumexp(testing.group_density(vectors), axis=0) - np.log(DRAWS)
    if trial.subject.is_beside:
        return groups, density, np.full((DRAWS, int(np.sum(testing.group != ""))), np.nan)
    simulated = testing.simulated(vectors, generator)
    return groups, density, simulated[:, testing.group != ""]
