"""What a model adds to the DataTree of its chain: labels of specimens, and observations."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.inference.model import Model, blocks_of, specimens_of

Floats = NDArray[np.float64]
Groups = dict[str, dict[str, NDArray[np.generic]]]

JOINT = "joint"
OBSERVED = ("log_likelihood", "posterior_predictive", "observed_data", "constant_data")


def specimen_labels(model: Model, kind: str) -> NDArray[np.str_]:
    """Return the names of what a kind of data is about, specimens or statistics."""
    if kind == "statistics":
        return np.array([f"{s.quantity} at {s.degradation:g} %" for s in model.statistics])
    if kind == "r_squared":
        assert model.published is not None
        return np.array(list(model.published.names("r_squared")))
    tables = {"tensile": model.tensile, "breaks": model.breaks}
    data = tables.get(kind, model.actuator)
    assert data is not None
    return np.array(data.specimens)


def readings_of(model: Model) -> dict[str, tuple[NDArray[np.bool_], slice]]:
    """Return where the readings of each output are: its mask, and its columns of all readings."""
    assert model.actuator is not None
    data = model.actuator
    points = data.pressure.shape[1]
    found = {"curvature": (data.mask, slice(0, points))}
    if data.with_angle:
        found["bend_angle"] = (data.mask & data.angle_mask, slice(points, 2 * points))
    return found


def add_likelihoods(
    model: Model, by_kind: Mapping[str, Floats], groups: Groups, *, shape: tuple[int, int]
) -> tuple[dict[str, NDArray[np.generic]], dict[str, list[str]]]:
    """Add log densities of whole specimens, by kind of data and jointly.

    Given the parameters, the readings of a specimen in different tables are independent, so their
    log densities add up to its joint one; a summary statistic is a specimen of its own. The joint
    ones sum to the log likelihood. They are what ``arviz.loo`` leaves out one by one: whole
    specimens, not single points of a curve.

    Parameters
    ----------
    model : Model
        With its data.
    by_kind : mapping
        What ``Model.log_likelihood`` returns.
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
        f"{kind}_specimen": specimen_labels(model, kind) for kind in by_kind
    }
    blocks = _blocks(model, by_kind)
    densities[JOINT] = np.stack(
        [sum(by_kind[k][:, rows].sum(axis=-1) for k, rows in found.items()) for _, found in blocks],
        axis=-1,
    )
    groups["log_likelihood"] = {name: d.reshape(*shape, -1) for name, d in densities.items()}
    coords["specimen"] = np.array([name for name, _ in blocks])
    return coords, dims | {JOINT: ["specimen"]}


def _blocks(
    model: Model, by_kind: Mapping[str, Floats]
) -> list[tuple[str, dict[str, NDArray[np.intp]]]]:
    """Return the rows of every specimen in every kind of data, and of every statistic."""
    blocks = list(blocks_of(model, by_kind).items())
    for kind in [kind for kind in by_kind if not specimens_of(model, kind)]:
        labels = specimen_labels(model, kind).tolist()
        blocks += [(name, {kind: np.array([row])}) for row, name in enumerate(labels)]
    return blocks


def with_one_likelihood(tree: xr.DataTree) -> xr.DataTree:
    """Leave the joint density as the one data variable of ``log_likelihood``.

    ``arviz.loo`` takes the one that there is, and refuses to choose among several. The others keep
    their names and places as coordinates: ``tree.log_likelihood["curvature"]`` and
    ``arviz.loo(tree, var_name="curvature")`` find them.
    """
    whole = tree["log_likelihood"].to_dataset()
    parts = [name for name in whole.data_vars if name != JOINT]
    tree["log_likelihood"] = xr.DataTree(whole.set_coords(parts))
    return tree


def add_observations(
    model: Model,
    values: dict[str, Floats],
    generator: np.random.Generator,
    *,
    groups: Groups,
    shape: tuple[int, int],
) -> None:
    """Add readings, their densities and replicates, to the groups."""
    assert model.actuator is not None
    data = model.actuator
    pointwise, replicates = model.readings_pointwise(values), model.simulate(values, generator)
    groups |= {"posterior_predictive": {}, "observed_data": {}, "constant_data": {}}
    for name, (mask, columns) in readings_of(model).items():
        groups["log_likelihood"][name] = pointwise[..., columns][:, mask].reshape(*shape, -1)
        groups["posterior_predictive"][name] = replicates[..., columns][:, mask].reshape(*shape, -1)
        groups["observed_data"][name] = data.readings[:, columns][mask]
    groups["constant_data"]["pressure"] = data.pressure[data.mask]


def observation_axes(model: Model) -> tuple[dict[str, NDArray[np.generic]], dict[str, list[str]]]:
    """Return coordinates and dimensions of the readings."""
    coords: dict[str, NDArray[np.generic]] = {}
    dims = {"pressure": ["observation"]}
    for name, (mask, _) in readings_of(model).items():
        axis = _axis(name)
        coords[axis] = np.arange(int(mask.sum()))
        dims[name] = [axis]
    return coords, dims


def label_observations(tree: xr.DataTree, model: Model) -> xr.DataTree:
    """Let the observations carry specimen, pressure and degradation rate."""
    assert model.actuator is not None
    data = model.actuator
    labels = {
        "specimen_id": np.broadcast_to(np.array(data.specimens)[:, None], data.mask.shape),
        "pressure_kPa": data.pressure,
        "degradation_pct": np.broadcast_to(data.degradation, data.mask.shape),
    }
    for output, (mask, _) in readings_of(model).items():
        axis = _axis(output)
        prefix = "" if output == "curvature" else f"{output}_"
        coords = {f"{prefix}{name}": (axis, value[mask]) for name, value in labels.items()}
        for name in OBSERVED:
            if axis in tree[name].dims:
                tree[name] = xr.DataTree(tree[name].to_dataset().assign_coords(coords))
    return tree


def _axis(output: str) -> str:
    return "observation" if output == "curvature" else f"{output}_observation"
