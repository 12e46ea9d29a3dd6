"""The surface of a solved actuator: faces and fields for drawing and for files."""

import io
from dataclasses import dataclass, replace
from dataclasses import fields as fields_of
from itertools import product
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray
from skfem import ElementHex1, ElementHex2
from skfem.quadrature import get_quadrature

from bayesdeg.actuator.body import (
    Body,
    Element,
    boundary_faces,
    isoparametric,
    reference_nodes,
    tetrahedron,
)
from bayesdeg.actuator.problem import MechanicalState, Problem
from bayesdeg.errors import BayesdegError
from bayesdeg.files import OF_DAMAGED_ARCHIVES, write_bytes, written
from bayesdeg.pages.checkpoints import load_arrays

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


SMALLEST = 1e-12  # squared stretch that still has a logarithm


@dataclass(frozen=True)
class NodalFields:
    """Nodal fields of a nearly incompressible solid at moulded size, in units of C1.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    strain : array, shape (n_nodes, 3, 3)
        Logarithmic (Hencky's) strain ½ ln F Fᵀ in the deformed axes [–].
    mean_stress : array, shape (n_nodes,)
        A third of the trace of Cauchy's stress, positive in tension [C1].
    constants : array, shape (n_nodes, 4)
        C1, C2, C3 and r of the energy [C1].
    """

    displacement: Floats
    strain: Floats
    mean_stress: Floats
    constants: Floats

    @property
    def stretch(self) -> Floats:
        """Largest principal stretch, (n_nodes,), of the part that keeps the volume [–]."""
        stretch: Floats = np.exp(np.linalg.eigvalsh(_deviator(self.strain))[:, -1])
        return stretch

    @property
    def stress(self) -> Floats:
        """Cauchy's stress, (n_nodes, 3, 3) [C1]."""
        return cauchy_stress(self.strain, self.mean_stress, constants=self.constants)


def nodal_fields(problem: Problem, state: MechanicalState) -> NodalFields:
    """Return fields of an equilibrium at the nodes.

    The strain is taken where it is most accurate, at the Gauss points of the rule one order below
    that of the element (Barlow 1976, doi:10.1002/nme.1620100202), extended to the corners of each
    cell by the polynomial through those points, averaged over the cells that meet in a corner
    (Hinton and Campbell 1974, doi:10.1002/nme.1620080303), and linear in between. It is the
    logarithmic strain, since any average of it is that of a possible deformation. A homogeneous
    deformation is met exactly. At re-entrant corners the exact field is singular: values there
    grow with refinement.

    Parameters
    ----------
    problem : Problem
        Body and material.
    state : MechanicalState
        One of its equilibria.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> from bayesdeg.actuator.material import MaterialGroups
    >>> from bayesdeg.actuator.problem import System
    >>> system = System(box((2.0, 1.0, 1.0), divisions=(1, 1, 1)))
    >>> sheared = system.body.nodes[:, [2, 2, 2]] * [1.5, 0.0, 0.0]  # γ = λ − 1/λ
    >>> problem = Problem(system, MaterialGroups(c2_ratio=0.0, c3_ratio=0.0, paper_group=0.0))
    >>> nodal_fields(problem, MechanicalState(sheared, np.zeros((1, 4)), 0.0)).stretch[:3].round(12)
    array([2., 2., 2.])
    """
    body, local = problem.system.body, state.displacement[problem.system.body.elements]
    rule = _reduced(body.element)
    gradients, _ = isoparametric(rule, body.nodes[body.elements])
    gradient = np.einsum("eai,eqja->eqij", local, gradients, optimize=True)
    inner = _to_corners(rule, rule.order - 1)
    outer = _to_corners(body.element, 1)
    return NodalFields(
        state.displacement,
        _joined(body, np.einsum("cq,eqij->ecij", inner, logarithmic_strain(np.eye(3) + gradient))),
        _joined(body, state.pressure @ (outer @ body.element.modes).T),
        _joined(body, np.einsum("cq,eqk->eck", outer, problem.constants)),
    )


