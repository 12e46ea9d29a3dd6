"""Predictions of held-out groups by a model without them, reweighted or calibrated again."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.fit.side_by_side import in_order
from bayesdeg.criticism.fit.trials import CandidateFit, firm, sharpened, wanted
from bayesdeg.data.levels import levels
from bayesdeg.inference.density import log_ratio
from bayesdeg.inference.importance import about_mode, improved
from bayesdeg.inference.laplace import Evidence, approximate
from bayesdeg.inference.model import JointModel, blocks_of
from bayesdeg.inference.sampling import Effort, sample
from bayesdeg.priors import Named

Floats = NDArray[np.float64]
Folds = NDArray[np.int64]

DRAWS = 400  # predictive draws


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
        """Kind of each group, (n_groups,)."""
        return np.zeros(len(self.log_density), dtype=np.int64) if self.kind is None else self.kind

    @property
    def mean(self) -> Floats:
        """Predictive mean of the readings, (n_readings,)."""
        known = np.isfinite(self.draws)
        total: Floats = np.where(known, self.draws, 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def joined(first: HeldOut, second: HeldOut) -> HeldOut:
    """Return both as one, with groups of different kinds and the draws of the first.

    Examples
    --------
    >>> films = HeldOut(np.zeros(3), np.zeros((1, 0)))
    >>> joined(films, films).kinds.tolist()
    [0, 0, 0, 1, 1, 1]
    """
    kind = np.concatenate([first.kinds, 1 + first.kinds.max() + second.kinds])
    return HeldOut(np.concatenate([first.log_density, second.log_density]), first.draws, kind)


def group_levels(subject: JointModel) -> Floats:
    """Return the degradation rate of each group [%], the mean over its readings."""
    return np.array(
        [float(np.mean(subject.places.level[subject.group == g])) for g in subject.groups]
    )


def by_level(subject: JointModel) -> Folds:
    """Return folds that leave out all specimens of one level of degradation."""
    member: Folds = levels(group_levels(subject))[1]
    return member


def difference(held_out: HeldOut, base: HeldOut) -> tuple[float, float]:
    """Return the gain in log predictive density over all groups and its standard error.

    The variance of a sum over several kinds of groups is the sum of the variances of each. A single
    group of its kind, such as a measured mean, has no spread; the standard deviation of a log
    ratio g of two normal densities with different means is used, √(2|g|).
    """
    gap = log_ratio(held_out.log_density, base.log_density)
    parts = [gap[held_out.kinds == kind] for kind in np.unique(held_out.kinds)]
    if len(parts) == 1:
        return float(np.sum(gap)), standard_error(gap)
    # a single one: ln N(y | a, 1) - ln N(y | b, 1) has mean (a - b)²/2 if a is right, and standard
    # deviation |a - b|
    errors = [
        standard_error(part) if len(part) > 1 else float(np.sqrt(2.0 * abs(part[0])))
        for part in parts
    ]
    return float(np.sum(gap)), float(np.sqrt(np.sum(np.square(errors))))


def standard_error(values: Floats) -> float:
    """Return the standard error of a sum over groups; nan for a single or an infinite value."""
    if len(values) < 2 or not np.all(np.isfinite(values)):
        return float("nan")
    return float(np.sqrt(len(values)) * np.std(values, ddof=1))


def specimen_density(
    model: JointModel, values: Named
) -> tuple[tuple[str, ...], tuple[str, ...], Floats]:
    """Return log densities of all readings of each specimen, from values by name, each (n,).

    Given the parameters, the readings of one specimen in different tables are independent, so that
    their log densities add up.

    The names of the specimens, what was read on each, and the density, (n, n_specimens), −inf where
    the model has no answer.
    """
    by_kind = model.log_likelihood(values)
    blocks = blocks_of(model)
    columns = [
        sum(by_kind[kind][:, rows].sum(axis=-1) for kind, rows in found.items())
        for found in blocks.values()
    ]
    count = len(next(iter(values.values())))
    density = np.stack(columns, axis=-1) if columns else np.empty((count, 0))
    known = np.where(np.isnan(density), -np.inf, density)
    return tuple(blocks), tuple(", ".join(found) for found in blocks.values()), known


LARGEST_K = 0.7  # shape of the weights' tail beyond which no number of draws gives a mean


@dataclass(frozen=True)
class Smoothed:
    """Each group left out by smoothed importance weights.

    Parameters
    ----------
    elpd, error : array, shape (n_groups,)
        Log predictive density given the other groups, and its Monte Carlo standard error.
    in_sample : array, shape (n_groups,)
        The same given all groups, itself included.
    pareto_k : array, shape (n_groups,)
        Shape of the tail of the weights.
    log_weights : array, shape (n_draws, n_groups)
        Normalised.
    """

    elpd: Floats
    error: Floats
    in_sample: Floats
    pareto_k: Floats
    log_weights: Floats


def smoothed(density: Floats, relative: float) -> Smoothed:
    """Reweight posterior draws to leave out each specimen in turn.

    From log densities of all readings of each specimen, (n_chains, n_draws, n_specimens);
    `relative` is the effective over the actual number of draws.
    """
    flat = density.reshape(-1, density.shape[-1])
    found = [_smooth(column, relative) for column in flat.T]
    weights = np.stack([weight for weight, _ in found], axis=-1)
    pareto_k = np.array([k for _, k in found])
    elpd = logsumexp(weights + flat, axis=0)
    deviation = np.exp(weights) * np.expm1(flat - elpd)
    error = np.sqrt(np.sum(deviation**2, axis=0) / relative)
    inside = logsumexp(flat, axis=0) - np.log(len(flat))
    return Smoothed(elpd, error, inside, pareto_k, weights)


def _smooth(density: Floats, relative: float) -> tuple[Floats, float]:
    """Return log weights 1/p that sum to 1, the largest smoothed, and the shape of their tail."""
    try:
        weights, k = array_stats.psislw(density, r_eff=relative)
    except ValueError:  # a tail of equal weights
        weights, k = -density, np.nan
    if np.isfinite(k) or k == np.inf:
        return _equal_where_alike(weights, density), float(k)
    # an uninformative specimen has bounded weights: no tail to smooth
    plain = -density - logsumexp(-density)
    return plain, 0.0 if np.ptp(density) < 1.0 else np.inf


ALIKE = 9
"""Decimals of a log density to which duplicates of a draw agree."""


def _equal_where_alike(weights: Floats, density: Floats) -> Floats:
    """Average the weights of duplicate draws.

    A resampled posterior contains duplicates, and their order in the smoothed tail depends on the
    sort, which differs between processors.

    Examples
    --------
    >>> shares = _equal_where_alike(np.log([0.1, 0.3, 0.6]), np.array([2.0, 2.0, 1.0]))
    >>> np.exp(shares).round(9).tolist()
    [0.2, 0.2, 0.6]
    """
    _, group, count = np.unique(density.round(ALIKE), return_inverse=True, return_counts=True)
    shares: Floats = np.bincount(group, np.exp(weights)) / count
    return np.log(shares)[group]


def largest_k(draws: int) -> float:
    """Return the largest shape k with a reliable mean for this many draws.

    Examples
    --------
    >>> largest_k(100), largest_k(4000)
    (0.5, 0.7)
    """
    return min(1.0 - 1.0 / float(np.log10(draws)), LARGEST_K)


ROUND, ENOUGH = 1000, 80.0  # draws of a round of importance sampling, effective draws wanted
FEWEST = 0.25  # share of the required effective draws below which a different method is tried
# the last method: averaging a density over draws needs few
RECALIBRATION = Effort(effective=60.0, r_hat=1.2, chunk=25, longest=200, ensembles=2)


def recalibrated(
    training: JointModel,
    generator: np.random.Generator,
    seed: np.random.SeedSequence,
    *,
    start: Floats | None,
    whole: Evidence | None = None,
    enough: float = ENOUGH,
    effort: Effort = RECALIBRATION,
) -> Evidence:
    """Calibrate a model again without some groups.

    An importance sample about its mode; one that begins with the posterior of all groups where that
    has too few draws, or had too few for all groups: what lies far from the mode has to be found
    with a group and without it, or their ratio says nothing; and emcee, without an evidence (nan),
    where that has too few as well. `start` (n_parameters,) is where the mode is sought; `effort`
    is that of emcee.

    The start is near the mode, None where posterior mass lies far from it; `whole` is the posterior
    of all groups; `enough` effective draws are wanted.

    Raises
    ------
    ValueError
        If there is neither a start nor a posterior of all groups.
    """
    found, fewest = None, FEWEST * enough
    if start is not None:
        laplace = approximate(training, generator, start=start)
        found = about_mode(training, laplace, generator, enough=enough)
    if whole is not None and (found is None or found.effective < fewest):
        found = improved(training, whole, generator, draws=ROUND, enough=enough)
    begun = whole if found is None or not found.effective > 0.0 else found
    if begun is None:
        raise ValueError("give a start or the posterior of all groups")
    if begun is found and found.effective >= fewest:
        return found
    chain = sample(training, begun, effort=effort, seed=seed)
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    effective = min(float(np.min(chain.effective())), float(len(flat)))
    return Evidence(float("nan"), float("nan"), flat, np.zeros(len(flat)), effective)


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
