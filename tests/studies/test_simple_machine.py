import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.analysis.judge import judge_model
from bayesdeg.analysis.summary import lines, summary
from bayesdeg.criticism.checks.discrepancy import interval_with_discrepancy

STUDIES = Path(__file__).resolve().parents[2] / "studies"
SEEDS = (1, 2, 2014)
THERE, ALIKE, MISSING = (
    "the truth is in the catalogue",
    "so is another cause like it",
    "the truth is not in the catalogue",
)


@pytest.fixture(scope="module")
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(STUDIES))
        yield importlib.import_module("simple_machine")


@pytest.fixture(scope="module", params=SEEDS)
def judged(study, request):
    subject = study.asked(request.param).density
    return {
        title: judge_model(subject, catalogue, seed=request.param)
        for title, catalogue in study.CATALOGUES.items()
    }


def ninety(draws):
    return np.quantile(draws, [0.05, 0.95])


def test_the_model_alone_is_sure_of_a_wrong_efficiency(study, judged):
    base = judged[THERE].search.base
    draws = base.named_draws("efficiency", np.random.default_rng(0))
    assert draws.max() < study.EFFICIENCY - 0.05
    assert np.std(draws) < 0.005
    effort, work = base.subject.places.along, base.subject.observed
    assert np.mean(draws) == pytest.approx(effort @ work / (effort @ effort), abs=0.001)


def test_its_misfit_is_seen(judged):
    assert judged[THERE].misfit.p_value <= 0.005


def test_the_true_cause_is_named_and_the_efficiency_is_then_right(study, judged):
    found = judged[THERE]
    assert (found.decision.outcome, found.decision.causes) == ("named", ("growing_friction",))
    draws = found.draws("efficiency", np.random.default_rng(0))
    assert np.quantile(draws, 0.01) < study.EFFICIENCY < np.quantile(draws, 0.99)
    trial = found.search.trials[found.chosen]
    growth = trial.named_draws("growing_friction.growth", np.random.default_rng(0))
    assert np.quantile(growth, 0.01) < study.FRICTION < np.quantile(growth, 0.99)


def test_a_cause_of_nearly_the_same_effect_is_not_ruled_out(judged):
    factor = judged[ALIKE].search.factor
    gap = factor(frozenset({"growing_friction"})) - factor(frozenset({"slip"}))
    assert abs(gap) < 6.0


def test_where_the_truth_is_missing_nothing_is_named_and_no_efficiency_is_given(judged):
    found = judged[MISSING]
    assert (found.decision.outcome, found.decision.causes) == ("unexplained", ())
    assert found.possible == ()
    assert not len(found.draws("efficiency", np.random.default_rng(0)))
    told = summary(found)
    assert told["trusted"] == {"efficiency": None, "reading_error": None}
    assert any(line.startswith("efficiency: unreliable") for line in lines(told))


def test_a_discrepancy_of_no_known_cause_widens_the_interval_but_does_not_make_it_right(
    study, judged
):
    base = judged[MISSING].search.base
    low, high = interval_with_discrepancy(base, "efficiency")
    alone = ninety(base.named_draws("efficiency", np.random.default_rng(0)))
    assert high - low > 4.0 * np.ptp(alone)
    assert high < study.EFFICIENCY


def test_an_average_over_causes_lies_between_theirs(study):
    found = judge_model(study.asked(2).density, study.CATALOGUES[ALIKE], seed=2)
    assert found.decision.outcome == "ambiguous"
    assert set(found.decision.causes) == {"growing_friction", "slip"}
    generator = np.random.default_rng(0)
    means = [
        np.mean(found.search.trials[names].named_draws("efficiency", generator))
        for names in found.possible
    ]
    assert len(means) == 2
    assert min(means) < np.mean(found.draws("efficiency", generator)) < max(means)


def test_a_machine_as_the_model_has_it_is_left_alone(study, monkeypatch):
    monkeypatch.setattr(study, "FRICTION", 0.0)
    found = judge_model(study.asked(5).density, study.CATALOGUES[ALIKE], seed=5)
    assert found.decision.outcome == "adequate"
    low, high = np.quantile(found.draws("efficiency", np.random.default_rng(0)), [0.005, 0.995])
    assert low < study.EFFICIENCY < high
    assert high - low < 0.01


@pytest.mark.slow
def test_the_command_says_what_is_to_be_trusted():
    command = [sys.executable, str(STUDIES / "simple_machine.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert "outcome: named: growing_friction" in done.stdout
    assert "efficiency: unreliable" in done.stdout


def test_the_script_is_short():
    assert len((STUDIES / "simple_machine.py").read_text(encoding="utf-8").splitlines()) < 150
