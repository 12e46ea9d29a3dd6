"""Geometry to a hexahedral half model with named boundaries, on scikit-fem's bases."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from skfem import MeshHex

from bayesdeg.actuator.body import QUADRATIC, Body, Element, body_of, boundary_faces
from bayesdeg.actuator.geometry import Box, Geometry
from bayesdeg.actuator.status import COARSE as COARSE
from bayesdeg.actuator.status import CONVERGED as CONVERGED
from bayesdeg.actuator.status import FINE as FINE
from bayesdeg.actuator.status import Resolution
from bayesdeg.errors import GeometryError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ActuatorMesh:
    """The half model: its body, and the node sets that are read.

    Parameters
    ----------
    geometry : Geometry
        What was meshed.
    body : Body
        Bricks, what is held, pressed and papered; depth under the faces exposed to the soil.
    free_end : array, shape (n_faces, (order + 1)²)
        Nodes of the faces of the free end, as grids over y and z.
    bottom_line : array, shape (n,)
        Nodes of the line at the middle of the bottom, ordered along x; its curvature is read.
    """

    geometry: Geometry
    body: Body
    free_end: Indices
    bottom_line: Indices


def build_mesh(
    geometry: Geometry, resolution: Resolution, *, element: Element = QUADRATIC
) -> ActuatorMesh:
    """Return the half model of an actuator.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    resolution : Resolution
        Largest element sizes [mm]; every wall has at least one element.
    element : Element
        Kind of brick.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> mesh = build_mesh(Geometry(Dimensions()), COARSE)
    >>> bool(abs(mesh.body.volume - 1818.0) < 1e-6)  # volume of the material [mm³]
    True
    """
    sizes = (resolution.along, resolution.across, resolution.up)
    grids = [
        _divide(planes, size, resolution.grading)
        for planes, size in zip(geometry.planes(), sizes, strict=True)
    ]
    full = MeshHex.init_tensor(*grids)
    centres = full.p[:, full.t].mean(axis=1).T
    hollow = _inside_any(centres, (*geometry.cavities, *geometry.slots))
    body = body_of(full.restrict(np.flatnonzero(~hollow)), element)
    faces = boundary_faces(body)
    middles = body.nodes[faces].mean(axis=1)
    end = np.isclose(middles[:, 0], geometry.length)
    nodes = body.nodes
    fixed = np.repeat(np.isclose(nodes[:, :1], 0.0), 3, axis=1)
    fixed[:, 1] |= np.isclose(nodes[:, 1], 0.0)
    return ActuatorMesh(
        geometry=geometry,
        body=replace(
            body,
            cavity=faces[_on_cavity(middles, geometry)],
            paper=_grid_order(nodes, faces[np.isclose(middles[:, 2], 0.0)]),
            fixed=fixed,
            depth=_depth(body, geometry),
        ),
        free_end=_grid_order(nodes, faces[end]),
        bottom_line=_line(nodes),
    )


def reshaped(mesh: ActuatorMesh, *, wall_factor: float, erosion: float) -> ActuatorMesh:
    """Return the mesh with thicker or thinner walls and faces eroded: the same bricks moved.

    Parameters
    ----------
    mesh : ActuatorMesh
        Of the nominal geometry.
    wall_factor, erosion : float
        As in ``Geometry`` [–, mm].

    Raises
    ------
    GeometryError
        If nothing is left of a wall or of a chamber.
    """
    geometry = replace(mesh.geometry, wall_factor=wall_factor, erosion=erosion)
    before, after = mesh.geometry.planes(), geometry.planes()
    if any(len(a) != len(b) for a, b in zip(before, after, strict=True)):
        raise GeometryError("walls so changed fall together with other faces")
    nodes = np.column_stack(
        [np.interp(mesh.body.nodes[:, axis], before[axis], after[axis]) for axis in range(3)]
    )
    body = mesh.body.placed_at(nodes)
    return replace(mesh, geometry=geometry, body=replace(body, depth=_depth(body, geometry)))


def _depth(body: Body, geometry: Geometry) -> Floats:
    """Distance of quadrature points from the faces that are exposed to the soil."""
    points = np.einsum("qa,eai->eqi", body.element.shapes, body.nodes[body.elements])
    outer = np.array([geometry.length, geometry.half_width, geometry.height])
    depth = np.min(outer - points, axis=-1)
    for slot in geometry.slots:
        low, high = np.array(slot).T
        outside = np.maximum(np.maximum(low - points, points - high), 0.0)
        depth = np.minimum(depth, np.linalg.norm(outside, axis=-1))
    return np.maximum(depth, 0.0)


def _divide(planes: Floats, size: float, grading: float) -> Floats:
    last = len(planes) - 2
    pieces = [
        low
        + (high - low)
        * graded(
            max(1, int(np.ceil((high - low) / size - 1e-9))),
            grading,
            first=place > 0,
            last=place < last,
        )[:-1]
        for place, (low, high) in enumerate(pairwise(planes))
    ]
    return np.concatenate([*pieces, planes[-1:]])


def graded(count: int, grading: float, *, first: bool, last: bool) -> Floats:
    """Return ends of elements on [0, 1] that are smaller towards its first or last end.

    x = t − β sin(2πt)/(2π) for both ends, x = t − β sin(πt)/π for the first, with t even: at the
    end elements are 1 − β times as large as even ones. More elements on the same map are a true
    refinement, which an extrapolation to vanishing size needs.

    Examples
    --------
    >>> graded(2, 0.5, first=True, last=False).round(3).tolist()
    [0.0, 0.341, 1.0]
    """
    t = np.linspace(0.0, 1.0, count + 1)
    if first and last:
        return t - grading * np.sin(2.0 * np.pi * t) / (2.0 * np.pi)
    if first:
        return t - grading * np.sin(np.pi * t) / np.pi
    if last:
        return t + grading * np.sin(np.pi * t) / np.pi
    return t


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


def _grid_order(nodes: Floats, faces: Indices) -> Indices:
    """Order the nodes of plane faces as a grid over their two tangent axes, x before y before z."""
    ordered = np.empty_like(faces)
    for row, face in enumerate(faces):
        position = np.round(nodes[face], 7)
        first, second = np.flatnonzero(np.ptp(position, axis=0) > 1e-6)
        ordered[row] = face[np.lexsort((position[:, second], position[:, first]))]
    return ordered


def _line(nodes: Floats) -> Indices:
    on_line = np.flatnonzero(np.isclose(nodes[:, 1], 0.0) & np.isclose(nodes[:, 2], 0.0))
    return on_line[np.argsort(nodes[on_line, 0])]
