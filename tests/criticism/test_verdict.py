"""Outcomes and their reasons, from what speaks for each cause of a set."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from bayesdeg.causes.creep import CAUSE as CREEP
from bayesdeg.criticism.checks.conflict import questioned_at
from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.checks.known_terms import Acts, KnownTerm, Quantified
from bayesdeg.criticism.checks.missing_terms import MissingTerm, MissingTerms
from bayesdeg.criticism.checks.shared_scatter import SharedScatter
from bayesdeg.criticism.decide import support as supporting
from bayesdeg.criticism.decide import verdict as deciding
from bayesdeg.criticism.decide.support import (
    CLOSE_CALL,
    EXCLUDED,
    IMPLAUSIBLE,
    INSEPARABLE,
    MODERATE,
    TWINS_APART,
    Support,
    least_tail,
    prior_tail,
    supports,
)
from bayesdeg.criticism.decide.verdict import (
    LEAST_CHANGE,
    LEAST_EXPLAINED,
    LEAST_ON_ONE_SCALE,
    MOST_HIDDEN,
    NEARLY_ALL,
    CoarseMap,
    Decision,
    ImplausibleSize,
    LittlePower,
    MisfitRemains,
    NoReduction,
    NotComputed,
    NothingHeldOut,
    NotPredictedBetter,
    NotTested,
    OnEdge,
    SharedByLevel,
    StructureLeft,
    TakenForErrors,
    TooLittleExplained,
    Uncalibrated,
    decide,
    share_explained,
)
from bayesdeg.criticism.findings import Conflict, Detectable, RuptureMisfit
from bayesdeg.criticism.fit.search import Search, SearchEffort, Step, run_search
from bayesdeg.criticism.holdout.held_out import HeldOut
from bayesdeg.criticism.outcome import LEFT_LEVEL, MISFIT_LEVEL, Outcome
from bayesdeg.priors import HalfNormal, LogNormal, Normal, Parameter, TruncatedNormal
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import linear_cause

BASE = frozenset()


def misfit(p_value=0.001, statistic=41.0):
    """Of which 40 nats are more than chance gives."""
    return Misfit(statistic, np.ones(100), p_value, "actuator", "the path", np.zeros(1), 0.0)


WAVE = linear_cause("wave")
OBSERVED = straight.readings(1, wave=0.3)
LACKING, WITH_WAVE = straight.exact_linear(OBSERVED), straight.exact_linear(OBSERVED, WAVE)


def step(p_value=0.001, statistic=41.0, *, linear=LACKING):
    """By default of a model whose misfit is as large with causes as without."""
    return Step(
        trial=SimpleNamespace(linear=linear),
        misfit=misfit(p_value, statistic),
        simulated=np.zeros((0, len(OBSERVED))),
        screened={},
        threshold=4.0,
    )


def support(cause="creep", **changes):
    """A cause for which everything speaks."""
    return replace(Support(cause, 30.0, 20.0, 4.0, {}, 0.3), **changes)


CLEAN = step(0.5, 1.0)


def outcome_of(*supported, base=None, final=CLEAN, **options):
    return decide(base or step(), final, list(supported), **options)


def test_a_cause_for_which_everything_speaks_is_named():
    assert outcome_of(support()) == Decision(Outcome.NAMED, ("creep",))


def test_a_cause_is_not_named_where_the_base_model_stands_on_the_edge_of_its_range():
    lost = replace(misfit(float("nan"), 41.0), lost=0.98, drawn=2400)
    found = outcome_of(support(), base=replace(step(), misfit=lost))
    assert (found.outcome, found.causes) == (Outcome.NOT_JUDGED, ())
    assert isinstance(found.reasons[0], Uncalibrated)
    inside = replace(step(), misfit=replace(lost, lost=0.0))
    assert outcome_of(support(), base=inside).outcome is Outcome.NAMED


@pytest.mark.parametrize(("lost", "outcome"), [(0.009, Outcome.NAMED), (0.02, Outcome.NOT_JUDGED)])
def test_a_cause_is_not_named_where_its_own_model_leaves_the_range(lost, outcome):
    """In one of a hundred simulated data sets, at readings that the verdict tells."""
    places = LACKING.subject.places
    last = places.specimen == places.specimen[-1]
    edge = replace(misfit(0.5, 1.0), lost=lost, unanswered=np.where(last, lost, 0.0))
    found = outcome_of(support(), final=replace(CLEAN, misfit=edge))
    assert found.outcome is outcome
    assert found.reasons == (
        () if outcome is Outcome.NAMED else (OnEdge(lost, (str(places.specimen[-1]),)),)
    )


def test_causes_that_act_together_are_named_together():
    together = outcome_of(support(), support("erosion"))
    assert together == Decision(Outcome.NAMED, ("creep", "erosion"))


@pytest.mark.parametrize(
    ("p_value", "outcome"),
    [
        (MISFIT_LEVEL, Outcome.UNEXPLAINED),
        (MISFIT_LEVEL + 1e-6, Outcome.ADEQUATE),
        (1.0, Outcome.ADEQUATE),
    ],
)
def test_without_a_cause_the_misfit_decides(p_value, outcome):
    assert outcome_of(base=step(p_value)) == Decision(outcome, ())


@pytest.mark.parametrize(
    ("p_value", "alike", "outcome"),
    [
        (MISFIT_LEVEL, ("creep", "erosion"), Outcome.AMBIGUOUS),
        (MISFIT_LEVEL, ("creep",), Outcome.UNEXPLAINED),
        (MISFIT_LEVEL + 1e-6, ("creep", "erosion"), Outcome.ADEQUATE),
    ],
)
def test_a_misfit_may_be_any_cause_that_reads_like_another_form_of_the_law(p_value, alike, outcome):
    causes = alike if outcome is Outcome.AMBIGUOUS else ()
    assert outcome_of(base=step(p_value), alike=alike) == Decision(outcome, causes)


def test_causes_that_read_like_the_law_answer_for_no_contradicted_mean():
    """A measured mean that is contradicted is no misfit of the readings."""
    wrong = Conflict(quantity="volume_ratio", calibrated=0.96, p_value=MISFIT_LEVEL)
    found = outcome_of(base=step(0.5), contradicted=wrong, alike=("creep", "erosion"))
    assert found == Decision(Outcome.UNEXPLAINED, ())


def left_over(largest, *, count_alike=0, p_value=0.004, confirmed=True):
    """What a cause leaves, if a term changes it by as much of the largest reading."""
    path = Quantified("force", "x")
    term = KnownTerm(
        "readings", ("reading",), Acts.PATH, (), path, {"reading": (1.0, "y", "")}, 1.0
    )
    one = MissingTerm(
        term, 0.2, 0.1, 0.3, 12.0, 0.004, 0.8, 9.0, 3.0, (), count_alike, np.zeros(3), largest
    )
    return MissingTerms((one,) if confirmed else (), 187, 300, p_value, one)


def test_a_cause_that_leaves_structure_is_not_named():
    found = outcome_of(support(), structure=left_over(0.1, count_alike=2))
    assert (found.outcome, found.causes) == (Outcome.UNEXPLAINED, ())
    assert found.reasons == (StructureLeft("y(x + b)", ("force",), 0.1, 2, 0.004, 300),)
    quiet = outcome_of(support(), base=step(0.5), structure=left_over(0.1))
    assert quiet.outcome is Outcome.UNEXPLAINED
    doubted = outcome_of(support(), structure=left_over(0.1, confirmed=False))
    assert doubted.outcome is Outcome.UNEXPLAINED


@pytest.mark.parametrize(
    "structure",
    [
        None,
        MissingTerms((), 187, 300, np.nan),
        left_over(0.1, p_value=1.01 * MISFIT_LEVEL),
        left_over(0.99 * LEAST_CHANGE),
    ],
    ids=["not tested", "no data", "chance", "as small as the simulation's own error"],
)
def test_a_cause_is_named_where_nothing_of_any_size_is_left(structure):
    found = outcome_of(support(), structure=structure)
    assert found == Decision(Outcome.NAMED, ("creep",))


def test_structure_speaks_for_no_misfit_where_no_cause_is_favoured():
    assert outcome_of(base=step(0.5), structure=left_over(0.1)).outcome is Outcome.ADEQUATE


@pytest.mark.parametrize("gain", [3.9, -20.0])
def test_what_speaks_against_a_cause_is_said_and_nothing_is_named(gain):
    found = outcome_of(support(elpd_diff=gain))
    assert (found.outcome, found.causes) == (Outcome.UNEXPLAINED, ())
    assert found.reasons == (NotPredictedBetter("creep", gain, 4.0),)
    without = outcome_of(support(elpd_diff=gain), base=step(p_value=0.5))
    assert (without.outcome, without.reasons) == (Outcome.ADEQUATE, found.reasons)


@pytest.mark.parametrize(
    ("p_value", "outcome"), [(0.001, Outcome.UNEXPLAINED), (0.5, Outcome.NOT_JUDGED)]
)
def test_a_cause_with_nothing_to_hold_out_leaves_only_a_misfit_to_be_judged(p_value, outcome):
    single = support(elpd_diff=None, elpd_diff_se=None)
    found = outcome_of(single, base=step(p_value=p_value))
    assert (found.outcome, found.causes) == (outcome, ())
    assert found.reasons == (NothingHeldOut(),)
    brief = outcome_of(single, base=step(p_value=p_value), held_out=False)
    assert (brief.outcome, brief.causes, brief.reasons) == (Outcome.NAMED, ("creep",), ())


@pytest.mark.parametrize(
    ("p_value", "hidden", "outcome"),
    [
        (0.5, MOST_HIDDEN, Outcome.ADEQUATE),
        (0.5, MOST_HIDDEN + 1e-6, Outcome.NOT_JUDGED),
        (0.5, float("nan"), Outcome.NOT_JUDGED),
        (0.001, 100.0, Outcome.UNEXPLAINED),
    ],
)
def test_readings_that_would_hide_a_large_misfit_make_no_model_adequate(p_value, hidden, outcome):
    seen = Detectable(kind="readings", misfit_pct=hidden)
    found = outcome_of(base=step(p_value), detectable=seen)
    assert (found.outcome, found.causes) == (outcome, ())
    assert [type(why) for why in found.reasons] == (
        [LittlePower] if outcome is Outcome.NOT_JUDGED else []
    )


@pytest.mark.parametrize(("count", "outcome"), [(1, Outcome.NOT_JUDGED), (2, Outcome.ADEQUATE)])
def test_one_specimen_makes_no_model_adequate(count, outcome):
    seen = Detectable(kind="readings", misfit_pct=1.0, specimens=count)
    assert outcome_of(base=step(0.5), detectable=seen).outcome is outcome
    assert outcome_of(base=step(0.001), detectable=seen).outcome is Outcome.UNEXPLAINED


def test_a_map_that_errs_by_more_than_the_readings_is_not_called_adequate():
    coarse = CoarseMap(1.7)
    assert outcome_of(base=step(0.5), coarse=coarse).reasons == (coarse,)
    assert outcome_of(base=step(0.001), coarse=coarse).outcome is Outcome.UNEXPLAINED


@pytest.mark.parametrize("supported", [(), (support(),)])
def test_errors_that_the_readings_do_not_have_are_a_misfit(supported):
    errors = TakenForErrors("curvature", 5.0, 0.9)
    found = outcome_of(*supported, base=step(0.5), errors=errors)
    assert (found.outcome, found.causes) == (Outcome.UNEXPLAINED, ())
    assert found.reasons == (errors,)


@pytest.mark.parametrize("p_value", [0.001, 0.5])
def test_scatter_of_whole_levels_is_not_named_as_one_of_single_specimens(p_value):
    """Not even where no misfit is seen: the scatter has taken it up."""
    misread = support("degradation_misread")
    by_level = SharedScatter("degradation_misread", 7.2, 0.95, MISFIT_LEVEL)
    found = outcome_of(misread, base=step(p_value), shared=[by_level])
    assert (found.outcome, found.causes) == (Outcome.UNEXPLAINED, ())
    assert found.reasons == (SharedByLevel("degradation_misread", MISFIT_LEVEL, 0),)
    one_by_one = replace(by_level, p_value=MISFIT_LEVEL + 1e-6)
    named = outcome_of(misread, base=step(p_value), shared=[one_by_one])
    assert named == Decision(Outcome.NAMED, ("degradation_misread",))


@pytest.mark.parametrize(
    ("gain", "together", "close"),
    [
        (4.0 + 0.9 * CLOSE_CALL, None, True),  # its error is 4
        (4.0 - 0.9 * CLOSE_CALL, None, True),
        (4.0 + 1.1 * CLOSE_CALL, None, False),
        (None, None, False),
        (1.1 * CLOSE_CALL, (9.0, 4.0), False),  # of several each has to gain, and all together
        (-0.9 * CLOSE_CALL, (9.0, 4.0), True),
        (9.0, (4.0 + 0.9 * CLOSE_CALL, 4.0), True),
    ],
)
def test_a_gain_next_to_the_least_is_a_close_call(gain, together, close):
    assert support(elpd_diff=gain, together=together).is_close_call is close


def test_one_of_two_causes_with_a_reason_against_it_keeps_both_from_being_named():
    found = outcome_of(support(), support("erosion", elpd_diff=-1.0))
    assert found.outcome is Outcome.UNEXPLAINED
    assert [reason.cause for reason in found.reasons] == ["erosion"]


@pytest.mark.parametrize(
    ("twins", "gap", "causes"),
    [
        (("erosion",), 2.0 * INSEPARABLE - 0.1, ("creep", "erosion")),
        (("erosion",), 2.0 * INSEPARABLE + 0.1, ("creep",)),
        ((), 2.0 * INSEPARABLE - 0.1, ("creep",)),
    ],
)
def test_a_twin_is_as_good_within_twice_the_margin(twins, gap, causes):
    found = outcome_of(support(rivals={"erosion": gap}, twins={"creep": twins}))
    assert found.causes == causes


@pytest.mark.parametrize(
    ("gap", "apart", "causes"),
    [
        (INSEPARABLE - 0.1, TWINS_APART - 0.1, ("creep", "erosion", "batch_stiffness")),
        (INSEPARABLE - 0.1, TWINS_APART + 0.1, ("creep", "erosion")),
        (INSEPARABLE + 0.1, 0.5, ("creep",)),
    ],
)
def test_a_twin_of_a_rival_that_is_as_good_is_as_good_too(gap, apart, causes):
    rivals, alike = ("erosion", "batch_stiffness"), {"erosion": ("batch_stiffness",)}
    alike |= {"batch_stiffness": ("erosion",)}
    gaps = dict(zip(rivals, (gap, gap + apart), strict=True))
    assert outcome_of(support(rivals=gaps, twins=alike)).causes == causes


@pytest.mark.parametrize(
    ("tail", "gap", "causes"),
    [
        (IMPLAUSIBLE / 2.0, 2.0 * INSEPARABLE - 0.1, ("creep", "erosion")),
        (IMPLAUSIBLE / 2.0, 2.0 * INSEPARABLE + 0.1, ("creep",)),
        (IMPLAUSIBLE, INSEPARABLE - 0.1, ("creep", "erosion")),
        (IMPLAUSIBLE, INSEPARABLE + 0.1, ("creep",)),
    ],
)
def test_an_implausible_size_doubles_the_margin_within_which_rivals_are_as_good(tail, gap, causes):
    found = outcome_of(support(prior_tail=tail, rivals={"erosion": gap}))
    outcome = Outcome.NAMED if len(causes) == 1 else Outcome.AMBIGUOUS
    assert found == Decision(outcome, causes)


@pytest.mark.parametrize(
    ("tail", "factor", "outcome"),
    [
        (IMPLAUSIBLE / 2.0, MODERATE - 0.1, Outcome.UNEXPLAINED),
        (IMPLAUSIBLE / 2.0, MODERATE, Outcome.NAMED),
        (IMPLAUSIBLE, MODERATE - 0.1, Outcome.NAMED),
        (0.0, 10.0 * MODERATE, Outcome.NAMED),
    ],
)
def test_a_moderately_better_fit_does_not_carry_an_implausible_size(tail, factor, outcome):
    found = outcome_of(support(prior_tail=tail, log_bayes_factor=factor))
    assert found.outcome is outcome
    named = outcome is Outcome.NAMED
    assert found.reasons == (() if named else (ImplausibleSize("creep", tail, factor),))


def test_no_evidence_carries_an_implausible_size_beside_another_cause():
    tail, factor, gains = IMPLAUSIBLE / 2.0, 10.0 * MODERATE, (60.0, 9.0)
    first = support(prior_tail=tail, log_bayes_factor=factor, together=gains)
    found = outcome_of(first, support("erosion", together=gains))
    assert found.outcome is Outcome.UNEXPLAINED
    assert found.reasons == (ImplausibleSize("creep", tail, factor, beside=True),)
    plausible = replace(first, prior_tail=IMPLAUSIBLE)
    assert outcome_of(plausible, support("erosion", together=gains)).outcome is Outcome.NAMED


def test_a_gain_without_a_standard_error_has_to_be_a_gain():
    single = support(elpd_diff=0.5, elpd_diff_se=None)
    assert single.held_out_agrees
    assert not replace(single, elpd_diff=0.0).held_out_agrees
    # a gain that is not a number agrees with nothing
    assert not replace(single, elpd_diff=float("nan")).held_out_agrees


@pytest.mark.parametrize(
    ("gain", "together", "agrees"),
    [
        (0.1, (20.0, 6.0), True),
        (-0.1, (20.0, 6.0), False),
        (30.0, (5.0, 6.0), False),
        (float("nan"), (20.0, 6.0), False),
        (20.0, (float("nan"), 6.0), False),
    ],
)
def test_one_of_several_must_add_to_what_all_gain_together(gain, together, agrees):
    one = support(elpd_diff=gain, elpd_diff_se=4.0, together=together)
    assert one.held_out_agrees is agrees


@pytest.mark.parametrize(
    ("left", "reason"),
    [
        (1.0 + 40.0 * (1.0 - LEAST_EXPLAINED) + 0.1, TooLittleExplained),
        (1.0 + 40.0 * (1.0 - LEAST_EXPLAINED) - 0.1, MisfitRemains),
        (1.0 + 40.0 * (1.0 - NEARLY_ALL) + 0.1, MisfitRemains),
        (1.0 + 40.0 * (1.0 - NEARLY_ALL) - 0.1, None),
    ],
)
def test_causes_must_remove_the_misfit(left, reason):
    found = outcome_of(support(), final=step(LEFT_LEVEL, left))
    assert found.outcome is (Outcome.UNEXPLAINED if reason else Outcome.NAMED)
    assert [type(one) for one in found.reasons] == ([reason] if reason else [])
    assert all(one.share == pytest.approx((41.0 - left) / 40.0) for one in found.reasons)


@pytest.mark.parametrize("left", [1.0, 41.0, 60.0])
def test_where_what_is_left_is_within_chance_nothing_is_left_to_explain(left):
    """However little the statistic has fallen."""
    fine = outcome_of(support(), final=step(LEFT_LEVEL + 1e-6, left))
    assert fine == Decision(Outcome.NAMED, ("creep",))
    doubted = outcome_of(support(), final=step(LEFT_LEVEL, left))
    assert doubted.outcome is (Outcome.NAMED if left == 1.0 else Outcome.UNEXPLAINED)


def test_the_share_is_taken_on_each_models_own_scale_and_on_one():
    """The second from the linear models: with the wave that is hidden, nearly all of it."""
    same = share_explained(step(), step(0.5, 21.0))
    assert same == pytest.approx((0.5, 0.0), abs=0.1)
    better = share_explained(step(), step(0.5, 21.0, linear=WITH_WAVE))
    assert better[0] == pytest.approx(0.5)
    assert better[1] > NEARLY_ALL


def test_a_misfit_that_the_base_model_hid_by_wide_errors_is_explained_on_one_scale():
    """The base model's own statistic falls by less than half."""
    small = 1.0 + 40.0 * (1.0 - LEAST_EXPLAINED) + 0.1
    hidden = outcome_of(support(), final=step(LEFT_LEVEL, small, linear=WITH_WAVE))
    assert hidden.outcome is Outcome.NAMED
    assert outcome_of(support(), final=step(LEFT_LEVEL, small)).outcome is Outcome.UNEXPLAINED
    assert LEAST_EXPLAINED < LEAST_ON_ONE_SCALE < NEARLY_ALL


