"""Sums of products of polynomials: their choice, and evaluation at many points.

A curve has one material and many readings. So each row of points is first contracted over the
material and the causes to coefficients along the swelling (and along powers of φ, the slack
coordinate, which varies with it), and these are summed at each reading. Products of material and
causes are computed once each, from a product with one factor less. Rows are processed in blocks,
one row per lane, so that neither their order nor their number changes a result.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled
from bayesdeg.surrogate.coordinates import SLACK
from bayesdeg.surrogate.scaling import CAUSES, MATERIAL, NAMES

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

N_CHEBYSHEV = 1 + len(MATERIAL)  # swelling and the material; causes enter by powers


@dataclass(frozen=True, eq=False)
class Terms:
    r"""Σₜ aₒₜ T_i(P₀) T_j(P₁) T_k(P₂) T_l(P₃) P₄^m₄ ⋯ P₁₂^m₁₂ for each output o.

    Parameters
    ----------
    orders : array, shape (n_terms, 13)
        Orders of the factors, in the order of ``NAMES``: of Chebyshev polynomials in the swelling
        and the material, powers of the causes.
    coefficients : array, shape (n_outputs, n_terms)
        aₒₜ [–].
    """

    orders: Indices
    coefficients: Floats

    def __post_init__(self) -> None:
        if self.orders.ndim != 2 or self.orders.shape[1] != len(NAMES):
            raise ValueError(f"orders need {len(NAMES)} columns, not shape {self.orders.shape}")
        if self.coefficients.ndim != 2 or self.coefficients.shape[1] != len(self.orders):
            raise ValueError(
                f"{len(self.orders)} terms need as many columns of coefficients, "
                f"not shape {self.coefficients.shape}"
            )

    def output(self, number: int) -> Self:
        """Return one output, without terms that it lacks."""
        there = self.coefficients[number] != 0.0
        return type(self)(self.orders[there], self.coefficients[number : number + 1, there])

    def derivative(self, axis: int) -> Self:
        """Return the derivative by one of the 13 coordinates, as terms.

        dTₙ/dx = 2n (Tₙ₋₁ + Tₙ₋₃ + …), with T₀ counted half.

        Examples
        --------
        >>> cube = np.zeros((1, 13), dtype=np.int64)
        >>> cube[0, 0] = 3  # T₃ = 4x³ − 3x, and 12x² − 3 = 6 T₂ + 3
        >>> slope = Terms(cube, np.ones((1, 1))).derivative(0)
        >>> slope.orders[:, 0].tolist(), slope.coefficients.tolist()
        ([0, 2], [[3.0, 6.0]])
        """
        orders, coefficients = [], []
        for n in range(1, int(self.orders[:, axis].max(initial=0)) + 1):
            these = self.orders[:, axis] == n
            lower = range(n - 1, -1, -2) if axis < N_CHEBYSHEV else (n - 1,)
            for k in lower:
                part = self.orders[these]
                part[:, axis] = k
                factor = n if axis >= N_CHEBYSHEV or k == 0 else 2 * n
                orders.append(part)
                coefficients.append(factor * self.coefficients[:, these])
        if not orders:
            return type(self)(self.orders[:0], self.coefficients[:, :0])
        return type(self)(*_collected(np.vstack(orders), np.hstack(coefficients)))


def stacked(parts: Sequence[Terms]) -> Terms:
    """Return the outputs of several sums as those of one."""
    count = sum(len(part.coefficients) for part in parts)
    widths = [len(part.orders) for part in parts]
    coefficients = np.zeros((count, sum(widths)))
    row = column = 0
    for part, width in zip(parts, widths, strict=True):
        height = len(part.coefficients)
        coefficients[row : row + height, column : column + width] = part.coefficients
        row, column = row + height, column + width
    return Terms(*_collected(np.vstack([part.orders for part in parts]), coefficients))


def _collected(orders: Indices, coefficients: Floats) -> tuple[Indices, Floats]:
    """Return each product once, with the sum of its coefficients."""
    once, where = np.unique(orders, axis=0, return_inverse=True)
    total = np.zeros((len(once), len(coefficients)))
    np.add.at(total, where.ravel(), coefficients.T)
    return once, np.ascontiguousarray(total.T)


Degrees = tuple[int, int, int, int]

# gravity in both directions is not trained: a body has one mount
APART = frozenset(NAMES.index(name) - N_CHEBYSHEV for name in ("gravity_along", "gravity_up"))


@dataclass(frozen=True)
class Family:
    """The degrees of a family of terms, as in ``terms.Terms``.

    Parameters
    ----------
    base : tuple of int
        Degrees in swelling and material without a cause: Σ orderᵢ/degreeᵢ ≤ 1.
    single : tuple of int
        The same for terms with one cause; they decrease with its power.
    powers : tuple of int, length 9
        Highest power of each cause.
    pair, triple : tuple of int, optional
        Degrees in swelling and material for products of two and three causes.
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


