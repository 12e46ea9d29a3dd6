"""Solved curves to a surrogate: least squares, and its error by leaving out whole curves."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import MODEL_VERSION, Curve, CurveSolution
from bayesdeg.actuator.status import Status
from bayesdeg.emulator.scaling import TrainingBox
from bayesdeg.emulator.surrogate import (
    Surrogate,
    chebyshev_features,
    polynomial,
    total_degree_orders,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LIMIT_MARGIN = 0.97  # share of a limit load up to which a curve is emulated
STEEPEST = 4.0  # where d ln κ / d ln p is larger the actuator is about to balloon
RIDGE = 1e-9


@dataclass(frozen=True)
class Table:
    """Points of solved curves, inside the training range.

    Parameters
    ----------
    points : array, shape (n, 4)
        Load and groups on [−1, 1].
    load : array, shape (n,)
        p/C1 [–].
    values : array, shape (n, 3)
        The three quantities that the surrogate's polynomials stand for.
    curve : array of int, shape (n,)
        To which curve a point belongs.
    """

    points: Floats
    load: Floats
    values: Floats
    curve: Indices


def tabulate(
    curves: Sequence[Curve], solutions: Sequence[CurveSolution], *, box: TrainingBox, length: float
) -> Table:
    """Return the points of solved curves that lie inside the box and within their ``reach``."""
    points, loads, values, numbers = [], [], [], []
    for number, (curve, solution) in enumerate(zip(curves, solutions, strict=True)):
        q = np.array(curve.loads[: len(solution.bend_angle)])
        z = unit_groups(curve, box)
        keep = q <= min(reach(curve, solution), float(box.largest_load(z[1:2])[0])) * (1 + 1e-9)
        kappa = solution.bend_angle / solution.arc_length
        y = np.stack(
            [
                np.log(kappa * length / q),
                np.log((solution.peak_stretch - 1.0) / q),
                (solution.arc_length / length - 1.0) / q,
            ],
            axis=1,
        )
        points.append(np.column_stack([2.0 * q / box.load - 1.0, np.tile(z, (len(q), 1))])[keep])
        loads.append(q[keep])
        values.append(y[keep])
        numbers.append(np.full(int(keep.sum()), number))
    return Table(*(np.concatenate(part) for part in (points, loads, values, numbers)))


def reach(curve: Curve, solution: CurveSolution) -> float:
    """Return the load up to which a curve is smooth enough to emulate [–]; inf if all of it is.

    Where d ln κ / d ln q passes ``STEEPEST``, or shortly before a limit point; of a curve whose
    end was not found, the last load that was solved.
    """
    q = np.array(curve.loads[: len(solution.bend_angle)])
    if len(q) < 3:
        return 0.0
    exhausted = solution.status == Status.EFFORT_EXHAUSTED
    limit = float(q[-1]) if exhausted else LIMIT_MARGIN * solution.limit_load
    growth = np.diff(np.log(solution.bend_angle / solution.arc_length)) / np.diff(np.log(q))
    steep = np.flatnonzero(growth > STEEPEST)
    if len(steep) == 0:
        return limit
    middle, at = np.sqrt(q[1:] * q[:-1]), int(steep[0])
    before = max(at - 1, 0)
    crossing = np.interp(STEEPEST, growth[before : at + 1], middle[before : at + 1])
    return min(float(crossing), limit)


def unit_groups(curve: Curve, box: TrainingBox) -> Floats:
    """Return the material groups of a curve on [−1, 1]."""
    m = curve.material
    raw = (m.c2_ratio / np.sqrt(3.0 * m.c3_ratio), np.log(m.c3_ratio), np.log(m.paper_group))
    return np.array([float(box.unit(i, np.array(v))) for i, v in enumerate(raw)])


def fit(orders: Indices, points: Floats, values: Floats) -> Floats:
    """Return least-squares coefficients, shape (n_outputs, n_terms)."""
    features = chebyshev_features(orders, points)
    normal = features.T @ features + RIDGE * len(points) * np.eye(len(orders))
    coefficients: Floats = np.linalg.solve(normal, features.T @ values).T
    return coefficients


def left_out_residuals(orders: Indices, table: Table) -> Floats:
    """Return residuals of every curve under the fit to all others, shape (n, n_outputs).

    By the block form of the leave-one-out identity: e₋ᵢ = (I − Hᵢᵢ)⁻¹ eᵢ with H the hat matrix.
    """
    features = chebyshev_features(orders, table.points)
    normal = features.T @ features + RIDGE * len(features) * np.eye(len(orders))
    lifted = np.linalg.solve(normal, features.T)
    residuals = table.values - features @ (lifted @ table.values)
    out = np.empty_like(residuals)
    for number in np.unique(table.curve):
        rows = np.flatnonzero(table.curve == number)
        hat = features[rows] @ lifted[:, rows]
        out[rows] = np.linalg.solve(np.eye(len(rows)) - hat, residuals[rows])
    return out


def best_orders(
    table: Table, candidates: Sequence[tuple[int, int, int, int]]
) -> tuple[Indices, Floats]:
    """Return the orders whose left-out curves are predicted best, and their residuals."""
    trials = [total_degree_orders(degrees) for degrees in candidates]
    trials = [orders for orders in trials if len(orders) < 0.6 * len(table.points)]
    residuals = [left_out_residuals(orders, table) for orders in trials]
    scores = [float(np.mean(r[:, 0] ** 2)) for r in residuals]
    best = int(np.argmin(scores))
    return trials[best], residuals[best]


def train(
    coarse: tuple[Sequence[Curve], Sequence[CurveSolution]],
    fine: tuple[Sequence[Curve], Sequence[CurveSolution]],
    *,
    box: TrainingBox,
    length: float,
    mesh_error: float,
    record: dict[str, object],
) -> Surrogate:
    """Return a surrogate of the fine mesh: many curves of a coarse one, corrected by few fine ones.

    Parameters
    ----------
    coarse, fine : pair of sequences
        Curves and their solutions on either mesh.
    box : TrainingBox
        Range of the groups.
    length : float
        Length of the actuator as moulded [mm].
    mesh_error : float
        Relative error of the fine mesh itself [–].
    record : dict
        What the design was; accuracy is added to it.
    """
    base = tabulate(*coarse, box=box, length=length)
    orders, _ = best_orders(
        base, [(a, b, c, 4) for a in (6, 8, 10, 12) for b in (4, 6, 8) for c in (4, 6, 8)]
    )
    coefficients = fit(orders, base.points, base.values)
    table = tabulate(*fine, box=box, length=length)
    gap = table.values - chebyshev_features(orders, table.points) @ coefficients.T
    shift = Table(table.points, table.load, gap, table.curve)
    small, left_out = best_orders(
        shift, [(a, b, b, c) for a in (2, 3, 4, 6) for b in (1, 2, 3, 4) for c in (1, 2, 3)]
    )
    correction = fit(small, shift.points, shift.values)
    joint, both = _merge(orders, coefficients, small, correction)
    error_loads, error = _error_by_load(table.load, left_out[:, 0])
    error = np.hypot(error, mesh_error)
    limit_orders, limit_coefficients = _limit(*coarse, box=box)
    accuracy = {
        "model_version": MODEL_VERSION,
        "coarse_curves": len(coarse[0]),
        "fine_curves": len(fine[0]),
        "curves_cut_short": sum(s.status != Status.CONVERGED for s in (*coarse[1], *fine[1])),
        "terms": len(joint),
        "mesh_error_pct": 100.0 * mesh_error,
    }
    record = record | accuracy | _accuracy(left_out[:, 0])
    return Surrogate(
        length,
        box,
        joint,
        both,
        limit_orders,
        limit_coefficients,
        error_loads,
        error,
        json.dumps(record, indent=1),
    )


def _accuracy(left_out: Floats) -> dict[str, object]:
    size = 100.0 * np.abs(left_out)
    return {
        "left_out_rms_pct": float(np.sqrt(np.mean(size**2))),
        "left_out_p95_pct": float(np.quantile(size, 0.95)),
        "left_out_largest_pct": float(np.max(size)),
    }


def _merge(first: Indices, a: Floats, second: Indices, b: Floats) -> tuple[Indices, Floats]:
    """Return the sum of two polynomials as one."""
    joint, where = np.unique(np.vstack([first, second]), axis=0, return_inverse=True)
    total = np.zeros((len(a), len(joint)))
    np.add.at(total.T, where.ravel(), np.hstack([a, b]).T)
    return joint, total


def _error_by_load(load: Floats, residual: Floats, bins: int = 6) -> tuple[Floats, Floats]:
    """Return the root mean square residual in bins of load, to interpolate."""
    edges = np.quantile(load, np.linspace(0.0, 1.0, bins + 1))
    inside = np.clip(np.searchsorted(edges, load, side="right") - 1, 0, bins - 1)
    rms = np.array([np.sqrt(np.mean(residual[inside == k] ** 2)) for k in range(bins)])
    return 0.5 * (edges[:-1] + edges[1:]), rms


def _limit(
    curves: Sequence[Curve], solutions: Sequence[CurveSolution], *, box: TrainingBox
) -> tuple[Indices, Floats]:
    """Fit ln(reach), less two standard errors.

    Of a curve that is smooth to its end only a lower bound is known: such values are raised to
    the fit where that is above the bound, and the fit repeated, until nothing changes.
    """
    points = np.array([unit_groups(curve, box) for curve in curves])
    known = np.array([reach(c, s) for c, s in zip(curves, solutions, strict=True)])
    bound = np.log(1.03 * box.largest_load(points[:, 1]))
    exact = np.isfinite(known)
    target = np.where(exact, np.log(np.where(exact, np.maximum(known, 1e-3), 1.0)), bound)
    orders = total_degree_orders((3, 3, 2))
    for _ in range(200):
        coefficients = fit(orders, points, target[:, None])[0]
        fitted = polynomial(orders, coefficients, points)
        raised = np.where(exact, target, np.maximum(bound, fitted))
        if np.max(np.abs(raised - target)) < 1e-6:
            break
        target = raised
    error = np.std((target - fitted)[exact]) if exact.any() else 0.0
    coefficients[0] -= 2.0 * error
    return orders, coefficients
