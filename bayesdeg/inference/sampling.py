"""Sampling with independent ensembles until convergence criteria are met."""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from typing import Protocol, Self

import emcee
import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.density import Density
from bayesdeg.inference.importance import FOR_WALKERS, Proposal
from bayesdeg.inference.laplace import Evidence, effective_draws
from bayesdeg.inference.model import CountedDensity, Refusals

Floats = NDArray[np.float64]

LONGEST_LOOK = 8  # most steps between checks, in units of the first period


@dataclass(frozen=True)
class Effort:
    """Limits and convergence criteria of sampling.

    Parameters
    ----------
    effective : float
        Effective sample size required in every parameter.
    r_hat : float
        Largest acceptable rank-normalised split R̂ across ensembles.
    chunk, longest : int
        Steps of the first period and up to the first check of the chain, and most steps, at least
        two.
    ensembles, kept : int
        Independent ensembles, and draws kept of each.
    times : float
        Autocorrelation times required of every walker. Without it, as many walkers as required
        effective draws would suffice without moving.
    starts : int
        Dispersed starts of the search for separate modes before sampling.
    """

    effective: float
    r_hat: float
    chunk: int
    longest: int
    ensembles: int = 4
    kept: int = 500
    times: float = 5.0
    starts: int = 0

    def periods(self, *, settled: bool = False) -> tuple[tuple[int, ...], ...]:
        """Return the steps up to each check of the chain, period by period.

        Moves are refitted before each period to the draws of the previous one, and only draws of
        the last period are kept, so each period is twice as long as the previous one. The first is
        only for fitting. The last continues to the limit.

        Parameters
        ----------
        settled : bool
            Whether the moves of the first period performed well: then the second is the last.

        Examples
        --------
        >>> effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
        >>> effort.periods()
        ((50,), (50, 50), (100, 100), (200, 200, 200, 50))
        >>> effort.periods(settled=True)[1][:6]
        (25, 25, 25, 25, 25, 31)
        >>> Effort(effective=400.0, r_hat=1.01, chunk=10, longest=20).periods()
        ((10,), (10,))
        """
        first = min(self.chunk, max(1, self.longest // 2))
        most, left = LONGEST_LOOK * first, self.longest - first
        if settled:  # a check whenever the chain is a quarter longer than at the last
            looks: list[int] = []
            while (done := sum(looks)) < left:
                looks.append(min(max(1, first // 2, done // 4), most, left - done))
            return (first,), tuple(looks)
        lengths = [first]
        while left >= 2 * lengths[-1]:
            lengths.append(2 * lengths[-1])
            left -= lengths[-1]
        if len(lengths) == 1:
            lengths.append(0)
        lengths[-1] += left
        periods = []
        for k, length in enumerate(lengths):
            look = min(first * 2 ** max(k - 1, 0), most)
            whole, rest = divmod(length, look)
            periods.append((look,) * whole + (rest,) * (rest > 0))
        return tuple(periods)


EFFORTS = {
    "quick": Effort(effective=150.0, r_hat=1.05, chunk=25, longest=1200),
    "standard": Effort(effective=400.0, r_hat=1.01, chunk=25, longest=6000, starts=4),
    "thorough": Effort(effective=2000.0, r_hat=1.005, chunk=50, longest=40000, kept=2000, starts=8),
}


@dataclass(frozen=True)
class SamplerStatus:
    """State of sampling.

    Parameters
    ----------
    steps, kept : int
        Steps done, and steps of the draws that would be kept now; 0 while moves are fitted.
    effective, r_hat : float
        Smallest bulk effective sample size and largest R̂ of the kept draws; nan without any.
    times : float
        Autocorrelation times covered by the walkers; nan without any.
    resumed : int
        Steps done by an earlier run.
    settled : bool
        Whether fitting of moves has ended.
    slowest : tuple of int
        Parameters with that effective sample size and that R̂.
    """

    steps: int = 0
    kept: int = 0
    effective: float = math.nan
    r_hat: float = math.nan
    times: float = math.nan
    resumed: int = 0
    settled: bool = False
    slowest: tuple[int, ...] = ()

    def steps_wanted(self, effort: Effort) -> float:
        """Return the number of kept steps needed for an effort's criteria; nan if none are kept.

        Effective draws grow with the steps, and R̂ − 1 falls with them.

        Examples
        --------
        >>> effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
        >>> SamplerStatus(100, kept=50, effective=250.0, r_hat=1.02, times=5.0).steps_wanted(effort)
        100.0
        """
        lacking = (
            effort.effective / self.effective,
            (self.r_hat - 1.0) / (effort.r_hat - 1.0) if effort.r_hat > 1.0 else math.inf,
            effort.times / self.times,
        )
        # the rounding is that of R̂ − 1
        return round(self.kept * max(lacking), 6)

    def enough(self, effort: Effort) -> bool:
        """Return whether an effort's criteria are met."""
        return (
            self.effective >= effort.effective
            and self.r_hat <= effort.r_hat
            and self.times >= effort.times
        )


@dataclass(frozen=True)
class Chain:
    """Draws of several independent ensembles.

    Parameters
    ----------
    vectors : array, shape (n_ensembles, n_steps, n_walkers, n_parameters)
        On the unconstrained scale, after burn-in.
    log_prob : array, shape (n_ensembles, n_steps, n_walkers)
        Log posterior density, not normalised.
    acceptance : array, shape (n_ensembles,)
        Accepted share of proposals.
    refusals : Refusals
        Number of proposals refused by the emulator, burn-in included.
    """

    vectors: Floats
    log_prob: Floats
    acceptance: Floats
    refusals: Refusals = field(default_factory=Refusals)

    def r_hat(self, which: Sequence[int] | None = None) -> Floats:
        """Rank-normalised split R̂ of each parameter, or of some, ensembles as chains.

        The walkers of one ensemble depend on each other, so they are not independent chains.
        """
        ensembles, steps, walkers, size = self.vectors.shape
        draws = self.vectors.reshape(ensembles, steps * walkers, size)
        return np.array([array_stats.rhat(draws[:, :, i]) for i in which or range(size)])

    @property
    def by_walker(self) -> Floats:
        """The vectors by walker, (ensembles, walkers, steps, n_parameters), as in files."""
        return np.swapaxes(self.vectors, 1, 2)

    def effective(self, method: str = "bulk", which: Sequence[int] | None = None) -> Floats:
        """Effective sample size of each parameter, or of some, along each walker."""
        ensembles, steps, walkers, size = self.vectors.shape
        lines = self.by_walker.reshape(ensembles * walkers, steps, size)
        prob = 0.9 if method == "tail" else None
        return np.array(
            [
                array_stats.ess(lines[:, :, i], method=method, prob=prob)
                for i in which or range(size)
            ]
        )

    def judged(self, standing: SamplerStatus, effort: Effort | None = None) -> SamplerStatus:
        """Return a state with the diagnostics of the chain.

        With an effort, only the previously slowest parameters are checked while they do not meet
        it.
        """
        if effort is not None and standing.slowest:
            some = self._worth(standing, standing.slowest)
            if not some.enough(effort):
                return some
        return self._worth(standing, range(self.vectors.shape[-1]))

    def _worth(self, standing: SamplerStatus, which: Sequence[int]) -> SamplerStatus:
        effective, r_hat = self.effective(which=which), self.r_hat(which)
        fewest, worst = int(np.argmin(effective)), int(np.argmax(r_hat))
        ensembles, steps, walkers, _ = self.vectors.shape
        return replace(
            standing,
            kept=steps,
            effective=float(effective[fewest]),
            r_hat=float(r_hat[worst]),
            times=float(effective[fewest]) / (ensembles * walkers),
            slowest=(which[fewest], which[worst]),
        )

    def thinned(self, kept: int) -> Self:
        """Return whole ensembles at evenly spaced steps, about ``kept`` draws of each ensemble.

        Steps are kept with all walkers: evenly spaced single draws would follow the same few
        walkers through the chain. At least one step is kept.
        """
        _, steps, walkers, _ = self.vectors.shape
        number = min(max(1, round(kept / walkers)), steps)
        take = np.linspace(steps - 1, 0, number).round().astype(np.int64)[::-1]
        return replace(self, vectors=self.vectors[:, take], log_prob=self.log_prob[:, take])

    def spread(self, count: int) -> Floats:
        """Return about ``count`` vectors of the whole chain, (n, n_parameters), as `thinned`."""
        each = -(-count // len(self.vectors))
        vectors = self.thinned(each).vectors
        return vectors.reshape(-1, vectors.shape[-1])


Arrays = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True)
class RandomState:
    """State of a Mersenne twister, as used by emcee.

    Parameters
    ----------
    keys : array of uint32, shape (624,)
    position : int
        Within the keys.
    has_spare : int
        Whether the second of a pair of normal numbers is stored.
    spare : float
        That number.
    """

    keys: NDArray[np.uint32]
    position: int
    has_spare: int
    spare: float

    def legacy(self) -> tuple[str, NDArray[np.uint32], int, int, float]:
        """Return the tuple for ``RandomState.set_state``."""
        return ("MT19937", self.keys, self.position, self.has_spare, self.spare)


@dataclass(frozen=True)
class Position:
    """Position of an ensemble.

    Parameters
    ----------
    vectors : array, shape (n_walkers, n_parameters)
    log_prob : array, shape (n_walkers,)
    random : RandomState
    """

    vectors: Floats
    log_prob: Floats
    random: RandomState


@dataclass(frozen=True)
class Task:
    """Everything but the density that determines the next piece of an ensemble.

    Parameters
    ----------
    position : Position
        Start of the piece.
    proposal : Proposal
        Proposal law of the moves.
    steps : int
        How many.
    """

    position: Position
    proposal: Proposal
    steps: int

    def key(self) -> str:
        """Return a hash of the task's bits."""
        position, warp = self.position, self.proposal.warp
        parts: tuple[NDArray[np.generic], ...] = (
            position.vectors,
            position.log_prob,
            position.random.keys,
            np.array([position.random.position, position.random.has_spare, self.steps]),
            np.array([position.random.spare]),
            *(warp.location, warp.scale, warp.skewness, warp.tail),
            *(self.proposal.mean, self.proposal.factor),
        )
        return digest({str(i): part for i, part in enumerate(parts)})


@dataclass(frozen=True)
class Piece:
    """A piece of an ensemble's chain.

    Parameters
    ----------
    vectors : array, shape (n_steps, n_walkers, n_parameters)
    log_prob : array, shape (n_steps, n_walkers)
    acceptance : float
        Accepted share of proposals.
    refusals : Refusals
        Of the emulator.
    random : RandomState
        At the end.
    """

    vectors: Floats
    log_prob: Floats
    acceptance: float
    refusals: Refusals
    random: RandomState

    @property
    def end(self) -> Position:
        """Position of the ensemble at the end."""
        return Position(self.vectors[-1], self.log_prob[-1], self.random)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything as arrays by name."""
        random = self.random
        return {
            "chain": self.vectors,
            "log_prob": self.log_prob,
            "acceptance": np.array([self.acceptance]),
            "refusals": np.array([self.refusals.proposed, self.refusals.refused]),
            "random_keys": random.keys,
            "random_position": np.array([random.position, random.has_spare]),
            "random_spare": np.array([random.spare]),
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> "Piece":
        """Return the piece from the result of ``arrays``."""
        position, has_spare = (int(v) for v in arrays["random_position"])
        keys = np.asarray(arrays["random_keys"], dtype=np.uint32)
        random = RandomState(keys, position, has_spare, float(arrays["random_spare"][0]))
        return cls(
            np.asarray(arrays["chain"], dtype=np.float64),
            np.asarray(arrays["log_prob"], dtype=np.float64),
            float(arrays["acceptance"][0]),
            Refusals(*(int(v) for v in arrays["refusals"])),
            random,
        )


class ChainStore(Protocol):
    """Keeps pieces of chains."""

    def load(self, ensemble: int, number: int, key: str) -> Piece | None:
        """Return a piece if it exists, is whole and belongs to the task with this key."""

    def save(self, ensemble: int, number: int, key: str, piece: Piece) -> None:
        """Keep a piece."""


class NoStore:
    """Keeps nothing."""

    def load(self, ensemble: int, number: int, key: str) -> None:
        """Return None."""

    def save(self, ensemble: int, number: int, key: str, piece: Piece) -> None:
        """Do nothing."""


def digest(arrays: Arrays) -> str:
    """Return a hash of arrays: names, kinds, shapes and bits.

    Examples
    --------
    >>> digest({"a": np.zeros(2)}) == digest({"a": np.zeros((2, 1))})
    False
    """
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


FEWEST_A_PARAMETER = 10.0  # effective draws, at least
FITTED = 4000  # draws for fitting the first law
PLANE = 1e-9  # smallest over largest singular value of draws that span the space
JITTERS = (
    0.1,
    0.01,
    1e-3,
    1e-5,
)  # jitter of walkers, in standard deviations; the first possible one is used
DROP = 2.0  # drop of log density that defines the width of a parameter
WIDENED = 2000  # draws around a single point


@dataclass(frozen=True)
class Start:
    """Equally weighted draws that span the space, and a law fitted to them.

    Parameters
    ----------
    draws : array, shape (n, n_parameters)
        Possible vectors, some more than once.
    proposal : Proposal
        Law of the draws.
    faithful : bool
        Whether the draws are of the posterior itself, not of a wider or narrower law.
    """

    draws: Floats
    proposal: Proposal
    faithful: bool = False

    def walkers(self, density: Density, generator: np.random.Generator, count: int) -> Floats:
        """Return distinct possible vectors (count, n_parameters) that span the space.

        They are draws jittered by a tenth of their spread, or less if that is impossible.
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
    """Return the start from an importance sample.

    If it has few effective draws its log weights are multiplied by a number below 1: the draws then
    follow a law between proposal and posterior. If its draws lie in a plane or coincide, they are
    replaced by draws around the best, as wide in each parameter as the density there.

    Raises
    ------
    BayesdegError
        If the density is zero at all draws.
    """
    possible = np.isfinite(importance.log_weights)
    if not possible.any():
        raise BayesdegError(
            "the posterior density is zero at every starting point: priors and data contradict "
            "each other, or a prior excludes what the data show; widen the priors"
        )
    draws, log_weights = importance.draws[possible], importance.log_weights[possible]
    wanted = FEWEST_A_PARAMETER * draws.shape[1]
    power, least = 1.0, min(wanted, 0.5 * len(log_weights))
    while effective_draws(power * log_weights) < least:
        power *= 0.9
    weights = np.exp(power * log_weights - logsumexp(power * log_weights))
    chosen = draws[generator.choice(len(draws), FITTED, p=weights)]
    if lie_in_a_plane(chosen):
        chosen = _widened(density, draws, generator)
        return Start(chosen, Proposal.fit(chosen, degrees=FOR_WALKERS))
    faithful = effective_draws(log_weights) >= wanted
    return Start(chosen, Proposal.fit(chosen, degrees=FOR_WALKERS), faithful)


def lie_in_a_plane(draws: Floats) -> bool:
    """Return whether draws (n, n_parameters) do not span the space.

    Examples
    --------
    >>> line = np.linspace(0.0, 1.0, 5)
    >>> lie_in_a_plane(np.column_stack([line, 2.0 * line])), lie_in_a_plane(line[:, None])
    (True, False)
    """
    deviation = draws - np.mean(draws, axis=0)
    # by rounding of the mean a constant has a small remainder
    constant = np.ptp(draws, axis=0) <= 1e-14 * np.max(np.abs(draws), axis=0)
    if constant.any():
        return True
    values = np.linalg.svd(deviation / np.std(deviation, axis=0), compute_uv=False)
    return len(values) < draws.shape[1] or bool(values[-1] <= PLANE * values[0])


def _widened(density: Density, draws: Floats, generator: np.random.Generator) -> Floats:
    """Draw around the best of some vectors, as wide in each parameter as the density."""
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
            "the posterior density is zero all around its best starting point: data or a prior fix "
            "a parameter to a single value; give it a wider prior"
        )
    return possible


# shares of the steps, from benchmarks/sampler_moves.py. Independent proposals are most efficient if
# the posterior is close to the fitted law; differential evolution works if it is not
INDEPENDENT, DIFFERENTIAL = 0.8, 0.2
# acceptance above which fitting the moves once is enough: a better law would not repay a further
# period
SERVED = 0.2
# ratio of required to covered autocorrelation times that triggers refitting. Small, since in a
# short chain the times are underestimated; the law of a study with flaws took 170 to 440 steps,
# refitted 185
SLOW = 1.2


def sample(
    density: Density,
    start: Evidence,
    *,
    effort: Effort,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_chunk: Callable[[SamplerStatus], None] | None = None,
    store: ChainStore | None = None,
) -> Chain:
    """Sample a posterior with independent ensembles until the effort's criteria are met.

    Walkers start from draws of the posterior's importance sample, each ensemble from its own. Most
    moves are independent proposals from a law fitted to the draws of all ensembles; the others are
    differential evolution, which needs no fit. The law is refitted before each period of the effort
    and fixed within it; if the start has many effective draws and their law performs well, the
    second period is the last, unless it turns out slow. Only draws of the last period are kept, so
    that detailed balance holds for all of them. The same seed gives the same chain whatever the
    executor, the threads and the content of the store.

    A posterior with several separate modes is explored around the one in the start.

    Parameters
    ----------
    density : Density
        Evaluated for a whole or half ensemble at once.
    start : Evidence
        Importance sample to start from.
    effort : Effort
        Criteria.
    seed : SeedSequence
        Every ensemble gets its own child.
    executor : Executor, optional
        Runs the ensembles in parallel.
    on_chunk : callable, optional
        Called with the state after every check.
    store : ChainStore, optional
        Keeps finished pieces for resuming an interrupted run.

    Raises
    ------
    BayesdegError
        If the density is zero at every possible start.
    """
    run = partial(_run, density, executor, store or NoStore())
    # one thread: the same sums in the same order, hence the same bits, in any process
    with threadpool_limits(limits=1):
        first, *others = seed.spawn(1 + effort.ensembles)
        begun = start_of(density, start, np.random.default_rng(first))
        positions = [_first(density, begun, child) for child in others]
        proposal, asked, standing = begun.proposal, Refusals(), SamplerStatus()
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
                standing = SamplerStatus(
                    standing.steps + look,
                    resumed=standing.resumed + resumed,
                    settled=standing.settled,
                    slowest=standing.slowest,
                )
                if period > 0:
                    standing = chain.judged(standing, effort)
                if on_chunk is not None:
                    on_chunk(standing)
                if standing.enough(effort) or standing.steps >= effort.longest:
                    return chain
                # a settled law may mix so slowly that refitting is worth a period; checked where
                # the second period would end if it were not settled
                due = standing.settled and standing.kept >= 2 * effort.chunk
                if due and SLOW * standing.times <= effort.times:
                    break
            served = float(np.min(chain.acceptance)) >= SERVED
            standing = replace(standing, settled=period == 0 and served and begun.faithful)
            # a poor law may have disturbed the first part of a period
            fitted = chain.vectors if served else chain.vectors[:, chain.vectors.shape[1] // 2 :]
            fitted = fitted.reshape(-1, fitted.shape[-1])
            proposal, period = Proposal.fit(fitted, degrees=FOR_WALKERS), period + 1


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
    """Run the tasks of all ensembles, except those with stored pieces.

    Also returns the number of steps taken from the store.
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
    """Run a task of one ensemble, with the same bits in any process."""
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
    """Return the moves of sampling with their shares of the steps."""
    return [
        (emcee.moves.MHMove(proposal.independent), INDEPENDENT),
        (emcee.moves.DEMove(), DIFFERENTIAL),
    ]


def _joined(history: list[list[Piece]], asked: Refusals) -> Chain:
    vectors = np.stack([np.concatenate([p.vectors for p in pieces]) for pieces in history])
    log_prob = np.stack([np.concatenate([p.log_prob for p in pieces]) for pieces in history])
    steps = [len(p.vectors) for p in history[0]]
    acceptance = np.array(
        [np.average([p.acceptance for p in pieces], weights=steps) for pieces in history]
    )
    return Chain(vectors, log_prob, acceptance, asked)
