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
    state, tests = density.state(values), density.tests(values)
    read = (one for one in density.observations if isinstance(one, Pointwise))
    stored = [kept for one in read for kept in one.stored(state, tests, generator)]
    further, along = _add_observations(stored, groups, shape=shape)
    tree: xr.DataTree = from_dict(groups, coords=coords | further, dims=dims | along)
    for one in stored:
        labels = {name: (one.axis, values) for name, values in one.labels.items()}
        for name in OBSERVED:
            if one.axis in tree[name].dims:
                tree[name] = xr.DataTree(tree[name].to_dataset().assign_coords(labels))
    # arviz.loo takes a single variable and refuses to choose among several: all but the joint
    # density become coordinates, which arviz.loo(tree, var_name="curvature") finds too
    whole = tree["log_likelihood"].to_dataset()
    parts = [name for name in whole.data_vars if name != JOINT]
    tree["log_likelihood"] = xr.DataTree(whole.set_coords(parts))
    return tree


def _add_likelihoods(
    model: JointModel, by_kind: Mapping[str, Floats], groups: Groups, *, shape: tuple[int, int]
) -> tuple[dict[str, NDArray[np.generic]], dict[str, list[str]]]:
    """Add log densities of whole specimens, by kind of data and jointly.

    Given the parameters, the readings of a specimen in different tables are independent, so their
    log densities add up to its joint one; a summary statistic counts as a specimen. The joint ones
    sum to the log likelihood. ``arviz.loo`` leaves these out one by one: whole specimens, not
    single points of a curve. Returns labels and axes.
    """
    densities = {f"{kind}_specimens": block for kind, block in by_kind.items()}
    dims = {f"{kind}_specimens": [f"{kind}_specimen"] for kind in by_kind}
    coords: dict[str, NDArray[np.generic]] = {
        f"{one.name}_specimen": np.array(list(one.labels)) for one in model.observations
    }
    blocks = list(blocks_of(model).items())
    for one in model.observations:
        if not one.specimens:
            blocks += [(name, {one.name: np.array([k])}) for k, name in enumerate(one.labels)]
    joint = np.empty((shape[0] * shape[1], len(blocks)))  # without columns if there are no data
    for column, (_, found) in enumerate(blocks):
        joint[:, column] = sum(by_kind[k][:, rows].sum(axis=-1) for k, rows in found.items())
    densities[JOINT] = joint
    groups["log_likelihood"] = {n: d.reshape(*shape, d.shape[-1]) for n, d in densities.items()}
    coords["specimen"] = np.array([name for name, _ in blocks], dtype=np.str_)
    return coords, dims | {JOINT: ["specimen"]}


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
