"""The mode of a log density and the curvature there.

A density that provides its factors (`bayesdeg.inference.density.Factored`) is climbed by
Fisher scoring: first derivatives of the factors give the gradient and the expected second
derivatives, at the cost of two densities for each parameter. Any other density is differenced
twice.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp, stdtr, stdtrit

from bayesdeg.inference.density import Density, Factors, bounds, continued, factors_of, guesses
from bayesdeg.observations.noise import LOG_TWO_PI
from bayesdeg.priors import Flat, ParameterTable

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP = 1e-3  # step of second differences, in units of a parameter's scale
SHORT = 1e-4  # step of differences of factors, in prior widths: rounding 1e-12, curvature 1e-8
INNER = 0.1  # fraction of it for the gradients, if gradients are differenced
REGULAR = (1e-2, 10.0)  # range of conditional widths within which a parameter's scale is taken as 1
USUAL, ANY = 10.0 ** np.arange(-3.0, 1.5, 0.5), 10.0 ** np.arange(-10.0, 10.5, 0.5)
IMPOSSIBLE = -1e12  # replaces −inf where a finite number is needed
FAR = 1e-3  # relative change of a large log density required: rounding hides less
LARGEST = 1e4  # largest density for which second differences are accurate
FLATTEST = 1e-4  # curvature, in units of the scales, below which a direction counts as flat
DAMPING = np.concatenate([[0.0], 10.0 ** np.arange(-2.0, 7.0)])  # dampings of a step, in curvatures
LENGTHS = np.array(
    [0.25, 0.5, 2.0, 4.0]
)  # multiples of the undamped step: convergence at the end is slow
CLOSE = 2e-4  # gain in log density at which a search ends: a fiftieth of a standard deviation
INWARDS = (0.1, 0.5, 1.0)  # distances from a bound, in prior widths, tried when a search ends there
LONGEST = 60
WIDEST = 5.0  # largest step of a logarithm or logit: beyond, its law is far from quadratic


class Expansion(NamedTuple):
    """A log density about a point: ln p ≈ value + gradient · δ − δ · information δ/2.

    ``gradient`` is (n_parameters,), ``information`` (n_parameters, n_parameters); ``unit`` holds
    the distances over which each parameter matters, (n_parameters,).
    """

    value: float
    gradient: Floats
    information: Floats
    unit: Floats


def find_mode(density: Density, start: Floats) -> tuple[Floats, Floats]:
    """Climb from a start to a mode within the bounds of truncated priors.

    Levenberg–Marquardt steps with the best of several dampings, cut at the bounds; a parameter at
    its bound stays there, unless the density is higher further inside: one of two scatters has no
    slope where it is zero. Returns the mode, (n_parameters,), and the inverse of the information
    there, (n_parameters, n_parameters).

    Examples
    --------
    >>> from bayesdeg.inference.density import CustomDensity
    >>> from bayesdeg.priors import Normal, Parameter
    >>> shift = Parameter("shift", Normal(1.0, 2.0), "–", "of a reading")
    >>> plain = CustomDensity((shift,), lambda values: np.zeros(len(values["shift"])))
    >>> mode, covariance = find_mode(plain, np.zeros(1))
    >>> mode.round(4), covariance.round(4)
    (array([1.]), array([[4.]]))
    """
    low, high = bounds(density.table)
    point = np.clip(np.ravel(start), low, high)
    for _ in range(LONGEST):
        about = expansion(density, point)
        free = ~((point <= low) & (about.gradient < 0.0) | (point >= high) & (about.gradient > 0.0))
        trials = np.clip(point + _steps(about, free, density.table), low, high)
        values = density.log_prob(trials)
        best = int(np.argmax(values))
        gain = float(values[best]) - about.value
        if gain > 0.0:
            point = trials[best]
        if not gain > CLOSE:
            inside = _inside(density, point, low, high)
            if inside is None:
                break
            point = inside
    unit = np.outer(about.unit, about.unit)
    return point, unit * positive_inverse(unit * about.information)


def _inside(density: Density, point: Floats, low: Floats, high: Floats) -> Floats | None:
    """Return the best point with one parameter away from its bound, if that is higher."""
    width = _widths(density.table)
    trials = []
    for end, inwards in ((low, 1.0), (high, -1.0)):
        for i in np.flatnonzero(np.abs(point - end) <= SHORT * width):
            for share in INWARDS:
                trials.append(point.copy())
                trials[-1][i] = np.clip(end[i] + inwards * share * width[i], low[i], high[i])
    if not trials:
        return None
    values = density.log_prob(np.array([point, *trials]))
    best = int(np.argmax(values))
    return trials[best - 1] if values[best] > values[0] + CLOSE else None


def expansion(density: Density, point: Floats) -> Expansion:
    """Return a quadratic expansion of the log density at a point.

    Its curvature is the expected one if the density is factored, else from differences. It may be
    indefinite where the density is not concave.
    """
    width = SHORT * _widths(density.table)
    around = point + np.vstack([np.zeros(len(point)), np.diag(width), -np.diag(width)])
    found = factors_of(density, around)
    if found is not None and np.isfinite(_total(found)).all():
        return _scored(found, density.table, point, width)
    scale = scales(density, point)
    gradient, hessian = derivatives(density, point, STEP * scale)
    return Expansion(float(bounded(density, point[None])[0]), gradient, -hessian, scale)


def _total(found: Factors) -> Floats:
    """Return the log density of factors up to a constant, (n,)."""
    readings = np.sum(-0.5 * found.score**2 - found.log_sd, axis=-1)
    total: Floats = readings + np.sum(found.other, axis=-1) + np.sum(found.prior, axis=-1)
    return total


def _scored(found: Factors, table: ParameterTable, point: Floats, width: Floats) -> Expansion:
    r"""Return gradient and expected information from factors here, a step forth and a step back.

    With z the scores, s their standard deviations and a = ∂z + z ∂ ln s, the slope of the expected
    reading over s, the information of readings is :math:`\sum_j a a^T + 2\, ∂\ln s\, (∂\ln s)^T`.
    """
    size, both = len(point), 2.0 * width[:, None]
    value = float(_total(found)[0]) - 0.5 * LOG_TWO_PI * found.score.shape[-1]
    slope = Factors(*((part[1 : size + 1] - part[size + 1 :]) / both for part in found))
    data = -slope.score @ found.score[0] - slope.log_sd.sum(axis=1) + slope.other.sum(axis=1)
    own = np.arange(size)
    here, forth, back = found.prior[0], found.prior[1 + own, own], found.prior[1 + size + own, own]
    by_prior = (forth - back) / (2.0 * width)
    bend = (2.0 * here - forth - back) / width**2
    mean = slope.score + slope.log_sd * found.score[0]
    information = mean @ mean.T + 2.0 * slope.log_sd @ slope.log_sd.T
    information += slope.signal @ slope.signal.T
    information[own, own] += bend + _from_the_scale(table, point, data)
    return Expansion(value, data + by_prior, information, width / SHORT)


def _from_the_scale(table: ParameterTable, point: Floats, slope: Floats) -> Floats:
    """Return what the curvature of the scale x(z) adds to the information, (n_parameters,).

    −∂ln L/∂z · x''/x' where that is positive: as a logarithm or a logit runs to its end, data press
    against the fall of the prior with a force that dies away, which first derivatives do not tell.
    """
    columns = []
    for i, p in enumerate(table.parameters):
        ends = p.law.log_jacobian(point[i] + STEP * np.array([-1.0, 1.0]))
        columns.append(float(ends[1] - ends[0]) / (2.0 * STEP))
    added: Floats = np.maximum(-slope * np.array(columns), 0.0)
    return added


def _steps(about: Expansion, free: Flags, table: ParameterTable) -> Floats:
    """Return trial steps, (n, n_parameters), zero for fixed parameters."""
    unit = np.where(free, about.unit, 0.0)
    gradient = unit * about.gradient
    values, vectors = np.linalg.eigh(np.outer(unit, unit) * about.information)
    along = vectors.T @ gradient
    # directions of positive curvature are climbed as if it were negative
    curvature = np.maximum(np.abs(values), FLATTEST)
    size = np.maximum(np.sum(vectors**2 * curvature, axis=1), FLATTEST)
    damped = [vectors @ (along / curvature)]
    inner = (vectors * curvature) @ vectors.T
    damped += [np.linalg.solve(inner + np.diag(d * size), gradient) for d in DAMPING[1:]]
    steps = unit * np.vstack([np.array(damped), LENGTHS[:, None] * damped[0]])
    # the scale of a logarithm or a logit is bent
    slopes = [p.law.log_jacobian(np.array([0.0, 1.0])) for p in table.parameters]
    reach = np.where([start != end for start, end in slopes], np.abs(steps), 0.0)
    return steps / np.maximum(np.max(reach, axis=1, initial=0.0) / WIDEST, 1.0)[:, None]


@lru_cache(maxsize=64)
def _widths(table: ParameterTable) -> Floats:
    """Return half the distances between the 16 % and 84 % quantiles of priors, as sampled."""
    widths = np.ones(len(table))
    for i, law in enumerate(p.law for p in table.parameters):
        if not isinstance(law, Flat):
            low, high = law.to_unconstrained(law.quantile(np.array([0.16, 0.84])))
            widths[i] = 0.5 * (high - low)
    return widths


def scales(density: Density, point: Floats) -> Floats:
    """Return the unit in which each parameter is treated at a point, shape (n_parameters,).

    1 where the log density changes by one half over a distance between 0.01 and 10 in all of them,
    as it does for logarithms; else for each the smallest power of √10 over which it does. Far from
    a mode, where densities are large, it is a change by a thousandth that counts.
    """
    here = float(bounded(density, point[None])[0])
    enough = max(0.5, FAR * abs(here)) if here > IMPOSSIBLE else 0.5

    def changes(steps: Floats) -> NDArray[np.bool_]:
        moves = (steps[:, None, None] * np.eye(len(point))).reshape(-1, len(point))
        change = bounded(density, np.vstack([point + moves, point - moves])) - here
        return np.any(np.abs(change.reshape(2, len(steps), -1)) >= enough, axis=0)

    narrow, regular = changes(np.array(REGULAR))
    if np.all(regular & ~narrow):
        return np.ones(len(point))
    reached = changes(USUAL)
    if np.all(reached.any(axis=0) & ~reached[0]):
        return USUAL[np.argmax(reached, axis=0)]
    reached = changes(ANY)
    return np.where(reached.any(axis=0), ANY[np.argmax(reached, axis=0)], 1.0)


def derivatives(
    density: Density, point: Floats, step: float | Floats = STEP
) -> tuple[Floats, Floats]:
    """Return gradient and Hessian of the log density at a point, bounds of priors left out.

    Differences of this step, one or of each parameter, are central, and one-sided where a neighbour
    is impossible: the step is then the distance between gradients, a tenth of it theirs.
    """
    steps = np.broadcast_to(np.asarray(step, dtype=np.float64), len(point))
    found = _from_pairs(density, point, steps)
    return _from_gradients(density, point, steps) if found is None else found


def _from_pairs(density: Density, point: Floats, steps: Floats) -> tuple[Floats, Floats] | None:
    """Second-order differences over all pairs of steps.

    None if a neighbour is impossible, or densities are so large that rounding would spoil them.

    H_ij = (f(i, j) + f(−i, −j) − f(i) − f(−i) − f(j) − f(−j) + 2 f) / (2 h_i h_j), with n² + n + 1
    densities in one call.
    """
    size = len(point)
    one = np.diag(steps)
    first, second = np.triu_indices(size, 1)
    both = one[first] + one[second]
    moves = np.vstack([np.zeros(size), one, -one, both, -both])
    values = bounded(density, point + moves)
    if not np.all(np.abs(values) < LARGEST):
        return None
    here, forth, back = values[0], values[1 : size + 1], values[size + 1 : 2 * size + 1]
    pairs = values[2 * size + 1 :].reshape(2, -1).sum(axis=0)
    around = forth + back
    hessian = np.diag((around - 2.0 * here) / steps**2)
    mixed = pairs - around[first] - around[second] + 2.0 * here
    hessian[first, second] = mixed / (2.0 * steps[first] * steps[second])
    hessian[second, first] = hessian[first, second]
    return (forth - back) / (2.0 * steps), hessian


def _from_gradients(density: Density, point: Floats, steps: Floats) -> tuple[Floats, Floats]:
    size = len(point)
    around = point + np.vstack([np.zeros(size), np.diag(steps), -np.diag(steps)])
    possible = (bounded(density, around) > IMPOSSIBLE)[:, None]
    gradients = slopes(density, around, INNER * steps)
    here = gradients[0]
    forth = np.where(possible[1 : size + 1], gradients[1 : size + 1], here)
    back = np.where(possible[size + 1 :], gradients[size + 1 :], here)
    sides = possible[1 : size + 1].astype(np.float64) + possible[size + 1 :]
    hessian = (forth - back) / (steps[:, None] * np.maximum(sides, 1.0))
    return here, 0.5 * (hessian + hessian.T)


def positive_inverse(precision: Floats) -> Floats:
    """Invert a precision, its eigenvalues held between `FLATTEST` and 1e8.

    A direction with too little curvature gets unit width.
    """
    values, vectors = np.linalg.eigh(precision)
    width = np.where(values > FLATTEST, 1.0 / np.clip(values, FLATTEST, 1e8), 1.0)
    covariance: Floats = (vectors * width) @ vectors.T
    return 0.5 * (covariance + covariance.T)


def bounded(density: Density, points: Floats) -> Floats:
    """Return the log density without bounds of priors, a large negative number where impossible."""
    return np.maximum(continued(density)(points), IMPOSSIBLE)


def slopes(density: Density, points: Floats, step: Floats) -> Floats:
    """Return gradients of ln p at points (n, size): differences, central where possible.

    Priors are taken without their bounds; ``step``, shape (size,), is that of the differences.
    """
    count, size = points.shape
    steps = np.vstack([np.zeros(size), np.diag(step), -np.diag(step)])
    values = bounded(density, (points[:, None, :] + steps).reshape(-1, size))
    values = values.reshape(count, 1 + 2 * size)
    here, forth, back = values[:, :1], values[:, 1 : size + 1], values[:, size + 1 :]
    possible = (forth > IMPOSSIBLE).astype(np.float64) + (back > IMPOSSIBLE)
    change = np.where(forth > IMPOSSIBLE, forth, here) - np.where(back > IMPOSSIBLE, back, here)
    found: Floats = change / (step * np.maximum(possible, 1.0))
    return found


DEGREES_OF_FREEDOM = (
    6.0  # degrees of freedom: 4 to 12 give as many effective draws; fewer miss no tail
)
LOOKS = np.array([1.5, 3.0, 6.0])  # distances at which widths are measured, in standard deviations
SHORT_LOOKS = np.array([0.02, 0.06, 0.2, 0.6])  # at a bound that holds the mode the fall is steeper
NARROWEST, WIDEST_PIECE = 0.01, 4.0  # limits of a width, in standard deviations
ROOM = 1e-3  # probability of a side below which it is ignored
LEAST = 1e-300  # smallest probability used as a divisor


@dataclass(frozen=True)
class TwoPiece:
    r"""θ = mode + L w, with w along each axis a Student law of width a below and b above zero.

    .. math:: q(w) = \frac{2}{a + b}\, t_\nu(w/a)\ (w < 0), \qquad
        \frac{2}{a + b}\, t_\nu(w/b)\ (w \ge 0)

    Truncated parameters come first in the order of L, so that each axis can be cut where its
    parameter reaches a bound.

    Parameters
    ----------
    mode : array, shape (n,)
        In the order of the vectors.
    factor : array, shape (n, n)
        L, lower triangular.
    order : array of int, shape (n,)
        Parameter of each row of L.
    below, above : array, shape (n,)
        a and b.
    low, high : array, shape (n_bounded,)
        Bounds of the first parameters of the order.
    """

    mode: Floats
    factor: Floats
    order: NDArray[np.intp]
    below: Floats
    above: Floats
    low: Floats
    high: Floats

    def draw(self, generator: np.random.Generator, count: int) -> tuple[Floats, Floats]:
        """Draw vectors (count, n), and return them with their log densities (count,)."""
        uniform = generator.random((count, len(self.mode)))
        w, log_density = np.empty_like(uniform), np.zeros(count)
        centre = self.mode[self.order]
        for k in range(len(self.low)):
            middle = centre[k] + w[:, :k] @ self.factor[k, :k]
            ends = np.array([[self.low[k]], [self.high[k]]]) - middle
            first, last = self._share(ends / self.factor[k, k], k)
            w[:, k] = self._quantile(first + uniform[:, k] * (last - first), k)
            log_density -= np.log(np.maximum(last - first, LEAST))
        free = slice(len(self.low), None)
        w[:, free] = self._quantile(uniform[:, free], free)
        vectors = np.empty_like(w)
        vectors[:, self.order] = centre + w @ self.factor.T
        within = np.clip(vectors[:, self.order[: len(self.low)]], self.low, self.high)
        vectors[:, self.order[: len(self.low)]] = within  # rounding may overstep a bound
        return vectors, log_density + self._log_density(w)

    def _log_density(self, w: Floats) -> Floats:
        nu = DEGREES_OF_FREEDOM
        constant = gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
        z = w / np.where(w < 0.0, self.below, self.above)
        one = constant + np.log(2.0 / (self.below + self.above))
        each = one - 0.5 * (nu + 1.0) * np.log1p(z**2 / nu)
        density: Floats = np.sum(each, axis=-1) - np.sum(np.log(np.diag(self.factor)))
        return density

    def _share(self, w: Floats, axis: int) -> Floats:
        """Return the probability below w along an axis."""
        a, b = self.below[axis], self.above[axis]
        left = a * stdtr(DEGREES_OF_FREEDOM, np.minimum(w, 0.0) / a)
        right = b * (stdtr(DEGREES_OF_FREEDOM, np.maximum(w, 0.0) / b) - 0.5)
        share: Floats = 2.0 * (left + right) / (a + b)
        return share

    def _quantile(self, share: Floats, axes: int | slice) -> Floats:
        """Return w below which lies a share of the probability along the axes."""
        a, b = self.below[axes], self.above[axes]
        lower = 0.5 * share * (a + b)
        is_below = lower < 0.5 * a
        tail = np.where(is_below, lower / a, 0.5 + (lower - 0.5 * a) / b)
        quantile: Floats = np.where(is_below, a, b) * stdtrit(DEGREES_OF_FREEDOM, tail)
        return quantile


def about(density: Density, mode: Floats, covariance: Floats) -> TwoPiece:
    """Return a proposal about a mode, its widths measured along each axis.

    Each axis is followed for 1.5 to 6 standard deviations, or for less where a bound is near. The
    covariance is the inverse of the information at the mode.
    """
    low, high = bounds(density.table)
    bounded = np.isfinite(low) | np.isfinite(high)
    order = np.argsort(~bounded, kind="stable")
    factor = np.linalg.cholesky(covariance[np.ix_(order, order)])
    count = int(bounded.sum())
    axes = np.zeros_like(factor)
    axes[order] = factor
    room = np.full((2, len(mode)), np.inf)
    ends = np.stack([mode - low, high - mode])[:, order[:count]]
    room[:, :count] = np.maximum(ends, 0.0) / np.diag(factor)[:count]
    below, above = _sides(density, mode, axes, room)
    return TwoPiece(mode, factor, order, below, above, low[order[:count]], high[order[:count]])


def _sides(density: Density, mode: Floats, axes: Floats, room: Floats) -> tuple[Floats, Floats]:
    """Return the widths along each axis, backward and forward, in standard deviations."""
    held = np.min(room, axis=0) < LOOKS[0]
    looks = np.concatenate([SHORT_LOOKS, LOOKS])[:, None]
    asked = held | (looks >= LOOKS[0])
    distance = np.stack([np.where(asked, np.minimum(looks, space), 0.0) for space in room])
    side, look, axis = np.nonzero(distance > ROOM)
    steps = np.where(side == 0, -1.0, 1.0) * distance[side, look, axis]
    values = density.log_prob(np.vstack([mode, mode + steps[:, None] * axes[:, axis].T]))
    drop = np.full(distance.shape, np.nan)
    drop[side, look, axis] = values[0] - values[1:]
    below, above = (_typical(*one, held) for one in zip(distance, drop, strict=True))
    below, above = (
        np.where(np.isnan(own), other, own) for own, other in ((below, above), (above, below))
    )
    return np.nan_to_num(below, nan=1.0), np.nan_to_num(above, nan=1.0)


def _typical(distance: Floats, drop: Floats, held: NDArray[np.bool_]) -> Floats:
    """Return a width from the drops at several distances, (n,); nan without any.

    The largest width with which Student's law has dropped as much at any of the looks: a tail that
    is too light misses what weighs most. Where a bound holds the mode, what that look says at which
    the density has dropped most nearly as much as a normal law at 1.5 standard deviations.
    """
    nu = DEGREES_OF_FREEDOM
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scaled = np.sqrt(nu * np.expm1(2.0 * np.maximum(drop, 0.0) / (nu + 1.0)))
        width = np.clip(distance / scaled, NARROWEST, WIDEST_PIECE)
        off = np.abs(np.log(np.maximum(drop, 0.0) / (0.5 * LOOKS[0] ** 2)))
    usual = np.max(width[-len(LOOKS) :], axis=0)
    best = np.argmin(np.where(np.isnan(off), np.inf, off), axis=0)
    return np.where(held, width[best, np.arange(len(held))], usual)


ROUND = 500  # proposals drawn and evaluated together
POOR = 0.02  # share of effective draws below which further draws of the same law are useless
LIGHT = (
    1.0 / 3.0
)  # shape of a tail up to which the weights have a third moment and are left unchanged
FEWEST_SMOOTHED = 100  # fewest draws for fitting a law to the tail
FEWEST_EFFECTIVE = 30.0  # fewest effective draws of a usable importance sample


@dataclass(frozen=True)
class Laplace:
    """A posterior's mode and its normal approximation there.

    Parameters
    ----------
    mode : array, shape (n_parameters,)
        On the unconstrained scale, within the bounds of truncated priors.
    covariance : array, shape (n_parameters, n_parameters)
        Inverse of the information there.
    log_density : float
        Log posterior density at the mode, not normalised.
    """

    mode: Floats
    covariance: Floats
    log_density: float


@dataclass(frozen=True)
class Evidence:
    """A marginal likelihood by importance sampling from the Laplace approximation.

    Parameters
    ----------
    log_evidence, error : float
        Estimate and its standard error.
    draws : array, shape (n, n_parameters)
        Proposals.
    log_weights : array, shape (n,)
        Their log importance weights.
    effective : float
        Effective number of draws.
    log_densities : array, shape (n,)
        Log posterior densities of the draws, not normalised; empty if unknown.
    pareto_k : float
        Shape of the tail of the weights; above 0.7 they are unreliable. Nan if unknown.
    """

    log_evidence: float
    error: float
    draws: Floats
    log_weights: Floats
    effective: float
    log_densities: Floats = field(default_factory=lambda: np.empty(0))
    pareto_k: float = float("nan")

    @property
    def top(self) -> tuple[Floats, float] | None:
        """The most probable draw and its log density; None if densities are unknown."""
        if not len(self.log_densities):
            return None
        best = int(np.argmax(self.log_densities))
        return self.draws[best], float(self.log_densities[best])

    def resample(self, generator: np.random.Generator, count: int) -> Floats:
        """Draw from the posterior, with replacement, shape (count, n_parameters)."""
        weights = np.exp(self.log_weights - logsumexp(self.log_weights))
        return self.draws[generator.choice(len(weights), count, p=weights)]


def approximate(
    density: Density, generator: np.random.Generator, *, start: Floats | None = None
) -> Laplace:
    """Return the Laplace approximation of a posterior.

    ``start``, shape (n_parameters,), is near the mode; by default the best of 400 prior draws.
    """
    if start is None:
        trials = guesses(density.table, generator, 400)
        start = trials[int(np.argmax(density.log_prob(trials)))]
    mode, covariance = find_mode(density, start)
    return Laplace(mode, covariance, float(density.log_prob(mode[None])[0]))


def with_exact_curvature(density: Density, laplace: Laplace) -> Laplace:
    """Return the approximation with second differences of the density instead of expected ones."""
    scale = scales(density, laplace.mode)
    _, hessian = derivatives(density, laplace.mode, STEP * scale)
    unit = np.outer(scale, scale)
    return replace(laplace, covariance=unit * positive_inverse(-hessian * unit))


def evidence(
    density: Density,
    laplace: Laplace,
    generator: np.random.Generator,
    *,
    draws: int = 3000,
    enough: float = np.inf,
) -> Evidence:
    """Estimate the marginal likelihood, Z = E_q[p(θ, y)/q(θ)] with q a law of two-piece axes.

    At most ``draws`` proposals are drawn, in rounds of `ROUND`, until ``enough`` are effective. The
    evidence is −inf where no draw is possible.
    """
    proposal = about(density, laplace.mode, laplace.covariance)
    rounds: list[tuple[Floats, Floats, Floats]] = []
    for first in range(0, draws, ROUND):
        points, log_q = proposal.draw(generator, min(ROUND, draws - first))
        values = density.log_prob(points)
        rounds.append((points, values - log_q, values))
        points, log_weights, values = (np.concatenate(part) for part in zip(*rounds, strict=True))
        found = replace(smoothed(points, log_weights), log_densities=values)
        hopeless = found.effective < POOR * len(points) and np.isfinite(enough)
        if found.effective >= enough or hopeless:
            break
    return found


def weighted(points: Floats, log_weights: Floats) -> Evidence:
    """Return the importance sample of draws with these weights, p/q; −inf if none is possible.

    Examples
    --------
    >>> weighted(np.zeros((4, 1)), np.log([1.0, 1.0, 2.0, 0.0 + 1e-300])).log_evidence
    0.0
    """
    weights = np.where(np.isnan(log_weights), -np.inf, log_weights)
    if not np.any(np.isfinite(weights)):
        return Evidence(-np.inf, np.inf, points, weights, 0.0)
    total, count, effective = float(logsumexp(weights)), len(weights), effective_draws(weights)
    error = float(np.sqrt(max(1.0 / effective - 1.0 / count, 0.0)))
    return Evidence(total - float(np.log(count)), error, points, weights, effective)


def smoothed(points: Floats, log_weights: Floats) -> Evidence:
    """Return the importance sample with its largest weights smoothed by a Pareto law.

    A single draw from a tail that the proposal hardly reaches would otherwise dominate the
    estimate.

    References
    ----------
    Vehtari, Simpson, Gelman, Yao and Gabry (2024), https://jmlr.org/papers/v25/19-556.html.
    """
    possible = np.isfinite(log_weights)
    if np.sum(possible) < FEWEST_SMOOTHED:
        return weighted(points, log_weights)
    known = log_weights[possible]
    try:
        normalised, pareto_k = array_stats.psislw(-known)
    except ValueError:  # a tail of equal weights
        return weighted(points, log_weights)
    if not pareto_k > LIGHT:
        return replace(weighted(points, log_weights), pareto_k=float(pareto_k))
    weights = np.full(len(log_weights), -np.inf)
    # all but the tail are unchanged, up to a constant
    weights[possible] = normalised + float(np.median(known - normalised))
    return replace(weighted(points, weights), pareto_k=float(pareto_k))


def effective_draws(log_weights: Floats) -> float:
    """Return the effective number of draws, (Σ w)²/Σ w², of importance weights.

    Examples
    --------
    >>> round(effective_draws(np.log([1.0, 1.0, 0.5])), 2)
    2.78
    """
    return float(np.exp(2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights)))
