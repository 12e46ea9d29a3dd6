"""Criteria of rupture: what a wall's state is alike to in uniaxial tension."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.data.settings import RUPTURE_CRITERIA, parse_settings
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    energy_equivalent_stretch,
    equivalent_uniaxial_stretch,
    wall_state,
)
from bayesdeg.observations.specimens import WALL_BIAXIALITY, WALL_ERROR, wall_demand

YEOH = (0.288, -0.004, 0.0012)
stretches = st.floats(1.0, 4.0)


def prediction(stretch, sd=0.01):
    stretch = np.asarray(stretch, dtype=float)
    zero = np.zeros_like(stretch)
    return Prediction(
        *(zero, zero, stretch, zero, zero, zero),
        np.full_like(stretch, sd),
        np.zeros(stretch.shape, int),
    )


def inputs(shape):
    one = np.ones(shape)
    return Inputs(240.0 * one, *(c * one for c in YEOH), 0.85 * one, 3e4 * one)


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
@pytest.mark.parametrize("criterion", RUPTURE_CRITERIA)
def test_in_uniaxial_tension_all_criteria_are_one(criterion, stretch):
    state = wall_state(stretch, -0.5)
    found = equivalent_uniaxial_stretch(state, criterion, Yeoh(*YEOH))
    assert float(found) == pytest.approx(stretch, abs=1e-5)


def test_the_more_biaxial_a_wall_the_more_its_energy_counts():
    b = np.linspace(-0.5, 1.0, 7)
    assert np.all(np.diff(energy_equivalent_stretch(wall_state(1.5, b))) > 0.0)


def test_by_the_principal_stretch_nothing_is_changed():
    given_ = prediction([[[1.2, 1.5]]])
    assert wall_demand("principal_stretch", inputs((1, 1, 2)), given_) is given_


@pytest.mark.parametrize("criterion", RUPTURE_CRITERIA[1:])
def test_the_demand_of_a_wall_is_that_of_the_library(criterion):
    """The root finder of the library is another way to the same stretch."""
    peak = np.linspace(1.0, 3.0, 9)[None, None]
    found = wall_demand(criterion, inputs(peak.shape), prediction(peak))
    wall = wall_state(peak, WALL_BIAXIALITY[criterion])
    expected = equivalent_uniaxial_stretch(wall, criterion, Yeoh(*YEOH))
    np.testing.assert_allclose(found.peak_stretch, expected, rtol=1e-6)
    assert np.all(found.peak_stretch[..., 1:] > peak[..., 1:])
    least = WALL_ERROR[criterion] * (found.peak_stretch - 1.0)
    assert np.all(found.peak_stretch_sd >= least)


@pytest.mark.parametrize("criterion", RUPTURE_CRITERIA)
def test_a_study_chooses_its_criterion(criterion):
    settings, faults = parse_settings(f'[rupture]\ncriterion = "{criterion}"\n'.encode())
    assert faults == ()
    assert settings.rupture_criterion == criterion


def test_another_criterion_is_refused_with_those_that_there_are():
    _, faults = parse_settings(b'[rupture]\ncriterion = "von_mises"\n')
    assert len(faults) == 1
    assert all(name in str(faults[0]) for name in RUPTURE_CRITERIA)