TOGETHER = 4  # terms, so that their sum is read and written once
OUTPUTS = 3  # outputs for which products are read once; others one by one
ROW_AXES = tuple(axis for axis in range(1, len(NAMES)) if axis != SLACK)


class Plan(NamedTuple):
    """Summation plan of terms; a tuple, which compiled functions accept.

    Parameters
    ----------
    starts : array, shape (12,)
        Where the orders of each of ``ROW_AXES`` start in the table of factors.
    parents, factors : array, shape (n_products,)
        Each product is an earlier one times a factor of that table; the first is 1.
    slots : array, shape (n_groups,)
        Power of φ × ``n_orders`` + order in the swelling of each ``TOGETHER`` terms that share it.
    products : array, shape (n_groups, 4)
        Products of the terms of each group.
    coefficients : array, shape (n_groups, n_outputs, 4)
        Coefficients of the terms; 0 where groups are padded.
    orders : array, shape (n_powers,)
        Orders in the swelling by power of φ, zero included.
    n_orders, n_powers : int
        Most of them, and powers of φ.
    """

    starts: Indices
    parents: Indices
    factors: Indices
    slots: Indices
    products: Indices
    coefficients: Floats
    orders: Indices
    n_orders: int
    n_powers: int


@lru_cache(maxsize=64)
def plan_of(terms: Terms, active: tuple[bool, ...]) -> Plan:
    """Return the plan for terms without those of neutral causes.

    Parameters
    ----------
    terms : Terms
        Terms to sum.
    active : tuple of bool, length 9
        Whether each of ``CAUSES`` is away from neutral anywhere.
    """
    neutral = [len(NAMES) - len(CAUSES) + k for k, acts in enumerate(active) if not acts]
    kept = ~np.any(terms.orders[:, neutral] > 0, axis=1)
    orders = terms.orders[kept]
    rows = orders[:, ROW_AXES]
    starts = np.concatenate([[0], np.cumsum(rows.max(axis=0, initial=0) + 1)])
    wanted = [tuple(row) for row in rows.tolist()]
    chain = {(0,) * len(ROW_AXES)}
    for product in wanted:  # with all products of fewer factors that lead to it
        while product not in chain:
            chain.add(product)
            product, _, _ = _last_factor(product)
    place = {product: k for k, product in enumerate(sorted(chain))}
    made = [_last_factor(product) for product in place]
    along, slack = orders[:, 0], orders[:, SLACK]
    n_orders, n_powers = int(along.max(initial=0)) + 1, int(slack.max(initial=0)) + 1
    groups = _grouped(
        slack * n_orders + along,
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
        orders=np.array([int(along[slack == m].max(initial=-1)) + 1 for m in range(n_powers)]),
        n_orders=n_orders,
        n_powers=n_powers,
    )


def _grouped(
    slots: Indices, products: Indices, coefficients: Floats
) -> tuple[Indices, Indices, Floats]:
    """Group terms of the same slot, padded with zero terms."""
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


BLOCK = 32  # rows
N_CHEBYSHEV_ROWS = len(MATERIAL)


def evaluate(terms: Terms, rows: Floats, swelling: Floats, phi: Floats) -> Floats:
    """Return sums of terms, shape (n_outputs, n_rows, n_columns).

    Parameters
    ----------
    terms : Terms
        Terms to sum.
    rows : array, shape (13, n_rows)
        Scaled material and causes, in the order of ``NAMES``; swelling and slack are not read.
    swelling : array, shape (n_rows, n_columns)
        Swelling on [−1, 1].
    phi : array, shape (n_rows, n_columns)
        Slack coordinate.
    """
    plan = active_plan(terms, rows, slack=bool(np.any(phi != 0.0)))
    points, (swelling, phi) = rows[list(ROW_AXES)], map(np.ascontiguousarray, (swelling, phi))
    summed: Floats = _sum_terms(points, swelling, phi, plan)
    return summed


def active_plan(terms: Terms, rows: Floats, *, slack: bool) -> Plan:
    """Return the plan for the causes that act in any of the rows (13, n_rows), and the slack."""
    acts = np.any(rows[len(NAMES) - len(CAUSES) :] != 0.0, axis=1)
    acts[SLACK - len(NAMES) + len(CAUSES)] = slack
    return plan_of(terms, tuple(acts.tolist()))


@compiled
def _fill(
    table: Floats, axis_points: Floats, starts: Indices, first: int, count: int
) -> None:  # pragma: no cover - compiled
    """Tabulate the factors of a block of rows; lanes beyond the last row hold zeros."""
    for axis in range(axis_points.shape[0]):
        low, high = starts[axis], starts[axis + 1]
        table[low, :] = 1.0
        if high - low < 2:
            continue
        table[low + 1, :] = 0.0
        for lane in range(count):
            table[low + 1, lane] = axis_points[axis, first + lane]
        for n in range(low + 2, high):
            for lane in range(BLOCK):
                z = table[low + 1, lane]
                if axis < N_CHEBYSHEV_ROWS:
                    table[n, lane] = 2.0 * z * table[n - 1, lane] - table[n - 2, lane]
                else:
                    table[n, lane] = z * table[n - 1, lane]


