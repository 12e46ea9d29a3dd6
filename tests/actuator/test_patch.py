"""A homogeneous stretch of a block gives the stress of the closed form."""

import numpy as np
import pytest

from bayesdeg.actuator import kernels
from bayesdeg.actuator.equilibrium import is_elliptic
from bayesdeg.actuator.outputs import volume_quantile
from bayesdeg.actuator.system import Material, State, System
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.stress import nominal_stress

C2, C3 = -0.05, 0.03
MATERIAL = Material(c2_ratio=C2, c3_ratio=C3, paper_group=0.0, bulk_ratio=50.0)
PRINCIPAL = {
    "uniaxial": lambda s: (s, s**-0.5, s**-0.5),
    "equibiaxial": lambda s: (s, s, s**-2.0),
    "planar": lambda s: (s, 1.0, 1.0 / s),
}
LOADED = {"uniaxial": (0,), "equibiaxial": (0, 1), "planar": (0,)}


def internal_force(system, displacement, hydrostatic):
    """Nodal forces (n_nodes, 3) under a given constant pressure, nothing condensed."""
    mesh, n = system.mesh, len(system.mesh.elements)
    pressure = np.zeros((n, 4))
    pressure[:, 0] = hydrostatic
    residual = np.zeros(mesh.nodes.size)
    coupling, volume = np.empty((n, 4, 81)), np.empty((n, 4))
    kernels.solid(
        displacement,
        pressure,
        mesh.elements,
        mesh.gradients,
        mesh.weights,
        system.modes,
        system.inverse_mass,
        np.array([1.0, C2, C3]),
        1.0,
        residual,
        coupling,
        volume,
        np.full((n, 81, 81), -1, dtype=np.int32),
        np.zeros(1),
    )
    lifted = np.einsum("emk,emn,en->ek", coupling, system.inverse_mass, volume)
    condensed = np.zeros(mesh.nodes.shape)
    np.add.at(condensed, mesh.elements, lifted.reshape(n, 27, 3))
    return residual.reshape(-1, 3) - condensed


def pressure_that_frees(axis, stretches):
    """Pressure at which the Cauchy stress along an axis vanishes, J being 1."""
    squares = np.array(stretches) ** 2
    x = squares.sum() - 3.0
    slope = 1.0 + 2.0 * C2 * x + 3.0 * C3 * x**2
    return -2.0 * slope * (squares[axis] - squares.sum() / 3.0)


@pytest.mark.parametrize("stretch", [0.8, 1.3, 2.0])
@pytest.mark.parametrize("mode", PRINCIPAL)
def test_forces_of_a_stretched_block_are_those_of_the_closed_form(block, mode, stretch):
    size = np.array([3.0, 2.0, 2.5])
    system = System(block(size=size, distortion=1.0))
    nodes = system.mesh.nodes
    stretches = np.array(PRINCIPAL[mode](stretch))
    force = internal_force(system, nodes * (stretches - 1.0), pressure_that_frees(2, stretches))
    wanted = float(nominal_stress(Yeoh(1.0, C2, C3), stretch, mode=mode))
    for axis in LOADED[mode]:
        on_face = np.isclose(nodes[:, axis], size[axis])
        area = np.prod(np.delete(size, axis))
        assert force[on_face, axis].sum() == pytest.approx(wanted * area, rel=1e-10)
    np.testing.assert_allclose(force[:, 2], 0.0, atol=1e-10)
    inside = np.all((nodes > 1e-9) & (nodes < size - 1e-9), axis=1)
    assert inside.sum() > 20
    np.testing.assert_allclose(force[inside], 0.0, atol=1e-10)


@pytest.mark.parametrize("mode", PRINCIPAL)
def test_end_force_of_the_stretched_actuator_is_stress_times_area(two_chambers, mode):
    mesh = two_chambers.mesh
    stretches = np.array(PRINCIPAL[mode](1.4))
    hydrostatic = pressure_that_frees(2, stretches)
    force = internal_force(two_chambers, mesh.nodes * (stretches - 1.0), hydrostatic)
    wanted = float(nominal_stress(Yeoh(1.0, C2, C3), 1.4, mode=mode))
    d = mesh.geometry.dimensions
    total = force[np.unique(mesh.free_end), 0].sum()
    assert total == pytest.approx(wanted * d.width / 2.0 * d.height, rel=1e-10)


