"""Which sets of causes may be right: products of lists, and lists of sets where there is none."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from bayesdeg.criticism.decide.alternatives import (
    TOLERANCE,
    SetOdds,
    StatedSets,
    stated_sets,
)
from bayesdeg.criticism.decide.support import INSEPARABLE, supports
from bayesdeg.criticism.decide.verdict import decide
from bayesdeg.criticism.fit.search import Search, SearchEffort, run_search
from bayesdeg.criticism.holdout.held_out import HeldOut
from bayesdeg.criticism.outcome import Outcome
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import SHAPES, X, linear_cause

EFFORT = SearchEffort(replicates=60, fitted=4, pairs=2)
BASE = frozenset()


PLANES = {
    "sharp": straight.unit(SHAPES["lag"]),
    "blurred": straight.unit(SHAPES["wave"]),
    "odd": straight.unit(np.cos(9.0 * X + straight.LEVEL)),
    "more": straight.unit(np.cos(23.0 * X + 3.0 * straight.LEVEL)),
}


def cause(name, **shares):
    """A cause that acts along the shapes above."""
    return linear_cause(name, 40.0 * sum(share * PLANES[k] for k, share in shares.items()))


def alike(name, along, k):
    """One of several that look the same but for a hundredth of the effect."""
    return cause(name, **{along: 1.0, "odd" if k % 2 else "more": 0.01 * k})


SHARP = cause("sharp", sharp=1.0)
BLURRED = tuple(alike(f"blurred_{k}", "blurred", k) for k in range(3))


def stated(observed, causes, *, effort=EFFORT):
    """A search that is done, and which sets it states."""
    base = straight.fitted(straight.subject_of(observed))
    search = Search(base, tuple(causes), effort, np.random.SeedSequence(1))
    chosen = run_search(search)
    supported = supports(search, chosen, held_out_well(chosen))
    return search, supported, stated_sets(search, chosen, supported)


def held_out_well(chosen):
    """All that was held out is predicted better with every cause of the set."""
    smaller = {BASE, chosen, *(chosen - {name} for name in chosen)}
    return {one: HeldOut(np.full(6, 9.0 * len(one)), np.zeros((1, 48))) for one in smaller}


def decided(search, supported, sets):
    chosen = frozenset(one.cause for one in supported)
    return decide(search.step(BASE), search.step(chosen), supported, stated=sets)


def planted(seed, **sizes):
    return straight.readings(seed) + sum(size * PLANES[name] for name, size in sizes.items())


@pytest.fixture(scope="module")
def three_by_one():
    return stated(planted(0, sharp=9.0, blurred=9.0), (SHARP, *BLURRED))


def test_three_look_alikes_beside_a_sharp_cause_are_a_product(three_by_one):
    _, _, found = three_by_one
    assert found.is_product
    assert sorted(map(sorted, found.product)) == [
        ["blurred_0", "blurred_1", "blurred_2"],
        ["sharp"],
    ]
    assert found.certain == ("sharp",)
    assert found.alternatives == ()
    assert {one.names for one in found.members} == {
        frozenset({"sharp", f"blurred_{k}"}) for k in range(3)
    }


def test_the_sharp_cause_is_named_and_the_list_is_one_of(three_by_one):
    found = decided(*three_by_one)
    assert (found.outcome, found.causes) == (Outcome.NAMED, ("sharp",))
    assert [set(names) for names in found.one_of] == [{"blurred_0", "blurred_1", "blurred_2"}]
    assert set(map(frozenset, found.sets)) == {
        frozenset({"sharp"}),
        frozenset({"blurred_0", "blurred_1", "blurred_2"}),
    }


def test_members_hold_exact_evidence_the_favoured_one_first(three_by_one):
    search, supported, found = three_by_one
    observed, own = search.base.subject.observed, {c.name: c for c in search.causes}
    assert found.members[0].names == found.favoured == {one.cause for one in supported}
    assert found.members[0].behind == 0.0
    for one in found.members:
        exact = straight.log_factor(observed, *(own[name] for name in one.causes))
        assert one.log_bayes_factor == pytest.approx(exact, abs=0.15)
        assert one.fitted
    behind = [one.behind for one in found.members]
    assert behind == sorted(behind)


def test_two_lists_of_look_alikes_are_a_product_of_which_every_choice_is_fitted():
    sharp = tuple(alike(f"sharp_{k}", "sharp", k) for k in range(2))
    search, supported, found = stated(planted(1, sharp=9.0, blurred=9.0), (*sharp, *BLURRED[:2]))
    assert found.is_product
    assert {frozenset(picked) for picked in product(*found.lists)} == {
        frozenset({f"sharp_{j}", f"blurred_{k}"}) for j in range(2) for k in range(2)
    }
    assert all(one.fitted for one in found.members)
    decision = decided(search, supported, found)
    assert decision.outcome is Outcome.AMBIGUOUS
    assert set(decision.causes) == {"sharp_0", "sharp_1", "blurred_0", "blurred_1"}
    assert len(decision.sets) == 2


def test_choices_that_were_not_fitted_are_judged_by_screening():
    sharp = tuple(alike(f"sharp_{k}", "sharp", k) for k in range(2))
    few = replace(EFFORT, fitted=2)
    observed = planted(1, sharp=9.0, blurred=9.0)
    search, supported, _ = stated(observed, (*sharp, *BLURRED[:2]), effort=few)
    chosen = frozenset(one.cause for one in supported)
    left = {n for n in search.trials if len(n) == 2 and len(n & chosen) == 0}
    bare = replace(
        search,
        effort=replace(few, fitted=0),
        trials={n: t for n, t in search.trials.items() if n not in left},
        steps=dict(search.steps),
    )
    found = stated_sets(bare, chosen, supported)
    [screened] = [one for one in found.members if not one.fitted]
    own = {c.name: c for c in search.causes}
    exact = straight.log_factor(observed, *(own[name] for name in screened.causes))
    assert screened.log_bayes_factor == pytest.approx(exact, abs=0.3)
    assert found.is_product


CROSSED = (
    cause("a", sharp=1.0, odd=0.4),
    cause("b", blurred=1.0, odd=-0.4),
    cause("c", sharp=1.0, more=0.4),
    cause("d", blurred=1.0, more=-0.4),
)
"""a with b leaves nothing of an odd shape, nor c with d; a with d does, and c with b."""


def test_a_product_never_holds_a_choice_that_the_data_exclude():
    search, supported, found = stated(planted(2, sharp=12.0, blurred=12.0), CROSSED)
    observed, own = search.base.subject.observed, {c.name: c for c in CROSSED}
    factors = {
        names: straight.log_factor(observed, *(own[n] for n in names))
        for names in ("ab", "cd", "ad", "bc")
    }
    assert abs(factors["ab"] - factors["cd"]) < INSEPARABLE - 0.5
    assert max(factors["ad"], factors["bc"]) < min(factors["ab"], factors["cd"]) - 2.0 * INSEPARABLE
    assert not found.is_product
    assert found.product == ()
    assert set(map(frozenset, found.alternatives)) == {frozenset("ab"), frozenset("cd")}
    decision = decided(search, supported, found)
    # neither of the favoured pair is in both sets
    assert decision.outcome is Outcome.AMBIGUOUS
    assert set(decision.causes) == set("abcd")
    assert decision.sets == ()
    assert set(map(frozenset, decision.alternatives)) == {frozenset("ab"), frozenset("cd")}


def odds(causes, behind=0.0):
    return SetOdds(tuple(causes), 40.0 - behind, behind)


def test_a_cause_in_every_set_is_named_also_where_they_are_no_product():
    """Beside it act b and c, or d and e: not b and e."""
    found = StatedSets((("a",), ("b",), ("c",)), (odds("abc"), odds("ade", 1.0)))
    assert not found.is_product
    assert found.certain == ("a",)
    assert found.alternatives == (tuple("abc"), tuple("ade"))
    assert found.one_of == (("b", "c", "d", "e"),)


def test_an_excluded_choice_makes_a_list_of_sets():
    lists = (("a", "c"), ("b", "d"))
    members = (odds("ab"), odds("cb", 1.0), odds("ad", 1.0))
    whole = StatedSets(lists, (*members, odds("cd", 2.0)))
    assert whole.product == lists
    without = StatedSets(lists, members, (odds("cd", 2.0 + TOLERANCE + INSEPARABLE),))
    assert without.product == ()
    assert without.alternatives == (("a", "b"), ("c", "b"), ("a", "d"))
    assert without.one_of == lists
    assert without.certain == ()


def test_where_nothing_is_favoured_nothing_is_stated():
    search, supported, found = stated(straight.readings(3), (SHARP, *BLURRED))
    assert supported == []
    assert found == StatedSets((), ())
    assert found.is_product
    decision = decided(search, supported, found)
    assert (decision.sets, decision.alternatives, decision.one_of) == ((), (), ())


def test_one_cause_with_a_rival_is_a_list_of_both():
    search, supported, found = stated(planted(4, blurred=9.0), BLURRED[:2])
    assert [set(names) for names in found.product] == [{"blurred_0", "blurred_1"}]
    decision = decided(search, supported, found)
    assert decision.outcome is Outcome.AMBIGUOUS
    assert [set(names) for names in decision.sets] == [{"blurred_0", "blurred_1"}]


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_the_catalogue_does_not_change_what_is_stated(seed):
    observed = planted(seed, sharp=9.0, blurred=9.0)
    orders = ((SHARP, *BLURRED), (*BLURRED[::-1], SHARP))
    found = [stated(observed, order)[2] for order in orders]
    assert found[0].is_product == found[1].is_product
    assert {frozenset(x) for x in found[0].lists} == {frozenset(x) for x in found[1].lists}
