"""Support for each cause of a set: evidence, held-out specimens, rivals, plausible size."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.linear import columns_of
from bayesdeg.criticism.fit.search import Names, Search, rivals
from bayesdeg.criticism.holdout.held_out import HeldOut, difference, one_by_one, run_folds
from bayesdeg.inference.model import JointModel

Regroup = Callable[[JointModel], JointModel]

INSEPARABLE = float(np.log(20.0))
IMPLAUSIBLE = 0.005  # least prior probability of a size as far from neutral
TWINS_APART = (
    2.0 * INSEPARABLE
)  # log Bayes factor that size priors alone can give between indistinguishable causes
MODERATE = 2.0 * INSEPARABLE  # evidence up to which an implausible size is not accepted
UNSURE = 3.0  # standard errors of a difference of evidences within which Monte Carlo error decides
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
        mismatch of five standard deviations together with a leak.
        """
        excused = self.together is None and self.log_bayes_factor >= MODERATE
        return self.prior_tail >= IMPLAUSIBLE or excused

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
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_set: Callable[[Names], None] | None = None,
) -> list[dict[Names, HeldOut]]:
    """Predict held-out groups with no cause, without each of a set, and with all of it, in turn.

    All calibrations run in parallel, with the same seed, so that they are compared on the same
    draws. Each of the ways makes of a model one that holds out other groups. `on_set` is called
    after each set. One mapping for each way; empty where there is a single group of readings,
    without which nothing would be left, or no group.
    """
    smaller = (chosen - {name} for name in sorted(chosen))
    sets = list(dict.fromkeys([search.base.names, *smaller, chosen]))
    asked = [
        (way, names)
        for way, regroup in enumerate(ways)
        if can_be_held_out(regroup(search.base.subject))
        for names in sets
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
    found, together = [], None
    if len(chosen) > 1 and {chosen, search.base.names} <= set(held_out):
        together = difference(held_out[chosen], held_out[search.base.names])
    for name in sorted(chosen):
        others = rivals(search, chosen, name)
        rest = chosen - {name}
        tested = chosen in held_out and rest in held_out
        gain, error = difference(held_out[chosen], held_out[rest]) if tested else (None, None)
        twins = {cause.name: cause.twins for cause in search.causes}
        whole = search.factor(chosen)
        found.append(
            replace(
                support_of(search, chosen, name),
                elpd_diff=gain,
                elpd_diff_se=error,
                rivals={rival: whole - other for rival, other in others.items()},
                together=together,
                twins={one: twins[one] for one in (name, *others)},
            )
        )
    return sorted(found, key=lambda one: -one.log_bayes_factor)


def support_of(search: Search, chosen: Names, name: str) -> Support:
    """Return the support for one cause of a fitted set by evidence alone, without rivals."""
    rest, fitted = chosen - {name}, search.trials[chosen]
    factor = search.factor(chosen) - search.factor(rest)
    cause = fitted.cause(name)
    size = float(fitted.mode[columns_of(fitted.subject, cause)[0]])
    chance = search.step(rest).chance_of(factor)
    return Support(name, factor, None, None, {}, prior_tail(cause, size), chance=chance)


def prior_tail(cause: Cause, value: float) -> float:
    """Return the prior probability of a size at least as far from neutral.

    The first parameter of a cause is its size; the value is on the unconstrained scale.
    """
    size = cause.parameters[0]
    neutral = float(size.law.to_unconstrained(size.neutral or 0.0))
    prior = size.law.to_unconstrained(size.law.quantile((np.arange(2000) + 0.5) / 2000.0))
    return float(np.mean(np.abs(prior - neutral) >= abs(value - neutral)))
