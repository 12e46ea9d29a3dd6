"""Importance sampling with a Student law of parameters warped to near normality."""

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.special import gammaln, logsumexp

from bayesdeg.inference.density import Density
from bayesdeg.inference.laplace import (
    POOR,
    Evidence,
    Laplace,
    effective_draws,
    evidence,
    smoothed,
    weighted,
    with_exact_curvature,
)

Floats = NDArray[np.float64]
Vector = np.ndarray[tuple[int], np.dtype[np.float64]]

MOST_WARPED = 2000  # draws used by a fit; more change its four numbers little
# bounds of location and log scale in standard deviations, skewness and log tail weight
BOUNDS = ((-5.0, 5.0), (-4.0, 4.0), (-4.0, 4.0), (-1.5, 1.5))
PULL = 1e-3  # shrinkage towards the normal law, as strong as this many draws


@dataclass(frozen=True)
class Warp:
    """The sinh–arcsinh map of each parameter.

    z = sinh(δ asinh((x − ξ)/η) − ε): normal z gives x skewness by ε and tails by δ.

    Source: Jones and Pewsey (2009), doi:10.1093/biomet/asp053.

    Parameters
    ----------
    location, scale, skewness, tail : array, shape (n_parameters,)
        ξ, η, ε and δ, the scale and the tail weight positive.

    Examples
    --------
    >>> one = np.ones(1)
    >>> warp = Warp(location=2.0 * one, scale=3.0 * one, skewness=0.0 * one, tail=one)
    >>> z, log_slope = warp.normal(np.array([[8.0]]))
    >>> z.round(6), log_slope.round(4)  # then z = (x − 2)/3
    (array([[2.]]), array([-1.0986]))
    >>> warp.original(z)
    array([[8.]])
    """

    location: Floats
    scale: Floats
    skewness: Floats
    tail: Floats

    @classmethod
    def fit(cls, draws: Floats) -> Self:
        """Return the most likely map of draws (n, n_parameters), parameter by parameter."""
        take = np.linspace(0, len(draws) - 1, min(MOST_WARPED, len(draws))).round().astype(np.int64)
        centre = np.median(draws, axis=0)
        # positive for constant columns too
        least = 1e-8 * np.maximum(1.0, np.abs(centre))
        spread = np.maximum(np.std(draws, axis=0), least)
        standard = (draws[take] - centre) / spread
        found = np.array([_most_likely(column) for column in standard.T])
        location, log_scale, skewness, log_tail = found.T
        return cls(
            centre + spread * location, spread * np.exp(log_scale), skewness, np.exp(log_tail)
        )

    def normal(self, vectors: Floats) -> tuple[Floats, Floats]:
        """Return z (n, n_parameters) of vectors x, and the map's log determinant (n,)."""
        standard = (vectors - self.location) / self.scale
        bent = self.tail * np.arcsinh(standard) - self.skewness
        log_slope = _log_cosh(bent) + np.log(self.tail / self.scale) - 0.5 * np.log1p(standard**2)
        return np.sinh(bent), np.sum(log_slope, axis=-1)

    def original(self, normal: Floats) -> Floats:
        """Return the vectors x (n, n_parameters) of z."""
        bent = (np.arcsinh(normal) + self.skewness) / self.tail
        vectors: Floats = self.location + self.scale * np.sinh(bent)
        return vectors


def _log_cosh(x: Floats) -> Floats:
    size = np.abs(x)
    value: Floats = size + np.log1p(np.exp(-2.0 * size)) - np.log(2.0)
    return value


def _most_likely(standard: Floats) -> Floats:
    def objective(theta: Vector) -> tuple[float, Vector]:
        location, log_scale, skewness, log_tail = theta
        tail, scale = np.exp(log_tail), np.exp(log_scale)
        u = (standard - location) / scale
        bend = np.arcsinh(u)
        w = tail * bend - skewness
        z = np.sinh(w)
        value = 0.5 * z**2 - _log_cosh(w) + 0.5 * np.log1p(u**2)
        by_w = z * np.cosh(w) - np.tanh(w)
        by_u = by_w * tail / np.sqrt(1.0 + u**2) + u / (1.0 + u**2)
        gradient = np.array(
            [
                -np.mean(by_u) / scale,
                1.0 - np.mean(by_u * u),
                -np.mean(by_w) + 2.0 * PULL * skewness,
                -1.0 + np.mean(by_w * tail * bend) + 2.0 * PULL * log_tail,
            ]
        )
        pull = PULL * (skewness**2 + log_tail**2)
        return float(np.mean(value) - log_tail + log_scale + pull), gradient

    with np.errstate(over="ignore", invalid="ignore"):
        found = minimize(objective, np.zeros(4), jac=True, method="L-BFGS-B", bounds=BOUNDS)
    return found.x if np.all(np.isfinite(found.x)) else np.zeros(4)


