"""Full fits of a model with a set of causes: mode, evidence, linear model."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.level_scatter import within_levels
from bayesdeg.criticism.fit.linear import (
    Linear,
    columns_of,
    effects,
    linearise,
    rest_law,
    with_neutral,
    with_prior_moments,
)
from bayesdeg.inference.density import bounds
from bayesdeg.inference.importance import about_mode, improved, refitted
from bayesdeg.inference.laplace import Evidence, approximate, weighted
from bayesdeg.inference.model import JointModel

Floats = NDArray[np.float64]

STRONG = (
    5.0  # size of an effect, in standard deviations, above which the mode is sought from two sides
)
CLIMBS, HIGHER = 2, 1.0  # more, where draws are higher than the mode by so much
BENT = 2.5  # standard deviations beyond which a parameter has adapted; heavy tails make them wide
DRAWS = 3000  # draws of the estimate from the prior
WANTED = 80.0  # effective draws
WANTED_OF_RUPTURES = 300.0
"""The same for a model with a cause of rupture: its posterior is curved, and a law about its mode
with some 80 effective draws missed 3 nats of evidence in a planted study."""
MANY = 4000  # draws of one parameter
SCATTERED = 64
"""Tried sizes of a cause of rupture, the best of which is a further start: four values of each of
three parameters, in the time of two or three steps of a mode search."""
SETTLING, DECIDING = 4_000, 16_000
"""Draws from a distribution fitted to those of a trial: for comparing evidence with that of a
rival, and near a threshold of naming or of held-out gains. In five models of three studies the
first gave 116 to 538 effective draws, 426 in the median, with which held-out gains varied by 1.6
between seeds; in two, the second gave 844 and 1,721."""


@dataclass(frozen=True)
class CandidateFit:
    """A model with a set of causes, fitted.

    Parameters
    ----------
    subject : JointModel
        With the causes active.
    mode : array, shape (n_parameters,)
        The mode within the bounds of priors.
    log_evidence : float
        Marginal likelihood.
    posterior : Evidence
        Weighted draws.
    uncertain : array, shape (n_parameters, n_parameters)
        Covariance of the parameters given all but the readings.
    centre : array, shape (n_parameters,)
        Their mean given all but the readings.
    is_near_mode : bool
        Whether the draws are those about the mode, not of a law fitted to what lies far from it.
    settled_by : int
        Draws from which the evidence was estimated again, see `settled`; 0 if it was not.
    """

    subject: JointModel
    mode: Floats
    log_evidence: float
    posterior: Evidence
    uncertain: Floats
    centre: Floats
    is_near_mode: bool = True
    settled_by: int = 0

    @property
    def names(self) -> frozenset[str]:
        """Names of the active causes."""
        return frozenset(cause.name for cause in self.subject.causes)

    def cause(self, name: str) -> Cause:
        """Return one of the active causes."""
        return next(cause for cause in self.subject.causes if cause.name == name)

    @cached_property
    def linear(self) -> Linear:
        """The model linearised at its mode, without scatter shared by whole levels.

        See `bayesdeg.criticism.fit.level_scatter`.
        """
        plain = linearise(self.subject, self.mode, uncertain=self.uncertain)
        return within_levels(plain, self.uncertain, self.centre)

    def unbent(self) -> Linear | None:
        """Return the model linearised where no parameter is far from its value by all else.

        A parameter with a heavy-tailed law adapts to a misfit of the readings: it absorbs the
        effect of a cause, which then seems absent. None if no parameter has, or the model cannot
        be evaluated there. Active causes keep their sizes from the readings.
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

    def named_draws(
        self, name: str, generator: np.random.Generator, *, count: int = MANY
    ) -> Floats:
        """Draw one parameter, in its unit, (count,)."""
        return self.subject.table.named(self.draws(generator, count))[name]


def base_trial(subject: JointModel, mode: Floats, posterior: Evidence) -> CandidateFit:
    """Return the trial of a model that is already fitted."""
    centre, uncertain = rest_law(subject, mode)
    return CandidateFit(subject, mode, posterior.log_evidence, posterior, uncertain, centre)


def try_causes(
    parent: CandidateFit, cause: Cause, size: Floats, generator: np.random.Generator
) -> CandidateFit:
    """Fit a model extended by one more cause: mode and importance sample.

    `size` (k,) is a guess of its parameters on the unconstrained scale.
    """
    subject = parent.subject.extended(cause)
    starts = _starts(parent, subject, cause, size)
    if cause.is_of_rupture_alone:
        # Rupture is strongly nonlinear in its causes: the guess may lead to a lower mode. One
        # without scatter of flaws was 17 nats below that with some.
        known = np.tile(parent.mode, (SCATTERED, 1))
        points = with_sizes(parent.subject, cause, known, generator)
        densities = np.nan_to_num(subject.log_prob(points), nan=-np.inf)
        best: Floats = points[int(np.argmax(densities))]
        starts.append(best)
    climbs = [approximate(subject, generator, start=start) for start in starts]
    laplace = max(climbs, key=lambda climbed: climbed.log_density)
    posterior = about_mode(subject, laplace, generator, enough=WANTED)
    for _ in range(CLIMBS):
        top = posterior.top
        if top is None or top[1] < laplace.log_density + HIGHER:
            break
        laplace = approximate(subject, generator, start=top[0])
        posterior = about_mode(subject, laplace, generator, enough=WANTED)
    centre, uncertain = with_prior_moments(parent.centre, parent.uncertain, parent.subject, subject)
    return CandidateFit(subject, laplace.mode, posterior.log_evidence, posterior, uncertain, centre)


