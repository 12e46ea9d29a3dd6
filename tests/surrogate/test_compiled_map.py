"""The compiled map over batches of rows; its values are tested with the surrogate."""

import dataclasses

import numpy as np
import pytest

from bayesdeg.surrogate.terms import BLOCK
from tests.surrogate.term_sums import OPTIONAL, random_inputs, small_surrogate


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