@pytest.mark.parametrize("mode", PRINCIPAL)
def test_affine_boundary_gives_an_affine_solution(block, mode):
    """Newton's method on the nodes inside a distorted block, from a wrong start."""
    size = np.array([3.0, 2.0, 2.5])
    system = System(block(size=size, distortion=1.0))
    nodes = system.mesh.nodes
    inside = np.all((nodes > 1e-9) & (nodes < size - 1e-9), axis=1)
    # J is not 1: the material is slightly compressible
    affine = nodes * (np.array(PRINCIPAL[mode](1.3)) * 1.01 - 1.0)
    state = State(np.where(inside[:, None], 0.9 * affine, affine), system.rest().pressure, 0.0)
    unknown = np.flatnonzero(np.repeat(inside, 3))
    for _ in range(12):
        lin = system.linearise(state, MATERIAL)
        upper = system.upper.copy()
        upper.data = lin.tangent
        tangent = upper.toarray()
        tangent += np.triu(tangent, 1).T
        step = np.zeros(nodes.size)
        step[unknown] = np.linalg.solve(tangent[np.ix_(unknown, unknown)], -lin.residual[unknown])
        increment = step.reshape(-1, 3)
        state = state.moved(increment, system.condensed_pressure(lin, increment, MATERIAL))
    np.testing.assert_allclose(state.displacement, affine, atol=1e-10)
    constant = MATERIAL.bulk_ratio * (1.01**3 - 1.0)
    np.testing.assert_allclose(state.pressure[:, 0], constant, rtol=1e-10)
    np.testing.assert_allclose(state.pressure[:, 1:], 0.0, atol=1e-9)


def test_peak_stretch_of_a_homogeneous_stretch_is_that_stretch(two_chambers):
    nodes = two_chambers.mesh.nodes
    # turned as well, since a stretch must not see rotations
    c, s = np.cos(1.1), np.sin(1.1)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    f = turn @ np.diag([1.37, 1.2, 0.6])
    state = State(nodes @ (f - np.eye(3)).T, two_chambers.rest().pressure, 0.0)
    for share in (0.0, 0.5, 0.99, 1.0):
        assert volume_quantile(two_chambers.mesh, state, share) == pytest.approx(1.37, rel=1e-12)


def test_peak_stretch_is_a_quantile_over_volume_not_over_elements(block):
    """u = 0.2 x**2 stretches linearly from 1 to 2.2 along x: quantiles are known."""
    mesh = block(counts=(12, 1, 1))
    displacement = np.zeros_like(mesh.nodes)
    displacement[:, 0] = 0.2 * mesh.nodes[:, 0] ** 2
    state = State(displacement, np.zeros((12, 4)), 0.0)
    for share in (0.25, 0.5, 0.9):
        wanted = 1.0 + 0.4 * share * 3.0
        # one Gauss slab of an element is a twelfth times 5/18 to 8/18 of the volume
        assert volume_quantile(mesh, state, share) == pytest.approx(wanted, abs=0.4 * 3.0 * 0.04)


@pytest.mark.parametrize("c3", [0.0, 1e-4, 0.02])
def test_ellipticity_is_that_of_the_energy_slope(c3):
    x = np.geomspace(1e-3, 1e6, 20001)
    for c2 in (-1.001 * np.sqrt(3.0 * c3) - 1e-3 * (c3 == 0.0), -0.999 * np.sqrt(3.0 * c3), 0.1):
        slope = 1.0 + 2.0 * c2 * x + 3.0 * c3 * x**2
        assert is_elliptic(Material(c2, c3, 0.0)) == bool(np.all(slope > 0.0))


@pytest.mark.parametrize("c2", [-0.1, 0.0, 0.1, float("nan")])
def test_negative_third_constant_is_never_elliptic(c2):
    assert not is_elliptic(Material(c2, -1e-3, 0.0))
    assert not is_elliptic(Material(c2, float("nan"), 0.0))
