"""Posteriors of posteriordb, written as its Stan models are, with their reference summaries.

Another is added by its parameters with their laws and a log likelihood over a batch of values; its
names are those of the reference file.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bayesdeg.distributions.improper import Flat
from bayesdeg.inference.density import CustomDensity
from bayesdeg.laws import HalfCauchy, HalfNormal, Normal, Parameter

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
