"""The trained map: polynomials in swelling, material and causes, with their own error.

With q = p/M the load, s the linear scale, L the length as moulded and t = ΔV/(c s³ L³) the swelling
of half of the cavity,

    load                        q = t exp(Y_q)
    change of curvature     κ s L = t exp(Y₀)
    change of bend angle          = t exp(Y₁)
    peak stretch            λ − 1 = (t + b) exp(Y₂)
    other strains               ε = (t + b) exp(Yₖ)
    half of the tip's force     F = s² L² M q exp(Y_F)

where b is the swelling equivalent of mismatch and weight of the body, and each Y a sum of
``Terms``. At a given load t is that of the rising part of q(t), whose largest value is the
ballooning pressure: nothing is singular there in t. So curvature is zero at zero pressure, smooth
in it, and has exact derivatives. Y_F alone has q in the place of t. L stays that of the nominal
actuator where dimensions depart from it, see `bayesdeg.surrogate.departure`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
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
    LARGEST_SWELLING,
    SLACK,
    STRAIN,
    Batch,
    coordinates,
    inside,
    unit_rate,
    unit_swelling,
)
from bayesdeg.surrogate.coordinates import WHOLE as WHOLE_SWELLING
from bayesdeg.surrogate.departure import OF_LOAD, Change, Departure
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

    ``limit``, shape (n_rows,), is p/M up to which curves are followed before they balloon, inf for
    those that do not; ``units`` are those of all.
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
            f"p/M reaches {loads[at]:.4g}, but an actuator of that material balloons at "
            f"{limit[at[0]] / END:.4g}; {int(past.sum())} of {loads.size} values"
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
    inputs: Inputs, batch: Batch, swelling: Floats, terms: Terms, load: Terms, span: TrainingRange
) -> dict[str, Floats]:
    """Return derivatives of κ L by every given field [mm/m over its unit], L as moulded.

    The inputs have no reference pressure, and their batch one row per point. ``swelling``, shape
    (n_rows,), is t at their loads, nan where the map has no answer; derivatives are then nan. The
    first output of ``terms`` is Y₀, that of ``load`` Y_q.
    """
    answered = np.isfinite(swelling)
    middle = 0.5 * (span.lower + span.upper)
    groups = np.where(answered, batch.groups, np.concatenate([[0.0], middle])[:, None])
    groups[0] = np.where(answered, swelling, 0.0)
    scale = np.broadcast_to(inputs.linear_scale, batch.shape).ravel()
    at = coordinates(groups.T)
    points = np.ascontiguousarray(at.points.T)
    log_gain, by_group = _value_and_gradient(terms, points, at.jacobian)
    log_load, load_by_group = _value_and_gradient(load, points, at.jacobian)
    gain, rate = np.exp(log_gain), np.exp(log_load)
    change = groups[0] * gain  # κ s L
    by_group *= change
    by_group[0] += gain
    load_by_group *= groups[0] * rate
    load_by_group[0] += rate
    # at a given load: t moves with the groups, and with the load
    by_load = by_group[0] / load_by_group[0]
    by_group -= by_load * load_by_group
    by_group[0] = by_load
    groups[0] = np.where(answered, batch.loads[:, 0], 0.0)
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


def _value_and_gradient(terms: Terms, points: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
    """Return the first output at points (13, n), (n,), and its derivatives by groups, (13, n)."""
    found = evaluate(_with_gradient(terms), points, points[0][:, None], points[SLACK][:, None])
    value, *by_points = found[:, :, 0]
    return value, np.einsum("an,nag->gn", np.stack(by_points), jacobian)


@lru_cache(maxsize=8)
def _of_outputs(terms: Terms, places: tuple[int, ...]) -> Terms:
    """Return some of the outputs."""
    return Terms(terms.orders, terms.coefficients[list(places)])


@lru_cache(maxsize=8)
def _along(terms: Terms) -> Terms:
    """Return the first output and its derivatives by place along the curve and of the slack."""
    first = terms.output(0)
    return stacked([first, first.derivative(0), first.derivative(SLACK)])


@lru_cache(maxsize=8)
def _with_gradient(terms: Terms) -> Terms:
    """Return the first output and its derivatives by the 13 coordinates, as 14 outputs."""
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
# and causes as in `terms`, which leaves Chebyshev series in the swelling, one for each power of φ.
# That of the load is tabulated at `NODES` places up to the largest load; at each asked load the
# place is then found by Newton's method with the curvature of its cell, and all other series are
# summed there.

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
# curvature, angle, stretch, slope, the standard errors of the first three, swelling t,
# d ln t/d ln q, and the relative standard error of q
VALUES = 10
_T, _RATE, _LOAD_ERROR = 7, 8, 9
DEGREES = 180.0 / math.pi
NODES = 33  # places of the range of the swelling at which a curve of loads is tabulated
STEPS = 2  # of Newton's method from the first guess: the error is then that of rounding
END = 0.995
"""Share of the ballooning pressure up to which a curve is followed: its slope is infinite there. It
then continues along its tangent."""
GROWTH = 2.0
"""d ln κ/d ln p up to which the mesh error is taken as constant. In steeper curves it is assumed
to grow like that of the pressure."""
_HALF = 0.5 * WHOLE_SWELLING


class Rows(NamedTuple):
    """Quantities constant along the loads of a row.

    Parameters
    ----------
    points : array, shape (11, n_rows)
        Scaled material and causes, in the order of ``ROW_AXES``.
    largest : array, shape (n_rows,)
        Largest p/M; below 0 where the map is nowhere defined.
    slack, give : array, shape (n_rows,)
        Slack strain s of the paper, and its strain over the swelling e/t.
    offset : array, shape (n_rows,)
        b, the swelling equivalent of mismatch and weight in the peak stretch.
    bending : array, shape (n_rows,)
        Curvature over bend angle, 1000/(L s) [1/m].
    """

    points: Floats
    largest: Floats
    slack: Floats
    give: Floats
    offset: Floats
    bending: Floats


class Plans(NamedTuple):
    """Plans of Y_q and Y, and of ln of their squared relative standard errors."""

    load: Plan
    terms: Plan
    load_error: Plan
    error: Plan


@compiled
def map_of_rows(
    loads: Floats, rows: Rows, plans: Plans, change: Floats, mesh_error: float
) -> tuple[Floats, Floats, Floats]:  # pragma: no cover - compiled
    """Return outputs with standard errors, and where curves end.

    Parameters
    ----------
    loads : array, shape (n_rows, n_columns)
        p/M [–]; those beyond the end of a curve, or below 0, are moved there.
    rows : Rows
        Rows of one material each.
    plans : Plans
        Of the outputs and errors.
    change : array, shape (n_slots, n_rows)
        Added to the series of the load; without rows if there is nothing to add.
    mesh_error : float
        Relative standard error added to all of them.

    Returns
    -------
    values : array, shape (10, n_rows, n_columns)
        Outputs at the loads.
    ends : array, shape (n_rows,)
        p/M up to which they are given; below 0 where they are nowhere defined.
    limits : array, shape (n_rows,)
        p/M at which a curve balloons; inf where it does not in its range.
    """
    n_rows, n_columns = loads.shape
    out, ends, limits = np.empty((VALUES, n_rows, n_columns)), np.empty(n_rows), np.empty(n_rows)
    load, terms, load_error, error = plans
    of_load = np.empty((load.n_orders * load.n_powers, 1, BLOCK))
    along = np.empty((terms.n_orders * terms.n_powers, Y, BLOCK))
    of_load_error = np.empty((load_error.n_orders * load_error.n_powers, 1, BLOCK))
    along_error = np.empty((error.n_orders * error.n_powers, Y, BLOCK))
    count = max(load.n_orders, terms.n_orders, load_error.n_orders, error.n_orders)
    table, slopes = np.empty((max(2, count), BLOCK)), np.empty((max(2, count), BLOCK))
    nodes, rates = np.empty((NODES, BLOCK)), np.empty((NODES, BLOCK))
    at, asked = np.zeros((_PLACES, BLOCK)), np.empty(BLOCK)
    sums, by_place, by_phi = np.empty((Y, BLOCK)), np.empty(BLOCK), np.empty(BLOCK)
    of_row = np.empty((5, BLOCK))
    for first in range(0, n_rows, BLOCK):
        lanes = min(BLOCK, n_rows - first)
        _take(of_row, rows, first, lanes)
        contract(of_load, rows.points, load, first, lanes)
        for slot in range(change.shape[0]):
            for lane in range(lanes):
                of_load[slot, 0, lane] += change[slot, first + lane]
        contract(along, rows.points, terms, first, lanes)
        contract(of_load_error, rows.points, load_error, first, lanes)
        contract(along_error, rows.points, error, first, lanes)
        last = _tabulate_loads(nodes, rates, at, of_row, of_load, load, table, slopes, sums)
        _find_ends(at, nodes, rates, last, of_row, of_load, load, table, slopes, sums)
        for lane in range(lanes):
            ends[first + lane], limits[first + lane] = at[_ENDS, lane], at[_LIMITS, lane]
        for column in range(n_columns):
            for lane in range(BLOCK):
                row = first + min(lane, lanes - 1)
                asked[lane] = min(max(loads[row, column], 0.0), max(at[_ENDS, lane], 0.0))
                if not asked[lane] >= 0.0:
                    asked[lane] = 0.0
            _start(at, asked, nodes, rates, last)
            for _ in range(STEPS):
                _load_at(at, of_row, of_load, load, table, slopes, sums)
                _step(at, asked)
            _load_at(at, of_row, of_load, load, table, slopes, sums)
            _write(out, at, first, lanes, column)
            _series(sums, by_place, by_phi, along, terms, at, table, slopes, True)
            _write_outputs(out, at, of_row, sums, by_place, by_phi, first, lanes, column)
            _series(sums, by_place, by_phi, along_error, error, at, table, slopes, False)
            _write_errors(out, sums, first, lanes, column)
            _series(sums, by_place, by_phi, of_load_error, load_error, at, table, slopes, False)
            _combine(out, sums, mesh_error, first, lanes, column)
    return out, ends, limits


# rows of the working space of a block
_X, _SWELLING, _PHI, _LOAD, _BY_X = 0, 1, 2, 3, 4  # place on [−1, 1], t, φ, q and dq/dx there
_LOW, _HIGH, _BEND = 5, 6, 7  # bounds of a cell, and d²q/dx² in it
_ENDS, _LIMITS, _LAST, _GROWS = 8, 9, 10, 11  # q and x at the end; dt/dx at a place
_PLACES = 12
_LARGEST_LOAD, _SLACK, _GIVE, _OFFSET, _BENDING = 0, 1, 2, 3, 4  # rows of row constants


@compiled
def _take(of_row: Floats, rows: Rows, first: int, lanes: int) -> None:  # pragma: no cover
    """Copy row constants of a block; lanes beyond the last row repeat it."""
    for lane in range(BLOCK):
        row = first + min(lane, lanes - 1)
        of_row[_LARGEST_LOAD, lane], of_row[_SLACK, lane] = rows.largest[row], rows.slack[row]
        of_row[_GIVE, lane], of_row[_OFFSET, lane] = rows.give[row], rows.offset[row]
        of_row[_BENDING, lane] = rows.bending[row]


@compiled
def _tabulate(
    table: Floats, slopes: Floats, at: Floats, count: int
) -> None:  # pragma: no cover - compiled
    """Tabulate Chebyshev polynomials of the place, and their derivatives."""
    x = at[_X]
    for lane in range(BLOCK):
        table[0, lane], table[1, lane] = 1.0, x[lane]
        slopes[0, lane], slopes[1, lane] = 0.0, 1.0
    for n in range(2, count):
        before, last, new = table[n - 2], table[n - 1], table[n]
        falling, rising, slope = slopes[n - 2], slopes[n - 1], slopes[n]
        for lane in range(BLOCK):
            new[lane] = 2.0 * x[lane] * last[lane] - before[lane]
        for lane in range(BLOCK):
            slope[lane] = 2.0 * (last[lane] + x[lane] * rising[lane]) - falling[lane]


@compiled
def _series(
    sums: Floats,
    by_place: Floats,
    by_phi: Floats,
    along: Floats,
    plan: Plan,
    at: Floats,
    table: Floats,
    slopes: Floats,
    has_slopes: bool,
) -> None:  # pragma: no cover - compiled
    """Sum series of a plan at a place; if wanted, of the first one also both derivatives."""
    outputs = along.shape[1]
    sums[:outputs] = 0.0
    by_place[:], by_phi[:] = 0.0, 0.0
    for n in range(plan.orders[0]):
        slot, polynomial, slope = along[n], table[n], slopes[n]
        for output in range(outputs):
            series, total = slot[output], sums[output]
            for lane in range(BLOCK):
                total[lane] += series[lane] * polynomial[lane]
        if has_slopes:
            series = slot[0]
            for lane in range(BLOCK):
                by_place[lane] += series[lane] * slope[lane]
    if plan.n_powers == 1:
        return
    power, before = np.ones(BLOCK), np.empty(BLOCK)
    for m in range(1, plan.n_powers):
        for lane in range(BLOCK):
            before[lane] = m * power[lane]  # m φ^(m−1)
            power[lane] *= at[_PHI, lane]
        for n in range(plan.orders[m]):
            slot, polynomial, slope = along[m * plan.n_orders + n], table[n], slopes[n]
            for output in range(outputs):
                series, total = slot[output], sums[output]
                for lane in range(BLOCK):
                    total[lane] += series[lane] * (polynomial[lane] * power[lane])
            if has_slopes:
                series = slot[0]
                for lane in range(BLOCK):
                    by_place[lane] += series[lane] * (slope[lane] * power[lane])
                    by_phi[lane] += series[lane] * (polynomial[lane] * before[lane])


@compiled
def _load_at(
    at: Floats,
    of_row: Floats,
    along: Floats,
    plan: Plan,
    table: Floats,
    slopes: Floats,
    sums: Floats,
) -> None:  # pragma: no cover - compiled
    """Write t, φ, q and dq/dx at the places of all lanes."""
    x, t, phi, load, by_x = at[_X], at[_SWELLING], at[_PHI], at[_LOAD], at[_BY_X]
    for lane in range(BLOCK):
        t[lane] = (x[lane] + 1.0) * _HALF
    exponentials(t)
    for lane in range(BLOCK):
        t[lane] -= 1.0
        slack = of_row[_SLACK, lane]
        # without slack the strain may be 0 as well
        strain = slack + of_row[_GIVE, lane] * t[lane]
        phi[lane] = slack / (strain if slack > 0.0 else 1.0)
    _tabulate(table, slopes, at, len(table))
    by_place, by_phi = np.empty(BLOCK), np.empty(BLOCK)
    _series(sums, by_place, by_phi, along, plan, at, table, slopes, True)
    gain = sums[0]
    exponentials(gain)
    for lane in range(BLOCK):
        # dt/dx, and dφ/dx over that
        grown = (1.0 + t[lane]) * _HALF
        slack = of_row[_SLACK, lane]
        eased = -phi[lane] * phi[lane] * of_row[_GIVE, lane] / (slack if slack > 0.0 else 1.0)
        change = by_place[lane] + by_phi[lane] * eased * grown
        load[lane] = t[lane] * gain[lane]
        by_x[lane] = gain[lane] * (grown + t[lane] * change)
        at[_GROWS, lane] = grown


@compiled
def _tabulate_loads(
    nodes: Floats,
    rates: Floats,
    at: Floats,
    of_row: Floats,
    along: Floats,
    plan: Plan,
    table: Floats,
    slopes: Floats,
    sums: Floats,
) -> int:  # pragma: no cover - compiled
    """Tabulate q and dq/dx up to where all lanes have their largest load; return the last node."""
    done = np.zeros(BLOCK, np.bool_)
    for node in range(NODES):
        at[_X, :] = -1.0 + node * (2.0 / (NODES - 1))
        _load_at(at, of_row, along, plan, table, slopes, sums)
        open_lanes = 0
        for lane in range(BLOCK):
            load, rate = at[_LOAD, lane], at[_BY_X, lane]
            nodes[node, lane], rates[node, lane] = load, rate
            if load >= of_row[_LARGEST_LOAD, lane] or not rate > 0.0:
                done[lane] = True
            open_lanes += not done[lane]
        if open_lanes == 0 and node > 0:
            return node
    return NODES - 1


@compiled
def _find_ends(
    at: Floats,
    nodes: Floats,
    rates: Floats,
    last: int,
    of_row: Floats,
    along: Floats,
    plan: Plan,
    table: Floats,
    slopes: Floats,
    sums: Floats,
) -> None:  # pragma: no cover - compiled
    """Write the load at which curves balloon, and the place and load at which they end."""
    width = 2.0 / (NODES - 1)
    has_limit = np.zeros(BLOCK, np.bool_)
    low_rate, high_rate = np.empty(BLOCK), np.empty(BLOCK)
    for lane in range(BLOCK):
        node = 0
        while (
            node < last
            and rates[node, lane] > 0.0
            and (node == 0 or nodes[node, lane] < of_row[_LARGEST_LOAD, lane])
        ):
            node += 1
        at[_LAST, lane] = -1.0 + node * width
        has_limit[lane] = node > 0 and not rates[node, lane] > 0.0
        at[_LIMITS, lane] = math.inf
        at[_ENDS, lane] = min(nodes[node, lane], of_row[_LARGEST_LOAD, lane])
        at[_LOW, lane], at[_HIGH, lane] = at[_LAST, lane] - width, at[_LAST, lane]
        low_rate[lane], high_rate[lane] = rates[max(node - 1, 0), lane], rates[node, lane]
    if not np.any(has_limit):
        return
    for _ in range(5):  # regula falsi for dq/dx = 0: q errs by the square of the place's error
        for lane in range(BLOCK):
            share = low_rate[lane] / (low_rate[lane] - high_rate[lane])
            share = min(max(share, 0.02), 0.98) if has_limit[lane] else 1.0
            at[_X, lane] = at[_LOW, lane] + share * (at[_HIGH, lane] - at[_LOW, lane])
        _load_at(at, of_row, along, plan, table, slopes, sums)
        for lane in range(BLOCK):
            if not has_limit[lane]:
                continue
            if at[_BY_X, lane] > 0.0:
                at[_LOW, lane], low_rate[lane] = at[_X, lane], at[_BY_X, lane]
                high_rate[lane] *= 0.5  # as in the Illinois algorithm
            else:
                at[_HIGH, lane], high_rate[lane] = at[_X, lane], at[_BY_X, lane]
                low_rate[lane] *= 0.5
    for lane in range(BLOCK):
        if has_limit[lane]:
            at[_LAST, lane], at[_LIMITS, lane] = at[_X, lane], at[_LOAD, lane]
            at[_ENDS, lane] = min(END * at[_LOAD, lane], of_row[_LARGEST_LOAD, lane])


@compiled
def _start(
    at: Floats, asked: Floats, nodes: Floats, rates: Floats, last: int
) -> None:  # pragma: no cover - compiled
    """Bracket the place of each asked load by nodes, and solve for it with the cell's curvature."""
    width = 2.0 / (NODES - 1)
    for lane in range(BLOCK):
        node = 0
        end = at[_LAST, lane]
        while (
            node + 1 < last
            and -1.0 + (node + 1) * width < end
            and nodes[node + 1, lane] < asked[lane]
        ):
            node += 1
        low = -1.0 + node * width
        high = min(low + width, end)
        bend = (rates[node + 1, lane] - rates[node, lane]) / width
        at[_LOW, lane], at[_HIGH, lane], at[_BEND, lane] = low, high, bend
        at[_X, lane] = low
        at[_LOAD, lane], at[_BY_X, lane] = nodes[node, lane], rates[node, lane]
    _step(at, asked)


