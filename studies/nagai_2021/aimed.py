"""Importance sampling of the likelihood in standard normal scores.

Unknowns are functions of scores that are standard normal under the prior. Likelihoods that need
rare noise at a narrow size of a cause are missed by draws from the prior; so draws are made around
earlier good ones, and weighted by prior over proposal density.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Floats = NDArray[np.float64]

PRIOR_SHARE = 0.3
"""Share of draws that still come from the prior, which bounds the weights."""
WIDENING = 1.5
"""Factor on the covariance of the earlier draws."""
POWERS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05)


@dataclass(frozen=True)
class Scores:
    """Draws of scores.

    Parameters
    ----------
    standard : array, shape (n, n_unknowns)
        Standard normal under the prior [–].
    log_weight : array, shape (n,)
        ln of prior over proposal density.
    """

    standard: Floats
    log_weight: Floats


@dataclass(frozen=True)
class Evidence:
    """An evidence by importance sampling.

    Parameters
    ----------
    log_value : float
        ln of the evidence.
    error : float
        Its Monte Carlo standard error [–].
    """

    log_value: float
    error: float

    def over(self, other: "Evidence") -> tuple[float, float]:
        """Return the Bayes factor over another one and its Monte Carlo standard error."""
        factor = float(np.exp(self.log_value - other.log_value))
        return factor, factor * float(np.hypot(self.error, other.error))


def from_prior(generator: np.random.Generator, count: int, unknowns: int) -> Scores:
    """Draw scores from the prior."""
    return Scores(generator.standard_normal((count, unknowns)), np.zeros(count))


def aimed(
    generator: np.random.Generator, before: Scores, log_likelihoods: Sequence[Floats], count: int
) -> Scores:
    """Draw scores about those that did well by each likelihood, some still from the prior."""
    unknowns = before.standard.shape[1]
    normals = [(np.zeros(unknowns), np.eye(unknowns))]
    normals += [_about(before, log_likelihood) for log_likelihood in log_likelihoods]
    others = len(log_likelihoods)
    shares = np.array([PRIOR_SHARE, *np.full(others, (1.0 - PRIOR_SHARE) / others)])
    of = generator.choice(len(shares), size=count, p=shares)
    plain = generator.standard_normal((count, unknowns))
    means, roots = (np.array([n[k] for n in normals]) for k in range(2))
    values = means[of] + np.einsum("nij,nj->ni", roots[of], plain)
    each = np.stack([_log_density(values, mean, root) for mean, root in normals])
    return Scores(values, each[0] - logsumexp(each + np.log(shares)[:, None], axis=0))


def evidence(log_joint: Floats) -> Evidence:
    """Return the mean of exp(log_joint), draws' likelihoods with their weights."""
    top = log_joint.max()
    if not np.isfinite(top):
        return Evidence(-np.inf, 0.0)
    weight = np.exp(log_joint - top)
    error = weight.std(ddof=1) / weight.mean() / np.sqrt(len(weight))
    return Evidence(float(top + np.log(weight.mean())), float(error))


def _about(before: Scores, log_likelihood: Floats) -> tuple[Floats, Floats]:
    """Return mean and Cholesky root of the covariance of draws that did well, widened."""
    weights = _tempered(log_likelihood, before.log_weight)
    mean = weights @ before.standard
    away = before.standard - mean
    covariance = WIDENING * (away.T * weights) @ away + 0.02 * np.eye(len(mean))
    return mean, np.linalg.cholesky(covariance)


def _tempered(log_likelihood: Floats, log_weight: Floats) -> Floats:
    """Return weights, of likelihood to the largest power that leaves enough draws at work."""
    enough = np.sqrt(10.0 * len(log_likelihood))
    for power in POWERS:
        total = power * log_likelihood + log_weight
        weights: Floats = np.exp(total - logsumexp(total))
        if 1.0 / np.square(weights).sum() > enough:
            break
    return weights


def _log_density(values: Floats, mean: Floats, root: Floats) -> Floats:
    """Return ln of a normal density by the Cholesky root of its covariance, but for a constant."""
    z = np.linalg.solve(root, (values - mean).T)
    density: Floats = -0.5 * np.square(z).sum(axis=0) - np.log(np.diag(root)).sum()
    return density
