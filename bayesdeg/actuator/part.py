"""Cells of a part that the user has meshed, with what is held, pressed and papered."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from skfem import ElementHex1, MeshHex

from bayesdeg.actuator.body import (
    Body,
    Element,
    body_of,
    boundary_faces,
    faces_on_plane,
    tetrahedra_of,
)
from bayesdeg.actuator.families import PartGeometry
from bayesdeg.data.part import CORNERS, FLAT, PartMesh
from bayesdeg.errors import GeometryError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class MeshedPart:
    """What `bayesdeg.actuator.mesh` makes an actuator of.

    Parameters
    ----------
    body : Body
        Bricks, what is held, pressed and papered.
    tip, line : array
        Nodes of the faces of the free end as grids, and of the line that is read, along x.
    share : float
        Of a reading that grows with the part, what a half of the actuator has: 1/2 of a whole one.
    """

    body: Body
    tip: Indices
    line: Indices
    share: float


def meshed_part(geometry: PartGeometry, element: Element) -> MeshedPart:
    """Return the bricks or tetrahedra of a part, each with straight edges.

    Tetrahedra are of the one element that there is of them, whichever kind of brick is asked for.

    Raises
    ------
    GeometryError
        If no line of nodes runs along the middle of the constraint or the bottom.
    """
    part = geometry.part
    if part.is_tetrahedral:
        body = tetrahedra_of(part.points, part.cells)
    else:
        body = body_of(_brick_mesh(part), element)
    faces = boundary_faces(body)
    corners = _corners_of(body, faces, part)
    on = {name: np.isin(corners, _keys(sides)) for name, sides in part.sides.items()}
    fixed = np.zeros(body.nodes.shape, dtype=bool)
    fixed[np.unique(faces[on["clamp"]])] = True
    if part.is_half:
        fixed[np.unique(faces[on["symmetry"]]), 1] = True
    paper = faces[:0]
    if geometry.constraint.is_membrane and "constraint" in part.sides:
        paper = faces_on_plane_within(body, part, geometry.line_height)
        paper = paper if part.is_tetrahedral else _grids(body.nodes, paper)
    whole = replace(body, cavity=faces[on["cavity"]], paper=paper, fixed=fixed)
    line = _line(whole, part, geometry.line_height)
    return MeshedPart(whole, faces[on["tip"]], line, 1.0 if part.is_half else 0.5)


def _brick_mesh(part: PartMesh) -> MeshHex:
    """Return scikit-fem's mesh; its bricks are left-handed where the file's are right-handed."""
    places = np.asarray(ElementHex1().doflocs)
    mirrored = np.column_stack([1.0 - places[:, 0], places[:, 1:]])
    order = [int(np.flatnonzero((place == CORNERS).all(axis=1))[0]) for place in mirrored]
    return MeshHex(part.points.T.copy(), part.cells[:, order].T.copy())


def _keys(sides: Indices) -> NDArray[np.str_]:
    return np.array([" ".join(map(str, sorted(side))) for side in sides.tolist()], dtype=np.str_)


def _corners_of(body: Body, faces: Indices, part: PartMesh) -> NDArray[np.str_]:
    """Return the corners of faces as the part numbers them; nodes of corners come first."""
    at = faces[:, body.element.corners]
    place = np.full(len(body.nodes), -1)
    place[: len(part.points)] = np.arange(len(part.points))
    return _keys(place[at])


def faces_on_plane_within(body: Body, part: PartMesh, height: float) -> Indices:
    """Return the faces of the constraint, which may lie between two bricks."""
    faces = faces_on_plane(body, height)
    return faces[np.isin(_corners_of(body, faces, part), _keys(part.sides["constraint"]))]


def _grids(nodes: Floats, faces: Indices) -> Indices:
    """Return flat faces as grids over x and y."""
    ordered = np.empty_like(faces)
    for row, face in enumerate(faces):
        x, y = (np.round(nodes[face, axis], 6) for axis in (0, 1))
        ordered[row] = face[np.lexsort((y, x))]
    return ordered


def _line(body: Body, part: PartMesh, height: float) -> Indices:
    """Return the nodes along the middle of the constraint, or of the bottom."""
    near = FLAT * float(part.size.max())
    on = np.flatnonzero(
        (np.abs(body.nodes[:, 1]) < near) & (np.abs(body.nodes[:, 2] - height) < near)
    )
    line: Indices = on[np.argsort(body.nodes[on, 0])]
    ends = body.nodes[line[[0, -1]], 0] if len(line) else np.zeros(2)
    whole = len(line) > 2 and np.ptp(ends) > (1.0 - FLAT) * float(part.size[0])
    if not whole or (len(line) - 1) % body.element.order:
        raise GeometryError(
            "no line of edges runs along the middle of the constraint, or of the bottom: mesh the "
            "part so that one does"
        )
    return line
