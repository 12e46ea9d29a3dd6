"""Tetrahedra: patch test, closed forms, order, and the bricks of the same part."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import scipy.sparse as sp

from bayesdeg.actuator import kernels, paper
from bayesdeg.actuator.body import (
    TETRAHEDRON,
    boundary_faces,
    faces_on_plane,
    isoparametric,
    tetrahedra_of,
)
from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.paper import bending_matrix
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.section import section
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.part import (
    PartError,
    PartMesh,
    bending_of,
    cavity_of,
    jacobians,
    outer_sides,
    read_part,
    volume_of,
)
from bayesdeg.data.plausibility import BENDING_LEFT_OUT, THICKEST_WITHOUT_BENDING
from bayesdeg.material.hyperelastic import nominal_stress
from bayesdeg.pages.surface import faces_of, nodal_fields, quads_of, write_vtu
from tests.actuator.geometries import geometry_of_file
from tests.actuator.parts import COARSEST, ORDER, PATHS, SMALL, half, tetrahedral, write
from tests.actuator.test_part import inputs
from tests.actuator.test_patch import (
    LAW,
    LOADED,
    MATERIAL,
    PRINCIPAL,
    SIZE,
    assert_affine,
    internal_force,
    is_inside,
    pressure_that_frees,
)
from tests.actuator.test_pressure_vessels import errors_of_sphere, octant


def cube(counts, size=(1.0, 1.0, 1.0)):
    """Corners of a grid of bricks, and six tetrahedra of each."""
    grids = [np.linspace(0.0, a, n + 1) for a, n in zip(size, counts, strict=True)]
    points = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3)
    place = np.arange(len(points)).reshape(*(n + 1 for n in counts))
    at = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    bricks = np.stack([place[tuple((at + corner).T)] for corner in ORDER], axis=1)
    return points, bricks[:, np.array(PATHS)].reshape(-1, 4)


def distorted(counts=(2, 2, 2)):
    points, cells = cube(counts, SIZE)
    move = 0.12 * np.random.default_rng(1).uniform(-1.0, 1.0, points.shape)
    inside = np.all((points > 1e-9) & (points < SIZE - 1e-9), axis=1)
    return tetrahedra_of(points + np.where(inside[:, None], move, 0.0), cells)


# ---- the element


def test_shapes_are_those_of_the_nodes_and_hold_all_quadratics():
    shapes, slopes = TETRAHEDRON.shapes, TETRAHEDRON.slopes
    body = tetrahedra_of(np.vstack([np.zeros(3), np.eye(3)]), np.arange(4)[None])
    nodes = body.nodes[body.elements[0]]
    x = TETRAHEDRON.points
    for power in [(0, 0, 0), (1, 0, 0), (0, 0, 1), (2, 0, 0), (1, 1, 0), (0, 1, 1)]:
        at_nodes = np.prod(nodes ** np.array(power), axis=1)
        np.testing.assert_allclose(shapes @ at_nodes, np.prod(x ** np.array(power), axis=1))
        for axis in range(3):
            lower = np.array(power) - np.eye(3, dtype=int)[axis]
            slope = power[axis] * np.prod(x ** np.maximum(lower, 0), axis=1)
            np.testing.assert_allclose(slopes[..., axis] @ at_nodes, slope, atol=1e-12)
    assert np.all(TETRAHEDRON.weights > 0.0)


def test_sides_carry_the_shapes_of_the_tetrahedron_and_point_inwards():
    """On a side the seven shapes are the trace, so that neighbours fit together."""
    body = tetrahedra_of(np.vstack([np.zeros(3), np.eye(3)]), np.arange(4)[None])
    values, first, second, weights = kernels.face_shapes(triangle=True)
    middle = body.nodes[-1]
    for side in boundary_faces(body):
        place = body.nodes[side]
        normal = np.cross(first @ place, second @ place)
        assert np.all(normal @ (middle - place[-1]) > 0.0)
        area = weights @ np.linalg.norm(normal, axis=1)
        corners = place[:3]
        plane = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        assert area == pytest.approx(0.5 * np.linalg.norm(plane))
        np.testing.assert_allclose(values.sum(axis=1), 1.0)


def test_the_volume_form_is_the_volume_under_curved_sides():
    """Nodes moved off the planes: against the integral of det ∂x/∂ξ over the body."""
    points, cells = cube((1, 1, 1))
    body = tetrahedra_of(points + 2.0, cells)
    bent = body.nodes + 0.05 * np.sin(3.0 * body.nodes[:, [1, 2, 0]])
    _, weights = isoparametric(TETRAHEDRON, bent[body.elements])
    volume = kernels.cavity_volume(
        bent,
        boundary_faces(body),
        kernels.volume_form(triangle=True),
        1.0,
        np.zeros_like(bent),
        np.empty((0, 0, 0), dtype=np.int32),
        np.empty(0),
    )
    # of a rule for degree 6, where shapes to the third are of degree 12
    assert -volume == pytest.approx(weights.sum(), rel=2e-4)


@pytest.mark.parametrize("stretch", [0.8, 1.3, 2.0])
@pytest.mark.parametrize("mode", PRINCIPAL)
def test_forces_of_a_stretched_block_are_those_of_the_closed_form(mode, stretch):
    system = System(distorted())
    nodes = system.body.nodes
    stretches = np.array(PRINCIPAL[mode](stretch))
    force = internal_force(system, nodes * (stretches - 1.0), pressure_that_frees(2, stretches))
    wanted = float(nominal_stress(LAW, stretch, mode=mode))
    for axis in LOADED[mode]:
        on_face = np.isclose(nodes[:, axis], SIZE[axis])
        area = np.prod(np.delete(SIZE, axis))
        assert force[on_face, axis].sum() == pytest.approx(wanted * area, rel=1e-10)
    inside = is_inside(system.body)
    assert inside.sum() >= 8
    np.testing.assert_allclose(force[inside], 0.0, atol=1e-10)
    np.testing.assert_allclose(force[:, 2], 0.0, atol=1e-10)


def test_affine_boundary_gives_an_affine_solution():
    assert_affine(distorted(), "planar")


def inf_sup(counts):
    """Least singular value of the divergence in the norms of both fields, but for the constant.

    Of a block that is held all around: the numerical test of Chapelle and Bathe (1993), Comput.
    Struct. 47:537, doi:10.1016/0045-7949(93)90340-J.
    """
    body = tetrahedra_of(*cube(counts))
    held = ~np.all((body.nodes > 1e-9) & (body.nodes < 1.0 - 1e-9), axis=1)
    system = System(replace(body, fixed=np.repeat(held[:, None], 3, axis=1)))
    rest = system.rest()
    coupling = Problem(system, MATERIAL).linearise(rest).coupling
    count = len(body.nodes)
    degrees = (np.arange(3)[:, None] * count + body.elements[:, None]).reshape(
        len(body.elements), -1
    )
    elements, modes, _ = coupling.shape
    rows = np.arange(elements * modes).reshape(elements, modes)[:, :, None]
    shape = (elements * modes, 3 * count)
    at = (
        np.broadcast_to(rows, coupling.shape).ravel(),
        np.broadcast_to(degrees[:, None], coupling.shape).ravel(),
    )
    divergence = sp.coo_array((coupling.ravel(), at), shape=shape).toarray()
    local = np.einsum("eqia,eqib,eq->eab", body.gradients, body.gradients, body.weights)
    pairs = (np.repeat(body.elements, 15, axis=1).ravel(), np.tile(body.elements, 15).ravel())
    stiffness = sp.coo_array((local.ravel(), pairs), shape=(count, count)).toarray()[~held][
        :, ~held
    ]
    free = np.tile(~held, 3)
    inverse = np.kron(np.eye(3), np.linalg.inv(stiffness))
    schur = divergence[:, free] @ inverse @ divergence[:, free].T
    root = np.linalg.cholesky(system.inverse_mass)
    scaled = np.zeros_like(schur)
    for e in range(elements):
        own = slice(e * modes, (e + 1) * modes)
        scaled[own] = root[e].T @ schur[own]
    for e in range(elements):
        own = slice(e * modes, (e + 1) * modes)
        scaled[:, own] = scaled[:, own] @ root[e]
    values = np.linalg.eigvalsh(0.5 * (scaled + scaled.T))
    assert abs(values[0]) < 1e-10  # the pressure that is the same everywhere
    return float(np.sqrt(values[1]))


def test_the_inf_sup_constant_does_not_vanish_with_the_mesh():
    found = [inf_sup((n, n, n)) for n in (1, 2, 3)]
    assert min(found) > 0.2
    assert found[2] > 0.85 * found[1]


def papered():
    """A block whose bottom is papered, cut into triangles of no pattern."""
    points, cells = cube((3, 3, 1), (3.0, 2.0, 1.0))
    move = 0.15 * np.random.default_rng(2).uniform(-1.0, 1.0, points.shape) * [1.0, 1.0, 0.0]
    inside = np.all((points[:, :2] > 1e-9) & (points[:, :2] < [2.999, 1.999]), axis=1)
    body = tetrahedra_of(points + np.where(inside[:, None], move, 0.0), cells)
    return replace(body, paper=faces_on_plane(body, 0.0))


def carried(body, placed, law):
    """Energy and forces of the paper of a body."""
    force = np.zeros_like(placed)
    rule = kernels.face_shapes(2, triangle=body.element.triangular)[1:]
    none = np.empty((0, 0, 0), dtype=np.int32)
    found = paper.membrane(
        placed, body.nodes, body.paper, *rule, np.array(law), force, none, np.empty(0)
    )
    return found, force


@pytest.mark.parametrize("law", [(20.0, 0.3, 0.0, 0.0), (20.0, 0.3, 0.02, 0.01)])
def test_paper_on_triangles_has_the_energy_and_forces_of_its_law(law):
    """Of a homogeneous strain that of its area; of another, forces are the energy's slopes."""
    body = papered()
    f = np.array([[1.04, 0.02, 0.0], [0.01, 0.98, 0.0], [0.03, 0.0, 1.0]])
    energy, force = carried(body, body.nodes @ f.T, law)
    _, _, _, wanted = paper.membrane_law(f[:, :2] / (1.0 + law[3]), np.array(law))
    assert energy == pytest.approx(6.0 * (1.0 + law[3]) ** 2 * wanted, rel=1e-12)
    bottom = np.unique(body.paper)
    edge = np.any(
        np.isclose(body.nodes[:, :2], 0.0) | np.isclose(body.nodes, [3, 2, 9])[:, :2], axis=1
    )
    np.testing.assert_allclose(force[~edge], 0.0, atol=1e-12)
    bent = body.nodes @ f.T + 0.02 * np.sin(2.0 * body.nodes[:, [1, 0, 0]])
    _, force = carried(body, bent, law)
    push = np.random.default_rng(3).standard_normal(bent.shape)
    ends = [carried(body, bent + step * push, law)[0] for step in (1e-6, -1e-6)]
    assert np.sum(force * push) == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6)
    assert np.all(force[np.setdiff1d(np.arange(len(bent)), bottom)] == 0.0)


