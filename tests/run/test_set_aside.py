"""What does not belong with its study is set aside before it is calibrated, and told."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bayesdeg.assembly.aside import Exclusion, is_set_aside, set_aside
from bayesdeg.assembly.assemble import Assembly
from bayesdeg.assembly.suspects import assemble_screened
from bayesdeg.criticism.checks.suspects import Anomaly, Irregularity, Suspect
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.data.settings import SuspectOptions
from bayesdeg.data.study import read_study
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.pages.headline import doubts_of
from bayesdeg.pages.record import InDoubt, SuspectEntry, VerdictRecord
from bayesdeg.pages.tables import SUSPECTS
from bayesdeg.pages.wording import sentences
from bayesdeg.progress import Silent
from bayesdeg.run import stages as run
from bayesdeg.run.record import suspects_of
from bayesdeg.run.writing import BUILDS

STUDY = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"
READ = ["curvature_per_m", "bend_angle_deg"]


def keeping_all(study):
    return replace(study, settings=replace(study.settings, suspects=SuspectOptions(False)))


@pytest.fixture(scope="module")
def study():
    return read_study(STUDY)


def spoilt(study, specimen, change):
    table = study.actuator.copy()
    rows = table["specimen_id"] == specimen
    table.loc[rows] = change(table.loc[rows].copy())
    return replace(study, actuator=table)


def halved(rows):
    rows[READ] *= 0.5
    return rows


def in_millibar(rows):
    rows["pressure_kPa"] *= 10.0
    return rows


@pytest.mark.slow
def test_a_study_that_keeps_its_suspects_still_learns_of_them(study):
    wrong = keeping_all(spoilt(study, "A10-2", halved))
    assembly = assemble_screened(wrong)
    [one] = assembly.aside
    assert (one.specimens, one.is_out) == (("A10-2",), False)
    assert not assembly.sets_aside
    assert assembly.study is assembly.whole is wrong
    assert "A10-2" in assembly.model.data_of(Curvature).tests.specimens
    [entry] = suspects_of(SimpleNamespace(assembly=assembly, final=None))
    assert (entry.specimen, entry.set_aside) == ("A10-2", False)


def test_suspects_are_in_the_table_whether_they_are_set_aside_or_not(study):
    millibar = spoilt(study, "A10-2", in_millibar)
    model = SimpleNamespace(world=object.__new__(FilmsAndActuators))
    for wrong in (millibar, keeping_all(millibar)):
        results = SimpleNamespace(assembly=Assembly(model, (), {}, {}, study=wrong, whole=wrong))
        found = SimpleNamespace(study=wrong, results=results)
        assert BUILDS[SUSPECTS](found)["set_aside"].tolist() == [0]


CASES = Path(__file__).resolve().parent / "mishaps"
"""Studies of another finite element code in which nothing is hidden but a mishap.

In ``exchanged_labels`` A05b and A20b carry each other's degradation rate, in
``one_leaking_specimen`` A00b had half of the pressure that was read.
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "specimens"),
    [("exchanged_labels", {"A05b", "A20b"}), ("one_leaking_specimen", {"A00b"})],
)
def test_mishaps_are_set_aside_without_being_asked_for(case, specimens):
    assembly = assemble_screened(read_study(CASES / case))
    assert {name for one in assembly.aside for name in one.specimens} == specimens
    assert all(one.is_out for one in assembly.aside)
    left = assembly.model.data_of(Curvature).tests.specimens
    assert not specimens & set(left)
    if case == "one_leaking_specimen":
        share = float(np.exp(-assembly.aside[0].suspect.size))
        assert share == pytest.approx(0.5, abs=0.05)


@pytest.mark.slow
def test_nothing_of_the_study_of_the_readme_is_set_aside(study):
    assembly = assemble_screened(study)
    assert assembly.aside == ()
    assert assembly.study is study
    assert (
        len(assembly.model.data_of(Curvature).tests.specimens)
        == study.actuator["specimen_id"].nunique()
    )


@pytest.mark.slow
@pytest.mark.parametrize(("change", "oddity"), [(halved, "response"), (in_millibar, "")])
def test_a_specimen_that_the_others_contradict_takes_no_part(study, change, oddity):
    wrong = spoilt(study, "A10-2", change)
    assembly = assemble_screened(wrong)
    [one] = assembly.aside
    assert (one.table, one.specimens, one.is_out) == ("actuator", ("A10-2",), True)
    assert "A10-2" not in assembly.model.data_of(Curvature).tests.specimens
    assert assembly.whole is wrong
    others = study.actuator[study.actuator["specimen_id"] != "A10-2"]
    assert len(assembly.study.actuator) == len(others)
    results = SimpleNamespace(assembly=replace(assembly, aside=(one,)), final=None)
    told = [entry for entry in suspects_of(results) if entry.set_aside]
    assert [entry.specimen for entry in told] == ["A10-2"]
    assert told[0].oddity == oddity
    assert "A10-2" in told[0].why
    assert "set aside" in told[0].why


