"""Build a half model with named boundaries from a geometry or a user's mesh, with scikit-fem."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from skfem import ElementHex1, MeshHex

from bayesdeg.actuator.body import (
    APART,
    QUADRATIC,
    Body,
    Element,
    body_of,
    boundary_faces,
    faces_on_plane,
    levels_of,
    tetrahedra_of,
)
from bayesdeg.actuator.families import PartGeometry
from bayesdeg.actuator.moulded import Box, Moulded, Planes
from bayesdeg.actuator.round import RoundSection
from bayesdeg.actuator.status import COARSE as COARSE
from bayesdeg.actuator.status import CONVERGED as CONVERGED
from bayesdeg.actuator.status import FINE as FINE
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.part import CORNERS, FLAT, PartMesh
from bayesdeg.errors import GeometryError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

TOLERANCE = 1e-7  # mm: points this close to a box are inside
TOGETHER = 9  # decimals of a coordinate [mm]: nodes of core and ring equal to them are merged


@dataclass(frozen=True, eq=False)
class ActuatorMesh:
    """The half model: its body, and the node sets used by readings.

    Parameters
    ----------
    geometry : Moulded
        The meshed geometry.
    body : Body
        Cells; fixed, pressurised and papered faces; depth under faces exposed to the soil.
    free_end : array, shape (n_faces, n_nodes of a side)
        Nodes of the faces of the free end; grids over y and z, except for a user's mesh.
    bottom_line : array, shape (n,)
        Nodes of the line at the middle of the constraint layer, which is on the bottom of a
        pneunet, ordered along x; its curvature is read.
    share : float
        Share of the model's volume and force that half of the actuator has: 1/2 if the model is the
        whole actuator.
    unbent : array, shape (n_nodes, 3), optional
        Nodes of a round section in the block from which it is bent [mm].
    """

    geometry: Moulded
    body: Body
    free_end: Indices
    bottom_line: Indices
    share: float = 1.0
    unbent: Floats | None = None


def build_mesh(
    geometry: Moulded,
    resolution: Resolution,
    *,
    element: Element = QUADRATIC,
    cuts: Planes | None = None,
) -> ActuatorMesh:
    """Return the half model of an actuator.

    Parameters
    ----------
    geometry : Moulded
        The actuator as moulded, of any family.
    resolution : Resolution
        Largest element sizes [mm]; every wall has at least one element.
    element : Element
        Kind of brick; there is only one kind of tetrahedron.
    cuts : tuple of arrays, optional
        Additional mesh planes along x, y and z [mm].

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> mesh = build_mesh(Geometry(Dimensions()), COARSE)
    >>> bool(abs(mesh.body.volume - 1818.0) < 1e-6)  # volume of the material [mm³]
    True
    """
    if isinstance(geometry, PartGeometry):
        return _of_part(geometry, element)
    sizes = (resolution.along, resolution.across, resolution.up)
    also = (np.empty(0),) * 3 if cuts is None else cuts
    grids = [
        _divide(np.union1d(planes, more) if len(more) else planes, size, resolution.grading)
        for planes, more, size in zip(geometry.planes(), also, sizes, strict=True)
    ]
    body, unbent = _bricks(geometry, grids, resolution, element)
    faces = boundary_faces(body)
    middles = body.nodes[faces].mean(axis=1)
    pressed = _inside_any(middles, geometry.cavities) & ~np.isclose(middles[:, 1], 0.0)
    paper = faces[:0]
    if geometry.constraint.is_membrane:
        paper = grid_order(body.nodes, faces_on_plane(body, geometry.line_height))
    end = np.isclose(middles[:, 0], geometry.outer[0][1])
    nodes = body.nodes
    fixed = np.repeat(np.isclose(nodes[:, :1], 0.0), 3, axis=1)
    on_symmetry = np.isclose(nodes[:, 1], 0.0)
    fixed[:, 1] |= on_symmetry
    on_line = np.flatnonzero(on_symmetry & np.isclose(nodes[:, 2], geometry.line_height))
    return ActuatorMesh(
        geometry=geometry,
        body=replace(
            body,
            cavity=faces[pressed],
            paper=paper,
            fixed=fixed,
            depth=_depth(body, geometry),
            layer=_inside_any(body.nodes[body.elements].mean(axis=1), geometry.slab),
        ),
        free_end=grid_order(nodes, faces[end]) if unbent is None else faces[end],
        bottom_line=on_line[np.argsort(nodes[on_line, 0])],
        unbent=unbent,
    )


def with_held_tip(mesh: ActuatorMesh) -> ActuatorMesh:
    """Return the mesh with the lower edge of its free end held in the bending direction.

    Like resting on a load cell: it slides along x, and the end may rotate.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> mesh = build_mesh(Geometry(Dimensions()), COARSE)
    >>> int(np.sum(with_held_tip(mesh).body.fixed) - np.sum(mesh.body.fixed)) == len(tip_edge(mesh))
    True
    """
    fixed = mesh.body.fixed.copy()
    fixed[tip_edge(mesh), 2] = True
    return replace(mesh, body=replace(mesh.body, fixed=fixed))


def tip_edge(mesh: ActuatorMesh) -> Indices:
    """Return the nodes of the lower edge of the free end."""
    nodes = np.unique(mesh.free_end)
    height = mesh.body.nodes[nodes, 2]
    lowest: Indices = nodes[height < height.min() + APART]
    return lowest


def _bricks(
    geometry: Moulded, grids: list[Floats], resolution: Resolution, element: Element
) -> tuple[Body, Floats | None]:
    """Return the bricks of material, and those of a round section before bending."""
    section, (x, y, z) = geometry.rounded, grids
    if section is not None:
        a, b = section.core
        y = y[y <= a + APART]
        z = z[np.abs(z - section.axis) <= b + APART]
    full = MeshHex.init_tensor(x, y, z)
    centres = full.p[:, full.t].mean(axis=1).T
    hollow = _inside_any(centres, (*geometry.cavities, *geometry.voids))
    solid = full.restrict(np.flatnonzero(~hollow))
    if section is None:
        return body_of(solid, element), None
    size = 0.5 * (resolution.across + resolution.up)
    body = body_of(_ringed(solid, [x, y, z], section, size), element)
    return body.placed_at(section.bent(body.nodes)), body.nodes


def _ringed(core: MeshHex, grids: list[Floats], section: RoundSection, size: float) -> MeshHex:
    """Return bricks of a core and of the ring around it, at most ``size`` thick, before bending."""
    x, y, z = grids
    a, b = section.core
    edge = np.concatenate(
        [
            np.column_stack([y, np.full(len(y), -b)]),
            np.column_stack([np.full(len(z) - 1, a), z[1:] - section.axis]),
            np.column_stack([y[-2::-1], np.full(len(y) - 1, b)]),
        ]
    )
    thickness = 0.5 * (section.half_width - a + section.half_height - b)
    rings = np.linspace(1.0, 2.0, max(1, int(np.ceil(thickness / size))) + 1)
    ring = MeshHex.init_tensor(x, rings, np.arange(len(edge), dtype=np.float64))
    along, distance, place = ring.p
    at = edge[np.rint(place).astype(np.int64)]
    around = np.stack([along, distance * at[:, 0], section.axis + distance * at[:, 1]])
    points = np.hstack([core.p, around])
    bricks = np.hstack([core.t, ring.t + core.p.shape[1]])
    _, kept, which = np.unique(
        points.round(TOGETHER) + 0.0, axis=1, return_index=True, return_inverse=True
    )
    return MeshHex(points[:, kept], which.ravel()[bricks])


def reshaped(mesh: ActuatorMesh, *, wall_factor: float, erosion: float) -> ActuatorMesh:
    """Return the mesh with changed walls and eroded faces, by moving the same bricks [–, mm].

    Raises
    ------
    GeometryError
        If a wall or chamber vanishes.
    """
    geometry = mesh.geometry.changed(wall_factor=wall_factor, erosion=erosion)
    if not geometry.is_boxes:
        return mesh
    return moved_onto(mesh, geometry)


def moved_onto(mesh: ActuatorMesh, geometry: Moulded) -> ActuatorMesh:
    """Return a mesh with bricks moved onto a different actuator of the same family.

    The discretisation error is then nearly the same in two similar actuators made of boxes.

    Raises
    ------
    GeometryError
        If the faces are not in the same order.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> longer = moved_onto(
    ...     build_mesh(Geometry(Dimensions()), COARSE), Geometry(Dimensions(length=52.0))
    ... )
    >>> round(float(longer.body.nodes[:, 0].max()), 9)
    52.0
    """
    before, after = mesh.geometry.planes(), geometry.planes()
    if any(len(a) != len(b) for a, b in zip(before, after, strict=True)):
        raise GeometryError("the changed walls coincide with other faces; change less")
    start = mesh.body.nodes if mesh.unbent is None else mesh.unbent
    nodes = np.column_stack(
        [np.interp(start[:, axis], before[axis], after[axis]) for axis in range(3)]
    )
    section = geometry.rounded
    body = mesh.body.placed_at(nodes if section is None else section.bent(nodes))
    body = replace(body, depth=_depth(body, geometry))
    return replace(mesh, geometry=geometry, body=body, unbent=None if section is None else nodes)


def _depth(body: Body, geometry: Moulded) -> Floats:
    """Return the distance of quadrature points from faces exposed to the soil."""
    points = np.einsum("qa,eai->eqi", body.element.shapes, body.nodes[body.elements])
    (_, length), (_, half_width), (bottom, top) = geometry.outer
    if geometry.rounded is not None:
        nearest = np.minimum(length - points[..., 0], geometry.rounded.depth(points))
        under: Floats = np.maximum(nearest, 0.0)
        return under
    depth = np.min(np.array([length, half_width, top]) - points, axis=-1)
    if geometry.bottom_is_exposed:
        depth = np.minimum(depth, points[..., 2] - bottom)
    for void in geometry.exposed:
        low, high = np.array(void).T
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

    x = t − β sin(2πt)/(2π) for both ends, x = t − β sin(πt)/π for the first, with t uniform: end
    elements are 1 − β times as large as uniform ones. More elements on the same map are a true
    refinement, as extrapolation to vanishing size requires.

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


def _inside_any(points: Floats, boxes: tuple[Box, ...]) -> NDArray[np.bool_]:
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        low, high = np.array(box).T
        inside |= np.all((points > low - TOLERANCE) & (points < high + TOLERANCE), axis=1)
    return inside


def grid_order(nodes: Floats, faces: Indices) -> Indices:
    """Return the nodes of plane faces as grids over their two tangent axes, x before y before z."""
    ordered = np.empty_like(faces)
    for row, face in enumerate(faces):
        position = nodes[face]
        first, second = np.flatnonzero(np.ptp(position, axis=0) > APART)
        keys = [levels_of(position[:, axis])[1] for axis in (second, first)]
        ordered[row] = face[np.lexsort(keys)]
    return ordered


def _of_part(geometry: PartGeometry, element: Element) -> ActuatorMesh:
    """Return the mesh of a part meshed by the user, with straight-edged cells.

    There is only one tetrahedral element, whatever brick is requested.

    Raises
    ------
    GeometryError
        If no line of nodes runs along the middle of the constraint or the bottom.
    """
    part = geometry.part
    if part.is_tetrahedral:
        body = tetrahedra_of(part.points, part.cells)
    else:
        # scikit-fem's bricks are left-handed where the file's are right-handed
        places = np.asarray(ElementHex1().doflocs)
        mirrored = np.column_stack([1.0 - places[:, 0], places[:, 1:]])
        order = [int(np.flatnonzero((place == CORNERS).all(axis=1))[0]) for place in mirrored]
        bricks = MeshHex(part.points.T.copy(), part.cells[:, order].T.copy())
        body = body_of(bricks, element)
    faces = boundary_faces(body)
    corners = _corners_of(body, faces, part)
    on = {name: np.isin(corners, _keys(sides)) for name, sides in part.sides.items()}
    fixed = np.zeros(body.nodes.shape, dtype=bool)
    fixed[np.unique(faces[on["clamp"]])] = True
    if part.is_half:
        fixed[np.unique(faces[on["symmetry"]]), 1] = True
    paper = faces[:0]
    if geometry.constraint.is_membrane and "constraint" in part.sides:
        # the faces of the constraint may lie between two cells
        paper = faces_on_plane(body, geometry.line_height)
        paper = paper[np.isin(_corners_of(body, paper, part), _keys(part.sides["constraint"]))]
        paper = paper if part.is_tetrahedral else grid_order(body.nodes, paper)
    whole = replace(body, cavity=faces[on["cavity"]], paper=paper, fixed=fixed)
    line = _line_of_part(whole, part, geometry.line_height)
    share = 1.0 if part.is_half else 0.5
    return ActuatorMesh(geometry, whole, faces[on["tip"]], line, share)


def _keys(sides: Indices) -> NDArray[np.str_]:
    return np.array([" ".join(map(str, sorted(side))) for side in sides.tolist()], dtype=np.str_)


def _corners_of(body: Body, faces: Indices, part: PartMesh) -> NDArray[np.str_]:
    """Return the corners of faces in the part's numbering; corner nodes come first."""
    at = faces[:, body.element.corners]
    place = np.full(len(body.nodes), -1)
    place[: len(part.points)] = np.arange(len(part.points))
    return _keys(place[at])


def _line_of_part(body: Body, part: PartMesh, height: float) -> Indices:
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
            "no line of edges runs along the middle of the constraint, or of the bottom: add one "
            "to the mesh of the part"
        )
    return line