def logarithmic_strain(deformation_gradient: Floats) -> Floats:
    """Return Hencky's strain ½ ln F Fᵀ of deformation gradients, (..., 3, 3) [–].

    Examples
    --------
    >>> logarithmic_strain(np.diag([np.e, 1.0, 1.0])).diagonal().round(12)
    array([1., 0., 0.])
    """
    f = deformation_gradient
    squares, axes = np.linalg.eigh(f @ np.swapaxes(f, -1, -2))
    return _assembled(0.5 * np.log(np.maximum(squares, SMALLEST)), axes)


def cauchy_stress(strain: Floats, mean_stress: Floats, *, constants: Floats) -> Floats:
    """Return Cauchy's stress, (..., 3, 3), in the unit of the constants.

    σ = σₘ 1 + 2/J dev[w₁ b̄ + w₂ (Ī₁ b̄ − b̄²)] with b̄ = exp(2 dev h), ln J = tr h,
    w₁ = C1 + 2 C2 (Ī₁ − 3) + 3 C3 (Ī₁ − 3)² and w₂ = r/(2 √Ī₂).

    Parameters
    ----------
    strain : array, shape (..., 3, 3)
        Logarithmic strain h [–].
    mean_stress : array, shape (...)
        σₘ.
    constants : array, shape (..., 4)
        C1, C2, C3 and r.

    Examples
    --------
    >>> strain, neo_hookean = np.log(2.0) * np.diag([1.0, -0.5, -0.5]), np.array([1.0, 0, 0, 0])
    >>> stress = cauchy_stress(strain, np.array(7.0 / 3.0), constants=neo_hookean)
    >>> stress.diagonal().round(12) + 0.0  # 2 C1 (λ² − 1/λ) along the load
    array([7., 0., 0.])
    """
    principal, axes = np.linalg.eigh(_deviator(strain))
    b = np.exp(2.0 * principal)
    c1, c2, c3, r = (constants[..., k, None] for k in range(4))
    first = b.sum(axis=-1, keepdims=True)
    x = first - 3.0
    w1 = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
    w2 = 0.5 * r / np.sqrt(0.5 * (first**2 - np.sum(b * b, axis=-1, keepdims=True)))
    inner = w1 * b + w2 * (first * b - b * b)
    volume = np.exp(np.trace(strain, axis1=-2, axis2=-1))[..., None]
    deviator = 2.0 / volume * (inner - inner.mean(axis=-1, keepdims=True))
    return _assembled(mean_stress[..., None] + deviator, axes)


