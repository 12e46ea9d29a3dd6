"""Least squares over solved curves, and the error by leaving out whole curves."""

import math

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.material import Material
from bayesdeg.emulator.campaign import space_filling
from bayesdeg.emulator.surrogate import chebyshev_features, polynomial, total_degree_orders
from bayesdeg.emulator.training import (
    LIMIT_MARGIN,
    STEEPEST,
    Table,
    _limit,
    best_orders,
    fit,
    left_out_residuals,
    reach,
    tabulate,
    unit_groups,
)
from tests.emulator.closed_form import BOX, LENGTH, limit_load, solution, solve

CURVES = space_filling(BOX, 16, seed=9)


def power_law(exponent, loads, *, limit=math.inf):
    """A curve whose d ln κ / d ln q is the exponent everywhere."""
    q = np.array(loads)
    arc = np.full(len(q), LENGTH)
    return solution(q**exponent * arc, arc, 1.0 + q, limit_load=limit)


@pytest.fixture
def noisy_table():
    """Values that no polynomial fits, in curves of different lengths."""
    generator = np.random.default_rng(2)
    sizes = [6, 3, 9, 1, 5, 7, 4, 8]
    points = generator.uniform(-1.0, 1.0, (sum(sizes), 4))
    values = np.sin(3.0 * points[:, :3]) + generator.standard_normal((sum(sizes), 3))
    return Table(points, np.abs(points[:, 0]), values, np.repeat(np.arange(len(sizes)), sizes))


def test_left_out_residuals_are_those_of_explicit_refits(noisy_table):
    orders = total_degree_orders((2, 1, 1, 1))
    got = left_out_residuals(orders, noisy_table)
    for number in np.unique(noisy_table.curve):
        out = noisy_table.curve == number
        features = chebyshev_features(orders, noisy_table.points)
        refit = np.linalg.lstsq(features[~out], noisy_table.values[~out], rcond=None)[0]
        np.testing.assert_allclose(
            got[out], noisy_table.values[out] - features[out] @ refit, rtol=1e-5, atol=1e-6
        )
    assert np.std(got) > np.std(
        noisy_table.values
        - chebyshev_features(orders, noisy_table.points)
        @ fit(orders, noisy_table.points, noisy_table.values).T
    )


def test_the_fit_is_that_of_least_squares(noisy_table):
    orders = total_degree_orders((2, 1, 1, 1))
    features = chebyshev_features(orders, noisy_table.points)
    want = np.linalg.lstsq(features, noisy_table.values, rcond=None)[0].T
    np.testing.assert_allclose(
        fit(orders, noisy_table.points, noisy_table.values), want, rtol=1e-5, atol=1e-6
    )


def test_the_best_orders_are_those_that_predict_left_out_curves_best():
    generator = np.random.default_rng(3)
    points = generator.uniform(-1.0, 1.0, (120, 4))
    values = np.tile((points[:, 0] ** 2 + points[:, 1])[:, None], 3)
    values = values + 0.01 * generator.standard_normal(values.shape)
    table = Table(points, points[:, 0], values, np.repeat(np.arange(12), 10))
    candidates = [(1, 1, 1, 1), (2, 2, 1, 1), (4, 4, 4, 4)]
    orders, residuals = best_orders(table, candidates)
    assert orders.tolist() == total_degree_orders((2, 2, 1, 1)).tolist()
    np.testing.assert_array_equal(residuals, left_out_residuals(orders, table))


def test_orders_with_too_many_terms_are_not_tried():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 4))
    table = Table(points, points[:, 0], points[:, :3], np.repeat(np.arange(5), 4))
    orders, _ = best_orders(table, [(1, 1, 1, 1), (6, 6, 6, 6)])
    assert len(orders) == 5


