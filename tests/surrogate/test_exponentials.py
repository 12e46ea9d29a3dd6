"""Exponentials as vectors against those of the library."""

import numpy as np

from bayesdeg.surrogate.surrogate import exponentials


def test_exponentials_are_those_of_the_library():
    generator = np.random.default_rng(0)
    values = np.concatenate(
        [generator.uniform(-700.0, 700.0, 5000), generator.normal(size=5000), [0.0, -0.0, 1.0]]
    )
    got = values.copy()
    exponentials(got)
    np.testing.assert_allclose(got, np.exp(values), rtol=1e-15)
    assert got[-3] == got[-2] == 1.0


def test_exponentials_beyond_the_range_of_numbers_are_its_ends_and_nan_stays():
    got = np.array([-np.inf, -1e4, 1e4, np.inf, np.nan])
    exponentials(got)
    np.testing.assert_allclose(got, [np.exp(-700.0)] * 2 + [np.exp(700.0)] * 2 + [np.nan])
