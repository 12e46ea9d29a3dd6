"""Posteriors whose moments others have established, through our own sampling and conversion."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy import integrate, stats

from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.sampling import EFFORTS, sample
from bayesdeg.inference.tree import to_datatree
from tests.inference.reference_posteriors import (
    POSTERIORS,
    REFERENCE,
    blr,
    flat_kidscore_momiq,
    kidscore_momiq,
)

each_posterior = pytest.mark.parametrize("name", POSTERIORS)


@dataclass(frozen=True)
class Moments:
    """Mean of a parameter's draws, its Monte Carlo error, and their standard deviation."""

    mean: float
    error: float
    sd: float


def sampled(density):
    """From nothing but the density to the moments of the DataTree's draws."""
    approximation, chains = np.random.SeedSequence(20211124).spawn(2)
    generator = np.random.default_rng(approximation)
    start = evidence(density, approximate(density, generator), generator)
    chain = sample(density, start, effort=EFFORTS["thorough"], seed=chains)
    draws = to_datatree(density, chain, generator)["posterior"].to_dataset()
    effective = dict(zip(density.table.names, chain.effective(), strict=True))
    return {
        name: Moments(
            float(values.mean()),
            float(values.std(ddof=1) / np.sqrt(effective[str(name)])),
            float(values.std(ddof=1)),
        )
        for name, values in draws.data_vars.items()
    }


@cache
def posterior(name):
    return sampled(POSTERIORS[name]())


@each_posterior
def test_the_parameters_are_those_of_the_reference(name):
    assert set(POSTERIORS[name]().table.names) == set(REFERENCE.loc[name].index)


@each_posterior
def test_means_are_within_four_combined_monte_carlo_errors(name):
    for parameter, found in posterior(name).items():
        want = REFERENCE.loc[(name, parameter)]
        error = np.hypot(found.error, want["mcse_mean"])
        assert abs(found.mean - want["mean"]) < 4.0 * error, parameter


@each_posterior
def test_standard_deviations_are_within_five_percent(name):
    for parameter, found in posterior(name).items():
        want = REFERENCE.loc[(name, parameter), "sd_derived"]
        assert found.sd == pytest.approx(want, rel=0.05), parameter


def exact_blr():
    """Means and sd's by quadrature over σ, given which β is normal."""
    density = blr()
    regression = density.log_likelihood.__self__
    x, y = regression.predictors, regression.outcome
    grid = np.linspace(0.7, 1.6, 2001)
    log_weight, means, squares = [], [], []
    for sigma in grid:
        precision = x.T @ x / sigma**2 + np.eye(5) / 100.0
        covariance = np.linalg.inv(precision)
        mean = covariance @ (x.T @ y) / sigma**2
        quadratic = y @ y / sigma**2 - mean @ precision @ mean
        log_weight.append(
            -0.5 * quadratic
            - len(y) * np.log(sigma)
            - 0.5 * np.linalg.slogdet(precision)[1]
            - 0.5 * (sigma / 10.0) ** 2
        )
        means.append(mean)
        squares.append(np.diag(covariance) + mean**2)
    weight = np.exp(np.array(log_weight) - max(log_weight))
    weight /= integrate.trapezoid(weight, grid)

    def average(values):
        return integrate.trapezoid(weight[:, None] * np.asarray(values), grid, axis=0)

    mean, sigma = average(means), average(grid[:, None])[0]
    sd = np.sqrt(average(np.asarray(squares) - mean**2))
    return {f"beta[{k + 1}]": (mean[k], sd[k]) for k in range(5)} | {
        "sigma": (sigma, np.sqrt(average((grid[:, None] - sigma) ** 2)[0]))
    }


def test_the_regression_has_the_moments_of_quadrature():
    found = posterior("sblrc-blr")
    for parameter, (mean, sd) in exact_blr().items():
        assert abs(found[parameter].mean - mean) < 4.0 * found[parameter].error, parameter
        assert found[parameter].sd == pytest.approx(sd, rel=0.05), parameter


def test_flat_priors_on_a_line_and_above_a_bound_give_the_textbooks_posterior():
    """With p(β, σ) ∝ 1/σ, β is Student's and s²(n − k)/σ² is χ²: Gelman et al., BDA3, 14.2."""
    found = sampled(flat_kidscore_momiq())
    regression = kidscore_momiq().log_likelihood.__self__
    x, y = regression.predictors, regression.outcome
    spread = np.linalg.inv(x.T @ x)
    estimate = spread @ x.T @ y
    degrees = len(y) - 2
    residual = float(np.sum((y - x @ estimate) ** 2))
    law = stats.invgamma(0.5 * degrees, scale=0.5 * residual)  # of σ²
    second = float(law.mean())
    first = float(law.expect(np.sqrt))
    want = {f"beta[{k + 1}]": (estimate[k], np.sqrt(second * spread[k, k])) for k in range(2)} | {
        "sigma": (first, np.sqrt(second - first**2))
    }
    for parameter, (mean, sd) in want.items():
        assert abs(found[parameter].mean - mean) < 4.0 * found[parameter].error, parameter
        assert found[parameter].sd == pytest.approx(sd, rel=0.05), parameter


@each_posterior
def test_the_mode_and_its_curvature_are_found_without_a_hint(name):
    """Both are regular: mode near the mean, and the normal law there as wide within a tenth."""
    density = POSTERIORS[name]()
    laplace = approximate(density, np.random.default_rng(3))
    sd = np.sqrt(np.diag(laplace.covariance))
    for k, parameter in enumerate(density.parameters):
        want = REFERENCE.loc[(name, parameter.name)]
        value = parameter.law.from_unconstrained(laplace.mode[k])
        slope = np.exp(parameter.law.log_jacobian(laplace.mode[k]))
        assert abs(value - want["mean"]) < 0.6 * want["sd_derived"], parameter.name
        assert sd[k] * slope == pytest.approx(want["sd_derived"], rel=0.1), parameter.name