def test_where_there_was_no_misfit_to_explain_none_has_to_be():
    slight = step(0.3, 0.5)
    assert share_explained(slight, step(0.2, 3.0)) == (1.0, 1.0)
    assert outcome_of(support(), base=slight, final=CLEAN).outcome is Outcome.NAMED


def test_what_leaves_a_misfit_where_there_was_none_is_not_named():
    """A base model with wide errors expects anything; what is named must expect what there is."""
    none = step(p_value=0.8, statistic=1400.0)
    found = outcome_of(support(), base=none, final=step(p_value=LEFT_LEVEL, statistic=25.0))
    assert found.outcome is Outcome.UNEXPLAINED
    assert found.reasons == (NoReduction(LEFT_LEVEL, 100),)
    failed = support(elpd_diff=-1.0)
    of_rupture = decide(none, step(p_value=MISFIT_LEVEL), [failed], on_rupture=frozenset({"creep"}))
    assert of_rupture.outcome is Outcome.ADEQUATE
    fine = outcome_of(support(), base=none, final=step(p_value=LEFT_LEVEL + 1e-6, statistic=25.0))
    assert fine.outcome is Outcome.NAMED


def test_rivals_within_the_odds_of_twenty_are_ambiguous_and_others_are_not():
    rivals = {"gravity": 1.5, "erosion": INSEPARABLE - 0.01, "mullins": INSEPARABLE + 0.01}
    found = outcome_of(support(rivals=rivals))
    assert found == Decision(Outcome.AMBIGUOUS, ("creep", "gravity", "erosion"))
    assert outcome_of(support(rivals={"mullins": INSEPARABLE + 0.01})).outcome is Outcome.NAMED
    better = outcome_of(support(rivals={"gravity": -0.5}))
    assert better == Decision(Outcome.AMBIGUOUS, ("creep", "gravity"))


