"""Loads between the steps of the path: interpolated against equilibria found at every load."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.status import PathEffort, Status
from bayesdeg.data.settings import Dimensions

pytestmark = pytest.mark.fem

# as tight as the rates allow with steps of a usual length
EXACT = PathEffort(tolerance=1e-5, iterations=12, rate_tolerance=1e-7, exact=True)
LOADS = tuple(np.linspace(0.0, 0.83, 12)[1:])


def relative_errors(dense, exact):
    curvature, wanted = (s.bend_angle / s.arc_length for s in (dense, exact))
    readings = np.abs(dense.readings - exact.readings).max(axis=0) / exact.readings.max(axis=0)
    rates = np.abs(dense.rates - exact.rates).max(axis=0) / np.abs(exact.rates).max(axis=0)
    return np.abs(curvature / wanted - 1.0), readings, rates


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["fresh", "every effect but slack"])
def test_interpolated_curve_of_the_default_actuator_is_that_of_exact_equilibria(
    name, fresh, every_effect
):
    actuator = Actuator(build_mesh(Geometry(Dimensions()), COARSE))
    curve = Curve(LOADS, fresh if name == "fresh" else replace(every_effect, paper_slack=0.0))
    dense, exact = actuator.solve(curve), actuator.solve(curve, effort=EXACT)
    assert dense.status is exact.status is Status.CONVERGED
    curvature, readings, rates = relative_errors(dense, exact)
    print(
        f"{name}: curvature within {curvature.max():.1e}, all readings within"
        f" {readings.max():.1e}, rates of {dict(zip(OUTPUTS, rates.round(5), strict=True))};"
        f" {dense.iterations} factorizations against {exact.iterations}"
    )
    assert curvature.max() < 1e-4
    assert readings.max() < 1e-4
    assert dense.iterations < exact.iterations


def test_interpolation_keeps_the_promised_displacement_on_a_short_actuator(
    two_chambers, fresh, equilibria
):
    """The tolerance is of the body's size, so little bending is known less well in proportion."""
    dense, exact = (equilibria(two_chambers, fresh, LOADS, e) for e in (None, EXACT))
    errors = [
        np.abs(a.displacement - b.displacement).max()
        for a, b in zip(dense.states, exact.states, strict=True)
    ]
    allowed = PathEffort().tolerance * 20.0
    print(f"displacement within {max(errors):.1e} mm of {allowed:.1e} mm allowed")
    assert max(errors) < allowed


def test_ends_of_steps_are_equilibria_and_loads_between_them_fit_smoothly(two_chambers, equilibria):
    material = MaterialGroups(0.02, 0.01, 50.0)
    loads = tuple(np.linspace(0.0, 0.8, 401)[1:])
    path = equilibria(two_chambers, material, loads)
    tip = np.array([s.displacement[two_chambers.mesh.bottom_line[-1], 2] for s in path.states])
    rate = np.array(
        [p.rate.displacement[two_chambers.mesh.bottom_line[-1], 2] for p in path.points]
    )
    # the rate handed out is the slope of what is handed out, across the joints of polynomials too
    slope = np.gradient(tip, np.array(loads))[2:-2]
    np.testing.assert_allclose(slope, rate[2:-2], rtol=2e-3, atol=1e-3 * np.abs(rate).max())


@pytest.mark.parametrize(
    ("paper", "slack"), [(30.0, 0.001), (30.0, 0.01), (100.0, 0.001), (300.0, 0.001), (300.0, 0.01)]
)
def test_a_stiff_paper_that_is_just_taken_up_is_followed_at_default_effort(
    two_chambers, paper, slack
):
    material = MaterialGroups(0.0, 0.01, paper, paper_thickness=0.1, paper_slack=slack)
    assert two_chambers.solve(Curve((0.2, 0.4, 0.6), material)).status is Status.CONVERGED


def test_where_it_cannot_be_followed_a_status_says_so_after_a_bounded_effort(two_chambers):
    """Stiff paper taken up in compression is next to buckling, which ends the path early."""
    material = MaterialGroups(0.0, 0.01, 300.0, paper_thickness=0.1, paper_slack=0.003)
    solution = two_chambers.solve(Curve((0.2, 0.4, 0.6), material))
    assert solution.status in (Status.CONVERGED, Status.BUCKLED, Status.EFFORT_EXHAUSTED)
    assert solution.iterations < 500
