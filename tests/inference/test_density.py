"""Posteriors of others: laws without a probability, densities of any scale."""

import math

import numpy as np
import pytest
from scipy import stats

from bayesdeg.inference.density import CustomDensity, continued, guesses
from bayesdeg.inference.laplace import approximate, evidence, scales
from bayesdeg.priors import (
    Flat,
    HalfCauchy,
    Normal,
    Parameter,
    ParameterTable,
    TruncatedNormal,
    Uniform,
)

FLATS = [Flat(), Flat(low=0.0), Flat(low=-3.0), Flat(high=2.0)]
READINGS = np.array([1.2, 0.4, 2.2, 1.0])


def parameter(name, law):
    return Parameter(name, law, "–", "p")


@pytest.mark.parametrize("law", FLATS, ids=repr)
def test_a_flat_law_maps_the_whole_line_onto_its_support_and_back(law):
    z = np.linspace(-5.0, 5.0, 21)
    x = law.from_unconstrained(z)
    low, high = law.support
    assert np.all((x > low) & (x < high))
    assert np.all(np.diff(x) > 0.0)
    np.testing.assert_allclose(law.to_unconstrained(x), z, rtol=1e-10, atol=1e-10)
    slope = (law.from_unconstrained(z + 1e-6) - law.from_unconstrained(z - 1e-6)) / 2e-6
    np.testing.assert_allclose(law.log_jacobian(z), np.log(slope), atol=1e-7)


def test_a_flat_law_is_one_inside_and_impossible_outside():
    np.testing.assert_array_equal(Flat(low=1.0).log_density([0.9, 1.0, 1e9]), [-math.inf, 0.0, 0.0])
    np.testing.assert_array_equal(Flat(high=1.0).log_density([-1e9, 1.1]), [0.0, -math.inf])


def test_a_flat_law_cannot_be_drawn_from():
    with pytest.raises(ValueError, match="no quantiles"):
        Flat().sample(np.random.default_rng(0), 3)


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (0.0, 2.0), (math.nan, 1.0)])
def test_flat_laws_between_finite_or_wrong_bounds_are_refused(low, high):
    with pytest.raises(ValueError, match=r"Uniform|below"):
        Flat(low, high)


def log_likelihood(values):
    mean, sd, shape = (values[name][:, None] for name in ("mean", "sd", "shape"))
    return stats.norm(mean + shape, sd).logpdf(READINGS).sum(axis=1)


def custom():
    return CustomDensity(
        (
            parameter("mean", Normal(0.5, 2.0)),
            parameter("sd", HalfCauchy(1.0)),
            parameter("shape", Uniform(-1.0, 3.0)),
        ),
        log_likelihood,
    )


def test_the_density_is_prior_jacobian_and_likelihood_of_scipy():
    vectors = np.random.default_rng(0).standard_normal((6, 3))
    mean, sd = vectors[:, 0], np.exp(vectors[:, 1])
    share = 1.0 / (1.0 + np.exp(-vectors[:, 2]))
    want = (
        stats.norm(0.5, 2.0).logpdf(mean)
        + stats.halfcauchy(scale=1.0).logpdf(sd)
        + np.log(sd)
        + np.log(share * (1.0 - share))  # 1/4 of the prior times the width 4 of the interval
        + stats.norm(mean + 4.0 * share - 1.0, sd).logpdf(READINGS[:, None]).sum(axis=0)
    )
    np.testing.assert_allclose(custom().log_prob(vectors), want, rtol=1e-12)


@pytest.mark.parametrize("nonsense", [np.nan, np.inf, -np.inf])
def test_a_likelihood_that_is_no_number_is_impossible(nonsense):
    density = CustomDensity(
        (parameter("a", Normal(0.0, 1.0)),),
        lambda values: np.where(values["a"] > 0.0, nonsense, 0.0),
    )
    got = density.log_prob(np.array([[1.0], [-1.0]]))
    assert got[0] == -np.inf
    assert got[1] == pytest.approx(stats.norm.logpdf(-1.0))


