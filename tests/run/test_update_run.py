"""Further readings enter a finished run: command, library, what is written and what is refused."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

import bayesdeg as bd
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.cli import INPUT_FAULT
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.page import build_page
from bayesdeg.run.update import RECOMPUTED, default_target
from tests.inference.small_study import values_of
from tests.run.planted_offset import (
    OFFSET,
    counted_study,
    emulator,
    model,
    planted_study,
)
from tests.run.small_run import contents, sample_of, write_run

HEAD = "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m"


def new_specimen():
    """Rows of a further specimen, as those of the study were drawn."""
    active = model()
    drawn = active.data_of(Curvature).drawn(
        active.tests(active.table.named(active.table.vectors(_truth(active)))),
        np.random.default_rng(9),
    )[0]
    curves = active.data_of(Curvature).tests
    rows = [
        f"n1,{curves.degradation[1, 0]},0.0,{curves.pressure[1, j]},{drawn[1, j]}"
        for j in np.flatnonzero(curves.mask[1])
    ]
    return "\n".join([HEAD, *rows]) + "\n"


def _truth(active):
    known = values_of() | {"pressure_offset.offset": np.array([OFFSET])}
    return {name: known[name] for name in active.table.names}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A study and its finished run."""
    folder = tmp_path_factory.mktemp("planted")
    study = folder / "study"
    study.mkdir()
    path, file = write_run(folder / "reports" / "planted", planted_study(study))
    return study, path, file


def copied(run, folder):
    """Copies of study and run, beside the rows of a new specimen."""
    study, path, file = run
    shutil.copytree(study, folder / "study")
    shutil.copytree(path, folder / "reports" / "planted")
    (folder / "new.csv").write_text(new_specimen(), encoding="utf-8")
    return folder, folder / "reports" / "planted", file


@pytest.fixture
def places(run, tmp_path):
    """Copies of study and run that may be changed."""
    return copied(run, tmp_path)


@pytest.fixture(scope="module")
def updated(run, tmp_path_factory):
    """A copy of the run, and the run updated with the new specimen, which stay as they are."""
    folder, report, file = copied(run, tmp_path_factory.mktemp("updated"))
    return report, bd.update(report, folder / "new.csv", emulator=file, progress=False)


def test_the_updated_run_is_that_of_all_readings(places, bayesdeg):
    folder, report, file = places
    before = contents(report)
    code, printed, said = bayesdeg(
        "update", report, folder / "new.csv", "--emulator", file, "--json", "--quiet"
    )
    assert code == 0, said
    answer = json.loads(printed)
    out = report.with_name("planted_updated")
    assert answer["folder"] == str(out)
    assert contents(report) == before
    assert answer["update"]["specimens"] == ["n1"]

    rows = pd.DataFrame(answer["parameters"]).set_index("parameter")
    assert_as_with_all_readings(rows, with_all_readings(folder / "study"), "pressure_offset")


def with_all_readings(folder):
    """Add the rows of the new specimen to the study, and read it."""
    with (folder / "actuator.csv").open("a", encoding="utf-8") as study:
        study.write("\n".join(new_specimen().splitlines()[1:]) + "\n")
    return read_study(folder)


def assert_as_with_all_readings(rows, study, *causes):
    """Means and standard deviations are those of the posterior of all readings."""
    assembly = assemble(study, emulator())
    known = {cause.name: cause for cause in assembly.causes}
    whole = assembly.extended(*(known[name] for name in causes))
    full = sample_of(whole, 11, enough=3000.0)
    weights = np.exp(full.log_weights - full.log_weights.max())
    values = whole.table.named(full.draws)
    assert set(values) == set(rows.index)
    for name, draws in values.items():
        mean = np.average(draws, weights=weights)
        sd = np.sqrt(np.average((draws - mean) ** 2, weights=weights))
        tail = np.average(((draws - mean) / sd) ** 4, weights=weights)
        # Monte Carlo error of a standard deviation; larger where tails are heavy
        error = 3.0 * np.sqrt((tail - 1.0) / (4.0 * full.effective))
        assert abs(rows.loc[name, "mean"] - mean) < 0.12 * sd, name
        assert abs(rows.loc[name, "sd"] / sd - 1.0) < 0.05 + error, name


