"""What is tested: the tests of the source, or those of a study."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdeg.data.study import Study, read_study
from bayesdeg.laboratory.experiment import Design, design_of


def study_of(folder, **files):
    (folder / "study.toml").write_text("[noise]\ndegradation_sd_pct = 0.8\n")
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    return read_study(folder)


def test_by_default_the_tests_are_those_of_the_source():
    design = Design()
    for table in (design.actuator, design.tensile, design.breaks):
        counts = table.drop_duplicates("specimen_id").groupby("degradation_pct").size()
        assert counts.to_dict() == dict.fromkeys((0.0, 5.0, 10.0, 15.0, 20.0, 25.0), 3)
    for _, test in design.actuator.groupby("specimen_id"):
        assert test["pressure_kPa"].tolist() == list(range(20, 260, 20))
    assert set(design.tensile["specimen_id"]) == set(design.breaks["specimen_id"])
    assert (design.tensile.groupby("specimen_id").size() == 15).all()
    assert 0.9 < design.tensile["elongation_share"].max() < 1.0
    by_time = design.moisture.groupby("time_h").size()
    assert by_time.to_dict() == {float(t): 9 for t in (0, 4, 8, 12, 16, 20, 24)}
    assert design.moisture["film_id"].is_unique
    assert len(design.shrinkage) == 4
    assert design.bend_angle


def test_an_empty_study_has_the_default_design():
    design, default = design_of(Study("s", Path("s"))), Design()
    for name in ("actuator", "tensile", "breaks", "moisture", "shrinkage"):
        pd.testing.assert_frame_equal(getattr(design, name), getattr(default, name))
    assert design.bend_angle


def test_specimens_rates_pressures_and_branches_are_those_of_the_study(tmp_path):
    study = study_of(
        tmp_path,
        actuator="specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m,"
        "branch,time_s,colour\n"
        "b,7.3,0.6,30,1,loading,0,red\nb,7.3,0.6,70,2,loading,60,red\n"
        "b,7.3,0.6,30,1.1,unloading,120,red\na,0,0,50,1,loading,0,red\n",
    )
    design = design_of(study)
    assert list(design.actuator) == [
        "specimen_id",
        "degradation_pct",
        "degradation_sd_pct",
        "pressure_kPa",
        "time_s",
        "branch",
    ]
    assert design.actuator["specimen_id"].tolist() == ["b", "b", "b", "a"]
    assert design.actuator["degradation_pct"].tolist() == [7.3, 7.3, 7.3, 0.0]
    assert design.actuator["degradation_sd_pct"].tolist() == [0.6, 0.6, 0.6, 0.0]
    assert design.actuator["pressure_kPa"].tolist() == [30.0, 70.0, 30.0, 50.0]
    assert design.actuator["branch"].tolist() == ["loading", "loading", "unloading", "loading"]
    assert not design.bend_angle


def test_an_error_that_the_study_does_not_state_is_left_to_the_truth(tmp_path):
    study = study_of(
        tmp_path, **{"break": "specimen_id,degradation_pct,elongation_pct\na,0,200\nb,12,90\n"}
    )
    assert design_of(study).breaks["degradation_sd_pct"].isna().all()


def test_a_specimen_that_burst_would_have_been_tested_to_the_end(tmp_path):
    head = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m,bend_angle_deg,ruptured\n"
    whole = "".join(f"a,5,{p},1,2,0\n" for p in (20, 40, 60, 80))
    burst = "b,25,20,1,2,0\nb,25,40,,,1\n"
    other = "c,25,30,1,2,0\nc,25,35,,,1\n"
    design = design_of(study_of(tmp_path, actuator=head + burst + whole + other))
    pressures = design.actuator.groupby("specimen_id")["pressure_kPa"].agg(list)
    assert pressures["b"] == pressures["a"] == [20.0, 40.0, 60.0, 80.0]
    assert pressures["c"] == [30.0, 35.0]
    rates = design.actuator.groupby("specimen_id")["degradation_pct"].agg(set)
    assert rates.to_dict() == {"a": {5.0}, "b": {25.0}, "c": {25.0}}
    assert design.bend_angle


def test_stretches_are_those_of_the_study_and_its_uniaxial_films_are_torn(tmp_path):
    study = study_of(
        tmp_path,
        tensile="specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure\n"
        "u,3,uniaxial,1.1,0.2,cauchy\nu,3,uniaxial,1.4,0.5,cauchy\ne,4,equibiaxial,1.2,0.3,\n",
        moisture="film_id,time_h,mass_equilibrated_g,mass_dry_g\nm,0,2,1.6\nn,7,2,1.7\n",
        shrinkage="film_id,mass_poured_g,mass_cured_g,mass_conditioned_g\ns,30,15,10\n",
    )
    design = design_of(study)
    assert design.tensile["stretch"].tolist() == [1.1, 1.4, 1.2]
    assert design.tensile["stress_measure"].tolist() == ["cauchy", "cauchy", "nominal"]
    assert design.tensile["mode"].tolist() == ["uniaxial", "uniaxial", "equibiaxial"]
    assert design.breaks["specimen_id"].tolist() == ["u"]
    assert design.moisture.to_dict("list") == {"film_id": ["m", "n"], "time_h": [0.0, 7.0]}
    assert design.shrinkage["film_id"].tolist() == ["s"]
    np.testing.assert_array_equal(design.actuator["pressure_kPa"].unique(), np.arange(20, 241, 20))


def test_a_design_cannot_be_changed():
    with pytest.raises(AttributeError):
        Design().bend_angle = False
