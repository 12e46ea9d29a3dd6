import json
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.verdict import Candidate, Decision, EffectSize, Outcome
from bayesdeg.pipeline.explanation import explain, unjudged_document, verdict_document
from bayesdeg.pipeline.judge import Judgement, effect_size

WHERE = "Measured curvature lies below the simulation by 12 % on average at 20–80 kPa."
SIZE = EffectSize(13.9, 0.6, 12.9, 14.9, "kPa")
OFFSET = Candidate("pressure_offset", 41.2, 0.93, 39.5, 6.1, {"offset": SIZE})
FRACTION = EffectSize(0.1, 0.02, 0.06, 0.13, "–")
LOSS = Candidate("pressure_loss", 6.0, 0.4, 3.0, 4.0, {"fraction": FRACTION})
UNJUDGED = Candidate("creep", None, None, None, None, {}, "actuator.csv does not record time_s")


def judgement_of(outcome, *causes, candidates=(OFFSET, LOSS, UNJUDGED), p_value=1 / 501):
    return Judgement(
        misfit=Misfit(60.0, np.ones(500), p_value, np.zeros(1), 0.0, 2.1, 0.6),
        candidates=candidates,
        decision=Decision(outcome, causes),
        threshold=4.2,
        confusable=[("pressure_loss", "pressure_offset")],
        held_out={},
    )


NAMED = judgement_of(Outcome.NAMED, "pressure_offset")


def test_a_named_cause_is_explained_with_mechanism_size_unit_and_gain():
    text = explain(NAMED, WHERE)
    assert text.startswith(WHERE)
    assert f"The cause is pressure_offset: {CATALOGUE['pressure_offset'].mechanism}." in text
    assert "offset 13.9 kPa (90 % interval 12.9 to 14.9)" in text
    assert "93 % of the misfit is explained" in text
    assert "better by 39.5 ± 6.1 in log density" in text
    assert "pressure_loss, is 35.2 behind in log Bayes factor" in text
    assert "Of 500 data sets simulated from the calibrated model, none misfit as much" in text


def test_a_size_without_a_unit_shows_no_dash():
    loss = replace(LOSS, log_bayes_factor=50.0)
    text = explain(judgement_of(Outcome.NAMED, "pressure_loss", candidates=(loss,)), WHERE)
    assert "fraction 0.1 (90 % interval 0.06 to 0.13)" in text
    assert "–" not in text.replace(WHERE, "")
    assert "next best" not in text


def test_an_ambiguous_outcome_names_all_that_remain():
    text = explain(judgement_of(Outcome.AMBIGUOUS, "pressure_offset", "pressure_loss"), WHERE)
    assert "explained by pressure_offset or pressure_loss" in text
    assert "cannot tell them apart" in text
    for name in ("pressure_offset", "pressure_loss"):
        assert CATALOGUE[name].mechanism in text


def test_an_unexplained_misfit_says_why_the_nearest_cause_is_not_named():
    text = explain(judgement_of(Outcome.UNEXPLAINED, candidates=(LOSS, UNJUDGED)), WHERE)
    assert "No cause in the catalogue accounts for it." in text
    assert "The nearest is pressure_loss" in text
    assert "removes only 40 % of the misfit" in text
    assert "held-out specimens are not predicted better" in text
    assert "log Bayes factor" not in text  # 6.0 would have been enough
    weak = replace(LOSS, log_bayes_factor=2.5, elpd_diff=None, elpd_diff_se=None)
    text = explain(judgement_of(Outcome.UNEXPLAINED, candidates=(weak,)), WHERE)
    assert "its log Bayes factor 2.5 is below the 4.2 that naming takes" in text
    assert "held-out" not in text


def test_without_any_candidate_there_is_no_nearest():
    text = explain(judgement_of(Outcome.UNEXPLAINED, candidates=(UNJUDGED,)), WHERE)
    assert "nearest" not in text


def test_an_adequate_model_is_said_to_be_so():
    text = explain(judgement_of(Outcome.ADEQUATE, p_value=0.34), WHERE)
    assert "agrees with the measurements" in text
    assert "34 % of 500 data sets" in text
    assert "No cause is named." in text
    assert WHERE not in text


@pytest.mark.parametrize(("larger", "said"), [(0, "none"), (1, "1"), (7, "7")])
def test_simulated_data_sets_that_misfit_as_much_are_counted(larger, said):
    judgement = judgement_of(Outcome.NAMED, "pressure_offset", p_value=(1 + larger) / 501)
    assert f"calibrated model, {said} misfit as much" in explain(judgement, WHERE)


def test_the_document_holds_what_was_promised():
    document = verdict_document(NAMED, WHERE)
    promised = "outcome causes explanation candidates confusable false_name_rate misfit"
    assert set(document) >= {*promised.split(), "next_experiments"}
    assert document["outcome"] == "named"
    assert document["causes"] == ["pressure_offset"]
    assert document["confusable"] == [["pressure_loss", "pressure_offset"]]
    misfit = {"rms_per_m": 2.1, "noise_per_m": 0.6, "p_value": 1 / 501, "where": WHERE}
    assert document["misfit"] == misfit
    assert json.loads(json.dumps(document)) == document


def test_candidates_in_the_document_keep_their_order_and_reasons():
    best, second, unjudged = verdict_document(NAMED, WHERE)["candidates"]
    names = [c["cause"] for c in (best, second, unjudged)]
    assert names == ["pressure_offset", "pressure_loss", "creep"]
    offset = {"mean": 13.9, "sd": 0.6, "q05": 12.9, "q95": 14.9, "unit": "kPa"}
    assert best["effect"] == {"offset": offset}
    assert best["probability"] == pytest.approx(1.0)
    assert second["probability"] == pytest.approx(np.exp(6.0 - 41.2), rel=1e-6)
    assert "why" not in best
    assert unjudged["probability"] is None
    assert unjudged["why"] == "actuator.csv does not record time_s"


def test_a_study_without_an_actuator_names_nothing():
    document = unjudged_document({"creep": "there are no actuator readings (actuator.csv)"})
    assert set(document) == set(verdict_document(NAMED, WHERE))
    assert document["causes"] == []
    assert document["misfit"]["p_value"] is None
    assert document["candidates"][0]["why"].startswith("there are no actuator readings")
    assert "no cause is named" in document["explanation"]


def test_effect_size_is_of_the_draws():
    size = effect_size(np.random.default_rng(1).normal(5.0, 2.0, 100_000), "kPa")
    assert size.mean == pytest.approx(5.0, abs=0.03)
    assert size.sd == pytest.approx(2.0, abs=0.03)
    assert size.q05 == pytest.approx(5.0 - 1.645 * 2.0, abs=0.05)
    assert size.q95 == pytest.approx(5.0 + 1.645 * 2.0, abs=0.05)
    assert size.unit == "kPa"
