"""The compiled map: over batches of rows, at all loads, and where curves end.

Its values are compared with its formulae in `test_surrogate`.
"""

import dataclasses

import numpy as np
import pytest

from bayesdeg.surrogate.coordinates import Batch, coordinates
from bayesdeg.surrogate.terms import BLOCK, features
from tests.surrogate.closed_form import trained
from tests.surrogate.term_sums import (
    END,
    LARGEST,
    OPTIONAL,
    SPAN,
    random_inputs,
    small_surrogate,
    taken,
)

SLACK = [(), ("paper_slack",), ("skin", "paper_slack")]
MAPS = pytest.mark.parametrize("surrogate", [small_surrogate(), trained()], ids=["random", "fit"])


def materials(given, count=12):
    """Inputs of materials, and their groups."""
    inputs = random_inputs(np.random.default_rng(21), (count,), given=given)
    return inputs, Batch.of(inputs, SPAN).groups[1:].T


def loads_at(surrogate, groups, swelling):
    """p/M at swellings (n,) of each row of groups, by sums of the terms, (n_rows, n)."""
    rows = np.column_stack(
        [np.tile(swelling, len(groups)), np.repeat(groups, len(swelling), axis=0)]
    )
    y = features(surrogate.load.orders, coordinates(rows).points) @ surrogate.load.coefficients[0]
    return (rows[:, 0] * np.exp(y)).reshape(len(groups), -1)


def ends_of(surrogate, inputs):
    """p/M at the first maximum, inf without one in the range, and up to which it is answered."""
    batch = Batch.of(inputs, SPAN)
    rows, ln_t = np.arange(len(batch.within)), np.linspace(0.0, np.log1p(LARGEST), 1001)
    loads = loads_at(surrogate, batch.groups[1:].T, np.expm1(ln_t))
    falls = np.diff(loads, axis=1) < 0.0
    has_limit = falls.any(axis=1)
    top = np.where(has_limit, falls.argmax(axis=1), len(ln_t) - 1)
    highest = loads[rows, top]
    # of the parabola through three
    low, high = loads[rows, top - 1] - highest, loads[rows, np.minimum(top + 1, 1000)] - highest
    with np.errstate(invalid="ignore", divide="ignore"):
        rise = -((high - low) ** 2) / (8.0 * (high + low))
    highest = highest + np.where(has_limit, rise, 0.0)
    largest = batch.largest_load(SPAN)
    limit = np.where(has_limit & (highest <= largest), highest, np.inf)
    return limit, np.minimum(np.where(has_limit, END * highest, highest), largest)


def at_loads(inputs, loads):
    """The same materials at p/M."""
    one = inputs.pressure / Batch.of(inputs, SPAN).loads
    return dataclasses.replace(inputs, pressure=one * loads)


@MAPS
@pytest.mark.parametrize("given", SLACK)
def test_the_swelling_at_a_load_has_that_load(surrogate, given):
    """From a millionth of the end to the end itself, which mostly is one by ballooning."""
    inputs, groups = materials(given)
    limit, end = ends_of(surrogate, inputs)
    assert np.isfinite(limit).sum() > 3
    for share in (1e-6, 1e-3, 0.1, 0.4, 0.7, 0.9, 0.97, 0.99, 1.0 - 1e-6):
        swelling = surrogate.swelling(groups, share * end)
        found = [
            loads_at(surrogate, groups[k : k + 1], swelling[k : k + 1])[0, 0]
            for k in range(len(end))
        ]
        # places are rounded on [-1, 1]: of a swelling of 1e-6 the last six digits are lost
        np.testing.assert_allclose(found, share * end, rtol=1e-10 if share > 1e-6 else 2e-9)


@MAPS
@pytest.mark.parametrize("given", SLACK)
def test_a_limit_is_the_first_maximum_of_the_load(surrogate, given):
    inputs, _ = materials(given)
    wanted, _ = ends_of(surrogate, inputs)
    limit = surrogate.limit_pressure(inputs).pressure
    one = inputs.pressure / Batch.of(inputs, SPAN).loads
    np.testing.assert_allclose(limit, one * wanted[:, None], rtol=2e-7)


@MAPS
@pytest.mark.parametrize("given", SLACK)
def test_slopes_are_those_of_differences_up_to_the_end(surrogate, given):
    inputs, _ = materials(given)
    inputs = dataclasses.replace(inputs, asked="cavity_volume")
    _, end = ends_of(surrogate, inputs)
    inputs = at_loads(inputs, end[:, None] * np.array([0.01, 0.1, 0.5, 0.9, 0.99]))
    h = 1e-6
    here, up, down = (
        surrogate(dataclasses.replace(inputs, pressure=inputs.pressure * (1.0 + step)))
        for step in (0.0, h, -h)
    )
    difference = (up.curvature - down.curvature) / (2.0 * h)
    np.testing.assert_allclose(here.slope, difference, rtol=1e-6)
    difference = (up.further.value - down.further.value) / (2.0 * h)
    np.testing.assert_allclose(here.further.slope, difference, rtol=1e-6)


@MAPS
@pytest.mark.parametrize("given", SLACK)
def test_curves_go_on_beyond_their_end_with_value_and_slope(surrogate, given):
    inputs, _ = materials(given)
    limit = surrogate.limit_pressure(inputs).pressure
    known = np.isfinite(limit[:, 0])
    inputs, end = taken(inputs, known), END * limit[known]
    assert len(end) > 3
    h = 1e-7
    at = np.array([1.0 - 2.0 * h, 1.0 - h, 1.0 + h, 1.0 + 2.0 * h])
    inputs = dataclasses.replace(inputs, pressure=end * at, asked="cavity_volume")
    answered, found = surrogate(inputs), surrogate.continued(inputs)
    assert np.all(answered.status[:, :2] == 0)
    assert np.all(answered.status[:, 2:] != 0)
    for value in (found.curvature, found.bend_angle, found.peak_stretch, found.further.value):
        growth = np.diff(value, axis=1) / np.diff(at) / value[:, :1]
        assert np.all(growth < 100.0)  # without a jump; it is some 20
        if value is found.curvature or value is found.further.value:
            np.testing.assert_allclose(growth[:, 1:], growth[:, :1].repeat(2, 1), rtol=1e-3)
    np.testing.assert_allclose(found.slope[:, 2:], found.slope[:, 1:2].repeat(2, 1), rtol=1e-4)
    assert np.all(found.excess[:, :2] == 0.0)
    assert np.all(found.excess[:, 2:] > 0.0)


@pytest.mark.parametrize("given", [(), ("paper_slack",), ("skin", "weight_up"), sorted(OPTIONAL)])
def test_neither_the_number_of_rows_nor_their_order_changes_a_result(given):
    surrogate = small_surrogate()
    inputs = random_inputs(np.random.default_rng(2), (BLOCK + 5,), given=given, columns=3)
    whole = surrogate(inputs)
    order = np.arange(BLOCK + 5)[::-1]
    fields = {
        field.name: value[order] if isinstance(value, np.ndarray) else value
        for field in dataclasses.fields(inputs)
        for value in [getattr(inputs, field.name)]
    }
    turned = surrogate(dataclasses.replace(inputs, **fields))
    for field in dataclasses.fields(whole):
        forth, back = getattr(whole, field.name), getattr(turned, field.name)
        if forth is None:  # it was not asked for
            assert back is None
            continue
        # the rest of a block may be rounded otherwise, on processors that fuse products and sums
        np.testing.assert_array_max_ulp(back, forth[order], maxulp=4)
