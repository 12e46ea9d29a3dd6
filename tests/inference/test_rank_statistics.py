"""Uniformity of ranks: the tests that judge the calibration hold their own level."""

import numpy as np
import pytest

from benchmarks.calibration_ranks import band, chi_square, coverage, ecdf, leaves

LARGEST = 99


def uniform(generator, count):
    return generator.integers(0, LARGEST + 1, count)


@pytest.mark.parametrize("count", [50, 200])
def test_the_band_holds_nineteen_of_twenty_uniform_samples(count):
    generator = np.random.default_rng(0)
    left = np.mean([leaves(uniform(generator, count), LARGEST) for _ in range(3000)])
    # never more than 5 %; less only by the counts being whole numbers
    assert 0.03 < left < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 3000)


def test_a_wider_level_makes_a_wider_band():
    lower, upper = band(200, LARGEST)
    wider_lower, wider_upper = band(200, LARGEST, 0.99)
    assert np.all(wider_lower <= lower)
    assert np.all(wider_upper >= upper)
    points = np.arange(1, LARGEST + 1) / (LARGEST + 1)
    assert np.all((lower < points) & (upper > points))


def test_chi_square_holds_its_level():
    generator = np.random.default_rng(1)
    p = np.array([chi_square(uniform(generator, 200), LARGEST) for _ in range(3000)])
    assert abs(np.mean(p < 0.05) - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / 3000)
    assert abs(np.mean(p < 0.5) - 0.5) < 4.0 * np.sqrt(0.25 / 3000) + 0.02


@pytest.mark.parametrize("shape", [(1.5, 1.0), (1.0, 1.5), (0.6, 0.6), (1.7, 1.7)])
def test_shifted_too_narrow_and_too_wide_posteriors_are_seen(shape):
    generator = np.random.default_rng(2)
    seen = []
    for _ in range(40):
        ranks = np.floor(generator.beta(*shape, 200) * (LARGEST + 1)).astype(np.int64)
        seen.append(leaves(ranks, LARGEST) and chi_square(ranks, LARGEST) < 0.05)
    assert np.mean(seen) > 0.7


def test_the_distribution_function_counts_the_ranks_below():
    np.testing.assert_allclose(ecdf(np.array([0, 0, 2]), 3), [2 / 3, 2 / 3, 1.0])


@pytest.mark.parametrize("probability", [0.5, 0.9])
def test_coverage_is_the_share_inside(probability):
    generator = np.random.default_rng(3)
    ranks = uniform(generator, 100_000)
    assert coverage(ranks, LARGEST, probability) == pytest.approx(probability, abs=0.01)
    assert coverage(np.full(10, 50), LARGEST, probability) == pytest.approx(1.0)
    assert coverage(np.array([0, 99]), LARGEST, probability) == pytest.approx(0.0)
