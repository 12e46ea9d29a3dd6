"""Where walkers are sent: a law fitted to draws of a posterior."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.warp import Warp

Floats = NDArray[np.float64]

# of the fitted Student law: importance weights need tails heavier than those of a posterior
DEGREES_OF_FREEDOM = 10.0
# walkers that are sent far out by it also move by one another: lighter tails save a fifth of the
# steps of the gelatin study
FOR_WALKERS = 20.0


class Random(Protocol):
    """What moves ask of a source of random numbers; emcee hands on the old kind."""

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
        """Return the law of draws (n, n_parameters), of which some may be equal."""
        warp = Warp.fit(draws)
        z, _ = warp.normal(draws)
        covariance = np.atleast_2d(np.cov(z, rowvar=False))
        # positive definite also where the draws lie in a plane
        ridge = 1e-6 * np.maximum(np.diag(covariance), 1e-6)
        factor = np.linalg.cholesky(covariance + np.diag(ridge))
        return cls(warp, np.mean(z, axis=0), factor, np.linalg.inv(factor), degrees)

    def independent(self, vectors: Floats, random: Random) -> tuple[Floats, Floats]:
        """Propose draws of the law, whatever the walkers' positions.

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
        """Return vectors moved by so many standard deviations of the law, in all directions."""
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
