"""The verdict in plain words, and as the document that other tools read."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.conflict import Conflict, Questioned
from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.checks.residuals import Concentration
from bayesdeg.criticism.checks.rupture_misfit import RuptureMisfit
from bayesdeg.criticism.checks.shared_scatter import SharedScatter
from bayesdeg.criticism.decide.candidates import Candidate, Confusability, EffectSize
from bayesdeg.criticism.decide.support import Support
from bayesdeg.criticism.decide.verdict import Decision, Outcome
from bayesdeg.criticism.fit.search import Step
from bayesdeg.observations.means import Statistic
from bayesdeg.pipeline.document import unjudged_document, verdict_document
from bayesdeg.pipeline.explanation import explain
from bayesdeg.pipeline.judge import Judgement, readings_misfit
from bayesdeg.priors import Parameter, TruncatedNormal
from tests.criticism.linear_case import known_linear, with_readings

WHERE = "Measured curvature lies below the simulation by 12 % on average at 20–80 kPa."
SIZE = EffectSize(13.9, 0.6, 12.9, 14.9, "kPa")
OFFSET = Candidate("pressure_offset", 41.2, 0.95, 0.93, 39.5, 6.1, {"offset": SIZE})
FRACTION = EffectSize(0.1, 0.02, 0.06, 0.13, "–")
LOSS = Candidate("pressure_loss", 6.0, 0.04, 0.4, 3.0, 4.0, {"fraction": FRACTION})
SCREENED = Candidate("erosion", 1.5, 0.01, None, None, None, {}, fitted=False)
UNJUDGED = Candidate(
    "creep", *5 * (None,), {}, fitted=False, why="actuator.csv does not record time_s"
)
CANDIDATES = (OFFSET, LOSS, SCREENED, UNJUDGED)
CONFUSABLE = Confusability(
    ("pressure_loss", "film_mismatch"), np.array([9.0, 9.0]), np.array([[1.0, 0.9], [0.8, 1.0]])
)
CHANCE = np.append(np.full(490, 1.0), np.full(10, 5.0))  # 2 % above the threshold
RESIDUAL, LEFT = 2.0, 0.5  # by which curvatures are off [1/m], and what no discrepancy explains


def misfit_of(p_value, *, discrepancy=0.0, statistic=61.0, lost=0.0):
    shape = np.full(len(known_linear().mean), discrepancy)
    return Misfit(statistic, np.ones(500), p_value, "actuator", "the path", shape, lost)


def search_of(base, left):
    """What a finished search says of two sets: none, and all that the evidence favours."""
    linear = with_readings(known_linear(), known_linear().mean + RESIDUAL)
    trial = SimpleNamespace(linear=linear, subject=linear.subject, names=frozenset())

    def step(names):
        found = left if names else base
        return Step(
            trial=trial,
            misfit=found,
            simulated=np.zeros((0, 1)),
            screened={},
            threshold=4.2,
            chance=CHANCE,
        )

    return SimpleNamespace(base=trial, step=step)


def support(cause, *, rivals=None, factor=41.2, gain=39.5, together=None, chance=None):
    return Support(cause, factor, gain, 6.1, rivals or {}, 0.1, together, chance)


def judgement_of(
    decision,
    *supported,
    candidates=CANDIDATES,
    p_value=1 / 501,
    lost=0.0,
    rupture=None,
    contradicted=None,
):
    base = misfit_of(p_value, lost=lost)
    left = misfit_of(0.4, statistic=1.0, discrepancy=RESIDUAL - LEFT)
    return Judgement(
        misfit=base,
        left=left,
        rupture=rupture,
        contradicted=contradicted,
        candidates=candidates,
        supported=supported,
        decision=decision,
        threshold=4.2,
        confusability=CONFUSABLE,
        held_out={},
        levels_out={},
        search=search_of(base, left),
        experiments=[],
    )


def named(*causes, one_of=()):
    return Decision(Outcome.NAMED, causes, one_of=one_of)


ONE = judgement_of(
    named("pressure_offset"), support("pressure_offset", rivals={"pressure_loss": 35.2})
)


def test_a_named_cause_is_explained_with_mechanism_size_unit_and_gain():
    text = explain(ONE, WHERE)
    assert text.startswith(WHERE)
    assert f"The cause is pressure_offset: {CATALOGUE['pressure_offset'].mechanism}" in text
    assert "(pressure read but not in the chambers: 13.9 kPa, 90 % interval 12.9 to 14.9)" in text
    assert "With it 100 % of the misfit is explained" in text
    assert "predicted better with pressure_offset by 39.5 ± 6.1 in log density" in text
    assert "The next best candidate, pressure_loss, is 35.2 behind in log Bayes factor" in text
    assert "Of 500 data sets simulated from the calibrated model, none misfit as much" in text


def test_a_cause_without_rivals_has_no_runner_up():
    text = explain(judgement_of(named("pressure_offset"), support("pressure_offset")), WHERE)
    assert "next best" not in text
    assert "No other cause comes near." in text


def test_a_size_without_a_unit_shows_no_dash():
    text = explain(judgement_of(named("pressure_loss"), support("pressure_loss")), WHERE)
    assert "before the chambers: 0.1, 90 % interval 0.06 to 0.13" in text
    assert "–" not in text.replace(WHERE, "")


def test_causes_that_act_together_are_explained_together():
    both = judgement_of(
        named("pressure_offset", "pressure_loss"),
        support("pressure_offset", rivals={"creep": 9.0}),
        support("pressure_loss", rivals={"film_mismatch": 4.0}),
    )
    text = explain(both, WHERE)
    assert "The causes, acting together, are pressure_offset:" in text
    assert "and pressure_loss:" in text
    assert "With them" in text
    assert "with pressure_offset beside the others by 39.5 ± 6.1" in text
    assert "candidate in the place of pressure_loss, film_mismatch, is 4.0 behind" in text


def test_what_acts_beside_a_named_cause_is_said_where_it_cannot_be_told():
    decision = named("pressure_offset", one_of=(("pressure_loss", "film_mismatch"),))
    judgement = judgement_of(
        decision,
        support("pressure_offset", rivals={"creep": 9.0}),
        support("pressure_loss", rivals={"film_mismatch": 0.1}),
    )
    text = explain(judgement, WHERE)
    assert "Beside this one of pressure_loss or film_mismatch acts" in text
    document = verdict_document(judgement, WHERE)
    assert document["causes"] == ["pressure_offset"]
    assert document["one_of"] == [["pressure_loss", "film_mismatch"]]


def test_an_ambiguous_outcome_names_all_that_remain():
    decision = Decision(Outcome.AMBIGUOUS, ("pressure_offset", "pressure_loss"))
    text = explain(judgement_of(decision, support("pressure_offset")), WHERE)
    assert "explained by pressure_offset or pressure_loss" in text
    assert "cannot tell them apart" in text
    for name in ("pressure_offset", "pressure_loss"):
        assert CATALOGUE[name].mechanism in text


def test_an_unexplained_misfit_says_why_the_nearest_cause_is_not_named():
    reasons = ("it removes only 40 % of the misfit", "held-out specimens are not predicted better")
    decision = Decision(Outcome.UNEXPLAINED, (), reasons=reasons)
    text = explain(judgement_of(decision, support("pressure_offset")), WHERE)
    assert "No cause in the catalogue accounts for it." in text
    assert f"The nearest is pressure_offset: {'; '.join(reasons)}." in text
    weak = replace(LOSS, log_bayes_factor=2.5)
    nothing = Decision(Outcome.UNEXPLAINED, ())
    text = explain(judgement_of(nothing, candidates=(weak, UNJUDGED)), WHERE)
    assert "its log Bayes factor 2.5 is below the 4.2 that naming takes" in text


def test_without_any_candidate_there_is_no_nearest():
    judgement = judgement_of(Decision(Outcome.UNEXPLAINED, ()), candidates=(UNJUDGED,))
    assert "nearest" not in explain(judgement, WHERE)


def test_an_adequate_model_is_said_to_be_so():
    text = explain(judgement_of(Decision(Outcome.ADEQUATE, ()), p_value=0.34), WHERE)
    assert "agrees with the measurements" in text
    assert "34 % of 500 data sets" in text
    assert "No cause is named." in text
    assert WHERE not in text


@pytest.mark.parametrize(("larger", "said"), [(0, "none"), (1, "1"), (7, "7")])
def test_simulated_data_sets_that_misfit_as_much_are_counted(larger, said):
    judgement = judgement_of(
        named("pressure_offset"), support("pressure_offset"), p_value=(1 + larger) / 501
    )
    assert f"calibrated model, {said} misfit as much" in explain(judgement, WHERE)


@pytest.mark.parametrize(("p_value", "told"), [(0.01, True), (0.3, False)])
def test_ruptures_are_told_where_they_are_no_chance(p_value, told):
    decision = Decision(Outcome.UNEXPLAINED, ())
    found = RuptureMisfit(3, 0.2, 30.0, p_value)
    judgement = judgement_of(decision, rupture=found)
    said = "3 actuators burst, where the base model expects 0.2 (p = 0.01)."
    assert (said in explain(judgement, WHERE)) == told
    document = verdict_document(judgement, WHERE)
    assert document["ruptures"] == {
        "burst": 3,
        "expected": 0.2,
        "deviance": 30.0,
        "p_value": p_value,
    }
    assert verdict_document(ONE, WHERE)["ruptures"] is None


@pytest.mark.parametrize(("p_value", "told"), [(0.001, True), (0.2, False)])
def test_a_measured_mean_that_is_contradicted_is_told_with_its_source(p_value, told):
    adequate = Decision(Outcome.ADEQUATE, ())
    measured = Statistic("volume_ratio", 0.0, 0.617, 0.026, "shrinkage.csv, 4 films", 3.0)
    found = Conflict(measured, 0.962, 0.036, p_value)
    text = explain(judgement_of(adequate, p_value=0.5, contradicted=found), WHERE)
    assert ("0.962" in text) is told
    assert ("0.617 ± 0.026 was measured (shrinkage.csv, 4 films; p = 0.001)" in text) is told
    document = verdict_document(judgement_of(adequate, contradicted=found), WHERE)
    assert document["contradicted"]["calibrated"] == 0.962
    assert document["contradicted"]["p_value"] == p_value
    assert verdict_document(judgement_of(adequate), WHERE)["contradicted"] is None


def test_a_fit_at_values_off_their_priors_is_no_agreement():
    ratio = Parameter("volume_ratio", TruncatedNormal(0.62, 0.07, 0.1, 1.0), "–", "α")
    judgement = judgement_of(Decision(Outcome.UNEXPLAINED, ()), p_value=0.4)
    text = explain(replace(judgement, questioned=(Questioned(ratio, 0.976, 0.001),)), WHERE)
    assert text.startswith("The readings alone agree with the simulation, but only at values that")
    assert "all but exclude: 0.976 for volume_ratio (α), where 99.9 % of the prior" in text
    assert "within 0.39 to 0.85. Either a prior is wrong, or a reading" in text


def test_a_likely_cause_that_is_not_named_is_not_passed_over_in_silence():
    """The table once said 99.5 % of a cause while the text said that no cause was named."""
    adequate, [leader, *_] = Decision(Outcome.ADEQUATE, ()), CANDIDATES
    below = replace(leader, probability=0.995, log_bayes_factor=3.0)
    text = explain(judgement_of(adequate, p_value=0.4, candidates=(below,)), WHERE)
    assert f"{leader.cause} as the likeliest cause; it is not named" in text
    assert "3.0 is below the 4.2 that naming takes" in text
    above = replace(below, log_bayes_factor=99.0)
    text = explain(judgement_of(adequate, p_value=0.4, candidates=(above,)), WHERE)
    assert "99.0 is that of screening, and no full fit confirms it" in text
    unlikely = replace(below, probability=0.2)
    text = explain(judgement_of(adequate, p_value=0.4, candidates=(unlikely,)), WHERE)
    assert "likeliest" not in text


def test_a_cause_that_evidence_favours_and_held_out_specimens_do_not_is_told():
    adequate = Decision(Outcome.ADEQUATE, (), reasons=("held-out specimens disagree",))
    text = explain(judgement_of(adequate, support("creep"), p_value=0.4), WHERE)
    assert "The evidence favours creep, which is not named: held-out specimens disagree." in text


def test_where_ruptures_alone_are_off_the_readings_are_said_to_agree():
    decision = Decision(Outcome.UNEXPLAINED, ())
    judgement = judgement_of(decision, p_value=0.6, rupture=RuptureMisfit(3, 0.2, 30.0, 0.01))
    text = explain(judgement, WHERE)
    assert text.startswith("The readings alone agree with the simulation.")
    assert WHERE not in text


def test_where_wide_errors_may_hide_a_misfit_it_is_said_so():
    decision = Decision(Outcome.UNEXPLAINED, (), reasons=("what is left is more",))
    judgement = judgement_of(decision, support("creep"), p_value=0.6)
    text = explain(replace(judgement, left=replace(judgement.left, p_value=0.01)), WHERE)
    assert text.startswith("Taken alone, the readings agree with the simulation (60 % of 500")
    assert "but they favour creep, and what is left beside it is more than chance" in text
    assert "(p = 0.01)" in text


def test_specimens_that_deviate_together_are_told_where_no_misfit_is_seen():
    by_level = SharedScatter("degradation_misread", 7.2, 0.95, 0.005)
    reasons = ("degradation_misread lets each specimen deviate on its own, but",)
    decision = Decision(Outcome.UNEXPLAINED, (), reasons=reasons)
    judgement = judgement_of(decision, support("degradation_misread"), p_value=0.6)
    text = explain(replace(judgement, shared=(by_level,)), WHERE)
    assert text.startswith("Taken alone, the readings agree with the simulation (60 % of 500")
    assert "those of one degradation rate deviate together. Ask what they have in common" in text
    assert "The nearest is degradation_misread: degradation_misread lets each specimen" in text


@pytest.mark.parametrize(("lost", "warned"), [(0.04, False), (0.12, True)])
def test_many_simulated_sets_beyond_the_emulator_are_warned_of(lost, warned):
    judgement = judgement_of(Decision(Outcome.ADEQUATE, ()), p_value=0.5, lost=lost)
    assert ("Caution: 12 % of the data sets" in explain(judgement, WHERE)) == warned


def test_the_document_holds_what_was_promised():
    document = verdict_document(ONE, WHERE)
    promised = "outcome causes explanation candidates confusable false_name_rate misfit"
    assert set(document) >= {*promised.split(), "next_experiments"}
    assert document["outcome"] == "named"
    assert document["causes"] == ["pressure_offset"]
    assert document["one_of"] == []
    assert document["confusable"] == [["pressure_loss", "film_mismatch"]]
    assert document["false_name_rate"] == pytest.approx(0.02)
    assert document["naming"] == {"log_bayes_factor": 4.2, "replicates": 500}
    assert document["predicted_with"] == ["pressure_offset"]
    assert document["misfit"] == {
        "rms_per_m": pytest.approx(RESIDUAL),
        "noise_per_m": pytest.approx(LEFT),
        "p_value": 1 / 501,
        "replicates": 500,
        "where": WHERE,
        "concentrated": None,
    }
    assert json.loads(json.dumps(document)) == document


def test_the_false_name_rate_is_never_none_of_as_many_as_were_simulated():
    base = ONE.steps[0]
    assert replace(base, chance=np.zeros(500)).false_name_rate == pytest.approx(1 / 501)
    assert replace(base, chance=np.zeros(0)).false_name_rate is None


def test_where_most_of_the_misfit_sits_is_for_other_tools_too():
    found = Concentration("specimen", ("G7",), (-14.0,), 0.88, 0.06, 0.002)
    document = verdict_document(ONE, WHERE, concentrated=found)
    assert document["misfit"]["concentrated"] == {
        "kind": "specimen",
        "members": ["G7"],
        "excess_pct": [-14.0],
        "share_of_misfit": 0.88,
        "share_of_readings": 0.06,
        "p_value": 0.002,
    }
    assert json.loads(json.dumps(document)) == document


def test_candidates_tell_how_often_chance_gains_as_much():
    known = replace(OFFSET, naming_p_value=0.002)
    document = verdict_document(replace(ONE, candidates=(known, LOSS, UNJUDGED)), WHERE)
    first, *others = document["candidates"]
    assert first["naming_p_value"] == 0.002
    assert all("naming_p_value" not in one for one in others)


def directed_words(p_value):
    supported = support("pressure_offset", chance=1 / 501)
    return explain(judgement_of(named("pressure_offset"), supported, p_value=p_value), WHERE)


def test_where_the_misfit_as_a_whole_shows_it_one_p_value_is_enough():
    assert "directed at the candidates" not in directed_words(1 / 501)


def test_where_the_misfit_as_a_whole_is_chance_the_test_that_names_is_told():
    text = directed_words(0.63)
    assert "directed at the candidates" in text
    assert "with p < 0.002 in data simulated without pressure_offset." in text
    assert "As a whole that is within chance: 63 % of 500 data sets" in text
    assert "misfit as much (p = 0.63)" not in text


@pytest.mark.parametrize(("gain", "unsure"), [(12.1, True), (12.3, False)])
def test_gains_of_joint_causes_within_two_standard_errors_are_said_to_prove_nothing(gain, unsure):
    together = (51.6, 8.0)
    judgement = judgement_of(
        named("pressure_offset", "pressure_loss"),
        support("pressure_offset", together=together),
        support("pressure_loss", gain=gain, together=together),
    )
    text = explain(judgement, WHERE)
    assert "better with pressure_offset beside the others by 39.5 ± 6.1 in log density." in text
    assert f"with pressure_loss beside the others by {gain} ± 6.1 in log density" in text
    assert ("neither confirm nor contradict pressure_loss by itself" in text) is unsure
    assert "All of them together raise it by 51.6 ± 8.0." in text


def test_the_gain_of_a_single_cause_is_not_doubted():
    text = explain(judgement_of(named("pressure_offset"), support("pressure_offset", gain=7.0)), "")
    assert "by 7.0 ± 6.1" in text
    assert "neither confirm" not in text


@pytest.mark.parametrize("outcome", list(Outcome))
def test_only_an_ambiguous_outcome_says_with_which_cause_it_predicts(outcome):
    causes = ("pressure_offset", "pressure_loss")
    decision = Decision(outcome, causes if outcome in ("named", "ambiguous") else ())
    judgement = judgement_of(decision, support("pressure_offset"))
    told = "predicted with pressure_offset, one of the possible answers" in explain(judgement, "")
    assert told is (outcome is Outcome.AMBIGUOUS)
    assert verdict_document(judgement, "")["predicted_with"] == (
        ["pressure_offset"] if decision.causes else []
    )


def test_residuals_are_told_before_and_after_what_is_explained():
    assert readings_misfit(ONE) == (pytest.approx(RESIDUAL), pytest.approx(LEFT))


def test_experiments_are_passed_on():
    plan = [{"experiment": "unloading", "specimens": 3}]
    assert verdict_document(ONE, WHERE, plan)["next_experiments"] == plan
    assert verdict_document(ONE, WHERE)["next_experiments"] == []


def test_candidates_in_the_document_keep_their_order_and_reasons():
    best, second, screened, unjudged = verdict_document(ONE, WHERE)["candidates"]
    names = [c["cause"] for c in (best, second, screened, unjudged)]
    assert names == ["pressure_offset", "pressure_loss", "erosion", "creep"]
    offset = {"mean": 13.9, "sd": 0.6, "q05": 12.9, "q95": 14.9, "unit": "kPa"}
    assert best["effect"] == {"offset": offset}
    assert best["probability"] == 0.95
    assert best["explained_fraction"] == 0.93
    assert best["mechanism"] == CATALOGUE["pressure_offset"].mechanism
    assert best["judged_by"] == second["judged_by"] == "full fit"
    assert screened["judged_by"] == "screening"
    assert screened["effect"] == {}
    assert "why" not in best
    assert "judged_by" not in unjudged
    assert unjudged["probability"] is None
    assert unjudged["why"] == "actuator.csv does not record time_s"


def test_a_study_without_readings_names_nothing():
    document = unjudged_document({"creep": "there are no actuator readings (actuator.csv)"})
    assert set(document) == set(verdict_document(ONE, WHERE))
    assert document["causes"] == []
    assert document["misfit"]["p_value"] is None
    assert document["candidates"][0]["why"].startswith("there are no actuator readings")
    assert "no cause is named" in document["explanation"]


def test_modes_of_tension_that_were_predicted_wrong_are_told_without_readings_to_judge():
    assert "published" not in unjudged_document({})["explanation"]
    assert "published" in unjudged_document({}, published=True)["explanation"]
    document = unjudged_document({}, "Planar tension is off by 3 %.")
    assert document["explanation"].endswith("Planar tension is off by 3 %.")


# ---- what could not be judged


def unknown(outcome, *supported, reasons=("of chance nothing is known",)):
    found = judgement_of(Decision(outcome, (), reasons=reasons), *supported, p_value=np.nan)
    few = replace(found.misfit, null=np.ones(18), drawn=200, lost=0.91)
    return replace(found, misfit=few, search=search_of(few, found.left))


def test_what_could_not_be_set_against_chance_is_neither_adequate_nor_a_misfit():
    text = explain(unknown(Outcome.NOT_JUDGED), WHERE)
    assert "Nothing can be said of whether the base model is adequate" in text
    assert "of chance nothing is known" in text
    assert "agrees with the measurements" not in text
    assert "leave those pressures out of actuator.csv" in text  # what to do
    document = verdict_document(unknown(Outcome.NOT_JUDGED), WHERE)
    assert document["outcome"] == "not_judged"
    assert document["causes"] == document["predicted_with"] == []


def test_what_is_favoured_but_could_not_be_tested_is_told_and_not_named():
    text = explain(unknown(Outcome.NOT_JUDGED, support("pressure_offset")), WHERE)
    assert "The readings favour pressure_offset, but nothing is judged and nothing named" in text


@pytest.mark.parametrize("outcome", [Outcome.UNEXPLAINED, Outcome.NOT_JUDGED])
def test_few_simulated_data_sets_are_counted_in_words(outcome):
    text = explain(unknown(outcome, reasons=()), WHERE)
    if outcome is Outcome.UNEXPLAINED:
        assert "only 18 of 200 simulated data sets stayed within the emulator's range" in text
    assert "nan" not in text


def test_a_named_cause_is_explained_although_the_misfit_was_not_calibrated():
    found = replace(unknown(Outcome.NAMED), decision=named("pressure_offset"))
    found = replace(found, supported=(support("pressure_offset", chance=None),))
    text = explain(found, WHERE)
    assert "The cause is pressure_offset" in text
    assert "only 18 of 200 simulated data sets" in text
    assert "nan" not in text


def test_with_a_cause_that_was_not_sampled_nothing_is_predicted():
    assert ONE.predicted_with == ("pressure_offset",)
    without = replace(ONE, sampled=False)
    assert without.predicted_with == ()
    assert verdict_document(without, WHERE)["predicted_with"] == []


def test_a_verdict_that_failed_says_why_and_what_to_do():
    document = unjudged_document({"creep": "no time"}, "", "It broke.")
    assert set(document) == set(verdict_document(ONE, WHERE))
    assert document["outcome"] == unjudged_document({})["outcome"] == "not_judged"
    for words in ("could not be computed", "It broke.", "left_out.txt", "--seed"):
        assert words in document["explanation"]
