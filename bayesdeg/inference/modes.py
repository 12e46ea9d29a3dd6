"""Separate modes of a posterior: whether there are several, and what share of it each holds.

Climbs from dispersed starts cost little and tell whether to look closer: where they end on
different tops, or on one about which hardly any of the posterior lies, a population is tempered
from a wide law to the posterior. It follows the mass, not the height, so it also copes with
densities that are unbounded at the end of a funnel.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from bayesdeg.inference.density import Density, guesses
from bayesdeg.inference.importance import log_density
from bayesdeg.inference.laplace import (
    FEWEST_EFFECTIVE,
    Evidence,
    Laplace,
    approximate,
    effective_draws,
    evidence,
    weighted,
)
from bayesdeg.inference.mode import bounded, find_mode
from bayesdeg.inference.proposals import Proposal
from bayesdeg.inference.tempering import GUESSES, PARTICLES, spread, tempered

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]

STARTS = 8  # climbs
DRAWS = 500  # about each mode, to see how much of the posterior lies there
# fall of ln p between two tops that makes them two: half a unit comes of rough densities, and a
# normal law falls by 2 over two standard deviations
VALLEY, ALONG = 2.0, 17
FEWEST = 50  # particles that a law is fitted to; below, the mode's normal law is taken
HIGHER = 0.5  # gain in log density of a further climb, by which the first had not arrived
SMALLEST = 0.01  # share of the posterior below which a mode is not spoken of


@dataclass(frozen=True)
class Mode:
    """One top of a posterior and what belongs to it.

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
    """What was found of the separate modes of a posterior.

    Parameters
    ----------
    modes : tuple of Mode
        The largest share first; one where the posterior has one, none in a funnel without a top.
    posterior : Evidence
        Draws from all of them, to start `bayesdeg.inference.ensemble.sample` from.
    tempered : bool
        Whether a population was tempered, since the climbs gave reason to.
    """

    modes: tuple[Mode, ...]
    posterior: Evidence
    tempered: bool

    @property
    def warning(self) -> str:
        """A sentence for the report where there are several; else empty.

        Examples
        --------
        >>> top = Laplace(np.zeros(1), np.eye(1), 0.0)
        >>> nothing = Evidence(0.0, 0.0, np.zeros((1, 1)), np.zeros(1), 1.0)
        >>> Modes((Mode(top, 0.7, 0.01), Mode(top, 0.3, 0.01)), nothing, True).warning
        'Several modes: the posterior has 2 separate ones, with shares of 70 % and 30 %.'
        """
        return words([mode.weight for mode in self.modes])


def words(shares: Sequence[float]) -> str:
    """Say that there are several modes, with their shares; nothing of a single one.

    Examples
    --------
    >>> words([1.0])
    ''
    """
    if len(shares) < 2:
        return ""
    *first, last = (f"{100.0 * share:.0f} %" for share in shares)
    return (
        f"Several modes: the posterior has {len(shares)} separate ones, with shares of "
        f"{', '.join(first)} and {last}."
    )


def find_modes(
    density: Density,
    generator: np.random.Generator,
    *,
    known: Sequence[Laplace] = (),
    starts: int = STARTS,
    executor: Executor | None = None,
) -> Modes:
    """Look for separate modes, and weigh them.

    Parameters
    ----------
    density : Density
        Posterior up to a constant.
    generator : Generator
        Draws starts and the population.
    known : sequence of Laplace
        Modes that are known already.
    starts : int
        Climbs.
    executor : Executor, optional
        Runs the climbs side by side.
    """
    apply = map if executor is None else executor.map
    climbs = apply(partial(_climb, density), dispersed(density, generator, starts))
    tops = separate(density, [*known, *climbs])
    samples = [evidence(density, top, generator, draws=DRAWS) for top in tops]
    held = [
        k
        for k, one in enumerate(samples)
        if _about(one, tops, k) >= FEWEST_EFFECTIVE and not _goes_on(density, tops[k])
    ]
    if len(tops) == 1 and held:
        return Modes((Mode(tops[0], 1.0, 0.0),), samples[0], tempered=False)
    population, level = tempered(density, generator)
    return _weighed(density, [tops[k] for k in held], population, level, generator=generator)


def _climb(density: Density, start: Floats) -> Laplace:
    with threadpool_limits(limits=1):  # the same bits in whatever process
        return approximate(density, np.random.default_rng(0), start=start)


def _goes_on(density: Density, top: Laplace) -> bool:
    """Return whether a climb ended because it was long: there is no top, as in a funnel's neck."""
    mode, _ = find_mode(density, top.mode)
    return float(density.log_prob(mode[None])[0]) > top.log_density + HIGHER


def _about(sample: Evidence, tops: Sequence[Laplace], which: int) -> float:
    """Return the effective draws of those about one top: of others a tail may hit a few."""
    own = sample.log_weights[nearest(sample.draws, tops) == which]
    return effective_draws(own) if np.any(np.isfinite(own)) else 0.0


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
    """Return those between which the density falls, the highest first; of others the highest."""
    tops: list[Laplace] = []
    for one in sorted(found, key=lambda top: -top.log_density):
        if all(_valley(density, one.mode, other.mode) > VALLEY for other in tops):
            tops.append(one)
    return tops


def _valley(density: Density, first: Floats, second: Floats) -> float:
    """Return how far ln p falls along the line between two points, below the lower of them."""
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
    posterior = _of_population(population, level)
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


def nearest(points: Floats, tops: Sequence[Laplace]) -> Whole:
    """Return to which mode each point (n, n_parameters) belongs, by the normal laws there, (n,)."""
    heights = []
    for top in tops:
        factor = np.linalg.cholesky(top.covariance)
        white = np.linalg.solve(factor, (points - top.mode).T)
        heights.append(-0.5 * np.sum(white**2, axis=0) - np.sum(np.log(np.diag(factor))))
    found: Whole = np.argmax(heights, axis=0)
    return found


def _mixture(
    density: Density,
    tops: Sequence[Laplace],
    population: Floats,
    generator: np.random.Generator,
) -> Evidence:
    """Sample all modes by a mixture of laws, one a mode, with equal shares of the draws."""
    member = nearest(population, tops)
    laws = [_law(population[member == k], top, generator) for k, top in enumerate(tops)]
    size = population.shape[1]
    draws = [law.independent(np.zeros((PARTICLES, size)), generator)[0] for law in laws]
    points = np.concatenate(draws)
    each = [log_density(law, points) for law in laws]
    mixture = logsumexp(each, axis=0) - np.log(len(laws))
    return weighted(points, density.log_prob(points) - mixture)


def _law(points: Floats, top: Laplace, generator: np.random.Generator) -> Proposal:
    if len(points) >= max(FEWEST, 2 * points.shape[1]):
        return Proposal.fit(points)
    factor = np.linalg.cholesky(top.covariance)
    return Proposal.fit(top.mode + generator.standard_normal((PARTICLES, len(factor))) @ factor.T)


def _of_population(population: Floats, level: float) -> Evidence:
    even = np.zeros(len(population))
    distinct = float(len(np.unique(population, axis=0)))
    return Evidence(level, float("nan"), population, even, distinct)
