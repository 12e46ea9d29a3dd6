"""What solved runs say of the map, against the closed form that made them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate.coordinates import SLACK, coordinates
from bayesdeg.surrogate.design import space_filling
from bayesdeg.surrogate.regression import FLOOR, LIMIT_MARGIN, STEEPEST, observe, reach
from bayesdeg.surrogate.scaling import GROUPS, NAMES, Place
from tests.surrogate.closed_form import LENGTH, SPAN, all_readings_at, sample, volume_at

CURVES = space_filling(SPAN, 24, seed=9)
MIXED = Place((0.1, -3.0, 5.0, 0.1, 0.4, 0.15, 0.02, 0.01, 2e-5, -1e-5, 0.9, 0.2))
BASE = Place((0.1, -3.0, 5.0, *(group.neutral for group in GROUPS[3:])))
STARTS = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)  # what strains are read as at rest
LOADS = (0.1, 0.2, 0.3, 0.4, 0.5)


def observed(curve, samples=None):
    return observe(curve, samples or sample(curve), span=SPAN, length=LENGTH)


def logarithms(q, values):
    """y of curvature, angle, strains and volume, by their definitions, at a load over M."""
    place = Place(tuple(float(v) for v in values))
    at = dict(zip(NAMES[1:], place.values, strict=True))
    loads = np.array([0.0, q * place.modulus])
    angle, arc, *strains = all_readings_at(loads, vars(place.material())).T
    offset = abs(at["paper_mismatch"]) + 60.0 * math.hypot(at["gravity_along"], at["gravity_up"])
    return np.log(
        [
            np.diff(angle / arc)[0] * LENGTH / q,
            np.diff(angle)[0] / q,
            *(
                (one[1] - at_rest) / (q + offset)
                for one, at_rest in zip(strains, STARTS, strict=True)
            ),
            np.diff(volume_at(loads, vars(place.material())))[0] / LENGTH**3 / q,
        ]
    )


@pytest.mark.parametrize("place", [BASE, MIXED], ids=["base", "mixed"])
def test_values_are_logarithms_of_changes_over_the_load(place):
    curve = Curve(tuple(place.modulus * q for q in LOADS), place.material())
    run = observed(curve)
    np.testing.assert_allclose(run.load, LOADS)
    for q, values in zip(LOADS, run.values, strict=True):
        np.testing.assert_allclose(values, logarithms(q, place.values), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("axis", range(len(NAMES)), ids=NAMES)
def test_gradients_are_differences_by_load_and_groups(axis):
    run = observed(Curve(tuple(MIXED.modulus * q for q in LOADS), MIXED.material()))
    for k, q in enumerate(LOADS):
        step = np.zeros(len(NAMES))
        step[axis] = 1e-5 * (q if axis == 0 else GROUPS[axis - 1].high - GROUPS[axis - 1].low)
        at = np.array([q, *MIXED.values])
        more, less = (logarithms(p[0], p[1:]) for p in (at + step, at - step))
        slope = (more - less) / (2.0 * step[axis])
        np.testing.assert_allclose(
            run.gradients[k, :, axis], slope, rtol=1e-5, atol=1e-6 * np.max(np.abs(slope)) + 1e-9
        )


def test_coordinates_are_those_of_load_and_groups():
    run = observed(Curve(LOADS, MIXED.material()))
    groups = [[q / MIXED.modulus, *MIXED.values] for q in LOADS]
    np.testing.assert_allclose(
        run.coordinates.points, coordinates(np.array(groups)).points, rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize("place", [BASE, MIXED], ids=["base", "mixed"])
def test_the_first_slope_is_the_limit_at_small_loads(place):
    run = observed(Curve(LOADS, place.material()))
    small = logarithms(1e-6, place.values)
    np.testing.assert_allclose(run.first[[0, 1, 9]], small[[0, 1, 9]], rtol=1e-4)
    # what strains at rest has no first slope of its own; and where nothing strains, all points are
    # alike, so that which a quantile lies between says nothing
    assert np.all(np.isnan(run.first[[2, 7, 8]]))
    assert np.all(np.isfinite(run.first[3:7]) == (place is BASE))


def test_weights_are_curvatures_over_the_largest_but_not_below_the_floor():
    run = observed(Curve((0.01, *LOADS), BASE.material()))
    curvature = run.load * np.exp(run.values[:, 0])
    np.testing.assert_allclose(run.weights, np.maximum(curvature / curvature[-1], FLOOR))
    assert run.weights[0] == FLOOR


def test_derivatives_by_slack_are_used_of_slack_paper_alone():
    tight, slack = (observed(Curve(LOADS, place.material())) for place in (BASE, MIXED))
    assert tight.tight
    assert np.flatnonzero(~tight.known).tolist() == [SLACK]
    assert np.all(slack.known)


def test_nothing_is_said_beyond_the_reach_or_the_range_of_the_warped_load():
    said = 0
    for curve in CURVES:
        run, far = observed(curve), reach(curve, sample(curve))
        if run is None:
            continue
        said += 1
        assert np.all(run.load <= far.load * (1.0 + 1e-9))
        assert np.all(run.coordinates.points[:, 0] <= 1.0 + 1e-9)
    assert said > 20


@pytest.mark.parametrize("place", [BASE, MIXED], ids=["base", "mixed"])
def test_between_equilibria_values_alone_are_said(place):
    every = tuple(place.modulus * q for q in LOADS)
    curve, whole = Curve(every, place.material()), sample(Curve(every, place.material()))
    few = [0, 1, 3, 5]
    solved = replace(
        whole,
        loads=whole.loads[few],
        readings=whole.readings[few],
        gradients=whole.gradients[few],
        between=whole.readings[1:],
    )
    run = observe(curve, solved, span=SPAN, length=LENGTH, between=True)
    expected = observed(curve)
    np.testing.assert_array_equal(run.load, expected.load)
    np.testing.assert_array_equal(run.values, expected.values)
    np.testing.assert_array_equal(run.solved, [True, False, True, False, True])
    np.testing.assert_array_equal(run.gradients[run.solved], expected.gradients[run.solved])
    assert np.all(np.isnan(run.gradients[~run.solved]))
    at_steps = observed(curve, solved)
    np.testing.assert_array_equal(at_steps.load, expected.load[run.solved])


def test_where_a_curve_falls_nothing_is_said_of_the_step_either():
    whole = path([0.1, 0.2, 0.3, 0.4, 0.5], [1.0, 1.0, 1.0, -1.0, 1.0])
    solved = replace(whole, between=np.repeat(whole.readings[1:], 2, axis=0))
    loads = np.sort(np.concatenate([Q, Q - 0.05]))
    run = observe(
        replace(CURVE, loads=tuple(loads.tolist())),
        solved,
        span=SPAN,
        length=LENGTH,
        steepest=1e3,
        between=True,
    )
    np.testing.assert_allclose(run.load, [0.05, 0.1, 0.15, 0.2, 0.25, 0.3])


def test_a_path_that_failed_at_once_says_nothing():
    whole = sample(Curve(LOADS, BASE.material()))
    assert observed(Curve(LOADS, BASE.material()), shortened(whole, 2)) is None


def shortened(samples, count):
    return replace(
        samples,
        loads=samples.loads[:count],
        readings=samples.readings[:count],
        gradients=samples.gradients[:count],
        status=Status.TIMED_OUT,
    )


def path(kappa, slope, *, limit=math.inf):
    """A path of these curvatures at ``LOADS``, with their derivatives by the load."""
    count = len(kappa) + 1
    readings = np.zeros((count, len(OUTPUTS)))
    gradients = np.zeros((count, len(OUTPUTS), len(INPUTS)))
    readings[1:, 0], readings[:, 1] = LENGTH * np.array(kappa), LENGTH
    gradients[1:, 0, 0] = LENGTH * np.array(slope)
    readings[:, OUTPUTS.index("peak_stretch")] = 1.0 + np.array([0.0, *LOADS])[:count]
    loads = np.array([0.0, *LOADS])[:count]
    return PathSamples(loads, readings, gradients, Status.CONVERGED, limit, 20, "closed form")


CURVE = Curve(LOADS, MaterialGroups(0.0, 0.05, 100.0))
Q = np.array(LOADS)


def power_law(exponent, count=5, *, limit=math.inf):
    q = Q[:count]
    return path(q**exponent, exponent * q ** (exponent - 1.0), limit=limit)


def test_a_smooth_curve_is_emulated_at_least_to_its_end():
    far = reach(CURVE, power_law(1.5))
    assert far.open
    assert far.load == LOADS[-1]
    assert far.groups.tolist() == list(Place.of(CURVE.material).values)


def test_a_curve_is_emulated_to_shortly_before_its_limit_point():
    far = reach(CURVE, power_law(1.5, 3, limit=0.35))
    assert not far.open
    assert far.load == pytest.approx(LIMIT_MARGIN * 0.35)


def test_a_curve_is_emulated_to_where_it_gets_too_steep():
    """ln κ = 9 q: d ln κ / d ln q = 9 q passes the steepest between two loads."""
    far = reach(CURVE, path(np.exp(9.0 * Q), 9.0 * np.exp(9.0 * Q)))
    assert 9.0 * Q[2] < STEEPEST < 9.0 * Q[3]
    assert not far.open
    assert far.load == pytest.approx(STEEPEST / 9.0, rel=0.02)


def test_a_curve_too_steep_from_its_start_is_emulated_no_further_than_its_first_load():
    far = reach(CURVE, power_law(5.0))
    assert not far.open
    assert far.load <= LOADS[0]


@pytest.mark.parametrize("lost", [0.09, 0.15, 0.41])
def test_a_curve_that_hardly_bends_at_first_or_the_other_way_does_not_end_there(lost):
    """κ = q − lost: its growth q/κ is large or unknown at first, and then falls, if it goes on."""
    far = reach(CURVE, path(Q - lost, np.ones(5)))
    assert not 0.0 < Q[0] / (Q[0] - lost) < STEEPEST
    assert far.open
    assert far.load == LOADS[-1]


def test_a_curve_that_is_steep_and_then_falls_ends_at_its_first_load():
    slope = np.where(Q < 0.15, 50.0, -1.0)
    far = reach(CURVE, path(1.0 - Q, slope))
    assert not far.open
    assert far.load == LOADS[0]


def test_a_curve_that_falls_is_emulated_to_where_it_does():
    kappa, slope = Q.copy(), np.ones(5)
    kappa[3:], slope[3:] = [0.2, 0.1], -1.0
    assert reach(CURVE, path(kappa, slope)).load == LOADS[2]


def test_a_curve_that_failed_at_once_is_not_emulated():
    far = reach(CURVE, power_law(1.5, 1, limit=0.15))
    assert far.load == 0.0
    assert not far.open


def test_a_reach_is_in_the_unit_of_the_modulus_at_rest():
    plain, second = (
        reach(replace(CURVE, material=replace(CURVE.material, second_invariant_ratio=r)), p)
        for r, p in ((0.0, power_law(1.5)), (0.8, power_law(1.5)))
    )
    assert plain.load / second.load == pytest.approx(1.0 + 0.8 / (2.0 * math.sqrt(3.0)))
