"""Probability integral transforms of held-out readings, with correlated readings."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

from bayesdeg.criticism.holdout.gain import Scatter, frame, loo_pit

SPECIMENS, READINGS = 18, 12
DRAWS = 300


def specimens_read(generator, count, *, scale=1.0, shift=0.0):
    """Readings of standard deviation 1, strongly correlated in each specimen, (count, n)."""
    common = generator.standard_normal((count, SPECIMENS, 1))
    own = generator.standard_normal((count, SPECIMENS, READINGS))
    both = np.sqrt(0.8) * common + np.sqrt(0.2) * own
    return (shift + scale * both).reshape(count, -1)


@pytest.fixture(scope="module")
def draws():
    return specimens_read(np.random.default_rng(0), DRAWS)


def test_p_values_are_uniform_although_readings_of_a_specimen_are_correlated():
    generator = np.random.default_rng(1)
    p_values, independent = [], []
    for _ in range(200):
        both = specimens_read(generator, DRAWS + 1)
        found = loo_pit(both[1:], both[0])
        p_values.append(found.p_value)
        independent.append(kstest(found.pit, "uniform").pvalue)
    smooth = np.array(p_values) - generator.uniform(size=200) / (DRAWS + 1)
    assert kstest(smooth, "uniform").pvalue > 0.01
    assert np.mean(np.array(independent) < 0.05) > 0.3  # what a test for independent values says


def test_transforms_are_those_of_the_normal_law(draws):
    observed = specimens_read(np.random.default_rng(2), 1)[0]
    pit = loo_pit(draws, observed).pit
    assert np.all((pit > 0.0) & (pit < 1.0))
    np.testing.assert_allclose(pit, norm.cdf(observed), atol=0.12)


def test_the_difference_is_that_of_the_empirical_distribution(draws):
    observed = specimens_read(np.random.default_rng(3), 1)[0]
    found = loo_pit(draws, observed)
    by_hand = [np.mean(found.pit <= u) - u for u in found.grid]
    np.testing.assert_allclose(found.difference, by_hand)


def test_the_curve_leaves_the_band_where_and_only_where_it_is_significant(draws):
    generator = np.random.default_rng(4)
    seen = set()
    for scale in (1.0, 1.0, 1.0, 1.6, 2.5, 0.4):
        found = loo_pit(draws, specimens_read(generator, 1, scale=scale)[0])
        outside = np.any((found.difference < found.low) | (found.difference > found.high))
        assert outside == (found.p_value <= 0.05)
        seen.add(bool(outside))
    assert seen == {True, False}


def test_the_band_holds_for_95_of_100_data_sets(draws):
    found = loo_pit(draws, draws[0])
    new = specimens_read(np.random.default_rng(5), 200)
    inside = 0
    for observed in new:
        one = loo_pit(draws, observed).difference
        inside += bool(np.all((one >= found.low) & (one <= found.high)))
    assert inside / 200 == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize(
    ("made", "scatter"),
    [
        ({"scale": 2.5}, Scatter.TOO_NARROW),
        ({"scale": 0.3}, Scatter.TOO_WIDE),
        ({"shift": 1.2}, Scatter.ABOVE),
        ({"shift": -1.2}, Scatter.BELOW),
        ({}, Scatter.AS_PREDICTED),
    ],
)
def test_what_is_most_remarkable_is_found(draws, made, scatter):
    observed = specimens_read(np.random.default_rng(11), 1, **made)[0]
    found = loo_pit(draws, observed)
    assert found.scatter is scatter
    assert np.isnan(found.share) == (scatter is Scatter.AS_PREDICTED)


def test_the_shares_are_those_of_the_readings(draws):
    observed = specimens_read(np.random.default_rng(11), 1, shift=-1.2)[0]
    below = np.mean(observed < np.median(draws, axis=0))
    assert loo_pit(draws, observed).share == pytest.approx(below)
    wide = specimens_read(np.random.default_rng(11), 1, scale=2.5)[0]
    low, high = np.quantile(draws, [0.25, 0.75], axis=0)
    inside = np.mean((wide > low) & (wide < high))
    assert loo_pit(draws, wide).share == pytest.approx(inside, abs=0.015)


def test_draws_without_an_answer_are_left_out_and_too_few_give_no_answer(draws):
    observed = draws[0]
    broken = np.vstack([draws, np.full((5, draws.shape[1]), np.nan)])
    assert loo_pit(broken, observed).p_value == loo_pit(draws, observed).p_value
    for few, counts in ((draws[:50], (50, 50)), (broken[-5:], (0, 5))):
        found = loo_pit(few, observed)
        assert not found.is_available
        assert np.isnan(found.p_value)
        assert np.all(np.isnan(found.difference))
        assert found.scatter is Scatter.NOT_KNOWN
        assert (found.replicates, found.drawn) == counts
    assert not loo_pit(draws[:, :0], observed[:0]).is_available


def test_the_table_holds_the_curves_of_every_model(draws):
    found = loo_pit(draws, specimens_read(np.random.default_rng(7), 1, scale=3.0)[0])
    table = frame({"base": found, "final": loo_pit(draws, draws[3])})
    base = table[table["model"] == "base"]
    np.testing.assert_allclose(base["probability"], found.grid)
    np.testing.assert_allclose(base["difference"], found.difference)
    np.testing.assert_allclose(base["low"], found.low)
    np.testing.assert_allclose(base["high"], found.high)
    assert set(base["p_value"]) == {found.p_value}
    assert set(base["replicates"]) == {found.replicates} == {DRAWS}
    assert list(table["model"].unique()) == ["base", "final"]
