"""Geometry to a hexahedral half model with named boundaries, on scikit-fem's bases."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementHex2, MeshHex

from bayesdeg.actuator.geometry import Box, Geometry

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Resolution:
    """How finely the space between two planes of the geometry is divided.

    Parameters
    ----------
    along, across, up : float
        Largest size of an element in x, y and z [mm].
    """

    along: float
    across: float
    up: float


COARSE = Resolution(along=3.5, across=2.5, up=5.0)
FINE = Resolution(along=1.25, across=1.05, up=1.25)


@dataclass(frozen=True)
class ActuatorMesh:
    """The half model: triquadratic bricks and the node sets that the mechanics needs.

    Parameters
    ----------
    geometry : Geometry
        What was meshed.
    nodes : array, shape (n_nodes, 3)
        Coordinates as moulded [mm].
    elements : array, shape (n_elements, 27)
        Nodes of every brick.
    gradients : array, shape (n_elements, 27 points, 27 nodes, 3)
        Gradients of the shape functions at the quadrature points [1/mm].
    weights : array, shape (n_elements, 27)
        Volume of every quadrature point [mm³].
    points : array, shape (27, 3)
        Quadrature points on the unit cube.
    cavity, bottom, free_end : array, shape (n_faces, 9)
        Nodes of the faces under pressure, of those that carry the paper, and of the free end:
        3 × 3 grids whose first axis times second axis points out of the cavity (in order x, y
        on the bottom, y, z on the end).
    bottom_line : array, shape (n,)
        Nodes of the line at the middle of the bottom, ordered along x; its curvature is read.
    clamped, symmetry : array
        Nodes held in all directions, and nodes held across.
    """

    geometry: Geometry
    nodes: Floats
    elements: Indices
    gradients: Floats
    weights: Floats
    points: Floats
    cavity: Indices
    bottom: Indices
    free_end: Indices
    bottom_line: Indices
    clamped: Indices
    symmetry: Indices


def build_mesh(geometry: Geometry, resolution: Resolution) -> ActuatorMesh:
    """Return the half model of an actuator in triquadratic bricks.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    resolution : Resolution
        Largest element sizes [mm]; every wall has at least one element.

    Returns
    -------
    ActuatorMesh
        With 27 Gauss points an element.

    Examples
    --------
    >>> from bayesdeg.measure.settings import Dimensions
    >>> mesh = build_mesh(Geometry(Dimensions()), COARSE)
    >>> bool(abs(mesh.weights.sum() - 1818.0) < 1e-6)  # volume of the material [mm³]
    True
    """
    sizes = (resolution.along, resolution.across, resolution.up)
    grids = [_divide(p, size) for p, size in zip(geometry.planes(), sizes, strict=True)]
    full = MeshHex.init_tensor(*grids)
    centres = full.p[:, full.t].mean(axis=1).T
    hollow = _inside_any(centres, (*geometry.cavities, *geometry.slots))
    mesh = full.restrict(np.flatnonzero(~hollow))
    basis = Basis(mesh, ElementHex2(), intorder=5)
    nodes = np.ascontiguousarray(basis.doflocs.T)
    gradients = np.stack([field[0].grad for field in basis.basis], axis=-1)
    d = geometry.dimensions
    faces = _faces(mesh, basis, nodes)
    middles = nodes[faces].mean(axis=1)
    return ActuatorMesh(
        geometry=geometry,
        nodes=nodes,
        elements=np.ascontiguousarray(basis.element_dofs.T.astype(np.int64)),
        gradients=np.ascontiguousarray(np.transpose(gradients, (1, 2, 3, 0))),
        weights=np.ascontiguousarray(basis.dx),
        points=np.ascontiguousarray(basis.X.T),
        cavity=_outward(nodes, faces[_on_cavity(middles, geometry)], geometry.cavities),
        bottom=_grid_order(nodes, faces[np.isclose(middles[:, 2], 0.0)]),
        free_end=_grid_order(nodes, faces[np.isclose(middles[:, 0], d.length)]),
        bottom_line=_line(nodes),
        clamped=np.flatnonzero(np.isclose(nodes[:, 0], 0.0)),
        symmetry=np.flatnonzero(np.isclose(nodes[:, 1], 0.0)),
    )


def _divide(planes: Floats, size: float) -> Floats:
    pieces = [
        np.linspace(a, b, max(1, int(np.ceil((b - a) / size - 1e-9))) + 1)[:-1]
        for a, b in pairwise(planes)
    ]
    return np.concatenate([*pieces, planes[-1:]])


def _inside_any(
    points: Floats, boxes: tuple[Box, ...], tolerance: float = 1e-7
) -> NDArray[np.bool_]:
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        low, high = np.array(box).T
        inside |= np.all((points > low - tolerance) & (points < high + tolerance), axis=1)
    return inside


def _on_cavity(middles: Floats, geometry: Geometry) -> NDArray[np.bool_]:
    on_symmetry = np.isclose(middles[:, 1], 0.0)
    return _inside_any(middles, geometry.cavities) & ~on_symmetry


def _faces(mesh: MeshHex, basis: Basis, nodes: Floats) -> Indices:
    """Nodes of all boundary faces, (n, 9): those of the brick behind that lie in the face."""
    facets = mesh.boundary_facets()
    owners = basis.element_dofs[:, mesh.f2t[0, facets]].T
    corners = mesh.p[:, mesh.facets[:, facets]]
    low, high = corners.min(axis=1).T[:, None, :], corners.max(axis=1).T[:, None, :]
    positions = nodes[owners]
    inside = np.all((positions > low - 1e-7) & (positions < high + 1e-7), axis=2)
    within: Indices = owners[inside].reshape(len(facets), 9).astype(np.int64)
    return within


def _grid_order(nodes: Floats, faces: Indices) -> Indices:
    """Order the nine nodes of plane faces as a 3 × 3 grid over their two tangent axes."""
    ordered = np.empty_like(faces)
    for row, face in enumerate(faces):
        position = np.round(nodes[face], 7)
        first, second = np.flatnonzero(np.ptp(position, axis=0) > 1e-6)
        ordered[row] = face[np.lexsort((position[:, second], position[:, first]))]
    return ordered


def _outward(nodes: Floats, faces: Indices, cavities: tuple[Box, ...]) -> Indices:
    """Order faces so that the normal (first × second axis) points out of the cavity."""
    ordered = _grid_order(nodes, faces)
    grid = nodes[ordered].reshape(-1, 3, 3, 3)
    normal = np.cross(grid[:, 2, 1] - grid[:, 0, 1], grid[:, 1, 2] - grid[:, 1, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    into_air = _inside_any(grid[:, 1, 1] + 1e-3 * normal, cavities, tolerance=-1e-6)
    flipped = np.swapaxes(ordered.reshape(-1, 3, 3), 1, 2).reshape(-1, 9)
    return np.where(into_air[:, None], flipped, ordered)


def _line(nodes: Floats) -> Indices:
    on_line = np.flatnonzero(np.isclose(nodes[:, 1], 0.0) & np.isclose(nodes[:, 2], 0.0))
    return on_line[np.argsort(nodes[on_line, 0])]
