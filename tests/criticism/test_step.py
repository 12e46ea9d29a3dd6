"""Which causes deserve a full fit, and at which size it begins."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayesdeg.criticism.checks.discrepancy import complete_sets
from bayesdeg.criticism.fit import search as searching
from bayesdeg.criticism.fit.screening import Screened
from bayesdeg.criticism.fit.search import (
    CLOSE,
    LEAST_FACTOR,
    MARGIN,
    NEAR_SHARE,
    Search,
    SearchEffort,
    Step,
    naming_threshold,
    near,
)
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import linear_cause

BASE = frozenset()


def screened(size=0.1, **factors):
    """Causes with these screened log Bayes factors."""
    nothing = np.zeros((1, 1))
    cause = linear_cause("wave")
    return {
        name: Screened(cause, np.array([size]), factor, nothing[0], nothing)
        for name, factor in factors.items()
    }


def step_of(plain, unbent=None):
    trial = SimpleNamespace(names=BASE)
    return Step(
        trial=trial,
        misfit=None,
        simulated=np.zeros((0, 1)),
        screened=plain,
        threshold=4.0,
        unbent=unbent or {},
    )


@pytest.mark.parametrize(
    ("best", "behind"),
    [
        (20.0, CLOSE),
        (100.0, 100.0 * (1.0 - NEAR_SHARE)),  # a share of a strong one is more
    ],
)
def test_causes_near_the_best_are_those_behind_by_little_or_by_a_share(best, behind):
    found = near(screened(far=best - behind - 0.1, near=best - behind + 0.1, best=best), least=0.0)
    assert found == ["best", "near"]


def test_causes_below_the_least_are_not_near_however_close_to_the_best():
    assert near(screened(one=3.0, two=2.0), least=2.5) == ["one"]
    assert near({}, least=0.0) == []


def test_what_chance_gains_is_counted_and_never_told_as_nothing():
    step = replace(step_of({}), chance=np.array([1.0, 2.0, 3.0, 5.0]))  # the threshold is 4
    assert step.false_name_rate == 0.25
    assert [step.chance_of(factor) for factor in (0.5, 3.0, 9.0)] == [1.0, 0.6, 0.2]
    assert replace(step, threshold=6.0).false_name_rate == 0.2
    assert (step_of({}).false_name_rate, step_of({}).chance_of(3.0)) == (None, None)


@pytest.mark.parametrize(("straight_factor", "size"), [(5.1, 0.7), (4.9, 0.1)])
def test_a_fit_begins_at_the_size_with_the_larger_factor(straight_factor, size):
    step = step_of(screened(wave=5.0), screened(0.7, wave=straight_factor))
    cause, found = step.guess("wave")
    assert cause.name == "wave"
    assert found == np.array([size])


def test_where_nothing_gave_way_a_fit_begins_at_the_screened_size():
    assert step_of(screened(wave=5.0)).guess("wave")[1] == np.array([0.1])


def search_with(step, fitted, observed=None):
    observed = straight.readings(1) if observed is None else observed
    base = straight.fitted(straight.subject_of(observed))
    effort = SearchEffort(replicates=10, fitted=fitted, pairs=0)
    search = Search(base, straight.CAUSES, effort, np.random.SeedSequence(1))
    search.steps[BASE] = replace(step, trial=base)
    return search


def test_leaders_are_those_of_both_screenings_each_once():
    plain = screened(wave=12.0, lag=11.0, ageing=10.0, offset=1.0)
    unbent = screened(offset=30.0, wave=29.0, lag=1.0)
    step = step_of(plain, unbent)
    assert search_with(step, 2).leaders(BASE) == ["wave", "lag", "offset"]
    assert search_with(step_of(plain), 2).leaders(BASE) == ["wave", "lag"]


def test_a_cause_that_a_full_fit_might_still_name_is_a_leader():
    least = 4.0 - MARGIN
    step = step_of(screened(wave=least + 0.1, lag=least - 0.1))
    assert search_with(step, 4).leaders(BASE) == ["wave"]


@pytest.mark.parametrize(("sets", "leaders"), [(200, ["wave"]), (4000, [])])
def test_a_threshold_that_few_data_sets_may_have_put_too_high_hides_no_leader(sets, leaders):
    """Chance gives 4 and more in 8 % of the data sets: the threshold is 4, or less than 4."""
    chance = np.repeat([0.0, 4.0, 7.0], [int(0.92 * sets), int(0.04 * sets), int(0.04 * sets)])
    step = step_of(screened(wave=0.5 * (4.0 + LEAST_FACTOR) - MARGIN))
    step = replace(step, chance=chance, threshold=naming_threshold(chance))
    assert step.threshold == 4.0
    assert search_with(step, 4).leaders(BASE) == leaders


def promised(**factors):
    """Causes that can be fitted, with these screened log Bayes factors."""
    found = screened(**factors)
    return {name: replace(one, cause=linear_cause(name)) for name, one in found.items()}


def test_what_screening_puts_above_the_fitted_leaders_is_fitted_too():
    """Screening that misleads: the planted cause comes third, after two that a fit finds idle."""
    search = search_with(
        step_of(promised(lag=300.0, offset=200.0, wave=100.0)),
        fitted=1,
        observed=straight.readings(1, wave=0.15),
    )
    sets = search.fit_leaders(BASE)
    assert sets == [frozenset({name}) for name in ("lag", "offset", "wave")]
    assert max(sets, key=search.factor) == {"wave"}


def test_where_the_leader_keeps_what_screening_promised_nothing_more_is_fitted():
    search = search_with(
        step_of(promised(wave=12.0, lag=3.0)), fitted=1, observed=straight.readings(1, wave=0.15)
    )
    assert search.fit_leaders(BASE) == [frozenset({"wave"})]


@pytest.mark.parametrize(("kept", "least"), [(1.0, 40), (0.1, 20), (0.0, 0)])
def test_data_sets_outside_the_range_are_redrawn(kept, least, monkeypatch):
    """As near ballooning, where nine of ten were lost and nothing could be judged."""

    def simulated(draws, generator):
        lost = generator.random(len(draws)) >= kept
        return np.where(lost[:, None], np.nan, draws)

    monkeypatch.setattr(searching, "_as_refitted", lambda linear, draws: draws)
    trial = SimpleNamespace(
        linear=SimpleNamespace(straightened=lambda draws, found: found),
        subject=SimpleNamespace(simulated=simulated),
        draws=lambda generator, count: generator.standard_normal((count, 3)),
    )
    found = searching._simulated(trial, np.random.default_rng(4), 40)
    assert len(complete_sets(found)) >= least
    assert len(found) <= searching.ROUNDS * 40
    assert len(found) == 40 or kept < 1.0
