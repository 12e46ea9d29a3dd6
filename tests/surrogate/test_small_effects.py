"""What small causes do alone, fitted anew to curves of the fine mesh with one cause each."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.surrogate.design import IN_TURN, THIRD_RUNS, is_answered, third_stage
from bayesdeg.surrogate.fit import SMALL, with_small_effects
from bayesdeg.surrogate.regression import observe
from bayesdeg.surrogate.scaling import CAUSES, GROUPS, NAMES, Place
from bayesdeg.surrogate.terms import N_CHEBYSHEV, feature_gradients, features
from tests.surrogate.closed_form import LENGTH, SPAN, sample, trained

CURVES = third_stage(SPAN)
UP = NAMES.index("gravity_up")
WRONG = 0.02  # of ln curvature at the largest weight, and as much in a wave along the load
NEUTRAL = {group.name: group.neutral for group in CAUSES}


def acting(curve):
    """Causes at work in a curve, without the thickness of paper, which shrinks with the body."""
    values = dict(zip((g.name for g in GROUPS), Place.of(curve.material).values, strict=True))
    names = (n for n in NEUTRAL if n != "paper_thickness")
    return [name for name in names if abs(values[name] - NEUTRAL[name]) > 1e-9]


def off():
    """The emulator of the closed form, wrong in what weight across the paper does alone."""
    plain = trained()
    orders, coefficients = plain.terms.orders, plain.terms.coefficients.copy()
    for order in (0, 2):
        wanted = np.zeros(len(NAMES), dtype=np.int64)
        wanted[0], wanted[UP] = order, 1
        place = np.all(orders == wanted, axis=1)
        assert place.sum() == 1
        coefficients[:2, place] += WRONG
    return replace(plain, terms=replace(plain.terms, coefficients=coefficients))


@pytest.fixture(scope="module")
def mended():
    return with_small_effects(off(), CURVES, [sample(curve) for curve in CURVES])


def slope_errors(surrogate, curves, axis):
    """Errors of d ln κ by a cause's coordinate."""
    found = []
    for curve in curves:
        run = observe(curve, sample(curve), span=SPAN, length=LENGTH)
        slopes = feature_gradients(surrogate.terms.orders, run.coordinates.points)
        along = slopes[:, axis] @ surrogate.terms.coefficients[0]
        scale = run.coordinates.jacobian[:, axis, axis]
        wanted = run.gradients[:, 0, axis] - run.coordinates.warp_gradient[:, axis]
        found.append(along - wanted / scale)
    return np.concatenate(found)


def test_what_a_weight_does_is_known_again_at_curves_of_its_own(mended):
    fresh = [c for c in CURVES if not acting(c) or acting(c) == ["gravity_up"]]
    before, after = (np.sqrt(np.mean(slope_errors(s, fresh, UP) ** 2)) for s in (off(), mended))
    assert before > WRONG
    assert after < before / 8.0


def test_a_curve_left_out_is_met_too():
    rest, held = CURVES[12:], [c for c in CURVES[:12] if acting(c) == ["gravity_up"]]
    found = with_small_effects(off(), rest, [sample(curve) for curve in rest])
    assert held
    after = np.sqrt(np.mean(slope_errors(found, held, UP) ** 2))
    assert after < np.sqrt(np.mean(slope_errors(off(), held, UP) ** 2)) / 4.0


def test_without_a_small_cause_alone_no_term_changes(mended):
    before, after = (
        {
            tuple(order): tuple(column)
            for order, column in zip(s.terms.orders.tolist(), s.terms.coefficients.T, strict=True)
        }
        for s in (off(), mended)
    )
    small = [NAMES.index(name) for name in SMALL]

    def kept(terms):
        return {
            order: size
            for order, size in terms.items()
            if sum(k > 0 for k in order[N_CHEBYSHEV:]) != 1 or not any(order[k] for k in small)
        }

    one, other = kept(before), kept(after)
    zero = (0.0, 0.0, 0.0)
    assert all(one.get(k, zero) == other.get(k, zero) for k in one | other)


def test_far_from_all_curves_what_was_known_stays():
    """Five times the weight of gelatin, in any material: no curve was solved there."""
    plain = trained()
    again = with_small_effects(plain, CURVES, [sample(curve) for curve in CURVES])
    points = np.zeros((64, len(NAMES)))
    points[:, :N_CHEBYSHEV] = np.random.default_rng(3).uniform(-1.0, 1.0, (64, N_CHEBYSHEV))
    points[:, UP] = 1.0
    without = points.copy()
    without[:, UP] = 0.0
    one, other = (
        (features(s.terms.orders, points) - features(s.terms.orders, without))
        @ s.terms.coefficients[0]
        for s in (plain, again)
    )
    assert np.sqrt(np.mean((one - other) ** 2)) < 0.2 * np.sqrt(np.mean(one**2))


def test_the_record_counts_the_curves(mended):
    before, after = (json.loads(s.record)["fine_curves"] for s in (off(), mended))
    assert after == before + THIRD_RUNS


def test_each_curve_has_one_cause_and_all_are_answered():
    numbers = [len(acting(curve)) for curve in CURVES]
    assert set(numbers) <= {0, 1}
    assert all(is_answered(curve, SPAN) for curve in CURVES)
    with_weight = [c for c in CURVES if {"gravity_along", "gravity_up"} & set(acting(c))]
    assert len(with_weight) == THIRD_RUNS * IN_TURN.count(5) // len(IN_TURN)
    ends = {round(c.loads[-1] / min(o.loads[-1] for o in with_weight)) for c in with_weight}
    assert len(ends) > 1
