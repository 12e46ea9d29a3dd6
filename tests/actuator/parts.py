"""Files of meshed parts: the mesh of an actuator of boxes, with its boundaries by name."""

import meshio
import numpy as np

from bayesdeg.actuator.body import LINEAR_CONSTANT
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.settings import Dimensions

SMALL = Geometry(Dimensions(length=20.0, chambers=2))
COARSEST = Resolution(9.0, 9.0, 9.0)
ORDER = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
)


KINDS = {
    4: ("tetra", "triangle"),
    8: ("hexahedron", "quad"),
    10: ("tetra10", "triangle6"),
}


def half(geometry=SMALL, resolution=COARSEST):
    """Points, bricks in the order of VTK, and faces by boundary, of the half of an actuator."""
    mesh = build_mesh(geometry, resolution, element=LINEAR_CONSTANT)
    points = mesh.body.nodes
    corners = points[mesh.body.elements]
    low, high = corners.min(axis=1), corners.max(axis=1)
    bricks = []
    for nodes, own, a, b in zip(mesh.body.elements, corners, low, high, strict=True):
        at = np.round((own - a) / (b - a)).astype(int)
        bricks.append([nodes[np.flatnonzero((at == place).all(axis=1))[0]] for place in ORDER])
    around = [0, 1, 3, 2]  # of a grid of four
    sides = {
        "cavity": mesh.body.cavity[:, around],
        "constraint": mesh.body.paper[:, around],
        "tip": mesh.free_end[:, around],
    }
    bricks = np.array(bricks)
    for name, axis in (("clamp", 0), ("symmetry", 1)):
        sides[name] = plane(points, bricks, axis, 0.0)
    return points, bricks, sides


def plane(points, bricks, axis, value):
    """Sides of bricks that lie in a plane."""
    faces = [
        (0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)
    ]  # fmt: skip
    found = bricks[:, np.array(faces)].reshape(-1, 4)
    return found[np.isclose(points[found][..., axis], value).all(axis=1)]


def whole(geometry=SMALL, resolution=COARSEST):
    """The same of both halves, put together at the plane of symmetry."""
    points, bricks, sides = half(geometry, resolution)
    other = points * [1.0, -1.0, 1.0]
    on = np.isclose(points[:, 1], 0.0)
    place = np.where(on, np.arange(len(points)), -1)
    place[~on] = len(points) + np.arange(int(np.sum(~on)))
    mirrored = place[bricks[:, [3, 2, 1, 0, 7, 6, 5, 4]]]
    both = {n: np.vstack([s, place[s]]) for n, s in sides.items() if n != "symmetry"}
    return np.vstack([points, other[~on]]), np.vstack([bricks, mirrored]), both


def write(path, part, *, by="faces"):
    """Write a part to a file: boundaries by physical groups, sets of nodes or arrays over them."""
    points, bricks, sides = part
    volumes, surfaces = KINDS[bricks.shape[1]]
    if by == "faces":
        names = {name: np.array([k + 1, 2]) for k, name in enumerate(sides)}
        cells = [(volumes, bricks), *((surfaces, faces) for faces in sides.values())]
        tags = [np.full(len(bricks), 99), *(np.full(len(f), names[n][0]) for n, f in sides.items())]
        mesh = meshio.Mesh(
            points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}
        )
        mesh.field_data = names | {"body": np.array([99, 3])}
        meshio.write(path, mesh, file_format="gmsh22", binary=False)
    elif by == "nodes":
        sets = {name: np.unique(faces) for name, faces in sides.items()}
        meshio.write(path, meshio.Mesh(points, [(volumes, bricks)], point_sets=sets))
    else:
        marks = {
            name: np.isin(np.arange(len(points)), f).astype(float) for name, f in sides.items()
        }
        meshio.write(path, meshio.Mesh(points, [(volumes, bricks)], point_data=marks))
    return path


PATHS = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
"""Corners of the six tetrahedra about the diagonal of a brick, in the order of VTK."""


def tetrahedral(part):
    """The same part with each brick cut into six tetrahedra, all along the same diagonals."""
    points, bricks, sides = part
    cells = bricks[:, np.array(PATHS)].reshape(-1, 4)
    local = np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
    faces = cells[:, local].reshape(-1, 3)
    cut = {}
    for name, quads in sides.items():
        four = {frozenset(quad) for quad in quads.tolist()}
        halves = {frozenset(three): None for three in faces.tolist()}
        wanted = {
            three
            for quad in four
            for three in (quad - {corner} for corner in quad)
            if three in halves
        }
        on = [frozenset(face) in wanted for face in faces.tolist()]
        every = faces[np.array(on)]
        _, first = np.unique(np.sort(every, axis=1), axis=0, return_index=True)
        cut[name] = every[first]
    return points, cells, cut