def test_a_certain_cause_is_named_and_the_other_is_one_of_several():
    found = outcome_of(support(), support("erosion", rivals={"gravity": 1.0}))
    assert found == Decision(Outcome.NAMED, ("creep",), one_of=(("erosion", "gravity"),))


def test_two_uncertain_causes_are_ambiguous_together_each_told_once():
    found = outcome_of(
        support(rivals={"gravity": 1.0}), support("erosion", rivals={"gravity": 0.5})
    )
    assert found == Decision(Outcome.AMBIGUOUS, ("creep", "gravity", "erosion"))


RUPTURES = RuptureMisfit(burst=3, expected=0.2, deviance=30.0, p_value=MISFIT_LEVEL)


def test_ruptures_that_the_model_does_not_expect_are_a_misfit_too():
    even = step(0.6, 1.0)
    assert outcome_of(base=even, rupture=RUPTURES).outcome is Outcome.UNEXPLAINED
    expected = RUPTURES.model_copy(update={"p_value": 0.3})
    assert outcome_of(base=even, rupture=expected).outcome is Outcome.ADEQUATE
    assert outcome_of(base=even, rupture=None).outcome is Outcome.ADEQUATE


def test_a_measured_mean_that_the_model_contradicts_is_a_misfit_too():
    """Nothing else is off: the readings agree with a volume ratio that nobody measured."""
    wrong = Conflict(quantity="volume_ratio", calibrated=0.96, p_value=MISFIT_LEVEL)
    fine = wrong.model_copy(update={"p_value": MISFIT_LEVEL + 1e-6})
    assert outcome_of(base=CLEAN, contradicted=wrong).outcome is Outcome.UNEXPLAINED
    assert outcome_of(base=CLEAN, contradicted=fine).outcome is Outcome.ADEQUATE