def _assembled(values: Floats, axes: Floats) -> Floats:
    """Return tensors from principal values and axes."""
    tensor: Floats = (axes * values[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return tensor


def _deviator(tensor: Floats) -> Floats:
    trace = np.trace(tensor, axis1=-2, axis2=-1)[..., None, None]
    deviator: Floats = tensor - trace / 3.0 * np.eye(3)
    return deviator


def _reduced(element: Element) -> Element:
    """Return the element with the Gauss rule one order lower, a tetrahedron with four points."""
    if element.triangular:
        return tetrahedron(2)
    kind = ElementHex1() if element.order == 1 else ElementHex2()
    points, weights = get_quadrature(kind.refdom, 2 * element.order - 1)
    basis = [kind.lbasis(points, a) for a in range(len(kind.doflocs))]
    shapes = np.stack([values for values, _ in basis], axis=1)
    slopes = np.stack([gradients.T for _, gradients in basis], axis=1)
    return replace(element, points=points.T, weights=weights, shapes=shapes, slopes=slopes)


def _to_corners(element: Element, degree: int) -> Floats:
    """Return the matrix from quadrature points to corners, (n_corners, n_points)."""
    whole = element.triangular
    known = _monomials(element.points, degree, whole=whole)
    places = reference_nodes(element)
    corners = places[np.all(places % 1.0 == 0.0, axis=1)]
    extension: Floats = _monomials(corners, degree, whole=whole) @ np.linalg.pinv(known)
    return extension


def _monomials(points: Floats, degree: int, *, whole: bool) -> Floats:
    """Values of 1, z, y, yz, x, … with each coordinate up to the degree, (n_points, n).

    With products up to the degree as a whole, of tetrahedra.
    """
    powers = np.array(list(product(range(degree + 1), repeat=3)))
    powers = powers[powers.sum(axis=1) <= degree] if whole else powers
    values: Floats = np.prod(points[:, None, :] ** powers, axis=2)
    return values


def _joined(body: Body, values: Floats) -> Floats:
    """Join values at the corners of cells, (n_elements, n, ...), to one field at all nodes."""
    places, whole = reference_nodes(body.element), body.element.triangular
    corners = np.flatnonzero(np.all(places % 1.0 == 0.0, axis=1))
    average = _average(body.elements[:, corners], values, len(body.nodes))
    at_corners = _monomials(places[corners], 1, whole=whole)
    linear = _monomials(places, 1, whole=whole) @ np.linalg.inv(at_corners)
    between = np.einsum("ac,ec...->ea...", linear, average[body.elements[:, corners]])
    return _average(body.elements, between, len(body.nodes))


def _average(nodes: Indices, values: Floats, count: int) -> Floats:
    """Average over all that meet in each node; nan where nothing does."""
    total = np.zeros((count, *values.shape[2:]))
    np.add.at(total, nodes, values)
    times = np.bincount(nodes.ravel(), minlength=count).astype(np.float64)
    average: Floats = (total.T / np.where(times > 0.0, times, np.nan)).T
    return average


Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Shape:
    """One solved actuator at true size: the half y ≥ 0, or the whole of one that is meshed so.

    Parameters
    ----------
    degradation : float
        Degradation rate [%].
    pressure : float
        Gauge pressure as read [kPa].
    rest, placed : array, shape (n_nodes, 3)
        Nodes of the surface before loading and under pressure [mm].
    stretch : array, shape (n_nodes,)
        Largest principal stretch [–].
    """

    degradation: float
    pressure: float
    rest: Floats
    placed: Floats
    stretch: Floats


@dataclass(frozen=True)
class Surface:
    """The faces that all shapes share.

    Parameters
    ----------
    faces : array, shape (n_faces, 4 or 9)
        Nodes as 2 × 2 or 3 × 3 grids whose first axis times second axis points out of the solid; a
        side of a tetrahedron is three grids of 2 × 2, one at each corner.
    on_cut, in_cavity : array of bool, shape (n_faces,)
        Faces in the plane of symmetry y = 0, of which a whole actuator has none, and walls of the
        cavity.
    shapes : tuple of Shape
        In the order of drawing.
    """

    faces: Indices
    on_cut: Flags
    in_cavity: Flags
    shapes: tuple[Shape, ...]

    @property
    def is_half(self) -> bool:
        """Whether it is one half of a mirror-symmetric actuator."""
        return bool(self.on_cut.any())


def faces_of(body: Body) -> tuple[Surface, Indices]:
    """Return the surface of a body, without shapes, and the nodes of the body that it has.

    Parameters
    ----------
    body : Body
        Half an actuator, y ≥ 0, or a whole one about y = 0.

    Returns
    -------
    surface : Surface
        Its faces count the nodes that are on the surface.
    nodes : array, shape (n_nodes,)
        Number of each in the body.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> surface, nodes = faces_of(box((2.0, 1.0, 1.0), divisions=(2, 1, 1)))
    >>> surface.faces.shape, int(surface.on_cut.sum()), len(nodes)
    ((10, 9), 2, 42)
    """
    inward = boundary_faces(body)
    if body.element.triangular:
        outward = _thirds(inward)
    else:  # grids with their axes swapped
        side = int(np.sqrt(inward.shape[1]))
        outward = np.swapaxes(inward.reshape(-1, side, side), 1, 2).reshape(inward.shape)
    nodes, numbered = np.unique(outward, return_inverse=True)
    is_half = np.isclose(min(body.nodes[:, 1].min(), 0.0), 0.0)
    on_cut = is_half & np.all(np.isclose(body.nodes[outward, 1], 0.0), axis=1)
    pressed = {tuple(face) for face in np.sort(body.cavity, axis=1)}
    in_cavity = np.array([tuple(face) in pressed for face in np.sort(inward, axis=1)], dtype=bool)
    in_cavity = np.repeat(in_cavity, len(outward) // len(inward))
    return Surface(numbered.reshape(outward.shape), on_cut, in_cavity, ()), nodes


def _thirds(faces: Indices) -> Indices:
    """Return the three grids of each triangle, turned to the other side, (3 n_faces, 4).

    Each has a corner, the middles of the edges that meet there, and the middle of the triangle.
    """
    after, before = faces[:, [3, 4, 5]], faces[:, [5, 3, 4]]
    middle = np.repeat(faces[:, 6:], 3, axis=1)
    return np.stack([faces[:, :3], after, before, middle], axis=-1).reshape(-1, 4)


def shape_of(
    body: Body,
    fields: NodalFields,
    nodes: Indices,
    *,
    linear_scale: float,
    degradation: float,
    pressure: float,
) -> Shape:
    """Return the shape of a solved body.

    Parameters
    ----------
    body : Body
        At moulded size, before loading.
    fields : NodalFields
        Of the equilibrium.
    nodes : array
        Those of the surface, from `faces_of`.
    linear_scale : float
        True size over moulded size [–].
    degradation, pressure : float
        [%], [kPa].
    """
    rest = linear_scale * body.nodes[nodes]
    placed = rest + linear_scale * fields.displacement[nodes]
    return Shape(degradation, pressure, rest, placed, fields.stretch[nodes])


SURFACE = "deformed.npz"
_CELLS = {1: "hexahedron", 2: "hexahedron27"}
_IN_VTK = 10  # nodes of a quadratic tetrahedron; its bubbles' nodes are left out
# VTK's nodes of the unit cube: corners, then the middles of edges, of faces, and of the cube
_VTK_NODES = 0.5 * np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)


def vtk_order(element: Element) -> Indices:
    """Return the local node of the element at each of VTK's positions.

    VTK_TRIQUADRATIC_HEXAHEDRON for triquadratic bricks, VTK_HEXAHEDRON for trilinear ones,
    VTK_QUADRATIC_TETRA for tetrahedra.

    Examples
    --------
    >>> from bayesdeg.actuator.body import LINEAR_CONSTANT
    >>> vtk_order(LINEAR_CONSTANT)
    array([7, 4, 1, 5, 6, 2, 0, 3])
    """
    if element.triangular:
        return np.arange(_IN_VTK)
    places = reference_nodes(element)
    apart = np.abs(places[None] - _VTK_NODES[: len(places), None]).sum(axis=2)
    order: Indices = np.argmin(apart, axis=1).astype(np.int64)
    return order


def write_vtu(
    path: Path, body: Body, fields: NodalFields, *, linear_scale: float = 1.0, c1: float = 1.0
) -> None:
    """Write a solved body (the computed half y ≥ 0) for ParaView and similar tools.

    Points are at their positions before loading; *Warp By Vector* with ``displacement_mm``
    deforms them, *Reflect* at y = 0 adds the other half.

    Parameters
    ----------
    path : Path
        The file; it appears whole or not at all.
    body : Body
        At moulded size, before loading.
    fields : NodalFields
        Of an equilibrium: ``displacement_mm``, ``largest_principal_stretch``,
        ``mean_stress_MPa`` and ``cauchy_stress_MPa`` (xx, yy, zz, xy, yz, xz), all at nodes.
    linear_scale : float
        True size over moulded size; lengths in the file are true [–].
    c1 : float
        The unit of stress [MPa].

    Examples
    --------
    >>> import tempfile
    >>> from bayesdeg.actuator.body import box
    >>> brick = box((2.0, 1.0, 1.0), divisions=(1, 1, 1))
    >>> still = NodalFields(0 * brick.nodes, np.zeros((27, 3, 3)), np.zeros(27),
    ...     np.tile([1.0, 0.0, 0.0, 0.0], (27, 1)))
    >>> path = Path(tempfile.mkdtemp()) / "brick.vtu"
    >>> write_vtu(path, brick, still, linear_scale=0.5)
    >>> meshio.read(path).points.max(axis=0)
    array([1. , 0.5, 0.5])
    """
    stress, element = c1 * fields.stress, body.element
    cells = body.elements[:, vtk_order(element)]
    # nodes of bubbles come last, and no cell of the file has them
    kept = slice(int(cells.max()) + 1 if element.triangular else None)
    named = {
        "displacement_mm": linear_scale * fields.displacement,
        "largest_principal_stretch": fields.stretch,
        "mean_stress_MPa": c1 * fields.mean_stress,
        "cauchy_stress_MPa": stress[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]],
    }
    mesh = meshio.Mesh(
        linear_scale * body.nodes[kept],
        [("tetra10" if element.triangular else _CELLS[element.order], cells)],
        point_data={name: values[kept] for name, values in named.items()},
    )
    with written(path) as part:
        meshio.write(part, mesh, file_format="vtu")


def vtu_name(degradation: float) -> str:
    """Return the name of the VTU file of an actuator at a degradation rate [%].

    Examples
    --------
    >>> vtu_name(12.5)
    'actuator_12.5pct.vtu'
    """
    return f"actuator_{degradation:g}pct.vtu"


def clear_solved(folder: Path) -> None:
    """Remove solved actuators of an earlier run from a run folder."""
    for path in (*folder.glob(vtu_name(0.0).replace("0", "*")), folder / SURFACE):
        path.unlink(missing_ok=True)


def write_surface(folder: Path, surface: Surface) -> None:
    """Write the surface of solved actuators into a run folder."""
    arrays = {
        "faces": surface.faces.astype(np.int32),
        "on_cut": surface.on_cut,
        "in_cavity": surface.in_cavity,
    }
    for field in fields_of(Shape):
        values = np.array([getattr(shape, field.name) for shape in surface.shapes])
        arrays[field.name] = values.astype(np.float32)

    made = io.BytesIO()
    np.savez_compressed(made, allow_pickle=False, **arrays)
    write_bytes(folder / SURFACE, made.getbuffer())


def read_surface(folder: Path) -> Surface | None:
    """Read the file of `write_surface`; None if there is none.

    Raises
    ------
    BayesdegError
        If the file is there but damaged.
    """
    path = folder / SURFACE
    if not path.exists():
        return None
    try:
        stored = load_arrays(path)
        columns = [stored[field.name].astype(np.float64) for field in fields_of(Shape)]
        surface = Surface(
            stored["faces"].astype(np.int64),
            stored["on_cut"].astype(bool),
            stored["in_cavity"].astype(bool),
            tuple(Shape(*row) for row in zip(*columns, strict=True)),
        )
        count = {len(a) for a in (surface.faces, surface.on_cut, surface.in_cavity)}
        known = min((len(shape.stretch) for shape in surface.shapes), default=0)
        if len(count) != 1 or surface.faces.shape[1] not in (4, 9):
            raise ValueError("faces and their flags differ in number")
        if not surface.shapes or surface.faces.min() < 0 or surface.faces.max() >= known:
            raise ValueError("a face names a node that does not exist")
    except OF_DAMAGED_ARCHIVES as fault:
        raise BayesdegError(
            f"{path}: {fault}; the file is damaged or from another version: run the study again "
            "with --fresh, or delete the file to leave its figure out of the report"
        ) from fault
    return surface
