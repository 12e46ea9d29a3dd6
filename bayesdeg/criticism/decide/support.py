"""Support for each cause of a set: evidence, held-out specimens, rivals, plausible size."""

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.linear import columns_of
from bayesdeg.criticism.fit.search import Names, Search, ensure, rivals
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.criticism.holdout.held_out import HeldOut, difference, one_by_one, run_folds
from bayesdeg.inference.model import JointModel
from bayesdeg.priors import Distribution, Normal, TruncatedNormal

Regroup = Callable[[JointModel], JointModel]

INSEPARABLE = float(np.log(20.0))
IMPLAUSIBLE = 0.005  # least prior probability of a size as far from neutral
EXCLUDED = 0.001
"""Prior probability of a size as far from neutral below which no evidence names a cause: one cause
in a thousand has such a size, while one effect outside the catalogue in 25 was named as an entry in
virtual studies. So such a size is more often that of an imitation."""
TWINS_APART = (
    2.0 * INSEPARABLE
)  # log Bayes factor that size priors alone can give between indistinguishable causes
MODERATE = 2.0 * INSEPARABLE  # evidence up to which an implausible size is not accepted
UNSURE = 3.0  # standard errors of a difference of evidences within which Monte Carlo error decides
SIZES, INTERVAL = 2000, (0.05, 0.95)  # draws of a size and the ends of its interval
LEVELS = 20_000  # quantiles of a prior: twenty of them lie beyond a tail of 0.001
CLOSE_CALL = 2.0
"""Distance of a held-out gain from its threshold within which Monte Carlo error may decide [nats]:
in one study the gain varied by 2.0 between three seeds."""


@dataclass(frozen=True)
class Support:
    """Support for one cause of a set.

    Parameters
    ----------
    cause : str
        Its name.
    log_bayes_factor : float
        Of the set against the set without it [nats].
    elpd_diff, elpd_diff_se : float or None
        Gain in log predictive density of held-out specimens over the set without it.
    rivals : mapping of str to float
        What could stand in its place, with what it has less in log Bayes factor.
    prior_tail : float
        Prior probability of a size at least as far from neutral.
    together : (float, float), optional
        Gain of the whole set over the base model, and its standard error; of one of several.
    chance : float or None
        Share of data sets simulated without it in which the best of all candidates has as large a
        log Bayes factor, (1 + #)/(1 + n): the test that names, directed at the catalogue.
    twins : mapping of str to tuple of str
        Of it and of its rivals, which causes no reading tells from each.
    least_tail : float
        Prior probability of a size at least as far from neutral as the near end of its 90 %
        interval, so that an interval that reaches into the bulk of the prior does not count
        against it.
    """

    cause: str
    log_bayes_factor: float
    elpd_diff: float | None
    elpd_diff_se: float | None
    rivals: Mapping[str, float]
    prior_tail: float
    together: tuple[float, float] | None = None
    chance: float | None = None
    twins: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    least_tail: float = 1.0

    @property
    def held_out_agrees(self) -> bool:
        """Whether held-out specimens are predicted better by more than a standard error.

        For several causes this holds together; each must add to it, however little, since the gain
        of a cause that few specimens show is uncertain.
        """
        if self.elpd_diff is None:
            return False
        if self.together is None:
            return self.elpd_diff > (self.elpd_diff_se or 0.0)
        return self.elpd_diff > 0.0 and self.together[0] > self.together[1]

    @property
    def is_close_call(self) -> bool:
        """Whether Monte Carlo error may decide the result for held-out specimens."""
        if self.elpd_diff is None:
            return False
        if self.together is None:
            return abs(self.elpd_diff - (self.elpd_diff_se or 0.0)) < CLOSE_CALL
        beyond = self.together[0] - self.together[1]
        return min(abs(self.elpd_diff), abs(beyond)) < CLOSE_CALL

    @property
    def is_plausible(self) -> bool:
        """Whether its size is plausible a priori, or the evidence compels it.

        Evidence does not compel one of several causes: two causes of arbitrary size can imitate a
        third, with more evidence the more readings there are. A nonlinear gauge looks like a film
        mismatch of five standard deviations together with a leak. Nor does it compel one whose
        whole interval is `EXCLUDED`: a regulator with friction looks like creep, but creeps by a
        half where 99.9 % of the prior lie below two fifths.
        """
        if self.is_excluded:
            return False
        excused = self.together is None and self.log_bayes_factor >= MODERATE
        return self.prior_tail >= IMPLAUSIBLE or excused

    @property
    def is_excluded(self) -> bool:
        """Whether even the size nearest to neutral that the readings allow is `EXCLUDED`."""
        return self.least_tail < EXCLUDED

    @property
    def inseparable(self) -> tuple[str, ...]:
        """Equally good rivals, in order of evidence.

        If its size is implausible, rivals with a slightly larger deficit are as good. So are those
        that no reading distinguishes from it or from an equally good rival: there size priors
        dominate the evidence.
        """
        close = {name: gap for name, gap in self.rivals.items() if gap < self.farthest(name)}
        return tuple(sorted(close, key=lambda name: close[name]))

    def farthest(self, rival: str) -> float:
        """Return the largest deficit of an equally good rival [nats]."""
        alike = self.twins.get(rival, ())
        behind = [
            self.rivals[twin]
            for twin in alike
            if twin in self.rivals and self.rivals[twin] < self._farthest_alone(twin)
        ]
        return max([self._farthest_alone(rival), *(gap + TWINS_APART for gap in behind)])

    def _farthest_alone(self, rival: str) -> float:
        """Return the largest deficit, irrespective of other rivals [nats]."""
        if rival in self.twins.get(self.cause, ()):
            return TWINS_APART
        return (2.0 if self.prior_tail < IMPLAUSIBLE else 1.0) * INSEPARABLE

    def replaced(self, chosen: Names, rival: str) -> Names:
        """Return the set with this cause replaced by a rival."""
        return chosen - {self.cause} | {rival}