def test_a_value_that_its_prior_excludes_is_a_misfit_too_and_stops_no_naming():
    ratio = Parameter("volume_ratio", TruncatedNormal(0.62, 0.07, 0.1, 1.0), "–", "α")
    off = (questioned_at(ratio, 0.98, 1e-4),)
    assert outcome_of(base=CLEAN, questioned=off).outcome is Outcome.UNEXPLAINED
    assert outcome_of(base=CLEAN).outcome is Outcome.ADEQUATE
    with_cause = outcome_of(support("creep"), questioned=off)
    assert with_cause == outcome_of(support("creep"))
    assert with_cause.outcome is Outcome.NAMED


def test_a_cause_of_ruptures_need_not_explain_the_readings():
    flaws = support("flaw_embrittlement")
    off = step(0.001, 41.0)
    named = outcome_of(flaws, final=off, on_rupture=frozenset({"flaw_embrittlement"}))
    assert named == Decision(Outcome.NAMED, ("flaw_embrittlement",))
    # a cause of readings beside it must
    both = outcome_of(flaws, support(), final=off, on_rupture=frozenset({"flaw_embrittlement"}))
    assert both.outcome is Outcome.UNEXPLAINED


@given(st.floats(0.0, 200.0), st.floats(0.0, 200.0))
@settings(max_examples=25, deadline=None)
def test_the_share_that_is_explained_is_a_share(before, after):
    own, common = share_explained(step(statistic=before), step(statistic=after))
    assert 0.0 <= own <= 1.0
    assert 0.0 <= common <= 1.0


