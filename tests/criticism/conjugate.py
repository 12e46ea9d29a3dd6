"""A hierarchy of normal laws: posterior, leave-one-out and power-scaling in closed form.

y_ij = θ + a_i + ε_ij with θ ~ N(mean, sd²), a_i ~ N(0, between²), ε_ij ~ N(0, within²): given θ,
the readings of a specimen are jointly normal with covariance within² I + between² 1 1ᵀ, and the
specimen counts as one reading, its mean, of variance between² + within²/n.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import multivariate_normal, norm

from bayesdeg.inference.sampling import Chain
from bayesdeg.priors import Normal, Parameter, ParameterTable

BETWEEN, WITHIN = 0.4, 0.2


@dataclass(frozen=True)
class Readings:
    name: str
    specimens: tuple
    values: tuple

    @property
    def labels(self):
        return self.specimens

    def subset(self, rows):
        kept = (tuple(part[i] for i in rows) for part in (self.specimens, self.values))
        return Readings(self.name, *kept)


@dataclass(frozen=True)
class Conjugate:
    """Stands in for a model; its tables hold readings of the same kind."""

    mean: float
    sd: float
    observations: tuple[Readings, ...]

    @property
    def table(self):
        return ParameterTable((Parameter("theta", Normal(self.mean, self.sd), "–", "mean"),))

    def log_prob(self, vectors, *, truncate=True):
        total = self.table.log_prior(vectors, truncate=truncate)
        for block in self.log_likelihood(self.table.named(vectors)).values():
            total = total + block.sum(axis=-1)
        return total

    def log_likelihood(self, values):
        return {
            data.name: np.stack([density(values["theta"], v) for v in data.values], axis=-1)
            for data in self.observations
        }

    @property
    def information(self):
        """Precision and weighted mean of each table's specimens."""
        tables = self.observations
        means = np.array([np.mean(v) for t in tables for v in t.values])
        variance = np.array([BETWEEN**2 + WITHIN**2 / len(v) for t in tables for v in t.values])
        return means, 1.0 / variance

    def posterior(self):
        """Return mean and standard deviation of θ."""
        means, precision = self.information
        total = 1.0 / self.sd**2 + precision.sum()
        centre = (self.mean / self.sd**2 + precision @ means) / total
        return centre, total**-0.5

    def chain(self, draws=4000, seed=0):
        """Return independent draws as four ensembles of ten walkers."""
        centre, sd = self.posterior()
        generator = np.random.default_rng(seed)
        vectors = centre + sd * generator.standard_normal((4, draws // 40, 10, 1))
        log_prob = self.log_prob(vectors.reshape(-1, 1)).reshape(vectors.shape[:3])
        return Chain(vectors, log_prob, np.full(4, 0.4))


def density(theta, readings):
    count = len(readings)
    covariance = WITHIN**2 * np.eye(count) + BETWEEN**2
    centred = np.asarray(readings) - theta[:, None]
    return multivariate_normal(np.zeros(count), covariance).logpdf(centred).reshape(len(theta))


def exact_leave_one_out(model, specimen):
    """The readings of one specimen given all others: normal, with θ integrated out."""
    rest, own = [], []
    for data in model.observations:
        kept = [i for i, name in enumerate(data.specimens) if name != specimen]
        rest += [data.subset(kept)] if kept else []
        own += [v for name, v in zip(data.specimens, data.values, strict=True) if name == specimen]
    centre, sd = replace(model, observations=tuple(rest)).posterior()
    readings = np.concatenate(own)
    table = np.repeat(np.arange(len(own)), [len(v) for v in own])
    same = table[:, None] == table[None, :]
    covariance = WITHIN**2 * np.eye(len(readings)) + BETWEEN**2 * same + sd**2
    return multivariate_normal(np.full(len(readings), centre), covariance).logpdf(readings)


def study(*, specimens=8, readings=5, mean=0.0, sd=2.0, outlier=0.0, seed=3):
    """Films with several readings each; the last one lies off by so much."""
    generator = np.random.default_rng(seed)
    centres = norm.rvs(1.0, BETWEEN, specimens, random_state=generator)
    centres[-1] += outlier
    values = tuple(c + WITHIN * generator.standard_normal(readings) for c in centres)
    films = Readings("tensile", tuple(f"f{i}" for i in range(specimens)), values)
    return Conjugate(mean, sd, (films,))
