"""Every cause at its most probable size: fast, to see which deserve a full fit.

The model's own parameters are integrated out in the linearised model; the size φ of a cause goes
through the full equations, so that strong effects are judged at the size that they have. With z the
whitened readings and d(φ) the whitened effect,

    ln B = ln ∫ exp(z·d(φ) − |d(φ)|²/2) p(φ) dφ,

an average over draws from the prior and about the most probable size, weighted by their mixture.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import multivariate_t, qmc

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.linear import Linear, effects, is_seen, neutral_sizes, prior_size
from bayesdeg.criticism.subject import columns_of, with_neutral
from bayesdeg.inference.laplace import DEGREES_OF_FREEDOM

Floats = NDArray[np.float64]

DRAWS = 128  # from each of the prior and the neighbourhood of the most probable size
CLIMBS = 6
STEP = 1e-2  # of differences, in prior sizes
WIDTHS = 9  # sizes of what widens the scatter
SHORTER = (1.0, 0.5, 0.25, 0.1)


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
    """Judge one cause on the data of a linearised model."""
    z = linear.observed
    prior = _prior_draws(cause)
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


def _offset(one: Screened) -> Floats:
    units = np.array([prior_size(p) for p in one.cause.parameters])
    offset: Floats = (one.size - neutral_sizes(one.cause)) / units
    return offset


def _prior_draws(cause: Cause) -> Floats:
    count = len(cause.parameters)
    uniform = qmc.Halton(count, scramble=False).random(DRAWS + 1)[1:]  # the first is zero
    columns = [
        p.law.to_unconstrained(p.law.quantile(u))
        for p, u in zip(cause.parameters, uniform.T, strict=True)
    ]
    return np.stack(columns, axis=1)


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
    count = len(units)
    here, forth, back = found[0], found[1 : count + 1], found[count + 1 :]
    width = STEP * (np.isfinite(forth).astype(np.float64) + np.isfinite(back))
    change = np.where(np.isfinite(forth), forth, here) - np.where(np.isfinite(back), back, here)
    columns = change / np.maximum(width, STEP)
    return np.nan_to_num(here), np.nan_to_num(columns.T)


def _climbed(linear: Linear, cause: Cause, size: Floats, units: Floats) -> tuple[Floats, bool]:
    """Make one step of Gauss and Newton, as long as it climbs."""
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
    """Return what parameters that widen the scatter add, averaged over their prior.

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
    offset = columns @ _offset(one)
    residual = linear.whitening.coloured(linear.observed - one.effect + offset)
    own = linear.whitening.coloured(columns)
    scatter = extended.scatter(point)
    point[where] = np.where(np.isin(np.arange(len(size)), wide), _outermost(cause), point[where])
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


def _outermost(cause: Cause) -> Floats:
    """Return the largest size of each parameter that `_widening` looks at."""
    share = (WIDTHS - 0.5) / WIDTHS
    ends = [p.law.to_unconstrained(p.law.quantile(share)) for p in cause.parameters]
    return np.array(ends, dtype=np.float64)


def _normal(residual: Floats, covariance: Floats) -> float:
    if not np.all(np.isfinite(covariance)):
        return -np.inf
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return -np.inf
    z = np.linalg.solve(factor, residual)
    return float(-0.5 * z @ z - np.sum(np.log(np.diag(factor))))
