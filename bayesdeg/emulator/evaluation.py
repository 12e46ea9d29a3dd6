"""Sums of terms at many points: planned once for the causes that act, then compiled.

A curve has one material and many loads. So each row of points is contracted first over the
material and the causes to coefficients along the load (and along powers of φ, the place of the
slack, which moves with the load), and these are summed at each load. Products of material and
causes are made once each, from a product with one factor less. Rows go through in blocks, one row
a lane, so that neither their order nor their number changes a result.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.emulator.coordinates import SLACK
from bayesdeg.emulator.plan import ROW_AXES, Plan, plan_of
from bayesdeg.emulator.scaling import CAUSES, MATERIAL, NAMES
from bayesdeg.emulator.terms import Terms

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

BLOCK = 32  # rows
N_CHEBYSHEV_ROWS = len(MATERIAL)


def evaluate(
    terms: Terms, rows: Floats, loads: Floats, phi: Floats | None, *, slopes: bool = False
) -> Floats:
    """Return sums of terms, shape (n_outputs, n_rows, n_columns).

    Parameters
    ----------
    terms : Terms
        To sum.
    rows : array, shape (13, n_rows)
        Scaled material and causes, in the order of ``NAMES``; load and slack are not read.
    loads : array, shape (n_rows, n_columns)
        Warped load on [−1, 1].
    phi : array, shape (n_rows, n_columns), optional
        Place of the slack; 0 if not given.
    slopes : bool
        Whether the derivatives of the first output by load and φ follow the outputs.
    """
    plan = active_plan(terms, rows, slack=phi is not None and bool(np.any(phi != 0.0)))
    summed: Floats = _sum_terms(
        rows[list(ROW_AXES)],
        np.ascontiguousarray(loads),
        np.zeros((1, 1)) if phi is None else np.ascontiguousarray(phi),
        plan.starts,
        plan.parents,
        plan.factors,
        plan.products,
        plan.slots,
        plan.coefficients,
        plan.n_orders,
        plan.n_powers if phi is not None else 1,
        slopes,
    )
    return summed


def active_plan(terms: Terms, rows: Floats, *, slack: bool) -> Plan:
    """Return the plan for the causes that act in any of the rows (13, n_rows), and the slack."""
    acts = np.any(rows[len(NAMES) - len(CAUSES) :] != 0.0, axis=1)
    acts[SLACK - len(NAMES) + len(CAUSES)] = slack
    return plan_of(terms, tuple(acts.tolist()))


@njit(cache=True, nogil=True)
def fill(
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


@njit(cache=True, nogil=True)
def contract(
    along: Floats,
    product: Floats,
    table: Floats,
    parents: Indices,
    factors: Indices,
    products: Indices,
    slots: Indices,
    coefficients: Floats,
) -> None:  # pragma: no cover - compiled
    """Contract the terms of a block of rows to coefficients along load and φ."""
    n_outputs = coefficients.shape[1]
    product[0, :] = 1.0
    for f in range(1, parents.shape[0]):
        parent, factor = parents[f], factors[f]
        for lane in range(BLOCK):
            product[f, lane] = product[parent, lane] * table[factor, lane]
    along[:] = 0.0
    for t in range(products.shape[0]):
        slot, f, g, h, k = slots[t], products[t, 0], products[t, 1], products[t, 2], products[t, 3]
        for output in range(n_outputs):
            a, b = coefficients[t, output, 0], coefficients[t, output, 1]
            c, d = coefficients[t, output, 2], coefficients[t, output, 3]
            for lane in range(BLOCK):
                along[slot, output, lane] += (
                    a * product[f, lane]
                    + b * product[g, lane]
                    + c * product[h, lane]
                    + d * product[k, lane]
                )


@njit(cache=True, nogil=True)
def _along(
    value: Floats,
    along: Floats,
    load: Floats,
    phi: Floats,
    work: Floats,
    n_orders: int,
    n_powers: int,
    n_outputs: int,
    slopes: bool,
) -> None:  # pragma: no cover - compiled
    """Sum along the load and φ at one column of a block of rows."""
    value[:] = 0.0
    power, before, t0, t1, d0, d1 = work[0], work[1], work[2], work[3], work[4], work[5]
    power[:] = 1.0
    before[:] = 0.0  # m φ^(m−1)
    for m in range(n_powers):
        t0[:] = 1.0
        d0[:] = 0.0
        d1[:] = 1.0
        for lane in range(BLOCK):
            t1[lane] = load[lane]
        for n in range(n_orders):
            slot = m * n_orders + n
            for output in range(n_outputs):
                for lane in range(BLOCK):
                    value[output, lane] += along[slot, output, lane] * (t0[lane] * power[lane])
            if slopes:
                for lane in range(BLOCK):
                    a = along[slot, 0, lane]
                    value[n_outputs, lane] += a * (d0[lane] * power[lane])
                    value[n_outputs + 1, lane] += a * (t0[lane] * before[lane])
            for lane in range(BLOCK):
                u = 2.0 * load[lane]
                following = u * t1[lane] - t0[lane]
                slope = 2.0 * t1[lane] + u * d1[lane] - d0[lane]
                t0[lane], t1[lane] = t1[lane], following
                d0[lane], d1[lane] = d1[lane], slope
        for lane in range(BLOCK):
            before[lane] = (m + 1) * power[lane]
            power[lane] *= phi[lane]


@njit(cache=True, nogil=True)
def _sum_terms(
    points: Floats,
    loads: Floats,
    phi: Floats,
    starts: Indices,
    parents: Indices,
    factors: Indices,
    products: Indices,
    slots: Indices,
    coefficients: Floats,
    n_orders: int,
    n_powers: int,
    slopes: bool,
) -> Floats:  # pragma: no cover - compiled
    """Sum the terms of a plan, block by block; see ``evaluate``."""
    n_rows, n_columns = loads.shape
    n_outputs = coefficients.shape[1]
    n_values = n_outputs + 2 if slopes else n_outputs
    out = np.empty((n_values, n_rows, n_columns))
    table = np.empty((starts[-1], BLOCK))
    product = np.empty((parents.shape[0], BLOCK))
    along = np.empty((n_orders * n_powers, n_outputs, BLOCK))
    value = np.empty((n_values, BLOCK))
    work = np.empty((6, BLOCK))
    load, slack = np.zeros(BLOCK), np.zeros(BLOCK)
    for first in range(0, n_rows, BLOCK):
        count = min(BLOCK, n_rows - first)
        fill(table, points, starts, first, count)
        contract(along, product, table, parents, factors, products, slots, coefficients)
        for column in range(n_columns):
            for lane in range(count):
                load[lane] = loads[first + lane, column]
                if n_powers > 1:
                    slack[lane] = phi[first + lane, column]
            _along(value, along, load, slack, work, n_orders, n_powers, n_outputs, slopes)
            for k in range(n_values):
                for lane in range(count):
                    out[k, first + lane, column] = value[k, lane]
    return out
