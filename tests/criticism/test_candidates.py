"""How every cause fared: probabilities over sets, sizes, what was tried and what was not."""

import numpy as np
import pytest

from bayesdeg.criticism.decide.candidates import (
    LEAST,
    candidates,
    effect_size,
    effect_sizes,
    probabilities,
)
from bayesdeg.criticism.decide.support import supports
from bayesdeg.criticism.fit.search import Search, SearchEffort, run_search
from bayesdeg.criticism.holdout.held_out import HeldOut
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import linear_cause

EFFORT = SearchEffort(replicates=60, fitted=2, pairs=1)
BASE = frozenset()


def search_of(observed, causes=straight.CAUSES):
    base = straight.fitted(straight.subject_of(observed))
    return Search(base, tuple(causes), EFFORT, np.random.SeedSequence(1))


@pytest.fixture(scope="module")
def judged():
    """Readings with a wave in them, searched, with held-out scores made up."""
    search = search_of(straight.readings(1, wave=0.15))
    chosen = run_search(search)
    found = [HeldOut(np.array(d), np.zeros((1, 48))) for d in ([0.0, 1.0, 2.0], [3.0, 5.0, 5.0])]
    held_out = dict(zip([BASE, chosen], found, strict=True))
    supported = supports(search, chosen, held_out)
    return search, candidates(search, supported, held_out, np.random.default_rng(2))


def test_all_causes_are_listed_the_most_probable_first(judged):
    _, found = judged
    assert {c.cause for c in found} == {c.name for c in straight.CAUSES}
    assert found[0].cause == "wave"
    shares = [c.probability for c in found]
    assert shares == sorted(shares, reverse=True)


def test_a_named_cause_has_its_factor_gain_share_and_size(judged):
    search, (best, *_) = judged
    observed = search.base.subject.observed
    cause = linear_cause("wave")
    assert best.judged_by == "full fit"
    exact = straight.log_factor(observed, cause)
    assert best.log_bayes_factor == pytest.approx(exact, abs=0.15)
    errors = [search.trials[names].posterior.error for names in (BASE, frozenset({"wave"}))]
    assert 0.0 < best.log_bayes_factor_error == pytest.approx(np.hypot(*errors))
    assert abs(best.log_bayes_factor - exact) < 5.0 * best.log_bayes_factor_error
    gaps = np.array([3.0, 4.0, 3.0])
    assert best.elpd_diff == pytest.approx(gaps.sum())
    assert best.elpd_diff_se == pytest.approx(np.sqrt(3.0) * np.std(gaps, ddof=1))
    assert best.explained_fraction > 0.8
    base = search.step(BASE)
    assert len(base.chance) == len(base.simulated)
    assert best.naming_p_value == 1 / (1 + len(base.chance))  # none of the simulated gains as much
    mean, covariance = straight.joint_of(cause).posterior(observed)
    sd = np.sqrt(covariance[-1, -1])
    size = best.effect["size"]
    assert size.mean == pytest.approx(mean[-1], abs=0.2 * sd)
    assert size.sd == pytest.approx(sd, rel=0.15)
    assert size.q05 == pytest.approx(mean[-1] - 1.645 * sd, abs=0.4 * sd)
    assert size.q95 == pytest.approx(mean[-1] + 1.645 * sd, abs=0.4 * sd)


def test_a_cause_that_was_screened_only_has_no_size(judged):
    search, found = judged
    screened = search.step(BASE).screened
    only = [c for c in found if c.judged_by == "screening"]
    assert only
    for one in only:
        assert frozenset({one.cause}) not in search.trials
        assert one.log_bayes_factor == max(screened[one.cause].log_bayes_factor, LEAST)
        assert (one.explained_fraction, one.elpd_diff, one.effect) == (None, None, {})
        assert one.log_bayes_factor_error is None


def test_causes_fitted_alone_are_told_against_the_base_model():
    search = search_of(straight.readings(2, wave=0.15))
    search.fit(BASE, ["lag", "wave"])
    found = {c.cause: c for c in candidates(search, [], {}, np.random.default_rng(3))}
    for name in ("lag", "wave"):
        one = found[name]
        assert one.judged_by == "full fit"
        assert one.log_bayes_factor == search.factor(frozenset({name}))
        assert one.elpd_diff is None
        assert set(one.effect) == {"size"}
    assert found["wave"].explained_fraction > 0.8
    assert found["lag"].explained_fraction < 0.2
    chance = search.step(BASE).chance
    larger = np.sum(chance >= found["lag"].log_bayes_factor)
    assert found["lag"].naming_p_value == (1 + larger) / (1 + len(chance))


def test_probabilities_are_those_of_sets_by_bayes_rule():
    """Sets with the exact factors; of k causes as probable together as none, before the data."""
    observed = straight.readings(3, wave=0.04, lag=0.03)
    search = search_of(observed)
    search.fit(BASE, ["wave", "lag"])
    search.fit(frozenset({"wave"}), ["lag"])
    found = probabilities(search)
    names = [c.name for c in straight.CAUSES]
    sets = {BASE: 0.0}
    for name in names:
        prior = -np.log(len(names))
        exact = straight.log_factor(observed, linear_cause(name))
        sets[frozenset({name})] = exact + prior
    both = straight.log_factor(observed, linear_cause("wave"), linear_cause("lag"))
    sets[frozenset({"wave", "lag"})] = both - np.log(6.0)
    weights = {s: np.exp(value - max(sets.values())) for s, value in sets.items()}
    total = sum(weights.values())
    assert 0.01 < weights[BASE] / total < 0.99
    for name in names:
        expected = sum(w for s, w in weights.items() if name in s) / total
        assert found[name] == pytest.approx(expected, abs=0.05)
        assert 0.0 <= found[name] <= 1.0


def test_probabilities_without_an_effect_leave_room_for_none():
    found = probabilities(search_of(straight.readings(4)))
    assert sum(found.values()) < 0.5


def test_effect_sizes_of_an_impossible_model_are_not_told():
    search = search_of(straight.readings(5))
    [names] = search.fit(BASE, ["wave"])
    trial = search.trials[names]
    nothing = straight.replace(trial.posterior, effective=0.0)
    trial = straight.replace(trial, posterior=nothing)
    assert effect_sizes(trial, linear_cause("wave"), np.random.default_rng(1)) == {}


def test_effect_size_is_of_the_draws():
    size = effect_size(np.random.default_rng(1).normal(5.0, 2.0, 100_000), "kPa")
    assert size.mean == pytest.approx(5.0, abs=0.03)
    assert size.sd == pytest.approx(2.0, abs=0.03)
    assert size.q05 == pytest.approx(5.0 - 1.645 * 2.0, abs=0.05)
    assert size.q95 == pytest.approx(5.0 + 1.645 * 2.0, abs=0.05)
    assert size.unit == "kPa"
