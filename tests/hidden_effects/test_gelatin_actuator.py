"""The effect hidden in the shipped virtual experiment is found from the study's folder alone."""

import json
import re
import shutil
import warnings
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.data.settings import SamplingOptions
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.truth import TRUTH_NODES
from bayesdeg.material.degradation import bernstein_weights
from bayesdeg.observations.specimens import control_name
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.folder import RunFolder
from bayesdeg.progress import Silent
from bayesdeg.run.stages import fingerprint, run_study
from tests.hidden_effects.judging import verdict_with

STUDY = Path(__file__).parents[2] / "studies" / "gelatin_actuator"


ROOT = STUDY.parents[1]


def quick_start():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.split("## Quick start from Python")[1]
    return re.search(r"```python\n(.*?)```", section, re.DOTALL)[1]


def test_the_quick_start_is_short():
    assert len(quick_start().strip().splitlines()) <= 20


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """The first page run on a copy of the study without the truth: its names, what it printed."""
    place, names = tmp_path_factory.mktemp("gelatin"), {}
    copy = shutil.ignore_patterns("truth.json")
    shutil.copytree(STUDY, place / "studies" / STUDY.name, ignore=copy)
    printed, said = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.chdir(place)
        warnings.simplefilter("error")
        # two causes explain the bursts about equally well
        warnings.filterwarnings("ignore", "the run could not tell causes apart", UserWarning)
        with redirect_stdout(printed), redirect_stderr(said):
            exec(compile(quick_start(), "README.md", "exec"), names)
    return place / "reports" / "gelatin", names, printed.getvalue(), said.getvalue()


@pytest.fixture(scope="module")
def run(started):
    return started[0]


@pytest.mark.slow
def test_the_quick_start_of_the_first_page_runs(started):
    _, names, printed, said = started
    found = names["verdict"]
    assert (found.outcome, found.causes) == ("named", ("pressure_offset",))
    assert found.candidates["mean"][0] == pytest.approx(14.2, abs=0.6)
    assert "named: pressure_offset 14." in printed
    assert said == ""


def assert_named(verdict):
    """Check what ``verdict.json`` says of what was hidden."""
    truth = json.loads((STUDY / "truth.json").read_text(encoding="utf-8"))
    assert verdict["outcome"] == "named"
    assert verdict["causes"] == list(truth["causes"])
    best = verdict["candidates"][0]
    hidden = truth["causes"]["pressure_offset"]["offset"]
    effect = best["effect"]["offset"]
    assert abs(effect["mean"] - hidden) < 3.0 * effect["sd"]
    assert best["explained_fraction"] > 0.9
    assert best["elpd_diff"] > 5.0 * best["elpd_diff_se"]


@pytest.mark.slow
def test_the_hidden_effect_is_named_and_its_size_found(run):
    assert_named(RunFolder(run).read_json("verdict"))


@pytest.mark.long
@pytest.mark.slow
def test_a_run_says_the_same_as_the_verbs(started, tmp_path):
    found, study = started[1]["verdict"], read_study(STUDY)
    study = replace(
        study, settings=replace(study.settings, sampling=SamplingOptions("quick"), seed=1)
    )
    checkpoints = Checkpoints(tmp_path / "checkpoints", fingerprint(study))
    run_study(study, RunFolder(tmp_path / "run"), checkpoints, progress=Silent())
    told = RunFolder(tmp_path / "run").read_json("verdict")
    assert_named(told)
    assert (found.outcome, list(found.causes)) == (told["outcome"], told["causes"])
    factors = [entry["log_bayes_factor"] for entry in told["candidates"]]
    assert found.candidates["cause"].tolist() == [entry["cause"] for entry in told["candidates"]]
    judged = [factor for factor in factors if factor is not None]
    assert found.candidates["log_bayes_factor"].dropna().tolist() == judged


@pytest.mark.long
@pytest.mark.slow
def test_with_an_offset_that_does_nothing_that_test_fails(started):
    """The mutation check, as of the planted studies."""
    mutated = verdict_with(started[1]["verdict"].judgement, "pressure_offset")
    with pytest.raises(AssertionError):
        assert_named({"outcome": mutated.outcome, "causes": list(mutated.causes)})


@pytest.mark.slow
def test_every_file_of_a_run_is_written(run):
    names = (
        *("index.html", "verdict.json", "gain.csv", "posterior.nc", "posterior_base.nc"),
        *("bands.csv", "rupture.csv", "run.json"),
    )
    assert not [name for name in names if not (run / name).exists()]
    page = (run / "index.html").read_text(encoding="utf-8")
    assert "virtual experiment" in page.lower()


@pytest.mark.slow
def test_the_truth_is_inside_the_posterior(run):
    """Control values give the constant between the ends, where the truth is stated."""
    truth = json.loads((STUDY / "truth.json").read_text(encoding="utf-8"))["constants"]
    posterior = RunFolder(run).read_posterior("posterior")["posterior"]
    names = ("c1_at_0", "c1_at_25", "volume_ratio", "elongation_at_25", "stiffness_scatter")
    drawn = {name: posterior[name].to_numpy() for name in names}
    controls = [posterior[control_name("c1", TRUTH_NODES, k)].to_numpy() for k in range(3)]
    drawn["c1_at_12_5"] = np.tensordot(bernstein_weights(12.5, TRUTH_NODES), controls, axes=1)
    for name, draws in drawn.items():
        assert abs(draws.mean() - truth[name]) < 3.0 * draws.std(), name
