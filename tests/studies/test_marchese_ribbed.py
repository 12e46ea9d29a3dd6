"""A real ribbed segment of silicone: which readings are judged, and by what.

Data: Marchese, Katzschmann and Rus (2015), doi:10.1089/soro.2014.0022.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdeg.actuator.curve import SAMPLING, Curve, sample_task
from bayesdeg.actuator.families import geometry_of_study, with_dimensions
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.data.study import read_study
from bayesdeg.surrogate.kept import local_recipe

FOLDER = Path(__file__).resolve().parents[2] / "studies/marchese_ribbed"


@pytest.fixture(scope="module")
def study():
    return read_study(FOLDER)


def test_length_and_cover_are_priors(study):
    length, cover = study.settings.uncertain
    assert length.low < 37.8 < 43.0 < length.high
    assert cover.high < 6.15  # above, slits 3.1 mm deep would cut the film in the middle


def test_readings_that_are_judged_are_the_first_of_all():
    judged, every = (
        pd.read_csv(FOLDER / name, comment="#") for name in ("actuator.csv", "all_readings.csv")
    )
    columns = ["pressure_kPa", "curvature_per_m"]
    pd.testing.assert_frame_equal(judged[columns], every[columns].head(len(judged)))
    assert len(every) == 15


@pytest.mark.fem
@pytest.mark.slow
def test_the_model_has_equilibria_beyond_the_judged_readings_but_not_to_the_last_one(study):
    shape = with_dimensions(geometry_of_study(study.settings), {"length": 43.0, "cover": 5.65})
    c1, pressures = 8.6e-3, np.array([5.0, 14.35, 32.45])
    material = MaterialGroups(c2_ratio=8e-5 / c1, c3_ratio=9e-6 / c1, paper_group=6.0 / c1)
    curve = Curve(tuple(1e-3 * pressures / c1), material)
    mesh = local_recipe(study.settings.dimensions).coarse_mesh
    path = sample_task((shape, mesh, curve), effort=replace(SAMPLING, total=400))
    pressure = 1e3 * c1 * path.loads
    assert 14.35 < pressure.max() < 32.45
    kappa = 1e3 * path.readings[:, 0] / path.readings[:, 1]
    assert np.interp(14.35, pressure, kappa - kappa[0]) == pytest.approx(2.64, rel=0.05)