@compiled
def _step(at: Floats, asked: Floats) -> None:  # pragma: no cover - compiled
    """Move each place to the root of the parabola of its load, within its cell."""
    for lane in range(BLOCK):
        gap, rate = asked[lane] - at[_LOAD, lane], at[_BY_X, lane]
        root = max(rate * rate + 2.0 * gap * at[_BEND, lane], 0.0)
        step = 2.0 * gap / (max(rate, 1e-300) + math.sqrt(root))
        at[_X, lane] = min(max(at[_X, lane] + step, at[_LOW, lane]), at[_HIGH, lane])


@compiled
def _write(
    out: Floats, at: Floats, first: int, lanes: int, column: int
) -> None:  # pragma: no cover - compiled
    """Write t and d ln t/d ln q; at rest their limits."""
    for lane in range(lanes):
        t, load, by_x = at[_SWELLING, lane], at[_LOAD, lane], at[_BY_X, lane]
        out[_T, first + lane, column] = t if at[_ENDS, lane] >= 0.0 else math.nan
        # d ln t/d ln q = (q/t) (dt/dx)/(dq/dx)
        is_rest = not t > 0.0
        rate = 1.0 if is_rest else load / t * at[_GROWS, lane] / by_x
        out[_RATE, first + lane, column] = rate


