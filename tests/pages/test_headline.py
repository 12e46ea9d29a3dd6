"""The headline follows the outcome, whatever else the verdict holds."""

from itertools import product

import pytest

from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.headline import BADGES, headline_of, sets_of
from bayesdeg.pages.record import VerdictRecord
from tests.pages.synthetic_run import gain

SPACE = "\N{NO-BREAK SPACE}"
SAID = {
    Outcome.ADEQUATE: "No misfit beyond the noise",
    Outcome.NAMED: "The misfit is explained by second invariant",
    Outcome.AMBIGUOUS: "There is a misfit, but these data cannot identify its cause: "
    "second invariant or stress measure",
    Outcome.UNEXPLAINED: "There is a misfit, and no cause in the catalogue accounts for it",
    Outcome.NOT_JUDGED: "The simulation could not be judged on this data",
}
CAUSES = {
    Outcome.NAMED: ["second_invariant"],
    Outcome.AMBIGUOUS: ["second_invariant", "stress_measure"],
}
WHERE = "Measured stress departs most in uniaxial tension, 0.113 MPa; most of it at the end."
MISFITS = {
    "of actuators": {"rms_per_m": 2.1, "noise_per_m": 0.6, "p_value": 0.013},
    "of films": {"rms_MPa": 0.113, "noise_MPa": 0.160, "p_value": 0.013},
    "unknown": {},
}


def verdict(outcome, misfit="of films", *, probability=None, effects=None, more=None):
    effects = effects or {}
    causes = ["second_invariant", "stress_measure"]
    return VerdictRecord.read(
        {
            "outcome": str(outcome),
            "causes": CAUSES.get(outcome, []),
            "explanation": "Nothing was read. Therefore nothing is said.",
            "candidates": [
                {"cause": name, "probability": probability, "effect": effects.get(name, {})}
                for name in causes
            ],
            "misfit": MISFITS[misfit] | {"where": WHERE},
            "next_experiments": [{"design": "planar tension of a new film", "separates": causes}],
            **(more or {}),
        }
    )


def size(name, unit, mean=14.17):
    effect = {"mean": mean, "sd": 0.3, "q05": mean - 0.4, "q95": mean + 0.4, "unit": unit}
    return {name: effect}


@pytest.mark.parametrize(
    ("outcome", "misfit", "probability"), list(product(Outcome, MISFITS, (None, 0.5)))
)
def test_the_headline_follows_the_outcome(outcome, misfit, probability):
    headline = headline_of(verdict(outcome, misfit, probability=probability), None)
    assert headline.badge == BADGES[outcome]
    assert headline.sentence == SAID[outcome]


LISTS = [["creep", "erosion"], ["gravity"]]
APART = [["creep", "gravity"], ["erosion", "creep"]]


@pytest.mark.parametrize(
    ("found", "between", "within", "line"),
    [
        ({"sets": LISTS}, ", together with ", " or ", (" × ", ["(creep or erosion)", "gravity"])),
        (
            {"alternatives": APART},
            ", or ",
            " and ",
            ("; or ", ["creep + gravity", "erosion + creep"]),
        ),
        ({"sets": [["second_invariant"]]}, ", ", " or ", ("", [])),
        ({}, ", ", " or ", ("", [])),
    ],
)
def test_sets_of_causes_are_told_as_what_they_are(found, between, within, line):
    told = verdict(Outcome.AMBIGUOUS, more=found)
    begun, said = headline_of(told, None).sentence.split(": ")
    assert SAID[Outcome.AMBIGUOUS].startswith(begun)
    whole = CAUSES[Outcome.AMBIGUOUS]
    wanted = found.get("alternatives") or (LISTS if found.get("sets") == LISTS else [whole])
    parts = said.removeprefix("either ").split(between)
    assert [part.split(within) for part in parts] == [
        [name.replace("_", " ") for name in names] for names in wanted
    ]
    assert sets_of(told) == line[0].join(line[1])


@pytest.mark.parametrize("outcome", Outcome)
def test_the_lede_is_at_most_two_sentences(outcome):
    lede = headline_of(verdict(outcome), None).lede
    assert 1 <= len(lede) <= 2
    assert all(sentence.endswith(".") and "most of it" not in sentence for sentence in lede)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (size("offset", "kPa"), "second invariant: 14.2 kPa [13.8, 14.6]"),
        (size("ratio", "–"), "second invariant: ratio 14.2 [13.8, 14.6]"),
        ({"offset": {"mean": 14.17, "unit": "kPa"}}, "second invariant: 14.2 kPa"),
        ({}, "second invariant"),
    ],
)
def test_the_size_of_a_named_effect_is_in_the_headline(effect, said):
    named = verdict(Outcome.NAMED, effects={"second_invariant": effect})
    assert headline_of(named, None).sentence.replace(SPACE, " ").endswith(said)


def test_sizes_of_causes_that_act_together_are_in_the_headline():
    raw = verdict(
        Outcome.AMBIGUOUS,
        effects={
            "second_invariant": size("ratio", "–", 0.63),
            "stress_measure": size("share", "%"),
        },
    )
    both = headline_of(raw.model_copy(update={"outcome": Outcome.NAMED}), None).sentence
    said = "second invariant (ratio 0.630) and stress measure (14.2 %) acting together"
    assert both.replace(SPACE, " ").endswith(said)


def test_the_lede_says_what_is_gained_by_a_named_cause():
    named = VerdictRecord.read(
        {
            "outcome": "named",
            "causes": ["degraded_skin"],
            "candidates": [{"cause": "degraded_skin", "explained_fraction": 0.93}],
        }
    )
    (made,) = headline_of(named, gain("named")).lede
    numbers = ("93 %", "2.40 to 0.71 1/m")
    assert all(number in made.replace(SPACE, " ") for number in numbers)


@pytest.mark.parametrize(("p_value", "told"), [(0.4, True), (0.001, False)])
def test_of_a_cause_that_acts_on_rupture_alone_the_ruptures_are_told(p_value, told):
    """What it explains of the readings, which agree without it, says nothing."""
    named = VerdictRecord.read(
        {
            "outcome": "named",
            "causes": ["flaw_embrittlement"],
            "candidates": [{"cause": "flaw_embrittlement", "explained_fraction": 0.07}],
            "misfit": {"rms_per_m": 0.5, "noise_per_m": 0.5, "p_value": p_value},
            "ruptures": {"burst": 6, "expected": 0.66, "p_value": 0.01},
        }
    )
    headline = headline_of(named, None)
    assert ("ruptures do not" in headline.sentence) == told
    (made,) = headline.lede
    assert ("6 actuators burst" in made) == told
    assert ("7 %" in made.replace(SPACE, " ")) != told
