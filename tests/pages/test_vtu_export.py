import itertools

import meshio
import numpy as np
import pytest
from scipy.linalg import logm

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import (
    LINEAR_CONSTANT,
    LINEAR_FULL,
    QUADRATIC,
    QUADRATIC_CONSTANT,
    box,
)
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.pages.surface import cauchy_stress, logarithmic_strain, vtk_order, write_vtu
from tests.pages.solved_actuators import BENDING, SCALE, actuator, bent, brick, solved

ELEMENTS = {e.name: e for e in (QUADRATIC, QUADRATIC_CONSTANT, LINEAR_CONSTANT, LINEAR_FULL)}
# as drawn in VTK's documentation of vtkTriQuadraticHexahedron: corner numbers
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
EDGES += [(0, 4), (1, 5), (2, 6), (3, 7)]
FACES = [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)]
VTK_PARTS = [*((i,) for i in range(8)), *EDGES, *FACES, tuple(range(8))]


def affine(matrix):
    return lambda nodes: nodes @ (matrix - np.eye(3)).T


def written(tmp_path, body, fields, **units):
    path = tmp_path / "solved.vtu"
    write_vtu(path, body, fields, **units)
    return meshio.read(path)


# ---- cells


def test_every_node_stands_where_vtk_has_it_in_the_brick(tmp_path):
    body = brick()
    mesh = written(tmp_path, body, solved(body, bent))
    ((kind, cells),) = mesh.cells_dict.items()
    assert kind == "hexahedron27"
    assert cells.shape == body.elements.shape
    at = mesh.points[cells]
    for place, corners in enumerate(VTK_PARTS):
        middle = at[:, list(corners)].mean(axis=1)
        np.testing.assert_allclose(at[:, place], middle, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ELEMENTS)
def test_bricks_are_not_inside_out_in_vtk(tmp_path, name):
    body = brick(element=ELEMENTS[name])
    mesh = written(tmp_path, body, solved(body, bent))
    ((kind, cells),) = mesh.cells_dict.items()
    assert kind == ("hexahedron" if body.element.order == 1 else "hexahedron27")
    corner = mesh.points[cells]
    edges = np.stack([corner[:, k] - corner[:, 0] for k in (1, 3, 4)], axis=1)
    np.testing.assert_allclose(np.linalg.det(edges), body.volume / len(cells), rtol=1e-12)
    unit = np.array(CORNERS)
    spanned = corner[:, :1] + unit @ edges
    np.testing.assert_allclose(corner[:, :8], spanned, atol=1e-12)


def test_each_node_of_the_brick_has_one_place_in_vtk():
    for element in ELEMENTS.values():
        order = vtk_order(element)
        assert sorted(order) == list(range(len(order)))


@pytest.mark.peer
def test_vtk_itself_finds_the_gradients_of_the_displacement(tmp_path):
    vtk = pytest.importorskip("vtk")
    body = actuator()
    write_vtu(tmp_path / "solved.vtu", body, solved(body, bent))
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "solved.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    assert {grid.GetCellType(i) for i in range(grid.GetNumberOfCells())} == {29}
    array = grid.GetPointData().GetArray("displacement_mm")
    known = np.array([array.GetTuple3(i) for i in range(array.GetNumberOfTuples())])
    local = bent(body.nodes)[body.elements]
    gradient = np.einsum("eai,eqja->eqij", local, body.gradients)
    points = np.einsum("qa,eai->eqi", body.element.shapes, body.nodes[body.elements])
    for e, q in itertools.product(range(0, len(body.elements), 5), (0, 13, 25)):
        cell = grid.GetCell(e)
        nodes = [cell.GetPointId(i) for i in range(27)]
        inside, apart, place, weights = vtk.reference(0), vtk.reference(0.0), [0.0] * 3, [0.0] * 27
        cell.EvaluatePosition(points[e, q].tolist(), [0.0] * 3, inside, place, apart, weights)
        found = [0.0] * 9
        cell.Derivatives(0, place, known[nodes].ravel().tolist(), 3, found)
        np.testing.assert_allclose(np.reshape(found, (3, 3)), gradient[e, q], atol=1e-10)


# ---- values


