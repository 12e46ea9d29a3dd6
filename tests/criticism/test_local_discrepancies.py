"""A law that fails in one regime: that and the missing term are found, or a choice is stated."""

import importlib
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def beds():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        yield importlib.import_module("local_discrepancies")


def test_the_regime_and_its_term_are_named_and_the_parameter_is_unbiased(beds):
    bed = beds.drawn("one", np.random.default_rng(3))
    said = beds.by_verdict(bed, 3)
    assert said.terms == bed.hidden
    assert said.choices == ()
    assert said.loss == pytest.approx(beds.LOSS, abs=0.02)
    assert abs(beds.by_global_cubic(bed).loss - beds.LOSS) > 0.05


def test_terms_that_no_reading_tells_apart_are_a_choice(beds):
    bed = beds.drawn("alike", np.random.default_rng(3))
    said = beds.by_verdict(bed, 3)
    assert said.terms == ()
    assert set(bed.hidden) < set(said.choices)
    assert said.regimes == {regime for _, regime in bed.hidden}


def test_scores_of_a_closed_case(beds):
    bed = beds.drawn("two", np.random.default_rng(0))
    (first, second), wrong = bed.hidden, ("leak", 99)
    answers = [
        beds.Said(beds.LOSS + 0.5, (first, second)),
        beds.Said(beds.LOSS - 0.3, (first, wrong)),
        beds.Said(beds.LOSS - 0.1, (first,), (second, ("draught", second[1]))),
    ]
    found = beds.scored([bed] * 3, answers)
    assert found["bias"] == pytest.approx(0.3)
    assert found["f1_of_regimes"] == pytest.approx(2 * 5 / 12)
    assert found["terms_right"] == pytest.approx(1 / 3)
    assert found["named_wrongly"] == pytest.approx(1 / 3)
    assert found["truth_named_or_among_the_choices"] == pytest.approx(2 / 3)
