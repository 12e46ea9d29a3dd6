"""How sums of terms are carried out: what terms share, and which of them are left out."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.emulator.coordinates import SLACK
from bayesdeg.emulator.scaling import CAUSES, NAMES
from bayesdeg.emulator.terms import Terms

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

TOGETHER = 4  # terms, so that what they add to is read and written once
ROW_AXES = tuple(axis for axis in range(1, len(NAMES)) if axis != SLACK)


class Plan(NamedTuple):
    """How terms are summed; a tuple, which compiled functions take as it is.

    Parameters
    ----------
    starts : array, shape (12,)
        Where the orders of each of ``ROW_AXES`` start in the table of factors.
    parents, factors : array, shape (n_products,)
        Each product is an earlier one times a factor of that table; the first is 1.
    slots : array, shape (n_groups,)
        Power of φ × ``n_orders`` + order in the load of ``TOGETHER`` terms that share it.
    products : array, shape (n_groups, 4)
        Of the terms of each group.
    coefficients : array, shape (n_groups, n_outputs, 4)
        Of the terms; 0 where a group is not full.
    n_orders, n_powers : int
        Orders in the load and powers of φ, zero included.
    """

    starts: Indices
    parents: Indices
    factors: Indices
    slots: Indices
    products: Indices
    coefficients: Floats
    n_orders: int
    n_powers: int


@lru_cache(maxsize=64)
def plan_of(terms: Terms, active: tuple[bool, ...]) -> Plan:
    """Return the plan for terms of which those with a neutral cause are left out.

    Parameters
    ----------
    terms : Terms
        To sum.
    active : tuple of bool, length 9
        Whether each of ``CAUSES`` is away from neutral anywhere.
    """
    neutral = [len(NAMES) - len(CAUSES) + k for k, acts in enumerate(active) if not acts]
    kept = ~np.any(terms.orders[:, neutral] > 0, axis=1)
    orders = terms.orders[kept]
    rows = orders[:, ROW_AXES]
    starts = np.concatenate([[0], np.cumsum(rows.max(axis=0, initial=0) + 1)])
    wanted = [tuple(row) for row in rows.tolist()]
    chain = {product for row in wanted for product in _chain(row)} | {(0,) * len(ROW_AXES)}
    place = {product: k for k, product in enumerate(sorted(chain))}
    made = [_last_factor(product) for product in place]
    n_orders = int(orders[:, 0].max(initial=0)) + 1
    groups = _grouped(
        orders[:, SLACK] * n_orders + orders[:, 0],
        np.array([place[row] for row in wanted], dtype=np.int64),
        terms.coefficients[:, kept],
    )
    return Plan(
        starts=starts.astype(np.int64),
        parents=np.array([place[parent] for parent, _, _ in made], dtype=np.int64),
        factors=np.array([starts[axis] + order for _, axis, order in made], dtype=np.int64),
        slots=groups[0],
        products=groups[1],
        coefficients=groups[2],
        n_orders=n_orders,
        n_powers=int(orders[:, SLACK].max(initial=0)) + 1,
    )


def _grouped(
    slots: Indices, products: Indices, coefficients: Floats
) -> tuple[Indices, Indices, Floats]:
    """Put terms of the same slot together in groups, filled up with terms of no size."""
    order = np.lexsort((products, slots))
    parts = [
        chosen[k : k + TOGETHER]
        for slot in np.unique(slots)
        for chosen in (order[slots[order] == slot],)
        for k in range(0, len(chosen), TOGETHER)
    ]
    members = np.zeros((len(parts), TOGETHER), dtype=np.int64)
    sizes = np.zeros((len(parts), len(coefficients), TOGETHER))
    for k, part in enumerate(parts):
        members[k, : len(part)] = products[part]
        sizes[k, :, : len(part)] = coefficients[:, part]
    return np.array([slots[part[0]] for part in parts], dtype=np.int64), members, sizes


def _last_factor(orders: tuple[int, ...]) -> tuple[tuple[int, ...], int, int]:
    """Return the product without its last factor, that factor's axis and its order."""
    axis = max((a for a, order in enumerate(orders) if order > 0), default=0)
    return (*orders[:axis], 0, *orders[axis + 1 :]), axis, orders[axis]


def _chain(orders: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return a product and all those that it is made from."""
    chain = [orders]
    while any(chain[-1]):
        chain.append(_last_factor(chain[-1])[0])
    return chain
