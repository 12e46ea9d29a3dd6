"""Bending of the paper: second differences of the bottom's nodes, one constant matrix.

The energy of a plate that bends without stretching is ½ D ∫ |∇∇x|² dX, quadratic in the positions
and unchanged by rotations. The bottom's nodes stand in a rectangular grid, so second derivatives
are taken as differences over neighbouring nodes; kinks between elements count.
"""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayesdeg.actuator.body import Body

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
# degrees of freedom, (n, k), and the factors (n, k) whose products with them are squared
Stencils = tuple[Indices, Floats]

ALL, UP_ONLY, BUT_ACROSS = (0, 1, 2), (2,), (0, 2)


def bending_matrix(body: Body) -> sp.coo_array:
    """Return the Hessian of ½ ∫ |∇∇x|² dX over the papered faces, (3 n_nodes, 3 n_nodes).

    Where the body is clamped, so is the paper; where it is cut at a plane of symmetry y = 0,
    the other half follows.

    Parameters
    ----------
    body : Body
        Its papered faces fill a rectangle.

    Raises
    ------
    ValueError
        If they do not.
    """
    size = 3 * len(body.nodes)
    if len(body.paper) == 0:
        return sp.coo_array((size, size))
    grid, x, y = _grid(body)
    parts = [
        *_along(grid, x, _lengths(y)[None, :]),
        *_along(grid.T, y, _lengths(x)[None, :]),
        _twist(grid, x, y),
        *_edges(body, grid, x, y),
    ]
    entries = [_outer(*part) for part in parts]
    rows, columns, values = (np.concatenate(piece) for piece in zip(*entries, strict=True))
    return sp.coo_array((values, (rows, columns)), shape=(size, size))


def _grid(body: Body) -> tuple[Indices, Floats, Floats]:
    nodes = np.unique(body.paper)
    x, first = np.unique(np.round(body.nodes[nodes, 0], 9), return_inverse=True)
    y, second = np.unique(np.round(body.nodes[nodes, 1], 9), return_inverse=True)
    if len(nodes) != len(x) * len(y):
        raise ValueError("the papered faces do not fill a rectangle")
    grid = np.empty((len(x), len(y)), dtype=np.int64)
    grid[first, second] = nodes
    return grid, x, y


def _lengths(at: Floats) -> Floats:
    """Length that belongs to each point of a line."""
    lengths = np.zeros(len(at))
    lengths[:-1] += 0.5 * np.diff(at)
    lengths[1:] += 0.5 * np.diff(at)
    return lengths


def _along(grid: Indices, at: Floats, width: Floats) -> list[Stencils]:
    """Second derivative along the first axis at inner points, weighted by the area's root."""
    before, after = np.diff(at)[:-1, None], np.diff(at)[1:, None]
    total = before + after
    factors = np.stack(
        np.broadcast_arrays(2 / (before * total), -2 / (before * after), 2 / (after * total)), -1
    )
    area = 0.5 * total * width
    nodes = np.stack([grid[:-2], grid[1:-1], grid[2:]], axis=-1)
    weighted = np.sqrt(area)[..., None] * factors
    return _for_components(nodes.reshape(-1, 3), weighted.reshape(-1, 3), ALL)


def _twist(grid: Indices, x: Floats, y: Floats) -> Stencils:
    """Mixed second derivative, twice, in every cell of the grid."""
    area = np.diff(x)[:, None] * np.diff(y)[None, :]
    nodes = np.stack([grid[1:, 1:], grid[:-1, 1:], grid[1:, :-1], grid[:-1, :-1]], axis=-1)
    factors = np.sqrt(2.0 / area)[..., None] * np.array([1.0, -1.0, -1.0, 1.0])
    parts = _for_components(nodes.reshape(-1, 4), factors.reshape(-1, 4), ALL)
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _edges(body: Body, grid: Indices, x: Floats, y: Floats) -> list[Stencils]:
    """Where the slope is zero at an edge: the clamp, and the plane of symmetry."""
    parts = []
    if np.all(body.fixed[grid[0]]):
        parts += _mirrored(grid, x, _lengths(y), UP_ONLY)
    if np.all(body.fixed[grid[:, 0], 1]):
        parts += _mirrored(grid.T, y, _lengths(x), BUT_ACROSS)
    return parts


def _mirrored(
    grid: Indices, at: Floats, width: Floats, components: tuple[int, ...]
) -> list[Stencils]:
    step = at[1] - at[0]
    factors = np.sqrt(0.5 * step * width)[:, None] * 2.0 / step**2 * np.array([1.0, -1.0])
    nodes = np.stack([grid[1], grid[0]], axis=-1)
    return _for_components(nodes, factors, components)


def _for_components(nodes: Indices, factors: Floats, components: tuple[int, ...]) -> list[Stencils]:
    return [(3 * nodes + component, factors) for component in components]


def _outer(degrees: Indices, factors: Floats) -> tuple[Indices, Indices, Floats]:
    shape = (*degrees.shape, degrees.shape[1])
    rows = np.broadcast_to(degrees[:, :, None], shape)
    columns = np.broadcast_to(degrees[:, None, :], shape)
    values = factors[:, :, None] * factors[:, None, :]
    return rows.ravel(), columns.ravel(), values.ravel()