# ---- closed forms


@pytest.mark.long
@pytest.mark.fem
def test_thick_sphere_under_follower_pressure(path_of):
    """The pressure of the closed form grows the bore to the radius of the closed form."""
    octants = (octant(tetrahedra_of(*cube((n, n, n)))) for n in (1, 2, 4))
    errors = errors_of_sphere(octants, path_of)
    assert errors[-1] < 2e-3
    assert np.all(-np.diff(np.log2(errors)) > 2.9)


# ---- parts


MEDIUM = Resolution(2.0, 2.0, 2.0)


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    path = tmp_path_factory.mktemp("part") / "part.msh"
    return geometry_of_file(write(path, tetrahedral(half())))


def of_parts(folder, *parts):
    return [geometry_of_file(write(folder / f"{k}.msh", one)) for k, one in enumerate(parts)]


def test_sizes_and_volumes_are_those_of_the_bricks(tmp_path, part):
    (bricks,) = of_parts(tmp_path, half())
    sizes = (volume_of, bending_of, lambda one: cavity_of(one)[0], lambda one: cavity_of(one)[1])
    for what in sizes:
        assert what(part.part) == pytest.approx(what(bricks.part), rel=1e-12)
    ours, theirs = (build_mesh(one, COARSEST) for one in (part, bricks))
    assert ours.body.volume == pytest.approx(theirs.body.volume, rel=1e-12)
    areas = []
    for mesh in (ours, theirs):
        shapes = kernels.face_shapes(2, triangle=mesh.body.element.triangular)
        at = [
            np.einsum("qa,fai->fqi", one, mesh.body.nodes[mesh.body.paper]) for one in shapes[1:3]
        ]
        areas.append(float((np.linalg.norm(np.cross(*at), axis=-1) @ shapes[3]).sum()))
    assert areas[0] == pytest.approx(areas[1], rel=1e-12)
    np.testing.assert_allclose(
        ours.body.nodes[ours.bottom_line], theirs.body.nodes[theirs.bottom_line], atol=1e-9
    )


