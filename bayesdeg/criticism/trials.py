"""A set of causes joins the model, and everything is fitted again: mode, evidence, what is left."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.linear import Linear, linearise, rest_covariance, with_prior_variance
from bayesdeg.criticism.subject import Subject, columns_of, with_neutral
from bayesdeg.inference.importance import about_mode, improved
from bayesdeg.inference.laplace import Evidence, approximate, weighted

Floats = NDArray[np.float64]

LOOKED_AT = 2000  # draws
ROUND = 1000  # draws of a round of importance sampling
DRAWS = 3000  # of the estimate from the prior
ENOUGH, WANTED = 40.0, 80.0  # effective draws: fewer need a second estimate; where to stop


@dataclass(frozen=True)
class Trial:
    """A model with a set of causes, fitted.

    Parameters
    ----------
    subject : Subject
        With the causes active.
    mode : array, shape (n_parameters,)
        The mode, or where that is outside the bounds of a prior the most probable draw.
    log_evidence : float
        Marginal likelihood.
    posterior : Evidence
        Weighted draws.
    uncertain : array, shape (n_parameters, n_parameters)
        Covariance of the parameters given all but the readings.
    """

    subject: Subject
    mode: Floats
    log_evidence: float
    posterior: Evidence
    uncertain: Floats

    @property
    def names(self) -> frozenset[str]:
        """Names of the active causes."""
        return frozenset(cause.name for cause in self.subject.causes)

    @cached_property
    def linear(self) -> Linear:
        """The model linearised at its mode."""
        return linearise(self.subject, self.mode, uncertain=self.uncertain)

    def draws(self, generator: np.random.Generator, count: int) -> Floats:
        """Draw from the posterior, (count, n_parameters)."""
        return self.posterior.resample(generator, count)


def base_trial(subject: Subject, mode: Floats, posterior: Evidence) -> Trial:
    """Return the trial of a model that is fitted already."""
    top = most_probable(subject, mode, posterior)
    return Trial(subject, top, posterior.log_evidence, posterior, rest_covariance(subject, top))


def most_probable(subject: Subject, mode: Floats, posterior: Evidence) -> Floats:
    """Return the mode, or where it is outside the bounds of a prior the most probable draw."""
    known = posterior.draws[np.isfinite(posterior.log_weights)]
    points = np.vstack([mode, known[:: max(1, len(known) // LOOKED_AT)]])
    top: Floats = points[int(np.argmax(subject.log_prob(points)))]
    return top


def try_causes(parent: Trial, cause: Cause, size: Floats, generator: np.random.Generator) -> Trial:
    """Fit a model extended by one more cause.

    The evidence is an importance sample about the mode; where that has too few draws or is outside
    the prior, an average over the parent's posterior and the prior if that is larger.

    Parameters
    ----------
    parent : Trial
        Without the cause.
    cause : Cause
        What is added.
    size : array, shape (k,)
        Guess of its parameters on the unconstrained scale.
    generator : Generator
        Draws the proposals.
    """
    subject = parent.subject.extended(cause)
    start = with_neutral(parent.mode, parent.subject, subject)
    guess = start.copy()
    guess[columns_of(subject, cause)] = size
    both = np.stack([start, guess])
    densities = subject.log_prob(both)
    laplace = approximate(subject, generator, start=both[int(np.argmax(densities))])
    posterior = about_mode(subject, laplace, generator, enough=WANTED)
    outside = not np.isfinite(subject.log_prob(laplace.mode[None])[0])
    if posterior.effective < ENOUGH or outside:
        posterior = _other_way(parent, cause, posterior, generator)
    top = most_probable(subject, laplace.mode, posterior)
    uncertain = with_prior_variance(parent.uncertain, parent.subject, subject)
    return Trial(subject, top, posterior.log_evidence, posterior, uncertain)


def _other_way(
    parent: Trial, cause: Cause, posterior: Evidence, generator: np.random.Generator
) -> Evidence:
    """Sample a posterior from the parent's and the prior, where its own mode is of no use."""
    ratio = from_prior(parent, cause, generator)
    other = replace(ratio, log_evidence=parent.log_evidence + ratio.log_evidence)
    # what a sample does not reach is missing from its evidence
    best = max(posterior, other, key=lambda found: found.log_evidence)
    if best.effective >= WANTED:
        return best
    again = improved(parent.subject.extended(cause), best, generator, draws=ROUND, enough=WANTED)
    return again if again.effective > best.effective else best


def from_prior(
    parent: Trial, cause: Cause, generator: np.random.Generator, draws: int = DRAWS
) -> Evidence:
    """Average the likelihood ratio over a model's posterior and the prior of one more cause.

    Returns
    -------
    Evidence
        Its log evidence is the log Bayes factor against the parent.
    """
    subject = parent.subject.extended(cause)
    known = parent.draws(generator, draws)
    base = dict(zip(parent.subject.table.names, known.T, strict=True))
    prior = {
        cause.qualified(p.name): p.law.to_unconstrained(p.law.sample(generator, draws))
        for p in cause.parameters
    }
    points = np.stack([(base | prior)[name] for name in subject.table.names], axis=1)
    own = subject.table.log_prior(points) - parent.subject.table.log_prior(known)
    ratio = subject.log_prob(points) - parent.subject.log_prob(known) - own
    return weighted(points, ratio)