def test_posteriors_and_tables_are_of_all_readings_and_the_verdict_is_not_judged_again(updated):
    report, found = updated
    new = RunFolder(found.folder)
    record = new.read_run()
    assert record.update.run == str(report.resolve())
    assert record.update.readings == len(new_specimen().splitlines()) - 1
    assert record.update.times == 1
    assert set(record.update.posteriors) == {"final", "base"}
    assert new.read_verdict() == RunFolder(report).read_verdict()
    assert "not updated" in found.messages[-1]
    written = {name for name in RECOMPUTED if new.read_table(name) is not None}
    assert written == set(RECOMPUTED) - {"fitted", "lifetime"}
    observed = new.read_table("observations")
    assert (observed["specimen_id"] == "n1").sum() == 2 * record.update.readings
    tree = new.read_posterior("posterior")
    assert "n1" in tree["log_likelihood"]["specimen"].to_numpy()
    assert found.posterior["posterior"].equals(tree["posterior"])
    page = build_page(found.folder).read_text(encoding="utf-8")
    assert 'id="updated"' in page
    assert new.read_table("parameters")["r_hat"].isna().all()
    assert 'id="figure-ranks"' not in page
    assert 'id="figure-ranks"' in build_page(report).read_text(encoding="utf-8")
    assert found.method in ("weights", "refit", "mode")
    assert found.effective >= 400.0
    assert "shift_sd" in found.summary()
    assert str(found.folder) in repr(found)
    assert str(found.folder) in found._repr_html_()


@pytest.mark.long
def test_the_same_seed_gives_the_same_update(places, updated):
    folder, report, file = places
    new = pd.read_csv(folder / "new.csv")
    kept, one = {"emulator": file, "progress": False}, updated[1]
    two = bd.update(report, new, out=folder / "two", **kept)
    other = bd.update(report, new, out=folder / "three", seed=8, **kept)
    pd.testing.assert_frame_equal(one.summary(), two.summary())
    assert not one.summary().equals(other.summary())
    tables = [pd.read_csv(place.folder / "bands.csv") for place in (one, two)]
    pd.testing.assert_frame_equal(*tables)


def test_an_updated_run_is_updated_further_and_predicts(places, updated, bayesdeg):
    folder, report, file = places
    lines = new_specimen().splitlines()
    (folder / "first.csv").write_text("\n".join(lines[:4]) + "\n", encoding="utf-8")
    (folder / "rest.csv").write_text("\n".join([HEAD, *lines[4:]]) + "\n", encoding="utf-8")
    once = bd.update(report, folder / "first.csv", emulator=file, progress=False)
    before = contents(once.folder)
    twice = bd.update(once.folder, folder / "rest.csv", emulator=file, progress=False)
    assert twice.folder.name == "planted_updated_2"
    assert contents(once.folder) == before
    assert twice.entry.times == 2
    added = (twice.folder / "added.csv").read_text().splitlines()
    assert added == lines
    whole = updated[1]
    shift = (twice.summary()["mean"] - whole.summary()["mean"]) / whole.summary()["sd"]
    assert np.max(np.abs(shift)) < 0.15
    at = ("--pressure", "60", "--degradation", "0", "--emulator", file)
    code, printed, said = bayesdeg("predict", twice.folder, *at, "--json")
    assert code == 0, said
    assert "n1" in " ".join(json.loads(printed)["messages"])


def test_a_further_reading_of_an_earlier_specimen(places):
    folder, report, file = places
    data = read_study(folder / "study").actuator
    name, rate = data["specimen_id"].iloc[0], data["degradation_pct"].iloc[0]
    top = data.loc[data["specimen_id"] == name, "pressure_kPa"].max() + 10.0
    curvature = 1.09 * data.loc[data["specimen_id"] == name, "curvature_per_m"].max()
    (folder / "more.csv").write_text(
        f"{HEAD}\n{name},{rate},0.0,{top},{curvature}\n", encoding="utf-8"
    )
    found = bd.update(report, folder / "more.csv", emulator=file, progress=False)
    assert found.entry.readings == 1
    assert np.max(np.abs(found.summary()["shift_sd"])) < 1.5
    observed = RunFolder(found.folder).read_table("observations").query("model == 'base'")
    assert observed.loc[observed["specimen_id"] == name, "pressure_kPa"].iloc[-1] == top


