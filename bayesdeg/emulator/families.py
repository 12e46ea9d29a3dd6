"""Which products of polynomials a map is fitted with, their values and their derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bayesdeg.emulator.scaling import NAMES
from bayesdeg.emulator.terms import N_CHEBYSHEV

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Degrees = tuple[int, int, int, int]

# both directions of gravity at once are not trained: one body has one mount
APART = frozenset(NAMES.index(name) - N_CHEBYSHEV for name in ("gravity_along", "gravity_up"))


@dataclass(frozen=True)
class Family:
    """The degrees of a family of terms, as in ``terms.Terms``.

    Parameters
    ----------
    base : tuple of int
        Degrees in load and material without a cause: Σ orderᵢ/degreeᵢ ≤ 1.
    single : tuple of int
        The same for terms with one cause; they shrink as its power grows.
    powers : tuple of int, length 9
        Highest power of each cause.
    pair, triple : tuple of int, optional
        Degrees in load and material for products of two and three causes.
    """

    base: Degrees
    single: Degrees
    powers: tuple[int, ...]
    pair: Degrees | None = None
    triple: Degrees | None = None

    @cached_property
    def orders(self) -> Indices:
        """The orders of all terms, (n_terms, 13).

        Examples
        --------
        >>> Family((1, 1, 0, 0), (0, 0, 0, 0), (1,) + 8 * (0,)).orders[:, :5].tolist()
        [[0, 0, 0, 0, 0], [0, 1, 0, 0, 0], [1, 0, 0, 0, 0], [0, 0, 0, 0, 1]]
        """
        blocks = [_with_causes(self.base, ())]
        for cause, highest in enumerate(self.powers):
            for power in range(1, highest + 1):
                share = 1.0 - (power - 1) / (highest + 0.5)
                degrees = [max(1, round(d * share)) if d else 0 for d in self.single]
                blocks.append(_with_causes(degrees, ((cause, power),)))
        acting = [cause for cause, highest in enumerate(self.powers) if highest > 0]
        for count, degrees_of in ((2, self.pair), (3, self.triple)):
            if degrees_of is None:
                continue
            for group in combinations(acting, count):
                if not set(group) >= APART:
                    blocks.append(_with_causes(degrees_of, tuple((c, 1) for c in group)))
        return np.vstack(blocks)


def _with_causes(degrees: Sequence[int], causes: tuple[tuple[int, int], ...]) -> Indices:
    base = total_degree_orders(tuple(degrees))
    out = np.zeros((len(base), len(NAMES)), dtype=np.int64)
    out[:, :N_CHEBYSHEV] = base
    for cause, power in causes:
        out[:, N_CHEBYSHEV + cause] = power
    return out


def total_degree_orders(degrees: tuple[int, ...]) -> Indices:
    """Return all orders n with Σ nᵢ/degreeᵢ ≤ 1, shape (n_terms, n_inputs); 0 keeps an input out.

    Examples
    --------
    >>> total_degree_orders((1, 2)).tolist()
    [[0, 0], [0, 1], [0, 2], [1, 0]]
    """
    grids = np.meshgrid(*(np.arange(d + 1) for d in degrees), indexing="ij")
    orders = np.stack([g.ravel() for g in grids], axis=1).astype(np.int64)
    within: Indices = orders[np.sum(orders / np.maximum(degrees, 1), axis=1) <= 1.0 + 1e-9]
    return within


def features(orders: Indices, points: Floats) -> Floats:
    """Return all terms at points (n, 13), shape (n, n_terms)."""
    out = np.ones((len(points), len(orders)))
    for axis in np.flatnonzero(orders.any(axis=0)):
        held = orders[:, axis] > 0
        out[:, held] *= _tables(points, int(axis), orders)[0][:, orders[held, axis]]
    return out


def feature_gradients(orders: Indices, points: Floats) -> Floats:
    """Return derivatives of all terms by the points, shape (n, 13, n_terms)."""
    tables = [_tables(points, axis, orders) for axis in range(orders.shape[1])]
    out = np.zeros((len(points), orders.shape[1], len(orders)))
    for axis, (_, slopes) in enumerate(tables):
        held = orders[:, axis] > 0
        product = slopes[:, orders[held, axis]]
        for other, (values, _) in enumerate(tables):
            if other != axis and orders[held, other].any():
                product = product * values[:, orders[held, other]]
        out[:, axis, held] = product
    return out


def _tables(points: Floats, axis: int, orders: Indices) -> tuple[Floats, Floats]:
    """Return values and derivatives of one coordinate's polynomials, (n, highest order + 1)."""
    highest, x = int(orders[:, axis].max()), points[:, axis]
    degrees = np.arange(highest + 1)
    values, slopes = np.ones((len(x), highest + 1)), np.zeros((len(x), highest + 1))
    if axis >= N_CHEBYSHEV:
        values[:] = x[:, None] ** degrees
        slopes[:, 1:] = degrees[1:] * values[:, :-1]
    elif highest > 0:
        values[:] = np.polynomial.chebyshev.chebvander(x, highest)
        changes = np.polynomial.chebyshev.chebder(np.eye(highest + 1), axis=0)
        slopes[:] = np.polynomial.chebyshev.chebval(x, changes).T
    return values, slopes
