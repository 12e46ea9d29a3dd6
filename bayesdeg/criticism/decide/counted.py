r"""Causes of rupture that explain counts contradicting a model.

Without such a cause counts are not part of the fit. The evidence for one is

.. math:: B = \frac{p(y, k | \mathrm{cause})}{p(y, k)}

with the readings y and the counts k, both models fitted to both: draws of the model without counts
would make these far too improbable, since parameters that could accommodate them, such as a wide
scatter of the elongation at break, lie where there are no draws. Causes are named by the same
rules as all others: a factor above 20 and above that by chance in 95 % of counts without an
effect; better prediction of left-out actuators; a plausible size; counts that are probable with
it; and no rival within a factor of 20.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.causes.cause import Cause
from bayesdeg.causes.common_factor import COMMON_FACTOR
from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.checks.count_misfit import (
    PUBLISHED,
    CountLaw,
    CountMisfit,
    answered,
    chances_at,
    count_misfit,
    judged_counts,
)
from bayesdeg.criticism.decide.candidates import FULL_FIT, effect_sizes
from bayesdeg.criticism.decide.support import Support, least_tail, prior_tail
from bayesdeg.criticism.findings import Candidate
from bayesdeg.criticism.fit.linear import columns_of, with_prior_moments
from bayesdeg.criticism.fit.search import naming_threshold
from bayesdeg.criticism.fit.trials import WANTED, CandidateFit, with_sizes
from bayesdeg.criticism.holdout.held_out import standard_error
from bayesdeg.data.settings import RUPTURE_CRITERIA
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import Evidence, approximate, weighted
from bayesdeg.inference.model import AT_ONCE, JointModel
from bayesdeg.observations.counts import Chances, RuptureCounts, chances_of
from bayesdeg.observations.kinds import State
from bayesdeg.observations.rupture import Rupture
from bayesdeg.observations.specimens import FilmsAndActuators

Floats = NDArray[np.float64]

DRAWS = 3000
"""Draws of the posterior without the counts."""
OTHERS_DRAWS = 1000
"""Draws for p-values by other criteria of rupture: simulated counts have the larger error."""
CHANCE_SETS = 400
"""Simulated counts without an effect, for the factor exceeded by chance in 5 % of them."""


@dataclass(frozen=True)
class CountedCause:
    """Evidence of counts for one cause.

    The trial is of the model with the cause and the counts, its evidence comparable with that of
    the parent; `left` says how probable the counts are with it.
    """

    trial: CandidateFit
    support: Support
    left: CountMisfit

    @property
    def name(self) -> str:
        """The name of the cause."""
        return self.support.cause

    @property
    def explains(self) -> bool:
        """Whether it passes all tests but that of its evidence."""
        one = self.support
        return one.held_out_agrees and one.is_plausible and not self.left.contradicts


@dataclass(frozen=True)
class Counted:
    """Counts of ruptures under a model, and the causes that may explain them.

    Parameters
    ----------
    misfit : CountMisfit
        Without a cause of rupture beside those of the readings.
    tried : tuple of CountedCause
        The causes that were tried, the best first; none where the counts are expected.
    threshold : float
        Log Bayes factor needed to be named.
    candidates : mapping of str to Candidate
        How each cause of the catalogue fared.
    criteria : mapping of str to float
        p-values of the counts by the other criteria of rupture, where they contradict the model.
    """

    misfit: CountMisfit
    tried: tuple[CountedCause, ...] = ()
    threshold: float = 0.0
    candidates: Mapping[str, Candidate] = field(default_factory=dict)
    criteria: Mapping[str, float] = field(default_factory=dict)

    @property
    def best(self) -> CountedCause | None:
        """The cause that explains the counts best, if any does."""
        first = next((one for one in self.tried if one.explains), None)
        if first is None or first.name == COMMON_FACTOR.name:
            return None
        return first if first.support.log_bayes_factor >= self.threshold else None

    @property
    def supported(self) -> tuple[Support, ...]:
        """Support for that cause."""
        return () if self.best is None else (self.best.support,)

    @property
    def explained_by(self) -> tuple[str, ...]:
        """That cause and those that cannot be told apart from it."""
        return tuple(name for one in self.supported for name in (one.cause, *one.inseparable))


def judge_counts(
    parent: CandidateFit,
    counts: RuptureCounts,
    causes: Iterable[Cause],
    generator: np.random.Generator,
) -> Counted:
    """Compute the probability of counts, and the causes that explain improbable ones.

    The parent has the causes that the readings favour; `causes` act on rupture alone and may be
    named.
    """
    known = parent.draws(generator, DRAWS)
    chances = answered(chances_at(parent.subject, counts, known))
    misfit = judged_counts(counts.tests, chances, generator, PUBLISHED)
    if not misfit.contradicts:
        return Counted(misfit)
    others = [cause for cause in (*causes, COMMON_FACTOR) if cause.name not in parent.names]
    base = CountLaw.of(counts.tests, chances)
    laws = _all_extended(parent, counts, others, known, generator)
    sets = base.simulated(generator, CHANCE_SETS)
    gained = np.stack([one.log_probability(sets) - base.log_probability(sets) for one in laws])
    chance: Floats = gained.max(axis=0)
    # log probability of the counts given the readings, without a cause of rupture
    joint = parent.subject.with_observations(counts)
    _, plain = _fitted(joint, parent.mode, generator)
    drawn = float(base.log_probability(counts.tests.ruptured[None])[0])
    without = max(plain.log_evidence - parent.log_evidence, drawn)
    found = [one.judged(parent, base, without, chance, generator) for one in laws]
    factors = {one.name: one.support.log_bayes_factor for one in found}
    tried = []
    for one in sorted(found, key=lambda one: -one.support.log_bayes_factor):
        own = factors[one.name]
        rivals = {name: own - other for name, other in factors.items() if name != one.name}
        tried.append(replace(one, support=replace(one.support, rivals=rivals)))
    told = _candidates(tried, generator)
    told.pop(COMMON_FACTOR.name)
    vectors = known[:OTHERS_DRAWS]
    chosen = parent.subject.world.criterion
    others_say: dict[str, float] = {
        criterion: count_misfit(
            parent.subject.with_world(criterion=criterion), counts, vectors, generator, PUBLISHED
        ).p_value
        for criterion in RUPTURE_CRITERIA
        if criterion != chosen
    }
    return Counted(misfit, tuple(tried), naming_threshold(chance), told, others_say)


def _fitted(
    subject: JointModel, start: Floats, generator: np.random.Generator
) -> tuple[Floats, Evidence]:
    """Return the mode of a model with the counts, and an importance sample about it."""
    laplace = approximate(subject, generator, start=start)
    return laplace.mode, about_mode(subject, laplace, generator, enough=WANTED)


class _Found(NamedTuple):
    """Log likelihood of draws with a cause, (n,), and probabilities of rupture."""

    own: Floats
    chances: Chances


def _all_extended(
    parent: CandidateFit,
    counts: RuptureCounts,
    causes: Sequence[Cause],
    known: Floats,
    generator: np.random.Generator,
) -> list["_Extended"]:
    """Extend draws of a model by prior sizes of each cause in turn."""
    subjects = [parent.subject.extended(cause) for cause in causes]
    points = [with_sizes(parent.subject, cause, known, generator) for cause in causes]
    parts = [
        _answers(parent.subject, counts, subjects, [known[rows], *(one[rows] for one in points)])
        for rows in (slice(k, k + AT_ONCE) for k in range(0, len(known), AT_ONCE))
    ]
    found = []
    for cause, subject, of_it, answers in zip(
        causes, subjects, points, zip(*parts, strict=True), strict=True
    ):
        own, chances = zip(*answers, strict=True)
        whole = Chances(*map(np.concatenate, zip(*chances, strict=True)))
        found.append(
            _Extended.of(cause, subject, counts, of_it, _Found(np.concatenate(own), whole))
        )
    return found


def _answers(
    parent: JointModel,
    counts: RuptureCounts,
    subjects: Sequence[JointModel],
    points: Sequence[Floats],
) -> list[_Found]:
    """Evaluate models that differ only in causes of rupture, with one call of the forward map."""
    first, *values = (
        model.table.named(rows) for model, rows in zip((parent, *subjects), points, strict=True)
    )
    with np.errstate(all="ignore"):
        state, tests = parent.state(first), parent.tests(first)
        without = _of_ruptures(parent, state)
        found = []
        for subject, named in zip(subjects, values, strict=True):
            own = _of_ruptures(subject, state.with_causes(subject.causes, named)) - without
            chances = chances_of(tests.with_causes(subject.causes, named), counts.tests)
            found.append(_Found(own, chances))
    return found


def _of_ruptures(model: JointModel, state: State[FilmsAndActuators]) -> Floats:
    """Return the log likelihood of the study's own ruptures, the only data affected, (n,)."""
    parts = [one.log_likelihood(state).sum(axis=1) for one in model.of_kind(Rupture)]
    return np.sum(parts, axis=0) if parts else np.zeros(len(state))


