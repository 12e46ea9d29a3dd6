"""The whole argument on any model of readings: fit, search, hold out, decide, or refuse to say.

What a parameter is worth depends on the outcome. Where the model is adequate or a cause is named
its interval stands; where several causes are possible it is averaged over them by their evidence;
where a misfit stays unexplained none is given, since the parameter has absorbed part of the misfit:
a Gaussian-process discrepancy makes the interval wider, not right (Brynjarsdóttir and O'Hagan 2014,
doi:10.1088/0266-5611/30/11/114007).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.checks.discrepancy import (
    AMPLITUDES,
    MISFIT_LEVEL,
    Misfit,
    discrepancies,
    largest_ratio,
)
from bayesdeg.criticism.decide.support import Support, hold_out, supports
from bayesdeg.criticism.decide.verdict import Decision, Outcome, decide, fraction_explained
from bayesdeg.criticism.fit.search import Names, Search, SearchEffort, Step, run_search
from bayesdeg.criticism.fit.trials import Trial, base_trial
from bayesdeg.criticism.holdout.held_out import HeldOut
from bayesdeg.criticism.subject import Subject
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate
from bayesdeg.quantities import p_value_text

Floats = NDArray[np.float64]

EFFORT = SearchEffort(replicates=500, fitted=4, pairs=3)
DRAWS = 4000


@dataclass(frozen=True)
class Judgement:
    """What can be said of a model, and what it rests on.

    Parameters
    ----------
    search : Search
        All sets of causes that were fitted.
    chosen : frozenset of str
        The set that the evidence favours.
    supported : list of Support
        What speaks for each of them.
    held_out : mapping
        Predictions of held-out groups, by set.
    decision : Decision
        The outcome.
    """

    search: Search
    chosen: Names
    supported: list[Support]
    held_out: Mapping[Names, HeldOut]
    decision: Decision

    @property
    def base(self) -> Step:
        """What is known without a cause."""
        return self.search.step(self.search.base.names)

    @property
    def final(self) -> Step:
        """What is known with the favoured causes."""
        return self.search.step(self.chosen)

    @property
    def possible(self) -> tuple[Names, ...]:
        """Sets of causes that may be right, the favoured one first; none where a misfit is left."""
        if self.decision.outcome in (Outcome.UNEXPLAINED, Outcome.NOT_JUDGED):
            return ()
        if not self.decision.causes:
            return (self.search.base.names,)
        if self.final.misfit.p_value <= MISFIT_LEVEL:
            return ()
        others = (one.replaced(self.chosen, r) for one in self.supported for r in one.inseparable)
        return (self.chosen, *others)

    def draws(self, name: str, generator: np.random.Generator) -> Floats | None:
        """Draw a base parameter, averaged over the sets that may be right by their evidence.

        None where no set may be right: nothing is known of the parameter that could be trusted.
        """
        if not self.possible:
            return None
        factors = np.array([self.search.factor(names) for names in self.possible])
        weights = np.exp(factors - factors.max())
        counts = generator.multinomial(DRAWS, weights / weights.sum())
        found = [
            posterior_draws(self.search.trials[names], name, generator, count=count)
            for names, count in zip(self.possible, counts, strict=True)
        ]
        return np.concatenate(found)


def judge(
    subject: Subject,
    causes: tuple[Cause, ...],
    *,
    seed: np.random.SeedSequence,
    effort: SearchEffort = EFFORT,
) -> Judgement:
    """Say what is wrong with a model of readings, if anything.

    Parameters
    ----------
    subject : Subject
        Without a cause, such as `bayesdeg.criticism.custom.CustomModel`.
    causes : tuple of Cause
        The catalogue.
    seed : SeedSequence
        Of every random number.
    effort : SearchEffort
        What the search may cost.
    """
    searched, folds = seed.spawn(2)
    base = first_trial(subject, np.random.default_rng(searched))
    search = Search(base, causes, effort, searched)
    chosen = run_search(search)
    held_out = hold_out(search, chosen, seed=folds)
    supported = supports(search, chosen, held_out)
    decision = decide(search.step(base.names), search.step(chosen), supported)
    return Judgement(search, chosen, supported, held_out, decision)


def first_trial(subject: Subject, generator: np.random.Generator) -> Trial:
    """Return a model without a cause, fitted from its priors."""
    laplace = approximate(subject, generator)
    posterior = about_mode(subject, laplace, generator)
    return base_trial(subject, laplace.mode, posterior)


def posterior_draws(
    trial: Trial, name: str, generator: np.random.Generator, *, count: int = DRAWS
) -> Floats:
    """Draw one parameter of a fitted model, in its unit, (count,)."""
    return trial.subject.table.named(trial.draws(generator, count))[name]


def interval_with_discrepancy(trial: Trial, name: str) -> tuple[float, float]:
    """Return the 90 % interval of a parameter where the best discrepancy is added to the errors.

    In the linearised model, with δ ~ N(δ₀, Λ⁻¹) and readings of covariance V + K: K is the
    covariance of the most probable of the discrepancies that measure the misfit. It is no remedy:
    what of a misfit looks like a change of the parameter is still taken for one.
    """
    linear, subject, jacobian = trial.linear, trial.subject, trial.linear.jacobian
    kernels = discrepancies(linear)
    best = int(largest_ratio(linear.observed[None], kernels)[1][0])
    kernel, amplitude = kernels[best // len(AMPLITUDES)], AMPLITUDES[best % len(AMPLITUDES)]
    signal = amplitude**2 * kernel.values
    shrink = kernel.vectors * (signal / (1.0 + signal))

    spread = linear.whiten_columns(jacobian @ trial.uncertain)
    weighed = spread - shrink @ (kernel.vectors.T @ spread)
    centre = trial.mode + linear.shift + weighed.T @ linear.observed
    covariance = trial.uncertain - spread.T @ weighed
    row = subject.table.names.index(name)
    half = 1.645 * np.sqrt(covariance[row, row])
    law = subject.table.parameters[row].law
    low, high = law.from_unconstrained(centre[row] + half * np.array([-1.0, 1.0]))
    return float(low), float(high)


SEED = 0  # of the draws that are summarised


def summary(judgement: Judgement) -> dict[str, Any]:
    """Return outcome, misfit, every fitted set of causes, and what may be trusted.

    Returns
    -------
    dict
        With names and numbers alone. Log Bayes factors [nats] are against the model without a
        cause; ``explained_fraction`` is None where there is no more misfit than chance gives;
        ``trusted`` has mean, sd and 90 % interval of each base parameter, in its unit, or
        None where no model that was tried may be believed.
    """
    search = judgement.search
    base, final = judgement.base.misfit, judgement.final.misfit
    parameters = search.base.subject.table.parameters
    return {
        "outcome": str(judgement.decision.outcome),
        "causes": list(judgement.decision.causes),
        "reasons": list(judgement.decision.reasons),
        "favoured": sorted(judgement.chosen),
        "threshold": judgement.base.threshold,
        "misfit": _misfit(base),
        "misfit_left": _misfit(final),
        "explained_fraction": fraction_explained(judgement.base, judgement.final),
        "held_out": {one.cause: [one.elpd_diff, one.elpd_diff_se] for one in judgement.supported},
        "units": {p.name: p.unit for p in search.trials[judgement.chosen].subject.table.parameters}
        | {c.qualified(p.name): p.unit for c in search.causes for p in c.parameters},
        "fitted": [_fitted(judgement, names) for names in sorted(search.trials, key=sorted)],
        "trusted": {p.name: _trusted(judgement, p.name) for p in parameters},
    }


def _misfit(misfit: Misfit) -> dict[str, float]:
    return {
        "statistic": misfit.statistic,
        "p_value": misfit.p_value,
        "replicates": len(misfit.null),
    }


def _in_words(misfit: dict[str, float], unit: str = "") -> str:
    chance = p_value_text(misfit["p_value"], misfit["replicates"])
    return f"{misfit['statistic']:.1f}{unit}, {chance}"


def lines(found: dict[str, Any]) -> list[str]:
    """Return a summary in words, a line for each statement."""
    units = {name: f" {unit}".removesuffix(" –") for name, unit in found["units"].items()}
    left = found["misfit_left"]
    causes = " or " if found["outcome"] == "ambiguous" else " and "
    said = f": {causes.join(found['causes'])}" if found["causes"] else ""
    out = [f"outcome: {found['outcome']}{said}"]
    out += [f"  not named: {reason}" for reason in found["reasons"]]
    out.append(
        f"misfit: {_in_words(found['misfit'], ' nats')}; "
        f"left with {_name(found['favoured'])}: {_in_words(left)}"
    )
    for one in found["fitted"]:
        sizes = (f"{n} = {m:.3g} ± {s:.2g}{units[n]}" for n, (m, s) in one["posterior"].items())
        out.append(
            f"  {_name(one['causes'])}: ln Bayes factor {one['log_bayes_factor']:+.1f}; "
            + ", ".join(sizes)
        )
    for name, (gain, error) in found["held_out"].items():
        out.append(f"held out, with {name}: log density {gain:+.1f} ± {error:.1f}")
    for name, value in found["trusted"].items():
        if value is None:
            out.append(f"{name}: not to be trusted, no model that was tried is left without misfit")
        else:
            low, high = value["interval_90"]
            out.append(f"{name}: {low:.3g} to {high:.3g}{units[name]} (90 %)")
    return out


def _fitted(judgement: Judgement, names: Names) -> dict[str, Any]:
    trial, generator = judgement.search.trials[names], np.random.default_rng(SEED)
    draws = {n: posterior_draws(trial, n, generator) for n in trial.subject.table.names}
    return {
        "causes": sorted(names),
        "log_bayes_factor": judgement.search.factor(names),
        "posterior": {n: [float(np.mean(d)), float(np.std(d))] for n, d in draws.items()},
    }


def _trusted(judgement: Judgement, name: str) -> dict[str, Any] | None:
    draws = judgement.draws(name, np.random.default_rng(SEED))
    if draws is None:
        return None
    return {
        "mean": float(np.mean(draws)),
        "sd": float(np.std(draws)),
        "interval_90": np.quantile(draws, [0.05, 0.95]).tolist(),
    }


def _name(causes: list[str]) -> str:
    return " + ".join(causes) or "no cause"
