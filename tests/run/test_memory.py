"""Peaks of memory are those of the processes that worked, and stay when memory is given back."""

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from bayesdeg.run.run_record import peaks_of_memory

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems do not say")
LARGE = 400.0  # MB


def touched():
    """Use memory, all of it, and give it back."""
    return float(np.ones(int(LARGE * 1e6 / 8)).sum())


def test_the_peak_stays_and_grows_by_what_was_used():
    before = peaks_of_memory()["main process"]
    touched()
    after = peaks_of_memory("update")
    assert "main process" not in after
    assert after["update"] >= max(LARGE, before)


def test_the_largest_worker_is_found():
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        pool.submit(touched).result()
        found = peaks_of_memory()
    assert found["largest worker"] >= LARGE
