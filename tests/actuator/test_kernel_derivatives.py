"""Residuals against an energy written in numpy, tangents against finite differences."""

import numpy as np
import pytest

from bayesdeg.actuator import kernels, surfaces
from bayesdeg.actuator.system import Material, State

STEP = 1e-6
MATERIAL = Material(c2_ratio=-0.03, c3_ratio=0.02, paper_group=50.0, bulk_ratio=300.0)
SEEDS = (1, 2, 3)


def everywhere(n_parts, size):
    """Positions that keep the entries of every element apart, both triangles."""
    at = np.arange(n_parts * size * size, dtype=np.int32).reshape(n_parts, size, size)
    return at, np.zeros(at.size)


def solid(system, displacement, pressure, material=MATERIAL):
    """Residual at fixed pressure, coupling, volume residual and element tangents."""
    mesh, n = system.mesh, len(system.mesh.elements)
    residual = np.zeros(mesh.nodes.size)
    coupling, volume = np.empty((n, 4, 81)), np.empty((n, 4))
    at, data = everywhere(n, 81)
    smallest = kernels.solid(
        displacement,
        pressure,
        mesh.elements,
        mesh.gradients,
        mesh.weights,
        system.modes,
        system.inverse_mass,
        np.array([1.0, material.c2_ratio, material.c3_ratio]),
        material.bulk_ratio,
        residual,
        coupling,
        volume,
        at,
        data,
    )
    assert smallest > 0.0
    return residual, coupling, volume, data.reshape(at.shape)


def cavity(system, displacement, factor=1.0):
    mesh = system.mesh
    residual = np.zeros(mesh.nodes.size)
    at, data = everywhere(len(mesh.cavity), 27)
    volume = surfaces.cavity_volume(
        mesh.nodes + displacement,
        mesh.cavity,
        *surfaces.face_shapes(),
        factor,
        residual,
        at,
        data,
    )
    return residual, volume, data.reshape(at.shape)


def membrane(system, displacement, material=MATERIAL):
    mesh = system.mesh
    residual = np.zeros(mesh.nodes.size)
    at, data = everywhere(len(mesh.bottom), 27)
    surfaces.membrane(
        displacement,
        mesh.nodes,
        mesh.bottom,
        *surfaces.face_shapes()[1:],
        material.paper_group,
        material.paper_poisson,
        residual,
        at,
        data,
    )
    return residual, data.reshape(at.shape)


def apply(tangents, parts, direction):
    """Product of element tangents, summed over the elements, with a field."""
    local = direction[parts].reshape(len(parts), -1)
    product = np.zeros(direction.shape)
    np.add.at(product, parts, np.einsum("eij,ej->ei", tangents, local).reshape(*parts.shape, 3))
    return product.ravel()


def direction_at(system, seed):
    direction = np.random.default_rng(1000 + seed).standard_normal(system.mesh.nodes.shape)
    direction[system.mesh.symmetry, 1] = 0.0
    return direction


def relative(found, wanted):
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


def eliminated(system, displacement, material=MATERIAL):
    """The pressure field that satisfies the volume equation: p = K M^-1 int N (J - 1)."""
    volume = solid(system, displacement, np.zeros((len(system.mesh.elements), 4)), material)[2]
    return material.bulk_ratio * np.einsum("emn,en->em", system.inverse_mass, volume)


def complex_step(function, displacement, direction):
    return np.imag(function(displacement + 1e-30j * direction)) / 1e-30


