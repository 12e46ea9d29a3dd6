"""Criteria of rupture: what a wall's state is alike to in uniaxial tension."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from bayesdeg.data.settings import RUPTURE_CRITERIA, parse_settings
from bayesdeg.material.hyperelastic import Yeoh, cauchy_stress
from bayesdeg.material.strength import (
    energy_equivalent_stretch,
    equivalent_uniaxial_stretch,
    uniaxial_stretch,
    wall_state,
)

YEOH = (0.288, -0.004, 0.0012)
stretches = st.floats(1.0, 4.0)


POINTWISE = [one for one in RUPTURE_CRITERIA if one != "weakest_link"]


@given(stretches, st.floats(-0.5, 1.0))
def test_walls_keep_their_volume_and_are_stretched_most_along_the_first_axis(stretch, b):
    state = wall_state(stretch, b)
    assert np.prod(state) == pytest.approx(1.0)
    assert state.max() == pytest.approx(stretch)


@given(stretches, st.floats(-0.5, 1.0))
def test_the_uniaxial_state_of_an_energy_has_that_energy(stretch, b):
    state = wall_state(stretch, b)
    found = float(energy_equivalent_stretch(state))
    assert found**2 + 2.0 / found == pytest.approx(np.sum(state**2), rel=1e-9)
    assert found >= 1.0


@given(stretches)
@pytest.mark.parametrize("criterion", POINTWISE)
def test_in_uniaxial_tension_all_criteria_are_one(criterion, stretch):
    state = wall_state(stretch, -0.5)
    found = equivalent_uniaxial_stretch(state, criterion, Yeoh(*YEOH))
    assert float(found) == pytest.approx(stretch, abs=1e-5)


def test_the_more_biaxial_a_wall_the_more_its_energy_counts():
    b = np.linspace(-0.5, 1.0, 7)
    assert np.all(np.diff(energy_equivalent_stretch(wall_state(1.5, b))) > 0.0)


@given(stretches, st.floats(1.0, 4.0))
def test_the_uniaxial_stretch_of_a_stress_is_that_of_the_library(stretch, start):
    """The root finder of the library is another way to the same stretch."""
    law = Yeoh(*YEOH)
    stress = float(cauchy_stress(law, stretch, mode="uniaxial"))
    found = float(uniaxial_stretch(law, stress, start=start))
    other = optimize.brentq(
        lambda one: float(cauchy_stress(law, one, mode="uniaxial")) - stress, 0.5, 8.0, xtol=1e-13
    )
    assert found == pytest.approx(other, abs=1e-7)


def test_a_stress_that_no_stretch_has_is_no_number():
    assert np.isnan(uniaxial_stretch(Yeoh(0.3, -0.5, 0.0), 1e3))


def test_the_volume_of_a_film_can_be_given():
    settings, faults = parse_settings(b"[rupture]\nfilm_volume = 120.0\n")
    assert (faults, settings.rupture.film_volume) == ((), 120.0)
    _, faults = parse_settings(b"[rupture]\nfilm_volume = 0.0\n")
    assert len(faults) == 1


@pytest.mark.parametrize("criterion", RUPTURE_CRITERIA)
def test_a_study_chooses_its_criterion(criterion):
    settings, faults = parse_settings(f'[rupture]\ncriterion = "{criterion}"\n'.encode())
    assert faults == ()
    assert settings.rupture.criterion == criterion


def test_another_criterion_is_refused_with_those_that_there_are():
    _, faults = parse_settings(b'[rupture]\ncriterion = "von_mises"\n')
    assert len(faults) == 1
    assert all(name in str(faults[0]) for name in RUPTURE_CRITERIA)
