"""The law that moves are made of: its map, its density, its fit."""

import numpy as np
import pytest
from scipy import stats

from bayesdeg.inference.importance import DEGREES_OF_FREEDOM, Proposal, Warp

WARP = Warp(
    location=np.array([1.0, -2.0]),
    scale=np.array([0.5, 3.0]),
    skewness=np.array([0.6, -1.0]),
    tail=np.array([0.8, 1.3]),
)
FACTOR = np.array([[1.2, 0.0], [0.5, 0.4]])
LAW = Proposal(WARP, np.array([0.3, -0.1]), FACTOR, np.linalg.inv(FACTOR))


def points(count=200):
    return np.random.default_rng(0).normal([1.0, -2.0], [1.0, 5.0], (count, 2))


def test_the_map_and_its_inverse_undo_one_another():
    z, _ = WARP.normal(points())
    np.testing.assert_allclose(WARP.original(z), points(), rtol=1e-12)


def test_the_slope_of_the_map_is_that_of_differences():
    step = 1e-6
    _, log_slope = WARP.normal(points())
    slopes = (WARP.normal(points() + step)[0] - WARP.normal(points() - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(log_slope, np.log(slopes).sum(axis=1), atol=1e-6)


@pytest.mark.parametrize(
    "law",
    [
        stats.norm(3.0, 0.2),
        stats.norm(1e6, 1e-3),
        stats.loggamma(0.7),  # the log of a scale that data do not hold
        stats.skewnorm(8.0, 5.0, 2.0),
        stats.gumbel_r(0.0, 4.0),
        stats.t(10),
    ],
)
def test_bent_draws_of_a_law_are_nearly_normal(law):
    draws = law.rvs((4000, 1), random_state=np.random.default_rng(1))
    z, _ = Warp.fit(draws).normal(draws)
    assert abs(stats.skew(z[:, 0])) < 0.12
    assert abs(stats.kurtosis(z[:, 0])) < 0.3
    assert stats.kstest((z[:, 0] - z.mean()) / z.std(), "norm").statistic < 0.03


def test_the_density_is_students_times_the_slope():
    z, log_slope = WARP.normal(points())
    student = stats.multivariate_t(LAW.mean, FACTOR @ FACTOR.T, df=DEGREES_OF_FREEDOM)
    want = student.logpdf(z) + log_slope
    got = LAW.log_density(points())
    np.testing.assert_allclose(got - got[0], want - want[0], atol=1e-10)


def test_independent_proposals_have_the_laws_density():
    """Means of p/q over draws of q are those of p, here a normal law."""
    random = np.random.RandomState(np.random.MT19937(2))
    begin = np.zeros((200_000, 2))
    proposed, factor = LAW.independent(begin, random)
    log_q = LAW.log_density(begin) - factor
    np.testing.assert_allclose(log_q, LAW.log_density(proposed), rtol=1e-12)
    target = stats.multivariate_normal([1.2, -3.0], [[0.2, 0.1], [0.1, 1.0]])
    weights = np.exp(target.logpdf(proposed) - log_q)
    weights /= weights.sum()
    effective = 1.0 / np.sum(weights**2)
    assert effective > 2000
    mean = weights @ proposed
    np.testing.assert_allclose(mean, target.mean, atol=4.5 / np.sqrt(effective))
    np.testing.assert_allclose(
        (weights[:, None] * (proposed - mean)).T @ (proposed - mean),
        target.cov,
        atol=4.5 * np.sqrt(2.0 / effective),
    )


def test_a_fit_recovers_the_law_of_its_draws():
    draws = LAW.independent(np.zeros((20_000, 2)), np.random.RandomState(np.random.MT19937(3)))[0]
    fitted = Proposal.fit(draws)
    white, _ = fitted.white(draws)
    np.testing.assert_allclose(np.cov(white.T), np.eye(2), atol=1e-4)
    gap = fitted.log_density(draws) - LAW.log_density(draws)
    assert np.std(gap[np.linalg.norm(white, axis=1) < 2.5]) < 0.2


def test_a_fit_to_draws_in_a_plane_is_a_law_all_the_same():
    line = np.random.default_rng(4).standard_normal(500)
    fitted = Proposal.fit(np.column_stack([line, 2.0 * line, np.full(500, 3.0)]))
    proposed, factor = fitted.independent(
        np.zeros((50, 3)), np.random.RandomState(np.random.MT19937(5))
    )
    assert np.all(np.isfinite(proposed))
    assert np.all(np.isfinite(factor))
