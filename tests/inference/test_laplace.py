"""Mode, curvature and evidence where all three are known in closed form."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from bayesdeg.inference.density import CustomDensity
from bayesdeg.inference.laplace import (
    approximate,
    derivatives,
    evidence,
    find_mode,
    positive_inverse,
)
from bayesdeg.priors import Normal, Parameter, ParameterTable, TruncatedNormal
from tests.inference.small_study import small_model, values_of

SLOPES = np.array([[1.0, 0.5, -0.3], [0.2, -1.0, 0.4], [0.7, 0.1, 1.5], [1.0, 1.0, 1.0]])
READINGS = np.array([1.3, -0.2, 2.1, 1.9])
NOISE = 0.3
PRIOR_MEAN, PRIOR_SD = np.array([0.5, -0.2, 0.1]), np.array([1.0, 2.0, 0.5])


class LinearModel:
    """y = A θ + ε with independent priors: what a Model offers, in closed form."""

    def __init__(self, laws):
        self.table = ParameterTable(
            tuple(Parameter(f"p{i}", law, "–", "p") for i, law in enumerate(laws))
        )

    def log_prob(self, vectors, *, truncate=True):
        residual = READINGS - vectors @ SLOPES[:, : len(self.table)].T
        return self.table.log_prior(vectors, truncate=truncate) + np.sum(
            stats.norm(0.0, NOISE).logpdf(residual), axis=-1
        )


def conjugate():
    return LinearModel([Normal(m, s) for m, s in zip(PRIOR_MEAN, PRIOR_SD, strict=True)])


def posterior():
    precision = np.diag(PRIOR_SD**-2.0) + SLOPES.T @ SLOPES / NOISE**2
    covariance = np.linalg.inv(precision)
    return covariance @ (PRIOR_MEAN / PRIOR_SD**2 + SLOPES.T @ READINGS / NOISE**2), covariance


def closed_form_evidence():
    covariance = NOISE**2 * np.eye(4) + SLOPES @ np.diag(PRIOR_SD**2) @ SLOPES.T
    return stats.multivariate_normal(SLOPES @ PRIOR_MEAN, covariance).logpdf(READINGS)


@pytest.mark.parametrize("start", [None, np.array([5.0, -5.0, 5.0])])
def test_mode_and_covariance_of_a_gaussian_are_exact(start):
    found = approximate(conjugate(), np.random.default_rng(0), start=start)
    mean, covariance = posterior()
    np.testing.assert_allclose(found.mode, mean, atol=1e-5)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-4, atol=1e-7)
    assert found.log_density == pytest.approx(conjugate().log_prob(mean[None])[0], abs=1e-7)


def test_the_evidence_is_that_of_the_closed_form():
    model = conjugate()
    laplace = approximate(model, np.random.default_rng(0))
    misses = []
    for seed in range(200):
        found = evidence(model, laplace, np.random.default_rng(seed), draws=1000)
        assert 0.0 < found.error < 0.05
        assert 500 < found.effective <= 1000
        misses.append((found.log_evidence - closed_form_evidence()) / found.error)
    assert abs(np.mean(misses)) < 0.25
    assert np.max(np.abs(misses)) < 4.5
    assert 0.85 < np.sqrt(np.mean(np.square(misses))) < 1.2  # the stated error is the true one


def test_the_evidence_does_not_depend_on_a_good_proposal():
    """Importance sampling corrects a proposal that is off and too wide."""
    model = conjugate()
    laplace = approximate(model, np.random.default_rng(0))
    off = type(laplace)(laplace.mode + 0.1, 2.0 * laplace.covariance, laplace.log_density)
    found = evidence(model, off, np.random.default_rng(1), draws=20000)
    assert abs(found.log_evidence - closed_form_evidence()) < 3.0 * found.error < 0.1


def test_resampled_draws_are_of_the_posterior():
    model = conjugate()
    found = evidence(
        model, approximate(model, np.random.default_rng(0)), np.random.default_rng(2), draws=20000
    )
    draws = found.resample(np.random.default_rng(3), 20000)
    mean, covariance = posterior()
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5.0 * np.sqrt(np.diag(covariance) / 8000))
    np.testing.assert_allclose(np.cov(draws.T), covariance, rtol=0.1, atol=2e-3)


def truncated_model(low, high):
    return LinearModel([TruncatedNormal(0.0, 1.0, low, high)])


def truncated_evidence(low, high):
    grid = np.linspace(max(low, -9.0), min(high, 9.0), 200001)
    density = truncated_model(low, high).log_prob(grid[:, None])
    between = np.logaddexp(density[1:], density[:-1]) - np.log(2.0)
    return logsumexp(between) + np.log(grid[1] - grid[0])


def test_a_truncated_prior_whose_bound_cuts_the_posterior():
    model = truncated_model(1.7, np.inf)
    laplace = approximate(model, np.random.default_rng(0), start=np.array([1.9]))
    found = evidence(model, laplace, np.random.default_rng(1), draws=4000)
    assert found.effective > 3000  # the proposal knows the bound
    assert abs(found.log_evidence - truncated_evidence(1.7, np.inf)) < 3.0 * found.error


def test_a_truncated_prior_that_holds_the_mode_far_outside_has_its_evidence():
    """The data pull with a slope of 107 against the bound; without it the mode would be above 0."""
    model = truncated_model(-9.0, -8.0)
    laplace = approximate(model, np.random.default_rng(0), start=np.array([-8.5]))
    assert laplace.mode[0] == -8.0
    found = evidence(model, laplace, np.random.default_rng(1), draws=2000)
    assert np.all((found.draws >= -9.0) & (found.draws <= -8.0))
    assert found.effective > 500.0
    assert abs(found.log_evidence - truncated_evidence(-9.0, -8.0)) < 4.0 * found.error < 0.2


def test_derivatives_are_those_of_the_quadratic():
    mean, covariance = posterior()
    point = mean + np.array([0.3, -0.2, 0.1])
    gradient, hessian = derivatives(conjugate(), point)
    precision = np.linalg.inv(covariance)
    np.testing.assert_allclose(gradient, -precision @ (point - mean), rtol=1e-6)
    np.testing.assert_allclose(hessian, -precision, rtol=1e-5, atol=1e-4)


def test_flat_and_wrong_directions_are_taken_as_unit_wide():
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    covariance = positive_inverse(turn @ np.diag([4.0, 0.0, -2.0]) @ turn.T)
    np.testing.assert_allclose(covariance, turn @ np.diag([0.25, 1.0, 1.0]) @ turn.T, atol=1e-12)


def test_the_mode_of_a_real_posterior_is_a_mode():
    model = small_model()
    start = model.table.vectors(values_of())[0]
    found = approximate(model, np.random.default_rng(0), start=start)
    gradient, _ = derivatives(model, found.mode)
    sd = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(gradient) * sd < 0.05)
    around = found.mode + 0.2 * sd * np.vstack([np.eye(len(sd)), -np.eye(len(sd))])
    # a climb ends where a step gains next to nothing, a few hundredths of a standard deviation off
    assert np.all(model.log_prob(around, truncate=False) < found.log_density + 0.01)


def test_a_scatter_beside_another_is_found_though_it_has_no_slope_where_it_is_zero():
    """ln p rises with w² at first: a climb that begins at the bound of w would stay there."""
    readings = stats.norm.rvs(scale=0.5, size=40, random_state=7)
    widening = Parameter("widening", TruncatedNormal(0.0, 1.0, 0.0, np.inf), "–", "added scatter")

    def log_likelihood(values):
        sd = np.hypot(0.1, values["widening"])[:, None]
        return stats.norm(0.0, sd).logpdf(readings).sum(axis=1)

    density = CustomDensity((widening,), log_likelihood)
    mode, _ = find_mode(density, np.zeros(1))
    grid = np.linspace(0.0, 1.5, 3001)
    assert mode[0] == pytest.approx(grid[np.argmax(density.log_prob(grid[:, None]))], abs=2e-3)


def test_a_parameter_stays_at_its_bound_where_nothing_inside_is_more_likely():
    size = Parameter("size", TruncatedNormal(0.0, 1.0, 0.0, np.inf), "–", "of an effect")
    density = CustomDensity((size,), lambda values: -3.0 * values["size"])
    assert find_mode(density, np.ones(1))[0][0] == 0.0
