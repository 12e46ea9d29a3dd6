"""Densities of paths of readings against full covariance matrices of scipy.stats."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bayesdeg.observations import noise as likelihood
from bayesdeg.observations.noise import Linearised, paths_of
from tests.inference.path_filter import density_and_mode

POINTS = 5


@st.composite
def curves(draw, n=1, specimens=1):
    """Two outputs of paths of five points, with gaps, and one or two deviations."""
    outputs, k = draw(st.integers(1, 2)), draw(st.integers(1, 2))
    gaps = draw(st.lists(st.booleans(), min_size=outputs * POINTS, max_size=outputs * POINTS))
    nothing = draw(st.booleans())  # no deviation of the last kind
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = outputs * POINTS
    mask = np.array(gaps).reshape(outputs, POINTS) ^ (generator.random((specimens, 1, 1)) < 0.2)
    spread = generator.uniform(0.0, 9.0, (n, specimens, k))
    spread[..., -1] *= not nothing
    return Linearised(
        generator.uniform(-5.0, 5.0, (n, specimens, size)),
        generator.uniform(-5.0, 5.0, (n, specimens, size, k)),
        generator.uniform(0.05, 4.0, (n, specimens, size)),
        spread,
        generator.uniform(0.5, 60.0, n),
        generator.uniform(-0.95, 0.95, n),
        paths_of(mask, np.cumsum(generator.uniform(0.1, 30.0, (specimens, POINTS)), axis=1)),
    )


def covariance(curve, b=0, s=0):
    """Covariance of what was read, entry by entry."""
    paths = curve.paths
    rows = np.flatnonzero(paths.mask[s])
    matrix = np.empty((len(rows), len(rows)))
    for i, one in enumerate(rows):
        for j, other in enumerate(rows):
            distance = abs(paths.place[s, one] - paths.place[s, other])
            value = np.exp(-distance / curve.length[b])
            value *= 1.0 if one % POINTS == other % POINTS else 0.8
            if one // POINTS != other // POINTS:
                value *= curve.correlation[b]
            value *= np.sqrt(curve.variance[b, s, one] * curve.variance[b, s, other])
            value += np.sum(curve.slope[b, s, one] * curve.spread[b, s] * curve.slope[b, s, other])
            matrix[i, j] = value
    return rows, matrix


def reference(curve, b=0, s=0):
    rows, matrix = covariance(curve, b, s)
    if not len(rows):
        return 0.0
    law = stats.multivariate_normal(np.zeros(len(rows)), matrix, allow_singular=False)
    return law.logpdf(curve.residual[b, s, rows])


@settings(deadline=None)
@given(curve=curves())
def test_the_density_is_that_of_the_full_covariance(curve):
    density, _ = density_and_mode(curve)
    assert density.shape == (1, 1)
    assert density[0, 0] == pytest.approx(reference(curve), rel=1e-8, abs=1e-8)


@settings(max_examples=20, deadline=None)
@given(curve=curves(n=3, specimens=2))
def test_batches_are_single_paths(curve):
    density, _ = density_and_mode(curve)
    for b, s in np.ndindex(3, 2):
        assert density[b, s] == pytest.approx(reference(curve, b, s), rel=1e-8, abs=1e-8)


@settings(deadline=None)
@given(curve=curves())
def test_the_deviation_is_the_posterior_mean_of_the_linear_gaussian(curve):
    _, deviation = density_and_mode(curve)
    rows, matrix = covariance(curve)
    J, spread = curve.slope[0, 0, rows], curve.spread[0, 0]
    want = spread * (J.T @ np.linalg.solve(matrix, curve.residual[0, 0, rows]))
    np.testing.assert_allclose(deviation[0, 0], want, rtol=1e-6, atol=1e-8)


@settings(deadline=None)
@given(curve=curves())
def test_covariance_is_that_of_what_was_read_and_the_unit_matrix_elsewhere(curve):
    got = likelihood.covariance(curve)[0, 0]
    rows, matrix = covariance(curve)
    np.testing.assert_allclose(got[np.ix_(rows, rows)], matrix, rtol=1e-10, atol=1e-12)
    others = np.setdiff1d(np.arange(len(got)), rows)
    np.testing.assert_array_equal(got[others], np.eye(len(got))[others])


@settings(deadline=None)
@given(curve=curves())
def test_sequential_densities_are_those_given_what_came_before(curve):
    """log p(y_1 … y_j) − log p(y_1 … y_{j−1}), each from its own full matrix."""
    got = likelihood.sequential(curve)[0, 0]
    rows, matrix = covariance(curve)
    before = 0.0
    for count, row in enumerate(rows, start=1):
        law = stats.multivariate_normal(np.zeros(count), matrix[:count, :count])
        now = law.logpdf(curve.residual[0, 0, rows[:count]])
        assert got[row] == pytest.approx(now - before, rel=1e-6, abs=1e-6)
        before = now
    np.testing.assert_array_equal(np.delete(got, rows), 0.0)


@settings(deadline=None)
@given(curve=curves())
def test_what_is_masked_cannot_act(curve):
    hidden = np.where(curve.paths.mask, curve.residual, np.nan)
    slope = np.where(curve.paths.mask[..., None], curve.slope, np.nan)
    other = curve._replace(residual=hidden, slope=slope)
    for got, want in zip(density_and_mode(other), density_and_mode(curve), strict=True):
        np.testing.assert_array_equal(got, want)
    np.testing.assert_array_equal(likelihood.sequential(other), likelihood.sequential(curve))


def test_a_short_length_is_independence_and_products_of_many_variances_do_not_underflow():
    generator = np.random.default_rng(0)
    size = 400
    residual = 1e-3 * generator.standard_normal((1, 1, size))
    variance = np.full((1, 1, size), 1e-6)
    curve = Linearised(
        residual,
        np.zeros((1, 1, size, 1)),
        variance,
        np.ones((1, 1, 1)),
        np.array([1e-3]),
        np.zeros(1),
        paths_of(np.ones((1, 1, size), bool), np.arange(1.0, size + 1)[None]),
    )
    want = stats.norm(0.0, 1e-3).logpdf(residual).sum()
    assert density_and_mode(curve)[0][0, 0] == pytest.approx(want, rel=1e-12)


def test_readings_at_one_place_disagree_by_their_own_errors():
    """A pressure that is held, the top of a cycle: no two errors are wholly the same."""
    curve = Linearised(
        np.array([[[0.30, 0.31]]]),
        np.zeros((1, 1, 2, 1)),
        np.full((1, 1, 2), 1e-4),
        np.ones((1, 1, 1)),
        np.ones(1),
        np.zeros(1),
        paths_of(np.ones((1, 1, 2), bool), np.array([[1.0, 1.0]])),
    )
    law = stats.multivariate_normal(np.zeros(2), 1e-4 * np.array([[1.0, 0.8], [0.8, 1.0]]))
    assert density_and_mode(curve)[0][0, 0] == pytest.approx(law.logpdf([0.30, 0.31]))
    assert likelihood.sequential(curve).sum() == pytest.approx(law.logpdf([0.30, 0.31]))


def test_a_residual_that_is_no_number_gives_none():
    curve = Linearised(
        np.array([[[0.1, np.nan, 0.2]]]),
        np.ones((1, 1, 3, 1)),
        np.ones((1, 1, 3)),
        np.ones((1, 1, 1)),
        np.ones(1),
        np.zeros(1),
        paths_of(np.ones((1, 1, 3), bool), np.array([[1.0, 2.0, 3.0]])),
    )
    assert np.isnan(density_and_mode(curve)[0][0, 0])


def test_drawn_errors_have_the_correlation_of_the_path():
    mask = np.ones((1, 2, 4), bool)
    mask[0, 1, 2] = False
    paths = paths_of(mask, np.array([[5.0, 12.0, 30.0, 41.0]]))
    count = 40000
    drawn = likelihood.correlated_normals(
        paths, np.full(count, 14.0), np.full(count, 0.6), np.random.default_rng(2)
    )[:, 0]
    want = likelihood.noise_correlation(paths, np.array([14.0]), np.array([0.6]))[0, 0]
    np.testing.assert_allclose(np.cov(drawn.T), want, atol=5.0 * np.sqrt(2.0 / count))


@given(value=st.floats(-9.0, 9.0), mean=st.floats(-5.0, 5.0), sd=st.floats(0.01, 50.0))
def test_normal_is_that_of_scipy(value, mean, sd):
    assert likelihood.normal(value, np.array(mean), sd) == pytest.approx(
        stats.norm(mean, sd).logpdf(value), rel=1e-12, abs=1e-12
    )


@given(
    value=st.floats(-9.0, 9.0),
    mean=st.floats(-9.0, 9.0),
    scale=st.floats(0.01, 9.0),
    dof=st.one_of(st.floats(1.0, 50.0), st.just(np.inf)),
)
def test_student_is_that_of_scipy(value, mean, scale, dof):
    got = likelihood.student(value, np.array(mean), scale, dof)
    want = stats.norm(mean, scale) if np.isinf(dof) else stats.t(dof, mean, scale)
    assert got == pytest.approx(want.logpdf(value), rel=1e-9, abs=1e-9)
