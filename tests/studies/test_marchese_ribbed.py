"""A real ribbed segment of silicone: which readings are judged, and by what.

Data: Marchese, Katzschmann and Rus (2015), doi:10.1089/soro.2014.0022.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.data.study import read_study
from bayesdeg.surrogate.trained import read_trained, surrogate_for

FOLDER = Path(__file__).resolve().parents[2] / "studies/marchese_ribbed"


@pytest.fixture(scope="module")
def study():
    return read_study(FOLDER)


def test_length_and_cover_are_priors_that_the_emulator_covers(study, emulator):
    length, cover = study.settings.uncertain
    assert length.low < 37.8 < 43.0 < length.high
    assert cover.high < 6.15  # above, slits 3.1 mm deep would cut the film in the middle
    for one in (length, cover):
        assert emulator.departure.covers(one.name, one.low, one.high)


@pytest.fixture(scope="module")
def emulator(study):
    """The one that is stored beside the study; refused if it were of another segment."""
    return surrogate_for(geometry_of_study(study.settings), read_trained(FOLDER / "emulator.npz"))


def test_readings_that_are_judged_are_the_first_of_all():
    judged, every = (
        pd.read_csv(FOLDER / name, comment="#") for name in ("actuator.csv", "all_readings.csv")
    )
    columns = ["pressure_kPa", "curvature_per_m"]
    pd.testing.assert_frame_equal(judged[columns], every[columns].head(len(judged)))
    assert len(every) == 15


def test_the_model_ends_between_the_judged_readings_and_the_last_one(emulator):
    one = np.ones((1, 1))
    sizes = {"length": 43.0 * one, "cover": 5.65 * one}
    asked = Inputs(
        14.35 * one, 8.6e-3 * one, 8e-5 * one, 9e-6 * one, one, 6e3 * one, dimensions=sizes
    )
    limit = emulator.limit_pressure(asked).pressure.item()
    assert 14.35 < limit < 32.45
    assert emulator(asked).curvature.item() == pytest.approx(2.46, rel=0.3)
