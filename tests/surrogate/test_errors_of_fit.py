"""The emulator's own error, from errors drawn from a known law."""

import numpy as np
import pytest

from bayesdeg.surrogate.fit import coverage, fit_errors, nearness, summary
from bayesdeg.surrogate.scaling import NAMES
from bayesdeg.surrogate.terms import N_CHEBYSHEV, Terms, features

SKIN, EROSION = NAMES.index("skin"), NAMES.index("erosion")
NINETY = 1.6448536269514722


def points_of(count, generator):
    points = np.zeros((count, len(NAMES)))
    points[:, :N_CHEBYSHEV] = generator.uniform(-1.0, 1.0, (count, N_CHEBYSHEV))
    points[:, SKIN] = generator.uniform(0.0, 1.0, count) * generator.integers(0, 2, count)
    points[:, EROSION] = generator.uniform(0.0, 1.0, count) * generator.integers(0, 2, count)
    return points


def law(points):
    """Standard deviation of two outputs: ln of its square is quadratic."""
    u, a, b = points[:, 0], points[:, 1], points[:, 2]
    skin, erosion = points[:, SKIN], points[:, EROSION]
    level = -10.0 + 1.0 * u + 0.8 * a**2 - 0.7 * b + 0.5 * a * b + 1.5 * skin**2 - 0.6 * erosion
    return np.exp(0.5 * np.column_stack([level, level + 2.0 - 1.2 * u]))


def drawn(points, generator):
    return law(points) * generator.standard_normal((len(points), 2))


@pytest.fixture(scope="module")
def errors():
    generator = np.random.default_rng(11)
    points = points_of(8000, generator)
    return fit_errors(points, drawn(points, generator), np.ones(len(points)))


def sd_of(errors, points):
    return np.exp(0.5 * features(errors.orders, points) @ errors.coefficients.T)


def test_nine_tenths_of_fresh_errors_lie_within_the_interval(errors):
    generator = np.random.default_rng(12)
    points = points_of(20000, generator)
    for share in coverage(errors, points, drawn(points, generator)):
        assert 0.88 < share < 0.92


@pytest.mark.parametrize("output", [0, 1])
def test_the_interval_holds_where_errors_are_small_and_where_they_are_large(errors, output):
    generator = np.random.default_rng(13)
    points = points_of(20000, generator)
    size = law(points)[:, output]
    left_out = drawn(points, generator)
    for part in np.array_split(np.argsort(size), 4):
        assert 0.86 < coverage(errors, points[part], left_out[part])[output] < 0.94


def test_the_law_is_found_point_by_point(errors):
    points = points_of(2000, np.random.default_rng(14))
    ratio = np.log(sd_of(errors, points) / law(points))
    assert np.sqrt(np.mean(ratio**2)) < 0.15
    spread = np.std(np.log(law(points)), axis=0)
    assert np.all(spread > 0.3)  # a constant would not do


def test_points_count_by_their_weight():
    """Ten times larger errors, hardly weighted, leave the level where the others have it."""
    generator = np.random.default_rng(15)
    points = points_of(4000, generator)
    left_out = 0.01 * generator.standard_normal((4000, 1))
    far = np.arange(4000) % 2 == 0
    left_out[far] *= 10.0
    found = fit_errors(points, left_out, np.where(far, 1e-6, 1.0))
    assert coverage(found, points[~far], left_out[~far])[0] == pytest.approx(0.9, abs=0.01)
    equal = fit_errors(points, left_out, np.ones(4000))
    assert coverage(equal, points[~far], left_out[~far])[0] > 0.99


def test_heavy_tails_are_covered_too():
    """Of Student's law with three degrees nine tenths lie within, though it is not normal."""
    generator = np.random.default_rng(16)
    points = points_of(8000, generator)
    left_out = law(points) * generator.standard_t(3.0, (8000, 2))
    found = fit_errors(points, left_out, np.ones(8000))
    fresh = law(points) * generator.standard_t(3.0, (8000, 2))
    for share in coverage(found, points, fresh):
        assert 0.88 < share < 0.92


def test_coverage_counts_errors_within_the_interval_of_a_normal_law():
    constant = Terms(np.zeros((1, len(NAMES)), dtype=np.int64), np.log([[0.04], [1.0]]))
    sizes = np.array([0.0, 0.99, -0.99, 1.01, -1.01]) * NINETY
    left_out = np.column_stack([0.2 * sizes, 0.2 * sizes])
    assert coverage(constant, np.zeros((5, len(NAMES))), left_out) == [0.6, 1.0]


def test_nearness_falls_with_the_distance_in_standard_deviations():
    generator = np.random.default_rng(17)
    usual = points_of(500, generator)
    usual[:, 1:N_CHEBYSHEV] @= np.array([[0.3, 0.1, 0.0], [0.0, 0.2, 0.05], [0.0, 0.0, 0.4]])
    usual[:, 1:N_CHEBYSHEV] += [0.2, -0.1, 0.3]
    material = usual[:, 1:N_CHEBYSHEV]
    root = np.linalg.cholesky(np.cov(material.T))
    steps = np.array([0.0, 1.0, 2.0, 50.0])
    points = np.zeros((4, len(NAMES)))
    points[:, 0], points[:, SKIN] = [-1.0, 0.3, 1.0, 0.5], 0.7  # neither load nor cause counts
    points[:, 1:N_CHEBYSHEV] = material.mean(axis=0) + steps[:, None] * root[:, 1]
    wanted = [1.02, np.exp(-1.0 / 8.0) + 0.02, np.exp(-0.5) + 0.02, 0.02]
    np.testing.assert_allclose(nearness(points, usual), wanted, rtol=1e-9)


def test_summary_is_in_per_cent_of_sizes():
    found = summary([0.01, -0.03, 0.02, -0.02])
    assert found["rms_pct"] == pytest.approx(np.sqrt(4.5))
    assert found["median_pct"] == pytest.approx(2.0)
    assert found["p95_pct"] == pytest.approx(2.85)
    assert found["max_pct"] == pytest.approx(3.0)
    assert summary([]) == {}