@pytest.mark.parametrize("raised", [0.0, 1.5])
@pytest.mark.parametrize("on_layer", [False, True])
def test_the_rough_bending_is_that_of_a_block_whatever_the_cells_are(raised, on_layer):
    r"""A block that is its own cavity, of height h from a to b: :math:`z_c = (a + b)/2`.

    .. math:: \theta = \frac{V z_c L}{6 \int z^2 dV} = \frac{h (a + b) L}{4 (b^3 - a^3)}

    with heights over the layer, if there is one, which is the bottom here: then L/(4h).
    """
    length, _, height = size = 5.0, 3.0, 2.0
    points, cells = cube((4, 3, 3), size)
    move = 0.3 * np.random.default_rng(4).uniform(-1.0, 1.0, points.shape)
    inside = np.all((points > 1e-9) & (points < np.array(size) - 1e-9), axis=1)
    points = points + np.where(inside[:, None], move, 0.0) + [0.0, 0.0, raised]
    assert np.ptp(jacobians(points[cells])) > 0.5 * jacobians(points[cells]).mean()
    outer = outer_sides(cells)
    bottom = outer[np.isclose(points[outer][..., 2], raised).all(axis=1)]
    sides = {"cavity": outer} | ({"constraint": bottom} if on_layer else {})
    low = 0.0 if on_layer else raised
    high = low + height
    wanted = height * (low + high) * length / (4.0 * (high**3 - low**3))
    assert bending_of(PartMesh(points, cells, sides, "")) == pytest.approx(wanted, rel=1e-12)


