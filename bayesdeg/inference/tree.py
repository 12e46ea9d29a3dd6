"""Conversion of a chain to a DataTree with parameters, densities and readings."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from arviz_base import from_dict
from numpy.typing import NDArray

from bayesdeg.inference.density import Density
from bayesdeg.inference.model import JointModel, blocks_of
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.kinds import Pointwise, Stored

Floats = NDArray[np.float64]
Groups = dict[str, dict[str, NDArray[np.generic]]]

JOINT = "joint"
OBSERVED = ("log_likelihood", "posterior_predictive", "observed_data", "constant_data")


def to_datatree(density: Density, chain: Chain, generator: np.random.Generator) -> xr.DataTree:
    """Return the chain as an arviz DataTree.

    Groups: ``posterior`` (named parameters, in the users' units), ``sample_stats`` (``lp``); for a
    ``JointModel`` also ``log_likelihood`` (``joint``: all readings of each specimen, for
    ``arviz.loo``; as coordinates its parts: each reading given those before it on its specimen,
    and whole specimens by kind of data), ``posterior_predictive``, ``observed_data``,
    ``constant_data``. Chains are ensembles.
    """
    ensembles, steps, walkers, size = chain.vectors.shape
    shape = (ensembles, steps * walkers)
    # by walker, so that neighbours in the tree have the autocorrelation of the chain
    values = density.table.named(chain.by_walker.reshape(-1, size))
    groups: Groups = {
        "posterior": {name: v.reshape(shape) for name, v in values.items()},
        "sample_stats": {"lp": np.swapaxes(chain.log_prob, 1, 2).reshape(shape)},
    }
    if not isinstance(density, JointModel):
        plain: xr.DataTree = from_dict(groups)
        return plain
    coords, dims = _add_likelihoods(density, density.log_likelihood(values), groups, shape=shape)
    stored = _stored_readings(density, values, generator)
    further, along = _add_observations(stored, groups, shape=shape)
    tree: xr.DataTree = from_dict(groups, coords=coords | further, dims=dims | along)
    return _with_one_likelihood(_label_observations(tree, stored))


def _add_likelihoods(
    model: JointModel, by_kind: Mapping[str, Floats], groups: Groups, *, shape: tuple[int, int]
) -> tuple[dict[str, NDArray[np.generic]], dict[str, list[str]]]:
    """Add log densities of whole specimens, by kind of data and jointly.

    Given the parameters, the readings of a specimen in different tables are independent, so their
    log densities add up to its joint one; a summary statistic counts as a specimen. The joint ones
    sum to the log likelihood. ``arviz.loo`` leaves these out one by one: whole specimens, not
    single points of a curve.

    Parameters
    ----------
    model : JointModel
        With its data.
    by_kind : mapping
        What ``JointModel.log_likelihood`` returns.
    groups : dict
        To which ``log_likelihood`` is added.
    shape : (int, int)
        Chains and draws.

    Returns
    -------
    coords, dims : dict
        Labels, and along what each variable goes.
    """
    densities = {f"{kind}_specimens": block for kind, block in by_kind.items()}
    dims = {f"{kind}_specimens": [f"{kind}_specimen"] for kind in by_kind}
    coords: dict[str, NDArray[np.generic]] = {
        f"{one.name}_specimen": np.array(list(one.labels)) for one in model.observations
    }
    blocks = _blocks(model)
    joint = np.empty((shape[0] * shape[1], len(blocks)))  # without columns if there are no data
    for column, (_, found) in enumerate(blocks):
        joint[:, column] = sum(by_kind[k][:, rows].sum(axis=-1) for k, rows in found.items())
    densities[JOINT] = joint
    groups["log_likelihood"] = {n: d.reshape(*shape, d.shape[-1]) for n, d in densities.items()}
    coords["specimen"] = np.array([name for name, _ in blocks], dtype=np.str_)
    return coords, dims | {JOINT: ["specimen"]}


def _blocks(model: JointModel) -> list[tuple[str, dict[str, NDArray[np.intp]]]]:
    """Return the rows of every specimen in every kind of data, and of every statistic."""
    blocks = list(blocks_of(model).items())
    for one in model.observations:
        if not one.specimens:
            blocks += [(name, {one.name: np.array([k])}) for k, name in enumerate(one.labels)]
    return blocks


def _with_one_likelihood(tree: xr.DataTree) -> xr.DataTree:
    """Make the joint density the only data variable of ``log_likelihood``.

    ``arviz.loo`` takes a single variable and refuses to choose among several. The others keep their
    names as coordinates: ``tree.log_likelihood["curvature"]`` and
    ``arviz.loo(tree, var_name="curvature")`` find them.
    """
    whole = tree["log_likelihood"].to_dataset()
    parts = [name for name in whole.data_vars if name != JOINT]
    tree["log_likelihood"] = xr.DataTree(whole.set_coords(parts))
    return tree


def _stored_readings(
    model: JointModel, values: dict[str, Floats], generator: np.random.Generator
) -> list[Stored]:
    """Return the readings, their densities and replicates to keep."""
    state, tests = model.state(values), model.tests(values)
    read = (one for one in model.observations if isinstance(one, Pointwise))
    return [kept for one in read for kept in one.stored(state, tests, generator)]


def _add_observations(
    stored: list[Stored], groups: Groups, *, shape: tuple[int, int]
) -> tuple[dict[str, NDArray[np.generic]], dict[str, list[str]]]:
    """Add readings, their densities and replicates, to the groups; return labels and axes."""
    coords: dict[str, NDArray[np.generic]] = {}
    dims: dict[str, list[str]] = {}
    if stored:
        groups |= {"posterior_predictive": {}, "observed_data": {}, "constant_data": {}}
    for one in stored:
        groups["log_likelihood"][one.output] = one.log_likelihood.reshape(*shape, -1)
        groups["posterior_predictive"][one.output] = one.replicates.reshape(*shape, -1)
        groups["observed_data"][one.output] = one.observed
        groups["constant_data"] |= one.constants
        coords[one.axis] = np.arange(len(one.observed))
        dims |= {name: [one.axis] for name in (one.output, *one.constants)}
    return coords, dims


def _label_observations(tree: xr.DataTree, stored: list[Stored]) -> xr.DataTree:
    """Add specimen, pressure and degradation rate as coordinates of the observations."""
    for one in stored:
        coords = {name: (one.axis, values) for name, values in one.labels.items()}
        for name in OBSERVED:
            if one.axis in tree[name].dims:
                tree[name] = xr.DataTree(tree[name].to_dataset().assign_coords(coords))
    return tree
