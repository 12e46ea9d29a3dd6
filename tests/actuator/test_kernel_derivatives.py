"""Residuals against an energy written in numpy, tangents against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import LINEAR_CONSTANT, LINEAR_FULL, QUADRATIC, QUADRATIC_CONSTANT
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.paper import membrane_law
from bayesdeg.actuator.problem import MechanicalState, Problem, System
from bayesdeg.actuator.sensitivity import MATERIAL_INPUTS, residual_rates
from bayesdeg.data.settings import Dimensions

STEP = 1e-6
NO_PAPER = MaterialGroups(
    c2_ratio=-0.03,
    c3_ratio=0.02,
    paper_group=0.0,
    bulk_ratio=300.0,
    second_invariant_ratio=0.4,
    skin=0.5,
)
PAPERED = replace(
    NO_PAPER, paper_group=50.0, paper_thickness=0.4, paper_slack=0.05, paper_mismatch=0.02
)
PLAIN_PAPER = replace(NO_PAPER, paper_group=50.0)
SEEDS = (1, 2)
ELEMENTS = (LINEAR_FULL, LINEAR_CONSTANT, QUADRATIC_CONSTANT, QUADRATIC)


@pytest.fixture(scope="module", params=ELEMENTS, ids=lambda element: element.name)
def loose(request):
    """Two chambers of which nothing is held, so that every degree of freedom is seen."""
    geometry = Geometry(Dimensions(length=20.0, chambers=2))
    body = build_mesh(geometry, Resolution(9.0, 9.0, 9.0), element=request.param).body
    return System(replace(body, fixed=np.zeros_like(body.fixed)))


def direction_at(system, seed):
    return np.random.default_rng(1000 + seed).standard_normal(system.body.nodes.shape)


def relative(found, wanted):
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


def lifted(problem, volume_residual):
    return problem.material.bulk_ratio * np.einsum(
        "emn,en->em", problem.system.inverse_mass, volume_residual
    )


def eliminated(problem, displacement, load=0.0):
    """The state whose pressure field satisfies the volume equation: p = K M^-1 int N (J - 1)."""
    state = MechanicalState(displacement, problem.system.rest().pressure, load)
    residual = problem.linearise(state, tangent=False).volume_residual
    return replace(state, pressure=lifted(problem, residual))


def matrix(problem, lin):
    """The tangent from the stored upper triangle."""
    upper = problem.system.upper.copy()
    upper.data = lin.tangent
    return upper + sp.triu(upper, k=1).T


def slope(function, displacement, direction):
    """Central difference of a field, along a direction."""
    ahead, behind = (function(displacement + s * STEP * direction) for s in (1.0, -1.0))
    return (ahead - behind) / (2.0 * STEP)


def complex_step(function, displacement, direction):
    return np.imag(function(displacement + 1e-30j * direction)) / 1e-30


@pytest.mark.parametrize("seed", SEEDS)
def test_solid_residual_is_the_derivative_of_the_energy(loose, random_state, solid_energy, seed):
    u, v = random_state(loose.body, seed).displacement, direction_at(loose, seed)
    problem = Problem(loose, NO_PAPER)
    lin = problem.linearise(eliminated(problem, u))
    np.testing.assert_allclose(lin.volume_residual, 0.0, atol=1e-12)
    wanted = complex_step(lambda w: solid_energy(loose.body, w, NO_PAPER), u, v)
    assert np.sum(lin.force * v) == pytest.approx(wanted, rel=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_solid_tangent_is_the_derivative_of_the_eliminated_residual(loose, random_state, seed):
    u, v = random_state(loose.body, seed).displacement, direction_at(loose, seed)
    problem = Problem(loose, NO_PAPER)

    def force(w):
        return problem.linearise(eliminated(problem, w), tangent=False).force.ravel()

    product = matrix(problem, problem.linearise(eliminated(problem, u))) @ v.ravel()
    assert relative(product, slope(force, u, v)) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_solid_tangent_condenses_the_mixed_system_at_any_pressure(loose, random_state, seed):
    state, v = random_state(loose.body, seed), direction_at(loose, seed)
    problem, elements = Problem(loose, NO_PAPER), loose.body.elements

    def at(w):
        return problem.linearise(replace(state, displacement=w), tangent=False)

    lin = problem.linearise(state)
    local = np.swapaxes(v[elements], 1, 2).reshape(len(elements), -1)
    strain = np.einsum("emk,ek->em", lin.coupling, local)
    assert relative(strain, slope(lambda w: at(w).volume_residual, state.displacement, v)) < 1e-6
    wanted = slope(lambda w: at(w).force, state.displacement, v)
    push = np.einsum("emk,em->ek", lin.coupling, lifted(problem, strain))
    np.add.at(wanted, elements, np.swapaxes(push.reshape(len(elements), 3, -1), 1, 2))
    assert relative(matrix(problem, lin) @ v.ravel(), wanted.ravel()) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_products_are_the_derivative_of_the_mixed_residual(loose, random_state, seed):
    """By displacement, pressure field and load at once, nothing condensed, all effects on."""
    state, rng = random_state(loose.body, seed, load=0.4), np.random.default_rng(seed)
    problem, v = Problem(loose, PAPERED), direction_at(loose, seed)
    along = MechanicalState(v, rng.standard_normal(state.pressure.shape), 0.7)

    def at(step):
        move = (step * along.displacement, step * along.pressure, step * along.load)
        return problem.linearise(state.moved(*move), tangent=False)

    ahead, behind = at(STEP), at(-STEP)
    ((force, volume),) = problem.products(state, [along])
    assert relative(force, (ahead.force - behind.force) / (2.0 * STEP)) < 1e-6
    difference = (ahead.volume_residual - behind.volume_residual) / (2.0 * STEP)
    assert relative(volume, difference) < 1e-6


def test_mixed_tangent_is_symmetric(loose, random_state):
    """Seen from the products, which store no half of it; the follower pressure is included."""
    state, rng = random_state(loose.body, 3, load=0.4), np.random.default_rng(3)
    problem = Problem(loose, PAPERED)
    one, other = (
        MechanicalState(direction_at(loose, k), rng.standard_normal(state.pressure.shape), 0.0)
        for k in (4, 5)
    )
    # a cavity cut at the plane of symmetry is closed for displacements within that plane only
    held = np.isclose(loose.body.nodes[:, 1], 0.0)
    one.displacement[held, 1] = other.displacement[held, 1] = 0.0
    (f1, v1), (f2, v2) = problem.products(state, [one, other])
    forth = np.sum(f1 * other.displacement) + np.sum(v1 * other.pressure)
    back = np.sum(f2 * one.displacement) + np.sum(v2 * one.pressure)
    size = np.linalg.norm(f1) * np.linalg.norm(other.displacement)
    print(f"asymmetry {abs(forth - back) / size:.1e} of the largest possible value")
    assert abs(forth - back) < 1e-13 * size


@pytest.mark.parametrize("seed", SEEDS)
def test_cavity_force_is_the_derivative_of_the_enclosed_volume(
    loose, random_state, enclosed_volume, seed
):
    body, problem = loose.body, Problem(loose, NO_PAPER)
    state, v = random_state(body, seed), direction_at(loose, seed)
    v[np.isclose(body.nodes[:, 1], 0.0), 1] = 0.0
    volume = problem.linearise(state, tangent=False).cavity_volume
    placed = body.nodes + state.displacement
    assert volume == pytest.approx(enclosed_volume(body, placed), rel=1e-12)
    wanted = complex_step(lambda w: enclosed_volume(body, w), placed, v)
    assert np.sum(problem.cavity_gradient(state) * v) == pytest.approx(wanted, rel=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_cavity_tangent_is_the_derivative_of_its_force(loose, random_state, seed):
    state, v = random_state(loose.body, seed), direction_at(loose, seed)
    problem = Problem(loose, NO_PAPER)
    under, without = (
        matrix(problem, problem.linearise(replace(state, load=load))) for load in (0.7, 0.0)
    )

    def force(w):
        return -0.7 * problem.cavity_gradient(replace(state, displacement=w)).ravel()

    wanted = slope(force, state.displacement, v)
    assert relative((under - without) @ v.ravel(), wanted) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("paper", [PLAIN_PAPER, PAPERED], ids=["plain", "slack and longer"])
def test_paper_residual_is_the_derivative_of_the_energy(
    loose, random_state, paper_energy, paper, seed
):
    state, v = random_state(loose.body, seed), direction_at(loose, seed)
    with_paper, without = (
        Problem(loose, m).linearise(state, tangent=False).force
        for m in (replace(paper, paper_thickness=0.0), NO_PAPER)
    )
    wanted = complex_step(lambda w: paper_energy(loose.body, w, paper), state.displacement, v)
    assert np.sum((with_paper - without) * v) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("paper", [PLAIN_PAPER, PAPERED], ids=["plain", "bending, slack, longer"])
def test_paper_tangent_is_the_derivative_of_its_force(loose, random_state, paper, seed):
    state, v = random_state(loose.body, seed), direction_at(loose, seed)
    problem, bare = Problem(loose, paper), Problem(loose, NO_PAPER)

    def force(w):
        at = replace(state, displacement=w)
        both = (p.linearise(at, tangent=False).force.ravel() for p in (problem, bare))
        return next(both) - next(both)

    stiff, soft = (matrix(p, p.linearise(state)) for p in (problem, bare))
    wanted = slope(force, state.displacement, v)
    assert relative((stiff - soft) @ v.ravel(), wanted) < 1e-6


def test_slack_law_is_smooth_where_its_series_takes_over():
    """Energy, stress and tangent from either side of q/s = 0.01."""
    found = []
    for strain in (0.01 * (1 - 1e-9), 0.01 * (1 + 1e-9)):
        first = np.array([[np.sqrt(1.0 + 2.0 * strain), 0.0], [0.0, 1.0], [0.0, 0.0]])
        plain, share, rate, energy = membrane_law(first, np.array([50.0, 0.0, 1.0, 0.0]))
        found.append([share, rate, energy, *plain.ravel()])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


@pytest.mark.parametrize("angle", [0.3, 2.0, 4.0])
def test_solid_and_paper_do_not_resist_a_rigid_rotation(loose, angle):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    u = loose.body.nodes @ (turn - np.eye(3)).T + [1.0, 2.0, 3.0]
    problem = Problem(loose, replace(PAPERED, paper_mismatch=0.0))
    lin = problem.linearise(MechanicalState(u, loose.rest().pressure, 0.0))
    np.testing.assert_allclose(lin.force, 0.0, atol=1e-10)
    np.testing.assert_allclose(lin.volume_residual, 0.0, atol=1e-10)


def test_an_element_turned_inside_out_is_reported(loose):
    state = loose.rest()
    mirrored = state.moved(-2.0 * loose.body.nodes, np.zeros_like(state.pressure))
    smallest = Problem(loose, NO_PAPER).linearise(mirrored).smallest_jacobian
    assert smallest == pytest.approx(-1.0)


@pytest.mark.parametrize("name", ["one_chamber", "two_chambers"])
def test_assembled_tangent_is_the_derivative_of_the_assembled_residual(name, random_state, request):
    system = request.getfixturevalue(name).system
    problem = Problem(system, PAPERED)
    u = random_state(system.body, 5).displacement
    v = system.expand(np.random.default_rng(6).standard_normal(len(system.free)))

    def residual(w):
        return problem.linearise(eliminated(problem, w, 0.3)).residual

    tangent = matrix(problem, problem.linearise(eliminated(problem, u, 0.3)))
    assert relative(tangent @ system.on_free(v), slope(residual, u, v)) < 1e-6


def test_assembled_residual_is_the_derivative_of_the_total_potential(
    two_chambers, random_state, stored_energy, enclosed_volume
):
    system, load = two_chambers.system, 0.4
    material = replace(PAPERED, gravity_along=0.02, gravity_up=-0.03)
    pulls = np.random.default_rng(9).standard_normal(system.body.nodes.shape)
    problem = Problem(system, material, nodal_force=pulls)
    u = random_state(system.body, 7).displacement
    v = system.expand(np.random.default_rng(8).standard_normal(len(system.free)))
    weight = np.zeros_like(u)
    local = np.einsum("eq,qa->ea", system.body.weights, system.body.element.shapes)
    np.add.at(weight, system.body.elements, local[..., None] * [0.02, 0.0, -0.03])

    def potential(w):
        lifted_by_pressure = load * enclosed_volume(system.body, system.body.nodes + w)
        return stored_energy(problem, w) - lifted_by_pressure - np.sum((weight + pulls) * w)

    residual = problem.linearise(eliminated(problem, u, load)).residual
    wanted = complex_step(potential, u, v)
    assert residual @ system.on_free(v) == pytest.approx(wanted, rel=1e-10)


def test_pressure_increments_keep_the_volume_equation(loose, random_state):
    problem, start = Problem(loose, NO_PAPER), random_state(loose.body, 9)
    increment = 1e-5 * direction_at(loose, 9)
    lin = problem.linearise(start)
    change = problem.pressure_increment(lin, increment, lin.volume_residual)
    left = np.abs(problem.linearise(start.moved(increment, change)).volume_residual).max()
    assert left < 1e-6 * np.abs(lin.volume_residual).max()


@pytest.mark.parametrize("name", MATERIAL_INPUTS)
def test_residual_rates_are_derivatives_of_the_residual(two_chambers, random_state, name):
    """∂R/∂m by central differences; those by gravity are exact at any step."""
    system = two_chambers.system
    material = replace(PAPERED, gravity_along=1e-3, gravity_up=-2e-3)
    state = random_state(system.body, 10, load=0.3)
    rate = residual_rates(Problem(system, material), state)[MATERIAL_INPUTS.index(name)]
    start = state.load if name == "load" else getattr(material, name)
    step = 1e-4 * abs(start)

    def force(value):
        if name == "load":
            return Problem(system, material).linearise(replace(state, load=value)).force
        return Problem(system, replace(material, **{name: value})).linearise(state).force

    wanted = (force(start + step) - force(start - step)) / (2.0 * step)
    error = relative(rate, wanted)
    print(f"{name}: {error:.1e}")
    assert error < 1e-6


@pytest.mark.parametrize("order", [1, 2])
def test_line_shapes_interpolate_polynomials_of_their_order(order):
    t = np.linspace(0.0, 1.0, 7)
    values, slopes = kernels.line_shapes(order, t)
    at_nodes = np.linspace(0.0, 1.0, order + 1)
    for power in range(order + 1):
        np.testing.assert_allclose(values @ at_nodes**power, t**power, atol=1e-14)
        wanted = power * t ** max(power - 1, 0)
        np.testing.assert_allclose(slopes @ at_nodes**power, wanted, atol=1e-14)