def lines_of(said):
    return [line for line in said.splitlines() if line.strip()]


REFUSED = {
    "colour": (f"{HEAD},colour\nn1,0,0,20,1,red\n", "column colour"),
    "text": (f"{HEAD}\nn1,0,0,twenty,1\n", "value 'twenty'"),
    "rate": (f"{HEAD}\nn1,300,0,20,1\n", "value '300'"),
    "angle": (f"{HEAD},bend_angle_deg\nn1,0,0,20,1,2.2\nn1,0,0,40,2,4.4\n", "bend_angle_noise"),
    "volume": (f"{HEAD},cavity_volume_ml\nn1,0,0,20,1,0.1\n", "volumes"),
    "nothing": (f"{HEAD}\n", "no data"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_bad_rows_are_refused_in_one_line(places, bayesdeg, what):
    folder, report, file = places
    text, words = REFUSED[what]
    (folder / "bad.csv").write_text(text, encoding="utf-8")
    code, printed, said = bayesdeg("update", report, folder / "bad.csv", "--emulator", file)
    assert code == INPUT_FAULT
    assert printed == ""
    assert len(lines_of(said)) == 1
    assert words in said
    assert not report.with_name("planted_updated").exists()


def test_a_unit_that_cannot_be_right_is_refused(places, bayesdeg):
    folder, report, file = places
    table = pd.read_csv(folder / "new.csv")
    table["curvature_per_m"] *= 1e-3  # 1/mm
    table.to_csv(folder / "bad.csv", index=False)
    code, _, said = bayesdeg("update", report, folder / "bad.csv", "--emulator", file)
    assert code == INPUT_FAULT
    assert len(lines_of(said)) == 1
    assert "curvature_per_m" in said
    assert "bad.csv" in said


def test_what_the_run_was_made_of_must_be_there_and_unchanged(places, bayesdeg):
    folder, report, file = places
    ask = ("update", report, folder / "new.csv", "--emulator", file)
    toml = folder / "study" / "study.toml"
    toml.write_text(toml.read_text() + "\n# changed\n", encoding="utf-8")
    code, _, said = bayesdeg(*ask)
    assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)
    assert "study.toml" in said
    shutil.rmtree(folder / "study")
    code, _, said = bayesdeg(*ask)
    assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)
    assert "planted" in said
    code, _, said = bayesdeg("update", folder / "none", folder / "new.csv")
    assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)
    code, _, said = bayesdeg("update", report, folder / "none.csv", "--emulator", file)
    assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)


def test_another_run_is_never_written_over(places, bayesdeg):
    folder, report, file = places
    before = contents(report)
    shutil.copytree(report, folder / "other")
    for out in (report, folder / "other", folder / "study"):
        ask = ("update", report, folder / "new.csv", "--emulator", file, "--out", out)
        code, _, said = bayesdeg(*ask)
        assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)
        assert "--out" in said
    assert contents(report) == before == contents(folder / "other")


def test_draws_of_another_density_are_refused(places, bayesdeg):
    folder, report, file = places
    new = RunFolder(report)
    tree = new.read_posterior("posterior")
    tree["sample_stats"]["lp"] = tree["sample_stats"]["lp"] + 1.0
    new.write_posterior("posterior", tree)
    new.write(new.read_run().model_copy(update={"posteriors": new.posterior_hashes()}))
    code, _, said = bayesdeg("update", report, folder / "new.csv", "--emulator", file)
    assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)
    assert "differs from" in said


def test_added_rows_that_were_changed_are_refused(places, updated, bayesdeg):
    folder, report, file = places
    once = shutil.copytree(updated[1].folder, report.with_name("once"))
    path = once / "added.csv"
    path.write_text(path.read_text() + "\n", encoding="utf-8")
    code, _, said = bayesdeg("update", once, folder / "new.csv", "--emulator", file)
    assert (code, len(lines_of(said))) == (INPUT_FAULT, 1)
    assert "added.csv" in said


