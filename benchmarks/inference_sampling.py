"""Effective draws per second of the package's sampler, of one walker at a time, and of NUTS."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import emcee
import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the peers are among the tests

from bayesdeg.inference.importance import FOR_WALKERS, Proposal
from bayesdeg.inference.laplace import Evidence
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain, Effort, moves_of, sample

Floats = NDArray[np.float64]
Moves = list[tuple[emcee.moves.Move, float]]


@dataclass(frozen=True)
class Sampled:
    """A chain and what it took.

    Parameters
    ----------
    chain : Chain
        Draws.
    seconds : float
        Of the processor, from the importance sample on, fitting of the moves included.
    """

    chain: Chain
    seconds: float

    @property
    def rate(self) -> float:
        """Smallest bulk effective sample size over all parameters, per second."""
        return float(np.min(self.chain.effective())) / self.seconds


def sampled(model: JointModel, start: Evidence, effort: Effort) -> Sampled:
    """Sample in this process, one ensemble after the other."""
    begin = time.process_time()
    chain = sample(model, start, effort=effort, seed=np.random.SeedSequence(1))
    return Sampled(chain, time.process_time() - begin)


@dataclass(frozen=True)
class Steps:
    """Steps of one ensemble from one state, one kind of call.

    Parameters
    ----------
    seconds : float
        Of the processor, for one step of all walkers.
    end : array, shape (n_walkers, n_parameters)
        Where they stand after the first steps.
    """

    seconds: float
    end: Floats


def moves_fitted_to(chain: Chain) -> Moves:
    """Return the sampler's moves, fitted to a chain."""
    draws = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return moves_of(Proposal.fit(draws, degrees=FOR_WALKERS))


def steps(model: JointModel, chain: Chain, *, batch: bool, count: int, compared: int) -> Steps:
    """Move an ensemble with the sampler's moves, its density asked for in either way."""
    begin = chain.vectors[0, -1]

    def alone(vector: Floats) -> float:
        return float(model.log_prob(vector[None])[0])

    sampler = emcee.EnsembleSampler(
        *begin.shape,
        model.log_prob if batch else alone,
        vectorize=batch,
        moves=moves_fitted_to(chain),
    )
    sampler.random_state = np.random.RandomState(np.random.MT19937(7)).get_state(legacy=True)
    state = sampler.run_mcmc(begin, 1, skip_initial_state_check=True)  # all is compiled and cached
    clock = time.process_time()
    sampler.run_mcmc(state, count, skip_initial_state_check=True)
    seconds = (time.process_time() - clock) / count
    return Steps(seconds, sampler.get_chain()[compared])


def loop(model: JointModel, chain: Chain) -> dict[str, Any]:
    """Compare steps of whole ensembles with steps of one walker at a time, the same moves."""
    whole = steps(model, chain, batch=True, count=60, compared=8)
    single = steps(model, chain, batch=False, count=8, compared=8)
    return {
        "ratio": single.seconds / whole.seconds,
        "seconds_a_step_of_all_at_once": whole.seconds,
        "seconds_a_step_of_one_at_a_time": single.seconds,
        "walkers": len(whole.end),
        "largest_difference_after_8_steps": float(np.max(np.abs(whole.end - single.end))),
    }


def default_moves(model: JointModel, chain: Chain, *, count: int = 400) -> float:
    """Return effective draws a step of emcee's own default move, from the posterior."""
    begin = chain.vectors[0, -1]
    sampler = emcee.EnsembleSampler(*begin.shape, model.log_prob, vectorize=True)
    sampler.random_state = np.random.RandomState(np.random.MT19937(8)).get_state(legacy=True)
    sampler.run_mcmc(begin, count, skip_initial_state_check=True)
    lines = np.swapaxes(sampler.get_chain(), 0, 1)
    return min(_bulk(lines[..., i]) for i in range(lines.shape[-1])) / count


def nuts(model: JointModel, chain: Chain, *, draws: int) -> dict[str, Any]:
    """Sample the same density by numpyro's NUTS, from the posterior, with its covariance."""
    from tests.peers import numpyro_process  # noqa: PLC0415  needs the group `dev`

    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    found = numpyro_process.nuts(
        model, flat[-1], np.cov(flat, rowvar=False), warmup=50, draws=draws, seed=1
    )
    effective = min(_bulk(column[None]) for column in found["vectors"].T)
    return {
        "ess_per_second": effective / found["seconds"],
        "effective": effective,
        "draws": draws,
        "seconds": found["seconds"],
        "wall_seconds": found["wall_seconds"],
        "divergent": found["divergent"],
        "gradients_per_effective_draw": found["gradients"] / effective,
        "densities_per_gradient": 1 + 2 * flat.shape[1],
    }


def _bulk(lines: Floats) -> float:
    return float(array_stats.ess(lines, method="bulk"))
