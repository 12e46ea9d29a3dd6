"""Posteriors of posteriordb, written as its Stan models are, with their reference summaries.

Another is added by its parameters with their laws and a log likelihood over a batch of values; its
names are those of the reference file.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bayesdeg.inference.density import CustomDensity
from bayesdeg.priors import Flat, HalfCauchy, HalfNormal, Normal, Parameter

DATA = Path(__file__).parent / "data"
REFERENCE = pd.read_csv(DATA / "posteriordb_reference_summaries.csv", comment="#").set_index(
    ["posterior", "parameter"]
)


@dataclass(frozen=True)
class Regression:
    """y ~ normal(X β, σ)."""

    predictors: np.ndarray
    outcome: np.ndarray

    def log_likelihood(self, values):
        beta = np.stack([values[f"beta[{k + 1}]"] for k in range(self.predictors.shape[1])])
        residual = self.outcome - (self.predictors @ beta).T
        sigma = values["sigma"]
        count = len(self.outcome)
        return -0.5 * np.sum(residual**2, axis=1) / sigma**2 - count * np.log(sigma)


def _read(name):
    return pd.read_csv(DATA / f"posteriordb_{name}.csv", comment="#")


def _coefficients(count, law):
    return tuple(Parameter(f"beta[{k + 1}]", law, "–", "coefficient") for k in range(count))


def kidscore_momiq():
    """Stan: real beta[2]; real<lower=0> sigma; sigma ~ cauchy(0, 2.5); β has no prior."""
    table = _read("kidiq")
    iq = table["mom_iq"].to_numpy(float)
    regression = Regression(
        np.column_stack([np.ones(len(iq)), iq]), table["kid_score"].to_numpy(float)
    )
    sigma = Parameter("sigma", HalfCauchy(2.5), "–", "residual standard deviation")
    return CustomDensity((*_coefficients(2, Flat()), sigma), regression.log_likelihood)


def blr():
    """Stan: vector[5] beta; real<lower=0> sigma; beta ~ normal(0, 10); sigma ~ normal(0, 10)."""
    table = _read("sblrc")
    predictors = table[[f"x{k}" for k in range(1, 6)]].to_numpy(float)
    regression = Regression(predictors, table["y"].to_numpy(float))
    sigma = Parameter("sigma", HalfNormal(10.0), "–", "residual standard deviation")
    return CustomDensity((*_coefficients(5, Normal(0.0, 10.0)), sigma), regression.log_likelihood)


POSTERIORS = {"kidiq-kidscore_momiq": kidscore_momiq, "sblrc-blr": blr}


def flat_kidscore_momiq():
    """kidiq with p(σ) = 1/σ: β has Student's law, the textbook's closed form."""
    density = kidscore_momiq()
    *coefficients, sigma = density.parameters

    def log_likelihood(values):
        return density.log_likelihood(values) - np.log(values["sigma"])

    unbounded = Parameter(sigma.name, Flat(low=0.0), sigma.unit, sigma.meaning)
    return CustomDensity((*coefficients, unbounded), log_likelihood)


SCHOOLS = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])  # effects of coaching, and errors
SCHOOL_ERRORS = np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0])
MEAN = Parameter("mu", Normal(0.0, 5.0), "–", "mean of the schools")
SPREAD = Parameter("tau", HalfCauchy(5.0), "–", "their standard deviation")


def _schools(name, law):
    return tuple(Parameter(f"{name}[{k + 1}]", law, "–", "school") for k in range(8))


def _stacked(values, name, count):
    return np.stack([values[f"{name}[{k + 1}]"] for k in range(count)], axis=1)


def _centred(values):
    theta, mu, tau = _stacked(values, "theta", 8), values["mu"], values["tau"]
    spread = ((theta - mu[:, None]) / tau[:, None]) ** 2
    read = ((SCHOOLS - theta) / SCHOOL_ERRORS) ** 2
    return -0.5 * np.sum(spread + read, axis=1) - 8.0 * np.log(tau)


def _not_centred(values):
    theta = values["mu"][:, None] + values["tau"][:, None] * _stacked(values, "trans", 8)
    return -0.5 * np.sum(((SCHOOLS - theta) / SCHOOL_ERRORS) ** 2, axis=1)


def schools_centred():
    """Stan: theta ~ normal(mu, tau); tau ~ cauchy(0, 5); mu ~ normal(0, 5): a funnel."""
    return CustomDensity((*_schools("theta", Flat()), MEAN, SPREAD), _centred)


def schools_not_centred():
    """The same with theta = mu + tau trans, trans ~ normal(0, 1)."""
    return CustomDensity((*_schools("trans", Normal(0.0, 1.0)), MEAN, SPREAD), _not_centred)


PLACES = np.arange(-10.0, 11.0, 2.0)
HEIGHTS = np.array(
    [
        *(4.75906, 1.59423, 2.99548, 5.27501, 1.66472, 2.24347),
        *(2.8914, 4.08681, 4.60588, 0.802364, 3.92136),
    ]
)


def _process(values):
    """Stan: y ~ normal(0, K + sigma I), K = alpha² exp(−(x − x')²/(2 rho²)); rho ~ gamma(25, 4)."""
    rho, alpha, sigma = (values[n][:, None, None] for n in ("rho", "alpha", "sigma"))
    distance = PLACES[:, None] - PLACES
    covariance = alpha**2 * np.exp(-0.5 * (distance / rho) ** 2) + sigma * np.eye(len(PLACES))
    possible = np.isfinite(covariance).all(axis=(1, 2))
    factor = np.linalg.cholesky(np.where(possible[:, None, None], covariance, np.eye(len(PLACES))))
    white = np.linalg.solve(factor, HEIGHTS[:, None])[..., 0]
    log_determinant = np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=1)
    density = -0.5 * np.sum(white**2, axis=1) - log_determinant
    rho = values["rho"]
    return np.where(possible, density + 24.0 * np.log(rho) - 4.0 * rho, -np.inf)


def gp_regr():
    """Stan: alpha ~ normal(0, 2); sigma ~ normal(0, 1), a variance; all above 0."""
    return CustomDensity(
        (
            Parameter("rho", Flat(low=0.0), "–", "length"),
            Parameter("alpha", HalfNormal(2.0), "–", "height"),
            Parameter("sigma", HalfNormal(1.0), "–", "variance of the errors"),
        ),
        _process,
    )


@dataclass(frozen=True)
class Logit:
    """y ~ bernoulli(logit⁻¹(alpha + X β))."""

    predictors: np.ndarray
    outcome: np.ndarray

    def log_likelihood(self, values):
        beta = _stacked(values, "beta", self.predictors.shape[1])
        score = values["alpha"][:, None] + beta @ self.predictors.T
        return np.sum(self.outcome * score - np.logaddexp(0.0, score), axis=1)


def logit20():
    """alpha and 20 coefficients ~ normal(0, 2.5); made up, see the README of the data."""
    table = pd.read_csv(DATA / "logit20.csv", comment="#")
    predictors = table.drop(columns="y").to_numpy(float)
    regression = Logit(predictors, table["y"].to_numpy(float))
    law = Normal(0.0, 2.5)
    parameters = (Parameter("alpha", law, "–", "intercept"), *_coefficients(20, law))
    return CustomDensity(parameters, regression.log_likelihood)