@pytest.fixture(scope="module")
def counted(tmp_path_factory):
    """A study whose final model is fitted to published counts, its run, and that run updated."""
    folder = tmp_path_factory.mktemp("counted")
    study = folder / "study"
    study.mkdir()
    causes = ("pressure_offset", "dry_embrittlement")
    path, file = write_run(folder / "run", counted_study(study), causes=causes, course=True)
    for name in ("criteria", "lifetime"):  # of the run before
        (path / f"{name}.csv").write_text("stale\n1\n", encoding="utf-8")
    (folder / "new.csv").write_text(new_specimen(), encoding="utf-8")
    return study, path, bd.update(path, folder / "new.csv", emulator=file, progress=False), file


@pytest.mark.long
def test_counts_that_the_final_model_is_fitted_to_stay_its_data(counted):
    study, _, found, _ = counted
    causes = ("pressure_offset", "dry_embrittlement")
    tree = found.posterior["log_likelihood"]
    assert "ruptures at 25 %" in tree["specimen"].to_numpy()
    whole = with_all_readings(shutil.copytree(study, study.parent / "whole"))
    assert_as_with_all_readings(found.summary(), whole, *causes)


def test_what_rests_on_counts_follows(counted):
    _, path, found, _ = counted
    before, after = (RunFolder(one).read_run() for one in (path, found.folder))
    assert [b.burst for b in after.model.bursts] == [2.0]
    assert after.model.bursts == before.model.bursts
    assert after.model.rupture_checks == before.model.rupture_checks + 1
    expected = {
        row.degradation_pct: row.predicted
        for row in after.comparisons
        if row.quantity == "ruptured_count"
    }
    assert set(expected) == {0.0, 25.0}
    assert all(words.startswith("fewer") for words in expected.values())


def test_criteria_and_life_are_made_anew(counted):
    study, _, found, _ = counted
    new = RunFolder(found.folder)
    assert not {"criteria.csv", "lifetime.csv"} & set(new.read_run().update.as_before)
    criteria, life = new.read_table("criteria"), new.read_table("lifetime")
    chosen = criteria[criteria["criterion"] == "principal_stretch"]
    ruptures = new.read_table("rupture")
    both = chosen.merge(ruptures, on=["degradation_pct", "pressure_kPa"], suffixes=("", "_all"))
    assert len(both) > 3
    assert np.max(np.abs(both["probability"] - both["probability_all"])) < 0.1
    moisture = pd.read_csv(study / "moisture.csv")
    assert life["time_h"].iloc[-1] == moisture["time_h"].max()
    assert life["degradation_q50"].is_monotonic_increasing
    # the duty follows from the posterior of all readings
    bands = new.read_table("bands").query("degradation_pct == 0")
    fresh = np.interp(life["pressure_kPa"].iloc[0], bands["pressure_kPa"], bands["q50"])
    assert life["wanted_per_m"].iloc[0] == pytest.approx(0.5 * fresh, rel=0.02)


@pytest.mark.long
def test_readings_above_the_largest_pressure_can_be_followed_by_others(places):
    """Priors and scales that follow from the largest pressure stay those of the run."""
    folder, report, file = places
    rows = pd.read_csv(folder / "new.csv")
    last = rows.iloc[[-1]].assign(pressure_kPa=200.0)
    last["curvature_per_m"] *= 200.0 / rows["pressure_kPa"].iloc[-1]
    kept = {"emulator": file, "progress": False}
    once = bd.update(report, last, out=folder / "one", **kept)
    twice = bd.update(once.folder, rows.assign(specimen_id="n2"), out=folder / "two", **kept)
    measured = RunFolder(twice.folder).read_run().model.measured
    assert measured["pressure_kPa"][-1] == 200.0


