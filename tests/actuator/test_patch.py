"""A homogeneous stretch of a distorted block gives the stress of the closed form."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from bayesdeg.actuator.body import LINEAR_CONSTANT, LINEAR_FULL, QUADRATIC, QUADRATIC_CONSTANT
from bayesdeg.actuator.material import MaterialGroups, is_elliptic
from bayesdeg.actuator.outputs import StrainFields, volume_quantile
from bayesdeg.actuator.problem import MechanicalState, Problem, System
from bayesdeg.material.hyperelastic import YeohRootSecondInvariant, nominal_stress

C2, C3, R = -0.05, 0.03, 0.4
MATERIAL = MaterialGroups(C2, C3, paper_group=0.0, bulk_ratio=50.0, second_invariant_ratio=R)
LAW = YeohRootSecondInvariant(1.0, C2, C3, R)
SIZE = np.array([3.0, 2.0, 2.5])
PRINCIPAL = {
    "uniaxial": lambda s: (s, s**-0.5, s**-0.5),
    "equibiaxial": lambda s: (s, s, s**-2.0),
    "planar": lambda s: (s, 1.0, 1.0 / s),
}
LOADED = {"uniaxial": (0,), "equibiaxial": (0, 1), "planar": (0,)}
ELEMENTS = (LINEAR_FULL, LINEAR_CONSTANT, QUADRATIC_CONSTANT, QUADRATIC)
each_element = pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)


def constant_pressure(body, value):
    """Coefficients of a pressure field that is the same everywhere."""
    modes = body.element.modes
    coefficients = np.linalg.lstsq(modes, np.full(len(modes), value), rcond=None)[0]
    return np.tile(coefficients, (len(body.elements), 1))


def internal_force(system, displacement, hydrostatic):
    """Nodal forces (n_nodes, 3) under a given constant pressure."""
    state = MechanicalState(displacement, constant_pressure(system.body, hydrostatic), 0.0)
    return Problem(system, MATERIAL).linearise(state, tangent=False).force


def pressure_that_frees(axis, stretches):
    """Pressure at which the Cauchy stress along an axis vanishes, J being 1."""
    squares = np.array(stretches) ** 2
    x = squares.sum() - 3.0
    slope = 1.0 + 2.0 * C2 * x + 3.0 * C3 * x**2
    second = 0.5 * (squares.sum() ** 2 - np.sum(squares**2))
    root = 0.5 * R / np.sqrt(second)
    on_first = -2.0 * slope * (squares[axis] - squares.sum() / 3.0)
    # λ² ∂I₂/∂λ² = λ² (I₁ − λ²)
    return on_first - 2.0 * root * (
        squares[axis] * (squares.sum() - squares[axis]) - 2.0 / 3.0 * second
    )


def is_inside(body):
    return np.all((body.nodes > 1e-9) & (body.nodes < SIZE - 1e-9), axis=1)


@each_element
@pytest.mark.parametrize("stretch", [0.8, 1.3, 2.0])
@pytest.mark.parametrize("mode", PRINCIPAL)
def test_forces_of_a_stretched_block_are_those_of_the_closed_form(block, mode, stretch, element):
    counts = (2, 2, 2) if element.order == 2 else (3, 3, 3)
    system = System(block(counts, SIZE, distortion=0.6, element=element))
    nodes = system.body.nodes
    stretches = np.array(PRINCIPAL[mode](stretch))
    force = internal_force(system, nodes * (stretches - 1.0), pressure_that_frees(2, stretches))
    wanted = float(nominal_stress(LAW, stretch, mode=mode))
    errors = []
    for axis in LOADED[mode]:
        on_face = np.isclose(nodes[:, axis], SIZE[axis])
        area = np.prod(np.delete(SIZE, axis))
        errors.append(abs(force[on_face, axis].sum() / (wanted * area) - 1.0))
    inside = is_inside(system.body)
    left = np.abs(force[inside]).max()
    print(f"{element.name} {mode} {stretch}: stress {max(errors):.1e}, inner forces {left:.1e}")
    assert max(errors) < 1e-10
    np.testing.assert_allclose(force[:, 2], 0.0, atol=1e-10)
    assert inside.sum() >= 8
    assert left < 1e-10


@pytest.mark.parametrize("mode", PRINCIPAL)
def test_end_force_of_the_stretched_actuator_is_stress_times_area(two_chambers, mode):
    mesh, nodes = two_chambers.mesh, two_chambers.mesh.body.nodes
    stretches = np.array(PRINCIPAL[mode](1.4))
    hydrostatic = pressure_that_frees(2, stretches)
    force = internal_force(two_chambers.system, nodes * (stretches - 1.0), hydrostatic)
    wanted = float(nominal_stress(LAW, 1.4, mode=mode))
    d = mesh.geometry.dimensions
    total = force[np.unique(mesh.free_end), 0].sum()
    assert total == pytest.approx(wanted * d.width / 2.0 * d.height, rel=1e-10)


def assert_affine(body, mode):
    """Newton's method finds an affine field inside, from a wrong start."""
    inside = is_inside(body)
    body = replace(body, fixed=np.repeat(~inside[:, None], 3, axis=1))
    system = System(body)
    problem = Problem(system, MATERIAL)
    # J is not 1: the material is slightly compressible
    affine = body.nodes * (np.array(PRINCIPAL[mode](1.3)) * 1.01 - 1.0)
    start = np.where(inside[:, None], 0.97 * affine, affine)
    state = MechanicalState(start, system.rest().pressure, 0.0)
    for _ in range(12):
        lin = problem.linearise(state)
        upper = system.upper.copy()
        upper.data = lin.tangent
        tangent = (upper + sp.triu(upper, k=1).T).toarray()
        increment = system.expand(np.linalg.solve(tangent, -lin.residual))
        change = problem.pressure_increment(lin, increment, lin.volume_residual)
        state = state.moved(increment, change)
    np.testing.assert_allclose(state.displacement, affine, atol=1e-10)
    field = state.pressure @ body.element.modes.T
    np.testing.assert_allclose(field, MATERIAL.bulk_ratio * (1.01**3 - 1.0), rtol=1e-10)


