"""Curved faces cut into small flat pieces, and the sharp edges between them, for drawing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SHARP = 0.8  # cosine of the angle between the normals of two faces that meet in a sharp edge


@dataclass(frozen=True)
class Quads:
    """Small quadrilaterals, seen from outside with their corners anticlockwise.

    Parameters
    ----------
    corners : array, shape (n, 4, 3)
        [mm].
    values : array, shape (n,)
        Mean of a field over the corners.
    """

    corners: Floats
    values: Floats

    @property
    def vectors(self) -> Floats:
        """Vectors along the outward normals, as long as the areas [mm²], (n, 3)."""
        c = self.corners
        vectors: Floats = 0.5 * np.cross(c[:, 2] - c[:, 0], c[:, 3] - c[:, 1])
        return vectors

    @property
    def areas(self) -> Floats:
        """Areas [mm²], (n,)."""
        return np.linalg.norm(self.vectors, axis=1)


def quads_of(points: Floats, values: Floats, faces: Indices, *, pieces: int) -> Quads:
    """Cut faces into pieces × pieces quadrilaterals along their own shape functions.

    Parameters
    ----------
    points : array, shape (n_nodes, 3)
        Positions of the nodes [mm].
    values : array, shape (n_nodes,)
        A field at the nodes.
    faces : array, shape (n_faces, 4 or 9)
        Nodes as grids whose first axis times second axis points outwards.
    pieces : int
        Into which each side is divided.

    Examples
    --------
    >>> square = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]])
    >>> quads = quads_of(square, square[:, 0], np.array([[0, 1, 2, 3]]), pieces=2)
    >>> quads.areas, quads.values
    (array([0.25, 0.25, 0.25, 0.25]), array([0.25, 0.25, 0.75, 0.75]))
    """
    line = _shapes(int(np.sqrt(faces.shape[1])), pieces)
    shapes = np.kron(line, line)
    at = np.einsum("qa,fai->fqi", shapes, points[faces])
    value = values[faces] @ shapes.T
    number = np.arange((pieces + 1) ** 2).reshape(pieces + 1, pieces + 1)
    corner = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    return Quads(at[:, corner].reshape(-1, 4, 3), value[:, corner].mean(axis=2).ravel())


def normals_of(points: Floats, faces: Indices) -> Floats:
    """Return unit normals at the middle of faces, (n_faces, 3)."""
    side = int(np.sqrt(faces.shape[1]))
    corner = points[faces.reshape(-1, side, side)[:, [0, -1, -1, 0], [0, 0, -1, -1]]]
    normal = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    unit: Floats = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return unit


def sharp_edges(points: Floats, faces: Indices) -> Indices:
    """Return the edges at which faces end or meet at an angle, (n_edges, nodes of an edge).

    Parameters
    ----------
    points : array, shape (n_nodes, 3)
        Before loading, so that edges do not come and go with the deformation [mm].
    faces : array, shape (n_faces, 4 or 9)
        As of `quads_of`.

    Examples
    --------
    >>> plane = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0], [2, 1, 0]])
    >>> sharp_edges(plane, np.array([[0, 1, 2, 3], [2, 3, 4, 5]])).tolist()
    [[0, 1], [0, 2], [1, 3], [2, 4], [3, 5], [4, 5]]
    """
    side = int(np.sqrt(faces.shape[1]))
    grid = faces.reshape(-1, side, side)
    edges = np.stack([grid[:, 0], grid[:, -1], grid[:, :, 0], grid[:, :, -1]], axis=1)
    edges = edges.reshape(-1, side)
    normals = np.repeat(normals_of(points, faces), 4, axis=0)
    _, first, which, count = np.unique(
        np.sort(edges[:, [0, -1]], axis=1),
        axis=0,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    total = np.zeros((len(first), 3))
    np.add.at(total, which.ravel(), normals)
    # two unit normals at an angle add up to less than 2
    smooth = (count == 2) & (np.sum(total**2, axis=1) > 2.0 + 2.0 * SHARP)
    sharp: Indices = edges[first[~smooth]]
    return sharp


def segments_of(points: Floats, edges: Indices, *, pieces: int) -> Floats:
    """Return points along edges, (n_edges, pieces + 1, 3)."""
    along: Floats = np.einsum("qa,eai->eqi", _shapes(edges.shape[1], pieces), points[edges])
    return along


def _shapes(nodes: int, pieces: int) -> Floats:
    """Lagrange polynomials of equidistant nodes on [0, 1] at the ends of the pieces."""
    at, known = np.linspace(0.0, 1.0, pieces + 1), np.linspace(0.0, 1.0, nodes)
    powers = np.arange(nodes)
    shapes: Floats = (at[:, None] ** powers) @ np.linalg.inv(known[:, None] ** powers)
    return shapes
