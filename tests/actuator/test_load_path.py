"""The load path: equilibrium, energy, the limit point, and statuses in place of exceptions."""

from itertools import pairwise

import numpy as np
import pytest

from bayesdeg.actuator.equilibrium import Effort, Status, follow
from bayesdeg.actuator.linear import LostDefinitenessError, open_factorization
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.system import Material

pytestmark = pytest.mark.fem

EXACT = Effort(tolerance=1e-9, iterations=12)


def test_states_stand_at_the_loads_and_in_equilibrium(two_chambers, fresh, equilibria):
    loads = (0.1, 0.35, 0.5)
    path = equilibria(two_chambers, fresh, loads, EXACT)
    assert path.status is Status.CONVERGED
    assert path.limit_load == np.inf
    assert tuple(state.load for state in path.states) == loads
    for state in path.states:
        lin = two_chambers.linearise(state, fresh)
        force = state.load * two_chambers.cavity_force(state)
        assert np.linalg.norm(lin.residual) < 1e-8 * np.linalg.norm(force)
        assert np.abs(lin.volume_residual).max() < 1e-10
        np.testing.assert_array_equal(state.displacement[two_chambers.mesh.clamped], 0.0)
        np.testing.assert_array_equal(state.displacement[two_chambers.mesh.symmetry, 1], 0.0)


def test_equilibrium_does_not_depend_on_the_steps(two_chambers, fresh, equilibria):
    few = equilibria(two_chambers, fresh, (0.3, 0.6), EXACT)
    many = equilibria(two_chambers, fresh, tuple(np.linspace(0.05, 0.6, 12)), EXACT)
    np.testing.assert_allclose(few.states[-1].displacement, many.states[-1].displacement, atol=1e-9)


def test_default_effort_is_accurate_enough(two_chambers, fresh, equilibria):
    loads = tuple(np.linspace(0.1, 0.8, 8))
    default, exact = (equilibria(two_chambers, fresh, loads, e) for e in (None, EXACT))
    for a, b in zip(default.states, exact.states, strict=True):
        one, other = (read_state(two_chambers.mesh, state).curvature for state in (a, b))
        assert one == pytest.approx(other, rel=1e-5)
    assert default.iterations <= 2.5 * len(loads) + 1


def test_small_pressure_bends_in_proportion(two_chambers, fresh, equilibria):
    first, second = (
        read_state(two_chambers.mesh, state).bend_angle
        for state in equilibria(two_chambers, fresh, (1e-5, 2e-5), EXACT).states
    )
    assert first > 0.0
    assert second == pytest.approx(2.0 * first, rel=1e-3)


def test_neighbouring_loads_cost_no_extra_iterations(two_chambers, fresh, equilibria):
    apart = equilibria(two_chambers, fresh, (0.2, 0.4, 0.6))
    together = equilibria(two_chambers, fresh, (0.2, 0.4, 0.4 * (1.0 + 1e-10), 0.6))
    assert together.status is Status.CONVERGED
    assert together.iterations <= apart.iterations + 6
    np.testing.assert_allclose(
        together.states[-1].displacement, apart.states[-1].displacement, atol=1e-4
    )


def work_and_energy(system, material, loads, path, energies):
    """Trapezoid of p dV along the path, and the stored energy at its end [C1 mm3]."""
    solid, paper, volume = energies
    volumes = [volume(system.mesh, system.mesh.nodes)]
    volumes += [volume(system.mesh, system.mesh.nodes + s.displacement) for s in path.states]
    work = np.trapezoid(np.concatenate([[0.0], loads]), volumes)
    end = path.states[-1].displacement
    return work, solid(system, end, material) + paper(system.mesh, end, material)


def test_work_of_the_pressure_is_the_stored_energy(
    two_chambers, fresh, equilibria, solid_energy, paper_energy, enclosed_volume
):
    """The trapezoid's error falls with the square of the step; extrapolated, the balance closes."""
    energies = solid_energy, paper_energy, enclosed_volume
    gaps = []
    for n in (10, 20):
        loads = np.linspace(0.0, 0.6, n + 1)[1:]
        path = equilibria(two_chambers, fresh, tuple(loads), EXACT)
        work, stored = work_and_energy(two_chambers, fresh, loads, path, energies)
        assert stored > 0.0
        gaps.append((work - stored) / stored)
    assert abs(gaps[0]) < 2e-3
    assert gaps[0] / gaps[1] == pytest.approx(4.0, abs=0.1)
    assert abs((4.0 * gaps[1] - gaps[0]) / 3.0) < 1e-5


def test_energy_is_least_at_equilibrium(
    one_chamber, fresh, equilibria, solid_energy, paper_energy, enclosed_volume
):
    mesh, load = one_chamber.mesh, 0.5
    u = equilibria(one_chamber, fresh, (load,), EXACT).states[0].displacement

    def potential(w):
        stored = solid_energy(one_chamber, w, fresh) + paper_energy(mesh, w, fresh)
        return stored - load * enclosed_volume(mesh, mesh.nodes + w)

    rng = np.random.default_rng(3)
    for _ in range(5):
        v = one_chamber.expand(rng.standard_normal(len(one_chamber.free)))
        assert potential(u + 1e-3 * v) > potential(u)


