"""Causes that a study could confuse, found by simulating it under each cause.

Readings z = d_a + e, e ~ N(0, I), of the linearised model with the effect d_a of cause a; cause b
is as good where its linear Bayes factor is within odds of 20 of that of a.
"""

from collections.abc import Mapping
from dataclasses import dataclass

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
from bayesdeg.criticism.subject import typical_size

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
            for i in range(len(self.names))
            for j in range(i + 1, len(self.names))
            if self._is_confused(i, j)
        ]

    def rivals(self, name: str) -> list[str]:
        """Return causes that would often be as good as a given one if it acted."""
        i = self.names.index(name)
        return [n for j, n in enumerate(self.names) if j != i and self.confused[i, j] > OFTEN]

    def _is_confused(self, i: int, j: int) -> bool:
        seen = self.visible[[i, j]] > VISIBLE
        return bool(
            (seen[0] and seen[1]) and (self.confused[i, j] > OFTEN or self.confused[j, i] > OFTEN)
        )


NOT_KNOWN = Confusability((), np.zeros(0), np.zeros((0, 0)))


def confusability(
    linear: Linear, causes: tuple[Cause, ...], generator: np.random.Generator
) -> Confusability:
    """Simulate the readings under each cause at its typical size and judge them.

    Parameters
    ----------
    linear : Linear
        The base model, linearised.
    causes : tuple of Cause
        What may act; each at the size that its catalogue entry gives as typical.
    generator : Generator
        For the noise.
    """
    if not causes:
        return NOT_KNOWN
    columns = [sensitivities(linear, cause) for cause in causes]
    changes = np.stack([_typical_effect(linear, cause) for cause in causes])
    noise = generator.standard_normal((DRAWS, changes.shape[1]))
    confused = np.zeros((len(causes), len(causes)))
    for i, change in enumerate(changes):
        z = change + noise
        factors = np.stack(
            [log_bayes_factor(z, _wide(c, d)) for c, d in zip(columns, changes, strict=True)]
        )
        confused[i] = np.mean(factors > factors[i] - CLEAR, axis=1)
    return Confusability(
        tuple(cause.name for cause in causes), np.linalg.norm(changes, axis=1), confused
    )


def _typical_effect(linear: Linear, cause: Cause) -> Floats:
    effect: Floats = np.nan_to_num(effects(linear, cause, typical_size(cause)[None])[0])
    return effect


def _wide(columns: Floats, change: Floats) -> Floats:
    """Return directions of a cause: for small sizes, and for its typical one."""
    return np.column_stack([columns, change])


EFFECT_DRAWS = 2000
LEAST = -1e3  # floor of the log Bayes factors shown
FULL_FIT, SCREENING = "full fit", "screening"  # how a cause was judged


def candidates(
    search: Search,
    supported: list[Support],
    held_out: Mapping[Names, HeldOut],
    generator: np.random.Generator,
) -> list[Candidate]:
    """Return every cause that was tried, the most probable first."""
    shares = probabilities(search)
    named = {one.cause: one for one in supported}
    found = []
    for cause in search.causes:
        if cause.name in named:
            found.append(_named(search, named, cause, shares[cause.name], generator))
        else:
            found.append(_other(search, cause, shares[cause.name], held_out, generator))
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


def _named(
    search: Search,
    named: Mapping[str, Support],
    cause: Cause,
    probability: float,
    generator: np.random.Generator,
) -> Candidate:
    one, chosen = named[cause.name], frozenset(named)
    return Candidate(
        cause=cause.name,
        log_bayes_factor=one.log_bayes_factor,
        probability=probability,
        explained_fraction=fraction_explained(search.step(search.base.names), search.step(chosen)),
        elpd_diff=one.elpd_diff,
        elpd_diff_se=one.elpd_diff_se,
        effect=effect_sizes(search.trials[chosen], cause, generator),
        log_bayes_factor_error=_error(search, chosen, chosen - {cause.name}),
        naming_p_value=one.chance,
        mechanism=cause.mechanism,
        judged_by=FULL_FIT,
    )


def _other(
    search: Search,
    cause: Cause,
    probability: float,
    held_out: Mapping[Names, HeldOut],
    generator: np.random.Generator,
) -> Candidate:
    alone, base = frozenset({cause.name}), search.base.names
    if alone not in search.trials:
        factor = search.step(base).screened[cause.name].log_bayes_factor
        return Candidate(
            cause=cause.name,
            log_bayes_factor=max(factor, LEAST),
            probability=probability,
            naming_p_value=search.step(base).chance_of(factor),
            mechanism=cause.mechanism,
            judged_by=SCREENING,
        )
    tested = alone in held_out and base in held_out
    gain, error = difference(held_out[alone], held_out[base]) if tested else (None, None)
    return Candidate(
        cause=cause.name,
        log_bayes_factor=max(search.factor(alone), LEAST),
        probability=probability,
        explained_fraction=fraction_explained(search.step(base), search.step(alone)),
        elpd_diff=gain,
        elpd_diff_se=error,
        effect=effect_sizes(search.trials[alone], cause, generator),
        log_bayes_factor_error=_error(search, alone, base),
        naming_p_value=search.step(base).chance_of(search.factor(alone)),
        mechanism=cause.mechanism,
        judged_by=FULL_FIT,
    )


def _error(search: Search, one: Names, other: Names) -> float:
    """Return the Monte Carlo standard error of the log Bayes factor of two sets [nats]."""
    return float(np.hypot(search.trials[one].posterior.error, search.trials[other].posterior.error))
