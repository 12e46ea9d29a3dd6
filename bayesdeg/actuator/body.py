"""Bodies of bricks or of tetrahedra: elements, nodes, and fixed, pressurised and papered parts."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementHex1, ElementHex2, ElementTetCCR, MeshHex
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from bayesdeg.data.part import SIDES_OF_TETRAHEDRON

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Element:
    """A brick on the unit cube, or a tetrahedron: shapes, quadrature, and modes of its pressure.

    Parameters
    ----------
    name : str
        Name of the element.
    order : int
        1 for trilinear, 2 for triquadratic shape functions; nodes in scikit-fem's order.
    points, weights : array, shape (n_points, 3) and (n_points,)
        Gauss rule of ``order + 1`` points a direction.
    shapes : array, shape (n_points, n_local)
        Shape functions at the points.
    slopes : array, shape (n_points, n_local, 3)
        Their derivatives.
    modes : array, shape (n_points, n_modes)
        Functions that span the discontinuous pressure, at the points.
    sides : array, shape (n_sides, n_nodes)
        Local nodes of its sides, such that first axis times second axis points inwards.
    corners : array, shape (n_corners,)
        Which of the nodes of a side are its corners.
    triangular : bool
        Whether sides are triangles, with nodes as of `bayesdeg.actuator.kernels.triangle_shapes`;
        else they are grids.
    """

    name: str
    order: int
    points: Floats
    weights: Floats
    shapes: Floats
    slopes: Floats
    modes: Floats
    sides: Indices
    corners: Indices
    triangular: bool = False


def reference_faces(order: int) -> Indices:
    """Return the local nodes of the six faces of a brick as grids that point inwards."""
    kind = ElementHex1() if order == 1 else ElementHex2()
    places = np.asarray(kind.doflocs)
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for side in (0.0, 1.0):
            on = np.flatnonzero(places[:, axis] == side)
            # first × second points along +axis, which is inwards on the low side
            slow, fast = (first, second) if side == 0.0 else (second, first)
            faces.append(on[np.lexsort((places[on, fast], places[on, slow]))])
    return np.array(faces, dtype=np.int64)


def _made(
    name: str,
    order: int,
    kind: Any,
    degree: int,
    places: Iterable[int],
    modes: Callable[[Floats], Floats],
    sides: Indices,
    corners: Indices,
) -> Element:
    """Return an element with scikit-fem's shape functions of some places at Gauss points."""
    points, weights = get_quadrature(kind.refdom, degree)
    basis = [kind.lbasis(points, a) for a in places]
    shapes = np.stack([values for values, _ in basis], axis=1)
    slopes = np.stack([gradients for _, gradients in basis], axis=1)
    return Element(
        name,
        order,
        np.ascontiguousarray(points.T),
        np.ascontiguousarray(weights),
        np.ascontiguousarray(shapes),
        np.ascontiguousarray(np.transpose(slopes, (2, 1, 0))),
        np.ascontiguousarray(modes(points.T)),
        sides,
        corners,
        triangular=kind.refdom is RefTet,
    )


def _element(name: str, order: int, modes: Callable[[Floats], Floats]) -> Element:
    kind, side = ElementHex1() if order == 1 else ElementHex2(), order + 1
    corners = np.array([0, side - 1, side * (side - 1), side * side - 1])
    count = 8 if order == 1 else 27
    return _made(
        *(name, order, kind, 2 * order + 1, range(count), modes, reference_faces(order), corners)
    )


def tetrahedron(degree: int = 6) -> Element:
    """Return the conforming Crouzeix–Raviart element: P2 with side and volume bubbles, P1 pressure.

    Its 15 nodes are in the order of `reference_nodes`. Quadratics alone do not satisfy the inf-sup
    condition with a linear pressure, and with a constant pressure converge only to first order.

    Parameters
    ----------
    degree : int
        Degree of polynomials integrated exactly by its quadrature.

    Examples
    --------
    >>> tetrahedron(2).shapes.shape
    (4, 15)

    References
    ----------
    Crouzeix and Raviart (1973), RAIRO 7:33, doi:10.1051/m2an/197307R300331.
    """
    kind = ElementTetCCR()
    ours = _nodes_of(np.vstack([np.zeros(3), np.eye(3)]))
    distance = np.abs(ours[:, None] - np.asarray(kind.doflocs)[None]).sum(axis=2)
    places = np.argmin(distance, axis=1).tolist()

    def modes(points: Floats) -> Floats:
        return np.hstack([np.ones((len(points), 1)), points - 0.25])

    return _made("P2+P1disc", 2, kind, degree, places, modes, _NODES_OF_SIDES, np.arange(3))


EDGES_OF_TETRAHEDRON = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)])


_MIDDLES = {frozenset(edge): 4 + k for k, edge in enumerate(EDGES_OF_TETRAHEDRON.tolist())}
# corners, middles of edges and middle of each side among the 15 nodes
_NODES_OF_SIDES = np.array(
    [
        [a, b, c, *(_MIDDLES[frozenset(edge)] for edge in ((a, b), (b, c), (c, a))), 10 + k]
        for k, (a, b, c) in enumerate(SIDES_OF_TETRAHEDRON.tolist())
    ]
)