@dataclass(frozen=True)
class _Extended:
    """A model with a cause and the counts, by weighted draws."""

    cause: Cause
    subject: JointModel
    counts: RuptureCounts
    drawn: Evidence
    law: CountLaw
    own: Floats

    @classmethod
    def of(
        cls, cause: Cause, subject: JointModel, counts: RuptureCounts, points: Floats, found: _Found
    ) -> "_Extended":
        """Weight the draws within the range of model and forward map."""
        own, chances = found
        kept = np.isfinite(own) & np.all(np.isfinite(chances.whole), axis=1)
        points, own = points[kept], own[kept]
        law = CountLaw.of(counts.tests, Chances(*(part[kept] for part in chances)))
        joint = own + law.draw_by_draw(counts.tests.ruptured)
        return cls(cause, subject, counts, weighted(points, joint), law, own)

    def log_probability(self, sets: Floats) -> Floats:
        """Return the log probability of sets of counts with the cause, (m,)."""
        mean = logsumexp(self.own) - np.log(len(self.own))
        found: Floats = self.law.reweighted(self.own).log_probability(sets) + mean
        return found

    def judged(
        self,
        parent: CandidateFit,
        base: CountLaw,
        without: float,
        chance: Floats,
        generator: np.random.Generator,
    ) -> CountedCause:
        # Fitted from the best draw of its prior. Counts leave the sizes of a cause on a ridge,
        # around whose top there may be fewer effective draws than among those of the prior: the
        # sample with more effective draws gives the evidence.
        subject = self.subject.with_observations(self.counts)
        best = self.drawn.draws[int(np.argmax(self.drawn.log_weights))]
        mode, posterior = _fitted(subject, best, generator)
        beyond = posterior.log_evidence - parent.log_evidence
        if not posterior.effective >= self.drawn.effective:
            posterior, beyond = self.drawn, self.drawn.log_evidence
        centre, uncertain = with_prior_moments(
            parent.centre, parent.uncertain, parent.subject, subject
        )
        log_evidence = parent.log_evidence + beyond - without
        trial = CandidateFit(subject, mode, log_evidence, posterior, uncertain, centre)
        factor = trial.log_evidence - parent.log_evidence
        drawn = trial.draws(generator, DRAWS)
        different, place = np.unique(drawn, axis=0, return_inverse=True)  # draws are repeated
        chances = chances_at(self.subject, self.counts, different)
        repeated = answered(Chances(*(part[place] for part in chances)))
        left = judged_counts(self.counts.tests, repeated, generator, PUBLISHED)
        # actuators left out in turn: the gain in log predictive density of each
        tests = self.counts.tests
        times = np.concatenate([tests.ruptured, tests.tested - tests.ruptured])
        each = _left_out(self.law.reweighted(self.own)) - _left_out(base)
        each = np.repeat(each, times.astype(int))
        size = float(np.median(drawn[:, columns_of(trial.subject, self.cause)[0]]))
        support = Support(
            cause=self.cause.name,
            log_bayes_factor=factor,
            elpd_diff=float(np.sum(each)),
            elpd_diff_se=standard_error(each),
            rivals={},
            prior_tail=prior_tail(self.cause, size),
            chance=float(chance_of(factor, chance)),
            least_tail=least_tail(trial, self.cause),
        )
        return CountedCause(trial, support, left)


