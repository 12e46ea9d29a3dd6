"""Prediction of the camera record from the markers on the beam."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dragon_skin.causes import GEOMETRICAL, RIG, Block
from dragon_skin.marker_map import MarkerMap
from dragon_skin.record import AT_CLAMP, CASE_OF_TAKE, CLAMP, HELD, NOMINAL, REST, TIP

Floats = NDArray[np.float64]

SHAPE = (6, 2, 6, 3)  # take, state, marker, coordinate

BLOCKS: dict[str, Block] = {
    **RIG,
    **{name: cause.block for name, cause in GEOMETRICAL.items() if cause.block is not None},
}
COUNT = sum(block.count for block in BLOCKS.values())


def split(nuisances: Floats) -> dict[str, Floats]:
    """Return the arrays of each block from vectors (n, COUNT)."""
    ends = np.cumsum([block.count for block in BLOCKS.values()])[:-1]
    pieces = zip(BLOCKS.items(), np.split(nuisances, ends, axis=1), strict=True)
    return {name: piece.reshape(-1, *block.shape) for (name, block), piece in pieces}


def columns(name: str) -> slice:
    """Return where a block stands in a vector of nuisances."""
    names = list(BLOCKS)
    start = sum(BLOCKS[other].count for other in names[: names.index(name)])
    return slice(start, start + BLOCKS[name].count)


def spread(name: str) -> Floats:
    """Return the prior standard deviations of a block at a size of 1, flat."""
    block = BLOCKS[name]
    return np.broadcast_to(np.array(block.spread), block.shape).ravel()


def seen(forward: MarkerMap, values: Mapping[str, Floats], nuisances: Floats) -> Floats:
    """Return positions of all markers, shape (n, 6, 2, 6, 3) [mm].

    Parameters
    ----------
    forward : MarkerMap
        Finite element solutions.
    values : dict of array, shape (n,)
        ``c1`` [kPa] and mechanical causes by name; those not named are none.
    nuisances : array, shape (m, COUNT)
        Of all blocks; m = 1, n = 1, or both equal.
    """
    at = split(nuisances)
    rest = _moved(_rest(forward, values, at["tip_marker_offset"]), at["rest_misfit"])
    rest = _moved(rest[:, CASE_OF_TAKE], at["repeat"])
    nominal = NOMINAL[TIP] + at["tip_marker_offset"]
    held = _moved(np.repeat(nominal[:, None], len(CASE_OF_TAKE), axis=1), at["held_shape"])
    clamp = NOMINAL[AT_CLAMP] + at["clamp_marker_offset"][:, None] + at["frame_by_case"]
    beam = np.empty((max(len(rest), len(nuisances)), *SHAPE))
    beam[:, :, HELD, TIP], beam[:, :, REST, TIP] = held, rest
    beam[:, :, :, AT_CLAMP] = clamp[:, CASE_OF_TAKE, None]
    beam[:, :, REST] = _moved(beam[:, :, REST], at["rig_shift"])
    setup = np.concatenate([at["setup_shift"], at["setup_turn"]], axis=-1)
    return _placed(_placed(beam, setup[:, CASE_OF_TAKE]), at["pose"])


def _rest(forward: MarkerMap, values: Mapping[str, Floats], offset: Floats) -> Floats:
    """Tip markers at rest in beam axes, (n, 3 cases, 3 markers, 3)."""
    effects = {name: values[name] for name in forward.slopes if name in values}
    tilt = values.get("gravity_tilt", np.zeros_like(values["c1"]))
    ball, turn, moment = forward.at(values["c1"], tilt, effects)
    # the surface under a ball carries its displaced centre along
    rest = ball + rotate(turn, offset[:, None])
    if "clamp_compliance" not in values:
        return rest
    angle = 1e-3 * np.deg2rad(values["clamp_compliance"])[:, None] * moment
    axis = angle[..., None, None] * np.array([0.0, 1.0, 0.0])
    return np.asarray(rotate(axis, rest - CLAMP) + CLAMP, dtype=np.float64)


def rotate(turn: Floats, points: Floats) -> Floats:
    """Turn points (..., 3) by rotation vectors (..., 3) [rad] by Rodrigues's formula.

    Examples
    --------
    >>> rotate(np.array([0.0, 0.0, np.pi / 2.0]), np.array([1.0, 0.0, 0.0])).round(12).tolist()
    [0.0, 1.0, 0.0]
    """
    angle = np.sqrt(np.maximum(np.sum(turn**2, axis=-1, keepdims=True), 1e-24))
    once = _cross(turn, points)
    twice = _cross(turn, once)
    turned: Floats = points + np.sin(angle) / angle * once
    return np.asarray(turned + (1.0 - np.cos(angle)) / angle**2 * twice, dtype=np.float64)


def _cross(a: Floats, b: Floats) -> Floats:
    """Return a × b; numpy's own is slower by far on small arrays."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _moved(points: Floats, motion: Floats) -> Floats:
    """Move points (n, take, marker, 3) by motions (n, take, 6), turning about their centre."""
    centre = points.mean(axis=2, keepdims=True)
    turned = rotate(motion[:, :, None, 3:], points - centre) + centre
    return turned + motion[:, :, None, :3]


def _placed(points: Floats, pose: Floats) -> Floats:
    """Move points (n, take, state, marker, 3) by poses (n, take, 6), turning about the clamp."""
    turned = rotate(pose[:, :, None, None, 3:], points - CLAMP) + CLAMP
    return np.asarray(turned + pose[:, :, None, None, :3], dtype=np.float64)
