"""Mode and curvature of a posterior: screening, starting points, evidence."""

from dataclasses import dataclass, replace

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.inference.density import Density, guesses
from bayesdeg.inference.mode import STEP, derivatives, find_mode, positive_inverse, scales
from bayesdeg.inference.two_piece import about

Floats = NDArray[np.float64]


ROUND = 500  # proposals drawn and looked at together
POOR = 0.02  # share of effective draws below which further draws of the same law are of no use
LIGHT = 1.0 / 3.0  # shape of a tail up to which the weights have a third moment: left as they are
FEWEST_SMOOTHED = 100  # draws: of fewer, the tail has too few to fit a law to
FEWEST_EFFECTIVE = 30.0  # an importance sample of fewer effective draws is not used


@dataclass(frozen=True)
class Laplace:
    """A posterior's mode and the normal law that touches it there.

    Parameters
    ----------
    mode : array, shape (n_parameters,)
        On the unconstrained scale, within the bounds of truncated priors.
    covariance : array, shape (n_parameters, n_parameters)
        Inverse of the information there.
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
    log_densities : array, shape (n,), optional
        Log posterior densities of the draws, not normalised.
    pareto_k : float
        Shape of the tail of the weights; above 0.7 they cannot be relied on. Nan if not known.
    """

    log_evidence: float
    error: float
    draws: Floats
    log_weights: Floats
    effective: float
    log_densities: Floats | None = None
    pareto_k: float = float("nan")

    @property
    def top(self) -> tuple[Floats, float] | None:
        """The most probable draw and its log density; None if densities are not known."""
        if self.log_densities is None:
            return None
        best = int(np.argmax(self.log_densities))
        return self.draws[best], float(self.log_densities[best])

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
    mode, covariance = find_mode(density, start)
    return Laplace(mode, covariance, float(density.log_prob(mode[None])[0]))


def with_exact_curvature(density: Density, laplace: Laplace) -> Laplace:
    """Return the approximation with second differences of the density in the place of expected."""
    scale = scales(density, laplace.mode)
    _, hessian = derivatives(density, laplace.mode, STEP * scale)
    unit = np.outer(scale, scale)
    return replace(laplace, covariance=unit * positive_inverse(-hessian * unit))


def evidence(
    density: Density,
    laplace: Laplace,
    generator: np.random.Generator,
    *,
    draws: int = 3000,
    enough: float = np.inf,
) -> Evidence:
    """Estimate the marginal likelihood, Z = E_q[p(θ, y)/q(θ)] with q a law of two-piece axes.

    Parameters
    ----------
    density, laplace : Density, Laplace
        What is sampled, and its mode.
    generator : Generator
        Draws the proposals.
    draws : int
        Of them, at most.
    enough : float
        Effective draws with which fewer proposals do; they are drawn in rounds of `ROUND`.

    Returns
    -------
    Evidence
        With −inf where no draw is possible.
    """
    proposal = about(density, laplace.mode, laplace.covariance)
    rounds: list[tuple[Floats, Floats, Floats]] = []
    for first in range(0, draws, ROUND):
        points, log_q = proposal.draw(generator, min(ROUND, draws - first))
        values = density.log_prob(points)
        rounds.append((points, values - log_q, values))
        points, log_weights, values = (np.concatenate(part) for part in zip(*rounds, strict=True))
        found = replace(smoothed(points, log_weights), log_densities=values)
        hopeless = found.effective < POOR * len(points) and np.isfinite(enough)
        if found.effective >= enough or hopeless:
            break
    return found


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


def smoothed(points: Floats, log_weights: Floats) -> Evidence:
    """Return the importance sample with its largest weights smoothed by a Pareto law.

    A single draw from a tail that the proposal hardly reaches would else decide the estimate.

    References
    ----------
    Vehtari, Simpson, Gelman, Yao and Gabry (2024), https://jmlr.org/papers/v25/19-556.html.
    """
    possible = np.isfinite(log_weights)
    if np.sum(possible) < FEWEST_SMOOTHED:
        return weighted(points, log_weights)
    known = log_weights[possible]
    try:
        normalised, pareto_k = array_stats.psislw(-known)
    except ValueError:  # a tail of equal weights
        return weighted(points, log_weights)
    if not pareto_k > LIGHT:
        return replace(weighted(points, log_weights), pareto_k=float(pareto_k))
    weights = np.full(len(log_weights), -np.inf)
    # all but the tail are as they were, up to a constant
    weights[possible] = normalised + float(np.median(known - normalised))
    return replace(weighted(points, weights), pareto_k=float(pareto_k))


def effective_draws(log_weights: Floats) -> float:
    """Return (Σ w)²/Σ w² of importance weights, the number of equal ones that are worth as much.

    Examples
    --------
    >>> round(effective_draws(np.log([1.0, 1.0, 0.5])), 2)
    2.78
    """
    return float(np.exp(2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights)))
