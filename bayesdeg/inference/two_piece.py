"""A proposal about a mode: along each axis a Student law with a width of its own on either side."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, stdtr, stdtrit

from bayesdeg.inference.density import Density, bounds

Floats = NDArray[np.float64]

DEGREES_OF_FREEDOM = 6.0  # 4 to 12 give as many effective draws; fewer miss no tail
LOOKS = np.array([1.5, 3.0, 6.0])  # distances at which widths are measured, in standard deviations
SHORT_LOOKS = np.array([0.02, 0.06, 0.2, 0.6])  # where a bound holds the mode the fall is steeper
NARROWEST, WIDEST = 0.01, 4.0  # of a width, in standard deviations
ROOM = 1e-3  # of a side, below which nothing is looked for there
LEAST = 1e-300  # probability that is still divided by


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

    Parameters
    ----------
    density : Density
        Looked at where each axis is followed for 1.5 to 6 standard deviations, or for less where a
        bound is near.
    mode : array, shape (n,)
        Within the bounds of truncated priors.
    covariance : array, shape (n, n)
        Inverse of the information there.
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
    """Return a width from the drops at several distances, (n,); nan where none was looked at.

    The largest width with which Student's law has dropped as much at any of the looks: a tail that
    is too light misses what weighs most. Where a bound holds the mode, what that look says at which
    the density has dropped most nearly as much as a normal law at 1.5 standard deviations.
    """
    nu = DEGREES_OF_FREEDOM
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scaled = np.sqrt(nu * np.expm1(2.0 * np.maximum(drop, 0.0) / (nu + 1.0)))
        width = np.clip(distance / scaled, NARROWEST, WIDEST)
        off = np.abs(np.log(np.maximum(drop, 0.0) / (0.5 * LOOKS[0] ** 2)))
    usual = np.max(width[-len(LOOKS) :], axis=0)
    best = np.argmin(np.where(np.isnan(off), np.inf, off), axis=0)
    return np.where(held, width[best, np.arange(len(held))], usual)
