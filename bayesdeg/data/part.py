"""A part meshed by the user: cells and named boundaries of a file, and its faults.

Gmsh, Abaqus and VTU are read. A boundary is named by a physical group or set of faces, by a node
set, or by a nodal array that is non-zero on it. x runs from the clamp along the part, z up from the
constraint, in mm; the part may be cut at a plane of symmetry across y.
"""

import hashlib
import importlib
import io
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from bayesdeg.data.families import LARGEST_MM
from bayesdeg.files import STUDY_MB, read_bytes

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

FORMATS = {".msh": "Gmsh", ".inp": "Abaqus", ".vtu": "VTU"}
NEEDED, OPTIONAL = ("clamp", "cavity", "tip"), ("constraint", "symmetry")
CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
)
"""Nodes of a brick on the unit cube, in the node order of these file formats."""
SIDES = np.array(
    [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
)
"""Nodes of a brick's sides, ordered so that the normal points into the brick."""
SIDES_OF_TETRAHEDRON = np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
"""The same for a tetrahedron, whose fourth node lies where the normal of the others points."""
VOLUMES = ("tetra", "hexahedron", "wedge", "pyramid")
SHORTEST_MM = 1.0  # a part in metres is shorter
FLAT = 1e-4  # of the length: tolerance for lying in a plane
MOST_CELLS = 20_000
"""About ten times the bricks of the default actuator's fine mesh, half a million unknowns.

As many tetrahedra have half of that: about 14 unknowns each; a 27-node brick has 27.
"""
HOW_TO_EXPORT = (
    'export hexahedra of 8 nodes, in Gmsh by "Recombine" and "Transfinite", or tetrahedra alone'
)


class PartError(Exception):
    """A part that cannot be used: what is wrong and, after a semicolon, what to do."""


@dataclass(frozen=True, eq=False)
class PartMesh:
    """Bricks or tetrahedra with named boundaries, shifted so that the clamp is at x = 0.

    Parameters
    ----------
    points : array, shape (n_points, 3)
        Corners [mm]; the lowest at z = 0, the plane of symmetry, or else the middle,
        at y = 0.
    cells : array, shape (n_cells, 8) or (n_cells, 4)
        Corners of bricks in the order of `CORNERS`, or of tetrahedra.
    sides : mapping of str to array, shape (n_sides, 4) or (n_sides, 3)
        Corners of the sides on each boundary, around each side.
    content : str
        Hash of the file.
    """

    points: Floats
    cells: Indices
    sides: Mapping[str, Indices]
    content: str

    @property
    def size(self) -> Floats:
        """Length, width and height of the mesh [mm]."""
        extent: Floats = np.ptp(self.points, axis=0)
        return extent

    @property
    def is_half(self) -> bool:
        """Whether the part is cut at a plane of symmetry."""
        return "symmetry" in self.sides

    @property
    def is_tetrahedral(self) -> bool:
        """Whether its cells are tetrahedra."""
        return bool(self.cells.shape[1] == 4)


def read_part(place: Path | str) -> PartMesh:
    """Return the part in a file; parts read before are cached.

    Raises
    ------
    PartError
        If it cannot be used.
    """
    path = Path(place)
    if path.suffix.lower() not in FORMATS:
        known = ", ".join(f"{name} ({end})" for end, name in FORMATS.items())
        raise PartError(f"{path.name} is not a mesh of a known format; give a file of {known}")
    try:
        content = read_bytes(path, most_mb=STUDY_MB)
    except FileNotFoundError:
        raise PartError(f"{path.name} does not exist; put the mesh next to study.toml") from None
    except OSError as fault:
        raise PartError(f"{path.name} cannot be read ({fault}); export it again") from None
    return _read(path, hashlib.sha256(content).hexdigest())


@lru_cache(maxsize=4)
def _read(path: Path, content: str) -> PartMesh:
    said = io.StringIO()  # meshio prints what it raises
    try:
        with redirect_stdout(said), redirect_stderr(said):
            # slow to import, and only needed for meshed parts
            mesh = importlib.import_module("meshio").read(path)
    except (SystemExit, Exception) as fault:  # meshio exits the process on unknown input
        raise PartError(
            f"{path.name} cannot be read as {FORMATS[path.suffix.lower()]} ({fault}); "
            "export it again, or in a different format"
        ) from None
    points, cells = _cells(mesh)
    sides = _boundaries(mesh, points, cells)
    used, cells_of_used = np.unique(cells, return_inverse=True)
    place = np.full(len(points), -1)
    place[used] = np.arange(len(used))
    kept = {name: place[at] for name, at in sides.items()}
    part = PartMesh(points[used], cells_of_used.reshape(cells.shape), kept, content)
    # causes before their consequences
    for check in (_wrong_size, _inverted, _apart, _open_cavity, _wrong_planes, _wrong_constraint):
        _refuse(check(part))
    moved = _moved(part)
    _refuse(_without_line(moved))
    return moved


def _cells(mesh: Any) -> tuple[Floats, Indices]:
    kinds = {block.type for block in mesh.cells if block.type.startswith(VOLUMES)}
    other = sorted(kinds - {"hexahedron", "tetra", "tetra10"})
    if other:
        raise PartError(
            f"has cells of type {', '.join(other)}, which are not supported; {HOW_TO_EXPORT}"
        )
    if not kinds:
        raise PartError(f"has no cells with a volume; {HOW_TO_EXPORT}")
    if "hexahedron" in kinds and len(kinds) > 1:
        raise PartError(f"mixes hexahedra and tetrahedra, which is not supported; {HOW_TO_EXPORT}")
    corners = 8 if "hexahedron" in kinds else 4
    found = [block.data[:, :corners] for block in mesh.cells if block.type in kinds]
    cells = np.vstack(found).astype(np.int64)
    if len(cells) > MOST_CELLS:
        raise PartError(
            f"has {len(cells)} cells, too many to solve for a study; "
            f"give a coarser mesh of at most {MOST_CELLS} cells"
        )
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.shape[1] != 3 or not np.all(np.isfinite(points)):
        raise PartError("has points without finite coordinates; export it again")
    return points, cells


def _boundaries(mesh: Any, points: Floats, cells: Indices) -> dict[str, Indices]:
    """Return the outer sides on each named boundary.

    Where nodes name the cavity, a side in a plane end or cut does not belong to it even if all its
    nodes do: a triangle in the plane of symmetry can have three nodes on the cavity's edge. Named
    faces are used unchanged.
    """
    outer = outer_sides(cells)
    every = {name: _marked(mesh, name, outer, len(points)) for name in (*NEEDED, *OPTIONAL)}
    on = {name: marked for name, marked in every.items() if marked is not None}
    if "cavity" in on and not len(_named_faces(mesh, "cavity", outer.shape[1])):
        for name in on.keys() & {"symmetry", "clamp", "tip"}:
            on["cavity"] = on["cavity"] & ~on[name]
    found = {name: outer[marked] for name, marked in on.items() if marked.any()}
    missing = [name for name in NEEDED if name not in found]
    if missing:
        named = sorted({*mesh.cell_sets, *mesh.point_sets, *mesh.point_data, *mesh.field_data})
        known = ", ".join(n for n in named if ":" not in n) or "none"
        raise PartError(
            f"has no boundary named {' and none named '.join(missing)} (named: {known}); "
            "name the faces by a physical group, or their nodes by a set or an array"
        )
    return found


def outer_sides(cells: Indices) -> Indices:
    """Return the sides that belong to only one cell, (n_sides, 4) or (n_sides, 3).

    Examples
    --------
    >>> len(outer_sides(np.arange(8)[None])), len(outer_sides(np.arange(4)[None]))
    (6, 4)
    """
    local = SIDES_OF_TETRAHEDRON if cells.shape[1] == 4 else SIDES
    sides = cells[:, local].reshape(-1, local.shape[1])
    _, first, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer: Indices = sides[np.sort(first[count == 1])]
    return outer


def _marked(mesh: Any, name: str, outer: Indices, count: int) -> Flags | None:
    """Return which outer sides are on a boundary; None if nothing has that name."""
    faces = _named_faces(mesh, name, outer.shape[1])
    if len(faces):
        wanted = {tuple(row) for row in np.sort(faces, axis=1).tolist()}
        keys = np.sort(outer, axis=1).tolist()
        return np.array([tuple(row) in wanted for row in keys], dtype=bool)
    on = np.zeros(count, dtype=bool)
    if name in mesh.point_sets:
        on[np.asarray(mesh.point_sets[name], dtype=np.int64)] = True
    elif name in mesh.point_data and np.ndim(mesh.point_data[name]) == 1:
        on = np.asarray(mesh.point_data[name]) != 0
    else:
        return None
    marked: Flags = on[outer].all(axis=1)
    return marked


def _named_faces(mesh: Any, name: str, corners: int) -> Indices:
    """Return the faces with ``corners`` corners of a named set or physical group."""
    kind = "triangle" if corners == 3 else "quad"
    found = [np.empty((0, corners), dtype=np.int64)]
    tag = mesh.field_data.get(name, [None])[0]
    tags = mesh.cell_data.get("gmsh:physical", [()] * len(mesh.cells))
    rows_of_set = mesh.cell_sets.get(name, [()] * len(mesh.cells))
    for block, of_group, of_set in zip(mesh.cells, tags, rows_of_set, strict=True):
        if block.type in (kind, "triangle6" if corners == 3 else kind):
            rows = np.asarray(() if of_set is None else of_set, dtype=np.int64)
            if tag is not None and len(of_group):
                rows = np.union1d(rows, np.flatnonzero(np.asarray(of_group) == tag))
            found.append(np.asarray(block.data, dtype=np.int64)[rows, :corners])
    return np.vstack(found)


def _refuse(problems: Iterator[str]) -> None:
    """Refuse a part for its first problem."""
    for problem in problems:
        raise PartError(problem)


def _wrong_size(part: PartMesh) -> Iterator[str]:
    length = float(part.size.max())
    if length > LARGEST_MM:
        yield (
            f"is {length:g} mm long, too long for a soft actuator; likely in µm: export it in "
            "mm, or divide by 1000"
        )
    elif length < SHORTEST_MM:
        yield f"is {length:g} mm long; likely in m: export it in mm, or multiply by 1000"


def jacobians(corners: Floats) -> Floats:
    """Return each cell's smallest Jacobian determinant at its corners, (n,) from (n, 8, 3) [mm³].

    It is constant over a tetrahedron, (n, 4, 3).
    """
    if corners.shape[1] == 4:
        return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    found = []
    for corner in CORNERS:
        at = corners[:, np.flatnonzero((corner == CORNERS).all(axis=1))[0]]
        edges = []
        for axis in range(3):
            other = corner.copy()
            other[axis] = 1 - other[axis]
            there = corners[:, np.flatnonzero((other == CORNERS).all(axis=1))[0]]
            edges.append((there - at) * (1 - 2 * corner[axis]))
        found.append(np.linalg.det(np.stack(edges, axis=1)))
    least: Floats = np.min(found, axis=0)
    return least


def _inverted(part: PartMesh) -> Iterator[str]:
    wrong = np.flatnonzero(~(jacobians(part.points[part.cells]) > 0.0))
    if len(wrong):
        at = part.points[part.cells[wrong[0]]].mean(axis=0)
        kind = "tetrahedra" if part.is_tetrahedral else "bricks"
        yield (
            f"has {len(wrong)} {kind} that are flat or inverted, the first at {_place(at)}; remesh "
            "there, or correct the node order"
        )


def _apart(part: PartMesh) -> Iterator[str]:
    rows = np.repeat(np.arange(len(part.cells)), part.cells.shape[1])
    joins = scipy.sparse.coo_array(
        (np.ones(len(rows)), (rows, part.cells.ravel())),
        shape=(len(part.cells), len(part.points)),
    ).tocsr()
    count, _ = scipy.sparse.csgraph.connected_components(joins @ joins.T, directed=False)
    if count > 1:
        yield (
            f"consists of {count} pieces that share no nodes; merge coincident nodes "
            'before the export, in Gmsh by "Coherence"'
        )


def _open_cavity(part: PartMesh) -> Iterator[str]:
    """Say where the cavity is open: it may be so only in the plane of symmetry."""
    sides = part.sides["cavity"]
    edges = np.sort(np.stack([sides, np.roll(sides, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    each, count = np.unique(edges, axis=0, return_counts=True)
    loose = each[count % 2 == 1]
    if part.is_half:
        cut = np.unique(part.sides["symmetry"])
        loose = loose[~np.isin(loose, cut).all(axis=1)]
    if len(loose):
        at = part.points[loose[0]].mean(axis=0)
        yield (
            f"has a hole in its cavity: {len(loose)} edges of faces named cavity have no "
            f"neighbour, the first at {_place(at)}; name all faces that the pressure acts on, "
            "and close the inlet"
        )


def _wrong_planes(part: PartMesh) -> Iterator[str]:
    tolerance = FLAT * float(part.size.max())
    x = part.points[:, 0]
    for name, side, wanted in (("clamp", "the lowest", x.min()), ("tip", "the largest", x.max())):
        if np.abs(x[part.sides[name]] - wanted).max() > tolerance:
            yield (
                f"has a {name} that is not the plane end at {side} x; turn the part so that "
                "x runs from the clamp to the tip, z up from the constraint, and cut both ends"
            )
    if part.is_half:
        across, y = part.points[part.sides["symmetry"], 1], part.points[:, 1]
        middle = across.mean()
        off = min(abs(middle - y.min()), abs(middle - y.max()))
        if np.ptp(across) > tolerance or off > tolerance:
            yield (
                "has a symmetry plane that is not an end of the part across y; turn the part so "
                "that y runs across"
            )


def _wrong_constraint(part: PartMesh) -> Iterator[str]:
    if "constraint" not in part.sides:
        return
    sides, tolerance = part.points[part.sides["constraint"]], FLAT * float(part.size.max())
    nodes = np.unique(part.sides["constraint"])
    x, y = (_distinct(part.points[nodes, axis], tolerance) for axis in (0, 1))
    flat = np.ptp(sides[..., 2]) <= tolerance
    if part.is_tetrahedral:
        if not flat:
            yield "has a constraint that is not flat; name a plane face, or omit it"
    elif not flat or len(nodes) != x * y:
        yield (
            "has a constraint that is not a flat rectangle meshed by a grid of rectangles; mesh "
            "the face that carries the paper or film with lines along x and y, or omit it"
        )


def _without_line(part: PartMesh) -> Iterator[str]:
    """Say if no line of nodes runs along the middle of the constraint, or of the bottom."""
    near, length = FLAT * float(part.size.max()), float(part.size[0])
    off = np.abs(part.points[:, 1:] - [0.0, plane_of(part)])
    x = part.points[(off < near).all(axis=1), 0]
    if len(x) < 2 or np.ptp(x) < length - near:
        yield (
            "has no line of nodes along the middle of its constraint, or of its bottom, where the "
            "curvature is read; partition the part there before meshing"
        )


def _distinct(values: Floats, tolerance: float) -> int:
    return 1 + int(np.sum(np.diff(np.sort(values)) > tolerance))


def _moved(part: PartMesh) -> PartMesh:
    """Put the clamp at x = 0, the lowest point at z = 0, and the symmetry or middle at y = 0."""
    points = part.points.copy()
    # faces are searched in planes, and a file with few digits has rounded points
    for name, axis in (("clamp", 0), ("tip", 0), ("symmetry", 1), ("constraint", 2)):
        if name in part.sides:
            nodes = np.unique(part.sides[name])
            points[nodes, axis] = np.median(points[nodes, axis])
    points[:, 0] -= points[:, 0].min()
    points[:, 2] -= points[:, 2].min()
    if part.is_half:
        points[:, 1] -= points[part.sides["symmetry"], 1].mean()
        if points[:, 1].mean() < 0.0:  # only the other half was meshed: mirror it
            points[:, 1] *= -1.0
            mirrored = [0, 2, 1, 3] if part.is_tetrahedral else [3, 2, 1, 0, 7, 6, 5, 4]
            return replace(part, points=points, cells=part.cells[:, mirrored])
    else:
        points[:, 1] -= 0.5 * (points[:, 1].min() + points[:, 1].max())
    return replace(part, points=points)


def _place(at: Floats) -> str:
    return f"({', '.join(f'{value:.4g}' for value in at)}) mm"


def volume_of(part: PartMesh) -> float:
    """Return the volume of the cells [mm³], with bricks cut into tetrahedra about their centres."""
    return float(np.abs(jacobians(_tetrahedra(part))).sum()) / 6.0


def _tetrahedra(part: PartMesh) -> Floats:
    """Return the corners of the cells, (n, 4, 3) [mm], each brick cut into 24 about its centre."""
    corners = part.points[part.cells]
    if part.is_tetrahedral:
        return corners
    sides = corners[:, SIDES]
    ends = (
        corners.mean(axis=1)[:, None, None],
        sides.mean(axis=2, keepdims=True),
        sides,
        np.roll(sides, -1, axis=2),
    )
    cut = np.stack(np.broadcast_arrays(*ends), axis=-2)
    return cut.reshape(-1, 4, 3)


def cavity_of(part: PartMesh) -> tuple[float, float]:
    """Return volume of the cavity [mm³] and height of its centroid [mm], by the divergence theorem.

    The open cut at the plane of symmetry goes through the origin and adds nothing.
    """
    total, height = 0.0, 0.0
    for triangle in ((0, 1, 2), (0, 2, 3))[: part.sides["cavity"].shape[1] - 2]:
        a, b, c = (part.points[part.sides["cavity"][:, k]] for k in triangle)
        six = np.einsum("ni,ni->n", a, np.cross(b, c))
        total += float(six.sum()) / 6.0
        height += float((six * (a + b + c)[:, 2]).sum()) / 24.0
    return abs(total), height / total if total else 0.0


def bending_of(part: PartMesh) -> float:
    r"""Return the bend angle over p/C1 of a beam of the part's mean section [rad].

    .. math:: \theta = \frac{p V_c z_c}{6 C_1 \int z^2 dV} L

    with :math:`V_c` and :math:`z_c` the volume of the cavity and the height of its centroid above
    the constraint, or the bottom, and the integral over the material: a rough size. For a
    tetrahedron of volume v the integral is :math:`v/20 [\sum z_i^2 + (\sum z_i)^2]`, with the
    heights of its corners above the same plane.
    """
    plane = plane_of(part)
    volume, height = cavity_of(part)
    cells = _tetrahedra(part)
    z = cells[..., 2] - plane
    squares = np.sum(z**2, axis=1) + np.sum(z, axis=1) ** 2
    second = float(np.abs(jacobians(cells)) @ squares) / 120.0
    return volume * (height - plane) / (6.0 * second) * float(part.size[0])


def plane_of(part: PartMesh) -> float:
    """Return the height of the constraint, 0 without one [mm]."""
    if "constraint" not in part.sides:
        return 0.0
    return float(part.points[part.sides["constraint"], 2].mean())
