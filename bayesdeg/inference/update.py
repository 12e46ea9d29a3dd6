"""Updating a posterior with further data: reweighting its draws, or refitting."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from bayesdeg.inference.importance import about_mode, refitted
from bayesdeg.inference.laplace import Evidence, approximate, smoothed
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.kinds import Pointwise

Floats = NDArray[np.float64]

ENOUGH = 4000.0
"""Effective draws: standard deviations are then known to 1.1 %, the worst of 30 to 2.5 %."""

FEWEST = 400.0  # fewest effective draws accepted: as required of a standard run's chain
RELIABLE_K = 0.7  # Pareto k above which weights are unreliable, see `Evidence`
ROUNDS = 6  # laws fitted one after the other, each to all earlier draws


class Method(StrEnum):
    """Method of updating a posterior."""

    WEIGHTS = "weights"
    REFIT = "refit"
    MODE = "mode"


@dataclass(frozen=True)
class Updated:
    """The posterior of earlier and further data.

    Parameters
    ----------
    posterior : Evidence
        Weighted draws.
    method : Method
        Weights of the earlier draws; an importance sample of a law that was fitted to them; or one
        about a mode that was found again.
    weights : Evidence
        The weights of the earlier draws, with the check that decided.
    """

    posterior: Evidence
    method: Method
    weights: Evidence

    @property
    def reliable(self) -> bool:
        """Whether the posterior is usable."""
        return is_reliable(self.posterior) and self.posterior.effective >= FEWEST


def is_reliable(sample: Evidence) -> bool:
    """Return whether the tail of a sample's weights is light enough; equal weights have no tail."""
    return sample.effective > 0.0 and not sample.pareto_k > RELIABLE_K


def take_in(
    before: JointModel,
    after: JointModel,
    vectors: Floats,
    densities: Floats,
    specimens: Iterable[str],
    generator: np.random.Generator,
    *,
    independent: float = 1.0,
    enough: float = ENOUGH,
) -> Updated:
    """Return the posterior with further readings of specimens.

    Parameters
    ----------
    before, after : JointModel
        The same parameters and priors; the second has the further readings.
    vectors, densities : array, shape (n, n_parameters) and (n,)
        Draws of the posterior before, and their log densities.
    specimens : iterable of str
        Those of which there are further readings.
    generator : Generator
        Draws proposals.
    independent : float
        Share of the draws that are worth an independent one each.
    enough : float
        Effective draws wanted; further ones are drawn where the earlier draws have fewer.
    """
    with threadpool_limits(limits=1):  # the same bits on every machine
        weights = reweighted(before, after, vectors, densities, specimens)
        weights = replace(weights, effective=independent * weights.effective)
        if is_reliable(weights) and weights.effective >= enough:
            return Updated(weights, Method.WEIGHTS, weights)
        found = _refit(after, weights, generator, enough)
        if found.effective >= FEWEST:
            return Updated(found, Method.REFIT, weights)
        best = vectors[int(np.argmax(after.log_prob(vectors)))]
        found = about_mode(after, approximate(after, generator, start=best), generator)
        if found.effective > 0.0:
            found = _refit(after, found, generator, enough)
        return Updated(found, Method.MODE, weights)


def reweighted(
    before: JointModel,
    after: JointModel,
    vectors: Floats,
    densities: Floats,
    specimens: Iterable[str],
) -> Evidence:
    r"""Weight draws of a posterior by further readings.

    Readings of different specimens are independent given the parameters, so specimens without
    further readings cancel:

    .. math:: \ln w = \sum_s \ln p(y_s, y'_s \mid \theta) - \ln p(y_s \mid \theta)

    A specimen's readings share its deviation of stiffness, hence further ones y' of an earlier
    specimen are evaluated together with its earlier ones y. The largest weights are smoothed; the
    evidence is that of the further readings given the earlier ones [nats]. The arguments are those
    of `take_in`.
    """
    chosen = frozenset(specimens)
    values = after.table.named(vectors)
    with np.errstate(all="ignore"):
        # other kinds of data are the same before and after
        same = {id(one) for one in before.observations} & {id(one) for one in after.observations}
        with_new, without = (_log_likelihood(m, chosen, values, same) for m in (after, before))
        ratio = with_new - without
        ratio = np.where(after.allows(values), ratio, -np.inf)
    ratio = np.where(np.isnan(ratio), -np.inf, ratio)
    return replace(smoothed(vectors, ratio), log_densities=densities + ratio)


def _log_likelihood(
    model: JointModel, specimens: frozenset[str], values: dict[str, Floats], same: set[int]
) -> Floats:
    """Return the log density of the readings of some specimens, of kinds not the same, (n,)."""
    known = (one for one in model.observations if id(one) not in same)
    tested = [one for one in known if one.is_criticised and one.uses_forward]
    tested = [one for one in tested if not (isinstance(one, Pointwise) and one.shares)]
    rows = [np.flatnonzero([name in specimens for name in one.labels]) for one in tested]
    some = tuple(one.subset(of) for one, of in zip(tested, rows, strict=True) if len(of))
    if not some:
        return np.zeros(len(next(iter(values.values()))))
    blocks = replace(model, observations=some).log_likelihood(values).values()
    total: Floats = np.sum([block.sum(axis=-1) for block in blocks], axis=0)
    return total


def _refit(
    after: JointModel, start: Evidence, generator: np.random.Generator, enough: float
) -> Evidence:
    """Draw from one fitted law after another, and pool the reliable samples."""
    pooled = start if is_reliable(start) else replace(start, effective=0.0)
    for _ in range(ROUNDS if np.isfinite(start.log_weights).sum() > len(after.table) else 0):
        sample = refitted(after, start, generator)
        if not np.isfinite(sample.log_evidence):
            break
        pooled = _pooled(pooled, sample) if is_reliable(sample) else pooled
        start = pooled if pooled.effective > sample.effective else sample
        if pooled.effective >= enough:
            break
    return pooled


def _pooled(first: Evidence, second: Evidence) -> Evidence:
    """Pool two samples of one posterior, weighted by effective draws."""
    samples = [one for one in (first, second) if one.effective > 0.0]
    log_weights = [
        one.log_weights - logsumexp(one.log_weights) + np.log(one.effective) for one in samples
    ]
    return Evidence(
        second.log_evidence,
        second.error,
        np.concatenate([one.draws for one in samples]),
        np.concatenate(log_weights),
        sum(one.effective for one in samples),
        np.concatenate([one.log_densities for one in samples]),
        pareto_k=float(np.nanmax([one.pareto_k for one in samples])),
    )


def drawn_evenly(sample: Evidence, generator: np.random.Generator, count: int) -> NDArray[np.intp]:
    """Return indices (count,) of equally weighted draws, each in proportion to its weight.

    Systematic resampling: a draw of weight w appears ⌊w count⌋ or ⌈w count⌉ times, in random order.

    Examples
    --------
    >>> sample = Evidence(0.0, 0.0, np.zeros((3, 1)), np.log([1.0, 2.0, 1.0]), 3.0)
    >>> sorted(drawn_evenly(sample, np.random.default_rng(0), 4).tolist())
    [0, 1, 1, 2]
    """
    weights = np.exp(sample.log_weights - np.max(sample.log_weights))
    ends = np.cumsum(weights) / np.sum(weights)
    ends[-1] = 1.0
    places = np.searchsorted(ends, (np.arange(count) + generator.random()) / count)
    return generator.permutation(places)
