"""Held-out specimens: what a model predicts of those that took no part in its calibration."""

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.leave_one_out import largest_k, smoothed
from bayesdeg.criticism.residuals import levels
from bayesdeg.criticism.subject import Subject
from bayesdeg.criticism.trials import Trial
from bayesdeg.inference.chain import Effort
from bayesdeg.inference.ensemble import sample
from bayesdeg.inference.importance import about_mode, improved
from bayesdeg.inference.laplace import approximate, surrounding

Floats = NDArray[np.float64]
Folds = NDArray[np.int64]
_Fold = tuple[NDArray[np.intp], Floats, Floats]

DRAWS, KEPT = 400, 1000
ROUND, WANTED = 1000, 150.0  # draws of a round of importance sampling, effective draws wanted
FEW = 6  # groups
FEWEST = 20.0  # effective draws below which another way is tried
# the last way: a density averaged over draws needs few
ANEW = Effort(effective=60.0, r_hat=1.2, chunk=25, longest=200, ensembles=2)


@dataclass(frozen=True)
class HeldOut:
    """Predictions of groups of readings by a model that was calibrated without them.

    Parameters
    ----------
    log_density : array, shape (n_groups,)
        Log predictive density of all that was read on each group.
    draws : array, shape (n_draws, n_readings)
        Predictive draws; nan of readings that are never held out.
    kind : array of int, shape (n_groups,), optional
        Which groups are alike, as actuators are, and films; None if all are.
    """

    log_density: Floats
    draws: Floats
    kind: NDArray[np.int64] | None = None

    @property
    def kinds(self) -> NDArray[np.int64]:
        """Which groups are alike, (n_groups,)."""
        return np.zeros(len(self.log_density), dtype=np.int64) if self.kind is None else self.kind

    @property
    def mean(self) -> Floats:
        """Predictive mean of the readings, (n_readings,)."""
        known = np.isfinite(self.draws)
        total: Floats = np.where(known, self.draws, 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def joined(first: HeldOut, second: HeldOut) -> HeldOut:
    """Return both as one, the groups of either being of other kinds; draws are those of the first.

    Examples
    --------
    >>> films = HeldOut(np.zeros(3), np.zeros((1, 0)))
    >>> joined(films, films).kinds.tolist()
    [0, 0, 0, 1, 1, 1]
    """
    kind = np.concatenate([first.kinds, 1 + first.kinds.max() + second.kinds])
    return HeldOut(np.concatenate([first.log_density, second.log_density]), first.draws, kind)


def group_levels(subject: Subject) -> Floats:
    """Return the degradation rate of each group [%], the mean over its readings."""
    return np.array(
        [float(np.mean(subject.places.level[subject.group == g])) for g in subject.groups]
    )


def by_level(subject: Subject) -> Folds:
    """Return folds that leave out all specimens of one level of degradation."""
    member: Folds = levels(group_levels(subject))[1]
    return member


def predict_one_by_one(
    trial: Trial,
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
) -> HeldOut:
    """Predict each group from all others.

    Draws of the posterior are weighted by 1/p(y_g | θ), smoothed by a Pareto law; where its shape
    says that too few carry the weight, the model is calibrated anew without that group.

    Parameters
    ----------
    trial : Trial
        Fitted to all groups.
    seed : SeedSequence
        A child for each group.
    executor : Executor, optional
        Runs calibrations side by side.

    References
    ----------
    Vehtari, Gelman and Gabry (2017), doi:10.1007/s11222-016-9696-4.
    """
    subject, generator = trial.subject, np.random.default_rng(seed)
    # each of few specimens is too much of the data to be weighted away; a measured mean is not
    if len(subject.groups) <= FEW and np.any(subject.group != ""):
        return predict_folds(trial, np.arange(len(subject.groups)), seed=seed, executor=executor)
    vectors = trial.draws(generator, KEPT)
    density = subject.group_density(vectors)
    relative = float(np.clip(trial.posterior.effective / KEPT, 1e-3, 1.0))
    smooth = smoothed(density[None], relative)
    simulated = subject.simulated(vectors, generator)
    log_density = smooth.elpd.copy()
    draws = np.full((DRAWS, len(subject.places)), np.nan)
    for g, name in enumerate(subject.groups):
        rows = subject.group == name
        weights = np.exp(smooth.log_weights[:, g])
        chosen = generator.choice(KEPT, DRAWS, p=weights / weights.sum())
        draws[:, rows] = simulated[np.ix_(chosen, rows)]
    again = np.flatnonzero(~(smooth.pareto_k <= largest_k(KEPT)))
    found = _calibrated_anew(trial, [np.array([g]) for g in again], seed, executor)
    return _replaced(HeldOut(log_density, draws), subject, found)


def predict_folds(
    trial: Trial,
    fold: Folds,
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
) -> HeldOut:
    """Calibrate without each fold of groups in turn and predict it.

    Parameters
    ----------
    trial : Trial
        Fitted to all groups.
    fold : array of int, shape (n_groups,)
        When each group is left out.
    seed : SeedSequence
        A child for each fold.
    executor : Executor, optional
        Runs the folds side by side.
    """
    subject = trial.subject
    nothing = HeldOut(
        np.full(len(subject.groups), np.nan), np.full((DRAWS, len(subject.places)), np.nan)
    )
    parts = [np.flatnonzero(fold == k) for k in range(int(fold.max()) + 1)]
    return _replaced(nothing, subject, _calibrated_anew(trial, parts, seed, executor))


def difference(held_out: HeldOut, base: HeldOut) -> tuple[float, float]:
    """Return the gain in log predictive density over all groups and its standard error.

    The variance of a sum over several kinds of groups is that of the sums over each. A single group
    of its kind, such as a measured mean, has no spread: that of a log ratio g of two normal
    densities that differ in their means is taken, √(2|g|).
    """
    gap = held_out.log_density - base.log_density
    parts = [gap[held_out.kinds == kind] for kind in np.unique(held_out.kinds)]
    if len(parts) == 1:
        return float(np.sum(gap)), standard_error(gap)
    errors = [standard_error(part) if len(part) > 1 else _single_error(part[0]) for part in parts]
    return float(np.sum(gap)), float(np.sqrt(np.sum(np.square(errors))))


def standard_error(values: Floats) -> float:
    """Return the standard error of a sum over groups; nan for a single one."""
    return float(np.sqrt(len(values)) * np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _single_error(gain: float) -> float:
    """Return the standard error of a gain g that stands alone, √(2|g|).

    Of ln N(y | a, 1) - ln N(y | b, 1), which is (a - b)²/2 on average if a is right, and scatters
    by |a - b|.
    """
    return float(np.sqrt(2.0 * abs(gain)))


def _calibrated_anew(
    trial: Trial,
    parts: list[NDArray[np.intp]],
    seed: np.random.SeedSequence,
    executor: Executor | None,
) -> list[_Fold]:
    apply = map if executor is None else executor.map
    jobs = zip(parts, seed.spawn(len(parts)), strict=True)
    return list(apply(partial(_predict_fold, trial), jobs))


def _replaced(held_out: HeldOut, subject: Subject, found: list[_Fold]) -> HeldOut:
    log_density, draws = held_out.log_density.copy(), held_out.draws.copy()
    for groups, density, simulated in found:
        log_density[groups] = density
        draws[:, np.isin(subject.group, [subject.groups[g] for g in groups])] = simulated
    return HeldOut(log_density, draws)


def _predict_fold(trial: Trial, job: tuple[NDArray[np.intp], np.random.SeedSequence]) -> _Fold:
    groups, seed = job
    generator = np.random.default_rng(seed)
    vectors, log_evidence = _draws(trial, trial.subject.without(groups), seed, generator)
    testing = trial.subject.only(groups)
    if len(groups) == 1 and np.isfinite(log_evidence):
        # p(y_g | rest) is a ratio of evidences; few draws would miss what a whole curve demands
        density = np.array([trial.log_evidence - log_evidence])
    else:
        density = logsumexp(testing.group_density(vectors), axis=0) - np.log(DRAWS)
    simulated = testing.simulated(vectors, generator)
    return groups, density, simulated[:, testing.group != ""]


def _draws(
    trial: Trial,
    training: Subject,
    seed: np.random.SeedSequence,
    generator: np.random.Generator,
) -> tuple[Floats, float]:
    """Draw from the posterior without some groups; return the draws and the log evidence.

    An importance sample about its mode; one that begins with the posterior of all groups where that
    has too few draws; and emcee, without an evidence (nan), where that has too few as well.
    """
    laplace = approximate(training, generator, start=trial.mode)
    posterior = about_mode(training, laplace, generator, enough=WANTED)
    if posterior.effective < FEWEST:
        posterior = improved(training, trial.posterior, generator, draws=ROUND, enough=WANTED)
    if posterior.effective >= FEWEST:
        return posterior.resample(generator, DRAWS), posterior.log_evidence
    near = surrounding(training, trial.mode, laplace.covariance, generator)
    chain = sample(training, near, effort=ANEW, seed=seed)
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return flat[generator.integers(len(flat), size=DRAWS)], float("nan")
