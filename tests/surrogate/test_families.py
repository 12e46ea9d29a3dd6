"""Families of polynomial products, against slow loops and differences."""

from itertools import pairwise, product

import numpy as np
import pytest
from numpy.polynomial import Chebyshev

from bayesdeg.surrogate.fit import PLANS
from bayesdeg.surrogate.scaling import NAMES
from bayesdeg.surrogate.terms import (
    N_CHEBYSHEV,
    Family,
    feature_gradients,
    features,
    total_degree_orders,
)

FAMILY = Family((5, 3, 3, 2), (3, 2, 2, 1), (3, 2, 1, 4, 2, 1, 2, 0, 3), (2, 1, 1, 0), (1, 0, 0, 0))
ORDERS = FAMILY.orders
CAUSES = ORDERS[:, N_CHEBYSHEV:]
ALONG, UP = (NAMES.index(name) for name in ("gravity_along", "gravity_up"))


def random_points(count, *, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(NAMES)))


def slow_term(order, point):
    value = 1.0
    for axis, (n, x) in enumerate(zip(order, point, strict=True)):
        value *= Chebyshev.basis(n)(x) if axis < N_CHEBYSHEV else x**n
    return value


def test_values_are_products_of_one_dimensional_polynomials():
    points = random_points(5)
    want = [[slow_term(order, point) for order in ORDERS] for point in points]
    np.testing.assert_allclose(features(ORDERS, points), want, rtol=1e-12, atol=1e-13)


def test_gradients_are_those_of_central_differences():
    points, h = 0.9 * random_points(8), 1e-6
    found = feature_gradients(ORDERS, points)
    for axis in range(len(NAMES)):
        step = h * (np.arange(len(NAMES)) == axis)
        slope = (features(ORDERS, points + step) - features(ORDERS, points - step)) / (2.0 * h)
        np.testing.assert_allclose(found[:, axis], slope, rtol=1e-7, atol=1e-8)


def test_gradients_at_neutral_causes_are_finite_and_those_of_linear_terms_alone():
    points = random_points(3)
    points[:, N_CHEBYSHEV:] = 0.0
    found = feature_gradients(ORDERS, points)
    linear = CAUSES.sum(axis=1) == 1
    assert np.all(np.isfinite(found))
    np.testing.assert_array_equal(found[:, N_CHEBYSHEV:, ~linear], 0.0)
    assert np.all(np.any(found[:, N_CHEBYSHEV:, linear] != 0.0, axis=(0, 1)))


@pytest.mark.parametrize("degrees", [(3, 2, 4, 1), (2, 0, 3, 0), (0, 0, 0, 0)])
def test_total_degree_is_shared_between_the_inputs(degrees):
    want = [
        list(orders)
        for orders in product(*(range(d + 1) for d in degrees))
        if sum(n / d for n, d in zip(orders, degrees, strict=True) if d) <= 1.0 + 1e-12
    ]
    assert total_degree_orders(degrees).tolist() == want


@pytest.mark.parametrize(
    "family", [FAMILY, *(f for plan in PLANS for f in (plan.family, plan.correction))]
)
def test_no_term_occurs_twice_and_there_is_a_constant(family):
    orders = family.orders
    assert len(np.unique(orders, axis=0)) == len(orders)
    assert np.sum(~orders.any(axis=1)) == 1


def test_each_cause_is_raised_to_its_highest_power_and_none_further():
    assert CAUSES.max(axis=0).tolist() == list(FAMILY.powers)


def test_products_are_of_at_most_three_causes_each_to_the_first_power():
    count = np.sum(CAUSES > 0, axis=1)
    assert set(count.tolist()) == {0, 1, 2, 3}
    assert CAUSES[count > 1].max() == 1
    acting = sum(power > 0 for power in FAMILY.powers)
    pairs = np.unique(CAUSES[count == 2], axis=0)
    assert len(pairs) == acting * (acting - 1) // 2 - 1  # but for the two directions of gravity
    assert not np.any((ORDERS[:, ALONG] > 0) & (ORDERS[:, UP] > 0))


def test_degrees_shrink_as_the_power_of_a_cause_grows():
    slack = N_CHEBYSHEV + 3
    sizes = [
        np.sum((ORDERS[:, slack] == power) & (CAUSES.sum(axis=1) == power) & (CAUSES[:, 3] > 0))
        for power in (1, 2, 3, 4)
    ]
    assert all(a >= b for a, b in pairwise(sizes))
    assert sizes[0] > sizes[-1] > 0


def test_without_products_of_causes_there_are_none():
    orders = Family((2, 1, 1, 1), (1, 0, 0, 0), 9 * (1,)).orders
    assert np.max(np.sum(orders[:, N_CHEBYSHEV:] > 0, axis=1)) == 1
