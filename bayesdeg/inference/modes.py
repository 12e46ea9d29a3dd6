"""Search for separate modes, and tempering of a population to a posterior.

Mode searches from dispersed starts are cheap: if they end at different modes, or at one with hardly
any posterior mass around it, a population is tempered from a wide law to the posterior. It follows
the mass, not the height, so it also copes with densities that are unbounded at the end of a funnel.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.density import Density, guesses
from bayesdeg.inference.importance import Proposal, about_mode, log_density
from bayesdeg.inference.laplace import (
    FEWEST_EFFECTIVE,
    Evidence,
    Laplace,
    approximate,
    bounded,
    effective_draws,
    evidence,
    find_mode,
    weighted,
)

Floats = NDArray[np.float64]

GUESSES = 400  # prior draws that determine the width of the wide law
PARTICLES, LEFT = (
    1000,
    0.5,
)  # size of the population, and share of effective draws left by each tempering step
WIDTH = 1.5  # width of the initial law of tempering, over that of prior draws
NORMAL_QUARTILES = 1.349  # between the quartiles of a normal law, in standard deviations
SWEEPS, ACCEPTED = 40, 4.0  # moves after each step: largest number, and mean number that suffices
JUMPS = 0.1  # share of moves by a whole difference, which jump between modes
JITTER = 1e-3  # jitter of a move, in standard deviations of the population, to avoid a lattice
STEPS = 200  # most tempering steps: a few dozen suffice


@dataclass(frozen=True)
class _Wide:
    """A normal law with independent parameters, the start of tempering."""

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
            "the posterior density is zero at all prior draws tried: priors and data "
            "contradict each other, or a prior excludes what the data show; widen the priors"
        )
    power, level = 0.0, 0.0
    for _ in range(STEPS):
        step = _next(values - base, power)
        log_weights = step * (values - base)
        level += float(logsumexp(log_weights) - np.log(PARTICLES))
        power += step
        # systematic resampling
        weights = np.exp(log_weights - logsumexp(log_weights))
        even = (np.arange(PARTICLES) + generator.random()) / PARTICLES
        kept = np.minimum(np.searchsorted(np.cumsum(weights), even), PARTICLES - 1)
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


def _moved(
    density: Density,
    wide: _Wide,
    state: tuple[Floats, Floats, Floats],
    power: float,
    generator: np.random.Generator,
) -> tuple[Floats, Floats, Floats]:
    """Move points by differences of pairs of the initial population, until most have moved."""
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


STARTS = 8  # mode searches
DRAWS = 500  # draws around each mode, for its share of the posterior
# fall of ln p between two modes that separates them: rough densities give half a unit, and a
# normal law falls by 2 over two standard deviations
VALLEY, ALONG = 2.0, 17
FEWEST = 50  # fewest particles for fitting a law; below, the mode's normal law is used
HIGHER = 0.5  # gain in log density of a further search above which the first had not converged
SMALLEST = 0.01  # share of the posterior below which a mode is not reported
NEGLIGIBLE = 20.0  # deficit in log evidence above which a mode is irrelevant


@dataclass(frozen=True)
class Mode:
    """One mode of a posterior.

    Parameters
    ----------
    laplace : Laplace
        Where it is, and the normal law that touches it there.
    weight, error : float
        Its share of the posterior, and the standard error of that [–].
    """

    laplace: Laplace
    weight: float
    error: float


@dataclass(frozen=True)
class Modes:
    """The separate modes of a posterior.

    Parameters
    ----------
    modes : tuple of Mode
        The largest share first; one where the posterior has one, none in a funnel without a top.
    posterior : Evidence
        Draws from all of them, to start `bayesdeg.inference.sampling.sample` from.
    tempered : bool
        Whether a population was tempered, since the climbs gave reason to.
    """

    modes: tuple[Mode, ...]
    posterior: Evidence
    tempered: bool


def find_modes(
    density: Density,
    generator: np.random.Generator,
    *,
    known: Sequence[Laplace] = (),
    starts: int = STARTS,
    executor: Executor | None = None,
) -> Modes:
    """Find separate modes and their shares, climbing from as many dispersed points as ``starts``.

    An executor climbs from them side by side; ``known`` modes are added as they are.
    """
    apply = map if executor is None else executor.map
    climbs = apply(partial(_climb, density), dispersed(density, generator, starts))
    tops = separate(density, [*known, *climbs])
    samples = [evidence(density, top, generator, draws=DRAWS) for top in tops]
    best = max((one.log_evidence for one in samples), default=0.0)
    worth = [k for k, one in enumerate(samples) if not one.log_evidence < best - NEGLIGIBLE]
    tops, samples = [tops[k] for k in worth], [samples[k] for k in worth]
    held = []
    for k, one in enumerate(samples):
        # about this mode alone, as the tails of others may add a few
        own = one.log_weights[nearest(one.draws, tops) == k]
        effective = effective_draws(own) if np.any(np.isfinite(own)) else 0.0
        if effective >= FEWEST_EFFECTIVE and not _goes_on(density, tops[k]):
            held.append(k)
    if len(tops) == 1 and not held and not _goes_on(density, tops[0]):
        # along a ridge a law fitted to its own draws may work where the mode's does not
        samples = [about_mode(density, tops[0], generator, enough=FEWEST_EFFECTIVE)]
        held = [0] if samples[0].effective >= FEWEST_EFFECTIVE else []
    if len(tops) == 1 and held:
        return Modes((Mode(tops[0], 1.0, 0.0),), samples[0], tempered=False)
    population, level = tempered(density, generator)
    return _weighed(density, [tops[k] for k in held], population, level, generator=generator)


def _climb(density: Density, start: Floats) -> Laplace:
    with threadpool_limits(limits=1):  # the same bits in any process
        return approximate(density, np.random.default_rng(0), start=start)


def _goes_on(density: Density, top: Laplace) -> bool:
    """Return whether a search ended at its limit, without a maximum, as in a funnel's neck."""
    mode, _ = find_mode(density, top.mode)
    return float(density.log_prob(mode[None])[0]) > top.log_density + HIGHER