EFFORT = SearchEffort(replicates=60, fitted=3, pairs=0)


def searched(observed, causes):
    base = straight.fitted(straight.subject_of(observed))
    search = Search(base, tuple(causes), EFFORT, np.random.SeedSequence(1))
    return search, run_search(search)


@pytest.fixture(scope="module")
def twins():
    causes = [linear_cause(name) for name in ("offset", "twin", "lag")]
    return searched(straight.readings(1, offset=0.3, lag=0.2), causes)


def test_supports_hold_exact_factors_gains_and_rivals(twins):
    search, chosen = twins
    observed = search.base.subject.observed
    [one] = chosen - {"lag"}
    [other] = {"offset", "twin"} - {one}
    scores = {chosen: 9.0, chosen - {"lag"}: 4.0}
    held_out = {
        names: HeldOut(np.array([total, total + 1.0]), np.zeros((1, 48)))
        for names, total in scores.items()
    }
    found = {support.cause: support for support in supports(search, chosen, held_out)}
    lag, best = linear_cause("lag"), linear_cause(one)
    exact = straight.log_factor(observed, lag, beside=[best])
    assert found["lag"].log_bayes_factor == pytest.approx(exact, abs=0.2)
    assert (found["lag"].elpd_diff, found["lag"].elpd_diff_se) == (10.0, 0.0)
    # the set without the other was not held out
    assert found[one].elpd_diff is None
    assert found[one].together is None
    base = {BASE: HeldOut(np.array([1.0, 5.0]), np.zeros((1, 48)))}
    both = supports(search, chosen, held_out | base)
    gaps = np.array([9.0, 10.0]) - np.array([1.0, 5.0])
    wanted = (gaps.sum(), np.sqrt(2.0) * gaps.std(ddof=1))
    assert all(s.together == pytest.approx(wanted) for s in both)
    gap = straight.log_factor(observed, best, beside=[lag]) - straight.log_factor(
        observed, linear_cause(other), beside=[lag]
    )
    assert found[one].rivals[other] == pytest.approx(gap, abs=0.2)
    assert found[one].inseparable == (other,)
    assert found["lag"].inseparable == ()
    order = [s.log_bayes_factor for s in supports(search, chosen, held_out)]
    assert order == sorted(order, reverse=True)


