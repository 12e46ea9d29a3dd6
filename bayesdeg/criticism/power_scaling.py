"""A part of a log density scaled up and down a little, by weights on stored draws."""

import warnings
from dataclasses import dataclass
from typing import Self

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

Floats = NDArray[np.float64]

ALPHAS = (0.99, 1.01)


@dataclass(frozen=True)
class Scaling:
    """Weights of stored draws for a part of the log density scaled down and up a little.

    Parameters
    ----------
    log_density : array, shape (n_chains, n_draws)
        The part.
    lower, upper : array, shape (n_chains, n_draws)
        Weights that sum to 1.
    """

    log_density: Floats
    lower: Floats
    upper: Floats

    @classmethod
    def of(cls, log_density: Floats) -> Self:
        """Scale a part, such as the log prior; the largest weights are smoothed."""
        if np.ptp(log_density) == 0.0:  # a flat prior: every power of it is the same
            even = np.full_like(log_density, 1.0 / log_density.size)
            return cls(log_density, even, even)
        logs = (_log_weights(log_density, alpha) for alpha in ALPHAS)
        lower, upper = (np.exp(w - logsumexp(w)) for w in logs)
        return cls(log_density, lower, upper)


def power_scaling(draws: Floats, scaling: Scaling) -> float:
    """Return how much the law of a quantity changes per doubling of the power of a density.

    Parameters
    ----------
    draws : array, shape (n_chains, n_draws)
        Of the quantity.
    scaling : Scaling
        Of the density.

    Examples
    --------
    >>> from scipy.stats import norm
    >>> draws = norm.ppf((np.arange(4000) + 0.5) / 4000).reshape(4, 1000)
    >>> round(power_scaling(draws, Scaling.of(norm.logpdf(draws))), 2)  # nothing but a prior
    0.08
    """
    if np.ptp(draws) == 0.0:
        return 0.0
    weights = (scaling.lower, scaling.upper)
    return float(array_stats.power_scale_sense(draws, *weights, *ALPHAS))


def noise_of(draws: Floats, scaling: Scaling) -> float:
    """Return the sensitivity of draws of one ensemble to the densities of another.

    They have nothing to do with each other, but are as many and as much alike as those that do.
    """
    turned = [power_scaling(np.roll(draws, turn, axis=0), scaling) for turn in range(1, len(draws))]
    return float(np.mean(turned)) if turned else 0.0


def _log_weights(log_density: Floats, alpha: float) -> Floats:
    # a part on which nearly all draws agree, as that no specimen bursts, has no tail to smooth
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Number of tail draws", UserWarning)
        try:
            smooth: Floats = array_stats.power_scale_lw(log_density, alpha=alpha, axis=(0, 1))
        except ValueError:
            return (alpha - 1.0) * log_density
    return smooth if np.all(np.isfinite(smooth)) else (alpha - 1.0) * log_density
