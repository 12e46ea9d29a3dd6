r"""Screening of causes and of all their sets on one linear scale.

A fast way to find the causes that deserve a full fit. The model's own parameters are integrated
out in the linearised model; only the size φ of a cause goes through the full equations, so that
strong effects are judged at their actual size. With z the whitened readings and d(φ) the whitened
effect,

.. math::
    \ln B = \ln \int \exp\left( z^T d(\varphi) - \tfrac12 |d(\varphi)|^2 \right)
            p(\varphi) \, d\varphi,

an average over draws from the prior and about the most probable size, weighted by their mixture.

In a set each cause acts as :math:`d_i + S_i u_i`, linear about the size at which it was screened
alone. With v the sizes in prior units from neutral, standard normal before the data, and
:math:`t = z - \sum_i (d_i - S_i o_i)`, where :math:`o_i` is the screened size in those units,

.. math::
    \ln B = \tfrac12 \left[ z^T z - t^T t + t^T S (I + S^T S)^{-1} S^T t
            - \ln \det (I + S^T S) \right]
            + \sum_j \ln \frac{P(v_j \in \text{support} \mid t)}{P(v_j \in \text{support})},

the last for priors with a bound: a pair that needs a leak of negative size has negligible evidence.
All follows from one matrix of inner products, so thousands of sets take milliseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp
from scipy.stats import multivariate_t, qmc

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.linear import (
    Linear,
    columns_of,
    differences,
    effects,
    is_seen,
    neutral_sizes,
    prior_size,
    with_neutral,
)
from bayesdeg.inference.density import bounds
from bayesdeg.inference.laplace import DEGREES_OF_FREEDOM
from bayesdeg.priors import ParameterTable

Floats = NDArray[np.float64]
Places = NDArray[np.int64]

DRAWS = 128  # draws from each of the prior and the neighbourhood of the most probable size
CLIMBS = 6
STEP = 1e-2  # step of differences, in prior sizes
WIDTHS = 9  # sizes tried of parameters that widen the scatter
SHORTER = (1.0, 0.5, 0.25, 0.1)
IMPOSSIBLE = -1e6  # log probability in place of −∞: no factor of a study comes near it


@dataclass(frozen=True)
class Screened:
    """One cause at its most probable size.

    Parameters
    ----------
    cause : Cause
        Which.
    size : array, shape (k,)
        Most probable values of its parameters on the unconstrained scale.
    log_bayes_factor : float
        Against the model without it [nats].
    effect : array, shape (n,)
        Whitened change of the readings at that size.
    columns : array, shape (n, k)
        Its derivative by the parameters, in prior sizes.
    """

    cause: Cause
    size: Floats
    log_bayes_factor: float
    effect: Floats
    columns: Floats


def screen(linear: Linear, cause: Cause) -> Screened:
    """Screen one cause on the data of a linearised model."""
    z = linear.observed
    count = len(cause.parameters)
    uniform = qmc.Halton(count, scramble=False).random(DRAWS + 1)[1:]  # the first is zero
    drawn = [
        p.law.to_unconstrained(p.law.quantile(u))
        for p, u in zip(cause.parameters, uniform.T, strict=True)
    ]
    prior = np.stack(drawn, axis=1)
    changes = effects(linear, cause, prior)
    fit = _log_likelihood(z, changes)
    start = np.vstack([neutral_sizes(cause), prior])
    fits = np.append(0.0, fit) + _log_prior(cause, start, truncate=False)
    size = start[int(np.argmax(fits))]
    units = np.array([prior_size(p) for p in cause.parameters])
    for _ in range(CLIMBS):
        size, moved = _climbed(linear, cause, size, units)
        if not moved:
            break
    effect, columns = _local(linear, cause, size, units)
    factor = _evidence(linear, cause, size, columns=columns, units=units, prior=(prior, fit))
    found = Screened(cause, size, factor, effect, columns)
    return replace(found, log_bayes_factor=factor + _widening(linear, found))


def _log_prior(cause: Cause, sizes: Floats, *, truncate: bool = True) -> Floats:
    total = np.zeros(len(sizes))
    for parameter, z in zip(cause.parameters, sizes.T, strict=True):
        law = parameter.law
        value = law.from_unconstrained(z)
        density = law.log_density(value) if truncate else law.untruncated_log_density(value)
        total = total + density + law.log_jacobian(z)
    return total


def _log_likelihood(z: Floats, changes: Floats) -> Floats:
    """Return ln N(z; d, I) − ln N(z; 0, I), (k,); −inf where a size is refused."""
    gain = changes @ z - 0.5 * np.sum(changes**2, axis=1)
    return np.where(np.isfinite(gain), gain, -np.inf)


def _local(linear: Linear, cause: Cause, size: Floats, units: Floats) -> tuple[Floats, Floats]:
    """Return the effect at a size and its derivative in prior sizes, (n,) and (n, k)."""
    step = STEP * np.diag(units)
    found = effects(linear, cause, np.vstack([size, size + step, size - step]))
    return np.nan_to_num(found[0]), np.nan_to_num(differences(found, STEP))


def _climbed(linear: Linear, cause: Cause, size: Floats, units: Floats) -> tuple[Floats, bool]:
    """Make one Gauss–Newton step, if it climbs."""
    effect, columns = _local(linear, cause, size, units)
    step = STEP * np.diag(units)
    around = np.vstack([size, size + step, size - step])
    prior = _log_prior(cause, around, truncate=False)
    count = len(units)
    slope = (prior[1 : count + 1] - prior[count + 1 :]) / (2.0 * STEP)
    bend = (2.0 * prior[0] - prior[1 : count + 1] - prior[count + 1 :]) / STEP**2
    precision = columns.T @ columns + np.diag(np.maximum(bend, 1e-3))
    move = np.linalg.solve(precision, columns.T @ (linear.observed - effect) + slope) * units
    trials = size + np.outer(np.append(SHORTER, 0.0), move)
    fits = _log_likelihood(linear.observed, effects(linear, cause, trials))
    fits = fits + _log_prior(cause, trials, truncate=False)
    best = int(np.argmax(fits))
    gained = fits[best] - fits[-1]
    return trials[best], bool(gained > 1e-3)


def _evidence(
    linear: Linear,
    cause: Cause,
    size: Floats,
    *,
    columns: Floats,
    units: Floats,
    prior: tuple[Floats, Floats],
) -> float:
    """Average the likelihood ratio over the prior, by draws from it and about the best size."""
    covariance = np.linalg.inv(columns.T @ columns + np.eye(len(units))) * np.outer(units, units)
    local = multivariate_t(size.tolist(), covariance, df=int(DEGREES_OF_FREEDOM))
    near = np.reshape(local.rvs(DRAWS, random_state=np.random.default_rng(0)), (DRAWS, -1))
    points = np.vstack([prior[0], near])
    fits = np.append(prior[1], _log_likelihood(linear.observed, effects(linear, cause, near)))
    density = _log_prior(cause, points)
    with np.errstate(divide="ignore"):
        mixture = np.logaddexp(density, np.log(local.pdf(points))) - np.log(2.0)
    weights = density + fits - mixture
    weights = np.where(np.isnan(weights), -np.inf, weights)
    return float(logsumexp(weights) - np.log(len(points)))


def _widening(linear: Linear, one: Screened) -> float:
    """Return the log Bayes factor of parameters that widen the scatter, averaged over their prior.

    The other parameters are integrated out, linear about their most probable size.
    """
    cause, size, columns = one.cause, one.size, one.columns
    wide = np.flatnonzero(~is_seen(columns))
    if not len(wide) or cause.is_of_rupture_alone:
        return 0.0
    extended = linear.subject.extended(cause)
    point = with_neutral(linear.mode, linear.subject, extended)
    where = columns_of(extended, cause)
    neutral = neutral_sizes(cause)
    point[where] = np.where(np.isin(np.arange(len(size)), wide), neutral, size)
    units = np.array([prior_size(p) for p in cause.parameters])
    offset = columns @ ((size - neutral) / units)
    residual = linear.whitening.coloured(linear.observed - one.effect + offset)
    own = linear.whitening.coloured(columns)
    scatter = extended.scatter(point)
    largest = (WIDTHS - 0.5) / WIDTHS
    ends = [p.law.to_unconstrained(p.law.quantile(largest)) for p in cause.parameters]
    point[where] = np.where(
        np.isin(np.arange(len(size)), wide), np.array(ends, dtype=np.float64), point[where]
    )
    if np.array_equal(extended.scatter(point), scatter):
        return 0.0
    base = linear.covariance + own @ own.T - scatter
    if not np.all(np.isfinite(base)):
        return 0.0
    ratios = []
    for share in (np.arange(WIDTHS) + 0.5) / WIDTHS:
        for k in wide:
            law = cause.parameters[k].law
            point[where[k]] = float(law.to_unconstrained(law.quantile(share)))
        ratios.append(_normal(residual, base + extended.scatter(point)))
    point[[where[k] for k in wide]] = neutral[wide]
    even = _normal(residual, base + extended.scatter(point))
    return float(logsumexp(np.array(ratios) - even) - np.log(WIDTHS))


def _normal(residual: Floats, covariance: Floats) -> float:
    if not np.all(np.isfinite(covariance)):
        return -np.inf
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return -np.inf
    z = np.linalg.solve(factor, residual)
    return float(-0.5 * z @ z - np.sum(np.log(np.diag(factor))))


@dataclass(frozen=True)
class JointScreening:
    """Screened causes, each linear about its own size, for combination in any set.

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
        """Combine screened causes on the scale on which they were screened.

        Those that do not change the readings are left out.
        """
        acting = [one for one in screened if np.any(one.columns)]
        widest = max((one.columns.shape[1] for one in acting), default=1)
        rows = []
        for one in acting:  # sizes and bounds in prior sizes from neutral
            units = np.array([prior_size(p) for p in one.cause.parameters])
            ends = (one.size, *bounds(ParameterTable(one.cause.parameters)))
            size, low, high = ((end - neutral_sizes(one.cause)) / units for end in ends)
            wide = _padded(size, widest), _padded(low, widest, -np.inf)
            rows.append((*wide, _padded(high, widest, np.inf)))
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
        """Combine causes screened on a model, with a different scatter V, (n, n).

        A model that lacks two causes widens its errors until both look small; with the scatter of
        the model found so far they do not.
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
        """Return every set of this many causes as indices into `causes`, (n_sets, size)."""
        found = list(combinations(range(len(self.causes)), size))
        return np.array(found, dtype=np.int64).reshape(-1, size)

    def names_of(self, places: Places) -> frozenset[str]:
        """Return the names of a set (size,)."""
        return frozenset(self.causes[k].name for k in places)

    def places_of(self, names: frozenset[str]) -> Places | None:
        """Return a set as indices (size,); None if one of them changes no reading."""
        known = [cause.name for cause in self.causes]
        if not names <= set(known):
            return None
        return np.array(sorted(known.index(name) for name in names), dtype=np.int64)

    def factors(self, sets: Places) -> Floats:
        """Return log Bayes factors of sets against none [nats], (n_sets,).

        The sets (n_sets, size) are of distinct places in `causes`.
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

    The data (k, n) are whitened and without an effect; columns (n, p) are the changes of the
    readings by each cause for one prior size of each of its parameters.

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


def _padded(rows: Floats, width: int, value: float = 0.0) -> Floats:
    """Return rows padded with a value up to a width."""
    more = [(0, width - len(rows))] + [(0, 0)] * (rows.ndim - 1)
    return np.pad(rows, more, constant_values=value)


def _log_probability(low: Floats, high: Floats) -> Floats:
    """Return ln of the probability that a standard normal number is between two bounds."""
    flip = low > 0.0  # use the lower tail, where the function is accurate
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    upper, lower = log_ndtr(high), log_ndtr(low)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Floats = upper + np.log1p(-np.exp(lower - upper))
    return np.where(np.isnan(found), IMPOSSIBLE, np.maximum(found, IMPOSSIBLE))
