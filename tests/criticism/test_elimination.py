"""Which set of causes survives the tests that may refute it, with made-up candidates."""

from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.analysis.judge import judge_model
from bayesdeg.criticism.decide.alternatives import SetOdds, StatedSets
from bayesdeg.criticism.decide.elimination import eliminate
from bayesdeg.criticism.decide.support import EXCLUDED, INSEPARABLE, Support
from bayesdeg.criticism.decide.verdict import (
    ExcludedSize,
    TooLittleEvidence,
    TooLittleExplained,
    decide,
)
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.priors import Normal
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import linear_cause
from tests.criticism.test_verdict import CLEAN, step

LITTLE = TooLittleExplained(0.4)
FACTORS = {"creep": 23.0, "erosion": 22.5, "gravity": 21.0, "mullins": 18.5, "paper_slack": 9.0}


def single(name):
    return frozenset({name})


def rivals_of(names):
    """All single causes within odds of 20, the best first."""
    [own] = names
    close = (n for n in FACTORS if n != own and FACTORS[own] - FACTORS[n] < INSEPARABLE)
    return [single(n) for n in sorted(close, key=lambda n: -FACTORS[n])]


def eliminated(*refuted, as_leader=()):
    """The elimination if some causes are refuted, and who was asked as what."""
    asked = []

    def against(names, leads):
        asked.append((*names, leads))
        [name] = names
        return (LITTLE,) if name in refuted or (leads and name in as_leader) else ()

    return eliminate(single("creep"), rivals_of, against), asked


def test_a_leader_that_survives_leads_and_refuted_rivals_drop_out():
    found, asked = eliminated("gravity")
    assert found.leader == single("creep")
    assert found.refuted == {single("gravity"): (LITTLE,)}
    assert asked == [("creep", True), ("erosion", False), ("gravity", False)]


def test_the_best_rival_that_survives_takes_the_place_of_a_refuted_leader():
    found, asked = eliminated("creep", "erosion")
    assert found.leader == single("gravity")
    assert set(found.refuted) == {single("creep"), single("erosion")}
    # what is within odds of 20 of the new leader is tested too
    assert asked[-1] == ("mullins", False)


def test_a_rival_is_refuted_as_leader_by_what_only_a_leader_is_asked():
    found, _ = eliminated("creep", as_leader=("erosion",))
    assert found.leader == single("gravity")
    assert set(found.refuted) == {single("creep"), single("erosion")}


def test_if_none_survives_the_favoured_set_is_reported_with_all_reasons():
    found, _ = eliminated(*FACTORS)
    assert found.leader == single("creep")
    assert set(found.refuted) == {single(name) for name in ("creep", "erosion", "gravity")}


@given(st.sets(st.sampled_from(sorted(FACTORS))), st.sets(st.sampled_from(sorted(FACTORS))))
def test_only_a_set_that_survives_leads_or_nothing_is_named(refuted, as_leader):
    found, asked = eliminated(*refuted, as_leader=as_leader)
    assert len(asked) == len(set(asked))
    if found.leader in found.refuted:
        assert {*found.refuted} >= {found.leader, *rivals_of(found.leader)}
    else:
        assert not found.leader & {*refuted, *as_leader}
        assert not any(one & found.leader for one in found.refuted)


LISTS = (("creep", "mullins", "erosion"), ("pressure_loss", "film_mismatch"))
PAIRS = [frozenset(picked) for picked in product(*LISTS)]
HEADS = PAIRS[0]


@given(st.sets(st.sampled_from(PAIRS[1:])), st.booleans())
@settings(max_examples=60)
def test_a_refuted_set_is_no_part_of_the_decision(refuted, with_another):
    """A cause of the decision is in a set that survives, and the sets hold no refuted one."""
    members = [SetOdds(picked, 30.0 - k, float(k)) for k, picked in enumerate(product(*LISTS))]
    another = frozenset({"gravity", "creep"})
    members += [SetOdds(("creep", "gravity"), 28.0, 2.0)] * with_another
    found = StatedSets(LISTS, tuple(members)).without(refuted)
    left = [one.names for one in members if one.names not in refuted]
    supported = [
        Support(heads, 30.0, 20.0, 4.0, dict.fromkeys(others, 1.0), 0.3, (40.0, 6.0))
        for heads, *others in LISTS
    ]
    decision = decide(step(), CLEAN, supported, stated=found)
    assert decision.outcome in (Outcome.NAMED, Outcome.AMBIGUOUS)
    assert {*decision.causes} <= frozenset().union(*left)
    assert {n for names in decision.one_of for n in names} <= frozenset().union(*left)
    possible = {frozenset(picked) for picked in product(*decision.sets)} if decision.sets else set()
    possible |= {frozenset(names) for names in decision.alternatives}
    assert possible == set(left)
    certain = frozenset.intersection(*left)
    assert set(decision.causes) == certain or not certain
    assert (another in possible) is with_another


def test_a_cause_of_a_size_that_it_does_not_have_gives_way_to_one_that_explains_as_much():
    """A very wide prior has a little less evidence than one that is exceeded four times."""
    narrow, wide = (
        linear_cause(name, straight.SHAPES["offset"], law=Normal(0.0, sd))
        for name, sd in (("narrow", 0.08), ("wide", 4000.0))
    )
    subject = straight.subject_of(straight.readings(3, offset=0.4))
    alone = judge_model(subject, (narrow,), seed=1)
    assert (alone.decision.outcome, alone.decision.causes) == (Outcome.UNEXPLAINED, ())
    [reason] = alone.decision.reasons
    assert isinstance(reason, ExcludedSize)
    assert reason.probability < EXCLUDED
    assert alone.missing is not None
    both = judge_model(subject, (narrow, wide), seed=1)
    assert 0.0 < both.search.factor(single("narrow")) - both.search.factor(single("wide")) < 3.0
    assert (both.decision.outcome, both.decision.causes) == (Outcome.NAMED, ("wide",))
    assert set(both.refuted) == {single("narrow")}
    rows = {one.cause: one.why for one in both.candidates}
    assert rows["wide"] == ""
    assert "narrow" in rows["narrow"]
    assert both.predicted_with == ("wide",)
    assert both.possible == (single("wide"),)


def test_evidence_is_asked_of_a_rival_that_takes_the_lead_alone():
    weak = TooLittleEvidence("erosion", 2.1, 4.2)
    found = eliminate(
        single("creep"),
        rivals_of,
        lambda names, leads: (LITTLE,) if names == single("creep") else (weak,) * leads,
    )
    assert found.leader == single("creep")
    assert found.refuted[single("erosion")] == (weak,)


@pytest.mark.parametrize("beside", [None, (60.0, 9.0)])
def test_no_evidence_names_a_cause_of_a_size_that_it_does_not_have(beside):
    own = Support("creep", 80.0, 70.0, 9.0, {}, EXCLUDED, beside, least_tail=0.9 * EXCLUDED)
    others = [] if beside is None else [Support("erosion", 30.0, 9.0, 4.0, {}, 0.3, beside)]
    found = decide(step(), CLEAN, [own, *others])
    assert found.outcome is Outcome.UNEXPLAINED
    assert found.reasons == (ExcludedSize("creep", 0.9 * EXCLUDED),)
    reached = replace(own, least_tail=EXCLUDED, prior_tail=0.3)
    assert decide(step(), CLEAN, [reached, *others]).outcome is Outcome.NAMED