def test_it_is_drawn_as_the_bricks_are_and_no_wall_grows_into_the_cavity(tmp_path, part):
    (bricks,) = of_parts(tmp_path, half())
    assert section(part, 60) == section(bricks, 60)
    points, cells, sides = tetrahedral(half())
    sheared = points.copy()
    sheared[:, 0] += 0.4 * points[:, 2] * points[:, 0] * (20.0 - points[:, 0]) / 1000.0
    (slanted,) = of_parts(tmp_path, (sheared, cells, sides))
    drawn = [section(one, 200) for one in (part, slanted)]
    air = [text.count("o") + text.count(" ") for text in drawn]
    assert air[1] == pytest.approx(air[0], rel=0.05)


@pytest.mark.long
@pytest.mark.fem
def test_they_come_to_the_bricks_as_the_mesh_is_refined(tmp_path):
    """Against bricks of 1.2 mm at 20 to 180 kPa: curvatures are 8, 5 and 2 % too small."""
    asked = replace(inputs(), asked="cavity_volume")
    fine = ExactMap(SMALL, Resolution(1.2, 1.2, 1.2))
    wanted, force = fine(asked), fine.tip_force(inputs()).value
    off = []
    for size in (9.0, 2.0, 1.2):
        mesh = Resolution(size, size, size)
        (geometry,) = of_parts(tmp_path, tetrahedral(half(SMALL, mesh)))
        ours = ExactMap(geometry, mesh)
        found = ours(asked)
        pairs = [
            (found.curvature, wanted.curvature),
            (found.further.value, wanted.further.value),
            (ours.tip_force(inputs()).value, force),
        ]
        off.append([float(np.nanmean(a / b)) - 1.0 for a, b in pairs])
    curvature = np.array(off)[:, 0]
    np.testing.assert_allclose(curvature, [-0.08, -0.05, -0.02], atol=0.005)
    assert np.all(np.abs(off[-1]) < 0.04)


@pytest.mark.fem
def test_the_bending_of_paper_that_they_leave_out_is_small(tmp_path, part):
    """Of bricks with paper as thin as a film against thicker ones of the same E t, up to 0.5 mm."""
    assert bending_matrix(build_mesh(part, COARSEST).body).nnz == 0
    (bricks,) = of_parts(tmp_path, half(SMALL, MEDIUM))
    assert bending_matrix(build_mesh(bricks, MEDIUM).body).nnz > 0
    plain, *found = (
        ExactMap(bricks, MEDIUM)(inputs(paper_thickness=thickness)).curvature
        for thickness in (1e-3, 0.1, THICKEST_WITHOUT_BENDING, 0.5)
    )
    usual, thickest, thick = (100.0 * (plain / one - 1.0) for one in found)
    assert np.all((usual > 0.1) & (usual < 0.3))
    assert np.all((thickest > 0.5) & (thickest < 0.8))
    np.testing.assert_allclose(thick, BENDING_LEFT_OUT * 0.5**2, rtol=0.25)