def hold_out_each(
    search: Search,
    chosen: Names,
    ways: Sequence[Regroup],
    *,
    known: Collection[Names] = (),
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_set: Callable[[Names], None] | None = None,
) -> list[dict[Names, HeldOut]]:
    """Predict held-out groups with no cause, without each of a set, and with all of it, in turn.

    All calibrations run in parallel, with the same seed, so that they are compared on the same
    draws. Each of the ways makes of a model one that holds out other groups. `on_set` is called
    after each set. One mapping for each way, without the sets already `known`; empty where there is
    a single group of readings, without which nothing would be left, or no group.
    """
    smaller = (chosen - {name} for name in sorted(chosen))
    sets = dict.fromkeys([search.base.names, *smaller, chosen])
    asked = [
        (way, names)
        for way, regroup in enumerate(ways)
        if can_be_held_out(regroup(search.base.subject))
        for names in sets
        if names not in known
    ]
    fits = ((search.trials[names], ways[way]) for way, names in asked)
    plans = (one_by_one(replace(fit, subject=way(fit.subject)), seed) for fit, way in fits)
    told = None if on_set is None else (lambda place: on_set(asked[place][1]))
    found: list[dict[Names, HeldOut]] = [{} for _ in ways]
    for (way, names), held_out in zip(asked, run_folds(plans, executor, told), strict=True):
        found[way][names] = held_out
    return found


def as_it_is(subject: JointModel) -> JointModel:
    """Return a model that holds out only groups that it has."""
    return subject


def can_be_held_out(subject: JointModel) -> bool:
    """Return whether data remain to predict from: a measured mean may be the only one."""
    return len(subject.groups) >= (2 if np.any(subject.group != "") else 1)


def supports(search: Search, chosen: Names, held_out: Mapping[Names, HeldOut]) -> list[Support]:
    """Return the support for each cause of a set, the strongest first.

    If a rival is so close to the deciding odds that Monte Carlo error matters, the evidence of both
    sets is estimated again first.
    """
    found = _supports(search, chosen, held_out)
    own, doubtful = search.trials[chosen].posterior.error, list[Names]()
    for one in found:
        for rival, gap in one.rivals.items():
            names = one.replaced(chosen, rival)
            error = np.hypot(own, search.trials[names].posterior.error)
            if abs(gap - one.farthest(rival)) < UNSURE * error:
                doubtful.append(names)
    if not doubtful:
        return found
    search.settle(dict.fromkeys([chosen, *doubtful]))
    return _supports(search, chosen, held_out)


