"""emcee over independent ensembles, and the one place where a chain becomes a DataTree."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import emcee
import numpy as np
import xarray as xr
from arviz_base import from_dict
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from bayesdeg.inference.laplace import Evidence
from bayesdeg.inference.model import Model
from bayesdeg.inference.refusals import CountedDensity, Refusals

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Effort:
    """What sampling may cost, and when it is enough.

    Parameters
    ----------
    effective : float
        Effective sample size wanted in every parameter.
    r_hat : float
        Largest rank-normalised split R̂ across ensembles that is accepted.
    chunk, longest : int
        Steps between looks at the chain, and at most.
    ensembles, kept : int
        Independent ensembles, and draws kept of each.
    """

    effective: float
    r_hat: float
    chunk: int
    longest: int
    ensembles: int = 4
    kept: int = 500


EFFORTS = {
    "quick": Effort(effective=150.0, r_hat=1.05, chunk=200, longest=1200),
    "standard": Effort(effective=400.0, r_hat=1.01, chunk=400, longest=6000),
    "thorough": Effort(effective=2000.0, r_hat=1.005, chunk=1000, longest=40000, kept=2000),
}


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
        How many proposals the emulator refused, burn-in included.
    """

    vectors: Floats
    log_prob: Floats
    acceptance: Floats
    refusals: Refusals = field(default_factory=Refusals)

    def r_hat(self) -> Floats:
        """Rank-normalised split R̂ of each parameter, ensembles as chains.

        The walkers of one ensemble move by one another, so they are no independent chains.
        """
        ensembles, steps, walkers, size = self.vectors.shape
        draws = self.vectors.reshape(ensembles, steps * walkers, size)
        return np.array([array_stats.rhat(draws[:, :, i]) for i in range(size)])

    def effective(self, method: str = "bulk") -> Floats:
        """Effective sample size of each parameter, autocorrelation taken along each walker."""
        ensembles, steps, walkers, size = self.vectors.shape
        lines = np.swapaxes(self.vectors, 1, 2).reshape(ensembles * walkers, steps, size)
        prob = 0.9 if method == "tail" else None
        return np.array(
            [array_stats.ess(lines[:, :, i], method=method, prob=prob) for i in range(size)]
        )

    def thinned(self, kept: int) -> "Chain":
        """Return about ``kept`` evenly spaced draws of each ensemble, one walker column."""
        ensembles, steps, walkers, size = self.vectors.shape
        total = steps * walkers
        take = np.unique(np.linspace(0, total - 1, min(kept, total)).round().astype(np.int64))
        return replace(
            self,
            vectors=self.vectors.reshape(ensembles, total, 1, size)[:, take],
            log_prob=self.log_prob.reshape(ensembles, total, 1)[:, take],
        )


@dataclass(frozen=True)
class _Position:
    vectors: Floats
    random_state: tuple[str, NDArray[np.uint32], int, int, float]


@dataclass(frozen=True)
class _Piece:
    """What one ensemble did in one chunk of steps; fields as in ``Chain``."""

    vectors: Floats
    log_prob: Floats
    acceptance: float
    refusals: Refusals


def sample(
    model: Model,
    start: Evidence,
    *,
    effort: Effort,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_chunk: Callable[[int, float, float], None] | None = None,
) -> Chain:
    """Sample a posterior with independent ensembles until the effort's criteria are met.

    Walkers start from draws of the posterior's importance sample, each ensemble from its own. The
    first quarter of the steps is discarded. The same seed gives the same chain whatever the
    executor.

    Parameters
    ----------
    model : Model
        Evaluated for a whole half ensemble at once.
    start : Evidence
        Importance sample to start from.
    effort : Effort
        Criteria.
    seed : SeedSequence
        Every ensemble gets its own child.
    executor : Executor, optional
        Runs the ensembles side by side.
    on_chunk : callable, optional
        Called with steps done, smallest effective size and largest R̂.
    """
    size = len(model.table)
    walkers = max(40, 2 * size + 2)
    positions = [_first(model, start, walkers, child) for child in seed.spawn(effort.ensembles)]
    history: list[list[_Piece]] = [[] for _ in positions]
    advance = partial(_advance, model, effort.chunk)
    apply = map if executor is None else executor.map
    for done in range(effort.chunk, effort.longest + 1, effort.chunk):
        results = list(apply(advance, positions))
        for pieces, (_, piece) in zip(history, results, strict=True):
            pieces.append(piece)
        positions = [position for position, _ in results]
        chain = _join(history)
        smallest, largest = float(np.min(chain.effective())), float(np.max(chain.r_hat()))
        if on_chunk is not None:
            on_chunk(done, smallest, largest)
        if smallest >= effort.effective and largest <= effort.r_hat:
            break
    return chain


