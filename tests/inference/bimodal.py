"""Posteriors of two separate modes whose shares are known."""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayesdeg.inference.density import CustomDensity
from bayesdeg.priors import Normal, Parameter

SHARES = (0.3, 0.7)
APART = 8.0  # standard deviations between the centres
WIDE = 10.0  # sd of the prior, which the likelihood takes out again
LABELLED = np.concatenate([np.linspace(-3.0, 0.0, 40), np.linspace(0.0, 3.0, 40)])


@dataclass(frozen=True)
class TwoNormals:
    """0.3 N(−4 u, 1) + 0.7 N(4 u, 1) with u the unit vector along the diagonal."""

    size: int

    def log_likelihood(self, values):
        x = np.stack([values[f"x{k}"] for k in range(self.size)], axis=1)
        centres = 0.5 * APART / np.sqrt(self.size) * np.array([-1.0, 1.0])
        tops = [
            np.log(share) - 0.5 * np.sum((x - centre) ** 2, axis=1)
            for share, centre in zip(SHARES, centres, strict=True)
        ]
        return logsumexp(tops, axis=0) + 0.5 * np.sum((x / WIDE) ** 2, axis=1)


def two_normals(size):
    """Two normals 8 sd apart in so many dimensions."""
    parameters = tuple(Parameter(f"x{k}", Normal(0.0, WIDE), "–", "x") for k in range(size))
    return CustomDensity(parameters, TwoNormals(size).log_likelihood)


def _either(values):
    tops = [-0.5 * (LABELLED - values[name][:, None]) ** 2 for name in ("first", "second")]
    return np.sum(logsumexp(tops, axis=0) - np.log(2.0), axis=1)


def label_switching():
    """Readings of two groups, which of the two means is which being unknown: shares are equal."""
    law = Normal(0.0, 3.0)
    names = ("first", "second")
    return CustomDensity(tuple(Parameter(n, law, "–", "mean of a group") for n in names), _either)
