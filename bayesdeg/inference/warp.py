"""A monotone map of each parameter that makes its distribution nearly normal."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

Floats = NDArray[np.float64]
Vector = np.ndarray[tuple[int], np.dtype[np.float64]]

MOST = 2000  # draws that a fit looks at; more change its four numbers little
# of location and log scale in standard deviations, skewness and log tail weight
BOUNDS = ((-5.0, 5.0), (-4.0, 4.0), (-4.0, 4.0), (-1.5, 1.5))
PULL = 1e-3  # towards the normal law, as strong as so many draws over their number


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
        """Return the most likely map of draws (n, n_parameters), each parameter by itself."""
        take = np.linspace(0, len(draws) - 1, min(MOST, len(draws))).round().astype(np.int64)
        centre, spread = np.median(draws, axis=0), _spread(draws)
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


def _spread(draws: Floats) -> Floats:
    """Return standard deviations, those of constant columns replaced by something positive."""
    least = 1e-8 * np.maximum(1.0, np.abs(np.median(draws, axis=0)))
    spread: Floats = np.maximum(np.std(draws, axis=0), least)
    return spread


def _log_cosh(x: Floats) -> Floats:
    value: Floats = np.logaddexp(x, -x) - np.log(2.0)
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