@pytest.mark.parametrize(("beyond", "settled"), [(0.0, True), (2.0, False)])
def test_a_rival_next_to_the_odds_that_decide_has_its_evidence_settled(
    beyond, settled, monkeypatch
):
    search, chosen = searched(
        straight.readings(1, offset=0.3), [linear_cause(name) for name in ("offset", "twin")]
    )
    [[other, gap]] = supports(search, chosen, {})[0].rivals.items()
    assert not search.trials[chosen].settled_by
    monkeypatch.setattr(supporting, "INSEPARABLE", gap + beyond)
    [one] = supports(search, chosen, {})
    sets = [chosen, frozenset({other})]
    assert [search.trials[names].settled_by > 0 for names in sets] == [settled, settled]
    assert one.rivals[other] == search.factor(chosen) - search.factor(frozenset({other}))


def test_confusable_causes_are_told_as_one_of_them(twins):
    search, chosen = twins
    fine = {
        names: HeldOut(np.full(6, 10.0 * len(names)), np.zeros((1, 48)))
        for names in (chosen, *(chosen - {name} for name in chosen))
    }
    found = decide(search.step(BASE), search.step(chosen), supports(search, chosen, fine))
    assert found.outcome is Outcome.NAMED
    assert found.causes == ("lag",)
    assert [set(names) for names in found.one_of] == [{"offset", "twin"}]