def _nodes_of(corners: Floats) -> Floats:
    """Return the 15 nodes of straight tetrahedra, (..., 15, 3) of (..., 4, 3)."""
    edges = corners[..., EDGES_OF_TETRAHEDRON, :].mean(axis=-2)
    faces = corners[..., SIDES_OF_TETRAHEDRON, :].mean(axis=-2)
    middle = corners.mean(axis=-2, keepdims=True)
    return np.concatenate([corners, edges, faces, middle], axis=-2)


def reference_nodes(element: Element) -> Floats:
    """Return the nodes of an element on the unit cube, or the unit tetrahedron, (n, 3).

    Examples
    --------
    >>> reference_nodes(TETRAHEDRON)[[3, 4, 14]].tolist()
    [[0.0, 0.0, 1.0], [0.5, 0.0, 0.0], [0.25, 0.25, 0.25]]
    """
    if element.triangular:
        return _nodes_of(np.vstack([np.zeros(3), np.eye(3)]))
    return np.asarray((ElementHex1() if element.order == 1 else ElementHex2()).doflocs)


# a pressure free at every quadrature point is equivalent to none: this element locks
LINEAR_FULL = _element("Q1", 1, lambda points: np.eye(len(points)))
LINEAR_CONSTANT = _element("Q1P0", 1, lambda points: np.ones((len(points), 1)))
QUADRATIC_CONSTANT = _element("Q2P0", 2, lambda points: np.ones((len(points), 1)))
QUADRATIC = _element(
    "Q2P1disc", 2, lambda points: np.hstack([np.ones((len(points), 1)), points - 0.5])
)
TETRAHEDRON = tetrahedron()


@dataclass(frozen=True, eq=False)
class Body:
    """A body of bricks or tetrahedra of one element type.

    Parameters
    ----------
    element : Element
        Element type.
    nodes : array, shape (n_nodes, 3)
        Coordinates [mm].
    elements : array, shape (n_elements, n_local)
        Nodes of every brick.
    gradients : array, shape (n_elements, n_points, 3, n_local)
        Gradients of the shape functions at the quadrature points [1/mm].
    weights : array, shape (n_elements, n_points)
        Volume of every quadrature point [mm³].
    cavity : array, shape (n_faces, (order + 1)²)
        Nodes of faces under pressure, as grids whose first axis times second axis points out
        of the cavity, into the body.
    paper : array, shape (n_faces, (order + 1)²)
        Nodes of the faces in a plane z = const that carry paper, or any other inextensible layer;
        first axis along x, second along y.
    fixed : array of bool, shape (n_nodes, 3)
        Displacements fixed at zero.
    depth : array, shape (n_elements, n_points)
        Depth of each quadrature point under the nearest exposed face; inf if there is none [mm].
    layer : array of bool, shape (n_elements,)
        Bricks of a layer of a different elastomer.
    """

    element: Element
    nodes: Floats
    elements: Indices
    gradients: Floats
    weights: Floats
    cavity: Indices
    paper: Indices
    fixed: NDArray[np.bool_]
    depth: Floats
    layer: NDArray[np.bool_]

    def placed_at(self, nodes: Floats) -> Self:
        """Return the same bricks with moved nodes, (n_nodes, 3) [mm]."""
        gradients, weights = isoparametric(self.element, nodes[self.elements])
        return replace(self, nodes=nodes, gradients=gradients, weights=weights)

    @property
    def volume(self) -> float:
        """Volume of the undeformed body [mm³]."""
        return float(self.weights.sum())


def isoparametric(element: Element, corners: Floats) -> tuple[Floats, Floats]:
    """Return gradients and volumes of quadrature points from the nodes of every brick.

    From nodes (n_elements, n_local, 3) [mm] to gradients (n_elements, n_points, 3, n_local) [1/mm]
    and volumes (n_elements, n_points) [mm³].

    Raises
    ------
    ValueError
        If a brick is inverted.
    """
    jacobian = np.einsum("eai,qaj->eqij", corners, element.slopes, optimize=True)
    determinant = np.linalg.det(jacobian)
    if not np.all(determinant > 0.0):
        raise ValueError("a brick of the mesh is inverted; correct its node order")
    inverse = np.linalg.inv(jacobian)
    gradients = np.einsum("qaj,eqji->eqia", element.slopes, inverse, optimize=True)
    return np.ascontiguousarray(gradients), determinant * element.weights


def body_of(mesh: MeshHex, element: Element = QUADRATIC) -> Body:
    """Return the body of a scikit-fem mesh: nothing fixed, pressurised or papered yet."""
    kind = ElementHex1() if element.order == 1 else ElementHex2()
    basis = Basis(mesh, kind, intorder=2 * element.order + 1)
    nodes = np.ascontiguousarray(basis.doflocs.T)
    # the order of local nodes that turns scikit-fem's left-handed tensor bricks right-handed
    places = np.asarray(kind.doflocs)
    mirrored = places * [-1.0, 1.0, 1.0] + [1.0, 0.0, 0.0]
    order = np.argmin(np.abs(places[None] - mirrored[:, None]).sum(axis=2), axis=1)
    elements = np.ascontiguousarray(basis.element_dofs.T.astype(np.int64)[:, order])
    return _bare(element, nodes, elements)


