"""The limit of curves, fitted to limits that are known."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.surrogate.coordinates import coordinates, scaled_cause
from bayesdeg.surrogate.design import space_filling
from bayesdeg.surrogate.fit import NEAR, UNKNOWN_SHIFT, fit_limit
from bayesdeg.surrogate.regression import Reach
from bayesdeg.surrogate.scaling import NAMES, Place
from bayesdeg.surrogate.terms import features
from tests.surrogate.closed_form import SPAN

COUNT = 192
PLACES = np.array([Place.of(c.material).values for c in space_filling(SPAN, COUNT, seed=4)])
FRESH = np.array([Place.of(c.material).values for c in space_filling(SPAN, 64, seed=40)])
AT = {name: k for k, name in enumerate(NAMES)}


def points_of(places):
    """Coordinates without a load, the slack by its range; and the warp."""
    groups = np.column_stack([np.full(len(places), 0.1), places])
    place = coordinates(groups)
    points = place.points.copy()
    points[:, 0] = 0.0
    slack = AT["paper_slack"]
    points[:, slack] = scaled_cause("paper_slack", groups[:, slack])[0]
    return points, place.warp


def log_limit(places):
    """A polynomial of low order in material and causes."""
    p, _ = points_of(places)
    a, b, skin, erosion = (p[:, k] for k in (1, 2, AT["skin"], AT["erosion"]))
    slack = p[:, AT["paper_slack"]]
    return -0.6 + 0.2 * a + 0.3 * b + 0.05 * a * b - 0.1 * skin + 0.08 * erosion**2 + 0.06 * slack


def reaches_of(places, noise=0.0, *, lower=None):
    """Runs that end at the limit, or at a bound below it by a factor of their own."""
    _, warp = points_of(places)
    x = np.exp(log_limit(places) - warp + noise)
    if lower is None:
        return [Reach(g, float(q), open=False) for g, q in zip(places, x, strict=True)]
    return [
        Reach(g, float(q * share), open=True)
        for g, q, share in zip(places, x, np.broadcast_to(lower, x.shape), strict=True)
    ]


def fitted(limit, places):
    points, _ = points_of(places)
    return (features(limit.terms.orders, points) @ limit.terms.coefficients.T).T


def test_a_known_limit_is_found_at_fresh_materials():
    found = fit_limit(reaches_of(PLACES))
    error = fitted(found, FRESH)[0] - log_limit(FRESH)
    assert np.sqrt(np.mean(error**2)) < 5e-3
    assert np.sqrt(np.mean(found.left_out**2)) < 1e-2
    assert len(found.left_out) == COUNT


def test_bounds_below_the_limit_leave_it_as_it_is():
    known = fit_limit(reaches_of(PLACES))
    low = reaches_of(FRESH[:16], lower=0.8)
    both = fit_limit([*reaches_of(PLACES), *low])
    assert np.max(np.abs(fitted(both, FRESH)[0] - fitted(known, FRESH)[0])) < 5e-3
    assert len(both.left_out) == COUNT  # no error is known where the limit is not


def test_the_error_of_few_ends_stays_theirs_where_a_cause_did_not_move_in_them():
    """As where one study lies: paper is nearly as thick in all curves that end."""
    generator = np.random.default_rng(3)
    near, thickness = PLACES[:12].copy(), AT["paper_thickness"] - 1
    near[:, thickness] = 0.117 + 0.002 * generator.standard_normal(12)
    found = fit_limit(reaches_of(near, 0.02 * generator.standard_normal(12)), family=NEAR.limit)
    stated = fitted(found, FRESH)[1]
    assert len(found.left_out) == 12
    assert np.all(stated <= 2.0 * np.abs(found.left_out).max())


def test_three_ends_count_among_many_curves_that_stop_far_below():
    """As of one study: its stiff materials are asked for loads far below where they balloon."""
    ground = fit_limit(reaches_of(PLACES)).terms.output(0)
    earlier = 0.17  # another actuator's curves end so much earlier in ln load
    ended = [replace(one, load=one.load * np.exp(-earlier)) for one in reaches_of(FRESH[:3])]
    low = reaches_of(FRESH[3:40], lower=0.3)
    found = fit_limit([*low, *ended], family=NEAR.limit, ground=ground)
    error = fitted(found, FRESH[:3])[0] - (log_limit(FRESH[:3]) - earlier)
    assert np.max(np.abs(error)) < 5e-3
    assert np.max(np.abs(found.left_out)) < 0.03


def test_an_end_that_no_fine_curve_showed_is_less_certain():
    ended, low = reaches_of(PLACES), reaches_of(FRESH[:2], lower=0.5)
    sd, less_certain = (
        fitted(fit_limit(ended, fine), FRESH)[1].min() for fine in (reaches_of(FRESH[:2]), low)
    )
    assert less_certain == pytest.approx(np.hypot(sd, UNKNOWN_SHIFT), rel=1e-6)


@pytest.mark.parametrize("index", range(4))
def test_a_bound_above_the_fit_pushes_it_up(index):
    place = FRESH[index : index + 1]
    known = fit_limit(reaches_of(PLACES))
    high = fit_limit([*reaches_of(PLACES), *reaches_of(place, lower=1.4)])
    rise = (fitted(high, place)[0] - fitted(known, place)[0])[0]
    assert 0.02 < rise < np.log(1.4) + 0.03


def test_runs_that_failed_at_once_say_nothing():
    failed = [Reach(place, 0.0, open=False) for place in FRESH[:5]]
    with_them, without = (fit_limit([*reaches_of(PLACES[:96]), *more]) for more in (failed, []))
    np.testing.assert_array_equal(with_them.terms.coefficients, without.terms.coefficients)
    np.testing.assert_array_equal(with_them.left_out, without.left_out)


def test_the_standard_error_is_that_of_scattered_limits_and_never_negative():
    noise = 0.08 * np.random.default_rng(2).standard_normal(COUNT)
    found = fit_limit(reaches_of(PLACES, noise))
    sd = fitted(found, PLACES)[1]
    assert np.all(found.terms.coefficients[1] >= 0.0)
    assert np.min(sd) >= 0.0
    # of 192 errors the mean size is known to 5.5 %: within three of that, beside √(2/π)
    size = np.mean(np.abs(found.left_out)) * np.sqrt(0.5 * np.pi)
    assert np.mean(sd) == pytest.approx(size, rel=0.15)
    assert np.mean(sd) > 0.08 * (1.0 - 3.0 * 0.055)