def _starts(parent: CandidateFit, subject: JointModel, cause: Cause, size: Floats) -> list[Floats]:
    """Return the best start: no effect; the guessed size; that with other parameters readjusted.

    The last is the most probable δ of the parent's linear model for readings less the effect. For a
    strong effect it is always a further start, since the base model may be in a region from which
    the search cannot climb. So is the better of the last two if no effect is best.
    """
    neutral = with_neutral(parent.mode, parent.subject, subject)
    guess = neutral.copy()
    guess[columns_of(subject, cause)] = size
    linear = parent.linear
    effect = np.nan_to_num(effects(linear, cause, size[None])[0])
    back = linear.whitening.adjoint(effect)
    known = {name: i for i, name in enumerate(parent.subject.table.names)}
    shift = -parent.uncertain @ (linear.jacobian.T @ back)
    room = guess.copy()
    for i, name in enumerate(subject.table.names):
        if name in known:
            room[i] += shift[known[name]]
    low, high = bounds(subject.table)
    points = np.clip(np.stack([neutral, guess, room]), low, high)
    densities = subject.log_prob(points)
    best = int(np.argmax(densities))
    with_effect = 1 + int(np.argmax(densities[1:]))
    starts = [points[best]]
    if best == 0:  # no effect may be a separate mode, from which no climb escapes
        starts += [points[with_effect]] if np.isfinite(densities[with_effect]) else []
    elif best == 1 and np.linalg.norm(effect) > STRONG and np.isfinite(densities[2]):
        starts.append(points[2])
    return starts


def wanted(subject: JointModel) -> float:
    """Return the number of effective draws required for a close comparison of evidence."""
    of_rupture = any(cause.is_of_rupture_alone for cause in subject.causes)
    return WANTED_OF_RUPTURES if of_rupture else WANTED


def firm(trial: CandidateFit, generator: np.random.Generator) -> CandidateFit:
    """Return a trial with enough effective draws for its evidence; itself if it has them.

    Too few effective draws about a mode indicate posterior mass far from it. A wider distribution
    fitted to them finds it.
    """
    enough = wanted(trial.subject)
    if trial.posterior.effective >= enough or not trial.posterior.effective > 0.0:
        return trial
    found = improved(trial.subject, trial.posterior, generator, draws=MANY, enough=enough)
    if found.effective <= trial.posterior.effective:
        return trial
    return replace(trial, posterior=found, log_evidence=found.log_evidence, is_near_mode=False)


def settled(
    trial: CandidateFit, generator: np.random.Generator, draws: int = SETTLING
) -> CandidateFit:
    """Return a trial with its evidence estimated again from a distribution fitted to the draws.

    A result close to a threshold should not depend on the hundred effective draws of a first fit.
    """
    found = sharpened(trial.subject, trial.posterior, generator, draws)
    return replace(trial, posterior=found, log_evidence=found.log_evidence, settled_by=draws)


def sharpened(
    subject: JointModel, known: Evidence, generator: np.random.Generator, draws: int = SETTLING
) -> Evidence:
    """Return the better of a sample and one from a law fitted to it, by effective draws."""
    found = refitted(subject, known, generator, draws=draws)
    return found if found.effective > known.effective else known


def from_prior(
    parent: CandidateFit, cause: Cause, generator: np.random.Generator, draws: int = DRAWS
) -> Evidence:
    """Average the likelihood ratio over a model's posterior and the prior of one more cause.

    Its log evidence is the log Bayes factor against the parent.
    """
    known = parent.draws(generator, draws)
    points = with_sizes(parent.subject, cause, known, generator)
    subject = parent.subject.extended(cause)
    own = subject.table.log_prior(points) - parent.subject.table.log_prior(known)
    return weighted(points, subject.log_prob(points) - parent.subject.log_prob(known) - own)


def with_sizes(
    subject: JointModel, cause: Cause, known: Floats, generator: np.random.Generator
) -> Floats:
    """Extend draws of a model by prior sizes of one more cause.

    Draws (n, n_parameters) of the posterior without the cause become vectors of the extended model.
    """
    base = dict(zip(subject.table.names, known.T, strict=True))
    prior = {
        cause.qualified(p.name): p.law.to_unconstrained(p.law.sample(generator, len(known)))
        for p in cause.parameters
    }
    names = subject.extended(cause).table.names
    return np.stack([(base | prior)[name] for name in names], axis=1)
