"""Each verb of the library gives what its command gives: one study, a cause of rupture, an average.

The published counts of the study show that actuators burst earlier than its films; two causes
explain that as well, so what is predicted is averaged over both.
"""

import json
import warnings

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import bayesdeg as bd
from bayesdeg.cli import app
from bayesdeg.pages.checkpoints import NoCheckpoints
from bayesdeg.pages.folder import POSTERIOR_AVERAGED, RunFolder
from bayesdeg.pipeline.output import run_folder
from bayesdeg.pipeline.run import run_study
from bayesdeg.progress import Silent
from bayesdeg.surrogate.trained import write_trained
from tests.pipeline.planted_offset import COUNTS, DRY, SETTINGS, SUMMARY, emulator, planted_study

pytestmark = pytest.mark.slow

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


def test_the_final_model_has_the_cause_of_rupture_and_the_same_draws(run, fits):
    final = fits[2]
    assert final.model.name == "base+dry_embrittlement+pressure_offset"
    ours = final.posterior["posterior"].to_dataset()
    theirs = run.read_posterior("posterior")["posterior"].to_dataset()
    assert set(ours) == set(theirs)
    for name in ours:
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-6, err_msg=name)


def test_predict(run, fits):
    table, said = said_by(bd.predict, fits[2], **PREDICTED)
    options = ["--pressure", "60,160", "--degradation", "0,25"]
    assert_same_answer((table, said), answer("predict", run, *options))
    # without what the verdict says of ruptures they look rarer
    plain = bd.calibrate(fits[0].model.with_causes(*fits[1].causes), workers=1)
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


def test_report(run, fits, place):
    folder = RunFolder(
        bd.report(place / "report", *fits[::2], fits[1], full=False, workers=1).folder
    )
    ours, theirs = folder.read_run().model.averaged, run.read_run().model.averaged
    assert len(ours) == 2
    assert ours == theirs
    for name in ("posterior", "posterior_base", POSTERIOR_AVERAGED):
        one, other = (where.read_posterior(name)["posterior"] for where in (folder, run))
        for parameter, draws in one.to_dataset().items():
            np.testing.assert_allclose(draws, other[parameter], rtol=1e-6, err_msg=str(parameter))
    assert_same(folder.read_table("gain"), run.read_table("gain"))


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
