"""Regression against polynomials in its family, refits and the closed form."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.surrogate.coordinates import SLACK, coordinates
from bayesdeg.surrogate.design import space_filling
from bayesdeg.surrogate.regression import Observed, Prior, fit, half_ranges, observe, rows_of
from bayesdeg.surrogate.scaling import GROUPS, NAMES, Place
from bayesdeg.surrogate.terms import Family, Terms, features
from tests.surrogate.closed_form import FILLED, LENGTH, SPAN, sample

FAMILY = Family((3, 2, 2, 1), (1, 1, 0, 0), (1, 1, 0, 1, 1, 0, 1, 2, 1), (0, 0, 0, 0))
ORDERS = FAMILY.orders
CURVES = space_filling(SPAN, 64, seed=3)
TRUTH = Prior().scales(ORDERS) * np.random.default_rng(1).standard_normal((3, len(ORDERS)))
SHARP = Prior(noise=1e-8)


def polynomial_run(curve):
    """A run whose logarithms are polynomials of the family, those of its load among them."""
    values = Place.of(curve.material).values
    swelling = 8.0 * (np.arange(1, 8) / 7.0) ** 1.5
    place = coordinates(np.column_stack([swelling, np.tile(values, (7, 1))]))
    terms = Terms(ORDERS, TRUTH)
    by_points = np.stack(
        [
            features(d.orders, place.points) @ d.coefficients.T
            for d in (terms.derivative(k) for k in range(len(NAMES)))
        ],
        axis=-1,
    )
    at_rest = coordinates(np.array([[1e-13, *values]]))
    found = features(ORDERS, place.points) @ TRUTH.T
    return Observed(
        coordinates=place,
        along=swelling,
        load=swelling * np.exp(found[:, -1]),
        values=found,
        gradients=by_points @ place.jacobian,
        weights=np.linspace(0.2, 1.0, len(swelling)),
        first=(features(ORDERS, at_rest.points) @ TRUTH.T)[0],
        tight=curve.material.paper_slack == 0.0,
    )


RUNS = [polynomial_run(curve) for curve in CURVES]


def equations(runs, outputs=(0, 1, 2), *, derivatives=True):
    return [rows_of(run, ORDERS, outputs=list(outputs), derivatives=derivatives) for run in runs]


@pytest.mark.parametrize("derivatives", [False, True])
def test_a_polynomial_in_the_family_is_recovered(derivatives):
    """Values alone need more runs: each pair of causes has to meet in some."""
    runs = RUNS if derivatives else [polynomial_run(c) for c in space_filling(SPAN, 256, seed=3)]
    found = fit(equations(runs, derivatives=derivatives), ORDERS, SHARP, outputs=3)
    np.testing.assert_allclose(found.coefficients, TRUTH, atol=1e-6)


def test_every_equation_of_values_derivatives_and_first_slope_holds_for_the_polynomial():
    for run, rows in zip(RUNS, equations(RUNS), strict=True):
        count = len(run.load)
        known = len(NAMES) - run.tight
        assert rows.n_values == count
        assert len(rows.matrix) == len(rows.targets) == count * (1 + known) + 1
        np.testing.assert_allclose(rows.matrix @ TRUTH.T, rows.targets, atol=1e-9)


def test_an_unknown_derivative_or_first_slope_is_left_out():
    gradients = RUNS[0].gradients.copy()
    gradients[1, 2, SLACK + 1] = np.nan
    run = replace(RUNS[0], gradients=gradients, first=np.array([0.1, 0.2, np.nan]))
    whole, less = equations([RUNS[0]])[0], equations([run])[0]
    assert len(whole.matrix) - len(less.matrix) == len(run.load) + 1
    assert np.all(np.isfinite(less.targets))


def test_derivatives_count_over_half_of_each_range():
    sizes = half_ranges()
    for k, group in enumerate(GROUPS):
        far = max(group.high - group.neutral, group.neutral - group.low)
        expected = far if group.is_cause else 0.5 * (group.high - group.low)
        assert sizes[k] == pytest.approx(expected)


def test_a_derivative_by_swelling_counts_by_its_logarithm():
    run = RUNS[0]
    rows = rows_of(run, ORDERS, outputs=[0], weight=0.5)
    count = len(run.load)
    np.testing.assert_allclose(
        rows.targets[count : 2 * count, 0], 0.5 * run.weights * run.along * run.gradients[:, 0, 0]
    )


def noisy(rows):
    generator = np.random.default_rng(8)
    return [
        replace(part, targets=part.targets + 0.1 * generator.standard_normal(part.targets.shape))
        for part in rows
    ]


@pytest.mark.parametrize("count", [3, 40])
def test_coefficients_are_least_squares_beside_the_prior(count):
    prior = Prior(0.6, 0.4, 0.3, 0.05)
    rows = noisy(equations(RUNS[:count], derivatives=False))
    found = fit(rows, ORDERS, prior, outputs=3)
    causes = 0.3 ** ORDERS[:, 4:].sum(axis=1)
    scales = 0.6 ** ORDERS[:, 0] * 0.4 ** ORDERS[:, 1:4].sum(axis=1) * causes
    ridge = 0.05 * np.diag(1.0 / scales)
    matrix = np.vstack([*(part.matrix for part in rows), ridge])
    targets = np.vstack([*(part.targets for part in rows), np.zeros((len(ORDERS), 3))])
    wanted, *_ = np.linalg.lstsq(matrix, targets)
    np.testing.assert_allclose(found.coefficients, wanted.T, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("count", [4, 40])
@pytest.mark.parametrize("derivatives", [False, True])
def test_leaving_a_run_out_is_a_refit_without_it(count, derivatives):
    rows = noisy(equations(RUNS[:count], derivatives=derivatives))
    prior = Prior(noise=1e-2)
    whole = fit(rows, ORDERS, prior, outputs=3)
    for k in range(0, count, max(1, count // 4)):
        refit = fit(rows[:k] + rows[k + 1 :], ORDERS, prior, outputs=3).coefficients
        assert np.max(np.abs(refit - whole.coefficients)) > 1e-4
        np.testing.assert_allclose(whole.without(rows[k]), refit, rtol=1e-6, atol=1e-9)


def closed_form_runs(count, seed):
    curves = space_filling(SPAN, count, seed=seed)
    found = (observe(curve, sample(curve), length=LENGTH, compliance=FILLED) for curve in curves)
    return [run for run in found if run is not None]


def test_derivatives_lower_the_error_at_fresh_points_of_the_same_runs():
    runs, fresh = closed_form_runs(32, seed=5), closed_form_runs(48, seed=77)
    sizes = []
    for derivatives in (False, True):
        rows = equations(runs, (0, 1), derivatives=derivatives)
        found = fit(rows, ORDERS, Prior(noise=1e-3), outputs=2)
        unseen = equations(fresh, (0, 1), derivatives=False)
        errors = [part.matrix @ found.coefficients.T - part.targets for part in unseen]
        sizes.append(np.sqrt(np.mean(np.vstack(errors) ** 2)))
    assert sizes[1] < 0.5 * sizes[0]
