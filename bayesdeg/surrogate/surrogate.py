"""The trained map: polynomials in warped load, material and causes, with their own error.

With q = p/M the load, s the linear scale, L the length as moulded and W the warp by the causes,

    change of curvature     κ s L = q exp(W + Y₀)
    change of bend angle          = q exp(W + Y₁)
    peak stretch            λ − 1 = (q + b) exp(W + Y₂)
    other strains               ε = (q + b) exp(W + Yₖ)
    half of the cavity's change ΔV = s³ L³ q exp(W + Yₖ)
    half of the tip's force      F = s² L² M q exp(W + Yₖ)

where b is the load equivalent of mismatch and weight of the body, and each Y a sum of ``Terms``. So
curvature is zero at zero pressure, smooth in it, and has exact derivatives. L stays that of the
nominal actuator where dimensions depart from it, see `bayesdeg.surrogate.departure`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.demand import MEASURES, demanded_strain, needed
from bayesdeg.actuator.inputs import (
    Asked,
    Further,
    Inputs,
    Prediction,
    relative_to_reference,
)
from bayesdeg.actuator.status import Status
from bayesdeg.compiled import compiled
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.coordinates import (
    GIVE,
    GRAVITY_STRAIN,
    LARGEST_WARPED,
    SLACK,
    STRAIN,
    WARP,
    Batch,
    coordinates,
    inside,
)
from bayesdeg.surrogate.departure import Change, Departure
from bayesdeg.surrogate.scaling import (
    GROUPS,
    LOAD,
    MATERIAL,
    NAMES,
    ONE,
    SECOND,
    Group,
    TrainingRange,
    Units,
    modulus_of,
)
from bayesdeg.surrogate.terms import (
    BLOCK,
    ROW_AXES,
    Plan,
    Terms,
    active_plan,
    contract,
    evaluate,
    stacked,
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LIMIT = "limit"


def describe(
    batch: Batch,
    span: TrainingRange,
    limit: Floats,
    units: Units = ONE,
) -> dict[str, str]:
    """Return a sentence for each group that leaves its range, and for the load.

    ``limit``, shape (n_rows,), is p/M up to which curves are smooth; ``units`` are those of all.
    """
    out = ~inside(batch.groups[1:].T, span).T
    # values of a group count once per load of its row
    columns = batch.loads.shape[1]
    found = {
        group.name: _words_of_group(group, values, refused, columns, units)
        for group, values, refused in zip(span.groups, batch.groups[1:], out, strict=True)
        if np.any(refused)
    }
    loads, limit = units.load * batch.loads, units.load * limit
    largest = np.where(batch.within, units.load * batch.largest_load(span), np.inf)
    largest = np.broadcast_to(largest[:, None], loads.shape)
    over = ~((loads >= 0.0) & (loads <= largest))
    if np.any(over):
        words, known = "is not a number", ~np.isnan(loads[over])
        if np.any(known):
            refused, most = loads[over], largest[over]
            beyond = np.where(known, np.maximum(-refused, refused - most), -np.inf)
            worst = int(np.argmax(beyond))
            up_to = f" to {most[worst]:.4g} for that material" if np.isfinite(most[worst]) else ""
            words = f"reaches {refused[worst]:.4g}, trained from 0{up_to}"
        found[LOAD] = f"p/M {words}; {int(over.sum())} of {loads.size} values"
    past = batch.within[:, None] & ~over & (loads > limit[:, None])
    if np.any(past):
        at = np.unravel_index(int(np.argmax(np.where(past, loads, -1.0))), loads.shape)
        found[LIMIT] = (
            f"p/M reaches {loads[at]:.4g}, but the curve of that material is smooth only up to "
            f"{limit[at[0]]:.4g}; {int(past.sum())} of {loads.size} values"
        )
    return found


def _words_of_group(
    group: Group, values: Floats, refused: Flags, columns: int, units: Units
) -> str:
    """Say how far a group leaves its range, in the user's units."""
    if group.name == "log_paper":
        shift = float(np.log(units.paper))
        group = replace(group, low=group.low + shift, high=group.high + shift)
        values = values + shift
        if units.layer is not None:
            group = replace(group, meaning="ln(C1 of the constraint layer/M)", unit="–")
    unit = "" if group.unit == "–" else f" {group.unit}"
    count = f"{columns * int(refused.sum())} of {columns * len(values)} values"
    trained = f"trained from {group.low:.4g} to {group.high:.4g}{unit}; {count}"
    known = values[refused & ~np.isnan(values)]
    if group.name == "paper_slack" and np.any((known >= group.low) & (known <= group.high)):
        return f"{group.meaning} is combined with a mismatch of the paper, {trained}"
    if len(known) == 0:
        return f"{group.meaning} is not a number where the material is impossible, {trained}"
    beyond = np.maximum(group.low - known, known - group.high)
    worst = known[int(np.argmax(beyond))]
    return f"{group.meaning} reaches {worst:.4g}{unit}, {trained}"


