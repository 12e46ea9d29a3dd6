"""Stability of Yeoh's solid: published bounds, and brute force over strains."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bayesdeg.material.degradation import (
    is_monotone,
    satisfies_baker_ericksen,
    smallest_monotone_ratio,
    smallest_positive_ratio,
)
from bayesdeg.material.hyperelastic import EXPONENTS, Yeoh, nominal_stress

RATIOS = np.array([0.001, 0.01, 0.1])


def test_equibiaxial_bounds():
    bounds = smallest_monotone_ratio(RATIOS, largest_stretch=3.2, mode="equibiaxial")
    np.testing.assert_allclose(bounds, [-0.0375, -0.114, -0.368], rtol=0.005)


def test_equibiaxial_is_stricter_than_planar_uniaxial_and_baker_ericksen():
    bounds = [
        smallest_monotone_ratio(RATIOS, largest_stretch=3.2, mode=mode)
        for mode in ("equibiaxial", "planar", "uniaxial")
    ]
    bounds.append(smallest_positive_ratio(RATIOS))
    assert np.all(np.diff(bounds, axis=0) < 0.0)


@pytest.mark.parametrize("mode", EXPONENTS)
def test_bound_loosens_as_less_stretch_is_asked_for(mode):
    bounds = [
        smallest_monotone_ratio(0.01, largest_stretch=largest, mode=mode)
        for largest in (1.1, 1.2, 1.3)
    ]
    assert bounds[0] < bounds[1] < bounds[2]


@pytest.mark.parametrize("mode", EXPONENTS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_stress_falls_just_beyond_the_bound_and_not_before(mode, ratio):
    bound = float(smallest_monotone_ratio(ratio, largest_stretch=3.2, mode=mode))
    stretches = np.linspace(1.0, 3.2, 20001)
    for factor, rises in ((0.999, True), (1.001, False)):
        stress = nominal_stress(Yeoh(1.0, factor * bound, ratio), stretches, mode=mode)
        assert bool(np.all(np.diff(stress) > 0.0)) is rises
        assert (
            bool(is_monotone(1.0, factor * bound, ratio, largest_stretch=3.2, mode=mode)) is rises
        )


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
    bound = c1 * float(smallest_positive_ratio(c3 / c1))
    x_lowest = -bound / (3.0 * c3)
    for factor, stable in ((0.9999, True), (1.0001, False)):
        c2 = factor * bound
        assert bool(satisfies_baker_ericksen(c1, c2, c3)) is stable
        assert (c1 + 2.0 * c2 * x_lowest + 3.0 * c3 * x_lowest**2 > 0.0) is stable


def test_neo_hookean_solid_is_stable():
    assert bool(satisfies_baker_ericksen(0.3, 0.0, 0.0))
    assert bool(is_monotone(0.3, 0.0, 0.0, largest_stretch=4.0, mode="equibiaxial"))


def test_walkers_are_judged_one_by_one():
    stable = is_monotone(
        np.ones(3), [-0.1, -0.12, 0.0], 0.01, largest_stretch=3.2, mode="equibiaxial"
    )
    np.testing.assert_array_equal(stable, [True, False, True])


def test_stretch_must_exceed_one():
    with pytest.raises(ValueError, match="above 1"):
        smallest_monotone_ratio(0.01, largest_stretch=1.0, mode="uniaxial")