def with_middles(part):
    """The part as a mesher of second order writes it: ten nodes a cell, six a face."""
    points, cells, sides = part
    edges = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
    keys, which = np.unique(
        np.sort(cells[:, edges].reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    place = {tuple(key): len(points) + k for k, key in enumerate(keys.tolist())}
    more = np.hstack([cells, len(points) + which.reshape(len(cells), 6)])
    six = {
        name: np.array(
            [
                [*f, *(place[tuple(sorted((f[i], f[(i + 1) % 3])))] for i in range(3))]
                for f in faces.tolist()
            ]
        )
        for name, faces in sides.items()
    }
    return np.vstack([points, points[keys].mean(axis=1)]), more, six


def test_nodes_in_the_middles_of_edges_are_left_out(tmp_path, part):
    (ten,) = of_parts(tmp_path, with_middles(tetrahedral(half())))
    assert len(ten.part.points) == len(part.part.points)
    assert ten.part.cells.shape == part.part.cells.shape
    assert volume_of(ten.part) == pytest.approx(volume_of(part.part), rel=1e-12)
    assert {n: len(s) for n, s in ten.part.sides.items()} == {
        n: len(s) for n, s in part.part.sides.items()
    }


def upside_down():
    points, cells, sides = tetrahedral(half())
    return points, np.vstack([cells[:3, [1, 0, 2, 3]], cells[3:]]), sides


def bulged():
    points, cells, sides = tetrahedral(half())
    points = points.copy()
    points[:, 2] -= np.where(np.isclose(points[:, 2], 0.0), 0.01 * points[:, 0], 0.0)
    return points, cells, sides


def pierced():
    points, cells, sides = tetrahedral(half())
    return points, cells, sides | {"cavity": sides["cavity"][1:]}


@pytest.mark.parametrize(
    ("made", "word"), [(upside_down, "tetrahedra"), (bulged, "flat"), (pierced, "hole")]
)
def test_what_is_wrong_is_said(tmp_path, made, word):
    path = write(tmp_path / "part.msh", made())
    with pytest.raises(PartError, match=word):
        read_part(path)


# ---- what is drawn of them


def test_fields_of_a_homogeneous_deformation_are_met_at_all_nodes():
    body = distorted()
    system = System(body)
    f = np.diag([1.4, 1.4**-0.5, 1.4**-0.5]) @ np.array([[1, 0.2, 0], [0, 1, 0], [0, 0, 1.0]])
    rest = system.rest()
    state = replace(rest, displacement=body.nodes @ (f - np.eye(3)).T)
    fields = nodal_fields(Problem(system, MATERIAL), state)
    squares = np.linalg.eigvalsh(f @ f.T)
    np.testing.assert_allclose(fields.stretch, np.sqrt(squares[-1]), rtol=1e-10)
    np.testing.assert_allclose(np.trace(fields.strain, axis1=1, axis2=2), 0.0, atol=1e-10)


def test_the_surface_is_closed_and_points_outwards():
    body = distorted()
    surface, nodes = faces_of(body)
    assert len(surface.faces) == 3 * len(boundary_faces(body))
    quads = quads_of(body.nodes[nodes], np.ones(len(nodes)), surface.faces, pieces=1)
    assert quads.areas.sum() == pytest.approx(2.0 * (3 * 2 + 2 * 2.5 + 2.5 * 3), rel=1e-12)
    outward = np.einsum("ni,ni->n", quads.vectors, quads.corners.mean(axis=1) - 0.5 * SIZE)
    assert np.all(outward > 0.0)
    np.testing.assert_allclose(quads.vectors.sum(axis=0), 0.0, atol=1e-12)
    assert int(surface.on_cut.sum()) == 3 * 8


def test_a_file_for_paraview_has_ten_nodes_a_cell(tmp_path):
    body = distorted()
    problem = Problem(System(body), MATERIAL)
    fields = nodal_fields(problem, problem.system.rest())
    path = tmp_path / "part.vtu"
    write_vtu(path, body, fields)
    mesh = meshio.read(path)
    assert mesh.cells[0].type == "tetra10"
    assert len(np.unique(mesh.cells[0].data)) == len(mesh.points) < len(body.nodes)
    corners = mesh.points[mesh.cells[0].data]
    assert np.linalg.det(corners[:, 1:4] - corners[:, :1]).sum() == pytest.approx(6 * body.volume)
    edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
    for k, (a, b) in enumerate(edges):
        np.testing.assert_allclose(corners[:, 4 + k], 0.5 * (corners[:, a] + corners[:, b]))
