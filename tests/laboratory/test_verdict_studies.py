"""The studies on which verdicts are timed, and how the benchmark copes with what goes wrong."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.status import Status
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.data.study import read_study
from bayesdeg.surrogate.trained import default_surrogate

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    drawn, seconds = (import_module(f"verdict_{name}") for name in ("studies", "seconds"))
    fine = import_module("fine_library")


@pytest.mark.parametrize(("rows", "cycles"), [(11, 1), (22, 1), (44, 2), (88, 4)])
def test_cycles_go_up_and_down_and_hold_the_readings_wanted(rows, cycles):
    table = drawn.cycling(18, rows).actuator
    one = table[table["specimen_id"] == "A000"]
    assert rows <= len(one) <= rows + cycles
    assert one["cycle"].max() == cycles
    first = one[one["cycle"] == 1]
    assert first["pressure_kPa"].max() == 240.0
    assert (first["branch"] == "unloading").sum() == (first["branch"] == "loading").sum() - 1
    assert table.groupby("degradation_pct")["specimen_id"].nunique().tolist() == [3] * 6


def test_the_largest_catalogue_that_is_timed_is_made_of_known_causes():
    assert len(set(drawn.CAUSES)) == len(drawn.CAUSES) == max(drawn.CATALOGUES)
    assert set(drawn.CAUSES) <= set(CATALOGUE)


@pytest.mark.parametrize("name", ["edge", "specimens_100"])
def test_a_study_is_complete_read_without_fault_and_drawn_by_seed(tmp_path, name):
    study, forward = drawn.studies()[name], fine.shipped_library()
    for folder in ("a", "b"):
        truth = drawn.write(study, name, tmp_path / folder, forward=forward, seed=3)
    assert study.fresh[0] < truth.c1[0] < study.fresh[1]
    texts = [(tmp_path / f / "actuator.csv").read_text(encoding="utf-8") for f in ("a", "b")]
    assert texts[0] == texts[1]
    table = read_study(tmp_path / "a").actuator
    assert len(table) == len(study.design.actuator)
    assert not table["curvature_per_m"].isna().any()


def test_at_the_edge_the_emulator_answers_as_the_finer_map(tmp_path):
    study, forward = drawn.studies()["edge"], fine.shipped_library()
    truth = drawn.write(study, "edge", tmp_path / "edge", forward=forward, seed=drawn.SEED)
    c1, c2, c3 = truth.constants([0.0])[0]
    scale = np.cbrt(truth.volume_ratio)
    fresh = Inputs(np.array([160.0, 240.0]), c1, c2, c3, scale, truth.paper_stiffness)
    found, finer = default_surrogate()(fresh), forward(fresh)
    assert np.all(found.status == Status.CONVERGED)
    assert np.all(finer.status == Status.CONVERGED)
    np.testing.assert_allclose(found.curvature, finer.curvature, rtol=0.03)


def test_what_was_told_before_the_limit_is_kept():
    program = "import time; print('{\"fit\": 1.5}', flush=True); time.sleep(60)"
    told = seconds._told((sys.executable, "-c", program), 2.0)
    assert told.pop("fault").endswith("2 s")
    assert told == {"fit": 1.5}


def test_a_failure_is_told_by_its_last_line():
    told = seconds._told((sys.executable, "-c", "raise ValueError('no study')"), 20.0)
    assert told == {"fault": "ValueError: no study"}


def test_growth_is_the_slope_of_logarithms():
    rows = [{"n": n, "s": 0.1 * n**1.5} for n in (6, 18, 50)]
    assert seconds.power([*rows, {"n": 100}], "n", "s") == 1.5
    assert seconds.power(rows[:1], "n", "s") is None
