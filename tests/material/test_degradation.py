"""Constants as polynomials of D_R: exactness, derivative, stability, choice of nodes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.material.degradation import (
    derivative,
    is_stable,
    lagrange_slopes,
    lagrange_weights,
    nodes_for,
    polynomial,
    yeoh_constants,
    young_modulus,
)
from bayesdeg.material.hyperelastic import Yeoh, tangent

NODES = (0.0, 12.5, 25.0)
LEVELS = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 25.0])
coefficient = st.floats(-10.0, 10.0)
node_sets = st.sampled_from([(0.0,), (0.0, 25.0), NODES, (3.0, 40.0, 7.0), (14.9,)])


@given(nodes=node_sets, degradation=st.floats(-5.0, 60.0), data=st.data())
def test_polynomials_up_to_the_order_are_reproduced(nodes, degradation, data):
    powers = [data.draw(coefficient) for _ in nodes]
    values = np.polynomial.polynomial.polyval(np.array(nodes), powers)
    expected = float(np.polynomial.polynomial.polyval(degradation, powers))
    scale = 1.0 + np.abs(values).max() * 100.0
    assert float(polynomial(values, degradation, nodes)) == pytest.approx(
        expected, abs=1e-11 * scale
    )
    slope = float(
        np.polynomial.polynomial.polyval(degradation, np.polynomial.polynomial.polyder(powers))
    )
    assert float(derivative(values, degradation, nodes)) == pytest.approx(slope, abs=1e-11 * scale)


@given(nodes=node_sets, degradation=st.floats(-5.0, 60.0))
def test_weights_sum_to_one_and_slopes_to_zero(nodes, degradation):
    assert lagrange_weights(degradation, nodes).sum() == pytest.approx(1.0, abs=1e-9)
    assert lagrange_slopes(degradation, nodes).sum() == pytest.approx(0.0, abs=1e-9)


@given(
    values=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    degradation=st.floats(0.0, 30.0),
)
def test_derivative_is_the_slope_by_finite_differences(values, degradation):
    step = 1e-4
    above = polynomial(values, degradation + step, NODES)
    below = polynomial(values, degradation - step, NODES)
    assert float(derivative(values, degradation, NODES)) == pytest.approx(
        float(above - below) / (2.0 * step), abs=1e-9
    )


def test_values_at_nodes_are_kept():
    values = np.array([0.288, 0.7, 1.59])
    np.testing.assert_array_equal(polynomial(values, NODES, NODES), values)


def test_shapes_over_walkers_and_specimens():
    rng = np.random.default_rng(3)
    values = rng.normal(size=(7, 3))
    own = rng.uniform(0.0, 25.0, size=(7, 6))
    assert polynomial(values, LEVELS, NODES).shape == (7, 6)
    assert polynomial(values, 5.0, NODES).shape == (7,)
    assert polynomial(values[0], LEVELS, NODES).shape == (6,)
    each = polynomial(values, own, NODES)
    assert each.shape == (7, 6)
    for walker in range(7):
        np.testing.assert_allclose(
            each[walker], polynomial(values[walker], own[walker], NODES), rtol=1e-13
        )
    assert derivative(values, LEVELS, NODES).shape == (7, 6)
    np.testing.assert_array_equal(derivative(values[:, :1], LEVELS, (0.0,)), np.zeros((7, 6)))


def test_coinciding_nodes_are_refused():
    with pytest.raises(ValueError, match="distinct"):
        lagrange_weights(3.0, (0.0, 0.0, 25.0))


def test_number_of_values_must_be_that_of_the_nodes():
    with pytest.raises(ValueError, match="matmul"):
        polynomial([1.0, 2.0], 3.0, NODES)


ratios = st.lists(st.floats(-0.99, 2.0), min_size=3, max_size=3)
positive = st.lists(st.floats(1e-4, 3.0), min_size=3, max_size=3)


@given(c1=positive, ratio=ratios, c3=positive)
def test_constants_are_quadratic_and_stable_at_the_nodes(c1, ratio, c3):
    at_nodes = yeoh_constants(c1, ratio, c3, NODES, NODES)
    np.testing.assert_allclose(at_nodes[0], c1, rtol=1e-12)
    np.testing.assert_allclose(at_nodes[2], c3, rtol=1e-12)
    assert np.all(at_nodes[1] > -np.sqrt(3.0 * at_nodes[0] * at_nodes[2]))
    for constant, node_values in zip(
        yeoh_constants(c1, ratio, c3, LEVELS, NODES), at_nodes, strict=True
    ):
        third_difference = np.diff(constant, n=3)
        # of the smallest numbers that there are, rounding is no share
        rounding = max(1e-11 * np.abs(node_values).max(), 1e-300)
        np.testing.assert_allclose(third_difference, 0.0, atol=rounding)


@given(c1=positive, ratio=ratios, c3=positive)
def test_stability_flag_agrees_with_brute_force(c1, ratio, c3):
    x = np.linspace(0.0, 200.0, 4001)
    a, b, c = (
        constant[:, np.newaxis]
        for constant in yeoh_constants(c1, ratio, c3, np.linspace(0.0, 25.0, 51), NODES)
    )
    slopes = a + 2.0 * b * x + 3.0 * c * x**2
    stable = bool(is_stable(c1, ratio, c3, largest_degradation=25.0, nodes=NODES))
    if stable:
        assert slopes.min() > 0.0
    elif slopes.min() > 0.0:
        # between the strains examined, or beyond them
        assert np.min(c) <= 0.0 or np.min(a - b**2 / (3.0 * c)) <= 0.0


def test_unstable_walkers_are_told_apart():
    c1 = np.array([[0.288, 0.7, 1.59], [0.288, 0.05, 1.59], [0.288, 0.7, 1.59]])
    ratio = np.array([[-0.5, -0.5, -0.5], [-0.5, -0.5, -0.5], [-0.5, -1.1, -0.5]])
    c3 = np.full((3, 3), 0.01)
    stable = is_stable(c1, ratio, c3, largest_degradation=25.0, nodes=NODES)
    np.testing.assert_array_equal(stable, [True, False, False])


def test_third_constant_must_be_positive():
    ones = np.ones(3)
    assert not bool(is_stable(ones, ones, 0.0 * ones, largest_degradation=25.0, nodes=NODES))


@pytest.mark.parametrize(
    ("levels", "order", "nodes"),
    [
        (LEVELS, 2, NODES),
        (LEVELS, 1, (0.0, 25.0)),
        (LEVELS, 0, (0.0,)),
        ([0.0, 0.4, 12.0, 12.9, 25.0, 25.99], 2, NODES),
        ([0.0, 0.4, 25.0, 25.9], 2, (0.0, 25.0)),
        ([14.84, 14.8, 15.2], 2, (14.9,)),
        ([5.0], 0, (5.0,)),
        ([0.0, 1.0], 2, (0.0, 25.0)),
        ([0.0, 0.9, 1.8], 2, (0.0, 25.0)),
    ],
)
def test_nodes_follow_from_the_levels(levels, order, nodes):
    assert nodes_for(levels, order) == nodes


@pytest.mark.parametrize(("levels", "order"), [([], 2), ([np.nan], 2), ([0.0, 5.0], 4)])
def test_impossible_nodes_are_refused(levels, order):
    with pytest.raises(ValueError, match="must be"):
        nodes_for(levels, order)


def test_young_modulus_is_the_tangent_at_zero_strain():
    assert float(young_modulus(0.288)) == pytest.approx(
        float(tangent(Yeoh(0.288, -0.01, 0.001), 1.0, mode="uniaxial"))
    )
