"""emcee over independent ensembles, and the one place where a chain becomes a DataTree."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from itertools import count

import emcee
import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.inference.chain import EFFORTS, Chain, Effort, Standing
from bayesdeg.inference.chain_store import (
    ChainStore,
    NoStore,
    Piece,
    Position,
    RandomState,
    Task,
)
from bayesdeg.inference.density import Density
from bayesdeg.inference.laplace import Evidence
from bayesdeg.inference.model import Model
from bayesdeg.inference.proposals import FOR_WALKERS, Proposal
from bayesdeg.inference.refusals import CountedDensity, Refusals
from bayesdeg.inference.start import Start, start_of
from bayesdeg.inference.tree import (
    Groups,
    add_likelihoods,
    add_observations,
    label_observations,
    observation_axes,
    with_one_likelihood,
)

__all__ = ["EFFORTS", "Chain", "Effort", "Standing", "sample", "to_datatree"]

Floats = NDArray[np.float64]

# shares of the steps; chosen by benchmarks/sampler_moves.py. Independent proposals are worth most
# where the posterior is nearly the fitted law; differential evolution gets through where it is not
INDEPENDENT, DIFFERENTIAL = 0.8, 0.2
# accepted share from which fitting the moves once is enough: a better law would not gain the steps
# that a further period costs
SERVED = 0.2


def sample(
    density: Density,
    start: Evidence,
    *,
    effort: Effort,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_chunk: Callable[[Standing], None] | None = None,
    store: ChainStore | None = None,
) -> Chain:
    """Sample a posterior with independent ensembles until the effort's criteria are met.

    Walkers start from draws of the posterior's importance sample, each ensemble from its own. Most
    moves are independent proposals from a law that is fitted to the draws of all ensembles; the
    others are differential evolution, which needs no fit. The law is fitted anew before each
    period of the effort and stays as it is within it; where the start has many effective draws and
    their law served well already, the second period is the last. Only draws of the last period are
    kept, so that detailed balance holds for all of them. The same seed gives the same chain
    whatever the executor, the threads, and what the store held before.

    A posterior of several separate modes is explored about the one that the start knows of.

    Parameters
    ----------
    density : Density
        Evaluated for a whole ensemble, or half of one, at once.
    start : Evidence
        Importance sample to start from.
    effort : Effort
        Criteria.
    seed : SeedSequence
        Every ensemble gets its own child.
    executor : Executor, optional
        Runs the ensembles side by side.
    on_chunk : callable, optional
        Called with the standing after every look.
    store : ChainStore, optional
        Keeps what was done, and gives it back to a run that was interrupted.

    Raises
    ------
    BayesdegError
        If the density is zero wherever the sampler could start.
    """
    run = partial(_run, density, executor, store or NoStore())
    # one thread: the same sums in the same order, hence the same bits, in whatever process
    with threadpool_limits(limits=1):
        first, *others = seed.spawn(1 + effort.ensembles)
        begun = start_of(density, start, np.random.default_rng(first))
        positions = [_first(density, begun, child) for child in others]
        proposal, asked, standing = begun.proposal, Refusals(), Standing()
        numbers, period = count(), 0
        while True:
            looks = effort.periods(settled=standing.settled)[period]
            pieces: list[list[Piece]] = [[] for _ in positions]
            for look in looks:
                done, resumed = run(next(numbers), [Task(p, proposal, look) for p in positions])
                positions = [piece.end for piece in done]
                asked = sum((piece.refusals for piece in done), start=asked)
                for history, piece in zip(pieces, done, strict=True):
                    history.append(piece)
                chain = _joined(pieces, asked)
                standing = Standing(
                    standing.steps + look,
                    resumed=standing.resumed + resumed,
                    settled=standing.settled,
                )
                if period > 0:
                    standing = chain.judged(standing)
                if on_chunk is not None:
                    on_chunk(standing)
                if standing.enough(effort) or standing.steps >= effort.longest:
                    return chain
            served = float(np.min(chain.acceptance)) >= SERVED
            if period == 0:
                standing = replace(standing, settled=served and begun.faithful)
            proposal, period = _fitted(chain, served=served), period + 1


def to_datatree(density: Density, chain: Chain, generator: np.random.Generator) -> xr.DataTree:
    """Return the chain as an arviz DataTree.

    Groups: ``posterior`` (named parameters, in the users' units), ``sample_stats`` (``lp``); of a
    ``Model`` also ``log_likelihood`` (``joint``: all that was read on each specimen, for
    ``arviz.loo``; as coordinates its parts: each reading given those before it on its specimen,
    and whole specimens by kind of data), ``posterior_predictive``, ``observed_data``,
    ``constant_data``. Chains are ensembles.
    """
    ensembles, steps, walkers, size = chain.vectors.shape
    shape = (ensembles, steps * walkers)
    # walker by walker, so that neighbours in the tree are as much alike as the chain's own steps
    values = density.table.named(np.swapaxes(chain.vectors, 1, 2).reshape(-1, size))
    groups: Groups = {
        "posterior": {name: v.reshape(shape) for name, v in values.items()},
        "sample_stats": {"lp": np.swapaxes(chain.log_prob, 1, 2).reshape(shape)},
    }
    if not isinstance(density, Model):
        plain: xr.DataTree = from_dict(groups)
        return plain
    coords, dims = add_likelihoods(density, density.log_likelihood(values), groups, shape=shape)
    if density.actuator is not None:
        add_observations(density, values, generator, groups=groups, shape=shape)
        further, along = observation_axes(density)
        coords |= further
        dims |= along
    tree: xr.DataTree = from_dict(groups, coords=coords, dims=dims)
    tree = tree if density.actuator is None else label_observations(tree, density)
    return with_one_likelihood(tree)


def _first(density: Density, start: Start, seed: np.random.SeedSequence) -> Position:
    walkers = max(40, 2 * len(density.table) + 2)
    vectors = start.walkers(density, np.random.default_rng(seed), walkers)
    state = np.random.RandomState(np.random.MT19937(seed)).get_state(legacy=True)
    return Position(vectors, density.log_prob(vectors), RandomState(*state[1:]))


def _run(
    density: Density,
    executor: Executor | None,
    store: ChainStore,
    number: int,
    tasks: Sequence[Task],
) -> tuple[list[Piece], int]:
    """Do the tasks of all ensembles, but for those whose pieces are kept.

    Returns also how many steps there was nothing to do for.
    """
    keys = [task.key() for task in tasks]
    pieces = {i: piece for i, k in enumerate(keys) if (piece := store.load(i, number, k))}
    missing = [i for i in range(len(tasks)) if i not in pieces]
    apply = map if executor is None else executor.map
    done = apply(partial(advance, density), [tasks[i] for i in missing])
    for i, piece in zip(missing, done, strict=True):
        store.save(i, number, keys[i], piece)
        pieces[i] = piece
    return [pieces[i] for i in range(len(tasks))], 0 if missing else tasks[0].steps


def advance(density: Density, task: Task) -> Piece:
    """Let one ensemble do a task: the same bits in whatever process."""
    walkers, size = task.position.vectors.shape
    counted = CountedDensity(density)
    sampler = emcee.EnsembleSampler(
        walkers, size, counted, vectorize=True, moves=moves_of(task.proposal)
    )
    begin = emcee.State(
        task.position.vectors,
        log_prob=task.position.log_prob,
        random_state=task.position.random.legacy(),
    )
    with threadpool_limits(limits=1):
        sampler.run_mcmc(begin, task.steps, skip_initial_state_check=True)
    return Piece(
        sampler.get_chain(),
        sampler.get_log_prob(),
        float(np.mean(sampler.acceptance_fraction)),
        counted.refusals,
        RandomState(*sampler.random_state[1:]),
    )


def moves_of(proposal: Proposal) -> list[tuple[emcee.moves.Move, float]]:
    """Return the moves that sampling makes, with their shares of the steps."""
    return [
        (emcee.moves.MHMove(proposal.independent), INDEPENDENT),
        (emcee.moves.DEMove(), DIFFERENTIAL),
    ]


def _fitted(chain: Chain, *, served: bool) -> Proposal:
    """Fit a law to a period; walkers sent about by a poor one are still on their way at first."""
    vectors = chain.vectors if served else chain.vectors[:, chain.vectors.shape[1] // 2 :]
    return Proposal.fit(vectors.reshape(-1, vectors.shape[-1]), degrees=FOR_WALKERS)


def _joined(history: list[list[Piece]], asked: Refusals) -> Chain:
    vectors = np.stack([np.concatenate([p.vectors for p in pieces]) for pieces in history])
    log_prob = np.stack([np.concatenate([p.log_prob for p in pieces]) for pieces in history])
    steps = [len(p.vectors) for p in history[0]]
    acceptance = np.array(
        [np.average([p.acceptance for p in pieces], weights=steps) for pieces in history]
    )
    return Chain(vectors, log_prob, acceptance, asked)
