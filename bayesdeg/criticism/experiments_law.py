"""The law of readings that are still to be taken, under each of several hypotheses."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cholesky, helmert, solve_triangular

from bayesdeg.criticism.experiments_measurement import Measurement
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

ANSWERED = 0.9  # share of draws that must have an answer at a reading
COMPLETE = 0.5  # and share of draws that must have one at all readings
SCATTERS = 50  # draws over which the scatter of readings is averaged
SIMULATED = 300  # data sets


@dataclass(frozen=True)
class Law:
    """Normal law of the readings of k specimens that are tested alike.

    Parameters
    ----------
    mean : array, shape (d,)
        Of each specimen.
    common : array, shape (d, d)
        Covariance of what all specimens share: the parameters.
    own : array, shape (d, d)
        Covariance of what is each specimen's own: reading error and scatter.
    copies : int
        k.
    """

    mean: Floats
    common: Floats
    own: Floats
    copies: int

    def log_density(self, readings: Floats) -> Floats:
        """Return the log density of readings (k, n, d), shape (n,).

        An orthogonal turn of the specimens leaves their mean, times √k, with covariance
        V + k C, and k − 1 contrasts with covariance V.
        """
        k = self.copies
        total = _log_normal(
            np.sqrt(k) * (readings.mean(axis=0) - self.mean), self.own + k * self.common
        )
        if k > 1:
            contrasts = np.tensordot(helmert(k), readings, axes=1)
            flat = _log_normal(contrasts.reshape(-1, contrasts.shape[-1]), self.own)
            total = total + flat.reshape(contrasts.shape[:2]).sum(axis=0)
        return total

    def divergence(self, other: "Law") -> float:
        """Return the Kullback–Leibler divergence to another law of as many specimens [nats].

        It is the expected log Bayes factor where the readings have this law.

        Examples
        --------
        >>> one = np.eye(1)
        >>> near, far = (Law(np.array([m]), 0.0 * one, one, 3) for m in (0.0, 2.0))
        >>> round(near.divergence(far), 6)  # ½ (2/1)² for each of 3 specimens
        6.0
        """
        k = self.copies
        shift = np.sqrt(k) * (self.mean - other.mean)
        along = _divergence(shift, self.own + k * self.common, other.own + k * other.common)
        across = _divergence(np.zeros_like(shift), self.own, other.own) if k > 1 else 0.0
        return along + (k - 1) * across


class Foretold(NamedTuple):
    """The law of readings under one hypothesis, and readings drawn under it (k, n, d)."""

    law: Law
    drawn: Floats


class Separation(NamedTuple):
    """Expected log Bayes factor of the truth, and its Monte Carlo standard error [nats]."""

    expected: float
    error: float


def foretell(
    hypotheses: Sequence[tuple[Model, Named]],
    measurement: Measurement,
    generator: np.random.Generator,
) -> list[Foretold]:
    """Return the law of the readings under each hypothesis, and readings drawn under it.

    Parameters
    ----------
    hypotheses : sequence of (Model, mapping)
        Models with named draws of their parameters, (n,).
    measurement : Measurement
        What would be read.
    generator : Generator
        Draws the readings.

    Returns
    -------
    list of Foretold
        Empty where too little of it can be foretold.
    """
    expected = [measurement.expected(model, values) for model, values in hypotheses]
    answered = [np.mean(np.isfinite(one), axis=0) >= ANSWERED for one in expected]
    usable = measurement.read & np.logical_and.reduce(answered)
    found = []
    for (model, values), means in zip(hypotheses, expected, strict=True):
        complete = np.all(np.isfinite(means[:, usable]), axis=1)
        if not usable.any() or complete.mean() < COMPLETE:
            return []
        known = {name: value[complete] for name, value in values.items()}
        law = _law((model, known), measurement, means[complete][:, usable], usable)
        drawn = _drawn((model, known), measurement, usable, generator)
        if not drawn.shape[1]:
            return []
        found.append(Foretold(law, drawn))
    return found


def separation(first: Foretold, second: Foretold) -> tuple[Separation, Separation]:
    """Return what is expected if the first is the truth, and if the second is."""
    return _expected(first, second.law), _expected(second, first.law)


def _law(
    hypothesis: tuple[Model, Named], measurement: Measurement, means: Floats, usable: Flags
) -> Law:
    model, values = hypothesis
    own = measurement.covariance(model, _first(values, SCATTERS)).mean(axis=0)
    blocks = [one[np.ix_(row, row)] for one, row in zip(own, usable, strict=True)]
    common = np.atleast_2d(np.cov(means.T))
    return Law(means.mean(axis=0), common, np.asarray(block_diag(*blocks)), measurement.copies)


def _drawn(
    hypothesis: tuple[Model, Named],
    measurement: Measurement,
    usable: Flags,
    generator: np.random.Generator,
) -> Floats:
    """Draw readings of every copy, (k, n, d), without those that leave the model's range."""
    model, values = hypothesis
    some = _first(values, SIMULATED)
    copies = [measurement.simulated(model, some, generator) for _ in range(measurement.copies)]
    drawn = np.stack(copies)[:, :, usable]
    return drawn[:, np.all(np.isfinite(drawn), axis=(0, 2))]


def _first(values: Named, count: int) -> dict[str, Floats]:
    return {name: value[:count] for name, value in values.items()}


def _expected(truth: Foretold, other: Law) -> Separation:
    ratio = truth.law.log_density(truth.drawn) - other.log_density(truth.drawn)
    return Separation(float(ratio.mean()), float(ratio.std() / np.sqrt(len(ratio))))


def _log_normal(residual: Floats, covariance: Floats) -> Floats:
    """Return ln N(r; 0, C) of residuals (n, d), less the constant."""
    factor = cholesky(covariance, lower=True)
    z = solve_triangular(factor, residual.T, lower=True)
    density: Floats = -0.5 * np.sum(z**2, axis=0) - np.sum(np.log(np.diag(factor)))
    return density


def _divergence(shift: Floats, first: Floats, second: Floats) -> float:
    factor, other = cholesky(second, lower=True), cholesky(first, lower=True)
    z = solve_triangular(factor, shift, lower=True)
    ratio = solve_triangular(factor, other, lower=True)
    logs = np.sum(np.log(np.diag(factor))) - np.sum(np.log(np.diag(other)))
    return float(0.5 * (np.sum(ratio**2) + z @ z - len(shift)) + logs)
