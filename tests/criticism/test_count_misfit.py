"""Counts of ruptures under a model, against laws of scipy and a hand-made actuator."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.count_misfit import (
    COUNT_LEVEL,
    FEWEST,
    SETS,
    CountLaw,
    answered,
    can_be_counted,
    count_misfit,
    judged_counts,
    own_counts,
)
from bayesdeg.observations.counts import Chances, CountedTests, RuptureCounts, chances_of
from bayesdeg.observations.curvature import Curvature, mechanics_inputs, parts_of
from bayesdeg.observations.means import Means
from tests.inference.small_study import TRUTH, altered, small_model, values_of

WEAK = TRUTH | {"elongation_at_0": 60.0, "elongation_at_25": 10.0, "elongation_scatter": 0.15}


def counted(tested, ruptured, *, degradation=None, pressure=100.0):
    levels = np.arange(len(tested), dtype=float) if degradation is None else np.array(degradation)
    return CountedTests(
        specimens=tuple(f"ruptures at {level:g} %" for level in levels),
        degradation=levels[:, None],
        degradation_sd=np.zeros((len(levels), 1)),
        pressure=np.full(len(levels), pressure),
        tested=np.array(tested, dtype=float),
        ruptured=np.array(ruptured, dtype=float),
    )


def chances(burst):
    burst = np.asarray(burst)
    return Chances(np.log(burst), np.log1p(-burst))


def test_an_average_over_a_beta_law_is_beta_binomial():
    a, b = 2.0, 5.0
    places = (np.arange(20_000) + 0.5) / 20_000
    draws = chances(stats.beta(a, b).ppf(places)[:, None])
    for ruptured in range(4):
        found = judged_counts(
            counted([3], [ruptured]), draws, np.random.default_rng(0), "summary.csv"
        )
        expected = stats.betabinom(3, a, b)
        assert np.exp(found.log_probability) == pytest.approx(expected.pmf(ruptured), rel=1e-3)
        assert found.levels[0].count_probability == pytest.approx(expected.pmf(ruptured), rel=1e-3)
        assert found.levels[0].probability == pytest.approx(a / (a + b), rel=1e-3)
        assert found.levels[0].probability_q05 == pytest.approx(
            stats.beta(a, b).ppf(0.05), rel=1e-2
        )


@given(st.integers(1, 12), st.floats(0.02, 0.98), st.data())
@settings(max_examples=25, deadline=None)
def test_p_values_of_one_level_are_those_of_the_exact_binomial_test(tested, chance, data):
    ruptured = data.draw(st.integers(0, tested))
    draws = chances(np.full((FEWEST, 1), chance))
    found = judged_counts(
        counted([tested], [ruptured]), draws, np.random.default_rng(1), "summary.csv"
    )
    exact = stats.binomtest(ruptured, tested, chance).pvalue
    error = np.sqrt(exact * (1.0 - exact) / SETS)
    assert found.p_value == pytest.approx(exact, abs=5.0 * error + 2.0 / SETS)


def test_levels_share_the_draws():
    """Either all actuators are weak or none is: counts that agree are more probable."""
    draws = chances(np.repeat([[0.9, 0.9], [0.1, 0.1]], 100, axis=0))
    law = CountLaw.of(counted([1, 1], [0, 0]), draws)
    found = np.exp(law.log_probability(np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])))
    np.testing.assert_allclose(found, [0.41, 0.09, 0.41])


def test_weights_of_draws_count():
    draws = chances(np.array([[0.2], [0.8]]))
    law = CountLaw.of(counted([1], [1]), draws).reweighted(np.log([3.0, 1.0]))
    assert np.exp(law.log_probability(np.array([[1.0]])))[0] == pytest.approx(0.35)
    assert law.levels()[0].probability == pytest.approx(0.35)
    drawn = law.simulated(np.random.default_rng(3), 4000)
    assert drawn.mean() == pytest.approx(0.35, abs=0.03)


def test_p_values_of_counts_of_the_model_are_not_too_small():
    """Each of many levels is improbable, and yet one study in a hundred is contradicted."""
    generator = np.random.default_rng(4)
    burst = generator.uniform(0.1, 0.9, (FEWEST, 6))
    found = []
    for _ in range(200):
        row = burst[generator.integers(FEWEST)]
        ruptured = generator.binomial(3, row)
        found.append(judged_counts(counted([3] * 6, ruptured), chances(burst), generator, "x"))
    p_values = np.array([one.p_value for one in found])
    assert np.median([np.exp(one.log_probability) for one in found]) < COUNT_LEVEL
    assert stats.kstest(p_values, "uniform", alternative="greater").pvalue > 0.01
    assert sum(one.contradicts for one in found) <= stats.binom(200, COUNT_LEVEL).ppf(0.999)


def test_what_is_next_to_impossible_has_a_logarithm_and_the_least_p_value():
    certain = Chances(np.full((200, 1), -400.0), np.zeros((200, 1)))
    found = judged_counts(counted([3], [2]), certain, np.random.default_rng(5), "summary.csv")
    assert found.log_probability == pytest.approx(np.log(3.0) - 800.0)
    assert found.p_value == pytest.approx(1.0 / (1 + SETS))
    assert found.contradicts


def test_too_few_draws_with_an_answer_give_no_p_value():
    some = chances(np.full((FEWEST - 1, 1), 0.5))
    blank = Chances(*(np.full((50, 1), np.nan) for _ in range(2)))
    both = Chances(*(np.vstack(pair) for pair in zip(some, blank, strict=True)))
    found = judged_counts(counted([3], [2]), answered(both), np.random.default_rng(0), "x")
    assert np.isnan(found.p_value)
    assert not found.contradicts
    assert found.draws == FEWEST - 1


def test_counts_of_a_model_are_those_of_simulated_actuators():
    """By hand: actuators of the law of stiffness and of the limit, pressed to the largest."""
    model, values = small_model(), values_of(WEAK)
    tests = counted([3, 3], [0, 1], degradation=[0.0, 12.5])
    vectors = np.repeat(model.table.vectors(values), FEWEST, axis=0)
    found = count_misfit(
        model, RuptureCounts(tests), vectors, np.random.default_rng(6), "summary.csv"
    )
    generator, many = np.random.default_rng(7), 20_000
    for place, level in enumerate((0.0, 12.5)):
        many_values = {name: np.repeat(v, many) for name, v in values.items()}
        state = model.tests(many_values)
        one = counted([1], [0], degradation=[level])

        sd = np.sqrt(parts_of(state, one).spread)[..., None]
        asked = mechanics_inputs(state, one, sd * generator.standard_normal((many, 1, 1)))
        stretch = model.world.forward(asked).peak_stretch[:, 0, 0]
        median = model.world.elongation(values, np.array([level]))[0, 0] / 100.0
        scatter = WEAK["elongation_scatter"]
        limit = median * np.exp(scatter * generator.standard_normal(many))
        share = np.mean(stretch - 1.0 > limit)
        assert found.levels[place].probability == pytest.approx(share, abs=0.015)


def test_own_actuators_are_counted_by_level():
    model = small_model()
    own = own_counts(model).tests
    assert own.tested.sum() == len(model.data_of(Curvature).tests.specimens)
    assert own.ruptured.sum() == model.data_of(Curvature).tests.ruptured.any(axis=1).sum()
    assert own_counts(altered(model, actuator=None)) is None


def test_own_actuators_of_a_level_are_counted_in_the_room_of_their_tests():
    """Whose dry air weakens them, and that of the storage does not."""
    model, dry = small_model(), CATALOGUE["dry_embrittlement"]
    room = np.full(model.data_of(Curvature).tests.pressure.shape, 67.0)
    room[0], room[1], room[2] = 61.0, 63.0, np.nan  # two are fresh, the next is of 5 %
    known = altered(model, actuator=replace(model.data_of(Curvature).tests, humidity=room))
    tests = own_counts(known).tests
    np.testing.assert_array_equal(tests.humidity, [62.0, np.nan, 67.0, 67.0])
    assert np.all(np.isnan(own_counts(model).tests.humidity))
    values = values_of(TRUTH | {"elongation_at_25": 10.0})
    sizes = {dry.qualified(name): np.array([size]) for name, size in dry.typical.items()}
    without = chances_of(known.tests(values), tests).burst[0]
    with_it = chances_of(known.extended(dry).tests(values | sizes), tests).burst[0]
    np.testing.assert_array_equal(with_it[[0, 2, 3]], without[[0, 2, 3]])
    assert with_it[1] > without[1] + 1.0


def test_only_models_of_actuators_with_a_limit_are_asked():
    model = small_model()
    assert can_be_counted(model)
    unlimited = tuple(p for p in model.base if "elongation" not in p.name)
    assert not can_be_counted(
        altered(
            model,
            base=unlimited,
            breaks=None,
            statistics=tuple(
                s for s in model.data_of(Means).statistics if "elongation" not in s.quantity
            ),
        )
    )
