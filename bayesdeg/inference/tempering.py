"""A population tempered from a wide law to a posterior, which follows the mass, not the height."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import logsumexp

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.density import Density, guesses
from bayesdeg.inference.laplace import effective_draws

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]

GUESSES = 400  # draws of the prior, from which the wide law takes its width
PARTICLES, LEFT = 1000, 0.5  # of the population, and the share that each step of tempering leaves
WIDTH = 1.5  # of the law that tempering begins with, over that of draws of the prior
NORMAL_QUARTILES = 1.349  # between the quartiles of a normal law, in standard deviations
SWEEPS, ACCEPTED = 40, 4.0  # of moves after each step: at most, and the mean number that suffices
JUMPS = 0.1  # share of moves by a whole difference, which lead from mode to mode
JITTER = 1e-3  # of a move, in standard deviations of the population, lest it stay on a lattice
STEPS = 200  # of tempering, at most: a few dozen do


@dataclass(frozen=True)
class _Wide:
    """A normal law with independent parameters: where tempering begins."""

    mean: Floats
    sd: Floats

    def draws(self, generator: np.random.Generator, count: int) -> Floats:
        return self.mean + self.sd * generator.standard_normal((count, len(self.mean)))

    def log_density(self, points: Floats) -> Floats:
        squares = np.sum(((points - self.mean) / self.sd) ** 2, axis=1)
        constant = np.sum(np.log(self.sd)) + 0.5 * len(self.mean) * np.log(2.0 * np.pi)
        found: Floats = -0.5 * squares - constant
        return found


def tempered(density: Density, generator: np.random.Generator) -> tuple[Floats, float]:
    """Return a population of the posterior, (n, n_parameters), and the log evidence.

    A sequential Monte Carlo sampler: draws of a law q that is wider than the prior are weighted
    by (p/q)^(b' − b) from one power b of the density q^(1 − b) p^b to the next, resampled, and
    moved by differential evolution. Each step of b leaves half of the effective draws.

    Parameters
    ----------
    density : Density
        p.
    generator : Generator
        Source of randomness.

    Raises
    ------
    BayesdegError
        If the density is zero at all draws of the wide law.

    References
    ----------
    Del Moral, Doucet and Jasra (2006), doi:10.1111/j.1467-9868.2006.00553.x.
    """
    points = guesses(density.table, generator, GUESSES)
    wide = _Wide(np.median(points, axis=0), WIDTH * spread(points))
    points = wide.draws(generator, PARTICLES)
    values, base = density.log_prob(points), wide.log_density(points)
    if not np.any(np.isfinite(values)):
        raise BayesdegError(
            "the posterior density is zero wherever its priors were tried: priors and data "
            "contradict each other, or a prior leaves out what the data show; widen the priors"
        )
    power, level = 0.0, 0.0
    for _ in range(STEPS):
        step = _next(values - base, power)
        log_weights = step * (values - base)
        level += float(logsumexp(log_weights) - np.log(PARTICLES))
        power += step
        kept = _resampled(log_weights, generator)
        state = points[kept], values[kept], base[kept]
        points, values, base = _moved(density, wide, state, power, generator)
        if power >= 1.0:
            break
    return points, level


def _next(log_ratio: Floats, power: float) -> float:
    """Return the step of the power that leaves the share `LEFT` of effective draws."""
    least = LEFT * float(np.sum(np.isfinite(log_ratio)))
    rest = 1.0 - power
    log_ratio = np.where(np.isfinite(log_ratio), log_ratio, -np.inf)

    def lacking(step: float) -> float:
        return effective_draws(step * log_ratio) - least

    if lacking(rest) >= 0.0:
        return rest
    # on the scale of logarithms: the first steps are small where data are many
    low = 1e-12 * rest
    return float(np.exp(brentq(lambda u: lacking(np.exp(u)), np.log(low), np.log(rest))))


def _resampled(log_weights: Floats, generator: np.random.Generator) -> Whole:
    """Return places drawn by weight, evenly spaced in the sum of the weights."""
    weights = np.exp(log_weights - logsumexp(log_weights))
    even = (np.arange(len(weights)) + generator.random()) / len(weights)
    found: Whole = np.minimum(np.searchsorted(np.cumsum(weights), even), len(weights) - 1)
    return found


def _moved(
    density: Density,
    wide: _Wide,
    state: tuple[Floats, Floats, Floats],
    power: float,
    generator: np.random.Generator,
) -> tuple[Floats, Floats, Floats]:
    """Move points by differences of pairs of the population as it was, until most have moved."""
    points, values, base = (part.copy() for part in state)
    count, size = points.shape
    pairs, width = state[0], JITTER * spread(state[0])
    accepted = 0.0
    for _ in range(SWEEPS):
        first, second = generator.integers(count, size=(2, count))
        usual = 2.38 / np.sqrt(2.0 * size) * np.exp(0.5 * generator.standard_normal(count))
        length = np.where(generator.random(count) < JUMPS, 1.0, usual)[:, None]
        jitter = width * generator.standard_normal(points.shape)
        tried = points + length * (pairs[first] - pairs[second]) + jitter
        new, new_base = density.log_prob(tried), wide.log_density(tried)
        gain = power * (new - values) + (1.0 - power) * (new_base - base)
        taken = np.log(generator.random(count)) < gain
        points[taken], values[taken], base[taken] = tried[taken], new[taken], new_base[taken]
        accepted += float(np.mean(taken))
        if accepted >= ACCEPTED:
            break
    return points, values, base


def spread(points: Floats) -> Floats:
    """Return the width of draws in each parameter, by quartiles: priors may have no variance."""
    low, high = np.quantile(points, [0.25, 0.75], axis=0)
    width: Floats = np.maximum((high - low) / NORMAL_QUARTILES, 1e-8)
    return width
