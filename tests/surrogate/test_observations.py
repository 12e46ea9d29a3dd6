"""What solved runs say of the map, against the closed form that made them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate.coordinates import LARGEST_SWELLING, SLACK, coordinates
from bayesdeg.surrogate.design import space_filling
from bayesdeg.surrogate.regression import FLOOR, LOADS, TO, compliance_of, observe
from bayesdeg.surrogate.scaling import GROUPS, NAMES, Place
from tests.surrogate.closed_form import (
    FILLED,
    LENGTH,
    SPAN,
    largest_of,
    load_at,
    readings_at,
    sample,
)

CURVES = space_filling(SPAN, 24, seed=9)
MIXED = Place((0.1, -3.0, 5.0, 0.1, 0.4, 0.15, 0.02, 0.01, 2e-5, -1e-5, 0.9, 0.2))
BASE = Place((0.1, -3.0, 5.0, *(group.neutral for group in GROUPS[3:])))
SOFT = Place((-0.1, -7.0, 5.0, *(group.neutral for group in GROUPS[3:])))
STARTS = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)  # what strains are read as at rest
PLACES = pytest.mark.parametrize("place", [BASE, MIXED, SOFT], ids=["base", "mixed", "soft"])


def curve_of(place, load=0.5):
    return Curve((place.modulus * load,), place.material())


def observed(curve, samples=None):
    return observe(curve, samples or sample(curve), length=LENGTH, compliance=FILLED)


def logarithms(t, values):
    """y of curvature, angle and strains, and ln(q/t), by their definitions, at a swelling."""
    place = Place(tuple(float(v) for v in values))
    at, m = dict(zip(NAMES[1:], place.values, strict=True)), vars(place.material())
    angle, arc, _, *strains = readings_at(np.array([0.0, t]), m).T
    offset = abs(at["paper_mismatch"]) + 60.0 * math.hypot(at["gravity_along"], at["gravity_up"])
    return np.log(
        [
            np.diff(angle / arc)[0] * LENGTH / t,
            np.diff(angle)[0] / t,
            *(
                (one[1] - at_rest) / (t + offset)
                for one, at_rest in zip(strains, STARTS, strict=True)
            ),
            load_at(t, m) / place.modulus / t,
        ]
    )


@PLACES
def test_values_are_logarithms_of_changes_over_the_swelling(place):
    run = observed(curve_of(place))
    assert len(run.along) > 10
    for t, q, values in zip(run.along, run.load, run.values, strict=True):
        np.testing.assert_allclose(values, logarithms(t, place.values), rtol=1e-9, atol=1e-11)
        assert q == pytest.approx(t * np.exp(values[-1]), rel=1e-12)


@pytest.mark.parametrize("axis", range(len(NAMES)), ids=NAMES)
def test_gradients_are_differences_by_swelling_and_groups(axis):
    run = observed(curve_of(MIXED))
    for k, t in enumerate(run.along):
        step = np.zeros(len(NAMES))
        step[axis] = 1e-5 * (t if axis == 0 else GROUPS[axis - 1].high - GROUPS[axis - 1].low)
        at = np.array([t, *MIXED.values])
        more, less = (logarithms(p[0], p[1:]) for p in (at + step, at - step))
        slope = (more - less) / (2.0 * step[axis])
        np.testing.assert_allclose(
            run.gradients[k, :, axis], slope, rtol=1e-5, atol=1e-6 * np.max(np.abs(slope)) + 1e-9
        )


def test_gradients_go_through_the_limit_point():
    """There derivatives by the load are infinite, and those by swelling are not."""
    run = observed(curve_of(SOFT, 1.2))
    at_limit, _ = largest_of(vars(SOFT.material()))
    assert run.along[-2] < at_limit < run.along[-1]
    assert run.growth[-2] > 10.0
    assert run.growth[-1] < 0.0
    for k in (-3, -2, -1):
        h = 1e-5 * run.along[k]
        more, less = (logarithms(run.along[k] + d, SOFT.values) for d in (h, -h))
        np.testing.assert_allclose(run.gradients[k, :, 0], (more - less) / (2.0 * h), rtol=1e-5)


def test_coordinates_are_those_of_swelling_and_groups():
    run = observed(curve_of(MIXED))
    groups = [[t, *MIXED.values] for t in run.along]
    np.testing.assert_allclose(
        run.coordinates.points, coordinates(np.array(groups)).points, rtol=1e-10, atol=1e-12
    )


@PLACES
def test_the_first_slope_is_the_limit_at_small_swellings(place):
    run = observed(curve_of(place))
    small = logarithms(1e-6, place.values)
    np.testing.assert_allclose(run.first[[0, 1, 9]], small[[0, 1, 9]], rtol=1e-4, atol=1e-5)
    # what strains at rest has no first slope of its own; and where nothing strains, all points are
    # alike, so that which a quantile lies between says nothing
    assert np.all(np.isnan(run.first[[2, 7, 8]]))
    assert np.all(np.isfinite(run.first[3:7]) == (place is not MIXED))


def test_weights_are_curvatures_over_the_largest_but_not_below_the_floor_and_loads_count_alike():
    run = observed(curve_of(BASE))
    curvature = run.along * np.exp(run.values[:, 0])
    np.testing.assert_allclose(run.weights, np.maximum(curvature / curvature.max(), FLOOR))
    assert run.weights[0] == FLOOR
    np.testing.assert_array_equal(run.weights_of((0, 1)), run.weights)
    np.testing.assert_array_equal(run.weights_of(LOADS), 1.0)


def test_derivatives_by_slack_are_used_of_slack_paper_alone():
    tight, slack = (observed(curve_of(place)) for place in (BASE, MIXED))
    assert tight.tight
    assert np.flatnonzero(~tight.known).tolist() == [SLACK]
    assert np.all(slack.known)


def test_growth_is_that_at_a_given_load_and_errors_count_to_shortly_before_the_limit():
    run, m = observed(curve_of(SOFT, 1.2)), vars(SOFT.material())
    at_limit, limit = largest_of(m)
    before = run.before_limit
    assert np.all(before == ((run.along < at_limit) & (run.load <= TO * run.load.max())))
    assert before.any()
    assert run.load.max() == pytest.approx(limit / SOFT.modulus, rel=0.02)
    for t, growth in zip(run.along[before], run.growth[before], strict=True):
        h = 1e-6
        more, less = (logarithms(t * (1.0 + d), SOFT.values)[[0, -1]] for d in (h, -h))
        bent, loaded = (more - less) / (2.0 * h)
        assert growth == pytest.approx((1.0 + bent) / (1.0 + loaded), rel=1e-5)


def test_nothing_is_said_beyond_the_range_of_the_swelling_and_paths_go_beyond_their_limit():
    beyond = 0
    for curve in CURVES:
        run, solved = observed(curve), sample(curve)
        assert np.all(np.diff(run.along) > 0.0)
        assert np.all(run.along <= LARGEST_SWELLING)
        assert np.all(run.coordinates.points[:, 0] <= 1.0)
        beyond += solved.status == Status.LIMIT_POINT and bool(run.growth[-1] < 0.0)
    assert beyond > 5


def changed(samples, angle, *, slope=1.0):
    """The path with these bend angles and slopes of them after rest."""
    readings, gradients = samples.readings.copy(), samples.gradients.copy()
    readings[1:, 0] = angle
    gradients[1:, 0, 0] *= slope
    return replace(samples, readings=readings, gradients=gradients)


def test_of_a_curve_that_bends_the_other_way_at_first_the_rest_is_said():
    whole = sample(curve_of(BASE))
    angle = whole.readings[1:, 0].copy()
    lost = angle - angle[3] * 1.01
    run = observed(curve_of(BASE), changed(whole, lost))
    np.testing.assert_array_equal(run.along, observed(curve_of(BASE)).along[4:])


def test_where_a_curve_straightens_nothing_is_said():
    whole = sample(curve_of(BASE))
    slope = np.ones((len(whole.loads) - 1, 1))[:, 0]
    slope[[2, 5]] = -1.0
    run = observed(curve_of(BASE), changed(whole, whole.readings[1:, 0], slope=slope))
    expected = observed(curve_of(BASE)).along
    np.testing.assert_array_equal(run.along, np.delete(expected, [2, 5]))


def test_a_path_that_failed_at_once_says_nothing():
    assert observed(curve_of(BASE), shortened(sample(curve_of(BASE)), 2)) is None
    assert len(observed(curve_of(BASE), shortened(sample(curve_of(BASE)), 3)).load) == 2


def shortened(samples, count):
    return replace(
        samples,
        loads=samples.loads[:count],
        readings=samples.readings[:count],
        gradients=samples.gradients[:count],
        status=Status.TIMED_OUT,
    )


def test_the_compliance_is_the_median_first_slope_of_the_volume():
    found = compliance_of(((curve, sample(curve)) for curve in CURVES), LENGTH)
    wanted = []
    for curve in CURVES:
        m, t = vars(curve.material), 1e-7
        wanted.append(FILLED * t / load_at(t, m) * Place.of(curve.material).modulus)
    assert found == pytest.approx(np.median(wanted), rel=1e-5)
    assert compliance_of([], LENGTH) == 1.0
