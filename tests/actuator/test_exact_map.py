"""The exact forward map: scaling law, order of pressures, statuses, reference pressure."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.actuator.status import Status
from bayesdeg.data.settings import Dimensions

pytestmark = pytest.mark.fem

COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
PRESSURES = np.array([20.0, 60.0, 120.0, 180.0])


@pytest.fixture(scope="module")
def forward():
    return ExactMap(Geometry(Dimensions(length=20.0, chambers=2)), COARSEST)


def inputs(pressure=PRESSURES, c1=0.288, ratios=(-0.02, 0.005), scale=0.843, paper=3e4):
    c1 = np.atleast_1d(np.asarray(c1, dtype=float))
    return Inputs(
        pressure=np.asarray(pressure, dtype=float),
        c1=c1,
        c2=ratios[0] * c1,
        c3=ratios[1] * c1,
        linear_scale=np.atleast_1d(float(scale)),
        paper_stiffness=np.atleast_1d(float(paper)),
    )


def agree(one, other, rtol=1e-10):
    for name in ("curvature", "bend_angle", "peak_stretch", "slope"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=rtol)


def test_only_ratios_of_stresses_matter(forward):
    base = forward(inputs())
    assert np.all(base.status == 0)
    assert np.all(base.curvature > 0.0)
    for factor in (0.3, 1.7, 11.0):
        agree(forward(inputs(factor * PRESSURES, c1=factor * 0.288, paper=factor * 3e4)), base)


def test_curvature_scales_with_one_over_the_size(forward):
    base = forward(inputs())
    for factor in (0.6, 1.3):
        # the paper bends as well, so its thickness shrinks along
        thickness = np.atleast_1d(0.1 * factor)
        scaled = forward(
            replace(inputs(scale=0.843 * factor, paper=3e4 * factor), paper_thickness=thickness)
        )
        np.testing.assert_allclose(scaled.curvature * factor, base.curvature, rtol=1e-10)
        np.testing.assert_allclose(scaled.slope * factor, base.slope, rtol=1e-10)
        np.testing.assert_allclose(scaled.bend_angle, base.bend_angle, rtol=1e-10)
        np.testing.assert_allclose(scaled.peak_stretch, base.peak_stretch, rtol=1e-10)


def test_scaled_model_agrees_with_scaled_geometry():
    """The law against a mesh that really has the other size."""
    small = Dimensions(length=14.0, chambers=1)
    factor = 0.7
    shrunk = Dimensions(
        **{
            name: value if name == "chambers" else factor * value
            for name, value in vars(small).items()
        }
    )
    at_scale = ExactMap(Geometry(small), COARSEST)(inputs(scale=factor))
    size = factor * 9.0
    as_built = ExactMap(Geometry(shrunk), Resolution(size, size, size))(inputs(scale=1.0))
    agree(at_scale, as_built, rtol=1e-9)


def test_every_group_matters(forward):
    highest = forward(inputs()).curvature[-1]  # where stiffening is felt most
    for other in (
        inputs(ratios=(0.02, 0.005)),
        inputs(ratios=(-0.02, 0.02)),
        inputs(paper=3e3),
        inputs(c1=0.3),
    ):
        assert abs(forward(other).curvature[-1] / highest - 1.0) > 1e-3


def test_bend_angle_is_curvature_times_arc_length(forward):
    answer = forward(inputs())
    arc = np.radians(answer.bend_angle) / answer.curvature * 1e3 / 0.843  # moulded [mm]
    assert np.all(np.abs(arc / 20.0 - 1.0) < 0.2)


def test_zero_pressure_is_exactly_straight(forward):
    for pressure in (np.zeros(1), np.zeros(3), np.array([0.0, 60.0])):
        answer = forward(inputs(pressure))
        assert answer.curvature[0] == 0.0
        assert answer.bend_angle[0] == 0.0
        assert answer.slope[0] == 0.0
        # rest is an equilibrium like any other, found to rounding error
        assert answer.peak_stretch[0] == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_array_equal(answer.status, 0)


def test_pressures_may_be_repeated_and_out_of_order(forward):
    order = np.array([2, 0, 3, 2, 1, 1, 0])
    straight, mixed = forward(inputs()), forward(inputs(PRESSURES[order]))
    for name in ("curvature", "bend_angle", "peak_stretch", "slope", "status"):
        np.testing.assert_array_equal(getattr(mixed, name), getattr(straight, name)[order])


def test_slope_is_the_derivative_by_the_logarithm_of_pressure(forward):
    fine = forward(inputs(np.linspace(5.0, 180.0, 36)))
    ahead, behind = (forward(inputs(120.0 * factor)) for factor in (1.001, 0.999))
    wanted = (ahead.curvature - behind.curvature) / 0.002
    at = np.searchsorted(np.linspace(5.0, 180.0, 36), 120.0)
    assert fine.slope[at] == pytest.approx(wanted[0], rel=2e-3)


def test_axes_before_the_pressure_are_separate_curves(forward):
    several = forward(inputs(c1=np.array([[0.288], [0.4]])))
    assert several.curvature.shape == (2, 4)
    for row, c1 in enumerate((0.288, 0.4)):
        one = forward(inputs(c1=c1))
        np.testing.assert_array_equal(several.curvature[row], one.curvature)


def test_an_executor_and_a_progress_call_change_nothing(forward):
    totals, calls = [], []
    with ThreadPoolExecutor(1) as executor:
        other = ExactMap(
            forward.geometry,
            forward.resolution,
            executor=executor,
            on_start=totals.append,
            on_curve=lambda: calls.append(1),
        )
        answer = other(inputs(c1=np.array([[0.288], [0.4]])))
    assert totals == [2]
    assert len(calls) == 2
    plain = forward(inputs(c1=np.array([[0.288], [0.4]])))
    np.testing.assert_array_equal(answer.curvature, plain.curvature)


def test_reference_pressure_is_taken_off(forward):
    plain, at = forward(inputs()), forward(inputs(np.array([15.0])))
    asked = replace(inputs(), reference_pressure=np.array([15.0]))
    relative = forward(asked)
    # the two paths take other steps, so they agree as far as Newton's method converged
    np.testing.assert_allclose(relative.curvature, plain.curvature - at.curvature, rtol=1e-12)
    np.testing.assert_allclose(relative.bend_angle, plain.bend_angle - at.bend_angle, rtol=1e-12)
    np.testing.assert_array_equal(relative.peak_stretch, plain.peak_stretch)


def test_reference_at_rest_changes_nothing(forward):
    answer = forward(replace(inputs(), reference_pressure=np.zeros(1)))
    np.testing.assert_array_equal(answer.curvature, forward(inputs()).curvature)
    np.testing.assert_array_equal(answer.status, 0)


def test_readings_in_several_mounts_are_those_of_a_path_in_each(forward):
    """Weight along, none, and along again: two paths, put where their readings stand."""
    weight = np.array([100.0, 0.0, 0.0, 100.0])  # kN/m³, as of nine times the material
    answer = forward(replace(inputs(), weight_along=weight))
    still = forward(inputs())
    hanging = forward(replace(inputs(), weight_along=np.full(4, 100.0)))
    for name in ("curvature", "bend_angle", "peak_stretch", "slope"):
        wanted = np.where(weight > 0.0, getattr(hanging, name), getattr(still, name))
        # a path with fewer loads takes other steps, and Newton stops a little elsewhere
        np.testing.assert_allclose(getattr(answer, name), wanted, rtol=5e-6)
    assert np.all(np.abs(hanging.curvature / still.curvature - 1.0) > 1e-4)


@pytest.mark.parametrize("c1", [-0.288, 0.0, float("nan")])
def test_modulus_that_is_not_positive_is_an_invalid_input(forward, c1):
    c1 = np.array([c1])
    bad = replace(inputs(np.array([0.0, 60.0])), c1=c1, c2=-0.01 + 0 * c1, c3=0.002 + 0 * c1)
    answer = forward(bad)
    np.testing.assert_array_equal(answer.status, int(Status.INVALID_INPUT))
    assert np.all(np.isnan(answer.curvature))


@pytest.mark.parametrize("ratios", [(-0.2, 0.01), (0.1, -0.01), (-0.01, 0.0)])
def test_unstable_constants_are_a_status(forward, ratios):
    answer = forward(inputs(ratios=ratios))
    np.testing.assert_array_equal(answer.status, int(Status.UNSTABLE_MATERIAL))
    assert np.all(np.isnan(answer.curvature))


def test_beyond_the_limit_point_the_answer_is_nan_with_a_status(thin_walled):
    forward = ExactMap(thin_walled.mesh.geometry, COARSEST)
    pressures = np.array([120.0, 0.0, 30.0, 200.0, 60.0])
    answer = forward(inputs(pressures, ratios=(-0.05, 0.001)))
    beyond = pressures > 100.0  # the limit point is near 95 kPa
    np.testing.assert_array_equal(
        answer.status, np.where(beyond, int(Status.LIMIT_POINT), int(Status.CONVERGED))
    )
    for name in ("curvature", "bend_angle", "peak_stretch", "slope"):
        np.testing.assert_array_equal(np.isnan(getattr(answer, name)), beyond)
