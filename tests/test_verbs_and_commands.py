"""Each verb of the library gives what its command gives: one study, a cause of rupture, an average.

The published counts of the study show that actuators burst earlier than its films; two causes
explain that as well, so what is predicted is averaged over both.
"""

import json
import re
import warnings

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import bayesdeg as bd
from bayesdeg.cli import app
from bayesdeg.pages.checkpoints import NoCheckpoints
from bayesdeg.pages.folder import POSTERIOR_AVERAGED, RunFolder
from bayesdeg.pages.output import run_folder
from bayesdeg.pages.tables import TABLES
from bayesdeg.progress import Silent
from bayesdeg.run.stages import run_study
from bayesdeg.surrogate.trained import write_trained
from tests.run.planted_offset import COUNTS, DRY, SETTINGS, SUMMARY, emulator, planted_study

pytestmark = [pytest.mark.long, pytest.mark.slow]

CANDIDATES = '"pressure_offset", "dry_embrittlement", "flaw_embrittlement"'
PREDICTED = {"pressure": [60, 160], "degradation": [0, 25]}
DUTY = {"pressure": 60.0, "curvature": 10.0, "hours": [0, 4, 8]}


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("verbs")


@pytest.fixture(scope="session")
def study(place):
    (place / "study").mkdir()
    settings = SETTINGS.replace('"pressure_offset", "erosion", "creep"', CANDIDATES) + DRY
    return planted_study(place / "study", settings=settings, summary=SUMMARY + COUNTS)


@pytest.fixture(scope="session")
def run(study, place):
    """The run folder of the command."""
    write_trained(place / "emulator.npz", emulator())
    with run_folder(place / "run", study) as folder:
        run_study(study, folder, NoCheckpoints(), progress=Silent(), forward=emulator())
    return folder


@pytest.fixture(scope="session")
def fits(study):
    """The same by the verbs: base calibration, verdict, final calibration."""
    base = bd.calibrate(bd.Model(study, emulator()), workers=1)
    verdict = bd.criticise(base, workers=1)
    return base, verdict, bd.calibrate(base.model.with_verdict(verdict), workers=1)


@pytest.fixture(scope="session")
def plain(fits):
    """The final calibration without what the verdict says of ruptures."""
    return bd.calibrate(fits[0].model.with_causes(*fits[1].causes), workers=1)


