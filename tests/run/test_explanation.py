"""The verdict in plain words, and as the document that other tools read."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bayesdeg.analysis.judge import Judgement, readings_misfit
from bayesdeg.causes.catalogue import CATALOGUE, mechanism_of
from bayesdeg.criticism.checks.conflict import questioned_at
from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.checks.shared_scatter import SharedScatter
from bayesdeg.criticism.decide.candidates import FULL_FIT, SCREENING, Confusability
from bayesdeg.criticism.decide.support import Support
from bayesdeg.criticism.decide.verdict import (
    Decision,
    ExcludedSize,
    NoReduction,
    NotPredictedBetter,
    TooLittleExplained,
    Uncalibrated,
)
from bayesdeg.criticism.findings import (
    Candidate,
    Concentration,
    Conflict,
    EffectSize,
    ExperimentEntry,
    RuptureMisfit,
)
from bayesdeg.criticism.fit.search import Step
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.priors import Parameter, TruncatedNormal
from bayesdeg.run import record
from bayesdeg.run.record import explain
from bayesdeg.run.stages import _final
from tests.criticism.linear_case import known_linear, with_readings
from tests.pages.test_findings import SAMPLED


def verdict_document(*arguments, **options):
    return record.verdict_document(*arguments, **options).document()


def unjudged_document(*arguments, **options):
    return record.unjudged_document(*arguments, **options).document()


WHERE = "Measured curvature lies below the simulation by 12 % on average at 20–80 kPa."
OFFSET = Candidate(
    cause="pressure_offset",
    probability=0.95,
    log_bayes_factor=41.2,
    elpd_diff=39.5,
    elpd_diff_se=6.1,
    explained_fraction=0.93,
    effect={"offset": EffectSize(mean=13.9, sd=0.6, q05=12.9, q95=14.9, unit="kPa")},
    mechanism=mechanism_of("pressure_offset"),
    judged_by=FULL_FIT,
)
LOSS = Candidate(
    cause="pressure_loss",
    probability=0.04,
    log_bayes_factor=6.0,
    elpd_diff=3.0,
    elpd_diff_se=4.0,
    explained_fraction=0.4,
    effect={"fraction": EffectSize(mean=0.1, sd=0.02, q05=0.06, q95=0.13, unit="–")},
    judged_by=FULL_FIT,
)
SCREENED = Candidate(cause="erosion", probability=0.01, log_bayes_factor=1.5, judged_by=SCREENING)
UNJUDGED = Candidate(cause="creep", why="actuator.csv does not record time_s")
RUPTURES = RuptureMisfit(burst=3, expected=0.2, deviance=30.0, p_value=0.01)
CONTRADICTED = Conflict(
    quantity="volume_ratio",
    measured=0.617,
    standard_error=0.026,
    source="shrinkage.csv, 4 films",
    calibrated=0.962,
    p_value=0.001,
    calibrated_sd=0.036,
)


def with_new(record, **new):
    return record.model_copy(update=new)


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

    return SimpleNamespace(base=trial, step=step, causes=())


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
        experiments=(),
    )


def named(*causes, one_of=()):
    return Decision(Outcome.NAMED, causes, one_of=one_of)


ONE = judgement_of(
    named("pressure_offset"), support("pressure_offset", rivals={"pressure_loss": 35.2})
)


def cases():
    """Judgements of every kind, by what is special in them."""
    unexplained, adequate = Decision(Outcome.UNEXPLAINED, ()), Decision(Outcome.ADEQUATE, ())
    together = (51.6, 8.0)
    hidden = judgement_of(
        Decision(Outcome.UNEXPLAINED, (), reasons=(NoReduction(0.01, 500),)),
        support("creep"),
        p_value=0.6,
    )
    ratio = Parameter("volume_ratio", TruncatedNormal(0.62, 0.07, 0.1, 1.0), "–", "α")
    likely = with_new(OFFSET, probability=0.995, log_bayes_factor=3.0)
    off_prior = judgement_of(unexplained, p_value=0.4)
    uncalibrated = replace(unknown(Outcome.NAMED), decision=named("pressure_offset"))
    return {
        "named": ONE,
        "named without rivals, size without unit": judgement_of(
            named("pressure_loss"), support("pressure_loss")
        ),
        "several named, one within two standard errors": judgement_of(
            named("pressure_offset", "pressure_loss"),
            support("pressure_offset", rivals={"creep": 9.0}, together=together),
            support("pressure_loss", rivals={"film_mismatch": 4.0}, gain=12.1, together=together),
        ),
        "named with one of two more": judgement_of(
            named("pressure_offset", one_of=(("pressure_loss", "film_mismatch"),)),
            support("pressure_offset", rivals={"creep": 9.0}),
            support("pressure_loss", rivals={"film_mismatch": 0.1}),
        ),
        "named by the directed test": judgement_of(
            named("pressure_offset"), support("pressure_offset", chance=0.002), p_value=0.63
        ),
        "named, misfit not calibrated": replace(
            uncalibrated, supported=(support("pressure_offset", chance=None),)
        ),
        "named, something is left": replace(ONE, left=replace(ONE.left, p_value=0.01)),
        "named, a rival refuted": replace(
            judgement_of(named("pressure_loss"), support("pressure_loss")),
            refuted={frozenset({"pressure_offset"}): (TooLittleExplained(0.4),)},
        ),
        "ambiguous": judgement_of(
            Decision(Outcome.AMBIGUOUS, ("pressure_offset", "pressure_loss")),
            support("pressure_offset"),
        ),
        "ambiguous, a pair refuted": replace(
            judgement_of(
                Decision(Outcome.AMBIGUOUS, ("pressure_offset", "pressure_loss")),
                support("pressure_offset"),
            ),
            refuted={frozenset({"creep", "erosion"}): (NoReduction(0.01, 500),)},
        ),
        "ambiguous, one of two together with one of two": judgement_of(
            replace(
                Decision(Outcome.AMBIGUOUS, ("creep", "erosion", "pressure_loss", "gravity")),
                sets=(("creep", "erosion"), ("pressure_loss", "gravity")),
            ),
            support("creep"),
            support("pressure_loss"),
        ),
        "ambiguous, one of two sets": judgement_of(
            replace(
                Decision(Outcome.AMBIGUOUS, ("creep", "erosion", "pressure_loss", "gravity")),
                alternatives=(("creep", "pressure_loss"), ("erosion", "gravity")),
            ),
            support("creep"),
            support("pressure_loss"),
        ),
        "named, and one of two sets beside it": judgement_of(
            replace(
                named("pressure_offset", one_of=(("creep", "erosion", "gravity", "mullins"),)),
                alternatives=(
                    ("pressure_offset", "creep", "erosion"),
                    ("gravity", "mullins", "pressure_offset"),
                ),
            ),
            support("pressure_offset"),
            support("creep"),
            support("erosion"),
        ),
        "ambiguous, films in one mode": judgement_of(
            Decision(Outcome.AMBIGUOUS, ("second_invariant", "stress_measure"))
        ),
        "unexplained, not named for reasons": judgement_of(
            Decision(
                Outcome.UNEXPLAINED,
                (),
                reasons=(TooLittleExplained(0.4), NotPredictedBetter("creep", -20.0, 4.0)),
            ),
            support("pressure_offset"),
        ),
        "unexplained, rivals refuted too": replace(
            judgement_of(
                Decision(Outcome.UNEXPLAINED, (), reasons=(ExcludedSize("pressure_offset", 0.0),)),
                support("pressure_offset"),
            ),
            refuted={
                frozenset({"pressure_offset"}): (ExcludedSize("pressure_offset", 0.0),),
                frozenset({"creep"}): (TooLittleExplained(0.4),),
                frozenset({"gravity"}): (TooLittleExplained(0.3),),
                frozenset({"mullins"}): (TooLittleExplained(0.2),),
                frozenset({"erosion"}): (TooLittleExplained(0.1),),
            },
        ),
        "unexplained, evidence too weak": judgement_of(
            unexplained, candidates=(with_new(LOSS, log_bayes_factor=2.5), UNJUDGED)
        ),
        "unexplained without candidates": judgement_of(unexplained, candidates=(UNJUDGED,)),
        "unexplained, wide errors": replace(hidden, left=replace(hidden.left, p_value=0.01)),
        "unexplained, levels deviate together": replace(
            hidden, shared=(SharedScatter("creep", 7.2, 0.95, 0.005),)
        ),
        "unexplained, values off their priors": replace(
            off_prior, questioned=(questioned_at(ratio, 0.976, 0.001),)
        ),
        "unexplained by ruptures alone": judgement_of(unexplained, p_value=0.6, rupture=RUPTURES),
        "adequate, a measured mean contradicted, sets lost": judgement_of(
            adequate, p_value=0.34, contradicted=CONTRADICTED, lost=0.12
        ),
        "adequate, a likely cause too weak": judgement_of(
            adequate, p_value=0.4, candidates=(likely,)
        ),
        "adequate, a likely cause of screening": judgement_of(
            adequate, p_value=0.4, candidates=(with_new(likely, log_bayes_factor=99.0),)
        ),
        "adequate, favoured but not held out": judgement_of(
            Decision(Outcome.ADEQUATE, (), reasons=(NotPredictedBetter("creep", 3.9, 4.0),)),
            support("creep"),
            p_value=0.4,
        ),
        "adequate, films in one mode": replace(
            judgement_of(adequate, p_value=0.4, candidates=()), alike=("second_invariant",)
        ),
        "not judged": unknown(Outcome.NOT_JUDGED),
        "not judged, a cause favoured": unknown(Outcome.NOT_JUDGED, support("pressure_offset")),
    }


FEW = (Uncalibrated(18, 200),)


def unknown(outcome, *supported):
    found = judgement_of(Decision(outcome, (), reasons=FEW), *supported, p_value=np.nan)
    few = replace(found.misfit, null=np.ones(18), drawn=200, lost=0.91)
    return replace(found, misfit=few, search=search_of(few, found.left))


SENTENCES = Path(__file__).with_name("explanations.json")


@pytest.mark.parametrize("name", cases())
def test_every_sentence_of_the_explanation_is_rendered(name):
    """To accept new words: ``python -m tests.run.test_explanation``, and read the changes."""
    assert explain(cases()[name], WHERE) == json.loads(SENTENCES.read_text("utf-8"))[name]


def changed(judgement, **changes):
    """Return whether the explanation is another with these changes."""
    return explain(replace(judgement, **changes), WHERE) != explain(judgement, WHERE)


def test_numbers_of_a_named_cause_are_those_of_the_judgement():
    text = explain(ONE, WHERE)
    assert text.startswith(WHERE)
    assert CATALOGUE["pressure_offset"].mechanism in text
    for number in ("13.9 kPa", "12.9 to 14.9", "100 %", "39.5 ± 6.1", "35.2", "500"):
        assert number in text


@pytest.mark.parametrize("name", cases())
def test_no_number_is_missing_in_any_explanation(name):
    text = explain(cases()[name], WHERE)
    assert not re.search(r"nan|None|\{|  | \.|\.\.", text)
    assert text.endswith(".")


@pytest.mark.parametrize(("larger", "said"), [(0, "none"), (1, "1"), (7, "7")])
def test_simulated_data_sets_that_misfit_as_much_are_counted(larger, said):
    judgement = judgement_of(
        named("pressure_offset"), support("pressure_offset"), p_value=(1 + larger) / 501
    )
    assert f"model, {said} ha" in explain(judgement, WHERE)


@pytest.mark.parametrize(("p_value", "told"), [(0.01, True), (0.3, False)])
def test_ruptures_are_told_where_they_are_no_chance(p_value, told):
    judgement = judgement_of(Decision(Outcome.UNEXPLAINED, ()))
    found = with_new(RUPTURES, p_value=p_value)
    assert changed(judgement, rupture=found) == told
    document = verdict_document(replace(judgement, rupture=found), WHERE)
    assert document["ruptures"] == {
        "burst": 3,
        "expected": 0.2,
        "deviance": 30.0,
        "p_value": p_value,
    }
    assert verdict_document(ONE, WHERE)["ruptures"] is None


@pytest.mark.parametrize(("p_value", "told"), [(0.001, True), (0.2, False)])
def test_a_measured_mean_that_is_contradicted_is_told_with_its_source(p_value, told):
    judgement = judgement_of(Decision(Outcome.ADEQUATE, ()), p_value=0.5)
    found = with_new(CONTRADICTED, p_value=p_value)
    assert changed(judgement, contradicted=found) == told
    document = verdict_document(replace(judgement, contradicted=found), WHERE)
    assert document["contradicted"]["calibrated"] == 0.962
    assert document["contradicted"]["p_value"] == p_value
    assert verdict_document(judgement, WHERE)["contradicted"] is None


@pytest.mark.parametrize(("probability", "told"), [(0.995, True), (0.2, False)])
def test_a_likely_cause_that_is_not_named_is_not_passed_over_in_silence(probability, told):
    """The table once said 99.5 % of a cause while the text said that no cause was named."""
    judgement = judgement_of(Decision(Outcome.ADEQUATE, ()), p_value=0.4, candidates=())
    known = with_new(OFFSET, probability=probability, log_bayes_factor=3.0)
    assert changed(judgement, candidates=(known,)) == told


@pytest.mark.parametrize("outcome", [Outcome.ADEQUATE, Outcome.UNEXPLAINED])
def test_a_threshold_beyond_all_bounds_is_not_given_as_a_number(outcome):
    judgement = judgement_of(Decision(outcome, ()), p_value=0.004, candidates=())
    known = with_new(OFFSET, probability=0.9, log_bayes_factor=3.0)
    text, usual = (
        explain(replace(judgement, candidates=(known,), threshold=threshold), WHERE)
        for threshold in (7465220.1, 12.5)
    )
    assert "7465220" not in text
    assert "arbitrarily large" in text
    assert "12.5 that naming" in usual


@pytest.mark.parametrize(("lost", "warned"), [(0.04, False), (0.12, True)])
def test_many_simulated_sets_beyond_the_emulator_are_warned_of(lost, warned):
    judgement = judgement_of(Decision(Outcome.ADEQUATE, ()), p_value=0.5)
    assert changed(judgement, misfit=replace(judgement.misfit, lost=lost)) == warned


@pytest.mark.parametrize(("p_value", "told"), [(1 / 501, False), (0.63, True)])
def test_the_test_that_names_is_told_where_the_misfit_as_a_whole_is_chance(p_value, told):
    without = judgement_of(named("pressure_offset"), support("pressure_offset"), p_value=p_value)
    assert changed(without, supported=(support("pressure_offset", chance=0.002),)) == told


@pytest.mark.parametrize(("gain", "unsure"), [(12.1, True), (12.3, False)])
def test_gains_of_joint_causes_within_two_standard_errors_are_said_to_prove_nothing(gain, unsure):
    first, second = support("pressure_offset"), support("pressure_loss", gain=gain)
    judgement = judgement_of(named("pressure_offset", "pressure_loss"), first, second)
    text, sure = (
        explain(replace(judgement, supported=(first, one)), WHERE)
        for one in (second, replace(second, elpd_diff=99.0))
    )
    assert (len(text) > len(sure)) is unsure


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


def test_the_document_holds_the_lists_or_the_sets_that_may_be_right():
    known = cases()
    lists = verdict_document(known["ambiguous, one of two together with one of two"], WHERE)
    assert lists["sets"] == [["creep", "erosion"], ["pressure_loss", "gravity"]]
    assert lists["alternatives"] == []
    sets = verdict_document(known["ambiguous, one of two sets"], WHERE)
    assert sets["sets"] == []
    assert sets["alternatives"] == [["creep", "pressure_loss"], ["erosion", "gravity"]]


def test_the_false_name_rate_is_never_none_of_as_many_as_were_simulated():
    base = ONE.steps[0]
    assert replace(base, chance=np.zeros(500)).false_name_rate == pytest.approx(1 / 501)
    assert replace(base, chance=np.zeros(0)).false_name_rate is None


def test_where_most_of_the_misfit_sits_is_for_other_tools_too():
    found = Concentration(
        kind="specimen",
        members=("G7",),
        excess_pct=(-14.0,),
        share_of_misfit=0.88,
        share_of_readings=0.06,
        p_value=0.002,
    )
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
    known = with_new(OFFSET, naming_p_value=0.002)
    document = verdict_document(replace(ONE, candidates=(known, LOSS, UNJUDGED)), WHERE)
    first, *others = document["candidates"]
    assert first["naming_p_value"] == 0.002
    assert all("naming_p_value" not in one for one in others)


@pytest.mark.parametrize("outcome", list(Outcome))
def test_only_an_ambiguous_outcome_says_with_which_cause_it_predicts(outcome):
    causes = ("pressure_offset", "pressure_loss")
    decision = Decision(outcome, causes if outcome in ("named", "ambiguous") else ())
    judgement = judgement_of(decision, support("pressure_offset"))
    assert changed(judgement, sampled=False) is (outcome is Outcome.AMBIGUOUS)
    assert verdict_document(judgement, "")["predicted_with"] == (
        ["pressure_offset"] if decision.causes else []
    )


def test_residuals_are_told_before_and_after_what_is_explained():
    assert readings_misfit(ONE) == (pytest.approx(RESIDUAL), pytest.approx(LEFT))


PLAN = {"design": "unloading", "separates": ["creep", "mullins"], "specimens": 3}


def test_experiments_are_passed_on():
    judgement = replace(ONE, experiments=(ExperimentEntry(**PLAN),))
    [planned] = verdict_document(judgement, WHERE)["next_experiments"]
    assert planned == PLAN | {"expected_log_bayes_factor": None, "pairs": []}
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
    assert unjudged["why"] == UNJUDGED.why


def test_a_study_without_readings_names_nothing():
    document = unjudged_document({"creep": "no actuator.csv"})
    assert set(document) == set(verdict_document(ONE, WHERE))
    assert document["causes"] == []
    assert document["misfit"]["p_value"] is None
    assert document["candidates"][0]["why"] == "no actuator.csv"


NOTE = "Planar tension is off by 3 %."


def test_modes_of_tension_that_were_predicted_wrong_are_told_without_readings_to_judge():
    assert "published" not in unjudged_document({})["explanation"]
    assert "published" in unjudged_document({}, published=True)["explanation"]
    document = unjudged_document({}, NOTE)
    assert document["explanation"].endswith(NOTE)


def test_what_could_not_be_set_against_chance_is_neither_adequate_nor_a_misfit():
    document = verdict_document(unknown(Outcome.NOT_JUDGED), WHERE)
    assert document["outcome"] == "not_judged"
    assert document["causes"] == document["predicted_with"] == []


def test_with_a_cause_that_was_not_sampled_nothing_is_predicted():
    assert ONE.predicted_with == ("pressure_offset",)
    without = replace(ONE, sampled=False)
    assert without.predicted_with == ()
    assert verdict_document(without, WHERE)["predicted_with"] == []


def test_causes_with_which_the_sampler_does_not_converge_are_not_named():
    stuck = SimpleNamespace(diagnosis=replace(SAMPLED, r_hat=(1.82, 1.0), ess_bulk=(21.4, 900.0)))
    base = object()
    model, judged = _final(base, ONE, (None, None), lambda *_, **__: stuck, None)
    assert model is base
    document = verdict_document(judged, WHERE)
    assert document["outcome"] == "not_judged"
    assert document["causes"] == document["predicted_with"] == []
    for words in ("pressure_offset", "not converged", "1.82", "21 effective"):
        assert words in document["explanation"]


def test_a_verdict_that_failed_says_why_and_what_to_do():
    document = unjudged_document({"creep": "no time"}, "", "It broke.")
    assert set(document) == set(verdict_document(ONE, WHERE))
    assert document["outcome"] == unjudged_document({})["outcome"] == "not_judged"
    for words in ("could not be computed", "It broke.", "left_out.txt", "--seed"):
        assert words in document["explanation"]


if __name__ == "__main__":
    found = {name: explain(judgement, WHERE) for name, judgement in cases().items()}
    SENTENCES.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", "utf-8")