# degrees of freedom of the fitted Student law: importance weights need heavy tails
DEGREES_OF_FREEDOM = 10.0
# for moves, where walkers also use differential evolution: lighter tails save a fifth of the steps
# of the gelatin study
FOR_WALKERS = 20.0


class Random(Protocol):
    """Interface of random numbers for moves; emcee uses the legacy kind."""

    def standard_normal(self, size: tuple[int, ...], /) -> Floats:
        """Draw standard normal numbers."""

    def standard_gamma(self, shape: float, size: int, /) -> Floats:
        """Draw gamma numbers of scale 1."""


@dataclass(frozen=True)
class Proposal:
    """A Student law with the marginals of a posterior and its correlations.

    In z, the parameters after ``warp``, it is the multivariate Student law of ``mean`` and scale
    matrix L Lᵀ; in x that times the map's determinant.

    Parameters
    ----------
    warp : Warp
        Makes each marginal nearly normal.
    mean : array, shape (n_parameters,)
        Centre of z.
    factor, whitening : array, shape (n_parameters, n_parameters)
        Lower Cholesky factor L, and its inverse.
    degrees : float
        Degrees of freedom.
    """

    warp: Warp
    mean: Floats
    factor: Floats
    whitening: Floats
    degrees: float = DEGREES_OF_FREEDOM

    @classmethod
    def fit(cls, draws: Floats, *, degrees: float = DEGREES_OF_FREEDOM) -> Self:
        """Fit the law to draws (n, n_parameters), possibly with duplicates."""
        warp = Warp.fit(draws)
        z, _ = warp.normal(draws)
        covariance = np.atleast_2d(np.cov(z, rowvar=False))
        # positive definite also where the draws lie in a plane
        ridge = 1e-6 * np.maximum(np.diag(covariance), 1e-6)
        factor = np.linalg.cholesky(covariance + np.diag(ridge))
        return cls(warp, np.mean(z, axis=0), factor, np.linalg.inv(factor), degrees)

    def independent(self, vectors: Floats, random: Random) -> tuple[Floats, Floats]:
        """Propose draws of the law, independent of the walkers' positions.

        Returns
        -------
        proposed : array, shape (n, n_parameters)
        log_factor : array, shape (n,)
            ln q(x) − ln q(x'), of the law's density q: what emcee adds to ln p(x') − ln p(x).
        """
        count, size = vectors.shape
        mixing = random.standard_gamma(0.5 * self.degrees, count) / (0.5 * self.degrees)
        white = random.standard_normal((count, size)) / np.sqrt(mixing)[:, None]
        proposed = self.original(white)
        return proposed, self.log_density(vectors) - self.log_density(proposed)

    def jittered(self, vectors: Floats, random: np.random.Generator, *, width: float) -> Floats:
        """Return vectors jittered by this many standard deviations of the law."""
        white, _ = self.white(vectors)
        return self.original(white + width * random.standard_normal(white.shape))

    def log_density(self, vectors: Floats) -> Floats:
        """Return the law's log density in x up to a constant, shape (n,)."""
        white, log_slope = self.white(vectors)
        distance = np.sum(white**2, axis=-1) / self.degrees
        density: Floats = log_slope - 0.5 * (self.degrees + vectors.shape[-1]) * np.log1p(distance)
        return density

    def original(self, white: Floats) -> Floats:
        """Return the vectors x (n, n_parameters) of white coordinates."""
        return self.warp.original(self.mean + white @ self.factor.T)

    def white(self, vectors: Floats) -> tuple[Floats, Floats]:
        """Return coordinates in which the law has no correlations, and ln |dz/dx|, (n,)."""
        z, log_slope = self.warp.normal(vectors)
        return (z - self.mean) @ self.whitening.T, log_slope


ENOUGH, DRAWS = 300.0, 1000  # effective draws required about a mode, and draws of each round
MOST = 4000  # draws about a mode before a better proposal is fitted to them
FITTED = 2000  # draws for fitting a proposal
WIDER = 1.3  # widening of the fit, to find regions not reached by earlier draws
LEAST = 20.0  # effective draws per parameter for fitting a proposal


