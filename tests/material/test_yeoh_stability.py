"""Stability of Yeoh's solid."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from bayesdeg.material.degradation import satisfies_baker_ericksen


@given(
    c1=st.floats(-1.0, 2.0),
    c2=st.floats(-2.0, 2.0),
    c3=st.floats(-0.5, 1.0),
)
def test_baker_ericksen_agrees_with_the_smallest_slope(c1, c2, c3):
    lowest = c1
    if c3 > 0.0 and c2 < 0.0:
        lowest = min(lowest, c1 - c2**2 / (3.0 * c3))
    assume(abs(lowest) > 1e-9)
    falls_for_ever = c3 < 0.0 or (c3 == 0.0 and c2 < 0.0)
    assert bool(satisfies_baker_ericksen(c1, c2, c3)) is (lowest > 0.0 and not falls_for_ever)


@given(c1=st.floats(0.01, 3.0), c3=st.floats(1e-5, 3.0))
def test_baker_ericksen_bound_is_sharp(c1, c3):
    bound = -float(np.sqrt(3.0 * c1 * c3))
    x_lowest = -bound / (3.0 * c3)
    for factor, stable in ((0.9999, True), (1.0001, False)):
        c2 = factor * bound
        assert bool(satisfies_baker_ericksen(c1, c2, c3)) is stable
        assert (c1 + 2.0 * c2 * x_lowest + 3.0 * c3 * x_lowest**2 > 0.0) is stable


def test_neo_hookean_solid_is_stable():
    assert bool(satisfies_baker_ericksen(0.3, 0.0, 0.0))


def test_walkers_are_judged_one_by_one():
    stable = satisfies_baker_ericksen(np.ones(3), [-0.1, -0.2, 0.0], 0.01)
    np.testing.assert_array_equal(stable, [True, False, True])
