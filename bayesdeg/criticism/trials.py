"""A set of causes joins the model, and everything is fitted again: mode, evidence, what is left."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.linear import (
    Linear,
    effects,
    linearise,
    rest_law,
    with_prior_moments,
)
from bayesdeg.criticism.subject import Subject, columns_of, with_neutral
from bayesdeg.inference.importance import about_mode, improved
from bayesdeg.inference.laplace import Evidence, Laplace, approximate, weighted

Floats = NDArray[np.float64]

LOOKED_AT = 2000  # draws
STRONG = 5.0  # size of an effect, in standard deviations, that is climbed to from two sides
CLIMBS, HIGHER = 2, 1.0  # more, where draws are higher than the mode by so much
BENT = 4.0  # standard deviations by which a parameter has given way
EDGE = 1e-4  # prior probability beyond a point that is put inside
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
    centre : array, shape (n_parameters,)
        Their mean given all but the readings.
    """

    subject: Subject
    mode: Floats
    log_evidence: float
    posterior: Evidence
    uncertain: Floats
    centre: Floats

    @property
    def names(self) -> frozenset[str]:
        """Names of the active causes."""
        return frozenset(cause.name for cause in self.subject.causes)

    @cached_property
    def linear(self) -> Linear:
        """The model linearised at its mode."""
        return linearise(self.subject, self.mode, uncertain=self.uncertain)

    def unbent(self) -> Linear | None:
        """Return the model linearised where no parameter is far from what all else says of it.

        A law with heavy tails gives way to a misfit of the readings: its parameter takes the effect
        of a cause up, which then seems to be none. None if no parameter has, or the model does not
        answer there. The size of an active cause is what the readings say it is.
        """
        sd = np.sqrt(np.diag(self.uncertain))
        bent = np.abs(self.mode - self.centre) > BENT * sd
        for cause in self.subject.causes:
            bent[columns_of(self.subject, cause)] = False
        if not bent.any():
            return None
        point = np.where(bent, self.centre, self.mode)
        found = linearise(self.subject, point, uncertain=self.uncertain, centre=self.centre)
        return found if found.is_known else None

    def draws(self, generator: np.random.Generator, count: int) -> Floats:
        """Draw from the posterior, (count, n_parameters)."""
        return self.posterior.resample(generator, count)


def base_trial(
    subject: Subject, mode: Floats, posterior: Evidence, *, covariance: Floats | None = None
) -> Trial:
    """Return the trial of a model that is fitted already, with the covariance at its mode."""
    top = most_probable(subject, mode, posterior, covariance=covariance)
    centre, uncertain = rest_law(subject, top)
    return Trial(subject, top, posterior.log_evidence, posterior, uncertain, centre)


