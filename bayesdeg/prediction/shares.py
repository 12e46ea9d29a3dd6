r"""Variance decomposition of a prediction by groups of inputs.

Inputs x are standard normal with correlations Σ, and a prediction is a quadratic of them,
:math:`y = b^T x + x^T B x`. The expectation of y given a set u of the inputs has the variance

.. math:: V(u) = |A^T b|^2 + 2\, \|A^T B A\|_F^2, \qquad A = \Sigma_{\cdot u} L^{-T},
    \quad L L^T = \Sigma_{uu}

in closed form, and all indices of a group follow from V over sets of groups. Posterior parameters
are correlated, so a variance cannot be split by terms: knowing one group is informative about the
others. The share of a group is therefore its Shapley effect, which sums to 1 whatever the
correlations (Owen 2014, doi:10.1137/130936233; Song, Nelson and Staum 2016,
doi:10.1137/15M1048070).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import ndtri
from scipy.stats import rankdata
from threadpoolctl import threadpool_limits

from bayesdeg.data.levels import levels
from bayesdeg.data.uncertain import is_dimension
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.specimens import PAPER_STIFFNESS
from bayesdeg.prediction.predictive import at_conditions
from bayesdeg.priors import Named

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Groups = Mapping[str, Indices]

MATERIAL, DEGRADATION, SCATTER, PAPER = "material", "degradation", "scatter", "paper"
SCALE, CAUSES, EMULATOR, READING = "scale", "causes", "emulator", "reading"
DIMENSIONS = "dimensions"
SOURCES = (MATERIAL, DEGRADATION, SCATTER, PAPER, SCALE, DIMENSIONS, CAUSES, EMULATOR, READING)

DRAWS = 2000  # a correlation of independent draws is then known to 0.02
PLACES = (0.25, 0.5, 0.75, 1.0)  # of the largest pressure
LEAST_ANSWERED = (
    0.5  # share of the draws within range, below which the law of a prediction is unknown
)
FEWEST_A_TERM = 3  # draws for each term of a quadratic; with fewer, it is a plane
RIDGE = 1e-9  # of variances 1: keeps a factor of correlations positive definite


@dataclass(frozen=True)
class Quadratic:
    """Outputs that are quadratics of inputs, up to a constant.

    Parameters
    ----------
    linear : array, shape (n_outputs, n_inputs)
        b of each output.
    square : array, shape (n_outputs, n_inputs, n_inputs)
        B of each, symmetric.
    explained : array, shape (n_outputs,)
        Share of the outputs' variance that the quadratics explain [–].
    """

    linear: Floats
    square: Floats
    explained: Floats


@dataclass(frozen=True)
class GroupIndices:
    """Indices of groups of inputs, each (n_groups, n_outputs).

    Parameters
    ----------
    first : array
        Share of the variance removed if only the group becomes known.
    total : array
        Share that remains if all but the group become known.
    share : array
        Shapley effect: mean gain of the group beyond those known before it, over all orders in
        which they may become known. Sums to 1 over the groups.
    """

    first: Floats
    total: Floats
    share: Floats


def fit_quadratic(inputs: Floats, outputs: Floats, correlation: Floats) -> Quadratic:
    """Fit quadratics to outputs by least squares.

    Parameters
    ----------
    inputs : array, shape (n, n_inputs)
        Draws, nearly standard normal with these correlations.
    outputs : array, shape (n, n_outputs)
        Without noise: with a single draw for each term there would be no error to see.
    correlation : array, shape (n_inputs, n_inputs)
        Σ.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal((200, 2))
    >>> fit = fit_quadratic(x, (3.0 * x[:, :1] + x[:, :1] * x[:, 1:]), np.eye(2))
    >>> fit.linear.round(6).tolist(), np.abs(fit.square).round(6).tolist()
    ([[3.0, 0.0]], [[[0.0, 0.5], [0.5, 0.0]]])
    """
    factor = _factor(correlation)
    # uncorrelated coordinates, in which the terms are nearly orthogonal
    white = solve_triangular(factor, inputs.T, lower=True).T
    size = inputs.shape[1]
    first, second = np.triu_indices(size)
    pairs = white[:, first] * white[:, second]
    if len(inputs) < FEWEST_A_TERM * (1 + size + len(first)):
        pairs = pairs[:, :0]
    terms = np.column_stack([np.ones(len(white)), white, pairs])
    normal = terms.T @ terms
    normal[np.diag_indices_from(normal)] += RIDGE * len(inputs)
    found = np.linalg.solve(normal, terms.T @ outputs)
    left = np.var(outputs - terms @ found, axis=0)
    square = np.zeros((outputs.shape[1], size, size))
    if pairs.shape[1]:
        square[:, first, second] += 0.5 * found[1 + size :].T
        square[:, second, first] += 0.5 * found[1 + size :].T
    back = solve_triangular(factor, np.eye(size), lower=True)
    total = np.maximum(np.var(outputs, axis=0), np.finfo(float).tiny)
    return Quadratic(found[1 : 1 + size].T @ back, back.T @ square @ back, 1.0 - left / total)


def known_variance(fit: Quadratic, correlation: Floats, known: Indices) -> Floats:
    """Return V(u), the variance of E[y | x_u], of each output for standard normal inputs.

    Parameters
    ----------
    fit : Quadratic
        The outputs.
    correlation : array, shape (n_inputs, n_inputs)
        Σ.
    known : array of int
        u; 0 of none.
    """
    if not len(known):
        return np.zeros(len(fit.linear))
    factor = _factor(correlation[np.ix_(known, known)])
    move = solve_triangular(factor, correlation[known], lower=True)
    linear, square = fit.linear @ move.T, move @ fit.square @ move.T
    variance: Floats = np.sum(linear**2, axis=-1) + 2.0 * np.sum(square**2, axis=(-2, -1))
    return variance


def _factor(correlation: Floats) -> Floats:
    return np.linalg.cholesky(correlation + RIDGE * np.eye(len(correlation)))


def group_indices(
    fit: Quadratic,
    correlation: Floats,
    groups: Groups,
    noises: Mapping[str, tuple[Quadratic, Floats]] | None = None,
) -> GroupIndices:
    r"""Return first-order and total indices and Shapley effects of groups of inputs.

    Parameters
    ----------
    fit : Quadratic
        The outputs.
    correlation : array, shape (n_inputs, n_inputs)
        Σ.
    groups : mapping of str to array of int
        Inputs of each group.
    noises : mapping of str to (Quadratic, array), optional
        Standard deviations of independent errors that are added to the outputs, with their means,
        (n_outputs,), by the group that they belong to. Once the group is among what is known, such
        an error s z adds :math:`E[E[s | x_u]^2]` to V(u).

    Examples
    --------
    Two correlated terms of equal weight share their common part:

    >>> fit = Quadratic(np.array([[1.0, 1.0]]), np.zeros((1, 2, 2)), np.ones(1))
    >>> alike = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> found = group_indices(fit, alike, {"a": np.array([0]), "b": np.array([1])})
    >>> found.first[:, 0].round(3), found.total[:, 0].round(3), found.share[:, 0].round(3)
    (array([0.75, 0.75]), array([0.25, 0.25]), array([0.5, 0.5]))
    """
    names = tuple(groups)
    values = {
        chosen: _value(fit, correlation, groups, noises or {}, tuple(names[i] for i in chosen))
        for size in range(len(names) + 1)
        for chosen in combinations(range(len(names)), size)
    }
    everything = tuple(range(len(names)))
    whole = np.maximum(values[everything], np.finfo(float).tiny)
    first = np.stack([values[(g,)] for g in everything]) / whole
    others = [tuple(i for i in everything if i != g) for g in everything]
    total = 1.0 - np.stack([values[rest] for rest in others]) / whole
    share = np.stack([_shapley(values, g, len(names)) for g in everything])
    return GroupIndices(first, total, share)


def _value(
    fit: Quadratic,
    correlation: Floats,
    groups: Groups,
    noises: Mapping[str, tuple[Quadratic, Floats]],
    chosen: tuple[str, ...],
) -> Floats:
    known = np.concatenate([np.empty(0, dtype=np.intp), *(groups[name] for name in chosen)])
    variance = known_variance(fit, correlation, known)
    for name in chosen:
        if name in noises:
            sd, mean = noises[name]
            variance = variance + mean**2 + known_variance(sd, correlation, known)
    return variance


def _shapley(values: Mapping[tuple[int, ...], Floats], group: int, count: int) -> Floats:
    """Return the mean gain of a group over orders, as a share of the whole, (n_outputs,)."""
    whole = np.maximum(values[tuple(range(count))], np.finfo(float).tiny)
    gain = np.zeros_like(whole)
    for known, value in values.items():
        if group not in known:
            joined = tuple(sorted((*known, group)))
            gain += (values[joined] - value) / (count * comb(count - 1, len(known)))
    return gain / whole


# ---- of a new actuator


@dataclass(frozen=True)
class _Inputs:
    """Draws of all inputs of a reading on a new actuator.

    Parameters
    ----------
    scores : array, shape (n, n_inputs)
        Normal scores: marginals exactly normal, with the order of the draws.
    groups : mapping
        Columns of each source.
    correlation : array
        Of the posterior; specimen and degradation rate are independent of it by construction.
    own : array, shape (n, 2)
        Scores of specimen and degradation rate.
    """

    scores: Floats
    groups: dict[str, Indices]
    correlation: Floats
    own: Floats


def curvature_shares(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
) -> pd.DataFrame:
    """Return the shares of the variance of a curvature read on a new actuator.

    The reading is of a prompt first loading in a horizontal mount. Its degradation rate has the
    standard error with which those of the study's actuators were measured.

    Parameters
    ----------
    model, chain : JointModel, Chain
        JointModel with its tests of actuators, and its posterior.
    generator : Generator
        Draws specimens and degradation rates.
    degradation, pressure : array
        Levels [%] and pressures as read [kPa].

    Returns
    -------
    DataFrame
        The columns of ``shares.csv``, a row for each place and source; places at which the
        forward map has no answer for most draws are left out.
    """
    values = model.table.named(chain.spread(DRAWS))
    inputs = _inputs(model, values, generator)
    curvature, noises = _readings(model, values, inputs.own, degradation, pressure)
    frames = []
    answered = np.isfinite(curvature)
    for pattern in np.unique(answered, axis=1).T if len(pressure) else ():
        here = np.flatnonzero(np.all(answered == pattern[:, None], axis=0))
        if np.mean(pattern) > LEAST_ANSWERED:
            with threadpool_limits(limits=1):  # small matrices, and the same bits everywhere
                frames.append(_of_places(inputs, curvature, noises, pattern, here))
    rates, pressures = (v.ravel() for v in np.meshgrid(degradation, pressure, indexing="ij"))
    if not frames:
        return pd.DataFrame(columns=["degradation_pct", "pressure_kPa", *_FOUND])
    table = pd.concat(frames, ignore_index=True)
    place = table.pop("place").to_numpy()
    table.insert(0, "degradation_pct", rates[place])
    table.insert(1, "pressure_kPa", pressures[place])
    return table.sort_values(["degradation_pct", "pressure_kPa"], kind="stable", ignore_index=True)


_FOUND = ("source", "first_order", "total", "share", "sd_per_m", "explained")


def pressures_of(largest: float) -> Floats:
    """Return pressures at which shares are shown, up to the largest applied [kPa]."""
    return largest * np.array(PLACES)


def _inputs(model: JointModel, values: Named, generator: np.random.Generator) -> _Inputs:
    """Return normal scores of parameters, specimen and degradation rate, with their groups."""
    members = _members(model)
    names = [name for group in members.values() for name in group]
    count = len(values[names[0]])
    scores = np.column_stack([_scores(values[name]) for name in names])
    own = generator.standard_normal((count, 2))
    size, drawn = len(names), own if model.world.degrades else own[:, :1]
    correlation = np.eye(size + drawn.shape[1])
    correlation[:size, :size] = scores.T @ scores / count  # scores have mean 0 and variance 1
    np.fill_diagonal(correlation, 1.0)  # also for a parameter that is known exactly
    groups, first = {}, 0
    for source, group in members.items():
        groups[source] = np.arange(first, first + len(group))
        first += len(group)
    groups[SCATTER] = np.append(groups[SCATTER], size)
    if model.world.degrades:
        groups[DEGRADATION] = np.array([size + 1])
    ordered = {source: groups[source] for source in SOURCES if source in groups}
    return _Inputs(np.column_stack([scores, drawn]), ordered, correlation, own)


def _scores(draws: Floats) -> Floats:
    """Return normal scores of draws (n,); of draws that are all the same, zeros."""
    if np.ptp(draws) == 0.0:
        return np.zeros(len(draws))
    scores: Floats = ndtri((rankdata(draws) - 0.5) / len(draws))
    return scores / np.std(scores)


def _members(model: JointModel) -> dict[str, list[str]]:
    """Return the parameters of a curvature by source, without empty sources."""
    names = model.table.names
    acting = [one for one in model.causes if "actuator" in one.acts_on]
    found = {
        MATERIAL: [n for n in names if n.startswith(("c1_", "c2_ratio_", "c3_"))],
        SCATTER: ["stiffness_scatter"],
        PAPER: [n for n in names if n == PAPER_STIFFNESS],
        SCALE: [n for n in names if n == "volume_ratio"],
        DIMENSIONS: [n for n in names if is_dimension(n)],
        CAUSES: [one.qualified(p.name) for one in acting for p in one.parameters],
        EMULATOR: [n for n in names if n.startswith("emulator_error_")],
        READING: ["curvature_noise", "curvature_noise_floor"],
    }
    return {source: group for source, group in found.items() if group}


def _readings(
    model: JointModel, values: Named, own: Floats, degradation: Floats, pressure: Floats
) -> tuple[Floats, dict[str, Floats]]:
    """Return curvatures (n, n_places) [1/m] and standard deviations of errors by their source."""
    kind = at_conditions(model, degradation, pressure).data_of(Curvature)
    state = model.tests(values)
    scatter = kind.deviation_sd(state)
    sd = _measured_sd(model, degradation)[:, None]
    both = Curvature(replace(kind.tests, degradation_sd=sd)).deviation_sd(state)
    by_rate = np.sqrt(np.maximum(both**2 - scatter**2, 0.0))
    deviation = scatter * own[:, :1, None] + by_rate * own[:, 1:, None]
    found = kind.predicted(state, deviation).prediction
    curvature = np.where(found.status == 0, found.curvature, np.nan)
    floor, noise = (values[f"curvature_noise{n}"][:, None, None] for n in ("_floor", ""))
    errors = {READING: np.hypot(floor, noise * curvature)}
    if np.any(found.sd[np.isfinite(curvature)] > 0.0):  # where no parameters represent it
        errors[EMULATOR] = np.broadcast_to(found.sd, curvature.shape)
    count = len(curvature)
    return curvature.reshape(count, -1), {n: e.reshape(count, -1) for n, e in errors.items()}


def _measured_sd(model: JointModel, degradation: Floats) -> Floats:
    """Return the standard error with which degradation rates were measured there [%]."""
    centres, member = levels(model.data_of(Curvature).tests.degradation[:, 0])
    sd = model.data_of(Curvature).tests.degradation_sd[:, 0]
    each = np.array([np.sqrt(np.mean(sd[member == k] ** 2)) for k in range(len(centres))])
    return np.asarray(np.interp(degradation, centres, each))


def _of_places(
    inputs: _Inputs,
    curvature: Floats,
    noises: Mapping[str, Floats],
    rows: NDArray[np.bool_],
    places: Indices,
) -> pd.DataFrame:
    """Return shares at places that have an answer for the same draws."""
    scores, groups = inputs.scores[rows], dict(inputs.groups)
    chosen = np.ix_(rows, places)
    fit = fit_quadratic(scores, curvature[chosen], inputs.correlation)
    sds = {name: sd[chosen] for name, sd in noises.items()}
    errors = {
        name: (fit_quadratic(scores, sd, inputs.correlation), sd.mean(axis=0))
        for name, sd in sds.items()
    }
    groups |= {name: np.empty(0, dtype=np.intp) for name in errors if name not in groups}
    found = group_indices(fit, inputs.correlation, groups, errors)
    squares = sum((np.mean(sd**2, axis=0) for sd in sds.values()), start=np.zeros(len(places)))
    sd = np.sqrt(np.var(curvature[chosen], axis=0) + squares)
    names = np.array(list(groups))
    return pd.DataFrame(
        {
            "place": np.repeat(places, len(names)),
            "source": np.tile(names, len(places)),
            "first_order": found.first.T.ravel(),
            "total": found.total.T.ravel(),
            "share": found.share.T.ravel(),
            "sd_per_m": np.repeat(sd, len(names)),
            "explained": np.repeat(fit.explained, len(names)),
        }
    )