@each_element
@pytest.mark.parametrize("mode", PRINCIPAL)
def test_affine_boundary_gives_an_affine_solution(block, mode, element):
    """Newton's method on the nodes inside a distorted block, from a wrong start."""
    counts = (2, 2, 2) if element.order == 2 else (3, 3, 3)
    body = block(counts, SIZE, distortion=0.6, element=element)
    assert_affine(body, mode)


@pytest.mark.parametrize("mode", PRINCIPAL)
def test_pulled_block_takes_the_homogeneous_state_of_the_closed_form(block, at_rest, mode):
    """Dead loads on a distorted block: what is left is the compressibility, in proportion 1/K."""
    errors = []
    for bulk in (1e4, 1e6):
        body = block((2, 2, 2), SIZE, distortion=0.6)
        at_zero = np.isclose(body.nodes, 0.0)
        if mode == "planar":
            at_zero[:, 1] = True
        system = System(replace(body, fixed=at_zero))
        stress = float(nominal_stress(LAW, 1.4, mode=mode))
        pull = np.zeros_like(body.nodes)
        for axis in LOADED[mode]:
            pull[:, axis] = stress * _areas(system, axis)
        problem = Problem(system, replace(MATERIAL, bulk_ratio=bulk), nodal_force=pull)
        wanted = body.nodes * (np.array(PRINCIPAL[mode](1.4)) - 1.0)
        found = at_rest(problem).displacement
        affine = np.linalg.lstsq(body.nodes, found, rcond=None)[0]
        assert np.abs(found - body.nodes @ affine).max() < 1e-10
        errors.append(np.abs(found - wanted).max() / np.abs(wanted).max())
    print(f"{mode}: off by {errors[0]:.1e} at K = 1e4 C1 and by {errors[1]:.1e} at 1e6")
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(100.0, rel=0.01)


def _areas(system, axis):
    """∫ N dA over the face at the end of an axis: from the forces of a unit pressure."""
    problem = Problem(system, MATERIAL)
    pressure = constant_pressure(system.body, 1.0)
    rest = MechanicalState(np.zeros_like(system.body.nodes), pressure, 0.0)
    force = problem.linearise(rest, tangent=False).force[:, axis]
    return np.where(np.isclose(system.body.nodes[:, axis], SIZE[axis]), force, 0.0)


def test_peak_stretch_of_a_homogeneous_stretch_is_that_stretch(two_chambers):
    body = two_chambers.mesh.body
    # turned as well, since a stretch must not see rotations
    c, s = np.cos(1.1), np.sin(1.1)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    f = turn @ np.diag([1.37, 1.2, 0.6])
    state = MechanicalState(
        body.nodes @ (f - np.eye(3)).T, two_chambers.system.rest().pressure, 0.0
    )
    stretches = StrainFields.of(body, state).largest
    np.testing.assert_allclose(stretches.value, 1.37, rtol=1e-12)
    # n ⊗ N: along the turned axis in space, along x in the undeformed body
    np.testing.assert_allclose(
        stretches.slope - np.outer(turn[:, 0], [1.0, 0.0, 0.0]), 0.0, atol=1e-12
    )
    for share in (0.0, 0.5, 0.99, 1.0):
        quantile = volume_quantile(stretches.value, body.weights, share)
        assert quantile == pytest.approx(1.37, rel=1e-12)


def test_peak_stretch_is_a_quantile_over_volume_not_over_elements(block):
    """u = 0.2 x**2 stretches linearly from 1 to 2.2 along x: quantiles are known."""
    body = block(counts=(12, 1, 1))
    displacement = np.zeros_like(body.nodes)
    displacement[:, 0] = 0.2 * body.nodes[:, 0] ** 2
    state = MechanicalState(displacement, np.zeros((12, 4)), 0.0)
    stretches = StrainFields.of(body, state).largest
    for share in (0.25, 0.5, 0.9):
        wanted = 1.0 + 0.4 * share * 3.0
        # one Gauss slab of an element is a twelfth times 5/18 to 8/18 of the volume
        found = volume_quantile(stretches.value, body.weights, share)
        assert found == pytest.approx(wanted, abs=0.4 * 3.0 * 0.04)


@pytest.mark.parametrize("c3", [0.0, 1e-4, 0.02])
def test_ellipticity_is_that_of_the_energy_slope(c3):
    x = np.geomspace(1e-3, 1e6, 20001)
    for c2 in (-1.001 * np.sqrt(3.0 * c3) - 1e-3 * (c3 == 0.0), -0.999 * np.sqrt(3.0 * c3), 0.1):
        slope = 1.0 + 2.0 * c2 * x + 3.0 * c3 * x**2
        assert is_elliptic(MaterialGroups(c2, c3, 0.0)) == bool(np.all(slope > 0.0))


@pytest.mark.parametrize("c2", [-0.1, 0.0, 0.1, float("nan")])
def test_negative_third_constant_is_never_elliptic(c2):
    assert not is_elliptic(MaterialGroups(c2, -1e-3, 0.0))
    assert not is_elliptic(MaterialGroups(c2, float("nan"), 0.0))


@pytest.mark.parametrize("r", [-1e-6, float("nan")])
def test_negative_second_invariant_term_is_not_elliptic(r):
    assert not is_elliptic(MaterialGroups(0.0, 0.01, 0.0, second_invariant_ratio=r))