@compiled
def _write_outputs(
    out: Floats,
    at: Floats,
    of_row: Floats,
    sums: Floats,
    by_place: Floats,
    by_phi: Floats,
    first: int,
    lanes: int,
    column: int,
) -> None:  # pragma: no cover - compiled
    """Write curvature, bend angle, peak stretch and the slope of the first."""
    for k in range(Y):
        exponentials(sums[k])
    for lane in range(lanes):
        row, t, phi = first + lane, out[_T, first + lane, column], at[_PHI, lane]
        # d ln κ/d ln t
        growth = 1.0 + t / at[_GROWS, lane] * by_place[lane]
        growth -= phi * (1.0 - phi) * by_phi[lane]
        curvature = t * of_row[_BENDING, lane] * sums[0, lane]
        out[0, row, column] = curvature
        out[1, row, column] = t * DEGREES * sums[1, lane]
        out[2, row, column] = 1.0 + (t + of_row[_OFFSET, lane]) * sums[2, lane]
        out[3, row, column] = curvature * growth * out[_RATE, row, column]


@compiled
def _write_errors(
    out: Floats, sums: Floats, first: int, lanes: int, column: int
) -> None:  # pragma: no cover - compiled
    """Write squared relative standard errors of the outputs at a given swelling."""
    for k in range(Y):
        exponentials(sums[k])
        for lane in range(lanes):
            out[4 + k, first + lane, column] = sums[k, lane]


