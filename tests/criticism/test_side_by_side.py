"""Work in parts is the same wherever the parts are done."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest

from bayesdeg.criticism.fit.side_by_side import PARTS, apply, later


def drawn(scale, seed):
    return scale * np.random.default_rng(seed).standard_normal(3)


@pytest.mark.parametrize("count", [0, 1, PARTS - 1, PARTS, 11])
def test_results_are_those_of_a_loop_in_its_order(count):
    work, items = partial(drawn, 2.0), list(range(count))
    want = [work(item) for item in items]
    with ThreadPoolExecutor(3) as threads:
        for executor in (None, threads):
            np.testing.assert_array_equal(apply(work, items, executor), want)


@pytest.mark.slow
def test_processes_give_the_same_bits():
    work, items = partial(drawn, 2.0), list(range(9))
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        np.testing.assert_array_equal(apply(work, items, executor), apply(work, items))
        np.testing.assert_array_equal(later(partial(drawn, 1.0, 5), executor)(), drawn(1.0, 5))


def test_what_fails_elsewhere_fails_where_it_is_waited_for():
    with ThreadPoolExecutor(1) as executor:
        waiting = later(partial(int, "nothing"), executor)
        with pytest.raises(ValueError, match="nothing"):
            waiting()
