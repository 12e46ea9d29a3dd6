"""Work of the pressure, stored energy, and their balance along a path."""

import numpy as np
import pytest

from bayesdeg.actuator import kernels, paper
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.problem import MechanicalState, Problem
from bayesdeg.actuator.status import PathEffort

pytestmark = pytest.mark.fem

EXACT = PathEffort(tolerance=1e-6, iterations=12, rate_tolerance=1e-9, exact=True)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_work_of_the_follower_pressure_is_p_dv(two_chambers, random_state, seed):
    """∫ f · du along a straight line; the volume is cubic, so Gauss's rule is exact."""
    body, pressure = two_chambers.mesh.body, 0.7
    problem = Problem(two_chambers.system, MaterialGroups(0.0, 0.0, paper_group=0.0))
    ends = [random_state(body, s).displacement for s in (seed, seed + 10)]
    points, weights = np.polynomial.legendre.leggauss(3)
    work = 0.0
    for point, weight in zip(0.5 + 0.5 * points, 0.5 * weights, strict=True):
        here = MechanicalState(
            ends[0] + point * (ends[1] - ends[0]), problem.system.rest().pressure, 0.0
        )
        work += weight * pressure * np.sum(problem.cavity_gradient(here) * (ends[1] - ends[0]))
    volumes = [
        problem.linearise(MechanicalState(u, problem.system.rest().pressure, 0.0)).cavity_volume
        for u in ends
    ]
    error = abs(work / (pressure * (volumes[1] - volumes[0])) - 1.0)
    print(f"work over p dV - 1: {error:.1e}")
    assert error < 1e-8


def test_energy_of_the_law_is_that_of_the_invariants(
    two_chambers, random_state, solid_energy, every_effect
):
    body, system = two_chambers.mesh.body, two_chambers.system
    problem, u = Problem(system, every_effect), random_state(body, 4).displacement
    f = np.empty((*body.weights.shape, 3, 3))
    kernels.deformation(u, body.elements, body.gradients, f)
    density = np.array(
        [
            [kernels.energy(f[e, q], problem.constants[e, q]) for q in range(f.shape[1])]
            for e in range(f.shape[0])
        ]
    )
    residual = problem.linearise(MechanicalState(u, system.rest().pressure, 0.0)).volume_residual
    volumetric = np.einsum("em,emn,en->", residual, system.inverse_mass, residual)
    total = np.sum(body.weights * density) + 0.5 * every_effect.bulk_ratio * volumetric
    assert total == pytest.approx(solid_energy(body, u, every_effect), rel=1e-11)


def test_energy_of_the_membrane_is_that_of_the_strains(
    two_chambers, random_state, paper_energy, every_effect
):
    body = two_chambers.mesh.body
    u = random_state(body, 5).displacement
    problem = Problem(two_chambers.system, every_effect)
    found = paper.membrane(
        body.nodes + u,
        body.nodes,
        body.paper,
        *kernels.face_shapes(body.element.order)[1:],
        problem.paper_law,
        np.zeros_like(u),
        two_chambers.system.paper_at,
        np.empty(0),
    )
    assert found == pytest.approx(paper_energy(body, u, every_effect), rel=1e-11)


@pytest.mark.parametrize("name", ["fresh", "every_effect"])
def test_work_of_the_pressure_is_the_energy_stored(
    two_chambers, path_of, stored_energy, name, request
):
    """∫ p dV between rest and the end, less what dead loads do, by a rule of fourth order.

    ∫ p dV = p V − ∫ V dp, the latter from V and dV/dp at the loads (Hermite and Simpson).
    """
    problem = Problem(two_chambers.system, request.getfixturevalue(name))
    gaps = []
    for n in (6, 12):
        loads = np.linspace(0.0, 0.6, n + 1)
        path = path_of(problem, tuple(loads[1:]), EXACT)
        points = (path.rest, *path.points)
        volume = np.array([problem.linearise(p.state, tangent=False).cavity_volume for p in points])
        rate = np.array(
            [np.sum(problem.cavity_gradient(p.state) * p.rate.displacement) for p in points]
        )
        step = 0.6 / n
        integral = np.trapezoid(volume, dx=step) + step**2 / 12.0 * (rate[0] - rate[-1])
        work = 0.6 * volume[-1] - integral
        ends = [points[i].state.displacement for i in (0, -1)]
        stored = np.diff(
            [stored_energy(problem, u) - np.sum(problem.dead_force * u) for u in ends]
        )[0]
        assert stored > 0.0
        gaps.append(abs(work / stored - 1.0))
    order = np.log2(gaps[0] / gaps[1])
    print(f"{name}: gap {gaps[0]:.1e} with 6 loads, {gaps[1]:.1e} with 12, order {order:.1f}")
    assert gaps[1] < 1e-5
    assert order > 3.5


def test_energy_is_least_at_equilibrium(
    one_chamber, path_of, every_effect, stored_energy, enclosed_volume
):
    body, load = one_chamber.mesh.body, 0.5
    problem = Problem(one_chamber.system, every_effect)
    u = path_of(problem, (load,), EXACT).states[0].displacement

    def potential(w):
        lifted = load * enclosed_volume(body, body.nodes + w)
        return stored_energy(problem, w) - lifted - np.sum(problem.dead_force * w)

    rng = np.random.default_rng(3)
    for _ in range(5):
        v = one_chamber.system.expand(rng.standard_normal(len(one_chamber.system.free)))
        assert potential(u + 1e-3 * v) > potential(u)
        assert potential(u - 1e-3 * v) > potential(u)