@compiled
def _combine(
    out: Floats, sums: Floats, mesh_error: float, first: int, lanes: int, column: int
) -> None:  # pragma: no cover - compiled
    """Write standard errors of the outputs at a given load, and that of the load."""
    exponentials(sums[0])
    for lane in range(lanes):
        row = first + lane
        curvature, slope = out[0, row, column], out[3, row, column]
        growth = slope / curvature if curvature > 0.0 else 1.0
        of_mesh = mesh_error * max(1.0, growth / GROWTH)
        of_load = growth * growth * sums[0, lane] + of_mesh * of_mesh
        for k in range(Y):
            size = out[k, row, column] - (1.0 if k == 2 else 0.0)
            out[4 + k, row, column] = size * math.sqrt(out[4 + k, row, column] + of_load)
        out[_LOAD_ERROR, row, column] = math.sqrt(sums[0, lane])


# ---- the map

OUTPUTS = ("curvature", "bend_angle", "peak_stretch")
_MISMATCH, _ALONG, _UP = (
    NAMES.index(name) for name in ("paper_mismatch", "gravity_along", "gravity_up")
)
OUTSIDE_BY = 0.01
"""Distance outside the range, as a share of it or in ln load, at which a density has fallen by one
half: small relative to posteriors, large relative to derivative steps."""
_FORCE = len(OUTPUTS) + len(MEASURES) + 1
STRAIN_MESH_ERROR = 0.025
"""Relative standard error of strain measures other than the peak stretch, dominated by corners: the
change between meshes of 2042 and 4616 elements (`benchmarks/rupture_measures.py`)."""
_TABLES = ("load", "load_error", "terms", "error", "strains", "strain_error")
_NUMBERS = ("length", "compliance", "mesh_error")