def curvature_gradient(
    inputs: Inputs, batch: Batch, allowed: Flags, terms: Terms, span: TrainingRange
) -> dict[str, Floats]:
    """Return derivatives of κ L by every given field [mm/m over its unit], L as moulded.

    The inputs have no reference pressure, and their batch one row per point. Derivatives are nan
    where the map is not ``allowed``, (n_rows, 1). The first output of the terms is Y₀.
    """
    answered = allowed[:, 0]
    middle = 0.5 * (span.lower + span.upper)
    groups = np.where(answered, batch.groups, np.concatenate([[0.0], middle])[:, None])
    groups[0] = np.where(answered, batch.loads[:, 0], 0.0)
    scale = np.broadcast_to(inputs.linear_scale, batch.shape).ravel()
    at = coordinates(groups.T)
    points = np.ascontiguousarray(at.points.T)
    y = evaluate(_with_gradient(terms), points, points[0][:, None], points[SLACK][:, None])[:, :, 0]
    gain = np.exp(y[0] + at.warp)
    change = groups[0] * gain  # κ s L
    by_group = np.einsum("an,nag->gn", y[1:], at.jacobian) + at.warp_gradient.T
    by_group *= change
    by_group[NAMES.index(LOAD)] += gain
    fields = _rates(inputs, batch.shape, groups)
    gradient = {}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # where it is refused
        for name, by in fields.items():
            value = sum(by_group[NAMES.index(group)] * rate for group, rate in by.items())
            if name == "linear_scale":
                value = value - change / scale
            value = np.where(answered, 1e3 * value / scale, np.nan)
            gradient[name] = value.reshape(batch.shape)
    return gradient


@lru_cache(maxsize=8)
def _of_outputs(terms: Terms, places: tuple[int, ...]) -> Terms:
    """Return some of the outputs."""
    return Terms(terms.orders, terms.coefficients[list(places)])


@lru_cache(maxsize=8)
def _along_load(terms: Terms) -> Terms:
    """Return the first output and its derivatives by warped load and place of the slack."""
    first = terms.output(0)
    return stacked([first, first.derivative(0), first.derivative(SLACK)])


@lru_cache(maxsize=8)
def _with_gradient(terms: Terms) -> Terms:
    """Return Y₀ and its derivatives by the 13 coordinates, as 14 outputs."""
    first = terms.output(0)
    return stacked([first, *(first.derivative(axis) for axis in range(len(NAMES)))])


