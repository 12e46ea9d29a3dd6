"""The choice of further runs, against refits of the normal matrix."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.surrogate.coordinates import coordinates
from bayesdeg.surrogate.design import SHARES, space_filling
from bayesdeg.surrogate.regression import DERIVATIVE_WEIGHT, Prior, half_ranges
from bayesdeg.surrogate.scaling import NAMES, Place, TrainingRange
from bayesdeg.surrogate.terms import Family, Terms, features
from benchmarks.second_stage import Question, most_informative

SPAN = TrainingRange()
# without slack, whose coordinate has a corner at tight paper
ORDERS = Family((2, 1, 2, 0), (1, 0, 0, 0), (1, 1, 0, 0, 1, 0, 0, 1, 1)).orders
PRIOR = Prior(noise=0.2)
SCALES = PRIOR.scales(ORDERS)
LOADS = (0.1, 0.2, 0.35)


def curves(count, seed):
    return [replace(curve, loads=LOADS) for curve in space_filling(SPAN, count, seed=seed)]


CANDIDATES, LIKELY = curves(24, 1), curves(16, 2)


def groups_at(curve):
    place = Place.of(curve.material)
    loads = np.array(SHARES) * curve.loads[-1] / place.modulus
    return np.column_stack([loads, np.tile(place.values, (3, 1))])


def basis(groups):
    return SCALES * features(ORDERS, coordinates(groups).points)


def equations(curve):
    """Weighted values and derivatives of a run, the latter by central differences."""
    groups, shares = groups_at(curve), np.array(SHARES)[:, None]
    rows = [shares * basis(groups)]
    for axis, size in enumerate(half_ranges(SPAN)):
        step = np.zeros(len(NAMES))
        step[axis] = 1e-5 * size
        slope = (basis(groups + step) - basis(groups - step)) / 2e-5
        rows.append(DERIVATIVE_WEIGHT * shares * slope)
    return np.vstack(rows)


def question(seed, *, errors=None):
    runs = [equations(curve) for curve in curves(3, seed)]
    normal = sum(rows.T @ rows for rows in runs)
    level = Terms(np.zeros((1, len(NAMES)), dtype=np.int64), np.array([[-8.0], [5.0]]))
    return Question(ORDERS, PRIOR, normal, errors or level)


def mean_variance(normal, weights):
    """Mean over the draws of what studies ask for, by the inverse of the whole matrix."""
    wanted = np.vstack([basis(groups_at(curve)) for curve in LIKELY])
    inverse = np.linalg.inv(normal + PRIOR.noise**2 * np.eye(len(SCALES)))
    return np.mean(weights * np.einsum("nt,ts,ns->n", wanted, inverse, wanted))


def plain_weights():
    return np.tile(np.square(SHARES), len(LIKELY))


def lowered(normal, weights):
    """By how much each candidate lowers the mean variance, its equations refitted one by one."""
    before = mean_variance(normal, weights)
    return np.array(
        [
            sum(
                before - mean_variance(normal + np.outer(row, row), weights)
                for row in basis(groups_at(curve))
            )
            for curve in CANDIDATES
        ]
    )


def lowered_by_runs(normal, weights):
    """By how much each candidate lowers it with all its values and derivatives at once."""
    before = mean_variance(normal, weights)
    runs = [equations(curve) for curve in CANDIDATES]
    return np.array([before - mean_variance(normal + r.T @ r, weights) for r in runs])


def pick(asked, count):
    return most_informative(asked, CANDIDATES, count, likely=LIKELY, span=SPAN)


@pytest.mark.parametrize("seed", range(3, 9))
def test_the_pick_lowers_the_mean_variance_most(seed):
    asked = question(seed)
    gain = lowered(asked.normal, plain_weights())
    assert pick(asked, 1) == [int(np.argmax(gain))]
    assert np.max(gain) > 1.2 * np.median(gain)  # there is something to choose


@pytest.mark.parametrize("seed", range(3, 6))
def test_each_pick_is_made_in_view_of_those_before(seed):
    asked = question(seed)
    normal, picked = asked.normal.copy(), []
    for _ in range(4):
        gain = lowered(normal, plain_weights())
        gain[picked] = 0.0
        picked.append(int(np.argmax(gain)))
        rows = equations(CANDIDATES[picked[-1]])
        normal = normal + rows.T @ rows
    assert pick(asked, 4) == picked


@pytest.mark.parametrize("seed", range(3, 15))
def test_a_whole_run_that_is_picked_lowers_it_nearly_as_much_as_any(seed):
    """The choice adds up single equations; values and derivatives at once may change its order."""
    asked = question(seed)
    gain = lowered_by_runs(asked.normal, plain_weights())
    assert gain[pick(asked, 1)[0]] > 0.9 * np.max(gain)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_variance_counts_where_errors_of_the_first_output_were_large(sign):
    """ln of squared errors −8 ± 6 T₁ of ln(C3/M), given as the first of two outputs."""
    orders = np.zeros((2, len(NAMES)), dtype=np.int64)
    orders[1, NAMES.index("log_stiffening")] = 1
    asked = question(3, errors=Terms(orders, np.array([[-8.0, 6.0 * sign], [0.0, 0.0]])))
    groups = np.vstack([groups_at(curve) for curve in LIKELY])
    place = coordinates(groups).points[:, NAMES.index("log_stiffening")]
    weights = plain_weights() * np.exp(-8.0 + 6.0 * sign * place)
    picked = pick(asked, 1)
    assert picked == [int(np.argmax(lowered(asked.normal, weights)))]
    opposite = plain_weights() * np.exp(-8.0 - 6.0 * sign * place)
    assert picked != [int(np.argmax(lowered(asked.normal, opposite)))]


def test_all_are_picked_once_and_told_of_in_order_and_the_question_stays_as_it_was():
    asked, told = question(3), []
    normal = asked.normal.copy()
    picked = most_informative(
        asked, CANDIDATES, len(CANDIDATES), likely=LIKELY, span=SPAN, on_pick=told.append
    )
    assert sorted(picked) == list(range(len(CANDIDATES)))
    assert told == picked
    np.testing.assert_array_equal(asked.normal, normal)
