"""The load path: equilibrium, steps, statuses in place of exceptions."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.status import PathEffort, Status

pytestmark = pytest.mark.fem

EXACT = PathEffort(tolerance=1e-9, iterations=12, rate_tolerance=1e-9, exact=True)


def test_states_stand_at_the_loads_and_in_equilibrium(two_chambers, fresh, equilibria):
    loads = (0.1, 0.35, 0.5)
    path = equilibria(two_chambers, fresh, loads, EXACT)
    assert path.status is Status.CONVERGED
    assert path.limit_load == np.inf
    assert tuple(state.load for state in path.states) == loads
    problem, fixed = Problem(two_chambers.system, fresh), two_chambers.mesh.body.fixed
    for state in path.states:
        lin = problem.linearise(state)
        force = state.load * problem.cavity_gradient(state)
        assert np.linalg.norm(lin.residual) < 1e-8 * np.linalg.norm(force)
        assert np.abs(lin.volume_residual).max() < 1e-10
        np.testing.assert_array_equal(state.displacement[fixed], 0.0)


def test_equilibrium_does_not_depend_on_the_steps(two_chambers, fresh, equilibria):
    few = equilibria(two_chambers, fresh, (0.3, 0.6), EXACT)
    many = equilibria(two_chambers, fresh, tuple(np.linspace(0.05, 0.6, 12)), EXACT)
    np.testing.assert_allclose(few.states[-1].displacement, many.states[-1].displacement, atol=1e-9)


def test_default_effort_is_accurate_enough(two_chambers, fresh, equilibria):
    loads = tuple(np.linspace(0.1, 0.8, 8))
    efforts = (PathEffort(exact=True), EXACT)
    default, exact = (equilibria(two_chambers, fresh, loads, e) for e in efforts)
    errors = []
    for a, b in zip(default.states, exact.states, strict=True):
        one, other = (read_state(two_chambers.mesh, state).curvature for state in (a, b))
        errors.append(abs(one / other - 1.0))
    print(f"curvature off by {max(errors):.1e}, {default.iterations} factorizations")
    assert max(errors) < 1e-5
    assert default.iterations <= 2.5 * len(loads) + 1


def test_many_loads_cost_no_more_than_the_course_of_the_path(two_chambers, fresh, equilibria):
    few, many = (
        equilibria(two_chambers, fresh, tuple(np.linspace(0.0, 0.8, n + 1)[1:])).iterations
        for n in (2, 40)
    )
    assert many == few


def test_small_pressure_bends_in_proportion(two_chambers, fresh, equilibria):
    first, second = (
        read_state(two_chambers.mesh, state).bend_angle
        for state in equilibria(two_chambers, fresh, (1e-5, 2e-5), EXACT).states
    )
    assert first > 0.0
    assert second == pytest.approx(2.0 * first, rel=1e-3)


@pytest.mark.parametrize("exact", [False, True])
def test_neighbouring_loads_cost_few_extra_iterations(two_chambers, fresh, equilibria, exact):
    effort = PathEffort(exact=exact)
    apart = equilibria(two_chambers, fresh, (0.2, 0.4, 0.6), effort)
    together = equilibria(two_chambers, fresh, (0.2, 0.4, 0.4 * (1.0 + 1e-10), 0.6), effort)
    assert together.status is Status.CONVERGED
    assert together.iterations <= apart.iterations + 6
    np.testing.assert_allclose(
        together.states[-1].displacement, apart.states[-1].displacement, atol=1e-4
    )


def test_stiffer_material_and_lower_pressure_bend_less(two_chambers, fresh, equilibria):
    stiffer = replace(fresh, c3_ratio=10.0 * fresh.c3_ratio)
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


@pytest.mark.parametrize(
    "material",
    [
        MaterialGroups(c2_ratio=-0.2, c3_ratio=0.01, paper_group=100.0),
        MaterialGroups(c2_ratio=-0.01, c3_ratio=0.0, paper_group=100.0),
        MaterialGroups(c2_ratio=0.1, c3_ratio=-0.01, paper_group=100.0),
        MaterialGroups(c2_ratio=float("nan"), c3_ratio=0.01, paper_group=100.0),
        MaterialGroups(c2_ratio=0.0, c3_ratio=0.01, paper_group=100.0, second_invariant_ratio=-0.1),
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
    path = equilibria(two_chambers, fresh, loads, PathEffort(total=total, exact=True))
    assert path.status is Status.EFFORT_EXHAUSTED
    assert len(path.states) < 10
    assert path.iterations <= total + PathEffort().iterations
    assert tuple(state.load for state in path.states) == loads[: len(path.states)]


def test_too_few_iterations_end_the_path_without_an_exception(two_chambers, fresh, equilibria):
    path = equilibria(two_chambers, fresh, (5.0,), PathEffort(tolerance=1e-14, iterations=1))
    assert path.status is not Status.CONVERGED
    assert path.states == ()


def test_no_load_needs_no_solution_beyond_rest(two_chambers, fresh):
    solver = open_factorization(two_chambers.system.upper, "splu")
    path = follow(Problem(two_chambers.system, fresh), solver, loads=())
    assert path.status is Status.CONVERGED
    assert path.states == ()
    # rest is found like any equilibrium, since its rate by the load is wanted
    assert path.iterations == 1
    np.testing.assert_allclose(path.rest.state.displacement, 0.0, atol=1e-12)


@pytest.mark.parametrize("status", Status)
def test_every_status_has_advice(status):
    assert len(status.advice) > 10


def test_a_path_is_parted_into_as_many_steps_as_are_asked_for(two_chambers, fresh):
    """Paths that need few steps are all that tells of a stiff part."""
    loads, count = (0.01, 0.02), {}
    for steps in (1, 3, 5):
        found = two_chambers.sample(Curve(loads, fresh), effort=PathEffort(steps=steps))
        assert found.status is Status.CONVERGED
        assert found.loads[-1] == loads[-1]
        assert np.max(np.diff(found.loads)) <= loads[-1] / steps * (1.0 + 1e-9)
        count[steps] = len(found.loads) - 1
    assert count[1] < 3 <= count[3] < count[5]