@pytest.mark.parametrize(
    ("law", "of_law"),
    [
        (Normal(0.0, 0.1), lambda size: 2.0 * norm.sf(abs(size) / 0.1)),
        (Normal(0.05, 0.1), lambda s: norm.sf((s - 0.05) / 0.1) + norm.cdf((-s - 0.05) / 0.1)),
        (TruncatedNormal(0.0, 0.1, 0.0, np.inf), lambda size: 2.0 * norm.sf(size / 0.1)),
    ],
)
def test_the_tail_of_the_prior_is_that_of_its_law(law, of_law):
    cause = linear_cause("wave", law=law)
    search, chosen = searched(straight.readings(2, wave=0.2), [cause])
    assert chosen == {"wave"}
    size = search.trials[chosen].mode[-1]
    assert prior_tail(cause, size) == pytest.approx(of_law(size), abs=2e-3)
    assert of_law(size) > 0.005


@pytest.mark.parametrize(
    ("law", "neutral", "value", "tail"),
    [
        (Normal(0.0, 1.0), 0.0, 3.0, 2.0 * norm.sf(3.0)),
        (Normal(0.0, 1.0), 0.0, -3.0, 2.0 * norm.sf(3.0)),
        (TruncatedNormal(0.0, 0.12, 0.0, 1.0), 0.0, 0.36, 2.0 * norm.sf(3.0)),
        (TruncatedNormal(0.0, 0.12, 0.0, 1.0), 0.0, 0.0, 1.0),
        (HalfNormal(1.0), 0.0, 3.0, 2.0 * norm.sf(3.0)),  # neutral at an end of the scale
        (LogNormal(1.0, 0.5), 1.0, float(np.exp(1.5)), 2.0 * norm.sf(3.0)),
        (Normal(14.0, 1.0), 0.0, 17.0, norm.sf(3.0)),  # a user's own prior, off neutral
        (Normal(14.0, 1.0), 0.0, 5.0, 1.0),
        (Normal(14.0, 1.0), 0.0, -14.0, 0.0),
    ],
)
def test_the_prior_tail_is_that_beyond_a_size_seen_from_neutral(law, neutral, value, tail):
    given = replace(linear_cause("wave"), parameters=(Parameter("size", law, "–", "x", neutral),))
    found = prior_tail(given, float(law.to_unconstrained(value)))
    assert found == pytest.approx(tail, abs=1e-4)