def suspect(oddity, *, size=0.3, at=float("nan"), kind="", specimens=("A10-2",)):
    nothing = np.zeros(1)
    way = Irregularity(oddity, specimens, kind, nothing > 0.0, nothing, at)
    return Suspect(way, size, 6.0, 1e-4)


def picture(study, row=4):
    cells = study.actuator[study.actuator["specimen_id"] == "A10-2"].iloc[row]
    history = f"{cells['branch']} {int(cells['cycle'])} {cells['mount']}"
    time = -1.0 if np.isnan(cells["time_s"]) else float(cells["time_s"])
    key = ("A10-2", float(cells["pressure_kPa"]), history, time)
    return Exclusion(suspect(Anomaly.READING, at=key[1]), "actuator", ("A10-2",), (key,))


def test_of_a_picture_the_row_stays_and_what_was_read_goes(study):
    one = picture(study)
    rest = set_aside(study, [one])
    gone = is_set_aside(study.actuator, [one])
    assert gone.sum() == 1
    assert rest.actuator.loc[gone, READ].isna().all(axis=None)
    assert rest.actuator.loc[~gone].equals(study.actuator.loc[~gone])
    assert rest.actuator["pressure_kPa"].equals(study.actuator["pressure_kPa"])


def test_a_group_of_more_than_half_is_told_only(study):
    names = tuple(study.actuator["specimen_id"].unique()[:10])
    one = Exclusion(suspect(Anomaly.DAY, specimens=names), "actuator", names, (), is_out=False)
    assert set_aside(study, [one]).actuator is study.actuator


@pytest.mark.parametrize("oddity", Anomaly)
def test_every_oddity_has_its_words(oddity):
    found = suspect(oddity, at=120.0)
    way = found.hypothesis
    one = Exclusion(found, "actuator", way.specimens, ())
    facts = {"one": one, "odd": found, "way": way, "partner": "", "stiffer": 1.35}
    said = sentences("findings", "suspect", **facts)
    assert said.startswith("A10-2 ")
    assert "set aside" in said
    assert said.count("?") == 1
    exchanged = sentences("findings", "suspect", **(facts | {"partner": "A20-1"}))
    assert "A20-1" in exchanged


def test_the_reader_learns_what_the_verdict_would_be_with_them():
    entry = SuspectEntry(specimen="A10-2", why="odd", set_aside=True)
    verdict = VerdictRecord.read(
        {
            "outcome": "adequate",
            "suspects": [entry.document()],
            "with_suspects": {"outcome": "named", "causes": ["erosion"]},
        }
    )
    assert verdict.with_suspects.outcome is Outcome.NAMED
    first, second = doubts_of(verdict)
    assert first == "odd"
    assert "erosion" in second
    alike = {"outcome": "adequate", "suspects": [entry.document()]}
    brief = {"outcome": "adequate", "without": ["held-out specimens"]}
    same = VerdictRecord.read(alike | {"with_suspects": brief})
    assert "same" in doubts_of(same)[1]
    assert "without held-out specimens" in doubts_of(same)[1]
    assert "without" not in second


def test_python_judges_with_all_that_was_set_aside_too(study, monkeypatch):
    told, decision = [], SimpleNamespace(outcome=Outcome.NAMED)

    def decided(left, forward, *_):
        assert len(left.whole.actuator) == len(study.actuator)
        assert forward is None
        return decision

    def doubted(results):
        told.append(results.with_suspects)
        return InDoubt()

    model = SimpleNamespace(world=SimpleNamespace(forward=None), of_kind=lambda _: ())
    monkeypatch.setattr(run, "_decision_of", decided)
    monkeypatch.setattr(run, "can_be_judged", lambda _: True)
    monkeypatch.setattr(run, "judged_fit", lambda *_, **__: object())
    monkeypatch.setattr(run, "in_doubt", doubted)
    monkeypatch.setattr(run, "verdict_of", lambda *_: VerdictRecord(outcome="adequate"))
    fit = SimpleNamespace(model=model)
    for aside, expected in (((picture(study),), decision), ((), None)):
        assembly = Assembly(model, (), {}, (), aside=aside, whole=study)
        run.verdict_on(assembly, fit, "quick", 1, progress=Silent(), executor=None)
        assert told.pop() is expected