def about_mode(
    density: Density, laplace: Laplace, generator: np.random.Generator, *, enough: float = ENOUGH
) -> Evidence:
    """Return an importance sample of a posterior with known mode, `improved` if it is poor.

    ``enough`` is the number of effective draws wanted.
    """
    found = evidence(density, laplace, generator, draws=MOST, enough=enough)
    if found.effective >= enough:
        return found
    if found.effective < POOR * len(
        found.draws
    ):  # expected curvature may be misleading, as for ruptures
        exact = with_exact_curvature(density, laplace)
        second = evidence(density, exact, generator, draws=MOST, enough=enough)
        found = max(found, second, key=lambda one: one.effective)
        if found.effective >= enough:
            return found
    again = improved(density, found, generator, draws=DRAWS, enough=enough)
    return again if again.effective > found.effective else found


def improved(
    density: Density,
    posterior: Evidence,
    generator: np.random.Generator,
    *,
    draws: int = 2000,
    enough: float = 1000.0,
    rounds: int = 8,
) -> Evidence:
    """Return an importance sample with enough effective draws, if possible.

    Each round fits a Student law with warped marginals to the weighted draws so far, and draws from
    it; all draws are then weighted by the mixture of all these laws. If few draws carry the weight,
    weights are flattened before fitting, so that the law does not collapse onto those few.

    The evidence is −inf where no draw is possible.

    Parameters
    ----------
    density : Density
        What is sampled.
    posterior : Evidence
        Draws and weights to begin with; they serve the first fit alone.
    generator : Generator
        Draws the proposals.
    draws, rounds : int
        Draws of each round, and most rounds.
    enough : float
        Effective draws at which no further round is made.

    References
    ----------
    Cornuet, Marin, Mira and Robert (2012), doi:10.1111/j.1467-9469.2011.00756.x.
    """
    laws: list[Proposal] = []
    known = posterior
    points, densities = np.empty((0, len(density.table))), np.empty(0)
    under = np.empty((0, 0))  # log density of each point (column) under each law
    found = posterior
    for _ in range(rounds if posterior.effective > 0.0 else 0):
        law = Proposal.fit(_flattened(known).resample(generator, FITTED))
        law = replace(law, factor=WIDER * law.factor, whitening=law.whitening / WIDER)
        more, _ = law.independent(np.zeros((draws, points.shape[1])), generator)
        earlier = np.array([log_density(one, more) for one in laws]).reshape(len(laws), draws)
        laws, points = [*laws, law], np.concatenate([points, more])
        under = np.vstack([np.hstack([under, earlier]), log_density(law, points)])
        densities = np.concatenate([densities, density.log_prob(more)])
        mixture = logsumexp(under, axis=0) - np.log(len(laws))
        found = replace(weighted(points, densities - mixture), log_densities=densities)
        if not np.isfinite(found.log_evidence) or found.effective >= enough:
            break
        known = found
    return found


def refitted(
    density: Density, posterior: Evidence, generator: np.random.Generator, *, draws: int = 4000
) -> Evidence:
    """Return an importance sample from the law fitted to draws of nearly the same posterior.

    The law is as wide as the draws, so far fewer proposals are wasted than by `improved`, which
    searches for regions that draws have missed. Weights are flattened where few draws carry them.
    """
    law = Proposal.fit(_flattened(posterior).resample(generator, FITTED))
    points, _ = law.independent(np.zeros((draws, len(density.table))), generator)
    values = density.log_prob(points)
    return replace(smoothed(points, values - log_density(law, points)), log_densities=values)


def log_density(law: Proposal, points: Floats) -> Floats:
    """Return the normalised log density of a proposal, shape (n,)."""
    size, half = points.shape[-1], 0.5 * law.degrees
    constant = (
        gammaln(half + 0.5 * size)
        - gammaln(half)
        - 0.5 * size * np.log(law.degrees * np.pi)
        - np.sum(np.log(np.diag(law.factor)))
    )
    density: Floats = law.log_density(points) + constant
    return density


def _flattened(sample: Evidence) -> Evidence:
    """Raise the weights to a power below 1 if there are too few effective draws."""
    possible = np.isfinite(sample.log_weights)
    points, weights = sample.draws[possible], sample.log_weights[possible]
    weights = weights - np.max(weights)
    least = min(LEAST * points.shape[1], 0.5 * len(weights))
    if effective_draws(weights) < least:
        power = brentq(lambda b: effective_draws(b * weights) - least, 0.0, 1.0)
        weights = power * weights
    return weighted(points, weights)