def test_lengths_are_true_and_stresses_in_megapascals(tmp_path):
    body, c1 = actuator(), 0.3
    fields = solved(body, bent)
    mesh = written(tmp_path, body, fields, linear_scale=SCALE, c1=c1)
    np.testing.assert_allclose(mesh.points, SCALE * body.nodes, rtol=1e-15)
    data = mesh.point_data
    np.testing.assert_allclose(data["displacement_mm"], SCALE * bent(body.nodes), rtol=1e-15)
    np.testing.assert_array_equal(data["largest_principal_stretch"], fields.stretch)
    np.testing.assert_allclose(data["mean_stress_MPa"], c1 * fields.mean_stress)
    xx, yy, zz, xy, yz, xz = data["cauchy_stress_MPa"].T
    stress = c1 * fields.stress
    np.testing.assert_allclose(np.stack([xx, yy, zz], axis=1), np.einsum("nii->ni", stress))
    for value, (i, j) in ((xy, (0, 1)), (yz, (1, 2)), (xz, (0, 2))):
        np.testing.assert_allclose(value, stress[:, i, j])
        np.testing.assert_allclose(stress[:, i, j], stress[:, j, i], atol=1e-12)


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    body = brick()
    path = tmp_path / "solved.vtu"
    path.write_text("before", encoding="utf-8")
    with pytest.raises(ValueError, match="len"):
        write_vtu(path, body, solved(actuator(), bent))
    assert path.read_text(encoding="utf-8") == "before"
    assert list(tmp_path.iterdir()) == [path]


# ---- fields


@pytest.mark.parametrize("name", ELEMENTS)
def test_a_homogeneous_deformation_is_met_at_every_node(name):
    matrix = np.array([[1.3, 0.2, -0.1], [0.05, 0.9, 0.3], [0.1, -0.2, 1.1]])
    body = brick(element=ELEMENTS[name])
    fields = solved(body, affine(matrix))
    exact = 0.5 * logm(matrix @ matrix.T)
    np.testing.assert_allclose(
        fields.strain, np.broadcast_to(exact, fields.strain.shape), atol=1e-12
    )
    largest = np.sqrt(np.linalg.eigvalsh(matrix.T @ matrix)[-1])
    np.testing.assert_allclose(fields.stretch, largest / np.linalg.det(matrix) ** (1 / 3))


def test_the_stretch_of_bending_converges_with_second_order():
    errors = []
    for bricks in (2, 4, 8):
        body = box((8.0, 1.0, 2.0), divisions=(bricks, 1, bricks // 2))
        along = 1.0 + BENDING * body.nodes[:, 2]  # sections stay plane: only fibres along x stretch
        exact = np.maximum(along, 1.0) / np.cbrt(along)
        errors.append(np.max(np.abs(solved(body, bent).stretch - exact)))
    assert errors[1] < errors[0] / 3.5
    assert errors[2] < errors[1] / 3.5


def test_a_linear_pressure_is_met_at_every_node():
    body = brick()
    slope = np.array([0.3, -0.2, 0.7])
    points = np.einsum("qa,eai->eqi", QUADRATIC.shapes, body.nodes[body.elements])
    pressure = np.linalg.lstsq(QUADRATIC.modes, (points @ slope).T, rcond=None)[0].T
    fields = solved(body, bent, pressure)
    np.testing.assert_allclose(fields.mean_stress, body.nodes @ slope, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_stress_is_that_of_the_solid_that_was_solved(seed):
    rng = np.random.default_rng(seed)
    f = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    constants, p = np.array([1.0, -0.02, 0.004, 0.5]), 0.7
    jacobian = np.linalg.det(f)
    nominal = np.empty((3, 3))
    kernels.stress(f, np.linalg.inv(f).T.copy(), jacobian, p, constants, nominal)
    found = cauchy_stress(logarithmic_strain(f), np.array(p), constants=constants)
    np.testing.assert_allclose(found, nominal @ f.T / jacobian, atol=1e-13)


def test_the_skin_is_stiffer_in_the_stress_too():
    body = actuator()
    uniform, skinned = (
        solved(body, bent, material=MaterialGroups(0.0, 0.0, 0.0, skin=skin)) for skin in (0.0, 0.4)
    )
    shear = skinned.constants[:, 0]
    assert np.ptp(uniform.constants[:, 0]) < 1e-14
    free = np.argmax(body.nodes[:, 0] + body.nodes[:, 1] + body.nodes[:, 2])
    assert shear[free] > 1.2
    assert shear.min() < 1.0
    scaled = shear[:, None, None] * uniform.stress
    np.testing.assert_allclose(skinned.stress, scaled, atol=1e-12)


def test_any_deformation_has_a_stretch_of_at_least_one():
    body = brick()
    wild = np.random.default_rng(1).normal(scale=0.4, size=body.nodes.shape)
    fields = solved(body, lambda nodes: wild)
    assert np.all(fields.stretch >= 1.0)
    assert np.all(np.isfinite(fields.stress))
