"""Curvature of the default actuator against a separate implementation of the same model.

The reference is a prototype of the same equations on meshes of 304, 968 and 2224 elements; the
finest is itself not converged at 240 kPa. Its paper is a membrane; here the paper of 0.1 mm bends
as well, which one of the tests below shows to be within these tolerances.
"""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.data.settings import Dimensions

pytestmark = [pytest.mark.fem, pytest.mark.slow]

PRESSURES = np.arange(20.0, 250.0, 20.0)
TABLE = np.searchsorted(PRESSURES, [20.0, 60.0, 120.0, 180.0, 240.0])
COARSE, MEDIUM = Resolution(2.5, 2.5, 2.1), Resolution(2.0, 1.4, 2.1)
FRESH, DEGRADED = (0.288, -0.004, 0.0012), (1.588, -0.149, 0.1175)
WITH_304 = np.array([2.233, 6.883, 14.67, 24.32, 38.67])
WITH_968 = np.array([2.169, 6.761, 14.60, 24.47, 39.30])
WITH_2224 = np.array([2.161, 6.757, 14.66, 24.75, 40.09])


def solve(resolution, constants, thickness=None):
    c1, c2, c3 = (np.array([c]) for c in constants)
    inputs = Inputs(PRESSURES, c1, c2, c3, np.array([0.843]), np.array([3e4]))
    if thickness is not None:
        inputs = replace(inputs, paper_thickness=np.array([thickness]))
    answer = ExactMap(Geometry(Dimensions()), resolution)(inputs)
    print(f"{resolution}: {np.round(answer.curvature[TABLE], 4)} 1/m at 20, 60, 120, 180, 240 kPa")
    return answer


@pytest.fixture(scope="module")
def coarse_fresh():
    return solve(COARSE, FRESH)


def test_fresh_actuator_on_the_coarse_mesh(coarse_fresh):
    curvature = coarse_fresh.curvature[TABLE]
    np.testing.assert_allclose(curvature, WITH_304, rtol=0.015)
    np.testing.assert_allclose(curvature[:-1], WITH_2224[:-1], rtol=0.03)


def test_bending_of_the_paper_changes_the_curvature_by_little(coarse_fresh):
    """A paper that stretches only, as the prototype's, against one of 0.1 mm."""
    membrane = solve(COARSE, FRESH, thickness=0.0).curvature
    share = coarse_fresh.curvature / membrane - 1.0
    print("bending changes the curvature by", np.round(100.0 * share, 3), "%")
    assert np.all(share < 0.0)
    assert np.all(np.abs(share) < 0.005)


def test_fresh_actuator_turns_by_a_right_angle_at_the_highest_pressure(coarse_fresh):
    assert coarse_fresh.bend_angle[-1] == pytest.approx(93.0, abs=2.0)


def test_fresh_actuator_on_the_medium_mesh():
    answer = solve(MEDIUM, FRESH)
    np.testing.assert_array_equal(answer.status, 0)
    np.testing.assert_allclose(answer.curvature[TABLE], WITH_968, rtol=0.03)
    np.testing.assert_allclose(answer.curvature[TABLE], WITH_2224, rtol=0.03)


@pytest.mark.parametrize(("resolution", "rtol"), [(COARSE, 0.03), (MEDIUM, 0.015)])
def test_degraded_actuator(resolution, rtol):
    answer = solve(resolution, DEGRADED)
    assert answer.curvature[-1] == pytest.approx(4.939, rel=rtol)
    assert answer.bend_angle[-1] == pytest.approx(12.0, abs=0.5)
    assert 1.05 < answer.peak_stretch[-1] < 1.11  # 99 % of the volume stays below