@compiled
def contract(
    along: Floats, points: Floats, plan: Plan, first: int, count: int
) -> None:  # pragma: no cover - compiled
    """Contract the terms of a block of rows to coefficients along swelling and φ.

    Parameters
    ----------
    along : array, shape (n_orders × n_powers, n_outputs, BLOCK)
        Written.
    points : array, shape (11, n_rows)
        Scaled material and causes, in the order of ``ROW_AXES``.
    plan : Plan
        Plan of the terms.
    first, count : int
        The block's first row, and its number of rows.
    """
    products, slots, coefficients = plan.products, plan.slots, plan.coefficients
    n_outputs = coefficients.shape[1]
    together = n_outputs - n_outputs % OUTPUTS
    table = np.empty((plan.starts[-1], BLOCK))
    _fill(table, points, plan.starts, first, count)
    product = np.empty((plan.parents.shape[0], BLOCK))
    product[0, :] = 1.0
    for f in range(1, plan.parents.shape[0]):
        new, parent, factor = product[f], product[plan.parents[f]], table[plan.factors[f]]
        for lane in range(BLOCK):
            new[lane] = parent[lane] * factor[lane]
    along[:] = 0.0
    sums = along.reshape(-1)
    for t in range(products.shape[0]):
        one, two = product[products[t, 0]], product[products[t, 1]]
        three, four = product[products[t, 2]], product[products[t, 3]]
        for output in range(0, together, OUTPUTS):
            total = sums[(slots[t] * n_outputs + output) * BLOCK :]
            c = coefficients[t, output : output + OUTPUTS]
            a0, a1, a2, a3 = c[0, 0], c[0, 1], c[0, 2], c[0, 3]
            b0, b1, b2, b3 = c[1, 0], c[1, 1], c[1, 2], c[1, 3]
            c0, c1, c2, c3 = c[2, 0], c[2, 1], c[2, 2], c[2, 3]
            for lane in range(BLOCK):
                w, x, y, z = one[lane], two[lane], three[lane], four[lane]
                total[lane] += (a0 * w + a1 * x) + (a2 * y + a3 * z)
                total[BLOCK + lane] += (b0 * w + b1 * x) + (b2 * y + b3 * z)
                total[2 * BLOCK + lane] += (c0 * w + c1 * x) + (c2 * y + c3 * z)
        for output in range(together, n_outputs):
            total = sums[(slots[t] * n_outputs + output) * BLOCK :]
            c = coefficients[t, output]
            a0, a1, a2, a3 = c[0], c[1], c[2], c[3]
            for lane in range(BLOCK):
                pair = a0 * one[lane] + a1 * two[lane]
                total[lane] += pair + (a2 * three[lane] + a3 * four[lane])


@compiled
def _along(
    value: Floats, along: Floats, load: Floats, phi: Floats, work: Floats, n_orders: int
) -> None:  # pragma: no cover - compiled
    """Sum along the swelling and φ at one column of a block of rows."""
    value[:] = 0.0
    power, t0, t1 = work[0], work[1], work[2]
    power[:] = 1.0
    for first in range(0, len(along), n_orders):
        t0[:] = 1.0
        for lane in range(BLOCK):
            t1[lane] = load[lane]
        for slot in range(first, first + n_orders):
            for output in range(len(value)):
                for lane in range(BLOCK):
                    value[output, lane] += along[slot, output, lane] * (t0[lane] * power[lane])
            for lane in range(BLOCK):
                t0[lane], t1[lane] = t1[lane], 2.0 * load[lane] * t1[lane] - t0[lane]
        for lane in range(BLOCK):
            power[lane] *= phi[lane]


@compiled
def _sum_terms(
    points: Floats, loads: Floats, phi: Floats, plan: Plan
) -> Floats:  # pragma: no cover - compiled
    """Sum the terms of a plan, block by block; see ``evaluate``."""
    n_rows, n_columns = loads.shape
    n_outputs = plan.coefficients.shape[1]
    out = np.empty((n_outputs, n_rows, n_columns))
    along = np.empty((plan.n_orders * plan.n_powers, n_outputs, BLOCK))
    value = np.empty((n_outputs, BLOCK))
    work = np.empty((3, BLOCK))
    load, slack = np.zeros(BLOCK), np.zeros(BLOCK)
    for first in range(0, n_rows, BLOCK):
        count = min(BLOCK, n_rows - first)
        contract(along, points, plan, first, count)
        for column in range(n_columns):
            for lane in range(count):
                load[lane] = loads[first + lane, column]
                if plan.n_powers > 1:
                    slack[lane] = phi[first + lane, column]
            _along(value, along, load, slack, work, plan.n_orders)
            for k in range(n_outputs):
                for lane in range(count):
                    out[k, first + lane, column] = value[k, lane]
    return out
