"""The study of the published actuator: it reads, and its statistics are those published."""

from pathlib import Path

import numpy as np
import pytest

from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import design_of
from bayesdeg.laboratory.truth import Truth

FOLDER = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"


@pytest.fixture(scope="module")
def study():
    return read_study(FOLDER)


def rows(study, quantity):
    table = study.summary[study.summary["quantity"] == quantity]
    return table["degradation_pct"].tolist(), table["value"].tolist()


def test_it_is_marked_as_virtual_and_says_where_every_statistic_stands(study):
    assert study.settings.virtual
    assert study.settings.seed == 20211124
    assert study.settings.noise.degradation_sd_pct == 0.5
    assert study.summary["source"].str.contains("doi:10.3389/frobt.2021.760485").all()


def test_its_statistics_are_those_published(study):
    levels = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0]
    assert rows(study, "r_squared") == (levels, [0.984, 0.997, 0.982, 0.931, 0.920, 0.861])
    assert rows(study, "ruptured_count") == (levels, [0.0] * 5 + [2.0])
    assert rows(study, "tested_count") == (levels, [3.0] * 6)
    assert rows(study, "mass_loss_slope")[1] == [0.8574]
    assert rows(study, "volume_ratio")[1] == [0.62]


def test_the_reference_truth_agrees_with_them_within_their_errors(study):
    table = study.summary.set_index(["quantity", "degradation_pct"])
    truth = Truth()
    for level in (0.0, 25.0):
        modulus = table.loc[("young_modulus", level)]
        assert abs(6.0 * truth.constants([level])[0, 0] - modulus["value"]) < (
            modulus["sd"] / np.sqrt(modulus["n"])
        )
        elongation = table.loc[("elongation_at_break", level)]
        assert abs(100.0 * (truth.limit_stretch([level])[0] - 1.0) - elongation["value"]) < (
            elongation["sd"] / np.sqrt(elongation["n"])
        )


def test_its_design_is_that_of_the_paper(study):
    design = design_of(study)
    levels = design.actuator.drop_duplicates("specimen_id")["degradation_pct"]
    assert levels.value_counts().to_dict() == dict.fromkeys(range(0, 30, 5), 3)
    assert design.bend_angle