def most_probable(
    subject: Subject, mode: Floats, posterior: Evidence, *, covariance: Floats | None = None
) -> Floats:
    """Return the mode, or where it is outside the bounds of a prior the best point within.

    That is the mode of the normal law at the mode given that what is outside is at its bound, or
    the most probable draw.
    """
    known = posterior.draws[np.isfinite(posterior.log_weights)]
    points = np.vstack([mode, known[:: max(1, len(known) // LOOKED_AT)]])
    if covariance is not None:
        points = np.vstack([_within_bounds(subject, mode, covariance), points])
    top: Floats = points[int(np.argmax(subject.log_prob(points)))]
    return top


def _within_bounds(subject: Subject, mode: Floats, covariance: Floats) -> Floats:
    """Return the conditional mode with parameters that are outside their priors put inside."""
    point = mode.copy()
    for i, parameter in enumerate(subject.table.parameters):
        law = parameter.law
        if not np.isfinite(float(law.log_density(law.from_unconstrained(mode[i])))):
            ends = law.to_unconstrained(law.quantile(np.array([EDGE, 1.0 - EDGE])))
            point[i] = float(ends[int(np.argmin(np.abs(ends - mode[i])))])
    moved = point != mode
    if not moved.any() or not np.all(np.isfinite(point)):
        return mode
    inner = np.linalg.solve(covariance[np.ix_(moved, moved)], (point - mode)[moved])
    point[~moved] += covariance[np.ix_(~moved, moved)] @ inner
    return point


def try_causes(parent: Trial, cause: Cause, size: Floats, generator: np.random.Generator) -> Trial:
    """Fit a model extended by one more cause.

    The evidence is an importance sample about the mode; where that has too few draws or is outside
    the prior, an average over the parent's posterior and the prior if that is larger, and a sample
    about the mode to which the best of those draws leads if that is larger still.

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
    starts = _starts(parent, subject, cause, size)
    climbs = [approximate(subject, generator, start=start) for start in starts]
    laplace = max(climbs, key=lambda climbed: climbed.log_density)
    posterior = about_mode(subject, laplace, generator, enough=WANTED)
    for _ in range(CLIMBS):
        top = most_probable(subject, laplace.mode, posterior)
        if subject.log_prob(top[None])[0] < laplace.log_density + HIGHER:
            break
        laplace = approximate(subject, generator, start=top)
        posterior = about_mode(subject, laplace, generator, enough=WANTED)
    outside = not np.isfinite(subject.log_prob(laplace.mode[None])[0])
    if posterior.effective < ENOUGH or outside:
        posterior = _other_way(parent, cause, posterior, generator)
        laplace, posterior = _from_above(subject, laplace, posterior, generator)
    top = most_probable(subject, laplace.mode, posterior, covariance=laplace.covariance)
    centre, uncertain = with_prior_moments(parent.centre, parent.uncertain, parent.subject, subject)
    return Trial(subject, top, posterior.log_evidence, posterior, uncertain, centre)


def _starts(parent: Trial, subject: Subject, cause: Cause, size: Floats) -> list[Floats]:
    """Return the best of: no effect; the guessed size; that with all else moved to make room.

    The last is the most probable δ of the parent's linear model for readings less the effect. Where
    the effect is strong it is a start of its own: the base model may have bent itself into a corner
    from which there is no way up. So is the better of the last two where no effect is best.
    """
    neutral = with_neutral(parent.mode, parent.subject, subject)
    guess = neutral.copy()
    guess[columns_of(subject, cause)] = size
    linear = parent.linear
    effect = np.nan_to_num(effects(linear, cause, size[None])[0])
    back = solve_triangular(linear.factor, effect, lower=True, trans="T")
    known = {name: i for i, name in enumerate(parent.subject.table.names)}
    shift = -parent.uncertain @ (linear.jacobian.T @ back)
    room = guess.copy()
    for i, name in enumerate(subject.table.names):
        if name in known:
            room[i] += shift[known[name]]
    points = np.stack([neutral, guess, room])
    densities = subject.log_prob(points)
    best = int(np.argmax(densities))
    with_effect = 1 + int(np.argmax(densities[1:]))
    if best == 0:  # no effect may be a mode of its own, from which no climb gets away
        return [neutral, points[with_effect]] if np.isfinite(densities[with_effect]) else [neutral]
    apart = np.linalg.norm(effect) > STRONG and np.isfinite(densities[2]) and best != 2
    return [points[best], room] if apart else [points[best]]


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


def _from_above(
    subject: Subject, laplace: Laplace, posterior: Evidence, generator: np.random.Generator
) -> tuple[Laplace, Evidence]:
    """Climb from the best draw, and sample about where that leads if it is higher.

    A climb that began where the parent is may have ended at once, between walls: where the base
    model was driven to the edge of what the forward map answers, or where an effect of no size is
    a mode of its own.
    """
    for _ in range(CLIMBS):
        climbed = approximate(subject, generator, start=_best_draw(subject, posterior))
        if climbed.log_density < laplace.log_density + HIGHER:
            break
        laplace = climbed
        found = about_mode(subject, laplace, generator, enough=WANTED)
        if found.log_evidence > posterior.log_evidence:
            posterior = found
    if posterior.effective < ENOUGH:
        more = improved(subject, posterior, generator, draws=DRAWS, enough=WANTED)
        posterior = more if more.effective > posterior.effective else posterior
    return laplace, posterior


def _best_draw(subject: Subject, posterior: Evidence) -> Floats:
    """Return the most probable of the draws that weigh most."""
    points = posterior.draws[np.argsort(-posterior.log_weights)[:LOOKED_AT]]
    best: Floats = points[int(np.argmax(subject.log_prob(points)))]
    return best


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