def test_stiffer_material_and_lower_pressure_bend_less(two_chambers, fresh, equilibria):
    stiffer = Material(fresh.c2_ratio, 10.0 * fresh.c3_ratio, fresh.paper_group)
    soft, hard = (
        [
            read_state(two_chambers.mesh, s).curvature
            for s in equilibria(two_chambers, m, loads).states
        ]
        for m in (fresh, stiffer)
        for loads in [(0.3, 0.6, 0.9)]
    )
    assert all(a < b for a, b in pairwise([0.0, *soft]))
    assert all(h < s for h, s in zip(hard, soft, strict=True))


BALLOONING = Material(c2_ratio=-0.05, c3_ratio=0.001, paper_group=100.0)


@pytest.fixture(scope="module")
def ballooned(thin_walled, equilibria):
    return equilibria(thin_walled, BALLOONING, (0.1, 0.2, 0.3, 0.4, 0.5))


def test_ballooning_is_a_status_and_the_loads_below_are_answered(ballooned):
    assert ballooned.status is Status.LIMIT_POINT
    assert len(ballooned.states) == 3
    assert 0.3 < ballooned.limit_load < 0.4
    assert "balloons" in ballooned.status.advice


def test_limit_load_does_not_depend_on_the_loads_asked_for(thin_walled, ballooned, equilibria):
    limit = ballooned.limit_load
    below = equilibria(thin_walled, BALLOONING, (0.5 * limit, 0.8 * limit, 0.97 * limit))
    assert below.status is Status.CONVERGED
    beyond = equilibria(thin_walled, BALLOONING, (0.4 * limit, 0.7 * limit, 1.03 * limit))
    assert beyond.status is Status.LIMIT_POINT
    assert len(beyond.states) == 2
    assert beyond.limit_load == pytest.approx(limit, rel=0.03)


def test_tangent_grows_singular_towards_the_limit_point(thin_walled, ballooned, equilibria):
    """The growth of the cavity with pressure diverges as one over the root of what is left."""
    limit, growth = ballooned.limit_load, []
    solver = open_factorization(thin_walled.upper)
    for share in (0.5, 0.9, 0.97):
        state = equilibria(thin_walled, BALLOONING, (0.5 * share * limit, share * limit)).states[-1]
        solver.factorize(thin_walled.linearise(state, BALLOONING).tangent)
        force = thin_walled.cavity_force(state)
        growth.append(force @ solver.solve(force))
    solver.close()
    assert growth[0] < growth[1] < growth[2]
    assert growth[2] > 3.0 * growth[0]


def test_tangent_beyond_the_limit_is_not_definite(thin_walled, ballooned):
    """Blown up along the path's last direction, the thin-walled actuator is no longer stable."""
    before, last = ballooned.states[-2:]
    direction = last.displacement - before.displacement
    solver = open_factorization(thin_walled.upper)
    refused = False
    for share in (1.0, 2.0, 3.0, 4.0):
        state = last.moved(share * direction, 0.0 * last.pressure, load=0.1)
        lin = thin_walled.linearise(state, BALLOONING)
        try:
            solver.factorize(lin.tangent)
        except LostDefinitenessError:
            refused = True
    solver.close()
    assert refused


@pytest.mark.parametrize(
    "material",
    [
        Material(c2_ratio=-0.2, c3_ratio=0.01, paper_group=100.0),
        Material(c2_ratio=-0.01, c3_ratio=0.0, paper_group=100.0),
        Material(c2_ratio=0.1, c3_ratio=-0.01, paper_group=100.0),
        Material(c2_ratio=float("nan"), c3_ratio=0.01, paper_group=100.0),
    ],
)
def test_unstable_constants_are_a_status(one_chamber, equilibria, material):
    path = equilibria(one_chamber, material, (0.1,))
    assert path.status is Status.UNSTABLE_MATERIAL
    assert path.states == ()


@pytest.mark.parametrize("total", [1, 4, 7])
def test_exhausted_effort_is_a_status_that_keeps_what_was_reached(
    two_chambers, fresh, equilibria, total
):
    loads = tuple(np.linspace(0.1, 1.0, 10))
    path = equilibria(two_chambers, fresh, loads, Effort(total=total))
    assert path.status is Status.EFFORT_EXHAUSTED
    assert len(path.states) < 10
    assert path.iterations <= total + Effort().iterations
    assert tuple(state.load for state in path.states) == loads[: len(path.states)]


def test_too_few_iterations_end_the_path_without_an_exception(two_chambers, fresh, equilibria):
    path = equilibria(two_chambers, fresh, (5.0,), Effort(tolerance=1e-14, iterations=1))
    assert path.status is not Status.CONVERGED
    assert path.states == ()


def test_no_load_needs_no_solution(two_chambers, fresh):
    path = follow(
        two_chambers, open_factorization(two_chambers.upper, "splu"), material=fresh, loads=()
    )
    assert path.status is Status.CONVERGED
    assert path.states == ()
    assert path.iterations == 0


@pytest.mark.parametrize("status", Status)
def test_every_status_has_advice(status):
    assert len(status.advice) > 10
