"""Compiled evaluation of the emulator, vectorised over rows, with its own exponential.

Rows are processed in blocks, one row per lane. The terms of a block are contracted over material
and causes as in `evaluation`, and at each load over the powers of φ, which leaves Chebyshev
coefficients along the load: of the outputs Y, of the derivatives of the first by load and φ, and of
the errors' logarithms. All are summed with one table of polynomials; what follows is written
without temporary arrays.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled
from bayesdeg.emulator.coordinates import LARGEST_WARPED
from bayesdeg.emulator.terms import BLOCK, Plan, contract, fill

Floats = NDArray[np.float64]


_LOG2E = 1.0 / math.log(2.0)
_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 in two parts, the first with 32 spare bits
_LN2_LOW = 1.90821492927058770002e-10
_ROUNDING = 6755399441055744.0  # 1.5 · 2⁵²: adding it leaves the nearest whole number in low bits
_LARGEST = 700.0  # largest exponent of a 64-bit number
_F = tuple(1.0 / math.factorial(n) for n in range(14))


@compiled
def exponentials(values: Floats) -> None:  # pragma: no cover - compiled
    """Replace values by their exponentials, as vectors: e^x = 2^n e^r with |r| ≤ ln 2/2.

    Values are clipped to ±700. The Taylor series to r¹³ has an error of 4·10⁻¹⁸.
    """
    whole = np.empty(values.size)
    bits = whole.view(np.int64)
    for k in range(values.size):
        x = min(max(values[k], -_LARGEST), _LARGEST)
        shifted = x * _LOG2E + _ROUNDING
        n = shifted - _ROUNDING
        r = (x - n * _LN2_HIGH) - n * _LN2_LOW
        # unrolled: an inner loop would prevent vectorisation
        total = _F[13] * r + _F[12]
        total = (((total * r + _F[11]) * r + _F[10]) * r + _F[9]) * r + _F[8]
        total = (((total * r + _F[7]) * r + _F[6]) * r + _F[5]) * r + _F[4]
        values[k] = (((total * r + _F[3]) * r + _F[2]) * r + _F[1]) * r + _F[0]
        whole[k] = shifted
    for k in range(values.size):
        bits[k] = (bits[k] + 1023) << 52
    for k in range(values.size):
        values[k] *= whole[k]


Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

Y = 3  # outputs: curvature, bend angle, peak stretch
VALUES = 7  # curvature, angle, stretch, slope and the standard errors of the first three
DEGREES = 180.0 / math.pi
_FROM_LOAD = 2.0 / LARGEST_WARPED
_SUMS = Y + 1  # series summed together: the outputs, and one derivative

# Offsets in the working space of a block, one number per row. It is one flat array with fixed
# offsets, so that the compiler sees that they do not overlap and vectorises rows.
_LOAD, _WARPED, _PHI, _KNOWN = 0, BLOCK, 2 * BLOCK, 3 * BLOCK
_LARGEST_LOAD, _STRETCHING, _SLACK = 4 * BLOCK, 5 * BLOCK, 6 * BLOCK
_GIVE, _OFFSET, _BENDING = 7 * BLOCK, 8 * BLOCK, 9 * BLOCK
_OUT = 10 * BLOCK  # Y
_BY_LOAD = _OUT + Y * BLOCK  # derivative of the first
_ERROR = _OUT + _SUMS * BLOCK  # ln of squared relative standard errors
_BY_PHI = _ERROR + Y * BLOCK  # derivative of the first output
_END = _BY_PHI + BLOCK


class Rows(NamedTuple):
    """Quantities constant along the loads of a row.

    Parameters
    ----------
    points : array, shape (11, n_rows)
        Scaled material and causes, in the order of ``ROW_AXES``.
    largest : array, shape (n_rows,)
        p/M up to which the map is defined; below 0 where it is nowhere defined.
    stretching : array, shape (n_rows,)
        e^W.
    slack, give : array, shape (n_rows,)
        Slack strain s of the paper, and its strain over the load e/q.
    offset : array, shape (n_rows,)
        b, the load equivalent of mismatch and weight in the peak stretch.
    bending : array, shape (n_rows,)
        Curvature over bend angle, 1000/(L s) [1/m].
    """

    points: Floats
    largest: Floats
    stretching: Floats
    slack: Floats
    give: Floats
    offset: Floats
    bending: Floats


@compiled
def map_of_rows(
    loads: Floats, rows: Rows, terms: Plan, errors: Plan, mesh_error: float
) -> tuple[Floats, Flags]:  # pragma: no cover - compiled
    """Return outputs with standard errors, (7, n_rows, n_columns), and where they are defined.

    Parameters
    ----------
    loads : array, shape (n_rows, n_columns)
        p/M [–].
    rows : Rows
        Rows of one material each.
    terms, errors : Plan
        Plans of Y, and of ln of the squared relative standard errors.
    mesh_error : float
        Relative standard error added to all of them.
    """
    n_rows, n_columns = loads.shape
    out = np.empty((VALUES, n_rows, n_columns))
    allowed = np.empty((n_rows, n_columns), np.bool_)
    along = np.empty((terms.n_orders * terms.n_powers, Y, BLOCK))
    along_errors = np.empty((errors.n_orders * errors.n_powers, Y, BLOCK))
    series = np.zeros((_even(terms.n_orders), _SUMS, BLOCK))
    by_phi = np.zeros((len(series), _SUMS, BLOCK))
    error_series = np.zeros((_even(errors.n_orders), _SUMS, BLOCK))
    polynomials = np.empty((max(len(series), len(error_series)), BLOCK))
    work = np.zeros(_END + (_SUMS - 1) * BLOCK)
    slack = terms.n_powers > 1 or errors.n_powers > 1
    for first in range(0, n_rows, BLOCK):
        count = min(BLOCK, n_rows - first)
        _take(work, rows, first, count)
        _contracted(along, rows.points, terms, first, count)
        _contracted(along_errors, rows.points, errors, first, count)
        for column in range(n_columns):
            _place(work, loads, allowed, first, count, column)
            if slack or column == 0:
                _series(series, by_phi, along, work[_PHI:_KNOWN], terms)
                _differentiate(series, terms.n_orders)
                _series(error_series, by_phi[:0], along_errors, work[_PHI:_KNOWN], errors)
            _tabulate(polynomials, work[_WARPED:_PHI])
            if slack:
                _sum(work[_BY_PHI:], by_phi, polynomials)
            _sum(work[_OUT:_ERROR], series, polynomials)
            _sum_errors(work[_ERROR:_BY_PHI], error_series, polynomials)
            _finish(work, mesh_error)
            _write(out, work, first, count, column)
    return out, allowed


@compiled
def _even(count: int) -> int:  # pragma: no cover - compiled
    """Return the next even number, at least 2: orders are summed in pairs."""
    return max(2, count + count % 2)


@compiled
def _take(work: Floats, rows: Rows, first: int, count: int) -> None:  # pragma: no cover - compiled
    """Copy row constants to the working space of a block."""
    for lane in range(count):
        row = first + lane
        work[_LARGEST_LOAD + lane], work[_STRETCHING + lane] = (
            rows.largest[row],
            rows.stretching[row],
        )
        work[_SLACK + lane], work[_GIVE + lane] = rows.slack[row], rows.give[row]
        work[_OFFSET + lane], work[_BENDING + lane] = rows.offset[row], rows.bending[row]


@compiled
def _contracted(
    along: Floats, points: Floats, plan: Plan, first: int, count: int
) -> None:  # pragma: no cover - compiled
    """Contract the terms of a block of rows to coefficients along load and φ."""
    table = np.empty((plan.starts[-1], BLOCK))
    product = np.empty((plan.parents.shape[0], BLOCK))
    fill(table, points, plan.starts, first, count)
    contract(
        along,
        product,
        table,
        plan.parents,
        plan.factors,
        plan.products,
        plan.slots,
        plan.coefficients,
    )


@compiled
def _place(
    work: Floats, loads: Floats, allowed: Flags, first: int, count: int, column: int
) -> None:  # pragma: no cover - compiled
    """Write load, warped load on [−1, 1] and φ of a column; the load is nan where refused."""
    for lane in range(count):
        load = loads[first + lane, column]
        answered = 0.0 <= load <= work[_LARGEST_LOAD + lane]
        allowed[first + lane, column] = answered
        work[_KNOWN + lane] = load if answered else math.nan
        work[_LOAD + lane] = load if answered else 0.0
    for lane in range(BLOCK):
        load, slack = work[_LOAD + lane], work[_SLACK + lane]
        work[_WARPED + lane] = load * (_FROM_LOAD * work[_STRETCHING + lane]) - 1.0
        # without slack the strain may be 0 as well
        strain = slack + work[_GIVE + lane] * load
        work[_PHI + lane] = slack / (strain if slack > 0.0 else 1.0)


@compiled
def _series(
    series: Floats, by_phi: Floats, along: Floats, phi: Floats, plan: Plan
) -> None:  # pragma: no cover - compiled
    """Sum the powers of φ to series in the load, with the derivative of the first by φ if asked."""
    n_orders = plan.n_orders
    for n in range(n_orders):
        series[n, :Y] = along[n]
    by_phi[:, 0] = 0.0
    power, before = np.ones(BLOCK), np.empty(BLOCK)
    for m in range(1, plan.n_powers):
        for lane in range(BLOCK):
            before[lane] = m * power[lane]  # m φ^(m−1)
            power[lane] *= phi[lane]
        for n in range(n_orders):
            slot = m * n_orders + n
            for output in range(Y):
                for lane in range(BLOCK):
                    series[n, output, lane] += along[slot, output, lane] * power[lane]
            if n < len(by_phi):
                for lane in range(BLOCK):
                    by_phi[n, 0, lane] += along[slot, 0, lane] * before[lane]


@compiled
def _differentiate(series: Floats, n_orders: int) -> None:  # pragma: no cover - compiled
    """Write the Chebyshev series of the derivative of the first output by the load, as the last.

    c'ₙ₋₁ = c'ₙ₊₁ + 2n cₙ, with c'₀ halved.
    """
    series[n_orders - 1, Y] = 0.0
    for n in range(n_orders - 1, 0, -1):
        half = 0.5 if n == 1 else 1.0
        for lane in range(BLOCK):
            above = series[n + 1, Y, lane] if n + 1 < n_orders else 0.0
            series[n - 1, Y, lane] = half * (above + 2.0 * n * series[n, 0, lane])


@compiled
def _tabulate(polynomials: Floats, load: Floats) -> None:  # pragma: no cover - compiled
    """Tabulate the Chebyshev polynomials of the load."""
    polynomials[0, :] = 1.0
    polynomials[1, :] = load
    table = polynomials.reshape(-1)
    for n in range(2, len(polynomials)):
        three = table[(n - 2) * BLOCK : (n + 1) * BLOCK]
        for lane in range(BLOCK):
            three[2 * BLOCK + lane] = 2.0 * load[lane] * three[BLOCK + lane] - three[lane]


@compiled
def _sum(sums: Floats, series: Floats, polynomials: Floats) -> None:  # pragma: no cover - compiled
    """Write the sums of four series in the load, two orders at a time."""
    sums[: _SUMS * BLOCK] = 0.0
    # a reshape would cost more than the sums of an order
    coefficients, table = series.reshape(-1), polynomials.reshape(-1)
    for n in range(0, len(series), 2):
        c, t = coefficients[n * _SUMS * BLOCK :], table[n * BLOCK :]
        for lane in range(BLOCK):
            even, odd = t[lane], t[BLOCK + lane]
            sums[lane] += c[lane] * even + c[4 * BLOCK + lane] * odd
            sums[BLOCK + lane] += c[BLOCK + lane] * even + c[5 * BLOCK + lane] * odd
            sums[2 * BLOCK + lane] += c[2 * BLOCK + lane] * even + c[6 * BLOCK + lane] * odd
            sums[3 * BLOCK + lane] += c[3 * BLOCK + lane] * even + c[7 * BLOCK + lane] * odd


@compiled
def _sum_errors(
    sums: Floats, series: Floats, polynomials: Floats
) -> None:  # pragma: no cover - compiled
    """Write the sums of the first three of four series in the load, two orders at a time."""
    sums[: Y * BLOCK] = 0.0
    # a reshape would cost more than the sums of an order
    coefficients, table = series.reshape(-1), polynomials.reshape(-1)
    for n in range(0, len(series), 2):
        c, t = coefficients[n * _SUMS * BLOCK :], table[n * BLOCK :]
        for lane in range(BLOCK):
            even, odd = t[lane], t[BLOCK + lane]
            sums[lane] += c[lane] * even + c[4 * BLOCK + lane] * odd
            sums[BLOCK + lane] += c[BLOCK + lane] * even + c[5 * BLOCK + lane] * odd
            sums[2 * BLOCK + lane] += c[2 * BLOCK + lane] * even + c[6 * BLOCK + lane] * odd


@compiled
def _finish(work: Floats, mesh_error: float) -> None:  # pragma: no cover - compiled
    """Convert the sums of a column to outputs, slope and standard errors, in place."""
    exponentials(work[_OUT:_BY_LOAD])
    exponentials(work[_ERROR:_BY_PHI])
    floor = mesh_error * mesh_error
    for lane in range(BLOCK):
        phi, known, stretching = work[_PHI + lane], work[_KNOWN + lane], work[_STRETCHING + lane]
        growth = 1.0 + (work[_WARPED + lane] + 1.0) * work[_BY_LOAD + lane]
        growth -= phi * (1.0 - phi) * work[_BY_PHI + lane]
        curvature = known * stretching * work[_BENDING + lane] * work[_OUT + lane]
        angle = known * stretching * DEGREES * work[_OUT + BLOCK + lane]
        stretch = (known + work[_OFFSET + lane]) * stretching * work[_OUT + 2 * BLOCK + lane]
        work[_OUT + lane] = curvature
        work[_OUT + BLOCK + lane] = angle
        work[_OUT + 2 * BLOCK + lane] = 1.0 + stretch
        work[_BY_LOAD + lane] = curvature * growth
        share, of_angle = work[_ERROR + lane], work[_ERROR + BLOCK + lane]
        of_stretch = work[_ERROR + 2 * BLOCK + lane]
        work[_ERROR + lane] = curvature * math.sqrt(share + floor)
        work[_ERROR + BLOCK + lane] = angle * math.sqrt(of_angle + floor)
        work[_ERROR + 2 * BLOCK + lane] = stretch * math.sqrt(of_stretch + floor)


@compiled
def _write(
    out: Floats, work: Floats, first: int, count: int, column: int
) -> None:  # pragma: no cover - compiled
    """Copy the outputs of a column: the sums, now outputs and slope, and the standard errors."""
    for k in range(VALUES):
        place = work[_OUT + k * BLOCK : _OUT + (k + 1) * BLOCK]
        for lane in range(count):
            out[k, first + lane, column] = place[lane]