def _rates(
    inputs: Inputs, shape: tuple[int, ...], groups: Floats
) -> dict[str, Mapping[str, Floats]]:
    """Return the derivatives of the groups by each given field of the inputs."""

    def spread(value: Floats) -> Floats:
        return np.broadcast_to(value, shape).ravel()

    at = dict(zip(NAMES, groups, strict=True))
    c1, c3, scale = spread(inputs.c1), spread(inputs.c3), spread(inputs.linear_scale)
    second = np.zeros(1) if inputs.second_invariant is None else spread(inputs.second_invariant)
    modulus = c1 + SECOND * second
    one = np.ones(())
    with np.errstate(divide="ignore", invalid="ignore"):
        # by M, with all else fixed
        ratios = (LOAD, "second_invariant", "gravity_along", "gravity_up")
        logarithms = [group.name for group in MATERIAL if group.name.startswith("log_")]
        by_modulus = (
            {name: -at[name] / modulus for name in ratios}
            | dict.fromkeys(logarithms, -1.0 / modulus)
            | {"softening": -0.5 * at["softening"] / modulus}
        )
        weight = 1e-6 * scale / modulus
        rates: dict[str, Mapping[str, Floats]] = {
            "pressure": {LOAD: 1e-3 / modulus},
            "c1": by_modulus,
            "c2": {"softening": 1.0 / np.sqrt(3.0 * c3 * modulus)},
            "c3": {"softening": -0.5 * at["softening"] / c3, "log_stiffening": 1.0 / c3},
            "linear_scale": {
                "log_paper": -1.0 / scale,
                "paper_thickness": -at["paper_thickness"] / scale,
                "gravity_along": at["gravity_along"] / scale,
                "gravity_up": at["gravity_up"] / scale,
                "erosion": -at["erosion"] / scale,
            },
            "paper_stiffness": {"log_paper": 1.0 / spread(inputs.paper_stiffness)},
            "second_invariant": {name: SECOND * rate for name, rate in by_modulus.items()}
            | {"second_invariant": SECOND * (by_modulus["second_invariant"] + 1.0 / modulus)},
            "skin": {"skin": one},
            "paper_thickness": {"paper_thickness": 1.0 / scale},
            "paper_slack": {"paper_slack": one},
            "paper_mismatch": {"paper_mismatch": one},
            "weight_along": {"gravity_along": weight},
            "weight_up": {"gravity_up": weight},
            "wall_factor": {"wall_factor": one},
            "erosion": {"erosion": 1.0 / scale},
        }
    return {name: by for name, by in rates.items() if getattr(inputs, name) is not None}


# ---- the same, compiled: vectorised over rows, with its own exponential
#
# Rows are processed in blocks, one row per lane. The terms of a block are contracted over material
# and causes as in `terms`, and at each load over the powers of φ, which leaves Chebyshev
# coefficients along the load: of the outputs Y, of the derivatives of the first by load and φ, and
# of the errors' logarithms. All are summed with one table of polynomials; what follows is written
# without temporary arrays.

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
        contract(along, rows.points, terms, first, count)
        contract(along_errors, rows.points, errors, first, count)
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


# ---- the map

OUTPUTS = ("curvature", "bend_angle", "peak_stretch")
_MISMATCH, _ALONG, _UP = (
    NAMES.index(name) for name in ("paper_mismatch", "gravity_along", "gravity_up")
)
OUTSIDE_BY = 0.01
"""Distance outside the range, as a share of it or in ln load, at which a density has fallen by one
half: small relative to posteriors, large relative to derivative steps."""
STRAIN_MESH_ERROR = 0.025
"""Relative standard error of strain measures other than the peak stretch, dominated by corners: the
change between meshes of 2042 and 4616 elements (`benchmarks/rupture_measures.py`)."""
LIMIT_MARGIN = 2.0  # margin from a limit, in standard errors
_TABLES = ("terms", "error", "limit", "strains", "strain_error")
FURTHER: tuple[Asked, ...] = ("cavity_volume", "tip_force")
_NUMBERS = ("length", "mesh_error")


