"""``lifetime`` on a run folder whose posteriors are known."""

import json

import numpy as np
import pandas as pd
import pytest

from bayesdeg.pages.tables import TABLES
from tests.commands.test_predict_and_control import (
    LIMIT,
    TIME_CONSTANT,
    buried,
    empty_folder,
    models,
    report,
    rows_of,
)

__all__ = ["buried", "empty_folder", "models", "report"]
DUTY = ("--pressure", "80", "--curvature", "4")
FEW = ("--hours", "0:20:5")


def life_of(bayesdeg, *arguments):
    code, printed, _ = bayesdeg("lifetime", *arguments, "--json")
    assert code == 0
    answer = json.loads(printed)
    return pd.DataFrame(answer["rows"]), answer


def test_a_life_has_the_columns_of_its_table_and_follows_the_films(bayesdeg, buried, tmp_path):
    out = tmp_path / "lifetime.csv"
    table, answer = life_of(bayesdeg, buried, *DUTY, *FEW, "--out", out)
    assert table.columns.tolist() == TABLES["lifetime"].headings
    assert list(pd.read_csv(out)) == TABLES["lifetime"].headings
    assert set(answer["units"]) == set(table.columns)
    hours = np.array([0.0, 5.0, 10.0, 15.0, 20.0])
    assert table["time_h"].tolist() == hours.tolist()
    rate = LIMIT * -np.expm1(-hours / TIME_CONSTANT)
    np.testing.assert_allclose(table["degradation_q50"], rate, rtol=0.03)
    for name in ("burst_probability", "lost_probability", "failed_probability"):
        assert table[name].is_monotonic_increasing
    assert table["q50_per_m"].is_monotonic_decreasing
    assert table["needed_q50_kPa"].is_monotonic_increasing
    assert (table["allowed_kPa"] <= 120.0).all()
    # next to nothing bursts, and no probability of failing is below what the specimens know
    failed = table["lost_probability"]
    known = np.maximum(failed, table["burst_probability"])
    np.testing.assert_allclose(table["failed_probability"], known, rtol=1e-6)
    times = [answer["summary"][f"time_to_failure_q{q:02d}_h"] for q in (5, 50, 95)]
    np.testing.assert_allclose(times, np.interp([0.05, 0.5, 0.95], failed, hours), rtol=1e-6)


def test_a_life_agrees_with_predictions_at_its_times(bayesdeg, buried):
    """Curvature of new specimens at the pressure of the duty, but for the scatter of the films."""
    table, _ = life_of(bayesdeg, buried, *DUTY, *FEW)
    at = ("predict", buried, "--pressure", "80", *FEW, "--json")
    predicted = rows_of(bayesdeg(*at)[1])
    np.testing.assert_allclose(table["q50_per_m"], predicted["q50"], rtol=0.02)
    fresh = table.iloc[0]
    assert fresh["q95_per_m"] == pytest.approx(predicted["q95"][0], rel=0.02)
    assert fresh["burst_probability"] == pytest.approx(predicted["probability"][0], abs=0.02)


CHECKS = 40  # films broken and actuators loaded


@pytest.fixture
def checked(buried):
    """The run with what it knows of ruptures."""
    path = buried / "run.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    content["model"]["rupture_checks"] = CHECKS
    path.write_text(json.dumps(content), encoding="utf-8")
    return buried


SAFE = ("--pressure", "40", "--curvature", "0.05")


@pytest.mark.parametrize("duty", [DUTY, SAFE])
def test_failing_is_as_probable_as_having_burst_at_least(bayesdeg, checked, duty):
    table, _ = life_of(bayesdeg, checked, *duty, *FEW)
    assert table["burst_probability"].min() == pytest.approx(1 / CHECKS)
    for kind in ("probability", "q05", "q95"):
        assert (table[f"failed_{kind}"] >= table[f"burst_{kind}"]).all()
    for kind in ("burst", "failed"):
        assert (table[f"{kind}_q05"] <= table[f"{kind}_q95"]).all()
    assert (table["failed_probability"] >= table["lost_probability"]).all()


def test_no_probability_below_one_in_the_specimens_is_printed_as_a_number(bayesdeg, checked):
    table, answer = life_of(bayesdeg, checked, *SAFE, *FEW)
    assert table["failed_probability"].max() == pytest.approx(1 / CHECKS)
    code, printed, _ = bayesdeg("lifetime", checked, *SAFE, *FEW)
    assert code == 0
    # burst, failed, and its interval, at each time
    rows = printed.replace("\N{NO-BREAK SPACE}", " ")
    assert rows.count(f"< 1 in {CHECKS}") == 3 * len(table)
    said = answer["messages"][0].replace("\N{NO-BREAK SPACE}", " ")
    assert said.count(f"less than 1 in {CHECKS}") == 2


def test_more_is_in_reach_where_more_is_allowed(bayesdeg, buried):
    within, _ = life_of(bayesdeg, buried, *DUTY, *FEW, "--risk", "0.5")
    beyond, _ = life_of(bayesdeg, buried, *DUTY, *FEW, "--risk", "0.5", "--beyond")
    assert (beyond["allowed_kPa"] >= within["allowed_kPa"]).all()
    assert beyond["allowed_kPa"].max() > 120.0
    assert beyond["reachable"].iloc[-1] > within["reachable"].iloc[-1]


def test_what_rests_on_no_test_is_said(bayesdeg, checked):
    within = life_of(bayesdeg, checked, *DUTY, *FEW, "--risk", "0.5")[1]["messages"]
    beyond = life_of(bayesdeg, checked, *DUTY, *FEW, "--risk", "0.5", "--beyond")[1]["messages"]
    further = " ".join(set(beyond[1:]) - set(within[1:]))
    assert "120 kPa" in further
    bold = life_of(bayesdeg, checked, *DUTY, *FEW, "--risk", "0.001")[1]["messages"]
    assert f"1 in {CHECKS}" in " ".join(bold[1:])


def test_the_table_ends_in_what_it_comes_to(bayesdeg, buried):
    code, printed, _ = bayesdeg("lifetime", buried, *DUTY, *FEW)
    assert code == 0
    answer = life_of(bayesdeg, buried, *DUTY, *FEW)[1]
    assert answer["messages"][0] in printed
    median = answer["summary"]["time_to_failure_q50_h"]
    assert f"{median:.3g} h" in printed


def test_times_are_those_of_the_films_if_none_are_given(bayesdeg, buried):
    table, _ = life_of(bayesdeg, buried, *DUTY)
    assert (table["time_h"].iloc[0], table["time_h"].iloc[-1]) == (0.0, 24.0)


def test_a_study_without_moisture_ends_with_2(bayesdeg, report):
    code, _, messages = bayesdeg("lifetime", report, *DUTY)
    assert code == 2
    assert "moisture.csv" in messages
