"""Mode and curvature of a posterior: screening, starting points, evidence."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from bayesdeg.inference.density import Density, guesses
from bayesdeg.inference.mode import bounded, climb

Floats = NDArray[np.float64]


FEWEST_EFFECTIVE = 30.0  # an importance sample of fewer effective draws is not used
DEGREES_OF_FREEDOM = 6.0  # tails of the proposal are heavier than those of the posterior


@dataclass(frozen=True)
class Laplace:
    """A posterior's mode and the normal law that touches it there.

    Parameters
    ----------
    mode : array, shape (n_parameters,)
        On the unconstrained scale, bounds of truncated priors left out.
    covariance : array, shape (n_parameters, n_parameters)
        Inverse of the negative Hessian.
    log_density : float
        Log posterior density at the mode, not normalised.
    """

    mode: Floats
    covariance: Floats
    log_density: float


@dataclass(frozen=True)
class Evidence:
    """A marginal likelihood by importance sampling from the Laplace approximation.

    Parameters
    ----------
    log_evidence, error : float
        Estimate and its standard error.
    draws : array, shape (n, n_parameters)
        Proposals.
    log_weights : array, shape (n,)
        Their log importance weights.
    effective : float
        Effective number of draws.
    """

    log_evidence: float
    error: float
    draws: Floats
    log_weights: Floats
    effective: float

    def resample(self, generator: np.random.Generator, count: int) -> Floats:
        """Draw from the posterior, with replacement, shape (count, n_parameters)."""
        weights = np.exp(self.log_weights - logsumexp(self.log_weights))
        return self.draws[generator.choice(len(weights), count, p=weights)]


def approximate(
    density: Density, generator: np.random.Generator, *, start: Floats | None = None
) -> Laplace:
    """Return the Laplace approximation of a posterior.

    Parameters
    ----------
    density : Density
        What to approximate: a `Model`, a `CustomDensity`, or what offers the same.
    generator : Generator
        Draws starting points from the prior.
    start : array, shape (n_parameters,), optional
        A point near the mode; by default the best of 400 draws from the prior.
    """
    if start is None:
        trials = guesses(density.table, generator, 400)
        start = trials[int(np.argmax(density.log_prob(trials)))]
    mode, covariance = climb(density, start, generator)
    return Laplace(mode, covariance, float(bounded(density, mode[None])[0]))


def evidence(
    density: Density, laplace: Laplace, generator: np.random.Generator, *, draws: int = 3000
) -> Evidence:
    """Estimate the marginal likelihood, Z = E_q[p(θ, y)/q(θ)] with q a Student law.

    Returns
    -------
    Evidence
        With −inf where no draw is possible, as for an effect of the wrong sign.
    """
    size = len(laplace.mode)
    factor = np.linalg.cholesky(laplace.covariance)
    normals = generator.standard_normal((draws, size))
    mixing = generator.chisquare(DEGREES_OF_FREEDOM, draws) / DEGREES_OF_FREEDOM
    points = laplace.mode + (normals / np.sqrt(mixing)[:, None]) @ factor.T
    distance = np.sum(normals**2, axis=1) / mixing
    log_q = (
        gammaln(0.5 * (DEGREES_OF_FREEDOM + size))
        - gammaln(0.5 * DEGREES_OF_FREEDOM)
        - 0.5 * size * np.log(DEGREES_OF_FREEDOM * np.pi)
        - np.sum(np.log(np.diag(factor)))
        - 0.5 * (DEGREES_OF_FREEDOM + size) * np.log1p(distance / DEGREES_OF_FREEDOM)
    )
    return weighted(points, density.log_prob(points) - log_q)


def weighted(points: Floats, log_weights: Floats) -> Evidence:
    """Return the importance sample of draws with these weights, p/q.

    Returns
    -------
    Evidence
        With −inf where no draw is possible.

    Examples
    --------
    >>> weighted(np.zeros((4, 1)), np.log([1.0, 1.0, 2.0, 0.0 + 1e-300])).log_evidence
    0.0
    """
    weights = np.where(np.isnan(log_weights), -np.inf, log_weights)
    if not np.any(np.isfinite(weights)):
        return Evidence(-np.inf, np.inf, points, weights, 0.0)
    total, count, effective = float(logsumexp(weights)), len(weights), effective_draws(weights)
    error = float(np.sqrt(max(1.0 / effective - 1.0 / count, 0.0)))
    return Evidence(total - float(np.log(count)), error, points, weights, effective)


def effective_draws(log_weights: Floats) -> float:
    """Return (Σ w)²/Σ w² of importance weights, the number of equal ones that are worth as much.

    Examples
    --------
    >>> round(effective_draws(np.log([1.0, 1.0, 0.5])), 2)
    2.78
    """
    return float(np.exp(2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights)))


def surrounding(
    density: Density,
    point: Floats,
    covariance: Floats,
    generator: np.random.Generator,
    draws: int = 2000,
) -> Evidence:
    """Return possible points close to a possible point, equally weighted, to start a sampler from.

    Their log evidence is not known: nan.
    """
    factor = 0.1 * np.linalg.cholesky(covariance)
    points = point + generator.standard_normal((draws, len(point))) @ factor.T
    weights = np.where(np.isfinite(density.log_prob(points)), 0.0, -np.inf)
    return Evidence(float("nan"), float("nan"), points, weights, float(np.sum(weights == 0.0)))