@pytest.mark.parametrize(
    ("size", "sd", "law"),
    [
        (0.3, 0.01, Normal(0.0, 0.1)),
        (0.3, 0.3, Normal(0.0, 0.1)),
        (-0.5, 0.1, Normal(0.0, 0.1)),
        (0.17999, 1e-6, TruncatedNormal(0.0, 0.1, 0.0, 0.18)),  # at a bound, but not improbable
        (0.38, 0.01, TruncatedNormal(0.0, 0.1, 0.0, 1.0)),
    ],
)
def test_the_end_of_the_interval_next_to_neutral_decides_whether_a_size_is_heard_of(size, sd, law):
    cause = linear_cause("wave", law=law)
    draws = norm.ppf((np.arange(2000) + 0.5) / 2000.0, size, sd)[:, None]
    trial = SimpleNamespace(
        subject=SimpleNamespace(table=SimpleNamespace(names=("wave.size",))),
        posterior=SimpleNamespace(effective=100.0),
        draws=lambda generator, count: draws,
    )
    end = max(abs(size) - norm.ppf(0.95) * sd, 0.0)
    assert least_tail(trial, cause) == pytest.approx(2.0 * norm.sf(end / 0.1), abs=1e-3)
    worthless = SimpleNamespace(posterior=SimpleNamespace(effective=0.0))
    assert least_tail(worthless, cause) == 1.0


@pytest.mark.parametrize(("seconds", "is_heard_of"), [(30.0, True), (1e5, False)])
def test_a_pace_that_a_cause_does_not_have_is_not_heard_of_either(seconds, is_heard_of):
    amount, pace = CREEP.parameters
    centre = float(pace.law.to_unconstrained(seconds))
    at = np.array([float(amount.law.to_unconstrained(0.1)), centre])
    draws = at + 0.01 * norm.ppf((np.arange(2000) + 0.5) / 2000.0)[:, None]
    trial = SimpleNamespace(
        subject=SimpleNamespace(
            table=SimpleNamespace(names=("creep.amount", "creep.time_constant"))
        ),
        posterior=SimpleNamespace(effective=100.0),
        draws=lambda generator, count: draws,
    )
    assert (least_tail(trial, CREEP) >= EXCLUDED) is is_heard_of


# ---- what could not be set against chance


UNKNOWN = step(np.nan)
UNKNOWN = replace(UNKNOWN, misfit=replace(UNKNOWN.misfit, null=np.ones(18), drawn=200))


def test_a_misfit_that_could_not_be_set_against_chance_is_never_adequate():
    found = outcome_of(base=UNKNOWN)
    assert (found.outcome, found.causes) == (Outcome.NOT_JUDGED, ())
    assert found.reasons == (Uncalibrated(18, 200),)


def test_what_is_known_beside_it_still_contradicts_the_model():
    burst = RuptureMisfit(burst=3, expected=0.1, deviance=9.0, p_value=MISFIT_LEVEL)
    assert outcome_of(base=UNKNOWN, rupture=burst).outcome is Outcome.UNEXPLAINED


def test_a_cause_that_removes_the_misfit_may_be_named_although_that_was_not_calibrated():
    """What is left is calibrated, and held-out specimens confirm it."""
    assert outcome_of(support(), base=UNKNOWN) == Decision(Outcome.NAMED, ("creep",))


@pytest.mark.parametrize(
    ("share", "reason"),
    [
        (0.5, TooLittleExplained(0.5)),
        (NEARLY_ALL - 0.01, Uncalibrated(18, 200, remaining=True)),
        (NEARLY_ALL, None),
    ],
)
def test_with_what_is_left_unknown_the_cause_must_remove_nearly_all(monkeypatch, share, reason):
    monkeypatch.setattr(deciding, "explained_on_one_scale", lambda *_: share)
    found = outcome_of(support(), final=UNKNOWN)
    assert found.outcome is (Outcome.UNEXPLAINED if reason else Outcome.NAMED)
    assert found.reasons == ((reason,) if reason else ())


def test_an_unknown_misfit_is_not_one_that_was_not_reduced(monkeypatch):
    monkeypatch.setattr(deciding, "explained_on_one_scale", lambda *_: NEARLY_ALL)
    found = outcome_of(support(), base=step(0.3), final=UNKNOWN)
    assert (found.outcome, found.reasons) == (Outcome.NAMED, ())


@pytest.mark.parametrize("p_value", [0.5, 0.001])
def test_a_cause_that_missed_a_test_is_not_named(p_value):
    untested = (NotComputed("held-out specimens", "It broke."),)
    found = outcome_of(support(), base=step(p_value), untested=untested)
    assert found == Decision(Outcome.NOT_JUDGED, (), reasons=untested)
    # where nothing is favoured, nothing had to be tested
    without = outcome_of(base=step(p_value), untested=untested)
    assert without == outcome_of(base=step(p_value))


def test_a_shared_scatter_that_could_not_be_tested_names_nothing():
    untested = SharedScatter("creep", 3.0, 0.5, np.nan)
    assert not untested.is_more_than_chance
    found = outcome_of(support(), shared=[untested])
    assert found.outcome is Outcome.NOT_JUDGED
    assert found.reasons == (NotTested("creep"),)