def to_datatree(model: Model, chain: Chain, generator: np.random.Generator) -> xr.DataTree:
    """Return the chain as an arviz DataTree.

    Groups: ``posterior`` (named parameters, in the users' units), ``sample_stats`` (``lp``),
    ``log_likelihood`` (each reading of curvature given those before it on its specimen; and whole
    specimens), ``posterior_predictive``, ``observed_data``, ``constant_data``. Chains are
    ensembles.
    """
    ensembles, steps, walkers, size = chain.vectors.shape
    shape = (ensembles, steps * walkers)
    flat = chain.vectors.reshape(-1, size)
    values = model.table.named(flat)
    groups: dict[str, dict[str, NDArray[np.generic]]] = {
        "posterior": {name: v.reshape(shape) for name, v in values.items()},
        "sample_stats": {"lp": chain.log_prob.reshape(shape)},
    }
    coords: dict[str, NDArray[np.generic]] = {}
    dims: dict[str, list[str]] = {}
    groups["log_likelihood"] = {}
    for kind, block in model.log_likelihood(values).items():
        groups["log_likelihood"][f"{kind}_specimens"] = block.reshape(*shape, -1)
        dims[f"{kind}_specimens"] = [f"{kind}_specimen"]
        coords[f"{kind}_specimen"] = _labels(model, kind)
    if model.actuator is not None:
        _add_curvature(model, values, generator, groups=groups, shape=shape)
        dims["curvature"] = dims["pressure"] = ["observation"]
        coords["observation"] = np.arange(int(model.actuator.mask.sum()))
    tree: xr.DataTree = from_dict(groups, coords=coords, dims=dims)
    return tree if model.actuator is None else _label_observations(tree, model)


def _first(model: Model, start: Evidence, walkers: int, seed: np.random.SeedSequence) -> _Position:
    generator = np.random.default_rng(seed)
    vectors = start.resample(generator, walkers)
    # resampling repeats draws: a jitter of a tenth of the spread keeps the ensemble regular
    vectors = vectors + 0.1 * np.std(vectors, axis=0) * generator.standard_normal(vectors.shape)
    impossible = ~np.isfinite(model.log_prob(vectors))
    vectors[impossible] = start.resample(generator, int(impossible.sum()))
    state = np.random.RandomState(np.random.MT19937(seed)).get_state()
    return _Position(vectors, state)


def _advance(model: Model, steps: int, position: _Position) -> tuple[_Position, _Piece]:
    walkers, size = position.vectors.shape
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)]
    density = CountedDensity(model)
    sampler = emcee.EnsembleSampler(walkers, size, density, vectorize=True, moves=moves)
    sampler.random_state = position.random_state
    sampler.run_mcmc(position.vectors, steps, skip_initial_state_check=True)
    piece = _Piece(
        sampler.get_chain(),
        sampler.get_log_prob(),
        float(np.mean(sampler.acceptance_fraction)),
        density.refusals,
    )
    return _Position(piece.vectors[-1], sampler.random_state), piece


def _join(history: list[list[_Piece]]) -> Chain:
    vectors = np.stack([np.concatenate([p.vectors for p in pieces]) for pieces in history])
    log_prob = np.stack([np.concatenate([p.log_prob for p in pieces]) for pieces in history])
    burnt = vectors.shape[1] // 4
    acceptance = np.array([np.mean([p.acceptance for p in pieces]) for pieces in history])
    refusals = sum((p.refusals for pieces in history for p in pieces), start=Refusals())
    return Chain(vectors[:, burnt:], log_prob[:, burnt:], acceptance, refusals)


def _labels(model: Model, kind: str) -> NDArray[np.str_]:
    if kind == "statistics":
        return np.array([f"{s.quantity} at {s.degradation:g} %" for s in model.statistics])
    data = {"tensile": model.tensile, "actuator": model.actuator, "breaks": model.breaks}[kind]
    assert data is not None
    return np.array(data.specimens)


def _add_curvature(
    model: Model,
    values: dict[str, Floats],
    generator: np.random.Generator,
    *,
    groups: dict[str, dict[str, NDArray[np.generic]]],
    shape: tuple[int, int],
) -> None:
    assert model.actuator is not None
    mask = model.actuator.mask
    groups["log_likelihood"]["curvature"] = model.curvature_pointwise(values)[:, mask].reshape(
        *shape, -1
    )
    replicates = model.simulate(values, generator)[:, mask]
    groups["posterior_predictive"] = {"curvature": replicates.reshape(*shape, -1)}
    groups["observed_data"] = {"curvature": model.actuator.curvature[mask]}
    groups["constant_data"] = {"pressure": model.actuator.pressure[mask]}


def _label_observations(tree: xr.DataTree, model: Model) -> xr.DataTree:
    assert model.actuator is not None
    data, mask = model.actuator, model.actuator.mask
    shape = mask.shape
    labels = {
        "specimen_id": np.broadcast_to(np.array(data.specimens)[:, None], shape)[mask],
        "pressure_kPa": data.pressure[mask],
        "degradation_pct": np.broadcast_to(data.degradation, shape)[mask],
    }
    coords = {name: ("observation", values) for name, values in labels.items()}
    for name in ("log_likelihood", "posterior_predictive", "observed_data", "constant_data"):
        tree[name] = xr.DataTree(tree[name].to_dataset().assign_coords(coords))
    return tree