def stretch_offset(groups: Floats) -> Floats:
    """Return the load b equivalent to mismatch and weight in the peak stretch [–].

    Parameters
    ----------
    groups : array, shape (13, …)
        Groups in the order of ``NAMES``.
    """
    weight = GRAVITY_STRAIN * np.hypot(groups[_ALONG], groups[_UP])
    offset: Floats = np.abs(groups[_MISMATCH]) + weight
    return offset


def _constants() -> Floats:
    """Return the constants of the coordinates: terms are meaningless with different ones."""
    warp = [WARP.get(group.name, (0.0, 0.0)) for group in GROUPS]
    return np.concatenate([np.ravel(warp), [LARGEST_WARPED, STRAIN, GIVE, GRAVITY_STRAIN]])


@dataclass(frozen=True)
class FurtherTerms:
    """Trained terms of an output besides the shape.

    Parameters
    ----------
    terms : Terms
        Y of the output.
    error : Terms
        ln of its squared relative standard error.
    """

    terms: Terms
    error: Terms


@dataclass(frozen=True)
class LimitPressure:
    """Pressures up to which curves are smooth, before they balloon.

    Parameters
    ----------
    pressure, sd : array
        Best estimate and standard error [kPa]; nan outside the range of the groups.
    trained : array of bool
        Whether the estimate lies within the trained loads; outside it only shows that it lies
        beyond.
    """

    pressure: Floats
    sd: Floats
    trained: Flags