def _supports(search: Search, chosen: Names, held_out: Mapping[Names, HeldOut]) -> list[Support]:
    twins, whole = {cause.name: cause.twins for cause in search.causes}, search.factor(chosen)
    found = []
    for name in sorted(chosen):
        others = rivals(search, chosen, name)
        one = support_without_rivals(search, chosen, name, held_out)
        found.append(
            replace(
                one,
                rivals={rival: whole - other for rival, other in others.items()},
                chance=search.step(chosen - {name}).chance_of(one.log_bayes_factor),
                twins={one: twins[one] for one in (name, *others)},
            )
        )
    return sorted(found, key=lambda one: -one.log_bayes_factor)


def support_without_rivals(
    search: Search, chosen: Names, name: str, held_out: Mapping[Names, HeldOut]
) -> Support:
    """Return the support for a cause of a fitted set whose replacements are not sought."""
    base, rest, fitted = search.base.names, chosen - {name}, search.trials[chosen]
    ensure(search, rest)
    together = None
    if len(chosen) > 1 and {chosen, base} <= set(held_out):
        together = difference(held_out[chosen], held_out[base])
    tested = chosen in held_out and rest in held_out
    gain, error = difference(held_out[chosen], held_out[rest]) if tested else (None, None)
    cause = fitted.cause(name)
    return Support(
        name,
        search.factor(chosen) - search.factor(rest),
        gain,
        error,
        {},
        prior_tail(cause, float(fitted.mode[columns_of(fitted.subject, cause)[0]])),
        together,
        least_tail=least_tail(fitted, cause),
    )


def least_tail(trial: CandidateFit, cause: Cause) -> float:
    """Return the prior tail beyond the end of the 90 % interval that is nearest to the centre.

    The centre of a cause's size is its neutral value, that of another parameter, such as the time
    constant of creep, its prior median; the least of all parameters counts. 1 if every interval
    holds its centre, or the draws are worth nothing. A bound cuts no tail off: the skin of a wide
    prior that is pressed against its bound is thicker than the rule has it, but not improbable up
    to there.
    """
    if not trial.posterior.effective > 0.0:
        return 1.0
    draws = trial.draws(np.random.default_rng(0), SIZES)[:, columns_of(trial.subject, cause)]
    tails = []
    for number, (one, drawn) in enumerate(zip(cause.parameters, draws.T, strict=True)):
        low, high = np.quantile(drawn, INTERVAL)
        median = float(np.asarray(one.law.quantile(np.array([0.5]))).item())
        centre = float(one.law.to_unconstrained((one.neutral or 0.0) if number == 0 else median))
        law = Normal(one.law.mean, one.law.sd) if isinstance(one.law, TruncatedNormal) else one.law
        tails.append(_tail(law, centre, float(np.clip(centre, low, high))))
    return min(tails)


def prior_tail(cause: Cause, value: float) -> float:
    """Return the prior probability of a size at least as far from neutral.

    The first parameter of a cause is its size; the value is on the unconstrained scale. If the
    prior is not symmetric about neutral, sizes on the other side count for no more than those on
    the value's own side: under a prior of 14 ± 1, a size of −14 is not probable.
    """
    size = cause.parameters[0]
    return _tail(size.law, float(size.law.to_unconstrained(size.neutral or 0.0)), value)


def _tail(law: Distribution, neutral: float, value: float) -> float:
    if value == neutral:
        return 1.0
    prior = law.to_unconstrained(law.quantile((np.arange(LEVELS) + 0.5) / LEVELS))
    above = value > neutral
    same = float(np.mean(prior >= value if above else prior <= value))
    if not np.isfinite(neutral):  # at a bound, from which all sizes are on one side
        return same
    return min(float(np.mean(np.abs(prior - neutral) >= abs(value - neutral))), 2.0 * same)