def test_the_table_holds_the_logarithms_that_the_surrogate_stands_for():
    table = tabulate(CURVES, [solve(c) for c in CURVES], box=BOX, length=LENGTH)
    row = 0
    for number, curve in enumerate(CURVES):
        solution = solve(curve)
        for j in np.flatnonzero(table.curve == number) - row:
            q = curve.loads[j]
            kappa = solution.bend_angle[j] / solution.arc_length[j]
            assert table.load[row + j] == q
            assert table.points[row + j, 0] == pytest.approx(2.0 * q / BOX.load - 1.0)
            np.testing.assert_allclose(table.points[row + j, 1:], unit_groups(curve, BOX))
            np.testing.assert_allclose(
                table.values[row + j],
                (
                    math.log(kappa * LENGTH / q),
                    math.log((solution.peak_stretch[j] - 1.0) / q),
                    (solution.arc_length[j] / LENGTH - 1.0) / q,
                ),
            )
        row += int(np.sum(table.curve == number))
    assert row == len(table.load)


def test_no_point_of_the_table_lies_beyond_a_limit_point_or_the_box():
    table = tabulate(CURVES, [solve(c) for c in CURVES], box=BOX, length=LENGTH)
    for number, curve in enumerate(CURVES):
        _, a, b, _ = (None, *unit_groups(curve, BOX))
        rows = table.curve == number
        assert np.all(table.load[rows] <= LIMIT_MARGIN * max(limit_load(a, b), 1e-9) + 1e-9) or (
            limit_load(a, b) > curve.loads[-1]
        )
        assert np.all(table.load[rows] <= BOX.largest_load(np.array([b]))[0] * (1 + 1e-6))


LOADS = (0.1, 0.2, 0.3, 0.4, 0.5)
CURVE = Curve(LOADS, Material(0.0, 0.05, 100.0))


def test_a_smooth_curve_is_emulated_to_its_end():
    assert reach(CURVE, power_law(1.5, LOADS)) == math.inf


def test_a_curve_is_emulated_to_shortly_before_its_limit_point():
    assert reach(CURVE, power_law(1.5, LOADS[:3], limit=0.35)) == pytest.approx(LIMIT_MARGIN * 0.35)


def test_a_curve_is_emulated_to_where_it_gets_too_steep():
    q = np.array(LOADS)
    growth = q * 12.0  # ln κ = 12 q: d ln κ / d ln q = 12 q passes 4 at q = 1/3
    arc = np.full(5, LENGTH)
    steep = solution(np.exp(12.0 * q) * arc, arc, 1.0 + q)
    assert growth[2] < STEEPEST < growth[3]
    assert reach(CURVE, steep) == pytest.approx(1.0 / 3.0, rel=0.02)


def test_a_curve_that_failed_at_once_is_not_emulated():
    assert reach(CURVE, power_law(1.5, LOADS[:2], limit=0.25)) == 0.0


def test_a_curve_too_steep_from_its_start_is_emulated_no_further_than_its_first_loads():
    assert reach(CURVE, power_law(5.0, LOADS)) <= 0.2


def test_a_limit_that_scatters_is_rarely_overestimated():
    """The fitted limit is two standard errors low: about one curve in forty lies under it."""
    generator = np.random.default_rng(6)
    curves = space_filling(BOX, 256, seed=11)
    solutions, limits = [], []
    for curve in curves:
        a, b, _ = unit_groups(curve, BOX)
        limits.append(limit_load(a, b) * np.exp(0.05 * generator.standard_normal()))
        kept = sum(q < limits[-1] for q in curve.loads)
        limit = limits[-1] if kept < len(curve.loads) else math.inf
        solutions.append(power_law(1.5, curve.loads[:kept], limit=limit))
    orders, coefficients = _limit(curves, solutions, box=BOX)
    points = np.array([unit_groups(curve, BOX) for curve in curves])
    fitted = np.exp(polynomial(orders, coefficients, points))
    met = np.array([np.isfinite(s.limit_load) and len(s.bend_angle) >= 3 for s in solutions])
    assert met.sum() > 10
    ratio = fitted[met] / (LIMIT_MARGIN * np.array(limits)[met])
    assert np.mean(ratio > 1.0) < 0.1
    assert 0.8 < np.median(ratio) < 0.97