@dataclass(frozen=True)
class Surrogate:
    """A forward map trained on finite element curves.

    Parameters
    ----------
    length : float
        Length of the actuator as moulded [mm].
    span : TrainingRange
        Range of load and groups.
    terms : Terms
        Y of each of ``OUTPUTS``.
    error : Terms
        ln of the squared relative standard errors of ``OUTPUTS``; the peak stretch's is relative
        to the stretch less 1.
    limit : Terms
        ln of the warped load x = q e^W up to which curves are smooth, and its standard error; the
        slack enters by its range, the load not at all. Loads are refused within ``LIMIT_MARGIN``
        standard errors of it.
    strains, strain_error : Terms
        Y of each of ``MEASURES`` of `bayesdeg.actuator.demand`, and ln of their squared relative
        standard errors.
    mesh_error : float
        Relative standard error of the finite element model itself, in all outputs [–].
    record : str
        How it was trained: design, code version, accuracy (JSON).
    units : Units
        Units of p/M and Et/(M s) in the span and the terms.
    further : mapping of str to FurtherTerms
        Terms of outputs besides the shape.
    departure : Departure, optional
        Departure with dimensions that may differ from the nominal ones.
    """

    length: float
    span: TrainingRange
    terms: Terms
    error: Terms
    limit: Terms
    strains: Terms
    strain_error: Terms
    mesh_error: float
    record: str
    units: Units = ONE
    further: Mapping[Asked, FurtherTerms] = field(default_factory=dict, hash=False)
    departure: Departure | None = None

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction; outside the training range it is nan with a status."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        inputs = self.units.inputs(inputs)
        batch, away = self._batch(inputs)
        return self._answer(inputs, batch, self._largest(batch, away), away)

    def _batch(self, inputs: Inputs) -> tuple[Batch, Floats | None]:
        """Return the rows of inputs, and the deviations of their dimensions; None without any.

        Raises
        ------
        BayesdegError
            If an untrained dimension is given.
        """
        given = inputs.dimensions or {}
        known = () if self.departure is None else self.departure.names
        unknown = [name for name in given if name not in known]
        if unknown:
            raise BayesdegError(f"the emulator was not trained for other values of {unknown[0]}")
        if self.departure is None or not given:
            return Batch.of(inputs, self.span), None
        shape = np.broadcast_shapes(np.shape(inputs.c1), *map(np.shape, given.values()))
        batch = Batch.of(replace(inputs, c1=np.broadcast_to(inputs.c1, shape)), self.span)
        away = self.departure.away(given, batch.row_shape)
        return replace(batch, within=batch.within & self.departure.inside(away)), away

    def continued(self, inputs: Inputs) -> Prediction:
        """Return the prediction; outside the training range, an extrapolation with its excess.

        Groups outside are clipped to their range, and curves continue from the largest load along
        their tangent in ln load. The excess is the distance in units of `OUTSIDE_BY`: hundredths of
        a group's range, and of ln load. It is nan for impossible materials.
        """
        if inputs.reference_pressure is not None:
            return relative_to_reference(self.continued, inputs)
        inputs = self.units.inputs(inputs)
        batch, away = self._batch(inputs)
        inner, distance = batch.brought_inside(self.span)
        if away is not None and self.departure is not None:
            off_by = away - (away := np.clip(away, *self.departure.bounds))
            distance = np.sqrt(distance**2 + np.sum(off_by**2, axis=0))
        limits = self._largest(inner, away)
        asked, most = inner.loads, limits[:, None]
        off = ~np.all((asked >= 0.0) & (asked <= most), axis=1) | (distance > 0.0)
        if not off.any():
            return self._answer(inputs, inner, limits, away)
        loads, asked, most = asked.copy(), asked[off], most[off]
        loads[off] = np.clip(asked, 0.0, np.maximum(most, 0.0))
        found = self._answer(inputs, replace(inner, loads=loads), limits, away)
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.log(np.maximum(asked / most, 1.0))
            below = np.maximum(-asked / most, 0.0)
        excess = np.sqrt(distance[off, None] ** 2 + above**2 + below**2) / OUTSIDE_BY
        return _continued(found, off, above, excess)

    def _answer(
        self, inputs: Inputs, batch: Batch, largest: Floats, away: Floats | None
    ) -> Prediction:
        slack, give = batch.slack
        scale = np.broadcast_to(inputs.linear_scale, batch.row_shape).ravel()
        rows = Rows(
            points=batch.scaled[list(ROW_AXES)],
            largest=largest,
            stretching=np.exp(batch.warp[:, 0]),
            slack=slack,
            give=give,
            offset=stretch_offset(batch.groups),
            bending=1e3 / self.length / scale,
        )
        is_slack = bool(np.any(slack > 0.0))
        values, allowed = map_of_rows(
            np.require(batch.loads, requirements=("C", "W")),  # one layout: compiled once
            rows,
            active_plan(self.terms, batch.scaled, slack=is_slack),
            active_plan(self.error, batch.scaled, slack=is_slack),
            self.mesh_error,
        )
        if away is not None:
            values = self._change((0, 1, 2), batch, rows, allowed, away).applied(values)
        curvature, angle, stretch, slope, *sds = values.reshape(len(values), *batch.shape)
        demand, demand_sd = stretch, sds[2]
        if inputs.criterion != "principal_stretch":
            demand, demand_sd = self._demand(inputs, batch, rows, allowed, away)
        return Prediction(
            curvature=curvature,
            bend_angle=angle,
            peak_stretch=demand,
            slope=slope,
            sd=sds[0],
            bend_angle_sd=sds[1],
            peak_stretch_sd=demand_sd,
            status=np.where(allowed, 0, int(Status.OUTSIDE_TRAINING)).reshape(batch.shape),
            excess=np.zeros(batch.shape),
            further=self._further(inputs, batch, rows, allowed, away),
        )

    def _change(
        self, places: tuple[int, ...], batch: Batch, rows: Rows, allowed: Flags, away: Floats
    ) -> Change:
        """Return the change of outputs with dimensions; the optional outputs come last.

        They are numbered as ``OUTPUTS``, ``MEASURES`` and the optional outputs.
        """
        assert self.departure is not None
        loads, warped = _warped(batch, rows, allowed)
        return self.departure.change(places, batch, away, warped, loads)

    def _further(
        self, inputs: Inputs, batch: Batch, rows: Rows, allowed: Flags, away: Floats | None
    ) -> Further | None:
        """Return the requested output besides the shape; None if not trained."""
        if inputs.asked not in self.further:
            return None
        trained, (loads, warped) = self.further[inputs.asked], _warped(batch, rows, allowed)
        phi = batch.phi(loads)
        y, by_load, by_phi = evaluate(_along_load(trained.terms), batch.scaled, warped, phi)
        log_error = evaluate(trained.error, batch.scaled, warped, phi)[0]
        growth = 1.0 + (warped + 1.0) * by_load - phi * (1.0 - phi) * by_phi
        known = np.where(allowed, loads * rows.stretching[:, None], np.nan)
        if away is not None and self.departure is not None:
            at = len(OUTPUTS) + len(MEASURES) + self.departure.further.index(inputs.asked)
            change = self._change((at,), batch, rows, allowed, away)
            y, growth = y + np.log(change.factor[0]), growth + change.growth
            log_error = np.log(np.exp(log_error) + change.variance[0])
        length = self.length * inputs.linear_scale
        size = 2e-3 * length**3  # of both halves [ml or N]
        if inputs.asked == "tip_force":
            size = 2.0 * length**2 * modulus_of(inputs)
        value = np.asarray(size * (known * np.exp(y)).reshape(batch.shape))
        sd = value * np.sqrt(np.exp(log_error) + self.mesh_error**2).reshape(batch.shape)
        return Further(value, value * growth.reshape(batch.shape), sd)

    def _demand(
        self, inputs: Inputs, batch: Batch, rows: Rows, allowed: Flags, away: Floats | None
    ) -> tuple[Floats, Floats]:
        """Return the equally demanding uniaxial stretch by a criterion, and its error."""
        loads, warped = _warped(batch, rows, allowed)
        places, phi = needed(inputs.criterion), batch.phi(loads)
        y, log_error = (
            evaluate(_of_outputs(terms, places), batch.scaled, warped, phi)
            for terms in (self.strains, self.strain_error)
        )
        if away is not None:
            at = tuple(len(OUTPUTS) + place for place in places)
            change = self._change(at, batch, rows, allowed, away)
            y = y + np.log(change.factor)
            log_error = np.log(np.exp(log_error) + change.variance)
        base = np.where(allowed, (loads + rows.offset[:, None]) * rows.stretching[:, None], np.nan)
        strain = demanded_strain(inputs, (base * np.exp(y)).reshape(-1, *batch.shape))
        variance = np.exp(log_error).mean(axis=0).reshape(batch.shape) + STRAIN_MESH_ERROR**2
        return 1.0 + strain, strain * np.sqrt(variance)

    def without_mesh_error(self) -> Self:
        """Return the same map with interpolation errors only, relative to its own mesh."""
        return replace(self, mesh_error=0.0)

    def gradient(self, inputs: Inputs) -> dict[str, Floats]:
        """Return the derivatives of the curvature by every given field of the inputs.

        Returns
        -------
        dict of array
            By the names of ``Inputs``, each in the broadcast shape of the inputs: 1/m over the
            field's unit; nan where the prediction is refused.

        Raises
        ------
        BayesdegError
            If dimensions are given.
        """
        if inputs.reference_pressure is not None:
            at = replace(inputs, reference_pressure=None)
            zero = self.gradient(replace(at, pressure=inputs.reference_pressure))
            by = self.gradient(at)
            # nan at either pressure stays nan
            return {name: value - zero[name] for name, value in by.items()} | {
                "pressure": by["pressure"] + 0.0 * zero["pressure"],
                "reference_pressure": 0.0 * by["pressure"] - zero["pressure"],
            }
        if inputs.dimensions:
            raise BayesdegError("derivatives are not available with changed dimensions")
        inputs = self.units.inputs(inputs)
        batch = Batch.of(inputs, self.span, one_by_one=True)
        allowed = (batch.loads >= 0.0) & (batch.loads <= self._largest(batch)[:, None])
        gradient = curvature_gradient(inputs, batch, allowed, self.terms, self.span)
        by_given = self.units.by_given(gradient, inputs)
        return {name: value / self.length for name, value in by_given.items()}

    def limit_pressure(self, inputs: Inputs) -> LimitPressure:
        """Return the pressure up to which the curve of each material is smooth, with its error."""
        inputs = self.units.inputs(inputs)
        batch, away = self._batch(inputs)
        shape = (*batch.shape[:-1], 1) if batch.loads.shape[-1:] != (1,) else batch.shape
        modulus = np.broadcast_to(modulus_of(inputs), shape).ravel()
        load, error = self._limit(batch, away)
        largest = batch.largest_load(self.span)
        pressure = np.where(batch.within, 1e3 * modulus * load * self.units.load, np.nan)
        trained: Flags = batch.within & (load <= largest)
        return LimitPressure(
            pressure.reshape(shape), (error * pressure).reshape(shape), trained.reshape(shape)
        )

    def refusals(self, inputs: Inputs) -> dict[str, str]:
        """Say in words, by name, what lies outside the training range and by how much.

        The names are those of the groups, "load" for the largest load trained, and "limit" for
        loads at which the curve is no longer smooth. Empty if nothing is refused.
        """
        batch, away = self._batch(self.units.inputs(inputs))
        found = describe(batch, self.span, self._limit_load(batch, away), self.units)
        if inputs.reference_pressure is None:
            return found
        at = replace(inputs, pressure=inputs.reference_pressure, reference_pressure=None)
        zero = {n: f"at the reference pressure: {text}" for n, text in self.refusals(at).items()}
        return zero | found

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything as plain arrays, for a npz file."""
        arrays: dict[str, NDArray[np.generic]] = {
            "load": np.array(self.span.load),
            "share": np.array(self.span.share),
            "groups": np.array([group.name for group in self.span.groups]),
            "ranges": np.array([(g.low, g.high, g.neutral) for g in self.span.groups]),
            "constants": _constants(),
            "record": np.array(self.record),
        }
        if self.units != ONE:  # earlier files lack them
            layer = () if self.units.layer is None else (self.units.layer,)
            arrays["units"] = np.array([self.units.load, self.units.paper, *layer])
        tables: dict[str, Terms] = {name: getattr(self, name) for name in _TABLES}
        for asked, further in self.further.items():
            tables |= {asked: further.terms, f"{asked}_error": further.error}
        for name, table in tables.items():
            arrays |= {f"{name}_orders": table.orders, f"{name}_coefficients": table.coefficients}
        if self.departure is not None:
            arrays |= self.departure.to_arrays()
        return arrays | {name: np.array(getattr(self, name)) for name in _NUMBERS}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> Self:
        """Return the surrogate that ``to_arrays`` described.

        Raises
        ------
        ValueError
            If it was made with different groups or coordinates.
        """
        names = tuple(str(name) for name in arrays["groups"])
        ranges = np.asarray(arrays["ranges"], dtype=np.float64)
        constants = np.asarray(arrays["constants"], dtype=np.float64)
        known = np.array([(g.low, g.high, g.neutral) for g in GROUPS])
        ordered = [known[:, 0], ranges[:, 0], ranges[:, 1], known[:, 1]]
        are_parts = all(np.all(low <= high) for low, high in pairwise(ordered))
        are_parts = are_parts and np.array_equal(ranges[:, 2], known[:, 2])
        if names != tuple(group.name for group in GROUPS) or not are_parts:
            raise ValueError("the emulator was trained with different groups than now")
        if not np.array_equal(constants, _constants()):
            raise ValueError("the emulator was trained in different coordinates than now")
        # earlier files lack outputs besides the shape
        asked = [name for name in FURTHER if f"{name}_orders" in arrays]
        tables = {
            name: Terms(
                arrays[f"{name}_orders"].astype(np.int64),
                arrays[f"{name}_coefficients"].astype(np.float64),
            )
            for name in (*_TABLES, *asked, *(f"{name}_error" for name in asked))
        }
        load, paper, *layer = (float(unit) for unit in arrays.get("units", np.ones(2)))
        return cls(
            length=float(arrays["length"]),
            span=TrainingRange(
                load=float(arrays["load"]),
                groups=tuple(
                    replace(group, low=float(low), high=float(high))
                    for group, (low, high, _) in zip(GROUPS, ranges, strict=True)
                ),
                # earlier files of the whole range lack it
                share=float(arrays.get("share", np.ones(()))),
            ),
            mesh_error=float(arrays["mesh_error"]),
            record=str(arrays["record"]),
            terms=tables["terms"],
            error=tables["error"],
            limit=tables["limit"],
            strains=tables["strains"],
            strain_error=tables["strain_error"],
            units=Units(load, paper, *layer),
            further={name: FurtherTerms(tables[name], tables[f"{name}_error"]) for name in asked},
            departure=Departure.from_arrays(arrays),
        )

    def _limit(self, batch: Batch, away: Floats | None) -> tuple[Floats, Floats]:
        """Return p/M up to which curves are smooth, and its relative standard error, (n_rows,)."""
        slack = batch.scaled[SLACK][:, None]
        log_limit, error = evaluate(self.limit, batch.scaled, np.zeros_like(slack), slack)[:, :, 0]
        if away is not None and self.departure is not None:
            change, more = self.departure.limit(away)
            log_limit, error = log_limit + change, np.hypot(error, more)
        return np.exp(log_limit - batch.warp[:, 0]), error

    def _limit_load(self, batch: Batch, away: Floats | None = None) -> Floats:
        """Return p/M up to which curves are emulated, (n_rows,)."""
        load, error = self._limit(batch, away)
        safe: Floats = load * np.exp(-LIMIT_MARGIN * error)
        return safe

    def _largest(self, batch: Batch, away: Floats | None = None) -> Floats:
        """Return p/M up to which the map is defined, (n_rows,); −1 in rows outside."""
        largest = np.minimum(self._limit_load(batch, away), batch.largest_load(self.span))
        return np.where(batch.within, largest, -1.0)


def _warped(batch: Batch, rows: Rows, allowed: Flags) -> tuple[Floats, Floats]:
    """Return p/M, 0 where refused, and the warped load on [−1, 1], each (n_rows, n_columns)."""
    loads = np.where(allowed, batch.loads, 0.0)
    return loads, loads * rows.stretching[:, None] * (2.0 / LARGEST_WARPED) - 1.0


def _continued(found: Prediction, off: Flags, above: Floats, excess: Floats) -> Prediction:
    """Extrapolate curves of some rows along their tangents in ln load."""
    arrays = {name: values for name, values in vars(found).items() if name != "further"}
    whole = {name: values.reshape(len(off), -1) for name, values in arrays.items()}
    part = {name: values[off] for name, values in whole.items()}  # keep the map's own arrays
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = part["curvature"]
        factor = 1.0 + np.where(curvature > 0.0, part["slope"] / curvature, 1.0) * above
    whole["curvature"][off] = curvature * factor
    whole["bend_angle"][off] = part["bend_angle"] * factor
    whole["peak_stretch"][off] = 1.0 + (part["peak_stretch"] - 1.0) * factor
    outside = int(Status.OUTSIDE_TRAINING)
    whole["status"][off] = np.where(excess > 0.0, outside, part["status"])
    whole["excess"][off] = excess
    if found.further is not None:
        value, slope = (v.reshape(len(off), -1) for v in (found.further.value, found.further.slope))
        value[off] += slope[off] * above
    shaped = {n: v.reshape(found.curvature.shape) for n, v in whole.items()}
    return Prediction(**shaped, further=found.further)
