"""Causes of rupture compete for counts: on a small study whose own actuators did not burst."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.common_factor import COMMON_FACTOR
from bayesdeg.criticism.decide.counted import judge_counts
from bayesdeg.criticism.decide.verdict import decide
from bayesdeg.criticism.fit.search import LEAST_FACTOR
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.pages.wording import worded
from tests.criticism.test_count_misfit import counted
from tests.criticism.test_verdict import step
from tests.inference.small_study import small_model

OF_RUPTURE = (CATALOGUE["flaw_embrittlement"], CATALOGUE["dry_embrittlement"])
RATES = (0.0, 12.5, 20.0, 25.0)


@pytest.fixture(scope="module")
def parent():
    return base_without_chain(small_model(), np.random.SeedSequence(1))


def judged(parent, ruptured, causes=OF_RUPTURE, *, tested=3):
    tests = counted([tested] * 4, ruptured, degradation=RATES, pressure=100.0)
    return judge_counts(parent, RuptureCounts(tests), causes, np.random.default_rng(2))


@pytest.fixture(scope="module")
def far_degraded(parent):
    """Two of three burst at 25 %, and none below."""
    return judged(parent, [0, 0, 0, 2])


def test_counts_that_are_expected_ask_for_no_cause(parent):
    found = judged(parent, [0, 0, 0, 0])
    assert not found.misfit.contradicts
    assert found.tried == found.supported == found.explained_by == ()


def test_what_the_model_holds_for_impossible_is_explained_by_either_of_two(far_degraded):
    assert far_degraded.misfit.contradicts
    assert set(far_degraded.explained_by) == {"flaw_embrittlement", "dry_embrittlement"}
    [support] = far_degraded.supported
    assert support.held_out_agrees
    assert support.is_plausible
    assert support.log_bayes_factor > far_degraded.threshold >= LEAST_FACTOR
    assert not far_degraded.best.left.contradicts


def test_evidence_is_that_of_models_fitted_to_readings_and_counts(far_degraded, parent):
    """With a prior that has the size all but right, by averages over draws from it."""
    best = far_degraded.tried[0]
    again = replace(parent, subject=best.trial.subject)
    draws = best.trial.draws(np.random.default_rng(0), 4)
    assert draws.shape == (4, len(again.subject.table))
    assert np.isfinite(best.trial.subject.log_prob(best.trial.mode[None])[0])
    gained = best.trial.log_evidence - parent.log_evidence
    assert gained == pytest.approx(best.support.log_bayes_factor)


def test_a_cut_of_all_limits_alike_is_behind_where_the_order_of_ruptures_is_reversed(far_degraded):
    common = next(one for one in far_degraded.tried if one.name == COMMON_FACTOR.name)
    assert common.support.log_bayes_factor < far_degraded.best.support.log_bayes_factor
    assert COMMON_FACTOR.name not in far_degraded.explained_by
    assert COMMON_FACTOR.name not in far_degraded.candidates


def test_alone_in_the_catalogue_a_cause_is_named(parent):
    found = judged(parent, [0, 0, 0, 2], OF_RUPTURE[:1])
    assert found.explained_by == ("flaw_embrittlement",)


def test_flaws_of_the_far_degraded_do_not_explain_fresh_ruptures(parent):
    found = judged(parent, [3, 0, 0, 0])
    assert found.misfit.contradicts
    assert found.explained_by == ()
    of_degraded = [one.support for one in found.tried if one.name != COMMON_FACTOR.name]
    assert max(one.log_bayes_factor for one in of_degraded) < found.threshold


def test_probabilities_of_the_causes_and_none_of_them_sum_to_at_most_one(far_degraded):
    shares = [one.probability for one in far_degraded.candidates.values()]
    assert 0.99 < sum(shares) <= 1.0
    sizes = far_degraded.candidates["flaw_embrittlement"].effect["cut"]
    assert 0.0 < sizes.q05 < sizes.mean < sizes.q95


def test_the_words_name_what_explains_and_what_does_not(far_degraded):
    said = worded(far_degraded)
    assert "2 of 12" in said
    assert "(2 of 3 at 25 %)" in said
    assert "flaw_embrittlement" in said
    assert "dry_embrittlement" in said
    assert "size effect" in said


def test_the_same_seed_gives_the_same(parent, far_degraded):
    again = judged(parent, [0, 0, 0, 2])
    assert again.misfit == far_degraded.misfit
    assert [one.support for one in again.tried] == [one.support for one in far_degraded.tried]


# ---- the verdict


def test_a_model_that_counts_contradict_is_not_adequate(far_degraded, parent):
    quiet = step(p_value=0.4)
    on_rupture = frozenset({"flaw_embrittlement", "dry_embrittlement"})
    alone = decide(quiet, quiet, [], counts=far_degraded.misfit, on_rupture=on_rupture)
    assert alone.outcome is Outcome.UNEXPLAINED
    explained = decide(
        quiet,
        quiet,
        list(far_degraded.supported),
        counts=far_degraded.misfit,
        on_rupture=on_rupture,
    )
    assert explained.outcome is Outcome.AMBIGUOUS
    assert explained.causes == far_degraded.explained_by
    expected = judged(parent, [0, 0, 0, 0]).misfit
    assert decide(quiet, quiet, [], counts=expected).outcome is Outcome.ADEQUATE