def _left_out(law: CountLaw) -> Floats:
    """Return the log predictive probability of one that burst, then one that did not, by level."""
    tests, chances = law.tests, law.chances
    each = np.concatenate([chances.burst, chances.whole], axis=1)
    times = np.concatenate([tests.ruptured, tests.tested - tests.ruptured])
    total = law.log_weights + np.sum(np.where(times > 0, each * times, 0.0), axis=1)
    found: Floats = np.where(
        times > 0.0, logsumexp(total) - logsumexp(total[:, None] - each, axis=0), 0.0
    )
    return found


def _candidates(
    tried: Sequence[CountedCause], generator: np.random.Generator
) -> dict[str, Candidate]:
    """Return the evidence for each cause, with its probability among them and no cause."""
    factors = np.array([0.0, *(one.support.log_bayes_factor for one in tried)])
    shares = np.exp(factors - logsumexp(factors))[1:]
    return {
        one.name: Candidate(
            cause=one.name,
            log_bayes_factor=one.support.log_bayes_factor,
            probability=float(share),
            elpd_diff=one.support.elpd_diff,
            elpd_diff_se=one.support.elpd_diff_se,
            effect=effect_sizes(one.trial, one.trial.cause(one.name), generator),
            log_bayes_factor_error=one.trial.posterior.error,
            naming_p_value=one.support.chance,
            mechanism=one.trial.cause(one.name).mechanism,
            judged_by=FULL_FIT,
        )
        for one, share in zip(tried, shares, strict=True)
    }