def stretch_offset(groups: Floats) -> Floats:
    """Return the swelling b equivalent to mismatch and weight in the peak stretch [–].

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
    return np.array([LARGEST_SWELLING, STRAIN, GIVE, GRAVITY_STRAIN])


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
    """Pressures at which actuators balloon: the largest of their curves.

    Parameters
    ----------
    pressure, sd : array
        Best estimate and standard error [kPa]; nan outside the range of the groups, inf where none
        lies within the trained loads.
    """

    pressure: Floats
    sd: Floats


@dataclass(frozen=True)
class Surrogate:
    """A forward map trained on finite element curves.

    Parameters
    ----------
    length : float
        Length of the actuator as moulded [mm].
    compliance : float
        c of the swelling t = ΔV/(c s³ L³), half of the cavity's [–].
    span : TrainingRange
        Range of load and groups.
    load : Terms
        Y_q.
    load_error : Terms
        ln of its squared standard error.
    terms : Terms
        Y of each of ``OUTPUTS``.
    error : Terms
        ln of the squared relative standard errors of ``OUTPUTS`` at a given swelling; the peak
        stretch's is relative to the stretch less 1.
    strains, strain_error : Terms
        Y of each of ``MEASURES`` of `bayesdeg.actuator.demand`, and ln of their squared relative
        standard errors.
    mesh_error : float
        Relative standard error of the finite element model itself, in all outputs [–].
    record : str
        How it was trained: design, code version, accuracy (JSON).
    units : Units
        Units of p/M and Et/(M s) in the span and the terms.
    force : FurtherTerms, optional
        Terms of the force of a held tip.
    departure : Departure, optional
        Departure with dimensions that may differ from the nominal ones.
    """

    length: float
    compliance: float
    span: TrainingRange
    load: Terms
    load_error: Terms
    terms: Terms
    error: Terms
    strains: Terms
    strain_error: Terms
    mesh_error: float
    record: str
    units: Units = ONE
    force: FurtherTerms | None = None
    departure: Departure | None = None

    @property
    def answers(self) -> tuple[Asked, ...]:
        """Optional outputs that it predicts."""
        return ("cavity_volume",) if self.force is None else ("cavity_volume", "tip_force")

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction; outside the training range it is nan with a status."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        inputs = self.units.inputs(inputs)
        batch, away = self._batch(inputs)
        rows, plans, change = self._prepared(inputs.linear_scale, batch, away)
        values, ends, _ = _mapped(batch.loads, rows, plans, change, self.mesh_error)
        refused = ~((batch.loads >= 0.0) & (batch.loads <= ends[:, None]))
        values[:, refused] = np.nan
        return self._prediction(inputs, batch, rows, values, refused, away)

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
        rows, plans, change = self._prepared(inputs.linear_scale, inner, away)
        values, ends, _ = _mapped(inner.loads, rows, plans, change, self.mesh_error)
        asked, most = inner.loads, ends[:, None]
        known = inner.within[:, None] & np.isfinite(asked)
        values[:, ~known] = np.nan
        found = self._prediction(inputs, inner, rows, values, ~known, away)
        off = ~np.all((asked >= 0.0) & (asked <= most), axis=1) | (distance > 0.0)
        if not off.any():
            return found
        asked, most = asked[off], most[off]
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.log(np.maximum(asked / most, 1.0))
            below = np.maximum(-asked / most, 0.0)
        excess = np.sqrt(distance[off, None] ** 2 + above**2 + below**2) / OUTSIDE_BY
        return _continued(found, off, above, excess)

    def _prepared(
        self, scale: Floats, batch: Batch, away: Floats | None
    ) -> tuple[Rows, Plans, Floats]:
        """Return rows, plans and the change of the load's series with dimensions."""
        slack, give = batch.slack
        scale = np.broadcast_to(scale, batch.row_shape).ravel()
        rows = Rows(
            points=batch.scaled[list(ROW_AXES)],
            largest=np.where(batch.within, batch.largest_load(self.span), -1.0),
            slack=slack,
            give=give,
            offset=stretch_offset(batch.groups),
            bending=1e3 / self.length / scale,
        )
        is_slack = bool(np.any(slack > 0.0))
        plans = Plans(
            *(
                active_plan(terms, batch.scaled, slack=is_slack)
                for terms in (self.load, self.terms, self.load_error, self.error)
            )
        )
        change = np.empty((0, 0))
        if away is not None and self.departure is not None:
            shape = (plans.load.n_orders, plans.load.n_powers)
            change = self.departure.change_of_load(batch, away, shape)
        return rows, plans, change

    def _prediction(
        self,
        inputs: Inputs,
        batch: Batch,
        rows: Rows,
        values: Floats,
        refused: Flags,
        away: Floats | None,
    ) -> Prediction:
        swelling, rate, load_sd = values[[_T, _RATE, _LOAD_ERROR]]
        if away is not None:
            change = self._change((0, 1, 2, OF_LOAD), batch, away, swelling)
            values[:_T] = change.applied(values[:_T], rate)
        curvature, angle, stretch, slope, *sds = values[:_T].reshape(_T, *batch.shape)
        demand, demand_sd = stretch, sds[2]
        if inputs.criterion != "principal_stretch":
            with np.errstate(divide="ignore", invalid="ignore"):
                growth = np.where(curvature > 0.0, slope / curvature, 1.0)
            spread = np.square(growth * load_sd.reshape(batch.shape))
            demand, demand_sd = self._demand(inputs, batch, rows, swelling, spread, away)
        return Prediction(
            curvature=curvature,
            bend_angle=angle,
            peak_stretch=demand,
            slope=slope,
            sd=sds[0],
            bend_angle_sd=sds[1],
            peak_stretch_sd=demand_sd,
            status=np.where(refused, int(Status.OUTSIDE_TRAINING), 0).reshape(batch.shape),
            excess=np.zeros(batch.shape),
            further=self._further(inputs, batch, values, refused, away),
        )

    def _change(self, places: tuple[int, ...], batch: Batch, away: Floats, along: Floats) -> Change:
        """Return the change of outputs with dimensions at t, or at p/M of a held tip.

        They are numbered as ``OUTPUTS``, ``MEASURES``, the load and the force.
        """
        assert self.departure is not None
        return self.departure.change(places, batch, away, np.where(along >= 0.0, along, 0.0))

    def _further(
        self, inputs: Inputs, batch: Batch, values: Floats, refused: Flags, away: Floats | None
    ) -> Further | None:
        """Return the requested output besides the shape; None if not trained."""
        if inputs.asked not in self.answers:
            return None
        length = self.length * inputs.linear_scale
        if inputs.asked == "cavity_volume":
            size = 2e-3 * self.compliance * length**3  # of both halves [ml]
            swelling, rate, load_sd = (
                values[k].reshape(batch.shape) for k in (_T, _RATE, _LOAD_ERROR)
            )
            value = np.asarray(size * swelling)
            sd = value * rate * np.hypot(load_sd, self.mesh_error)
            return Further(value, value * rate, sd)
        assert self.force is not None
        loads = np.where(refused, 0.0, np.clip(batch.loads, 0.0, None))
        unit, phi = unit_swelling(loads), batch.phi(loads)
        y, by_load, by_phi = evaluate(_along(self.force.terms), batch.scaled, unit, phi)
        variance = np.exp(evaluate(self.force.error, batch.scaled, unit, phi)[0])
        growth = 1.0 + unit_rate(loads) * by_load - phi * (1.0 - phi) * by_phi
        if away is not None:
            change = self._change((_FORCE,), batch, away, loads)
            y, growth = y + np.log(change.factor[0]), growth + change.growth
            variance = variance + change.variance[0]
        known = np.where(refused, np.nan, loads)
        size = 2.0 * length**2 * modulus_of(inputs)  # of both halves [N]
        value = np.asarray(size * (known * np.exp(y)).reshape(batch.shape))
        sd = value * np.sqrt(variance + self.mesh_error**2).reshape(batch.shape)
        return Further(value, value * growth.reshape(batch.shape), sd)

    def _demand(
        self,
        inputs: Inputs,
        batch: Batch,
        rows: Rows,
        swelling: Floats,
        spread: Floats,
        away: Floats | None,
    ) -> tuple[Floats, Floats]:
        """Return the equally demanding uniaxial stretch by a criterion, and its error.

        ``spread`` is the relative variance due to the swelling's error.
        """
        t = np.where(swelling >= 0.0, swelling, 0.0)
        places, unit, phi = needed(inputs.criterion), unit_swelling(t), batch.phi(t)
        y, log_error = (
            evaluate(_of_outputs(terms, places), batch.scaled, unit, phi)
            for terms in (self.strains, self.strain_error)
        )
        if away is not None:
            change = self._change(tuple(len(OUTPUTS) + p for p in places), batch, away, t)
            y = y + np.log(change.factor)
            log_error = np.log(np.exp(log_error) + change.variance)
        base = swelling + rows.offset[:, None]
        strain = demanded_strain(inputs, (base * np.exp(y)).reshape(-1, *batch.shape))
        variance = np.exp(log_error).mean(axis=0).reshape(batch.shape) + STRAIN_MESH_ERROR**2
        return 1.0 + strain, strain * np.sqrt(variance + spread)

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
        rows, plans, change = self._prepared(inputs.linear_scale, batch, None)
        values, ends, _ = _mapped(batch.loads, rows, plans, change, 0.0)
        loads = batch.loads[:, 0]
        swelling = np.where((loads >= 0.0) & (loads <= ends), values[_T, :, 0], np.nan)
        gradient = curvature_gradient(inputs, batch, swelling, self.terms, self.load, self.span)
        by_given = self.units.by_given(gradient, inputs)
        return {name: value / self.length for name, value in by_given.items()}

    def limit_pressure(self, inputs: Inputs) -> LimitPressure:
        """Return the pressure at which each material balloons, with its error."""
        inputs = self.units.inputs(inputs)
        batch, away = self._batch(inputs)
        shape = (*batch.shape[:-1], 1) if batch.loads.shape[-1:] != (1,) else batch.shape
        modulus = np.broadcast_to(modulus_of(inputs), shape).ravel()
        rows, plans, change = self._prepared(inputs.linear_scale, batch, away)
        whole = rows._replace(largest=np.where(batch.within, np.inf, -1.0))
        limits = _mapped(np.zeros((len(modulus), 1)), whole, plans, change, 0.0)[2]
        at_end, _, _ = _mapped(limits[:, None], whole, plans, change, 0.0)
        limits = np.where(limits <= batch.largest_load(self.span), limits, np.inf)
        pressure = np.where(batch.within, 1e3 * modulus * limits * self.units.load, np.nan)
        sd = np.hypot(at_end[_LOAD_ERROR, :, 0], self.mesh_error / GROWTH) * pressure
        return LimitPressure(pressure.reshape(shape), sd.reshape(shape))

    def swelling(self, groups: Floats, loads: Floats) -> Floats:
        """Return t at loads (n,) of groups (n, 12) brought into their ranges, (n,).

        Loads beyond the end of a curve count as its end; t is nan for impossible materials.
        """
        batch = Batch.of_groups(groups, loads, self.span).brought_inside(self.span)[0]
        rows, plans, change = self._prepared(np.ones(()), batch, None)
        return _mapped(batch.loads, rows, plans, change, 0.0)[0][_T, :, 0]

    def refusals(self, inputs: Inputs) -> dict[str, str]:
        """Say in words, by name, what lies outside the training range and by how much.

        The names are those of the groups, "load" for the largest load trained, and "limit" for
        loads beyond ballooning. Empty if nothing is refused.
        """
        counted = self.units.inputs(inputs)
        batch, away = self._batch(counted)
        rows, plans, change = self._prepared(counted.linear_scale, batch, away)
        _, ends, limits = _mapped(batch.loads, rows, plans, change, 0.0)
        ends = np.where(np.isinf(limits), np.inf, ends)
        found = describe(batch, self.span, ends, self.units)
        if inputs.reference_pressure is None:
            return found
        at = replace(inputs, pressure=inputs.reference_pressure, reference_pressure=None)
        zero = {n: f"at the reference pressure: {text}" for n, text in self.refusals(at).items()}
        return zero | found

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything as plain arrays, for a npz file."""
        arrays: dict[str, NDArray[np.generic]] = {
            "largest_load": np.array(self.span.load),
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
        if self.force is not None:
            tables |= {"force": self.force.terms, "force_error": self.force.error}
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
        forces = ("force", "force_error") if "force_orders" in arrays else ()
        tables = {
            name: Terms(
                arrays[f"{name}_orders"].astype(np.int64),
                arrays[f"{name}_coefficients"].astype(np.float64),
            )
            for name in (*_TABLES, *forces)
        }
        load, paper, *layer = (float(unit) for unit in arrays.get("units", np.ones(2)))
        return cls(
            length=float(arrays["length"]),
            compliance=float(arrays["compliance"]),
            span=TrainingRange(
                load=float(arrays["largest_load"]),
                groups=tuple(
                    replace(group, low=float(low), high=float(high))
                    for group, (low, high, _) in zip(GROUPS, ranges, strict=True)
                ),
                share=float(arrays["share"]),
            ),
            mesh_error=float(arrays["mesh_error"]),
            record=str(arrays["record"]),
            units=Units(load, paper, *layer),
            force=FurtherTerms(*(tables[name] for name in forces)) if forces else None,
            departure=Departure.from_arrays(arrays),
            **{name: tables[name] for name in _TABLES},
        )


def _mapped(
    loads: Floats, rows: Rows, plans: Plans, change: Floats, mesh_error: float
) -> tuple[Floats, Floats, Floats]:
    """Call `map_of_rows` with each load once: both branches of a cycle have the same ones."""
    _, once, which = np.unique(loads[:1].ravel(), return_index=True, return_inverse=True)
    if len(once) == loads.shape[1] or not np.array_equal(loads[:, once[which]], loads):
        loads = np.require(loads, requirements=("C", "W"))  # the layout of the compiled function
        return map_of_rows(loads, rows, plans, change, mesh_error)
    values, ends, limits = map_of_rows(loads[:, once].copy(), rows, plans, change, mesh_error)
    return np.take(values, which, axis=-1), ends, limits


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
