"""Compiled sums of terms against one term after another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.surrogate.coordinates import SLACK
from bayesdeg.surrogate.scaling import NAMES
from bayesdeg.surrogate.terms import BLOCK, ROW_AXES, Terms, evaluate, plan_of, stacked
from tests.surrogate.term_sums import random_terms, slow_sum

ALL = (True,) * 9


def random_rows(generator, n_rows, n_columns, *, active=range(9)):
    rows = np.zeros((len(NAMES), n_rows))
    rows[1:4] = generator.uniform(-1.0, 1.0, (3, n_rows))
    for cause in active:
        rows[4 + cause] = generator.uniform(-1.0, 1.0, n_rows)
    loads = generator.uniform(-1.0, 1.0, (n_rows, n_columns))
    phi = np.zeros((n_rows, n_columns))
    if SLACK - 4 in active:
        phi = generator.uniform(0.0, 1.0, phi.shape)
    return rows, loads, phi


def count_of(plan):
    return int(np.count_nonzero(plan.coefficients[:, 0]))


def by_hand(terms, rows, loads, phi):
    out = np.empty((len(terms.coefficients), *loads.shape))
    for row, column in np.ndindex(loads.shape):
        point = rows[:, row].copy()
        point[0] = loads[row, column]
        point[SLACK] = phi[row, column]
        out[:, row, column] = slow_sum(terms, point)
    return out


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n_rows=st.sampled_from([1, 3, BLOCK - 1, BLOCK, BLOCK + 1]),
    n_columns=st.integers(1, 3),
    active=st.sets(st.integers(0, 8)),
)
def test_sums_are_those_of_single_terms(seed, n_rows, n_columns, active):
    generator = np.random.default_rng(seed)
    terms = random_terms(generator, 25, 3, size=1.0)
    points = random_rows(generator, n_rows, n_columns, active=active)
    np.testing.assert_allclose(
        evaluate(terms, *points), by_hand(terms, *points), rtol=1e-12, atol=1e-13
    )


def test_terms_left_out_for_neutral_causes_change_nothing():
    generator = np.random.default_rng(1)
    terms = random_terms(generator, 200, 2, size=1.0)
    rows, loads, _ = random_rows(generator, 40, 3, active=[1, 2])
    reduced = evaluate(terms, rows, loads, np.zeros_like(loads))
    rows_and_one = np.hstack([rows, random_rows(generator, 1, 3)[0]])
    loads_and_one = np.vstack([loads, np.zeros((1, 3))])
    phi = np.zeros((41, 3))
    phi[-1] = 0.5
    full = evaluate(terms, rows_and_one, loads_and_one, phi)[:, :40]
    assert count_of(plan_of(terms, ALL)) == len(terms.orders)
    active = tuple(k in (1, 2) for k in range(9))
    assert count_of(plan_of(terms, active)) < 0.8 * len(terms.orders)
    np.testing.assert_allclose(reduced, full, rtol=1e-13, atol=1e-14)


def test_neither_order_nor_number_of_rows_changes_a_bit():
    generator = np.random.default_rng(2)
    terms = random_terms(generator, 100, 3, size=1.0)
    rows, loads, phi = random_rows(generator, 2 * BLOCK + 5, 2)
    whole = evaluate(terms, rows, loads, phi)
    shuffled = generator.permutation(rows.shape[1])
    again = evaluate(terms, rows[:, shuffled], loads[shuffled], phi[shuffled])
    np.testing.assert_array_equal(again, whole[:, shuffled])
    alone = evaluate(terms, rows[:, 7:8], loads[7:8], phi[7:8])
    np.testing.assert_array_equal(alone[:, 0], whole[:, 7])


def test_products_are_made_from_products_with_one_factor_less():
    terms = random_terms(np.random.default_rng(4), 60, 1, size=1.0)
    plan = plan_of(terms, ALL)
    assert np.all(plan.parents[1:] < np.arange(1, len(plan.parents)))
    made = np.zeros((len(plan.parents), len(ROW_AXES)), dtype=int)
    for k, (parent, factor) in enumerate(zip(plan.parents, plan.factors, strict=True)):
        axis = np.searchsorted(plan.starts, factor, side="right") - 1
        made[k] = made[parent]
        made[k, axis] += factor - plan.starts[axis]
    found = {
        (*made[product].tolist(), *divmod(slot, plan.n_orders), a)
        for slot, products, coefficients in zip(
            plan.slots.tolist(), plan.products, plan.coefficients[:, 0], strict=True
        )
        for product, a in zip(products, coefficients.tolist(), strict=True)
        if a != 0.0
    }
    wanted = {
        (*row[list(ROW_AXES)].tolist(), int(row[SLACK]), int(row[0]), a)
        for row, a in zip(terms.orders, terms.coefficients[0].tolist(), strict=True)
    }
    assert found == wanted


@pytest.mark.parametrize("axis", range(13))
def test_derivatives_of_terms_are_terms(axis):
    generator = np.random.default_rng(axis)
    terms = random_terms(generator, 80, 2, size=1.0)
    h, point = 1e-5, generator.uniform(-0.9, 0.9, 13)
    step = h * (np.arange(13) == axis)
    slope = (slow_sum(terms, point + step) - slow_sum(terms, point - step)) / (2 * h)
    np.testing.assert_allclose(slow_sum(terms.derivative(axis), point), slope, rtol=1e-7, atol=1e-8)


def test_stacked_terms_keep_their_outputs():
    generator = np.random.default_rng(5)
    parts = [random_terms(generator, n, outputs, size=1.0) for n, outputs in ((30, 1), (40, 2))]
    both = stacked(parts)
    assert len(both.orders) == len(np.unique(both.orders, axis=0))
    point = generator.uniform(-1.0, 1.0, 13)
    want = np.concatenate([slow_sum(part, point) for part in parts])
    np.testing.assert_allclose(slow_sum(both, point), want, rtol=1e-12)
    np.testing.assert_allclose(slow_sum(both.output(2), point), want[2:], rtol=1e-12)


@pytest.mark.parametrize(("orders", "outputs"), [((4, 12), (1, 4)), ((4, 13), (1, 5))])
def test_tables_of_the_wrong_shape_are_refused(orders, outputs):
    with pytest.raises(ValueError, match="columns"):
        Terms(np.zeros(orders, dtype=np.int64), np.zeros(outputs))