@pytest.mark.long
def test_a_reading_that_no_curve_reaches_is_refused_even_alone(places, bayesdeg):
    folder, report, file = places
    fresh = [f"n3,0,0,{pressure},{4 + pressure / 20}" for pressure in (100, 240, 250)]
    for rows in (fresh, fresh[1:]):
        (folder / "far.csv").write_text("\n".join([HEAD, *rows, ""]), encoding="utf-8")
        code, _, said = bayesdeg("update", report, folder / "far.csv", "--emulator", file)
        assert code == INPUT_FAULT
        [line] = lines_of(said)
        told = ("far.csv", "n3", "pressure_kPa", "balloons", "240", "250")
        assert all(word in line for word in told)
    (folder / "far.csv").write_text("\n".join([HEAD, fresh[0], ""]), encoding="utf-8")
    assert bayesdeg("update", report, folder / "far.csv", "--emulator", file)[0] == 0


def test_what_is_unlikely_of_new_rows_is_in_doubt(places):
    folder, report, file = places
    rows = pd.read_csv(folder / "new.csv").assign(humidity_pct=0.6)
    found = bd.update(report, rows, emulator=file, progress=False)
    new = RunFolder(found.folder)
    [suspect] = new.read_verdict().suspects
    assert (suspect.file, suspect.column) == ("actuator.csv", "humidity_pct")
    assert new.read_run().suspects == (suspect,)
    assert "humidity_pct" in found.messages[0]


def test_new_rows_that_no_fit_uses_are_counted(places):
    folder, report, file = places
    rows = pd.read_csv(folder / "new.csv")
    flat = rows.iloc[:1].assign(pressure_kPa=0.0, curvature_per_m=0.0)
    before = {one.why: one.rows for one in RunFolder(report).read_run().unused}
    found = bd.update(report, pd.concat([flat, rows]), emulator=file, progress=False)
    after = {one.why: one.rows for one in RunFolder(found.folder).read_run().unused}
    assert sum(after.values()) == sum(before.values()) + 1


def test_names_of_updates_count_up(tmp_path):
    first = default_target(tmp_path / "gel")
    second = default_target(first)
    third = default_target(second)
    assert [p.name for p in (first, second, third)] == [
        *("gel_updated", "gel_updated_2", "gel_updated_3"),
    ]


@pytest.mark.long
def test_a_run_without_causes_has_one_posterior(tmp_path):
    study = tmp_path / "study"
    study.mkdir()
    path, file = write_run(tmp_path / "reports" / "base", planted_study(study), causes=())
    record = RunFolder(path).read_verdict()
    RunFolder(path).write(replace_outcome(record))
    (tmp_path / "new.csv").write_text(new_specimen(), encoding="utf-8")
    found = bd.update(path, tmp_path / "new.csv", emulator=file, progress=False)
    entries = found.entry.posteriors
    assert entries["base"] == entries["final"]
    assert not any("." in name for name in found.summary().index)


def replace_outcome(record):
    return record.model_copy(update={"causes": (), "predicted_with": ()})


@pytest.mark.long
def test_that_an_average_ends_with_an_update_is_recorded_and_said(places, bayesdeg):
    folder, report, file = places
    sets = [("pressure_offset",), ("pressure_loss",)]
    document = json.loads((report / "run.json").read_text(encoding="utf-8"))
    document["model"]["averaged"] = [{"causes": one, "probability": 0.5} for one in sets]
    (report / "run.json").write_text(json.dumps(document), encoding="utf-8")
    lines = new_specimen().splitlines()
    (folder / "first.csv").write_text("\n".join(lines[:4]) + "\n", encoding="utf-8")
    (folder / "rest.csv").write_text("\n".join([HEAD, *lines[4:]]) + "\n", encoding="utf-8")
    once = bd.update(report, folder / "first.csv", emulator=file, progress=False)
    twice = bd.update(once.folder, folder / "rest.csv", emulator=file, progress=False)
    for one in (once, twice):
        record = RunFolder(one.folder).read_run()
        assert record.model.averaged == ()
        assert [member.causes for member in record.update.not_averaged] == sets
    at = ("--pressure", "60", "--degradation", "0", "--emulator", file, "--json")
    _, printed, _ = bayesdeg("predict", twice.folder, *at)
    answer = json.loads(printed)
    assert answer["model"] == "base+pressure_offset"
    assert "pressure_loss" in " ".join(answer["messages"])
