r"""Which further experiment would best tell apart the causes still in question.

Under each cause the readings of a new experiment follow a law that the data so far fix: draws θ of
its posterior give expected readings f(θ) and a covariance V(θ) of errors and of specimens, so that
about

.. math:: y \mid c \sim N(\bar f, \mathrm{cov} f(\theta) + \bar V)

If a is the truth, the experiment is expected to add E[ln p_a(y) − ln p_b(y)] to the log Bayes
factor of a against b. It is averaged over readings simulated through the full equations.

References
----------
Kullback and Leibler (1951), Ann. Math. Stat. 22:79, doi:10.1214/aoms/1177729694; Box and Hill
(1967), Technometrics 9:57, doi:10.1080/00401706.1967.10490441, for designs that tell models apart.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.experiments_hypotheses import Hypothesis, hypotheses_of
from bayesdeg.criticism.experiments_law import Separation, foretell, separation
from bayesdeg.criticism.experiments_measurement import Measurement, with_noise
from bayesdeg.criticism.side_by_side import apply
from bayesdeg.criticism.trials import Trial
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

LEAST = 1.0
"""Expected log Bayes factor below which an experiment does not tell two causes apart."""
MOST = 8


@dataclass(frozen=True)
class Experiment:
    """A further experiment.

    Parameters
    ----------
    kind : str
        Experiments of one kind differ in degradation rate or mount alone; the best is kept.
    design : str
        What to do, in plain words with numbers.
    specimens : int
        What it costs.
    measurement : Measurement
        What would be read.
    """

    kind: str
    design: str
    specimens: int
    measurement: Measurement

    @property
    def readings(self) -> int:
        """Number of readings."""
        return self.measurement.copies * int(self.measurement.read.sum())


@dataclass(frozen=True)
class Pair:
    """What an experiment is expected to add to the log Bayes factor between two causes.

    Parameters
    ----------
    causes : (str, str)
        Names of the hypotheses.
    expected : float
        The smaller of the expectations with either as the truth [nats]: at least that much is to
        be expected.
    error : float
        Monte Carlo standard error of it.
    """

    causes: tuple[str, str]
    expected: float
    error: float


@dataclass(frozen=True)
class Ranked:
    """An experiment and what it would tell.

    Parameters
    ----------
    experiment : Experiment
        Which.
    pairs : tuple of Pair
        Every pair of hypotheses, the best told apart first.
    """

    experiment: Experiment
    pairs: tuple[Pair, ...]

    @property
    def told_apart(self) -> int:
        """Number of pairs with an expected log Bayes factor of at least `LEAST`."""
        return sum(pair.expected >= LEAST for pair in self.pairs)

    @property
    def decisive(self) -> Pair:
        """The worst of the pairs that it tells apart; the best pair if it tells none apart."""
        return self.pairs[max(self.told_apart, 1) - 1]


def rank(
    trials: Sequence[Trial],
    experiments: Sequence[Experiment],
    generator: np.random.Generator,
    *,
    untested: Sequence[Cause] = (),
    executor: Executor | None = None,
) -> tuple[Ranked, ...]:
    """Rank experiments by what they are expected to tell of the models in question.

    With more than two models, experiments that tell more pairs apart come first, then those with
    the larger expected log Bayes factor for the worst of these pairs; ties (0.1) go by cost.

    Parameters
    ----------
    trials : sequence of Trial
        Fitted models between which the data so far do not decide, as a cause and its rivals.
    experiments : sequence of Experiment
        Candidates, see `bayesdeg.criticism.experiments_candidates.candidate_experiments`.
    generator : Generator
        Draws everything.
    untested : sequence of Cause
        Causes that the data so far cannot reveal, where they are in question too.
    executor : Executor, optional
        Foretells experiments side by side.

    Returns
    -------
    tuple of Ranked
        The best of each kind; empty with fewer than two models. What the forward map has no answer
        for is not there.
    """
    if len(trials) + len(untested) < 2 or not trials:
        return ()
    return rank_hypotheses(
        hypotheses_of(trials, generator, untested=untested),
        experiments,
        generator,
        executor=executor,
    )


def rank_hypotheses(
    hypotheses: Sequence[Hypothesis],
    experiments: Sequence[Experiment],
    generator: np.random.Generator,
    *,
    executor: Executor | None = None,
) -> tuple[Ranked, ...]:
    """Rank experiments by what they are expected to tell of hypotheses, as `rank` does."""
    best: dict[str, Ranked] = {}
    children = generator.spawn(len(experiments))
    jobs = [(e.measurement, child) for e, child in zip(experiments, children, strict=True)]
    found = apply(partial(_compared, hypotheses), jobs, executor)
    for experiment, pairs in zip(experiments, found, strict=True):
        if not pairs:
            continue
        one = Ranked(experiment, pairs)
        known = best.get(experiment.kind)
        if known is None or _order(one) < _order(known):
            best[experiment.kind] = one
    return tuple(sorted(best.values(), key=_order))


def _compared(
    hypotheses: Sequence[Hypothesis], job: tuple[Measurement, np.random.Generator]
) -> tuple[Pair, ...]:
    return compare(hypotheses, *job)


def compare(
    hypotheses: Sequence[Hypothesis], measurement: Measurement, generator: np.random.Generator
) -> tuple[Pair, ...]:
    """Return what a measurement is expected to tell of every pair, the best told apart first.

    Readings are left out at which any hypothesis refuses more than a tenth of its draws; nothing is
    returned where that leaves none, or less than half of the draws of a hypothesis.
    """
    foretold = foretell([_named(h, generator) for h in hypotheses], measurement, generator)
    pairs = [
        _pair((a.name, b.name), separation(first, second))
        for (a, first), (b, second) in combinations(zip(hypotheses, foretold, strict=False), 2)
    ]
    return tuple(sorted(pairs, key=lambda pair: -pair.expected))


def next_experiments_document(
    ranked: Sequence[Ranked], *, most: int = MOST
) -> list[dict[str, object]]:
    """Return ``next_experiments`` of ``verdict.json``: the best that tell something apart.

    Beside what the contract asks for, each has the Monte Carlo error, the cost in specimens and
    readings, and every pair of causes in question.

    Examples
    --------
    >>> next_experiments_document(())
    []
    """
    useful = [entry for entry in ranked if entry.told_apart]
    return [_document(entry) for entry in useful[:most]]


def _document(entry: Ranked) -> dict[str, object]:
    experiment, pair = entry.experiment, entry.decisive
    return {
        "design": experiment.design,
        "separates": list(pair.causes),
        "expected_log_bayes_factor": round(pair.expected, 2),
        "monte_carlo_error": round(pair.error, 2),
        "specimens": experiment.specimens,
        "readings": experiment.readings,
        "per_specimen": round(pair.expected / experiment.specimens, 2),
        "pairs": [
            {"causes": list(p.causes), "expected_log_bayes_factor": round(p.expected, 2)}
            for p in entry.pairs
        ],
    }


def _order(entry: Ranked) -> tuple[float, ...]:
    size = round(entry.decisive.expected, 1)
    return -entry.told_apart, -size, entry.experiment.specimens, entry.experiment.readings


def _pair(names: tuple[str, str], both: tuple[Separation, Separation]) -> Pair:
    smaller = min(both, key=lambda one: one.expected)
    return Pair(names, smaller.expected, smaller.error)


def _named(
    hypothesis: Hypothesis, generator: np.random.Generator
) -> tuple[Model, dict[str, Floats]]:
    values = hypothesis.model.table.named(hypothesis.draws)
    return hypothesis.model, with_noise(values, generator)
