"""Derivatives from factors against differences of the density, and climbs within bounds."""

import numpy as np
import pytest

from bayesdeg.inference.density import CustomDensity, Factors, bounds, factors_of
from bayesdeg.inference.laplace import derivatives, expansion, find_mode
from bayesdeg.priors import HalfNormal, Normal, Parameter, ParameterTable, TruncatedNormal, Uniform
from tests.inference.small_study import small_model, values_of


def near_truth(seed=0, width=0.02):
    model = small_model()
    start = model.table.vectors(values_of())[0]
    return model, start + width * np.random.default_rng(seed).standard_normal(len(start))


def test_factors_sum_to_the_log_density():
    model, point = near_truth()
    vectors = point + 0.01 * np.random.default_rng(1).standard_normal((5, len(point)))
    found = factors_of(model, vectors)
    readings = -0.5 * found.score**2 - found.log_sd - 0.5 * np.log(2.0 * np.pi)
    total = readings.sum(axis=1) + found.other.sum(axis=1) + found.prior.sum(axis=1)
    np.testing.assert_allclose(total, model.log_prob(vectors, truncate=False), rtol=1e-9)


def test_the_gradient_from_factors_is_that_of_the_density():
    model, point = near_truth()
    about = expansion(model, point)
    gradient, _ = derivatives(model, point)
    sd = np.sqrt(np.diag(np.linalg.inv(about.information)))
    np.testing.assert_allclose(about.gradient * sd, gradient * sd, atol=2e-3)
    assert about.value == pytest.approx(float(model.log_prob(point[None], truncate=False)[0]))


class Readings:
    """y ~ N(mean, sd) with unknown mean and sd, as factors; the mean may be bounded."""

    def __init__(self, readings, law):
        self.readings = np.array(readings)
        sd = Parameter("sd", HalfNormal(1.0), "–", "of the readings")
        self.table = ParameterTable((Parameter("mean", law, "–", "of the readings"), sd))

    def factors(self, vectors):
        mean, log_sd = vectors[:, :1], vectors[:, 1:]
        score = (self.readings - mean) / np.exp(log_sd)
        none = np.empty((len(vectors), 0))
        prior = self.table.log_priors(vectors, truncate=False)
        return Factors(score, log_sd + 0.0 * score, none, none, prior)

    def log_prob(self, vectors, *, truncate=True):
        found = self.factors(vectors)
        terms = -0.5 * found.score**2 - found.log_sd - 0.5 * np.log(2.0 * np.pi)
        return terms.sum(axis=1) + self.table.log_prior(vectors, truncate=truncate)


def test_information_of_mean_and_sd_is_that_of_the_textbook():
    density = Readings([0.3, -0.4, 0.1, 0.0], Normal(0.0, 10.0))
    about = expansion(density, np.array([0.1, np.log(0.5)]))
    prior = np.array([0.01, 0.0])
    assert about.information[0, 0] == pytest.approx(4 / 0.25 + prior[0], rel=1e-6)
    assert about.information[0, 1] == pytest.approx(0.0, abs=1e-6)
    assert about.information[1, 1] > 2 * 4  # and what the prior of the logarithm adds


def test_a_mode_that_presses_against_a_bound_stays_on_it():
    density = Readings([-1.0, -1.2, -0.8], TruncatedNormal(0.0, 1.0, 0.0))
    mode, covariance = find_mode(density, np.array([0.5, 0.0]))
    assert mode[0] == 0.0
    # the other parameter is at its mode given that
    grid = np.linspace(-2.0, 2.0, 4001)
    along = density.log_prob(np.column_stack([np.zeros(4001), grid]))
    assert mode[1] == pytest.approx(grid[int(np.argmax(along))], abs=0.02)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


@pytest.mark.parametrize("start", [-4.0, 0.0, 4.0])
def test_a_logit_that_runs_to_its_end_has_the_curvature_of_its_fall(start):
    """Data press a share towards 1: the mode of ln L + ln|dx/dz| is far out, where it is curved."""
    law = Uniform(0.0, 1.0)

    def log_likelihood(values):
        return 50.0 * values["share"]

    density = CustomDensity((Parameter("share", law, "–", "of something"),), log_likelihood)
    mode, covariance = find_mode(density, np.array([start]))
    grid = np.linspace(-10.0, 10.0, 200001)
    values = density.log_prob(grid[:, None])
    assert mode[0] == pytest.approx(grid[int(np.argmax(values))], abs=0.03)
    assert 0.5 < covariance[0, 0] < 2.0


def test_bounds_are_those_of_truncated_laws_alone():
    laws = (TruncatedNormal(0.0, 1.0, -1.0), Uniform(0.0, 1.0), HalfNormal(1.0), Normal(0.0, 1.0))
    table = ParameterTable(tuple(Parameter(f"p{i}", law, "–", "p") for i, law in enumerate(laws)))
    low, high = bounds(table)
    np.testing.assert_array_equal(low, [-1.0, -np.inf, -np.inf, -np.inf])
    np.testing.assert_array_equal(high, np.inf)
