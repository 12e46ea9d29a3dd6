"""Which moves of the sampler give the most effective draws for a density that is asked for?

Walkers start from the posterior, and fitted moves have their law from other draws of it, as within
a period of the sampler. Counted are evaluations of the density, since these are what takes time.

    uv run python benchmarks/sampler_moves.py [--json]
"""

import argparse
import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import emcee
import numpy as np
from arviz_stats.base import array_stats
from forward_case import say
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.fit.linear import with_neutral
from bayesdeg.data.study import read_study
from bayesdeg.inference.density import Density
from bayesdeg.inference.importance import FOR_WALKERS, Proposal, Warp
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.sampling import Chain, Effort, sample

Floats = NDArray[np.float64]
Moves = list[tuple[emcee.moves.Move, float]]

STUDY = Path("studies/gelatin_actuator")
CAUSE = "pressure_offset"  # which the study's verdict names
BEFORE = Effort(effective=1500.0, r_hat=1.01, chunk=50, longest=1500)
STEPS = 400


@dataclass(frozen=True)
class Measured:
    """Of one mixture of moves; effective draws for a thousand evaluations."""

    smallest: float
    median: float
    tail: float
    acceptance: float
    slowest: str


def normal_law(draws: Floats) -> Proposal:
    """Return the Student law of mean and covariance alone, without bent marginals."""
    size = draws.shape[1]
    nothing = Warp(np.zeros(size), np.full(size, 1e8), np.zeros(size), np.ones(size))
    covariance = np.cov(draws, rowvar=False) * 1e-16
    factor = np.linalg.cholesky(covariance)
    mean = 1e-8 * draws.mean(axis=0)
    return Proposal(nothing, mean, factor, np.linalg.inv(factor), FOR_WALKERS)


def local(
    law: Proposal, share: float, vectors: Floats, random: np.random.RandomState
) -> tuple[Floats, Floats]:
    """Propose positions near the walkers, in a way that would keep the law itself.

    The Crank–Nicolson step of a Student law, x' = √(1 − ρ²) x + ρ ξ/√g in white coordinates, with
    ξ normal and g from the gamma law that x implies. Source: Grumitt, Karamanis and Seljak (2024),
    doi:10.48550/arXiv.2407.07781.
    """
    here = law.white(vectors)[0]
    shape = 0.5 * (FOR_WALKERS + here.shape[1])
    rate = 0.5 * (FOR_WALKERS + np.sum(here**2, axis=-1))
    precision = random.standard_gamma(shape, len(here)) / rate
    noise = random.standard_normal(here.shape) / np.sqrt(precision)[:, None]
    proposed = law.original(np.sqrt(1.0 - share**2) * here + share * noise)
    return proposed, law.log_density(vectors) - law.log_density(proposed)


def mixtures(law: Proposal, straight: Proposal) -> dict[str, Moves]:
    """Return moves by what the table calls them."""
    differential, stretch = emcee.moves.DEMove(), emcee.moves.StretchMove()
    snooker, walk = emcee.moves.DESnookerMove(), emcee.moves.WalkMove()
    independent = emcee.moves.MHMove(law.independent)

    def near(share: float) -> emcee.moves.Move:
        return emcee.moves.MHMove(partial(local, law, share))

    return {
        "stretch": [(stretch, 1.0)],
        "walk": [(walk, 1.0)],
        "differential evolution": [(differential, 1.0)],
        "differential evolution 0.8, stretch 0.2": [(differential, 0.8), (stretch, 0.2)],
        "differential evolution 0.8, snooker 0.2": [(differential, 0.8), (snooker, 0.2)],
        "independent, normal marginals": [(emcee.moves.MHMove(straight.independent), 1.0)],
        "local 0.3": [(near(0.3), 1.0)],
        "local 0.5": [(near(0.5), 1.0)],
        "local 0.9": [(near(0.9), 1.0)],
        "independent": [(independent, 1.0)],
        "independent 0.8, differential evolution 0.2": [(independent, 0.8), (differential, 0.2)],
        "independent 0.6, local 0.2, differential evolution 0.2": [
            (independent, 0.6),
            (near(0.5), 0.2),
            (differential, 0.2),
        ],
        "independent 0.5, differential evolution 0.5": [(independent, 0.5), (differential, 0.5)],
    }


def measured(density: Density, moves: Moves, begin: Floats) -> Measured:
    """Return what a mixture is worth from these walkers (n_walkers, n_parameters)."""
    walkers, size = begin.shape
    sampler = emcee.EnsembleSampler(walkers, size, density.log_prob, vectorize=True, moves=moves)
    sampler.random_state = np.random.RandomState(np.random.MT19937(7)).get_state(legacy=True)
    sampler.run_mcmc(begin, STEPS, skip_initial_state_check=True)
    lines = np.swapaxes(sampler.get_chain(), 0, 1)
    bulk, tail = (
        [array_stats.ess(lines[:, :, i], method=method, prob=prob) for i in range(size)]
        for method, prob in (("bulk", None), ("tail", 0.9))
    )
    per = 1000.0 / (STEPS * walkers)
    return Measured(
        per * min(bulk),
        per * float(np.median(bulk)),
        per * min(tail),
        float(np.mean(sampler.acceptance_fraction)),
        density.table.names[int(np.argmin(bulk))],
    )


def before(density: Density, hint: Floats | None = None) -> Chain:
    """Sample the posterior as the pipeline does."""
    generator = np.random.default_rng(1)
    start = evidence(density, approximate(density, generator, start=hint), generator)
    return sample(density, start, effort=BEFORE, seed=np.random.SeedSequence(2))


def table(density: Density, chain: Chain) -> dict[str, Measured]:
    """Return what each mixture is worth; walkers from one ensemble, laws from the others."""
    begin = chain.vectors[0, -1]
    others = chain.vectors[1:].reshape(-1, chain.vectors.shape[-1])
    candidates = mixtures(Proposal.fit(others, degrees=FOR_WALKERS), normal_law(others))
    return {name: measured(density, moves, begin) for name, moves in candidates.items()}


def posteriors() -> dict[str, tuple[Density, Chain]]:
    """Return the gelatin study's base model, and that with the cause that its verdict names."""
    base, cause = assemble(read_study(STUDY)).model, find(CAUSE)
    chain = before(base)
    extended = base.extended(cause)
    best = chain.vectors[0, -1, int(np.argmax(chain.log_prob[0, -1]))]
    hint = with_neutral(best, base, extended)
    return {"base": (base, chain), f"base+{CAUSE}": (extended, before(extended, hint))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print figures as JSON last")
    wanted = parser.parse_args()
    figures = {}
    with threadpool_limits(limits=1):
        for name, (density, chain) in posteriors().items():
            say(f"{name}: {len(density.table)} parameters")
            say("effective draws for 1000 evaluations: smallest, median, tails; accepted")
            figures[name] = table(density, chain)
            for label, m in figures[name].items():
                say(
                    f"{m.smallest:8.1f} {m.median:8.1f} {m.tail:8.1f} {m.acceptance:8.2f}  "
                    f"{label} (slowest: {m.slowest})"
                )
    if wanted.json:
        plain = {name: {k: vars(m) for k, m in rows.items()} for name, rows in figures.items()}
        print(json.dumps(plain, indent=2))


if __name__ == "__main__":
    main()
