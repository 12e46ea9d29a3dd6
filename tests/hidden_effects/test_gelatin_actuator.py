"""The effect hidden in the shipped virtual experiment is found from the study's folder alone."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bayesdeg as bd
from bayesdeg.data.settings import SamplingOptions
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.truth import TRUTH_NODES
from bayesdeg.material.degradation import bernstein_weights
from bayesdeg.observations.specimens import control_name
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.page import build_page
from bayesdeg.pipeline import run as running
from bayesdeg.pipeline.judge import judge
from bayesdeg.pipeline.run import fingerprint, run_study
from bayesdeg.progress import Silent
from tests.hidden_effects.judging import verdict_with

STUDY = Path(__file__).parents[2] / "studies" / "gelatin_actuator"


@pytest.fixture(scope="module")
def judged_run(tmp_path_factory):
    """A run at quick effort on a copy of the folder without the truth, and its judgement."""
    folder = tmp_path_factory.mktemp("gelatin") / "study"
    shutil.copytree(STUDY, folder, ignore=shutil.ignore_patterns("truth.json"))
    study = read_study(folder)
    study = replace(study, settings=replace(study.settings, sampling=SamplingOptions("quick")))
    target = folder / "run"
    checkpoints = Checkpoints(target / "checkpoints", fingerprint(study))
    judgements = []

    def watched(*args, **options):
        judgements.append(judge(*args, **options))
        return judgements[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "judge", watched)
        run_study(study, RunFolder(target), checkpoints, progress=Silent())
    build_page(target)
    [judgement] = judgements
    return target, judgement


@pytest.fixture(scope="module")
def run(judged_run):
    return judged_run[0]


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
def test_the_verbs_of_the_library_say_the_same(run):
    told = RunFolder(run).read_json("verdict")
    base = bd.calibrate(bd.Model(bd.read_study(STUDY)), effort="quick", workers=1)
    found = bd.criticise(base, workers=1)
    assert (found.outcome, list(found.causes)) == (told["outcome"], told["causes"])
    factors = [entry["log_bayes_factor"] for entry in told["candidates"]]
    assert found.candidates["cause"].tolist() == [entry["cause"] for entry in told["candidates"]]
    judged = [factor for factor in factors if factor is not None]
    assert found.candidates["log_bayes_factor"].dropna().tolist() == judged


@pytest.mark.slow
def test_with_an_offset_that_does_nothing_that_test_fails(judged_run):
    """The mutation check, as of the planted studies."""
    mutated = verdict_with(judged_run[1], "pressure_offset")
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
