"""Ballooning: where it begins, how well that is known, and that nothing raises or runs on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import LostDefinitenessError, open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import PathEffort, Status
from bayesdeg.data.settings import Dimensions

pytestmark = pytest.mark.fem

BALLOONING = MaterialGroups(c2_ratio=-0.05, c3_ratio=0.001, paper_group=100.0)
CLOSE = PathEffort(tolerance=1e-5, iterations=12)


@pytest.fixture(scope="module")
def ballooned(thin_walled, equilibria):
    return equilibria(thin_walled, BALLOONING, (0.1, 0.2, 0.3, 0.4, 0.5))


def test_ballooning_is_a_status_and_the_loads_below_are_answered(ballooned):
    print(f"limit load {ballooned.limit_load:.5f}, {ballooned.iterations} factorizations")
    assert ballooned.status is Status.LIMIT_POINT
    assert len(ballooned.states) == 3
    assert 0.3 < ballooned.limit_load < 0.4
    assert "balloons" in ballooned.status.advice


def test_limit_load_is_bracketed_by_solutions_under_pressure_control(
    thin_walled, ballooned, equilibria
):
    limit = ballooned.limit_load
    below = equilibria(thin_walled, BALLOONING, (0.999 * limit,), CLOSE)
    assert below.status is Status.CONVERGED
    beyond = equilibria(thin_walled, BALLOONING, (1.001 * limit,), CLOSE)
    assert beyond.status is Status.LIMIT_POINT
    assert beyond.states == ()


def test_limit_load_does_not_depend_on_the_loads_asked_for(thin_walled, ballooned, equilibria):
    limit = ballooned.limit_load
    found = [
        equilibria(thin_walled, BALLOONING, tuple(share * limit for share in shares)).limit_load
        for shares in ((0.4, 0.7, 1.03), (1.5,), (0.99, 3.0))
    ]
    print("limit loads over the first:", np.array(found) / limit)
    np.testing.assert_allclose(found, limit, rtol=5e-4)


def test_limit_load_is_the_same_with_either_solver(thin_walled, ballooned, path_of):
    """The solver that was chosen is also the one that looks for the limit."""
    pytest.importorskip("pypardiso")
    problem = Problem(thin_walled.system, BALLOONING)
    other = path_of(problem, (0.1, 0.2, 0.3, 0.4, 0.5), solver="splu")
    print(f"pypardiso {ballooned.limit_load:.10f}, splu {other.limit_load:.10f}")
    assert other.status is Status.LIMIT_POINT
    assert other.limit_load == pytest.approx(ballooned.limit_load, rel=1e-6)


@pytest.mark.parametrize("wall", [1.0, 1.2])
def test_thin_walls_of_the_default_layout_balloon(wall, fresh):
    """Walls of 1 mm on a mesh too coarse to trust, but thinner walls must balloon earlier."""
    limits = {}
    for thickness in (wall, 0.8 * wall):
        actuator = _thin(thickness)
        loads = tuple(np.linspace(0.1, 3.0, 12))
        solution = actuator.solve(Curve(loads, replace(fresh, c2_ratio=-0.04, c3_ratio=0.001)))
        assert solution.status is Status.LIMIT_POINT
        assert len(solution.readings) == np.sum(np.array(loads) < solution.limit_load)
        limits[thickness] = solution.limit_load
    print(limits)
    assert limits[0.8 * wall] < limits[wall]


def _thin(wall):
    dimensions = Dimensions(
        length=20.0, chambers=2, roof=wall, side_wall=wall, chamber_wall=wall, end_wall=wall
    )
    return Actuator(build_mesh(Geometry(dimensions), Resolution(9.0, 9.0, 9.0)))


def test_tangent_grows_singular_towards_the_limit_point(thin_walled, ballooned, equilibria):
    """The growth of the cavity with pressure diverges as one over the root of what is left."""
    limit, growth = ballooned.limit_load, []
    problem = Problem(thin_walled.system, BALLOONING)
    solver = open_factorization(thin_walled.system.upper)
    shares = np.array([0.98, 0.995, 0.999])
    for share in shares:
        state = equilibria(thin_walled, BALLOONING, (share * limit,), CLOSE).states[-1]
        solver.factorize(problem.linearise(state).tangent)
        force = problem.system.on_free(problem.cavity_gradient(state))
        growth.append(force @ solver.solve(force))
    solver.close()
    orders = np.diff(np.log(growth)) / np.diff(np.log(1.0 - shares))
    print("growth", growth, "as a power of what is left", orders)
    assert growth[0] < growth[1] < growth[2]
    np.testing.assert_allclose(orders, -0.5, atol=0.08)


def test_tangent_beyond_the_limit_is_not_definite(thin_walled, ballooned):
    """Blown up along the path's last direction, the thin-walled actuator is no longer stable."""
    before, last = ballooned.states[-2:]
    direction = last.displacement - before.displacement
    problem = Problem(thin_walled.system, BALLOONING)
    solver = open_factorization(thin_walled.system.upper)
    refused = False
    for share in (1.0, 2.0, 3.0, 4.0):
        state = last.moved(share * direction, 0.0 * last.pressure, load=0.1)
        try:
            solver.factorize(problem.linearise(state).tangent)
        except LostDefinitenessError:
            refused = True
    solver.close()
    assert refused


