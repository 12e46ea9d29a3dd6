from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.verdict import (
    FALSE_NAME_RATE,
    INSEPARABLE,
    LEAST_EXPLAINED,
    LEAST_FACTOR,
    MISFIT_LEVEL,
    Candidate,
    Decision,
    Outcome,
    confusable_pairs,
    decide,
    naming_threshold,
    probabilities,
)
from tests.criticism.linear_case import known_linear, scaling_cause

THRESHOLD = 4.0


def candidate(name="creep", **changes):
    """A cause that passes every test well."""
    good = Candidate(name, 30.0, 0.9, 20.0, 4.0, {})
    return replace(good, **changes)


def misfit(p_value=0.001):
    return Misfit(40.0, np.ones(100), p_value, np.zeros(1), 0.0, 2.0, 0.5)


def outcome_of(*candidates, p_value=0.001):
    return decide(list(candidates), misfit(p_value), THRESHOLD)


def test_a_cause_that_passes_every_test_is_named():
    assert outcome_of(candidate(), candidate("erosion", log_bayes_factor=1.0)) == Decision(
        Outcome.NAMED, ("creep",)
    )


@pytest.mark.parametrize(
    "change",
    [
        {"log_bayes_factor": THRESHOLD - 1e-6},
        {"explained_fraction": LEAST_EXPLAINED - 1e-6},
        {"explained_fraction": None},
        {"explained_fraction": float("nan")},
        {"elpd_diff": 3.9},
        {"elpd_diff": -20.0},
        {"elpd_diff": None, "elpd_diff_se": None},
        {"elpd_diff": float("nan")},
        {"log_bayes_factor": None, "why": "no such column"},
    ],
)
def test_a_cause_that_fails_one_test_is_not_named(change):
    assert outcome_of(candidate(**change)) == Decision(Outcome.UNEXPLAINED, ())


@pytest.mark.parametrize(
    "change", [{"log_bayes_factor": THRESHOLD}, {"explained_fraction": LEAST_EXPLAINED}]
)
def test_a_cause_at_the_threshold_is_named(change):
    assert outcome_of(candidate(**change)).outcome is Outcome.NAMED


@pytest.mark.parametrize(
    ("p_value", "outcome"),
    [
        (MISFIT_LEVEL, Outcome.UNEXPLAINED),
        (MISFIT_LEVEL + 1e-6, Outcome.ADEQUATE),
        (1.0, Outcome.ADEQUATE),
    ],
)
def test_without_a_cause_the_misfit_decides(p_value, outcome):
    assert outcome_of(candidate(log_bayes_factor=0.1), p_value=p_value).outcome is outcome
    assert outcome_of(p_value=p_value) == Decision(outcome, ())


def test_rivals_within_the_odds_of_twenty_are_ambiguous_and_the_others_not():
    near = candidate("erosion", log_bayes_factor=30.0 - INSEPARABLE + 0.01)
    far = candidate("gravity", log_bayes_factor=30.0 - INSEPARABLE - 0.01)
    assert outcome_of(candidate(), near, far) == Decision(Outcome.AMBIGUOUS, ("creep", "erosion"))
    assert outcome_of(candidate(), far) == Decision(Outcome.NAMED, ("creep",))


def test_a_near_rival_that_held_out_specimens_refute_is_no_rival():
    refuted = candidate("erosion", log_bayes_factor=29.0, elpd_diff=-5.0)
    assert outcome_of(candidate(), refuted) == Decision(Outcome.NAMED, ("creep",))


def test_a_near_rival_that_was_not_tried_on_held_out_specimens_stays_one():
    untried = candidate("erosion", log_bayes_factor=29.0, elpd_diff=None, elpd_diff_se=None)
    assert outcome_of(candidate(), untried) == Decision(Outcome.AMBIGUOUS, ("creep", "erosion"))


def test_the_order_of_the_candidates_does_not_matter():
    near, far = candidate("erosion", log_bayes_factor=29.0), candidate("g", log_bayes_factor=8.0)
    forwards = outcome_of(candidate(), near, far)
    backwards = outcome_of(far, near, candidate())
    assert forwards.outcome is backwards.outcome
    assert set(forwards.causes) == set(backwards.causes)


@given(st.lists(st.floats(-1000.0, 1000.0), min_size=1, max_size=6))
def test_probabilities_leave_room_for_no_cause_at_all(factors):
    found = probabilities([candidate(f"c{i}", log_bayes_factor=f) for i, f in enumerate(factors)])
    values = np.array(list(found.values()))
    assert np.all(values >= 0.0)
    none = 1.0 - values.sum()
    assert none >= -1e-9
    moderate = np.abs(factors) < 20.0
    for value, factor in zip(values[moderate], np.array(factors)[moderate], strict=True):
        if none > 1e-6:
            assert value / none == pytest.approx(np.exp(factor), rel=1e-3)


def test_one_even_cause_is_as_probable_as_none():
    assert probabilities([candidate(log_bayes_factor=0.0)]) == {"creep": 0.5}


def test_what_cannot_be_judged_has_no_probability():
    unjudged = candidate("gravity", log_bayes_factor=None, why="no mount")
    assert set(probabilities([candidate(), unjudged])) == {"creep"}


def test_naming_takes_at_least_odds_of_twenty():
    linear = known_linear()
    shape = linear.model.actuator.mask.shape
    exact = np.broadcast_to(linear.mean.reshape(shape), (50, *shape))
    assert naming_threshold(linear, (scaling_cause(),), exact) == LEAST_FACTOR == np.log(20.0)


def test_at_most_one_in_twenty_data_sets_without_an_effect_passes_the_threshold():
    linear = known_linear()
    shape = linear.model.actuator.mask.shape
    generator = np.random.default_rng(1)
    # twice the noise that the model believes in, so that the least factor is not enough
    noise = 4.0 * generator.standard_normal((2, 400, len(linear.mean))) @ linear.factor.T
    calibrating, fresh = (linear.mean + noise).reshape(2, 400, *shape)
    causes = (scaling_cause(), scaling_cause("other", sd=0.3))
    threshold = naming_threshold(linear, causes, calibrating)
    assert threshold > LEAST_FACTOR
    above = naming_threshold(linear, causes, fresh)
    assert above == pytest.approx(threshold, rel=0.35)
    single = naming_threshold(linear, causes[:1], calibrating)
    assert single <= threshold
    assert FALSE_NAME_RATE == 0.05


def bulge(prediction, conditions, effect):
    """An excess at middle pressures only."""
    factor = 1.0 + effect["size"] * np.sin(conditions.pressure / 25.0)
    return replace(prediction, curvature=factor * prediction.curvature)


def test_only_causes_with_the_same_signature_are_confusable():
    linear = known_linear()
    first, twin = scaling_cause("first"), scaling_cause("twin", sd=0.02)
    other = scaling_cause("other", on_reading=bulge)
    assert confusable_pairs(linear, (first, twin, other)) == [("first", "twin")]
    assert confusable_pairs(linear, (first,)) == []
