"""Causes that a study could confuse, found by simulating it under each cause.

Readings z = d_a + e, e ~ N(0, I), of the linearised model with the effect d_a of cause a; cause b
is as good where its linear Bayes factor is within odds of 20 of that of a.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.decide.support import Support
from bayesdeg.criticism.decide.verdict import fraction_explained
from bayesdeg.criticism.findings import Candidate, EffectSize
from bayesdeg.criticism.fit.linear import Linear, effects, log_bayes_factor, sensitivities
from bayesdeg.criticism.fit.search import Names, Search, set_penalties
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.criticism.holdout.held_out import HeldOut, difference

Floats = NDArray[np.float64]

CLEAR = float(np.log(20.0))
OFTEN = (
    0.1  # share of simulated studies in which the wrong cause is as good: then they are confusable
)
VISIBLE = 3.0  # size of an effect, in standard deviations, below which it is invisible
DRAWS = 300


@dataclass(frozen=True)
class Confusability:
    """Causes that would be named if each cause acted.

    Parameters
    ----------
    names : tuple of str
        The causes.
    visible : array, shape (k,)
        Size of each one's effect on the whitened readings [standard deviations].
    confused : array, shape (k, k)
        Share of studies simulated under the row's cause in which the column's is as good, to
        within a Bayes factor of 20.
    """

    names: tuple[str, ...]
    visible: Floats
    confused: Floats

    def pairs(self) -> list[tuple[str, str]]:
        """Return pairs of causes that would often be confused."""
        return [
            (self.names[i], self.names[j])
            for i, j in combinations(range(len(self.names)), 2)
            if np.all(self.visible[[i, j]] > VISIBLE)
            and max(self.confused[i, j], self.confused[j, i]) > OFTEN
        ]

    def rivals(self, name: str) -> list[str]:
        """Return causes that would often be as good as a given one if it acted."""
        i = self.names.index(name)
        return [n for j, n in enumerate(self.names) if j != i and self.confused[i, j] > OFTEN]


NOT_KNOWN = Confusability((), np.zeros(0), np.zeros((0, 0)))


def confusability(
    linear: Linear, causes: tuple[Cause, ...], generator: np.random.Generator
) -> Confusability:
    """Simulate the readings under each cause at its typical size and judge them."""
    if not causes:
        return NOT_KNOWN
    columns = [sensitivities(linear, cause) for cause in causes]
    typical = [
        [p.law.to_unconstrained(c.typical.get(p.name, p.neutral or 0.0)) for p in c.parameters]
        for c in causes
    ]
    changes = np.stack(
        [
            np.nan_to_num(effects(linear, cause, np.array([size], dtype=np.float64))[0])
            for cause, size in zip(causes, typical, strict=True)
        ]
    )
    noise = generator.standard_normal((DRAWS, changes.shape[1]))
    confused = np.zeros((len(causes), len(causes)))
    for i, change in enumerate(changes):
        z = change + noise
        # directions of each cause: for small sizes, and for its typical one
        wide = (np.column_stack(both) for both in zip(columns, changes, strict=True))
        factors = np.stack([log_bayes_factor(z, directions) for directions in wide])
        confused[i] = np.mean(factors > factors[i] - CLEAR, axis=1)
    return Confusability(
        tuple(cause.name for cause in causes), np.linalg.norm(changes, axis=1), confused
    )


EFFECT_DRAWS = 2000
LEAST = -1e3  # floor of the log Bayes factors shown
FULL_FIT, SCREENING = "full fit", "screening"  # how a cause was judged


def candidates(
    search: Search,
    supported: list[Support],
    held_out: Mapping[Names, HeldOut],
    generator: np.random.Generator,
    why: Mapping[str, str] = MappingProxyType({}),
) -> list[Candidate]:
    """Return every cause that was tried, the most probable first.

    `why` says why those that a test refuted are not named, by name.
    """
    shares = probabilities(search)
    named = {one.cause: one for one in supported}
    found = []
    base, chosen = search.base.names, frozenset(named)
    for cause in search.causes:
        alone = frozenset({cause.name})
        if cause.name in named:
            one = named[cause.name]
            names, rest, factor = chosen, chosen - alone, one.log_bayes_factor
            gain, error, chance = one.elpd_diff, one.elpd_diff_se, one.chance
        elif alone in search.trials:
            names, rest, factor = alone, base, max(search.factor(alone), LEAST)
            tested = alone in held_out and base in held_out
            gain, error = difference(held_out[alone], held_out[base]) if tested else (None, None)
            chance = search.step(base).chance_of(search.factor(alone))
        else:
            factor = search.step(base).screened[cause.name].log_bayes_factor
            found.append(
                Candidate(
                    cause=cause.name,
                    log_bayes_factor=max(factor, LEAST),
                    probability=shares[cause.name],
                    naming_p_value=search.step(base).chance_of(factor),
                    mechanism=cause.mechanism,
                    judged_by=SCREENING,
                )
            )
            continue
        larger, smaller = search.trials[names].posterior, search.trials[rest].posterior
        found.append(
            Candidate(
                cause=cause.name,
                log_bayes_factor=factor,
                probability=shares[cause.name],
                explained_fraction=fraction_explained(search.step(base), search.unscreened(names)),
                elpd_diff=gain,
                elpd_diff_se=error,
                effect=effect_sizes(search.trials[names], cause, generator),
                log_bayes_factor_error=float(np.hypot(larger.error, smaller.error)),
                naming_p_value=chance,
                mechanism=cause.mechanism,
                why=why.get(cause.name, ""),
                judged_by=FULL_FIT,
            )
        )
    return sorted(found, key=lambda c: (-(c.probability or 0.0), -(c.log_bayes_factor or LEAST)))


def probabilities(search: Search) -> dict[str, float]:
    """Return posterior probabilities of the causes.

    Over all fitted sets and all causes screened alone; the prior probability of a set of k out of m
    causes is that of no cause divided by the number of sets of its size.
    """
    factors = {names: search.factor(names) for names in search.trials}
    for name, one in search.step(search.base.names).screened.items():
        factors.setdefault(frozenset({name}), one.log_bayes_factor)
    penalty = set_penalties(len(search.causes))
    logs = np.array([factor - penalty[len(names)] for names, factor in factors.items()])
    weights = np.exp(logs - logsumexp(logs))
    return {
        cause.name: min(
            float(sum(w for names, w in zip(factors, weights, strict=True) if cause.name in names)),
            1.0,
        )
        for cause in search.causes
    }


def effect_sizes(
    trial: CandidateFit, cause: Cause, generator: np.random.Generator
) -> dict[str, EffectSize]:
    """Return the posterior of each parameter of an active cause."""
    if trial.posterior.effective == 0.0:
        return {}
    values = trial.subject.table.named(trial.draws(generator, EFFECT_DRAWS))
    return {p.name: effect_size(values[cause.qualified(p.name)], p.unit) for p in cause.parameters}


def effect_size(draws: Floats, unit: str) -> EffectSize:
    """Summarise posterior draws of one parameter of a cause."""
    low, high = np.quantile(draws, [0.05, 0.95])
    mean, sd = float(np.mean(draws)), float(np.std(draws))
    return EffectSize(mean=mean, sd=sd, q05=float(low), q95=float(high), unit=unit)