BEYOND = PathEffort(tolerance=1e-4, beyond=0.3)


def followed(actuator, **changes):
    """Return p/C1 and the volume at equilibria through the limit point, with all derivatives."""
    curve = Curve((1.0,), replace(BALLOONING, **changes))
    found = actuator.sample(curve, effort=BEYOND)
    at = OUTPUTS.index("cavity_volume")
    return found, found.readings[:, at], found.gradients[:, at]


def test_a_path_by_volume_passes_the_limit_point(thin_walled, ballooned):
    found, volume, by_inputs = followed(thin_walled)
    top = int(np.argmax(found.loads))
    print(f"{len(volume)} equilibria, {found.iterations} factorizations, the largest at {top}")
    assert found.status is Status.LIMIT_POINT
    assert found.limit_load == pytest.approx(ballooned.limit_load, rel=1e-4)
    assert found.loads[top] <= found.limit_load
    assert np.all(np.diff(volume) > 0.0)
    assert np.all(np.diff(found.loads[: top + 1]) > 0.0)
    assert np.all(np.diff(found.loads[top:]) < 0.0)
    assert found.loads[-1] < 0.99 * found.limit_load or volume[-1] > 1.25 * volume[top]
    # d(volume)/d(load) has the sign of the path
    assert np.all((by_inputs[:, 0] > 0.0) == (np.arange(len(volume)) <= top))


@pytest.mark.parametrize("name", ["c2_ratio", "wall_factor"])
def test_at_a_volume_derivatives_are_finite_through_the_limit_point(name, thin_walled):
    """Those at a load diverge there; dp/dm at a volume is −(∂V/∂m)/(∂V/∂p)."""
    found, volume, by_inputs = followed(thin_walled)
    found_rate = -by_inputs[1:, INPUTS.index(name)] / by_inputs[1:, 0]
    step = 4e-3 * abs(getattr(BALLOONING, name))
    loads = []
    for sign in (-1.0, 1.0):
        moved, there, rates = followed(
            thin_walled, **{name: getattr(BALLOONING, name) + sign * step}
        )
        known = np.column_stack([moved.loads, 1.0 / rates[:, 0]])
        between = BPoly.from_derivatives(there, known)
        loads.append(between(np.minimum(volume[1:], there[-1])))
    wanted = (loads[1] - loads[0]) / (2.0 * step)
    print(name, found_rate, wanted)
    # beyond, the curves between which differences are taken are interpolated over long steps
    near = np.arange(1, len(volume)) <= np.argmax(found.loads) + 1
    size = np.max(np.abs(wanted[near]))
    np.testing.assert_allclose(found_rate[near], wanted[near], atol=0.02 * size)


def wide_draws(count, seed):
    """Materials far beyond any prior: unstable, negative, not numbers, absurdly stiff or soft."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        c3 = float(rng.choice([0.0, -0.01, 1.0], p=[0.1, 0.1, 0.8]) * 10 ** rng.uniform(-5, 0))
        material = MaterialGroups(
            c2_ratio=float(rng.normal(0.0, 0.1)),
            c3_ratio=c3,
            paper_group=float(10 ** rng.uniform(-1, 5)),
            second_invariant_ratio=float(max(0.0, rng.normal(0.2, 0.5))),
            skin=float(rng.normal(0.0, 0.7)),
            paper_thickness=float(10 ** rng.uniform(-2, 0)),
            paper_slack=float(max(0.0, rng.normal(0.0, 0.02))),
            paper_mismatch=float(rng.normal(0.0, 0.03)),
            gravity_along=float(rng.normal(0.0, 1e-3)),
            gravity_up=float(rng.normal(0.0, 1e-3)),
            wall_factor=float(rng.uniform(0.3, 1.2)),
            erosion=float(rng.uniform(0.0, 0.4)),
        )
        spoilt = ("c2_ratio", "paper_group", "skin", "gravity_up", "wall_factor", "erosion")
        if i % 6 == 0:
            wrong = float(rng.choice([np.nan, np.inf, -1.0]))
            material = replace(material, **{spoilt[i // 6 % 6]: wrong})
        yield material, tuple(np.cumsum(10 ** rng.uniform(-3, 0.3, size=3)))


@pytest.mark.slow
def test_any_draw_ends_in_a_status_within_bounded_effort(one_chamber):
    effort, seen, most = PathEffort(total=40), {}, 0
    for material, loads in wide_draws(50, 7):
        solution = one_chamber.solve(Curve(loads, material), effort=effort)
        seen[solution.status] = seen.get(solution.status, 0) + 1
        most = max(most, solution.iterations)
        # the climb and the search of the limit may each spend the total and one more trial
        assert solution.iterations <= 3 * (effort.total + 12)
        reached = len(solution.readings)
        assert np.all(np.isfinite(solution.readings))
        assert np.all(np.isfinite(solution.rates))
        assert reached <= len(loads)
        assert (solution.status is Status.CONVERGED) == (reached == len(loads))
        if solution.status is Status.LIMIT_POINT:
            assert solution.limit_load > 0.0
            assert reached == np.sum(np.array(loads) < solution.limit_load)
    print({status.name: n for status, n in seen.items()}, f"at most {most} factorizations")
    assert set(seen) >= {Status.CONVERGED, Status.UNSTABLE_MATERIAL, Status.INVALID_INPUT}
