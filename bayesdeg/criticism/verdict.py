"""Which cause, several, or that none can be named.

The chain of argument: (1) the misfit as a whole is calibrated by simulating from the fitted base
model; (2) a Gaussian-process discrepancy says how much there is to explain; (3) causes are added
one after another as long as the evidence passes what chance gives in 5 % of data without an effect,
which is a test of its own, directed at the catalogue, and they are then judged jointly
(`bayesdeg.criticism.search`); (4) together they must raise the predictive density of what is held
out by more than a standard error, each adding to it, and leave no more than chance or remove most
of the misfit, and none may need an implausible size unless the evidence is strong; without a cause,
the misfit as a whole, ruptures and measured means say whether the base model is adequate; (5) what
could stand in the place of a cause is reported beside it.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.conflict import Conflict
from bayesdeg.criticism.discrepancy import MISFIT_LEVEL, explained, explained_on_one_scale
from bayesdeg.criticism.held_out import HeldOut, difference, predict_one_by_one
from bayesdeg.criticism.rupture_misfit import RuptureMisfit
from bayesdeg.criticism.search import Names, Search, rivals
from bayesdeg.criticism.step import Step
from bayesdeg.criticism.subject import Subject, columns_of

Floats = NDArray[np.float64]

LEAST_EXPLAINED, LEAST_ON_ONE_SCALE = 0.5, 0.8
NEARLY_ALL = 0.9  # of the misfit: what is left may be small and yet significant
INSEPARABLE = float(np.log(20.0))
CHANCE = 0.1  # p-value of what is left above which nothing is left to explain
IMPLAUSIBLE = 0.005  # prior probability of a size as far from neutral
MODERATE = 2.0 * INSEPARABLE  # evidence that cannot carry an implausible size


class Outcome(StrEnum):
    """What can be said of the misfit."""

    ADEQUATE = "adequate"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class Decision:
    """The outcome and the causes that it is about.

    Parameters
    ----------
    outcome : Outcome
        What can be said.
    causes : tuple of str
        Named, or not to be told apart; the strongest first.
    one_of : tuple of tuple of str
        Beside named causes: sets of which one more acts, but which cannot be said.
    reasons : tuple of str
        Why causes that the evidence favours were not named.
    """

    outcome: Outcome
    causes: tuple[str, ...]
    one_of: tuple[tuple[str, ...], ...] = ()
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Support:
    """What speaks for one cause of a set.

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
    """

    cause: str
    log_bayes_factor: float
    elpd_diff: float | None
    elpd_diff_se: float | None
    rivals: Mapping[str, float]
    prior_tail: float
    together: tuple[float, float] | None = None
    chance: float | None = None

    @property
    def held_out_agrees(self) -> bool:
        """Whether held-out specimens are predicted better by more than a standard error.

        By several causes together; then each must add to that, however little: a cause that few
        specimens show has a gain that scatters.
        """
        if self.elpd_diff is None:
            return False
        if self.together is None:
            return self.elpd_diff > (self.elpd_diff_se or 0.0)
        return self.elpd_diff > 0.0 and self.together[0] > self.together[1]

    @property
    def is_plausible(self) -> bool:
        """Whether its size is one that its prior expects, or the evidence leaves no choice."""
        return self.prior_tail >= IMPLAUSIBLE or self.log_bayes_factor >= MODERATE

    @property
    def inseparable(self) -> tuple[str, ...]:
        """Rivals as good as it, in the order of their evidence.

        An implausible size counts against it: then rivals a little farther behind are as good.
        """
        margin = INSEPARABLE if self.prior_tail >= IMPLAUSIBLE else 2.0 * INSEPARABLE
        close = {name: gap for name, gap in self.rivals.items() if gap < margin}
        return tuple(sorted(close, key=lambda name: close[name]))

    def replaced(self, chosen: Names, rival: str) -> Names:
        """Return the set with a rival in the place of this cause."""
        return chosen - {self.cause} | {rival}


def hold_out(
    search: Search,
    chosen: Names,
    *,
    seed: np.random.SeedSequence,
    of: Callable[[Subject], Subject] | None = None,
    executor: Executor | None = None,
    on_set: Callable[[Names], None] | None = None,
) -> dict[Names, HeldOut]:
    """Predict held-out groups with no cause, without each of a set, and with all of it, in turn.

    Parameters
    ----------
    search : Search
        In which those sets are fitted.
    chosen : frozenset of str
        The set.
    seed : SeedSequence
        The same for each, so that they are compared on the same draws.
    of : callable, optional
        Makes of each model one that holds out other groups.
    executor : Executor, optional
        Runs calibrations side by side.
    on_set : callable, optional
        Called after each set.

    Returns
    -------
    dict
        Empty where there is a single group of readings, without which nothing would be left, or
        no group.
    """
    regroup = (lambda subject: subject) if of is None else of
    regrouped = regroup(search.base.subject)
    if len(regrouped.groups) < (2 if np.any(regrouped.group != "") else 1):
        return {}
    smaller = (chosen - {name} for name in sorted(chosen))
    found = {}
    for names in dict.fromkeys([search.base.names, *smaller, chosen]):
        trial = replace(search.trials[names], subject=regroup(search.trials[names].subject))
        found[names] = predict_one_by_one(trial, seed=seed, executor=executor)
        if on_set is not None:
            on_set(names)
    return found


def supports(search: Search, chosen: Names, held_out: Mapping[Names, HeldOut]) -> list[Support]:
    """Return what speaks for each cause of a set, the strongest first."""
    found, together = [], None
    if len(chosen) > 1 and {chosen, search.base.names} <= set(held_out):
        together = difference(held_out[chosen], held_out[search.base.names])
    for name in sorted(chosen):
        rest = chosen - {name}
        tested = chosen in held_out and rest in held_out
        gain, error = difference(held_out[chosen], held_out[rest]) if tested else (None, None)
        others = rivals(search, chosen, name)
        whole = search.factor(chosen)
        factor = whole - search.factor(rest)
        found.append(
            Support(
                name,
                factor,
                gain,
                error,
                {rival: whole - factor for rival, factor in others.items()},
                prior_tail(search, chosen, name),
                together,
                search.step(rest).chance_of(factor),
            )
        )
    return sorted(found, key=lambda one: -one.log_bayes_factor)


def decide(
    base: Step,
    final: Step,
    supported: list[Support],
    *,
    rupture: RuptureMisfit | None = None,
    contradicted: Conflict | None = None,
    on_rupture: frozenset[str] = frozenset(),
    alike: tuple[str, ...] = (),
) -> Decision:
    """Return the outcome.

    A cause may be named where the misfit as a whole is within chance: `supported` passed a test
    that is directed at what causes look like and calibrated as well, which has more power than one
    for any smooth discrepancy. Without such a cause the misfit as a whole decides.

    Parameters
    ----------
    base, final : Step
        What is known without a cause, and with all that the evidence favours.
    supported : list of Support
        Those causes.
    rupture : RuptureMisfit, optional
        Whether the base model expects the ruptures that there were.
    contradicted : Conflict, optional
        The measured mean that the base model contradicts most.
    on_rupture : frozenset of str
        Causes that act on rupture alone: they need not explain the misfit of the readings.
    alike : tuple of str
        Causes that could not be judged since another form of the law reads like them: a misfit of
        the readings that nothing else explains may be any of them.
    """
    misread = base.misfit.p_value <= MISFIT_LEVEL
    beside = (found for found in (rupture, contradicted) if found is not None)
    off = misread or any(found.p_value <= MISFIT_LEVEL for found in beside)
    unconfirmed = (_against(one) for one in supported if not one.held_out_agrees)
    reasons = list(dict.fromkeys(unconfirmed))
    reasons += [_implausible(one) for one in supported if not one.is_plausible]
    if any(one.cause not in on_rupture for one in supported):
        reasons += _against_all(base, final)
    if not supported or reasons:
        if misread and len(alike) > 1:
            return Decision(Outcome.AMBIGUOUS, alike, reasons=tuple(reasons))
        outcome = Outcome.UNEXPLAINED if off else Outcome.ADEQUATE
        return Decision(outcome, (), reasons=tuple(reasons))
    certain = tuple(one.cause for one in supported if not one.inseparable)
    open_ones = tuple((one.cause, *one.inseparable) for one in supported if one.inseparable)
    if certain:
        return Decision(Outcome.NAMED, certain, one_of=open_ones)
    together = dict.fromkeys(name for names in open_ones for name in names)
    return Decision(Outcome.AMBIGUOUS, tuple(together))


def share_explained(base: Step, final: Step) -> tuple[float, float]:
    """Return the share of the misfit that is explained, on each model's own scale and on one.

    1 where there was no misfit. The second is measured against the errors of the final model
    (`explained_on_one_scale`); it is asked for only where the first leaves a doubt.
    """
    own = explained(base.misfit, final.misfit)
    own = 1.0 if np.isnan(own) else own
    if own >= NEARLY_ALL:
        return own, own
    common = explained_on_one_scale(base.trial.linear, final.trial.linear)
    return own, 1.0 if np.isnan(common) else common


def prior_tail(search: Search, names: Names, cause: str) -> float:
    """Return the prior probability of a size at least as far from neutral as the fitted one.

    Of the first parameter, which is the cause's size.
    """
    trial = search.trials[names]
    found: Cause = next(c for c in trial.subject.causes if c.name == cause)
    size = found.parameters[0]
    value = trial.mode[columns_of(trial.subject, found)[0]]
    neutral = float(size.law.to_unconstrained(size.neutral or 0.0))
    prior = size.law.to_unconstrained(size.law.quantile((np.arange(2000) + 0.5) / 2000.0))
    return float(np.mean(np.abs(prior - neutral) >= abs(value - neutral)))


def _against(one: Support) -> str:
    if one.elpd_diff is None:
        return "there is nothing to hold out: a single specimen cannot confirm a cause"
    return (
        f"with {one.cause} held-out specimens are not predicted better "
        f"({one.elpd_diff:+.1f} ± {one.elpd_diff_se:.1f} in log density)"
    )


def _implausible(one: Support) -> str:
    return (
        f"{one.cause} would need a size to which its prior gives {one.prior_tail:.1g}, "
        f"for which a log Bayes factor of {one.log_bayes_factor:.1f} is too little"
    )


def _against_all(base: Step, final: Step) -> list[str]:
    if final.misfit.p_value > CHANCE:
        return []
    if final.misfit.p_value <= MISFIT_LEVEL < base.misfit.p_value:
        return ["it removes no misfit that was more than chance, and what is left is more"]
    own, common = share_explained(base, final)
    share = max(own, common)
    if own < LEAST_EXPLAINED and common < LEAST_ON_ONE_SCALE:
        return [f"it removes only {100 * share:.0f} % of the misfit"]
    if final.misfit.p_value <= MISFIT_LEVEL and share < NEARLY_ALL:
        return [f"it removes {100 * share:.0f} % of the misfit, and what is left is no chance"]
    return []
