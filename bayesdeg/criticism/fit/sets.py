r"""Sets of causes on one linear scale: the evidence of every pair and every triple in closed form.

Each cause acts as :math:`d_i + S_i u_i`, linear about the size at which it was screened alone. With
v the sizes in prior units from neutral, standard normal before the data, and
:math:`t = z - \sum_i (d_i - S_i o_i)`, where :math:`o_i` is the screened size in those units,

.. math::
    \ln B = \tfrac12 \left[ z^T z - t^T t + t^T S (I + S^T S)^{-1} S^T t
            - \ln \det (I + S^T S) \right]
            + \sum_j \ln \frac{P(v_j \in \text{support} \mid t)}{P(v_j \in \text{support})},

the last for priors that end at a bound: a pair that needs a leak of a negative size has no evidence
to speak of. All follows from one matrix of inner products, so that thousands of sets take
milliseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.linear import Linear, neutral_sizes, prior_size
from bayesdeg.criticism.fit.screening import Screened
from bayesdeg.inference.density import bounds
from bayesdeg.priors import ParameterTable

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

IMPOSSIBLE = -1e6  # log probability that stands for none: no factor of a study comes near it


@dataclass(frozen=True)
class JointScreening:
    """Causes that were screened, each linear about its own size, to be put together in any set.

    Parameters
    ----------
    causes : tuple of Cause
        Those that change readings, m of them.
    sizes : array, shape (m, K)
        At which each was screened, in prior sizes from neutral; 0 where a cause has fewer than the
        K parameters of the largest.
    low, high : array, shape (m, K)
        Bounds of the priors on that scale.
    products : array, shape (1 + m + m K, 1 + m + m K)
        Inner products of the whitened data, of each cause's effect extrapolated to neutral, and of
        the derivatives.

    Examples
    --------
    Two effects at right angles add their evidence; the best pair is that of both.

    >>> from bayesdeg.priors import Normal, Parameter
    >>> from bayesdeg.causes.cause import Cause, Stage
    >>> def made(name, column):
    ...     size = Parameter("size", Normal(0.0, 1.0), "–", "of an effect", 0.0)
    ...     cause = Cause(name, Stage.READING, (size,), "", {"size": 1.0}, "",
    ...                   on_reading=lambda readings, *_: readings)
    ...     return Screened(cause, np.zeros(1), 0.0, np.zeros(3), column[:, None])
    >>> z = np.array([4.0, 3.0, 0.0])
    >>> found = JointScreening.of(z, [made(n, 9.0 * c) for n, c in zip("abc", np.eye(3))])
    >>> pairs = found.all_sets(2)
    >>> sorted(found.names_of(pairs[np.argmax(found.factors(pairs))]))
    ['a', 'b']
    """

    causes: tuple[Cause, ...]
    sizes: Floats
    low: Floats
    high: Floats
    products: Floats

    @classmethod
    def of(cls, observed: Floats, screened: Sequence[Screened]) -> "JointScreening":
        """Put screened causes together on the scale on which they were screened.

        Parameters
        ----------
        observed : array, shape (n,)
            The whitened data.
        screened : sequence of Screened
            Those that do not change the readings are left out.
        """
        acting = [one for one in screened if np.any(one.columns)]
        widest = max((one.columns.shape[1] for one in acting), default=1)
        rows = [_in_units(one, widest) for one in acting]
        sizes, low, high = (np.array([row[k] for row in rows]) for k in range(3))
        columns = [_padded(one.columns.T, widest).T for one in acting]
        rest = [
            one.effect - wide @ size for one, wide, size in zip(acting, columns, sizes, strict=True)
        ]
        everything = np.column_stack([observed, *rest, *columns])
        causes = tuple(one.cause for one in acting)
        return cls(causes, sizes, low, high, everything.T @ everything)

    @classmethod
    def at(cls, linear: Linear, screened: Sequence[Screened], scatter: Floats) -> "JointScreening":
        """Put causes together that were screened on a model, against another scatter of it.

        A model that lacks two causes widens its errors until both look small; the scatter of one
        that has what was found so far does not.

        Parameters
        ----------
        linear : Linear
            With which they were screened.
        screened : sequence of Screened
            The causes.
        scatter : array, shape (n, n)
            V of specimens and errors.
        """
        other = linear.with_scatter(scatter)
        if not other.is_known:
            return cls.of(linear.observed, screened)

        def moved(one: Screened) -> Screened:
            both = np.column_stack([one.effect, one.columns])
            again = other.whiten_columns(linear.whitening.coloured(both))
            return Screened(one.cause, one.size, one.log_bayes_factor, again[:, 0], again[:, 1:])

        return cls.of(other.observed, [moved(one) for one in screened])

    @cached_property
    def alone(self) -> Floats:
        """Log Bayes factors of the causes alone, linear as those of sets are, (m,)."""
        return self.factors(self.all_sets(1))

    def all_sets(self, size: int) -> Places:
        """Return every set of so many causes as places in `causes`, (n_sets, size)."""
        found = list(combinations(range(len(self.causes)), size))
        return np.array(found, dtype=np.int64).reshape(-1, size)

    def names_of(self, places: Places) -> frozenset[str]:
        """Return the names of a set (size,)."""
        return frozenset(self.causes[k].name for k in places)

    def places_of(self, names: frozenset[str]) -> Places | None:
        """Return a set as places (size,); None where one of them changes no reading."""
        known = [cause.name for cause in self.causes]
        if not names <= set(known):
            return None
        return np.array(sorted(known.index(name) for name in names), dtype=np.int64)

    def factors(self, sets: Places) -> Floats:
        """Return log Bayes factors of sets against none [nats], (n_sets,).

        Parameters
        ----------
        sets : array, shape (n_sets, size)
            Of places in `causes`, each set of distinct ones.
        """
        if not len(sets):
            return np.zeros(0)
        mean, covariance, factor = self._joint(sets)
        low, high = (ends[sets].reshape(len(sets), -1) for ends in (self.low, self.high))
        bounded = np.any(np.isfinite([low, high]), axis=0)
        sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        after = _log_probability((low - mean) / sd, (high - mean) / sd)
        before = _log_probability(low, high)
        inside = np.where(bounded, np.maximum(after, IMPOSSIBLE) - before, 0.0)
        total: Floats = factor + np.sum(inside, axis=1)
        return total

    def sizes_of(self, places: Places) -> dict[str, Floats]:
        """Return the most probable sizes in a set, on the unconstrained scale, by name.

        Within the bounds of the priors.
        """
        low, high = self.low[places].ravel(), self.high[places].ravel()
        mean = np.clip(self._joint(places[None])[0][0], low, high)
        rows = mean.reshape(len(places), -1)
        found = {}
        for k, row in zip(places, rows, strict=True):
            cause = self.causes[k]
            units = np.array([prior_size(p) for p in cause.parameters])
            found[cause.name] = neutral_sizes(cause) + row[: len(units)] * units
        return found

    def _joint(self, sets: Places) -> tuple[Floats, Floats, Floats]:
        """Return posterior mean and covariance of v, and the log Bayes factor without bounds."""
        count, m, width = len(sets), len(self.causes), self.sizes.shape[1]
        rest = 1 + sets
        own = 1 + m + (sets[:, :, None] * width + np.arange(width)).reshape(count, -1)
        g = self.products
        inner = np.eye(own.shape[1]) + g[own[:, :, None], own[:, None, :]]
        projected = g[0, own] - np.sum(g[rest[:, :, None], own[:, None, :]], axis=1)
        taken = 2.0 * np.sum(g[0, rest], axis=1)
        taken = taken - np.sum(g[rest[:, :, None], rest[:, None, :]], axis=(1, 2))
        covariance = np.linalg.inv(inner)
        mean = np.einsum("sij,sj->si", covariance, projected)
        gain = np.einsum("si,si->s", projected, mean)
        factor = 0.5 * (taken + gain - np.linalg.slogdet(inner)[1])
        return mean, covariance, factor


def largest_by_chance(whitened: Floats, columns: Sequence[Floats]) -> Floats:
    """Return the log Bayes factor of the best pair of causes in each data set [nats], (k,).

    Parameters
    ----------
    whitened : array, shape (k, n)
        Data without an effect.
    columns : sequence of array, shape (n, p)
        Changes of the readings by each cause for one prior size of each of its parameters.

    Examples
    --------
    >>> z = np.array([[2.0, 2.0, 0.0], [0.0, 0.0, 2.0]])
    >>> largest_by_chance(z, [c[:, None] for c in np.eye(3)]).round(4).tolist()
    [1.3069, 0.3069]
    """
    acting = [one for one in columns if np.any(one)]
    if len(acting) < 2 or not len(whitened):
        return np.zeros(len(whitened))
    width = max(one.shape[1] for one in acting)
    every = np.column_stack([_padded(one.T, width).T for one in acting])
    gram, projected = every.T @ every, whitened @ every
    largest = np.full(len(whitened), -np.inf)
    for first, second in combinations(range(len(acting)), 2):
        own = np.r_[first * width : (first + 1) * width, second * width : (second + 1) * width]
        inner = np.eye(len(own)) + gram[np.ix_(own, own)]
        z = projected[:, own]
        gain = np.einsum("ki,ij,kj->k", z, np.linalg.inv(inner), z)
        largest = np.maximum(largest, 0.5 * (gain - np.linalg.slogdet(inner)[1]))
    return largest


def _in_units(one: Screened, width: int) -> tuple[Floats, Floats, Floats]:
    """Return the size of a cause and the bounds of its prior, in prior sizes from neutral."""
    units = np.array([prior_size(p) for p in one.cause.parameters])
    neutral = neutral_sizes(one.cause)
    ends = bounds(ParameterTable(one.cause.parameters))
    low, high = ((end - neutral) / units for end in ends)
    return (
        _padded((one.size - neutral) / units, width),
        _padded(low, width, -np.inf),
        _padded(high, width, np.inf),
    )


def _padded(rows: Floats, width: int, value: float = 0.0) -> Floats:
    """Return rows with more of them of one value, up to a width."""
    more = [(0, width - len(rows))] + [(0, 0)] * (rows.ndim - 1)
    return np.pad(rows, more, constant_values=value)


def _log_probability(low: Floats, high: Floats) -> Floats:
    """Return ln of the probability that a standard normal number is between two bounds."""
    flip = low > 0.0  # the upper tail as the lower one, where the law is accurate
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    upper, lower = log_ndtr(high), log_ndtr(low)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Floats = upper + np.log1p(-np.exp(lower - upper))
    return np.where(np.isnan(found), IMPOSSIBLE, np.maximum(found, IMPOSSIBLE))
