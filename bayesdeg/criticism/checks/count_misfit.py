r"""Probability of ruptures, and of their counts, under a calibrated model.

With :math:`p_l(\theta)` the probability that an actuator of level l bursts, its own stiffness and
strength included, the probability of the counts is the average of the binomial law over the
posterior, the levels together, since they share its draws:

.. math::

    P(k) = \frac1n \sum_i \prod_l \binom{t_l}{k_l} p_l(\theta_i)^{k_l} (1 - p_l(\theta_i))^{t_l-k_l}

which is the beta-binomial law if p has a beta distribution. Of many counts at many levels even the
most probable is improbable, so they are judged by the probability of counts no more probable.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.findings import CountedLevel, RuptureMisfit
from bayesdeg.inference.model import JointModel, replicate
from bayesdeg.observations.counts import (
    Chances,
    CountedTests,
    RuptureCounts,
    chances_of,
    counted_by_level,
    log_count,
)
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import Rupture
from bayesdeg.observations.specimens import OF_ACTUATORS, has_elongation

Floats = NDArray[np.float64]

COUNT_LEVEL = 0.01
"""p-value below which counts contradict a model: one in a hundred of the studies with counts."""
SETS = 999
"""Simulated counts, so that p-values down to a tenth of that level are resolved."""
FEWEST = 100
"""Least number of usable draws, and of sets, for reaching that level reliably."""
WIDTH = (0.05, 0.95)
PUBLISHED, OWN = "summary.csv", "actuator.csv"
"""Files with rupture counts."""
EQUAL = 1e-9
"""Tolerance of a log probability: sets as probable as the counts, up to rounding."""


@dataclass(frozen=True)
class CountMisfit:
    """Probability of rupture counts under a model.

    Parameters
    ----------
    source : str
        The file that gives them.
    levels : tuple of CountedLevel
        One a degradation rate.
    log_probability : float
        ln of the probability of exactly these counts, levels together.
    p_value : float
        Probability of counts that are no more probable, (1 + #)/(1 + n) from simulated ones; nan
        where fewer than `FEWEST` draws have an answer.
    draws : int
        Posterior draws with an answer: no probability below one in so many is known.
    replicates : int
        Simulated counts behind the p-value.
    """

    source: str
    levels: tuple[CountedLevel, ...]
    log_probability: float
    p_value: float
    draws: int
    replicates: int

    @property
    def contradicts(self) -> bool:
        """Whether the counts contradict the model."""
        return self.p_value < COUNT_LEVEL

    @property
    def burst(self) -> float:
        """Actuators that burst."""
        return sum(one.ruptured for one in self.levels)

    @property
    def tested(self) -> float:
        """Actuators that were tested."""
        return sum(one.tested for one in self.levels)

    @property
    def expected(self) -> float:
        """Number that the model expects to burst."""
        return sum(one.tested * one.probability for one in self.levels)


def count_misfit(
    model: JointModel,
    counts: RuptureCounts,
    vectors: Floats,
    generator: np.random.Generator,
    source: str,
) -> CountMisfit:
    """Compare counts of ruptures with those that a model expects.

    Vectors (n, n_parameters) are posterior draws; `source` says where the counts are from.
    """
    chances = answered(chances_at(model, counts, vectors))
    return judged_counts(counts.tests, chances, generator, source)


def chances_at(model: JointModel, counts: RuptureCounts, vectors: Floats) -> Chances:
    """Return the log probabilities that actuators of the levels burst or not, (n, n_levels)."""
    with np.errstate(all="ignore"):
        return chances_of(model.tests(model.table.named(vectors)), counts.tests)


def answered(chances: Chances) -> Chances:
    """Return the draws within the forward map's range at all levels."""
    known = np.all(np.isfinite(chances.whole) | np.isfinite(chances.burst), axis=1)
    return Chances(chances.burst[known], chances.whole[known])


def judged_counts(
    tests: CountedTests, chances: Chances, generator: np.random.Generator, source: str
) -> CountMisfit:
    """Judge counts by draws of the probability that an actuator of each level bursts.

    Examples
    --------
    Two of three, where a half of the actuators bursts: as probable as one, none is less probable.

    >>> half = np.log(np.full((100, 1), 0.5))
    >>> one = np.ones((1, 1))
    >>> tests = CountedTests(("at 0 %",), 0 * one, 0 * one, 240 * one[0], 3 * one[0], 2 * one[0])
    >>> found = judged_counts(tests, Chances(half, half), np.random.default_rng(0), "summary.csv")
    >>> round(float(np.exp(found.log_probability)), 3), found.p_value
    (0.375, 1.0)
    """
    count = len(chances.burst)
    if count < FEWEST:
        return CountMisfit(source, (), float("nan"), float("nan"), count, 0)
    law = CountLaw.of(tests, chances)
    observed = law.log_probability(tests.ruptured[None])[0]
    simulated = law.log_probability(law.simulated(generator, SETS))
    p_value = float(chance_of(-observed - EQUAL, -simulated, fewest=FEWEST))
    return CountMisfit(source, law.levels(), float(observed), p_value, count, SETS)


class CountLaw(NamedTuple):
    """The law of counts under a model: ln weight and rupture probabilities of each draw."""

    tests: CountedTests
    chances: Chances
    log_weights: Floats

    @classmethod
    def of(cls, tests: CountedTests, chances: Chances) -> "CountLaw":
        """Return the law for draws of equal weight."""
        weights = np.zeros(len(chances.burst))
        return cls(tests, chances, weights - logsumexp(weights))

    def reweighted(self, log_weights: Floats) -> "CountLaw":
        """Return the law with different weights, not normalised."""
        return self._replace(log_weights=log_weights - logsumexp(log_weights))

    def draw_by_draw(self, ruptured: Floats) -> Floats:
        """Return the log probability of counts (n_levels,) under each draw, (n,)."""
        found: Floats = np.sum(log_count(ruptured, self.tests.tested, self.chances), axis=1)
        return found

    def log_probability(self, counts: Floats) -> Floats:
        """Return the log probability of sets of counts (m, n_levels), levels together, (m,)."""
        different, place = np.unique(counts.astype(int), axis=0, return_inverse=True)
        total = self.log_weights
        for level, tested in enumerate(self.tests.tested):
            every = np.arange(tested + 1.0)
            here = Chances(*(part[:, level, None] for part in self.chances))
            total = total + log_count(every, np.asarray(tested), here)[:, different[:, level]].T
        found: Floats = logsumexp(total, axis=1)[place]
        return found

    def simulated(self, generator: np.random.Generator, sets: int) -> Floats:
        """Draw sets of counts, (sets, n_levels)."""
        rows = generator.choice(len(self.log_weights), size=sets, p=np.exp(self.log_weights))
        chance = np.clip(np.exp(self.chances.burst[rows]), 0.0, 1.0)
        drawn: Floats = generator.binomial(self.tests.tested.astype(int), chance).astype(np.float64)
        return drawn

    def levels(self) -> tuple[CountedLevel, ...]:
        """Return the expectation level by level."""
        weights, tests = np.exp(self.log_weights), self.tests
        burst = np.exp(self.chances.burst)
        low, high = np.quantile(burst, WIDTH, axis=0, weights=weights, method="inverted_cdf")
        each = log_count(tests.ruptured, tests.tested, self.chances)
        chance = np.exp(logsumexp(each + self.log_weights[:, None], axis=0))
        return tuple(
            CountedLevel(
                degradation_pct=float(tests.degradation[k, 0]),
                pressure_kPa=float(tests.pressure[k]),
                tested=int(tests.tested[k]),
                ruptured=int(tests.ruptured[k]),
                probability=float(weights @ burst[:, k]),
                probability_q05=float(low[k]),
                probability_q95=float(high[k]),
                count_probability=float(chance[k]),
            )
            for k in range(len(tests.specimens))
        )


def can_be_counted(model: JointModel) -> bool:
    """Return whether a model predicts ruptures: it has actuators and an elongation limit."""
    return not OF_ACTUATORS.isdisjoint(model.table.names) and has_elongation(model.base)


def own_counts(model: JointModel) -> RuptureCounts | None:
    """Return the number of a study's own actuators that burst, by level; None without actuators."""
    found = (RuptureCounts(counted_by_level(one.tests)) for one in model.of_kind(Curvature))
    return next(found, None)


FEWEST_REPLICATES = 19
"""Fewest simulated data sets with which a p-value can reach 0.05, for judging ruptures."""


def rupture_misfit(
    model: JointModel, vectors: Floats, generator: np.random.Generator
) -> RuptureMisfit | None:
    """Compare ruptures with those of data simulated from posterior draws.

    The discrepancy is −2 Σ ln P of the specimens' survivals and ruptures, data and simulated data
    each at the parameters of the same draw.

    Draws are (k, n_parameters). None without actuators or a limit of elongation.

    References
    ----------
    Gelman, Meng, Stern (1996), Statistica Sinica 6:733, for discrepancies that depend on
    parameters.
    """
    happened = _events(model)
    if happened is None:
        return None
    observed = _deviances(model, vectors)
    simulated, bursts = [], []
    for vector in vectors:
        again = replicate(model, model.table.named(vector[None]), generator)
        simulated.append(_deviances(again, vector[None])[0])
        bursts.append(_events(again) or 0)
    known = np.isfinite(observed) & np.isfinite(simulated)
    count = int(np.sum(known))
    excess = np.array(simulated)[known] - observed[known]
    return RuptureMisfit(
        burst=happened,
        expected=float(np.mean(bursts)),
        deviance=float(np.mean(observed[known])) if count else float("nan"),
        p_value=float(chance_of(0.0, excess, fewest=FEWEST_REPLICATES)),
        known=count,
        drawn=len(vectors),
    )


def _deviances(model: JointModel, vectors: Floats) -> Floats:
    """Return −2 ln of the ruptures' probability, (k,), ignoring nan readings."""
    with np.errstate(all="ignore"):
        state = model.state(model.table.named(vectors))
        densities = [o.log_likelihood(state) for o in model.of_kind(Rupture)]
        return np.asarray(-2.0 * np.sum(np.concatenate(densities, axis=1), axis=1))


def _events(model: JointModel) -> int | None:
    """Return the number of specimens with an event; None if none is recorded."""
    return next((one.events for one in model.of_kind(Rupture)), None)
