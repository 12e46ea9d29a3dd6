"""Fitted models, and causes that could not be tested, as hypotheses with draws of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.model_readings import ModelReadings
from bayesdeg.criticism.trials import Trial
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

DRAWS = 600
NO_CAUSE = "no cause"


@dataclass(frozen=True)
class Hypothesis:
    """A model that may be true, and draws of its parameters.

    Parameters
    ----------
    name : str
        The cause or causes by which it differs from the others.
    model : Model
        With its causes active.
    draws : array, shape (n, n_parameters)
        On the sampler's scale.
    """

    name: str
    model: Model
    draws: Floats


def hypotheses_of(
    trials: Sequence[Trial],
    generator: np.random.Generator,
    *,
    untested: Sequence[Cause] = (),
    draws: int = DRAWS,
) -> tuple[Hypothesis, ...]:
    """Return fitted models as hypotheses, and with each untested cause added to the smallest.

    Parameters
    ----------
    trials : sequence of Trial
        Fitted models of one study; causes that all have in common are not in question.
    generator : Generator
        Draws from the posteriors and priors.
    untested : sequence of Cause
        Causes that the data so far cannot reveal: what is known of their sizes is the prior.
    draws : int
        Of each.
    """
    common = frozenset.intersection(*(trial.names for trial in trials))
    found = [
        Hypothesis(
            " and ".join(sorted(trial.names - common)) or NO_CAUSE,
            _model_of(trial),
            trial.draws(generator, draws),
        )
        for trial in trials
    ]
    smallest = min(trials, key=lambda trial: len(trial.names))
    return (*found, *(_untested(smallest, cause, generator, draws) for cause in untested))


def _untested(
    parent: Trial, cause: Cause, generator: np.random.Generator, draws: int
) -> Hypothesis:
    model = _model_of(parent).extended(cause)
    known = dict(zip(parent.subject.table.names, parent.draws(generator, draws).T, strict=True))
    for p in cause.parameters:
        known[cause.qualified(p.name)] = p.law.to_unconstrained(p.law.sample(generator, draws))
    vectors = np.stack([known[name] for name in model.table.names], axis=1)
    return Hypothesis(cause.name, model, vectors)


def _model_of(trial: Trial) -> Model:
    if not isinstance(trial.subject, ModelReadings):
        raise TypeError("experiments are known for models of studies only")
    return trial.subject.model
