"""Where walkers begin: draws of an importance sample, made regular where they are not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.density import Density
from bayesdeg.inference.laplace import Evidence, effective_draws
from bayesdeg.inference.proposals import FOR_WALKERS, Proposal

Floats = NDArray[np.float64]

FEWEST_A_PARAMETER = 10.0  # effective draws, at least
FITTED = 4000  # draws that the first law is fitted to
PLANE = 1e-9  # least singular value over the largest of draws that fill the space
JITTERS = (0.1, 0.01, 1e-3, 1e-5)  # of walkers, in standard deviations, the first that is possible
DROP = 2.0  # of log density, by which the width of a parameter is found
WIDENED = 2000  # draws about a single point


@dataclass(frozen=True)
class Start:
    """Equally weighted draws that fill the space, and a law fitted to them.

    Parameters
    ----------
    draws : array, shape (n, n_parameters)
        Possible vectors, some more than once.
    proposal : Proposal
        Law of the draws.
    faithful : bool
        Whether the draws are of the posterior itself, not of something wider or narrower.
    """

    draws: Floats
    proposal: Proposal
    faithful: bool = False

    def walkers(self, density: Density, generator: np.random.Generator, count: int) -> Floats:
        """Return possible vectors (count, n_parameters), all different, in no plane.

        They are draws, jittered by a tenth of their spread, or less where that is impossible.
        """
        chosen = self.draws[generator.integers(len(self.draws), size=count)]
        vectors, left = chosen.copy(), np.ones(count, dtype=bool)
        for width in JITTERS:
            vectors[left] = self.proposal.jittered(chosen[left], generator, width=width)
            left = ~np.isfinite(density.log_prob(vectors))
            if not left.any():
                break
        vectors[left] = chosen[left]
        return vectors


def start_of(density: Density, importance: Evidence, generator: np.random.Generator) -> Start:
    """Return where to start from an importance sample.

    Where that has few effective draws its log weights are multiplied by a number below 1: the
    draws are then those of a law between proposal and posterior. Where its draws lie in a plane,
    or are a single point, they are replaced by draws about the best, as wide in each parameter as
    the density is there.

    Raises
    ------
    BayesdegError
        If the density is zero at all draws.
    """
    possible = np.isfinite(importance.log_weights)
    if not possible.any():
        raise BayesdegError(
            "the posterior density is zero at every starting point: priors and data contradict "
            "each other, or a prior leaves out what the data show; widen the priors"
        )
    draws, log_weights = importance.draws[possible], importance.log_weights[possible]
    wanted = FEWEST_A_PARAMETER * draws.shape[1]
    weights = _tempered(log_weights, wanted)
    chosen = draws[generator.choice(len(draws), FITTED, p=weights)]
    if lie_in_a_plane(chosen):
        chosen = _widened(density, draws, generator)
        return Start(chosen, Proposal.fit(chosen, degrees=FOR_WALKERS))
    faithful = effective_draws(log_weights) >= wanted
    return Start(chosen, Proposal.fit(chosen, degrees=FOR_WALKERS), faithful)


def lie_in_a_plane(draws: Floats) -> bool:
    """Return whether draws (n, n_parameters) leave a direction of the space out.

    Examples
    --------
    >>> line = np.linspace(0.0, 1.0, 5)
    >>> lie_in_a_plane(np.column_stack([line, 2.0 * line])), lie_in_a_plane(line[:, None])
    (True, False)
    """
    deviation = draws - np.mean(draws, axis=0)
    # rounding of the mean leaves something of a constant
    constant = np.ptp(draws, axis=0) <= 1e-14 * np.max(np.abs(draws), axis=0)
    if constant.any():
        return True
    values = np.linalg.svd(deviation / np.std(deviation, axis=0), compute_uv=False)
    return len(values) < draws.shape[1] or bool(values[-1] <= PLANE * values[0])


def _tempered(log_weights: Floats, wanted: float) -> Floats:
    wanted = min(wanted, 0.5 * len(log_weights))
    power = 1.0
    while effective_draws(power * log_weights) < wanted:
        power *= 0.9
    weights: Floats = np.exp(power * log_weights - logsumexp(power * log_weights))
    return weights


def _widened(density: Density, draws: Floats, generator: np.random.Generator) -> Floats:
    """Draw about the best of some vectors, as wide in each parameter as the density is."""
    values = density.log_prob(draws)
    best = draws[int(np.argmax(values))]
    size, top = len(best), float(np.max(values))
    steps = 10.0 ** np.arange(-10.0, 2.5, 0.5)
    moves = (steps[:, None, None] * np.eye(size)).reshape(-1, size)
    sides = density.log_prob(np.vstack([best + moves, best - moves])).reshape(2, len(steps), size)
    inside = np.all(sides >= top - DROP, axis=0)
    # the last step before the density falls for the first time
    reach = np.argmin(np.vstack([inside, np.zeros(size, dtype=bool)]), axis=0)
    width = steps[np.maximum(reach - 1, 0)] / np.sqrt(size)
    around = best + 0.5 * width * generator.standard_normal((WIDENED, size))
    possible: Floats = around[np.isfinite(density.log_prob(around))]
    if len(possible) <= size or lie_in_a_plane(possible):
        raise BayesdegError(
            "the posterior density is zero all about its best starting point: a parameter is held "
            "by the data or a prior to a single value; give it a wider prior"
        )
    return possible
