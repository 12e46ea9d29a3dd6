"""No probability of rupture is smaller than the specimens that were tested can support."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.counts import CountedTests, RuptureCounts
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import Means
from bayesdeg.pages.wording import SPACE, chance
from bayesdeg.prediction.predictive import (
    fewest_checks,
    not_below,
    rupture_table,
    specimens_tested,
)
from tests.criticism.linear_case import constant_chain
from tests.inference.small_study import TRUTH, altered, small_model, values_of

STRONG = TRUTH | {"elongation_scatter": 0.02}


def counts(tested):
    one = np.ones((1, 1))
    return RuptureCounts(
        CountedTests(("at 25 %",), 25.0 * one, 0.0 * one, 240.0 * one[0], tested * one[0], one[0])
    )


def test_films_actuators_and_counts_are_what_knows_of_rupture():
    model = small_model()
    films = len(model.data_of(Breaks).table.specimens)
    means = [s for s in model.data_of(Means).statistics if s.quantity == "elongation_at_break"]
    published = sum(round(s.dof) + 1 for s in means if np.isfinite(s.dof))
    own = films + published + len(model.data_of(Curvature).tests.specimens)
    assert specimens_tested(model) == own
    assert specimens_tested(model.with_observations(counts(18.0))) == own + 18
    assert specimens_tested(altered(model, actuator=None, breaks=None)) == published


@given(st.integers(0, 500), st.integers(1, 5000))
def test_neither_specimens_nor_draws_know_of_less_than_one_among_them(specimens, draws):
    checks = fewest_checks(specimens, draws)
    assert 1 <= checks <= draws
    assert checks <= specimens or specimens == 0


@given(st.floats(0.0, 1.0), st.integers(1, 1000))
def test_bounded_probabilities_are_probabilities_in_the_same_order(probability, checks):
    found = not_below(np.array([probability, 1.0]), checks)
    assert 1.0 / checks <= found[0] <= found[1] == 1.0
    assert found[0] == max(probability, 1.0 / checks)


def test_a_table_says_no_less_than_its_specimens_know():
    model = small_model()
    chain = constant_chain(model, model.table.vectors(values_of(STRONG))[0])
    options = {"degradation": np.array([0.0, 25.0]), "pressure": np.array([20.0, 60.0])}
    by_draws = rupture_table(model, chain, np.random.default_rng(1), draws=40, **options)
    table = rupture_table(model, chain, np.random.default_rng(1), draws=40, specimens=12, **options)
    columns = ["probability", "probability_q05", "probability_q95"]
    assert by_draws[columns].min().min() == pytest.approx(1.0 / 40)
    assert table[columns].min().min() == pytest.approx(1.0 / 12)
    free = np.maximum(by_draws[columns], 1.0 / 12)
    pd.testing.assert_frame_equal(table[columns], free)


@pytest.mark.parametrize(
    ("probability", "said"),
    [(2e-80, "less than 1 in 54"), (1 / 54, "less than 1 in 54"), (0.1, "10 %"), (None, "–")],
)
def test_what_is_not_known_is_no_number(probability, said):
    assert chance(probability, 54).replace(SPACE, " ") == said
