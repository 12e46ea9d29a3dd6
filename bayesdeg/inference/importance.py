"""A better importance sample from a poor one: proposals are fitted to its weighted draws."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import gammaln, logsumexp

from bayesdeg.inference.density import Density
from bayesdeg.inference.laplace import (
    POOR,
    Evidence,
    Laplace,
    effective_draws,
    evidence,
    weighted,
    with_exact_curvature,
)
from bayesdeg.inference.proposals import Proposal

Floats = NDArray[np.float64]

ENOUGH, DRAWS = 300.0, 1000  # effective draws wanted about a mode, and draws of each round
MOST = 4000  # draws about a mode before a better proposal is fitted to them
FITTED = 2000  # draws that a proposal is fitted to
WIDER = 1.3  # than the fit: what the draws so far did not reach has to be found
LEAST = 20.0  # effective draws for each parameter that a proposal is fitted to


def about_mode(
    density: Density, laplace: Laplace, generator: np.random.Generator, *, enough: float = ENOUGH
) -> Evidence:
    """Return an importance sample of a posterior whose mode is known, `improved` where it is poor.

    Parameters
    ----------
    density, laplace : Density, Laplace
        What is sampled, and its mode.
    generator : Generator
        Draws the proposals.
    enough : float
        Effective draws wanted.
    """
    found = evidence(density, laplace, generator, draws=MOST, enough=enough)
    if found.effective >= enough:
        return found
    if found.effective < POOR * len(found.draws):  # expected curvature may mislead, as of ruptures
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
    """Return an importance sample of enough effective draws, if that can be had.

    Each round fits a Student law with warped marginals to the weighted draws so far, and draws
    from it; all draws are then weighted by the mixture of all those laws. Where few draws carry the
    weight, weights are flattened before a law is fitted, lest it narrow down on those few.

    Parameters
    ----------
    density : Density
        What is sampled.
    posterior : Evidence
        Draws and weights to begin with; they serve the first fit alone.
    generator : Generator
        Draws the proposals.
    draws : int
        Of each round.
    enough : float
        Effective draws at which no further round is made.
    rounds : int
        At most.

    Returns
    -------
    Evidence
        With −inf where no draw is possible.

    References
    ----------
    Cornuet, Marin, Mira and Robert (2012), doi:10.1111/j.1467-9469.2011.00756.x.
    """
    laws: list[Proposal] = []
    known = posterior
    points, densities = np.empty((0, len(density.table))), np.empty(0)
    found = posterior
    for _ in range(rounds if posterior.effective > 0.0 else 0):
        laws.append(_wide(Proposal.fit(_flattened(known).resample(generator, FITTED))))
        more, _ = laws[-1].independent(np.zeros((draws, points.shape[1])), generator)
        points = np.concatenate([points, more])
        densities = np.concatenate([densities, density.log_prob(more)])
        mixture = logsumexp([log_density(law, points) for law in laws], axis=0) - np.log(len(laws))
        found = replace(weighted(points, densities - mixture), log_densities=densities)
        if not np.isfinite(found.log_evidence) or found.effective >= enough:
            break
        known = found
    return found


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


def _wide(law: Proposal) -> Proposal:
    return replace(law, factor=WIDER * law.factor, whitening=law.whitening / WIDER)


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