def said_by(verb, *arguments, **options):
    """Return the table of a verb, and what it warns of."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        table = verb(*arguments, **options)
    return table, {str(one.message) for one in said}


def answer(command, run, *options):
    """Return the rows that a command gives, and its messages."""
    file = run.path.parent / "emulator.npz"
    arguments = [command, run.path, "--emulator", file, "--json", *options]
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    rows, messages = pd.DataFrame(told["rows"]), set(told["messages"])
    if "model" in rows:
        rows = rows[rows["model"] == "average"].drop(columns="model")
    return rows, messages


def assert_same_answer(ours, theirs):
    """Hold the answer of a verb against that of its command, which also knows of the whole run."""
    assert_same(ours[0], theirs[0])
    plain = {one.removesuffix("; --cause selects one") for one in theirs[1]}
    assert ours[1] <= plain
    assert any("flaw_embrittlement" in one for one in ours[1])  # it is averaged


def assert_same(ours, theirs, tolerance=1e-6):
    """Hold a table of a verb against that of a command, which knows no other columns."""
    assert ours.columns.tolist() == theirs.columns.tolist()
    for name in ours:
        one, other = ours[name].reset_index(drop=True), theirs[name].reset_index(drop=True)
        if pd.api.types.is_numeric_dtype(one):
            numbers = other.astype(float)
            np.testing.assert_allclose(one.astype(float), numbers, rtol=tolerance, err_msg=name)
        else:
            assert one.fillna("").tolist() == other.fillna("").tolist(), name


def test_criticise_and_run_come_to_the_same_verdict(run, fits):
    theirs, ours = run.read_verdict(), fits[1].document
    assert theirs.predicted_with == ("dry_embrittlement", "pressure_offset")
    for name in ("outcome", "causes", "predicted_with", "sets", "rupture_counts", "misfit"):
        assert getattr(ours, name) == getattr(theirs, name), name
    told, said = run.read_json("verdict"), fits[1].to_dict()
    for key in ("confusable", "next_experiments", "naming"):
        assert said[key] == told[key], key
    assert said["explanation"].split(" (")[0] == told["explanation"].split(" (")[0]
    for one, other in zip(said["candidates"], told["candidates"], strict=True):
        assert one["cause"] == other["cause"]
        assert one["log_bayes_factor"] == other["log_bayes_factor"]


def test_the_base_model_has_the_same_parameters(run, fits):
    table = run.read_table("parameters").query("model == 'base'")
    ours = fits[0].summary()["mean"].to_numpy()
    assert table["mean"].to_numpy() == pytest.approx(ours, rel=1e-12)


def test_the_final_model_has_the_cause_of_rupture_and_the_same_draws(run, fits):
    final = fits[2]
    assert final.model.name == "base+dry_embrittlement+pressure_offset"
    ours = final.posterior["posterior"].to_dataset()
    theirs = run.read_posterior("posterior")["posterior"].to_dataset()
    assert set(ours) == set(theirs)
    for name in ours:
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-6, err_msg=name)


def test_predict(run, fits, plain):
    table, said = said_by(bd.predict, fits[2], **PREDICTED)
    options = ["--pressure", "60,160", "--degradation", "0,25"]
    assert_same_answer((table, said), answer("predict", run, *options))
    # without what the verdict says of ruptures they look rarer
    fewer, _ = said_by(bd.predict, plain, **PREDICTED)
    assert table["probability"].iloc[-1] > 1.5 * fewer["probability"].iloc[-1]


@pytest.mark.parametrize("seed", [None, 3])
def test_predict_after_hours(run, fits, seed):
    ours = said_by(bd.predict, fits[2], pressure=[60, 160], hours=[4, 8], seed=seed)
    options = ["--pressure", "60,160", "--hours", "4,8", *(["--seed", seed] if seed else [])]
    assert_same(ours[0], answer("predict", run, *options)[0])


def test_control(run, fits):
    asked = {"curvature": [8.0, 300.0], "degradation": [0, 25], "max_risk": 0.05}
    options = ["--curvature", "8,300", "--degradation", "0,25", "--risk", "0.05"]
    assert_same_answer(said_by(bd.control, fits[2], **asked), answer("control", run, *options))


def test_lifetime(run, fits):
    options = ["--pressure", 60, "--curvature", 10, "--hours", "0,4,8"]
    ours = said_by(bd.lifetime, fits[2], **DUTY)
    assert_same_answer(ours, answer("lifetime", run, *options))


def test_compare(run, fits):
    table = bd.compare(fits[0], fits[2], workers=1)
    # those of the command are of the causes that readings show
    base, gain = table[table["model"] == "base"], run.read_table("gain")
    assert_same(base, gain[gain["model"] == "base"])
    assert table.columns.tolist() == [column.name for column in TABLES["gain"].columns]
    assert table["model"].unique().tolist() == ["base", fits[2].model.name]
    assert table[table["degradation_pct"] == "all"]["elpd_diff"].iloc[-1] > 0.0


def places_of(table):
    """Degradation rates and pressures that a table has rows for."""
    return set(zip(table["degradation_pct"], table["pressure_kPa"], strict=True))


def test_report(run, fits, place, study):
    written = bd.report(place / "report", *fits[::2], fits[1], full=False, workers=1)
    assert written.page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    folder = RunFolder(written.folder)
    assert folder.read_json("run")["seed"] == study.settings.seed
    ours, theirs = folder.read_run().model.averaged, run.read_run().model.averaged
    assert len(ours) == 2
    assert ours == theirs
    for name in ("posterior", "posterior_base", POSTERIOR_AVERAGED):
        trees = [where.read_posterior(name) for where in (folder, run)]
        assert set(trees[0].children) == set(trees[1].children)
        one, other = (tree["posterior"] for tree in trees)
        for parameter, draws in one.to_dataset().items():
            np.testing.assert_allclose(draws, other[parameter], rtol=1e-6, err_msg=str(parameter))
    assert_same(folder.read_table("gain"), run.read_table("gain"))
    # draws of their own: curves of a rate may end a step of pressure apart
    for name in ("bands", "rupture"):
        one, other = (places_of(where.read_table(name)) for where in (folder, run))
        apart = pd.Series([rate for rate, _ in one ^ other]).value_counts()
        assert all(apart <= 1)


def test_next(run, fits):
    result = CliRunner().invoke(app, ["next", str(run.path), "--json"])
    assert result.exit_code == 0, result.output
    theirs = json.loads(result.stdout)["next_experiments"]
    assert fits[1].to_dict()["next_experiments"] == theirs


def test_a_verdict_is_of_its_own_model_alone(fits):
    base, verdict, final = fits
    for other in (final.model, bd.Model(base.model.data, emulator())):
        with pytest.raises(bd.BayesdegError, match="a different model"):
            other.with_verdict(verdict)


def test_a_study_predicts_and_finds_pressures(plain):
    table = bd.predict(plain, pressure=range(0, 121, 60), degradation=[0, 10])
    quantiles = [f"q{q:02d}" for q in (5, 25, 50, 75, 95)]
    columns = ["degradation_pct", "pressure_kPa", *quantiles, "probability"]
    assert table.columns.tolist()[:8] == columns
    assert len(table) == 6
    wanted = float(table.query("degradation_pct == 0 and pressure_kPa == 60")["q50"].iloc[0])
    with pytest.warns(UserWarning, match="a risk of"):
        [pressure] = bd.control(plain, curvature=wanted, degradation=0)["pressure_kPa"]
    assert pressure == pytest.approx(60.0, abs=2.0)
    with pytest.warns(UserWarning, match="extrapolation"):
        bd.predict(plain, pressure=[500.0], degradation=0)
    unsure = bd.ServiceConditions(degradation_sd=2.0)
    wide = bd.predict(plain, pressure=60, degradation=10, conditions=unsure)
    row = table.query("degradation_pct == 10 and pressure_kPa == 60")
    assert (wide["q95"] - wide["q05"])[0] > 1.5 * (row["q95"] - row["q05"]).iloc[0]
    with pytest.warns(UserWarning, match="mount hanging"):
        bd.predict(
            plain, pressure=60, degradation=10, conditions=bd.ServiceConditions(mount="hanging")
        )
    asked = {"curvature": 200.0, "degradation": 0}
    with pytest.warns(UserWarning, match="a risk of"):
        allowed = bd.control(plain, **asked)["allowed_kPa"][0]
    assert allowed == 160.0  # the largest that was tested
    with pytest.warns(UserWarning, match="extrapolation|rests|risk") as said:
        assert bd.control(plain, **asked, beyond=True)["allowed_kPa"][0] > 160.0
    assert any("rests on" in str(one.message) for one in said)
    buried = bd.predict(plain, pressure=60, hours=[0, 8])
    assert buried["degradation_q05"][1] < buried["degradation_pct"][1]
    assert buried["q50"][1] < buried["q50"][0]
    wanted = float(buried["q50"].mean())
    with pytest.warns(UserWarning, match="a risk of"):
        life = bd.lifetime(plain, pressure=60, curvature=wanted, hours=np.linspace(0.0, 8.0, 5))
    assert life.columns.tolist() == TABLES["lifetime"].headings
    assert life["failed_probability"].is_monotonic_increasing
    assert 0.0 < life.attrs["time_to_failure_q50_h"] < 8.0
    assert "h" in life.attrs["summary"]


def test_mistakes_with_a_study_are_told(fits, plain, tmp_path):
    first, found, last = *fits[:2], plain
    for call, words in (
        (lambda: first.model.with_causes("presure_offset"), "'pressure_offset'"),
        (lambda: bd.criticise(first, causes=["presure_offset"]), "'pressure_offset'"),
        (lambda: bd.criticise(last), "without causes"),
        (lambda: bd.predict(last, pressure=10.0), "degradation"),
        (lambda: bd.predict(last, pressure=-1.0, degradation=0.0), "at least 0"),
        (lambda: bd.predict(last, pressure=1.0, degradation=0.0, hours=1.0), "not both"),
        (lambda: bd.predict(last, pressure=1.0, hours=-1.0), "at least 0"),
        (lambda: bd.lifetime(last, pressure=0.0, curvature=1.0), "pressure"),
        (lambda: bd.lifetime(last, pressure=9.0, curvature=1.0, hours=3.0), "at least two"),
        (lambda: bd.lifetime(last, pressure=9.0, curvature=1.0, max_risk=0.0), "max_risk"),
        (lambda: bd.predict(last, x=[1.0]), "pressure"),
        (lambda: bd.control(last, curvature=0.0, degradation=0.0), "above 0"),
        (lambda: bd.control(last, curvature=1.0, degradation=0.0, max_risk=1.0), "max_risk"),
        (lambda: bd.report(tmp_path / "r", last, first, found), "different model"),
        (lambda: bd.compare(first, first), "differ"),
    ):
        with pytest.raises(bd.BayesdegError, match=re.escape(words)):
            call()
