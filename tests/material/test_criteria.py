"""Failure criteria: coincide in uniaxial tension, closed forms and order elsewhere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.material.hyperelastic import EXPONENTS, Yeoh, cauchy_stress, principal_stretches
from bayesdeg.material.strength import (
    CRITERIA,
    equivalent_uniaxial_stretch,
    largest_cauchy_stress,
    utilisation,
)

LAW = Yeoh(0.288, -0.01, 0.002)
STRETCHES = np.array([1.0, 1.0 + 1e-8, 1.01, 1.2, 1.5, 2.0, 3.1])


@pytest.mark.parametrize("criterion", CRITERIA)
def test_all_coincide_in_uniaxial_tension(criterion):
    states = principal_stretches(STRETCHES, "uniaxial")
    np.testing.assert_allclose(
        equivalent_uniaxial_stretch(states, criterion, LAW), STRETCHES, rtol=1e-10
    )
    np.testing.assert_allclose(
        utilisation(states, STRETCHES[-1], criterion=criterion, law=LAW),
        (STRETCHES - 1.0) / (STRETCHES[-1] - 1.0),
        atol=1e-10,
    )


@pytest.mark.parametrize("mode", EXPONENTS)
def test_largest_stress_is_that_of_the_mode(mode):
    states = principal_stretches(STRETCHES, mode)
    np.testing.assert_allclose(
        largest_cauchy_stress(LAW, states),
        cauchy_stress(LAW, STRETCHES, mode=mode),
        rtol=1e-7,
        atol=1e-14,
    )


@pytest.mark.parametrize(("mode", "power"), [("equibiaxial", 2.0), ("planar", 2.0 / 3.0**0.5)])
def test_equivalent_strain_has_a_closed_form(mode, power):
    states = principal_stretches(STRETCHES, mode)
    np.testing.assert_allclose(
        equivalent_uniaxial_stretch(states, "equivalent_strain"), STRETCHES**power, rtol=1e-13
    )


@pytest.mark.parametrize(("mode", "share"), [("equibiaxial", 2.0), ("planar", 4.0 / 3.0)])
def test_equivalent_stretch_by_stress_in_the_small_strain_limit(mode, share):
    equivalent = equivalent_uniaxial_stretch(
        principal_stretches(1.0 + 1e-6, mode), "cauchy_stress", LAW
    )
    assert (float(equivalent) - 1.0) / 1e-6 == pytest.approx(share, rel=1e-4)


@pytest.mark.parametrize("mode", ["equibiaxial", "planar"])
@given(stretch=st.floats(1.05, 3.0), hardening=st.floats(0.0, 0.05))
def test_principal_stretch_is_the_mildest_criterion(mode, stretch, hardening):
    state = principal_stretches(stretch, mode)
    mildest, by_stress, by_strain = (
        float(equivalent_uniaxial_stretch(state, criterion, Yeoh(0.3, 0.0, hardening)))
        for criterion in CRITERIA
    )
    assert mildest == pytest.approx(stretch)
    assert mildest < by_stress
    assert mildest < by_strain
    if mode == "equibiaxial":
        assert by_stress < by_strain


def test_equivalent_stretch_gives_back_the_stress_for_each_walker():
    walkers = Yeoh(np.array([[0.2], [0.4]]), -0.01, 0.01)
    states = principal_stretches(STRETCHES, "planar")
    equivalent = equivalent_uniaxial_stretch(states, "cauchy_stress", walkers)
    assert equivalent.shape == (2, STRETCHES.size)
    np.testing.assert_allclose(
        cauchy_stress(walkers, equivalent, mode="uniaxial"),
        largest_cauchy_stress(walkers, states),
        rtol=1e-9,
        atol=1e-12,
    )


def test_faults_are_named():
    state = [1.5, 1.0, 1.0 / 1.5]
    with pytest.raises(ValueError, match="unknown criterion 'tresca'"):
        equivalent_uniaxial_stretch(state, "tresca")
    with pytest.raises(ValueError, match="material's law"):
        equivalent_uniaxial_stretch(state, "cauchy_stress")
    with pytest.raises(ValueError, match="above 1"):
        utilisation(state, 1.0)