@pytest.mark.parametrize("answer", [0.0, np.zeros((4, 1)), np.zeros(3)])
def test_a_likelihood_of_the_wrong_shape_is_told_what_is_expected(answer):
    density = CustomDensity((parameter("a", Normal(0.0, 1.0)),), lambda values: answer)
    with pytest.raises(ValueError, match=r"must return shape \(4,\)"):
        density.log_prob(np.zeros((4, 1)))


class Bare:
    """No more than a table and a density."""

    def __init__(self, law):
        self.table = ParameterTable((parameter("a", law),))

    def log_prob(self, vectors):
        return self.table.log_prior(vectors) - 0.5 * ((vectors[:, 0] + 1.0) / 0.5) ** 2


def test_a_density_without_the_keyword_is_taken_as_it_is():
    bare = Bare(TruncatedNormal(0.0, 1.0, 0.0))
    points = np.array([[-0.5], [0.5]])
    np.testing.assert_array_equal(continued(bare)(points), bare.log_prob(points))
    # pushed against its bound, the mode is there
    laplace = approximate(bare, np.random.default_rng(0))
    assert 0.0 <= laplace.mode[0] < 1e-3


def test_a_bare_density_has_its_mode_and_evidence():
    bare = Bare(Normal(0.0, 1.0))
    generator = np.random.default_rng(0)
    laplace = approximate(bare, generator)
    assert laplace.mode[0] == pytest.approx(-0.8, abs=1e-6)
    assert laplace.covariance[0, 0] == pytest.approx(0.2, rel=1e-4)
    found = evidence(bare, laplace, generator)
    want = stats.norm(0.0, math.sqrt(1.25)).logpdf(-1.0) + math.log(0.5 * math.sqrt(2.0 * math.pi))
    assert abs(found.log_evidence - want) < 4.0 * found.error


def test_guesses_are_prior_draws_and_about_zero_where_there_is_no_prior():
    table = ParameterTable((parameter("a", Normal(5.0, 0.1)), parameter("b", Flat(low=10.0))))
    found = guesses(table, np.random.default_rng(0), 500)
    assert found.shape == (501, 2)
    np.testing.assert_allclose(found[0], [5.0, 0.0])
    assert stats.kstest(found[1:, 0], stats.norm(5.0, 0.1).cdf).pvalue > 1e-3
    assert stats.kstest(found[1:, 1], stats.uniform(-2.0, 4.0).cdf).pvalue > 1e-3


def scaled_regression(scale):
    """y = a + b x, sd 1, with flat priors; in other units, b is another number."""
    x = 40.0 + np.linspace(-1.0, 1.0, 50)
    y = 3.0 - 2.0 * x + np.random.default_rng(0).standard_normal(50)
    design = np.column_stack([np.ones(50), x / scale])

    def log_likelihood(values):
        beta = np.stack([values["a"], values["b"]], axis=-1)
        return -0.5 * np.sum((y - beta @ design.T) ** 2, axis=1)

    covariance = np.linalg.inv(design.T @ design)
    density = CustomDensity((parameter("a", Flat()), parameter("b", Flat())), log_likelihood)
    return density, covariance @ design.T @ y, covariance


@pytest.mark.parametrize("scale", [1e-4, 1e-2, 1.0, 1e2, 1e4])
def test_mode_and_covariance_do_not_depend_on_units(scale):
    """Nor on correlation: intercept and slope have one of −0.9999."""
    density, mean, covariance = scaled_regression(scale)
    generator = np.random.default_rng(0)
    found = approximate(density, generator)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((found.mode - mean) / sd, 0.0, atol=0.05)
    units = np.outer(sd, sd)
    np.testing.assert_allclose(found.covariance / units, covariance / units, atol=0.02)
    assert evidence(density, found, generator).effective > 2000.0


def test_scales_are_one_for_regular_parameters():
    np.testing.assert_array_equal(scales(custom(), np.zeros(3)), np.ones(3))
