"""Readings at pressures to which no curve of their material goes take no part, and are told."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.assembly import reach
from bayesdeg.assembly.aside import is_set_aside, set_aside, unused_rows
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reach import ERRORS, MARGIN, assemble_within_reach
from bayesdeg.assembly.suspects import assemble_screened
from bayesdeg.data.study import Why, read_study
from bayesdeg.inference.model import least_squares
from bayesdeg.pages.tables import SET_ASIDE, SUSPECTS
from bayesdeg.run.record import suspects_of
from bayesdeg.run.writing import BUILDS
from bayesdeg.surrogate.fit import summed
from bayesdeg.surrogate.scaling import NAMES
from bayesdeg.surrogate.terms import Terms
from bayesdeg.surrogate.trained import default_surrogate

STUDY = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"
READ = ["curvature_per_m", "bend_angle_deg"]
FRESH = ("A00-1", "A00-2", "A00-3")
BALLOONS, SLOPE = 258.0, 0.5  # kPa, of ln of the load by the place on [-1, 1]


@pytest.fixture(scope="module")
def study():
    return read_study(STUDY)


def with_readings(study, specimens, pressures):
    """Return the study with more readings at the end of some tests, each 4 1/m more."""
    table = study.actuator
    more = []
    for name in specimens:
        last = table[table["specimen_id"] == name].iloc[-1]
        for k, pressure in enumerate(pressures, start=1):
            further = {READ[0]: last[READ[0]] + 4.0 * k, READ[1]: last[READ[1]] + 9.0 * k}
            more.append(pd.DataFrame([last]).assign(pressure_kPa=pressure, **further))
    whole = pd.concat([table, *more]).sort_values(["specimen_id", "pressure_kPa"], kind="stable")
    return replace(study, actuator=whole.reset_index(drop=True).astype(table.dtypes))


@pytest.fixture(scope="module")
def ballooning(study):
    return with_readings(study, FRESH, [280.0, 300.0])


def of_films(model):
    """Inputs of the fresh material that films and priors say, at 1 kPa."""
    values = {k: v[0] for k, v in model.table.named(least_squares(model)[None]).items()}
    named = {k: np.array([v]) for k, v in values.items()}
    c1, c2, c3 = model.world.constants(named, [0.0])[0].T
    scale, paper = np.cbrt(named["volume_ratio"]), named["paper_stiffness"]
    return Inputs(np.array([1.0]), c1, c2, c3, scale, paper)


@pytest.fixture(scope="module")
def forward(study):
    """The shipped emulator with loads that rise less, so that the fresh material balloons.

    At 258 kPa: its curves otherwise rise beyond all pressures of the study.
    """
    plain, fresh = default_surrogate(), of_films(assemble(study).model)
    orders = np.zeros((2, len(NAMES)), dtype=np.int64)
    orders[1, 0] = 1

    def lowered(level):
        lower = Terms(orders, np.array([[level, -SLOPE]]))
        return replace(plain, load=summed(plain.load, lower))

    limit = lowered(-SLOPE).limit_pressure(fresh).pressure.item()
    found = lowered(np.log(BALLOONS / limit) - SLOPE)
    assert found.limit_pressure(fresh).pressure.item() == pytest.approx(BALLOONS, rel=1e-3)
    return found


def test_of_the_study_of_the_readme_nothing_is_beyond(study):
    assembly = assemble_within_reach(study)
    assert assembly.beyond == ()
    assert assembly.study is assembly.whole is study


def test_the_models_are_those_of_a_study_without_such_readings(study, ballooning, forward):
    assembly = assemble_within_reach(ballooning, forward)
    [beyond] = assembly.beyond
    assert beyond.specimens == FRESH
    assert {key[1] for key in beyond.readings} == {280.0, 300.0}
    np.testing.assert_array_equal(assembly.model.observed, assemble(study).model.observed)
    assert assembly.whole is ballooning
    gone = is_set_aside(ballooning.actuator, assembly.beyond)
    assert gone.sum() == 2 * len(FRESH)
    rest = ballooning.actuator[~gone].reset_index(drop=True)
    assert assembly.study.actuator.equals(rest)
    [unused] = unused_rows(assembly.study, assembly.whole, assembly.beyond)
    assert (unused.file, unused.why) == ("actuator.csv", Why.BEYOND_REACH)
    assert (unused.rows, unused.specimens) == (2 * len(FRESH), FRESH)


def test_what_is_kept_ends_shortly_above_the_ballooning_pressure_of_the_films(ballooning, forward):
    limit = forward.limit_pressure(of_films(assemble(ballooning, forward).model))
    end = (1.0 + MARGIN) * (limit.pressure + ERRORS * limit.sd).item()
    kept = assemble_within_reach(ballooning, forward).study.actuator
    kept = kept[kept["specimen_id"].isin(FRESH) & kept[READ[0]].notna()]
    assert kept["pressure_kPa"].max() == 240.0
    assert 240.0 < BALLOONS < end < 280.0
    between = with_readings(read_study(STUDY), FRESH, [0.999 * end, 1.001 * end])
    kept = assemble_within_reach(between, forward).study.actuator
    assert kept["pressure_kPa"].max() == pytest.approx(0.999 * end)


def test_that_is_settled_before_readings_are_looked_at(ballooning, forward):
    other = ballooning.actuator.assign(curvature_per_m=ballooning.actuator[READ[0]] * 0.5)
    found = assemble_within_reach(replace(ballooning, actuator=other), forward)
    assert found.beyond == assemble_within_reach(ballooning, forward).beyond != ()


def test_they_are_told_with_pressure_and_count(ballooning, forward):
    assembly = assemble_within_reach(ballooning, forward)
    results = SimpleNamespace(assembly=assembly, final=None)
    [entry] = [one for one in suspects_of(results) if one.set_aside]
    assert (entry.oddity, entry.readings, entry.specimens) == ("beyond", 6, FRESH)
    assert "280 kPa" in entry.why
    assert "6 readings" in entry.why
    sources = SimpleNamespace(study=assembly.study, results=results)
    assert BUILDS[SUSPECTS](sources)["oddity"].tolist() == ["beyond"]
    table = BUILDS[SET_ASIDE](sources)
    assert table["set_aside"].sum() == 6
    assert set(table.loc[table["set_aside"] == 1, "pressure_kPa"]) == {280.0, 300.0}


def test_a_single_one_is_told_as_one(study, forward):
    one = with_readings(study, FRESH[:1], [300.0])
    results = SimpleNamespace(assembly=assemble_within_reach(one, forward), final=None)
    [entry] = [entry for entry in suspects_of(results) if entry.set_aside]
    assert (entry.specimen, entry.specimens, entry.readings) == (FRESH[0], (), 1)
    assert "300 kPa" in entry.why


def test_where_most_lie_beyond_something_else_is_wrong(study, forward):
    table = study.actuator.assign(pressure_kPa=study.actuator["pressure_kPa"] * 10.0)
    assert assemble_within_reach(replace(study, actuator=table), forward).beyond == ()


def test_a_specimen_in_another_unit_is_not_told_to_balloon(study, forward):
    table = study.actuator.copy()
    table.loc[table["specimen_id"] == "A00-2", "pressure_kPa"] *= 10.0
    millibar = replace(study, actuator=table)
    assert assemble_within_reach(millibar, forward).beyond == ()


@pytest.mark.slow
def test_suspects_are_looked_for_among_the_rest(ballooning, forward):
    table = ballooning.actuator.copy()
    table.loc[table["specimen_id"] == "A10-2", READ] *= 0.5
    spoilt = replace(ballooning, actuator=table)
    assembly = assemble_screened(spoilt, forward)
    assert [one.specimens for one in assembly.aside] == [("A10-2",)]
    assert [one.specimens for one in assembly.beyond] == [FRESH]
    assert assembly.whole is spoilt
    rest = set_aside(spoilt, [*assembly.aside, *assembly.beyond])
    np.testing.assert_array_equal(assembly.model.observed, assemble(rest, forward).model.observed)


def test_a_map_without_ends_keeps_all(ballooning, forward, monkeypatch):
    monkeypatch.setattr(reach, "Surrogate", type(None))
    assert assemble_within_reach(ballooning, forward).beyond == ()
