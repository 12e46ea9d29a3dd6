"""Mode and curvature of a posterior: screening, starting points, evidence."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaln, logsumexp

from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

Vector = np.ndarray[tuple[int], np.dtype[np.float64]]

STEP = 1e-4
IMPOSSIBLE = -1e12  # stands for −inf where an optimiser needs a number
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
    model: Model, generator: np.random.Generator, *, start: Floats | None = None
) -> Laplace:
    """Return the Laplace approximation of a model's posterior.

    Parameters
    ----------
    model : Model
        What to approximate.
    generator : Generator
        Draws starting points from the prior.
    start : array, shape (n_parameters,), optional
        A point near the mode; by default the best of 400 draws from the prior.
    """
    if start is None:
        trials = np.vstack([_prior_median(model), model.table.sample(generator, 400)])
        start = trials[int(np.argmax(model.log_prob(trials)))]
    mode = _climb(model, start)
    _, hessian = derivatives(model, mode)
    return Laplace(mode, positive_inverse(-hessian), float(_density(model, mode[None])[0]))


def evidence(
    model: Model, laplace: Laplace, generator: np.random.Generator, *, draws: int = 3000
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
    weights = model.log_prob(points) - log_q
    if not np.any(np.isfinite(weights)):
        return Evidence(-np.inf, np.inf, points, weights, 0.0)
    total = float(logsumexp(weights))
    effective = float(np.exp(2.0 * total - logsumexp(2.0 * weights)))
    error = float(np.sqrt(max(1.0 / effective - 1.0 / draws, 0.0)))
    return Evidence(total - float(np.log(draws)), error, points, weights, effective)


def surrounding(
    model: Model,
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
    weights = np.where(np.isfinite(model.log_prob(points)), 0.0, -np.inf)
    return Evidence(float("nan"), float("nan"), points, weights, float(np.sum(weights == 0.0)))


def derivatives(model: Model, point: Floats, step: float = 1e-3) -> tuple[Floats, Floats]:
    """Return gradient and Hessian of the log density at a point, bounds of priors left out.

    Differences are central, and one-sided where a neighbour is impossible.
    """
    size = len(point)
    around = point + step * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])
    possible = (_density(model, around) > IMPOSSIBLE)[:, None]
    gradients = _gradient(model, around)
    here = gradients[0]
    forth = np.where(possible[1 : size + 1], gradients[1 : size + 1], here)
    back = np.where(possible[size + 1 :], gradients[size + 1 :], here)
    sides = possible[1 : size + 1].astype(np.float64) + possible[size + 1 :]
    hessian = (forth - back) / (step * np.maximum(sides, 1.0))
    return here, 0.5 * (hessian + hessian.T)


def positive_inverse(precision: Floats) -> Floats:
    """Invert a precision, its eigenvalues held between 1e-2 and 1e8.

    A direction of too little curvature is taken as unit-wide.
    """
    values, vectors = np.linalg.eigh(precision)
    width = np.where(values > 1e-2, 1.0 / np.clip(values, 1e-2, 1e8), 1.0)
    covariance: Floats = (vectors * width) @ vectors.T
    return 0.5 * (covariance + covariance.T)


def _prior_median(model: Model) -> Floats:
    median = {p.name: p.law.quantile(0.5) for p in model.table.parameters}
    return model.table.vectors(median)[None]


def _density(model: Model, points: Floats) -> Floats:
    return np.maximum(model.log_prob(points, truncate=False), IMPOSSIBLE)


def _gradient(model: Model, points: Floats) -> Floats:
    """Differences for a batch of points, (n, size), all in one call; central where possible."""
    count, size = points.shape
    steps = STEP * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])
    values = _density(model, (points[:, None, :] + steps).reshape(-1, size))
    values = values.reshape(count, 1 + 2 * size)
    here, forth, back = values[:, :1], values[:, 1 : size + 1], values[:, size + 1 :]
    possible = (forth > IMPOSSIBLE).astype(np.float64) + (back > IMPOSSIBLE)
    change = np.where(forth > IMPOSSIBLE, forth, here) - np.where(back > IMPOSSIBLE, back, here)
    gradient: Floats = change / (STEP * np.maximum(possible, 1.0))
    return gradient


def _climb(model: Model, start: Floats) -> Floats:
    def objective(x: Vector) -> float:
        return -float(_density(model, x[None])[0])

    def downhill(x: Vector) -> Vector:
        return np.ravel(-_gradient(model, x[None]))

    point = np.ravel(start)
    for _ in range(4):  # L-BFGS stops early where the density is steep; a restart goes on
        found = minimize(
            objective,
            point,
            jac=downhill,
            method="L-BFGS-B",
            options={"maxiter": 300, "maxcor": 30},
        )
        gained = objective(point) - objective(found.x)
        point = found.x
        if gained < 1e-3:
            break
    return point