def _bare(element: Element, nodes: Floats, elements: Indices) -> Body:
    gradients, weights = isoparametric(element, nodes[elements])
    none = np.empty((0, element.sides.shape[1]), dtype=np.int64)
    return Body(
        *(element, nodes, elements, gradients, weights),
        cavity=none,
        paper=none,
        fixed=np.zeros(nodes.shape, dtype=bool),
        depth=np.full(weights.shape, np.inf),
        layer=np.zeros(len(elements), dtype=bool),
    )


def tetrahedra_of(points: Floats, cells: Indices) -> Body:
    """Return the body of straight tetrahedra: nothing fixed, pressurised or papered yet.

    Parameters
    ----------
    points : array, shape (n_points, 3)
        Corners [mm]; they are the first nodes of the body.
    cells : array, shape (n_cells, 4)
        Corners of each tetrahedron, the fourth on the side to which the normal of the others goes.

    Raises
    ------
    ValueError
        If one is inverted.

    Examples
    --------
    >>> corners = np.vstack([np.zeros(3), np.eye(3)])
    >>> body = tetrahedra_of(corners, np.arange(4)[None])
    >>> len(body.nodes), round(6.0 * body.volume, 12)
    (15, 1.0)
    """
    kinds = (cells[:, EDGES_OF_TETRAHEDRON], cells[:, SIDES_OF_TETRAHEDRON], cells[:, None])
    nodes, elements = [points], [cells]
    for kind in kinds:
        keys = np.sort(kind.reshape(-1, kind.shape[2]), axis=1)
        every, which = np.unique(keys, axis=0, return_inverse=True)
        elements.append(which.reshape(kind.shape[:2]) + sum(map(len, nodes)))
        nodes.append(points[every].mean(axis=1))
    return _bare(TETRAHEDRON, np.vstack(nodes), np.hstack(elements).astype(np.int64))


def box(
    lengths: tuple[float, float, float],
    *,
    divisions: tuple[int, int, int],
    element: Element = QUADRATIC,
) -> Body:
    """Return a box from the origin, clamped on its face x = 0.

    Lengths [mm] and numbers of bricks are along x, y and z.

    Examples
    --------
    >>> round(box((3.0, 2.0, 1.0), divisions=(2, 1, 1)).volume, 12)
    6.0
    """
    grids = (np.linspace(0.0, a, n + 1) for a, n in zip(lengths, divisions, strict=True))
    body = body_of(MeshHex.init_tensor(*grids), element)
    held = np.repeat(np.isclose(body.nodes[:, :1], 0.0), 3, axis=1)
    return replace(body, fixed=held)


def boundary_faces(body: Body) -> Indices:
    """Return the nodes of all boundary faces as grids, shape (n_faces, (order + 1)²).

    A face's first axis times its second axis points into the body.
    """
    grids = body.element.sides
    faces = body.elements[:, grids].reshape(-1, grids.shape[1])
    corners = np.sort(faces[:, body.element.corners], axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    boundary: Indices = faces[np.sort(first[count == 1])]
    return boundary


def faces_on_plane(body: Body, height: float) -> Indices:
    """Return the nodes of all faces in the plane z = height, each once, (n_faces, (order + 1)²).

    Faces of the boundary, and those between two straight bricks; the orientation of a face's grid
    is arbitrary.

    Examples
    --------
    >>> len(faces_on_plane(box((3.0, 2.0, 1.0), divisions=(3, 2, 2)), 0.5))
    6
    """
    grids = body.element.sides
    faces = body.elements[:, grids].reshape(-1, grids.shape[1])
    faces = faces[np.all(np.isclose(body.nodes[faces][..., 2], height), axis=1)]
    corners = np.sort(faces[:, body.element.corners], axis=1)
    _, first = np.unique(corners, axis=0, return_index=True)
    on_plane: Indices = faces[np.sort(first)]
    return on_plane


APART = 1e-6  # mm: coordinates closer than this belong to one plane


def levels_of(values: Floats) -> tuple[Floats, Indices]:
    """Return distinct coordinates up to rounding, sorted, and the index of each value.

    Examples
    --------
    >>> x, which = levels_of(np.array([1.0, 0.5 + 2e-16, 0.5, 1.0 - 1e-15]))
    >>> x.round(3).tolist(), which.tolist()
    ([0.5, 1.0], [1, 0, 0, 1])
    """
    order = np.argsort(values, kind="stable")
    rising = values[order]
    begins = np.diff(rising, prepend=-np.inf) > APART
    which = np.empty(len(values), dtype=np.int64)
    which[order] = np.cumsum(begins) - 1
    return rising[begins], which