def dispersed(density: Density, generator: np.random.Generator, count: int = STARTS) -> Floats:
    """Return starts (count, n_parameters): the most probable guess, then others far from those.

    Each is the most probable of the half of the guesses that is farthest from those before it.
    """
    points = guesses(density.table, generator, GUESSES)
    values = density.log_prob(points)
    points, values = points[np.isfinite(values)], values[np.isfinite(values)]
    if len(points) <= count:
        return points
    unit = spread(points)
    chosen = [int(np.argmax(values))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.linalg.norm((points - points[chosen[-1]]) / unit, axis=1)
        nearest = np.minimum(nearest, distance)
        far = np.flatnonzero(nearest >= np.median(nearest))
        chosen.append(int(far[np.argmax(values[far])]))
    return points[chosen]


def separate(density: Density, found: Sequence[Laplace]) -> list[Laplace]:
    """Return modes separated by a fall of the density, the highest first."""
    tops: list[Laplace] = []
    for one in sorted(found, key=lambda top: -top.log_density):
        if all(_valley(density, one.mode, other.mode) > VALLEY for other in tops):
            tops.append(one)
    return tops


def _valley(density: Density, first: Floats, second: Floats) -> float:
    """Return the fall of ln p along the line between two points, below the lower of them."""
    share = np.linspace(0.0, 1.0, ALONG)[:, None]
    along = bounded(density, first + share * (second - first))
    return float(min(along[0], along[-1]) - np.min(along))


def _weighed(
    density: Density,
    tops: Sequence[Laplace],
    population: Floats,
    level: float,
    *,
    generator: np.random.Generator,
) -> Modes:
    """Give each mode its share: by importance sampling, or by count of the population."""
    even, distinct = np.zeros(len(population)), len(np.unique(population, axis=0))
    posterior = Evidence(level, float("nan"), population, even, float(distinct))
    if not tops:
        return Modes((), posterior, tempered=True)
    sample = _mixture(density, tops, population, generator)
    if sample.effective >= len(tops) * FEWEST_EFFECTIVE:
        posterior = sample
    weights = np.exp(posterior.log_weights - logsumexp(posterior.log_weights))
    member = nearest(posterior.draws, tops)
    modes = []
    for k, top in enumerate(tops):
        inside = member == k
        share = float(np.sum(weights[inside]))
        error = float(np.sqrt(np.sum((weights * (inside - share)) ** 2)))
        modes.append(Mode(top, share, error))
    large = [mode for mode in modes if mode.weight >= SMALLEST]
    return Modes(tuple(sorted(large, key=lambda mode: -mode.weight)), posterior, tempered=True)


def nearest(points: Floats, tops: Sequence[Laplace]) -> NDArray[np.intp]:
    """Return the mode of each point (n, n_parameters), by the normal laws there, (n,)."""
    heights = []
    for top in tops:
        factor = np.linalg.cholesky(top.covariance)
        white = np.linalg.solve(factor, (points - top.mode).T)
        heights.append(-0.5 * np.sum(white**2, axis=0) - np.sum(np.log(np.diag(factor))))
    found: NDArray[np.intp] = np.argmax(heights, axis=0)
    return found


def _mixture(
    density: Density,
    tops: Sequence[Laplace],
    population: Floats,
    generator: np.random.Generator,
) -> Evidence:
    """Sample all modes by a mixture with one law per mode and equal shares of draws."""
    member = nearest(population, tops)
    size, laws = population.shape[1], []
    for k, top in enumerate(tops):
        points = population[member == k]
        if len(points) < max(FEWEST, 2 * size):
            factor = np.linalg.cholesky(top.covariance)
            points = top.mode + generator.standard_normal((PARTICLES, size)) @ factor.T
        laws.append(Proposal.fit(points))
    draws = [law.independent(np.zeros((PARTICLES, size)), generator)[0] for law in laws]
    points = np.concatenate(draws)
    each = [log_density(law, points) for law in laws]
    mixture = logsumexp(each, axis=0) - np.log(len(laws))
    return weighted(points, density.log_prob(points) - mixture)
