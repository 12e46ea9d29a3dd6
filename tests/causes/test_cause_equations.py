"""The equation of each cause, against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.causes.cause import Conditions, Degradation
from bayesdeg.causes.curvature_reading import trace_other_fibre
from bayesdeg.causes.degradation_misread import FRESH, misread
from bayesdeg.causes.degradation_scale import rescale
from bayesdeg.causes.gauge_gain import scale_pressure
from bayesdeg.causes.pressure_loss import lose_pressure
from bayesdeg.causes.pressure_offset import shift_pressure
from tests.surrogate.closed_form import trained

PRESSURE = np.array([[20.0, 40.0, 60.0, 80.0]])
CONDITIONS = Conditions(PRESSURE, np.array([[0.0]]))


def inputs_at(pressure, reference=None):
    one = np.ones((1, 1))
    return Inputs(pressure, 0.4 * one, 0 * one, 0.01 * one, 0.85 * one, 3e4 * one, reference)


def effect(**values):
    return {name: np.reshape(value, (-1, 1, 1)) for name, value in values.items()}


def curvature(pressure):
    """The curvature at true pressures."""
    return trained()(inputs_at(np.asarray(pressure, float))).curvature


@given(offset=st.floats(-40.0, 40.0))
@settings(deadline=None, max_examples=40)
def test_pressure_offset_reads_the_change_since_a_reading_of_zero(offset):
    shifted = trained()(shift_pressure(inputs_at(PRESSURE), CONDITIONS, effect(offset=offset)))
    true = [max(p - offset, 0.0) for p in PRESSURE[0]]
    at_zero = max(0.0 - offset, 0.0)
    want = curvature([true])[0] - curvature([[at_zero]])[0, 0]
    np.testing.assert_allclose(shifted.curvature[0, 0], want, rtol=1e-12, atol=1e-12)


def test_pressure_below_the_threshold_bends_nothing():
    late = trained()(shift_pressure(inputs_at(PRESSURE), CONDITIONS, effect(offset=50.0)))
    np.testing.assert_array_equal(late.curvature[0, 0, :2], 0.0)
    np.testing.assert_allclose(late.curvature[0, 0, 2:], curvature([[10.0, 30.0]])[0])
    np.testing.assert_array_equal(late.slope[0, 0, :2], 0.0)


def test_negative_offset_is_pressure_that_the_sensor_does_not_see():
    early = trained()(shift_pressure(inputs_at(PRESSURE), CONDITIONS, effect(offset=-10.0)))
    want = curvature(PRESSURE + 10.0) - curvature([[10.0]])
    np.testing.assert_allclose(early.curvature[0], want, rtol=1e-12)
    assert np.all(early.curvature > curvature(PRESSURE))  # the curve is convex


def test_pressure_offset_keeps_one_offset_a_walker():
    offsets = np.array([-10.0, 0.0, 5.0])
    shifted = shift_pressure(inputs_at(PRESSURE), CONDITIONS, effect(offset=offsets))
    np.testing.assert_array_equal(
        shifted.pressure[:, 0], np.maximum(PRESSURE - offsets[:, None], 0.0)
    )
    np.testing.assert_array_equal(shifted.reference_pressure[:, 0, 0], [10.0, 0.0, 0.0])


@given(fraction=st.floats(0.0, 0.9), pressure=st.floats(0.1, 500.0), reference=st.floats(0.0, 30.0))
@settings(max_examples=40)
def test_as_much_flows_through_the_tube_as_through_the_leak(fraction, pressure, reference):
    """A gas flows with the difference of the squares of absolute pressures."""
    read = inputs_at(np.array([pressure]), np.array([[reference]]))
    leaked = lose_pressure(read, CONDITIONS, effect(fraction=fraction))
    ends = ((pressure, leaked.pressure), (reference, leaked.reference_pressure))
    for before, behind in ends:
        supply, inside, outside = before + 101.325, behind.item() + 101.325, 101.325
        tube, leak = supply**2 - inside**2, inside**2 - outside**2
        assert (1.0 - fraction) * tube == pytest.approx(fraction * leak, rel=1e-6, abs=1e-6)


def test_a_small_pressure_loses_the_fraction_itself():
    leaked = lose_pressure(inputs_at(np.array([1e-3])), CONDITIONS, effect(fraction=0.2))
    assert leaked.pressure.item() == pytest.approx(0.8e-3, rel=1e-5)


def test_a_gauge_that_is_off_by_a_factor_cannot_be_told_from_stiffer_material():
    """κ depends on p/C1 alone if the paper is stiffened alike."""
    one = np.ones((1, 1))
    off = trained()(scale_pressure(inputs_at(PRESSURE), CONDITIONS, effect(gain=-0.2)))
    stiff = trained()(Inputs(PRESSURE, 0.5 * one, 0 * one, 0.0125 * one, 0.85 * one, 3.75e4 * one))
    np.testing.assert_allclose(off.curvature[0], stiff.curvature, rtol=1e-12)


def arc_points(radius, angle, count=200):
    """Points of an arc of a circle, evenly spaced."""
    t = np.linspace(0.0, angle, count)
    return radius * np.cos(t), radius * np.sin(t)


def traced_curvature(x, y):
    """Bend angle over arc length of a traced line: turning of its chords over their length."""
    dx, dy = np.diff(x), np.diff(y)
    heading = np.unwrap(np.arctan2(dy, dx))
    length = np.hypot(dx, dy)
    return (heading[-1] - heading[0]) / (np.sum(length) - 0.5 * (length[0] + length[-1]))


def reading_of(kappa):
    kappa = np.asarray(kappa, float)
    angle = 50e-3 * np.degrees(kappa)
    return Prediction(
        curvature=kappa,
        bend_angle=angle,
        peak_stretch=1 + 0 * kappa,
        slope=1.3 * kappa,
        sd=0.01 * kappa,
        bend_angle_sd=0.01 * angle,
        peak_stretch_sd=0 * kappa,
        status=0 * kappa,
    )


@given(
    kappa=st.floats(0.5, 80.0), height=st.floats(0.0, 15.0), magnification=st.floats(-0.05, 0.05)
)
def test_a_line_above_the_paper_is_a_concentric_arc(kappa, height, magnification):
    """The bottom line bends about a centre at 1/κ on the side of the paper; y lies further out."""
    read = trace_other_fibre(
        reading_of([[kappa]]),
        CONDITIONS,
        effect(fibre_height=height, magnification=magnification),
    )
    x, y = arc_points(1.0 / kappa + height * 1e-3, 1.0)
    # a picture whose lengths come out too short by 1 + m reads curvatures too large by it
    want = traced_curvature(x / (1.0 + magnification), y / (1.0 + magnification))
    assert read.curvature[0, 0, 0] == pytest.approx(want, rel=1e-5)


def test_the_factor_at_40_per_metre_is_that_of_the_published_table():
    read = trace_other_fibre(
        reading_of([[40.0]]),
        CONDITIONS,
        effect(fibre_height=[6.25, 8.33], magnification=[0.0, 0.0]),
    )
    np.testing.assert_allclose(read.curvature[:, 0, 0] / 40.0, [0.80, 0.75], atol=1e-3)


@given(kappa=st.floats(0.5, 80.0), height=st.floats(0.0, 15.0), m=st.floats(-0.05, 0.05))
def test_slope_and_error_of_a_traced_line_follow_the_chain_rule(kappa, height, m):
    h = 1e-6 * kappa
    values = effect(fibre_height=height, magnification=m)
    up, here, down = (
        trace_other_fibre(reading_of([[k]]), CONDITIONS, values)
        for k in (kappa + h, kappa, kappa - h)
    )
    derivative = (up.curvature - down.curvature) / (2.0 * h)
    np.testing.assert_allclose(here.slope, derivative * 1.3 * kappa, rtol=1e-6)
    np.testing.assert_allclose(here.sd, derivative * 0.01 * kappa, rtol=1e-6)


def test_a_traced_line_leaves_the_bend_angle():
    before = reading_of([[10.0, 40.0]])
    after = trace_other_fibre(before, CONDITIONS, effect(fibre_height=8.0, magnification=0.03))
    np.testing.assert_array_equal(after.bend_angle, before.bend_angle)
    np.testing.assert_array_equal(after.peak_stretch, before.peak_stretch)
    np.testing.assert_array_equal(after.status, before.status)


def test_misread_degradation_shifts_and_scatters_degraded_specimens_only():
    recorded = np.array([[0.0], [FRESH], [FRESH + 1e-9], [15.0]])
    state = misread(
        Degradation(recorded, np.full((4, 1), 0.6)),
        Conditions(PRESSURE, recorded),
        effect(shift=[3.0, -2.0], scatter=[0.8, 0.0]),
    )
    assert state.value.shape == (2, 4, 1)
    np.testing.assert_allclose(
        state.value[..., 0] - recorded[:, 0], [[0, 0, 3, 3], [0, 0, -2, -2]], atol=1e-12
    )
    np.testing.assert_allclose(
        state.sd[..., 0], [[0.6, 0.6, 1.0, 1.0], [0.6, 0.6, 0.6, 0.6]], rtol=1e-15
    )


def test_misread_judges_by_what_was_recorded_not_by_what_it_became():
    state = misread(
        Degradation(np.array([[30.0]]), np.array([[0.5]])),
        Conditions(PRESSURE, np.array([[0.0]])),
        effect(shift=3.0, scatter=1.0),
    )
    assert state.value.item() == 30.0
    assert state.sd.item() == 0.5


def test_rescaled_degradation_is_in_proportion_errors_too():
    recorded = np.array([[0.0], [5.0], [25.0]])
    state = rescale(
        Degradation(recorded, np.full((3, 1), 0.6)),
        Conditions(PRESSURE, recorded),
        effect(excess=[0.2, -0.5]),
    )
    np.testing.assert_allclose(state.value[..., 0], [[0.0, 6.0, 30.0], [0.0, 2.5, 12.5]])
    np.testing.assert_allclose(state.sd[..., 0], [[0.72] * 3, [0.3] * 3])


def test_rescaled_degradation_is_the_change_of_basis_of_moisture():
    """D/(1 − M_C) by dry mass for D by total mass: 25 → 29.4 at 20 % moisture."""
    wet = np.array([5.0, 25.0])
    content = 0.2 * (1.0 - wet / 100.0)
    dry = 100.0 * (1.0 - content / (1.0 - content) / 0.25)
    np.testing.assert_allclose(dry, wet / (1.0 - content))
    assert dry[-1] == pytest.approx(29.4, abs=0.05)
    back = rescale(
        Degradation(dry[:, None], np.zeros((2, 1))),
        Conditions(np.full((2, 1), 20.0), dry[:, None]),
        effect(excess=-0.16),
    )
    np.testing.assert_allclose(back.value[0, :, 0], wet, rtol=0.05)