@pytest.mark.parametrize("seed", SEEDS)
def test_solid_residual_is_the_derivative_of_the_energy(
    one_chamber, random_state, solid_energy, seed
):
    u, v = random_state(one_chamber.mesh, seed).displacement, direction_at(one_chamber, seed)
    residual, _, volume, _ = solid(one_chamber, u, eliminated(one_chamber, u))
    np.testing.assert_allclose(volume, 0.0, atol=1e-12)
    slope = complex_step(lambda w: solid_energy(one_chamber, w, MATERIAL), u, v)
    assert residual @ v.ravel() == pytest.approx(slope, rel=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_solid_tangent_is_the_derivative_of_the_eliminated_residual(
    one_chamber, random_state, seed
):
    u, v = random_state(one_chamber.mesh, seed).displacement, direction_at(one_chamber, seed)
    tangents = solid(one_chamber, u, eliminated(one_chamber, u))[3]
    ahead, behind = (
        solid(one_chamber, w, eliminated(one_chamber, w))[0] for w in (u + STEP * v, u - STEP * v)
    )
    product = apply(tangents, one_chamber.mesh.elements, v)
    assert relative(product, (ahead - behind) / (2.0 * STEP)) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_solid_tangent_condenses_the_mixed_system_at_any_pressure(one_chamber, random_state, seed):
    state, v = random_state(one_chamber.mesh, seed), direction_at(one_chamber, seed)
    u, p, elements = state.displacement, state.pressure, one_chamber.mesh.elements

    def lifted(mixed):
        return MATERIAL.bulk_ratio * np.einsum("emn,en->em", one_chamber.inverse_mass, mixed)

    def scattered(coupling, mixed):
        force = np.zeros(u.shape)
        local = np.einsum("emk,em->ek", coupling, lifted(mixed))
        np.add.at(force, elements, local.reshape(*elements.shape, 3))
        return force.ravel()

    def uncondensed(w):
        residual, coupling, volume, _ = solid(one_chamber, w, p)
        return residual - scattered(coupling, volume), volume

    _, coupling, _, tangents = solid(one_chamber, u, p)
    (force_ahead, volume_ahead), (force_behind, volume_behind) = (
        uncondensed(u + STEP * v),
        uncondensed(u - STEP * v),
    )
    strain = np.einsum("emk,ek->em", coupling, v[elements].reshape(len(elements), 81))
    assert relative(strain, (volume_ahead - volume_behind) / (2.0 * STEP)) < 1e-6
    wanted = (force_ahead - force_behind) / (2.0 * STEP) + scattered(coupling, strain)
    assert relative(apply(tangents, elements, v), wanted) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_every_element_tangent_is_symmetric(one_chamber, random_state, seed):
    state = random_state(one_chamber.mesh, seed)
    for tangents in (
        solid(one_chamber, state.displacement, state.pressure)[3],
        cavity(one_chamber, state.displacement)[2],
        membrane(one_chamber, state.displacement)[1],
    ):
        largest = np.abs(tangents).max()
        assert np.abs(tangents - np.swapaxes(tangents, 1, 2)).max() < 1e-12 * largest


@pytest.mark.parametrize("seed", SEEDS)
def test_cavity_force_is_the_derivative_of_the_enclosed_volume(
    two_chambers, random_state, enclosed_volume, seed
):
    mesh = two_chambers.mesh
    u, v = random_state(mesh, seed).displacement, direction_at(two_chambers, seed)
    gradient, volume, _ = cavity(two_chambers, u)
    assert volume == pytest.approx(enclosed_volume(mesh, mesh.nodes + u), rel=1e-12)
    slope = complex_step(lambda w: enclosed_volume(mesh, mesh.nodes + w), u, v)
    assert gradient @ v.ravel() == pytest.approx(slope, rel=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_cavity_tangent_is_the_derivative_of_its_force(two_chambers, random_state, seed):
    u, v = random_state(two_chambers.mesh, seed).displacement, direction_at(two_chambers, seed)
    tangents = cavity(two_chambers, u, -0.7)[2]
    ahead, behind = (cavity(two_chambers, w, -0.7)[0] for w in (u + STEP * v, u - STEP * v))
    product = apply(tangents, two_chambers.mesh.cavity, v)
    assert relative(product, (ahead - behind) / (2.0 * STEP)) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_paper_residual_is_the_derivative_of_the_energy(
    two_chambers, random_state, paper_energy, seed
):
    mesh = two_chambers.mesh
    u, v = random_state(mesh, seed).displacement, direction_at(two_chambers, seed)
    slope = complex_step(lambda w: paper_energy(mesh, w, MATERIAL), u, v)
    assert membrane(two_chambers, u)[0] @ v.ravel() == pytest.approx(slope, rel=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_paper_tangent_is_the_derivative_of_its_force(two_chambers, random_state, seed):
    u, v = random_state(two_chambers.mesh, seed).displacement, direction_at(two_chambers, seed)
    tangents = membrane(two_chambers, u)[1]
    ahead, behind = (membrane(two_chambers, w)[0] for w in (u + STEP * v, u - STEP * v))
    product = apply(tangents, two_chambers.mesh.bottom, v)
    assert relative(product, (ahead - behind) / (2.0 * STEP)) < 1e-6


@pytest.mark.parametrize("angle", [0.3, 2.0, 4.0])
def test_solid_and_paper_do_not_resist_a_rigid_rotation(two_chambers, angle):
    mesh = two_chambers.mesh
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    u = mesh.nodes @ (turn - np.eye(3)).T + [1.0, 2.0, 3.0]
    rest = np.zeros((len(mesh.elements), 4))
    np.testing.assert_allclose(solid(two_chambers, u, rest)[0], 0.0, atol=1e-10)
    np.testing.assert_allclose(membrane(two_chambers, u)[0], 0.0, atol=1e-10)


def test_an_element_turned_inside_out_is_reported(one_chamber, fresh):
    state = one_chamber.rest()
    mirrored = state.moved(-2.0 * one_chamber.mesh.nodes, np.zeros_like(state.pressure))
    assert one_chamber.linearise(mirrored, fresh).smallest_jacobian == pytest.approx(-1.0)


@pytest.mark.parametrize("system_name", ["one_chamber", "two_chambers"])
def test_assembled_tangent_is_the_derivative_of_the_assembled_residual(
    system_name, random_state, request
):
    system = request.getfixturevalue(system_name)
    start = random_state(system.mesh, 5, load=0.3)
    v = system.expand(np.random.default_rng(6).standard_normal(len(system.free)))

    def linearise(displacement):
        pressure = eliminated(system, displacement)
        return system.linearise(State(displacement, pressure, start.load), MATERIAL)

    upper = system.upper.copy()
    upper.data = linearise(start.displacement).tangent
    tangent = upper.toarray()
    tangent += np.triu(tangent, 1).T
    ahead, behind = (
        linearise(start.displacement + sign * STEP * v).residual for sign in (1.0, -1.0)
    )
    product = tangent @ v.ravel()[system.free]
    assert relative(product, (ahead - behind) / (2.0 * STEP)) < 1e-6


def test_assembled_residual_is_the_derivative_of_the_total_potential(
    two_chambers, random_state, solid_energy, paper_energy, enclosed_volume
):
    mesh = two_chambers.mesh
    u, load = random_state(mesh, 7).displacement, 0.4
    v = two_chambers.expand(np.random.default_rng(8).standard_normal(len(two_chambers.free)))

    def potential(w):
        stored = solid_energy(two_chambers, w, MATERIAL) + paper_energy(mesh, w, MATERIAL)
        return stored - load * enclosed_volume(mesh, mesh.nodes + w)

    state = State(u, eliminated(two_chambers, u), load)
    residual = two_chambers.linearise(state, MATERIAL).residual
    slope = complex_step(potential, u, v)
    assert residual @ v.ravel()[two_chambers.free] == pytest.approx(slope, rel=1e-10)


def test_pressure_increments_keep_the_volume_equation(one_chamber, random_state):
    start = random_state(one_chamber.mesh, 9)
    increment = 1e-5 * direction_at(one_chamber, 9)
    lin = one_chamber.linearise(start, MATERIAL)
    moved = start.moved(increment, one_chamber.condensed_pressure(lin, increment, MATERIAL))
    left = np.abs(one_chamber.linearise(moved, MATERIAL).volume_residual).max()
    assert left < 1e-6 * np.abs(lin.volume_residual).max()


def test_quadratic_shapes_interpolate_parabolas():
    t = np.linspace(0.0, 1.0, 7)
    values, slopes = surfaces.quadratic_shapes(t)
    at_nodes = np.array([0.0, 0.5, 1.0])
    for power in range(3):
        np.testing.assert_allclose(values @ at_nodes**power, t**power, atol=1e-14)
        np.testing.assert_allclose(
            slopes @ at_nodes**power, power * t ** max(power - 1, 0), atol=1e-14
        )
