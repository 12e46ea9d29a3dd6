"""Solved runs to a surrogate, with its own error and how far its curves go."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls
from scipy.stats import norm
from sklearn.linear_model import GammaRegressor

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.status import MODEL_VERSION, Status
from bayesdeg.emulator.coordinates import LARGEST_WARPED, SLACK, coordinates, scaled_cause
from bayesdeg.emulator.design import is_answered, likely
from bayesdeg.emulator.regression import (
    Fit,
    Observed,
    Prior,
    Reach,
    Rows,
    fit,
    observe,
    reach,
    rows_of,
)
from bayesdeg.emulator.scaling import Place, TrainingRange
from bayesdeg.emulator.surrogate import OUTPUTS, Surrogate
from bayesdeg.emulator.terms import N_CHEBYSHEV, Family, Terms, features, stacked

Floats = NDArray[np.float64]

# cubic in load and material, quadratic in each cause
FAMILY = Family((3, 3, 3, 3), (1, 0, 0, 0), (2, 2, 0, 2, 2, 2, 2, 2, 2))
SMALLEST = 2e-4  # relative error that is taken for rounding of the path
PENALTY = 1e-3
INSIDE = 0.9
# runs count by how near their material is to those that studies meet: over how many standard
# deviations, and how much at least
REACH, LEAST = 2.0, 0.02


def fit_errors(points: Floats, left_out: Floats, weights: Floats) -> Terms:
    """Return ln of the squared relative errors as terms.

    Their mean square is fitted by a gamma regression; then its level is set so that nine tenths
    of the errors lie within the 90 % interval of a normal law.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    left_out : array, shape (n, n_outputs)
        Relative errors of runs left out [–].
    weights : array, shape (n,)
        How much each counts, see ``nearness``.
    """
    orders = FAMILY.orders
    matrix = features(orders, points)
    coefficients = []
    for column in left_out.T:
        squares = np.maximum(column**2, SMALLEST**2)
        scale = float(np.average(squares, weights=weights))
        model = GammaRegressor(alpha=PENALTY, max_iter=2000, tol=1e-6)
        model.fit(matrix[:, 1:], squares / scale, sample_weight=weights)
        level = np.concatenate([[model.intercept_ + np.log(scale)], model.coef_])
        spread = np.sqrt(squares) / np.exp(0.5 * matrix @ level)
        inside = _weighted_quantile(spread, weights, INSIDE)
        level[0] += 2.0 * np.log(inside / norm.ppf(0.5 * (1.0 + INSIDE)))
        coefficients.append(level)
    return Terms(orders, np.array(coefficients))


def nearness(points: Floats, usual: Floats) -> Floats:
    """Return exp(−d²/8) + 0.02 with d the distance from usual materials, (n,).

    d is Mahalanobis's, over the mean and the covariance of the usual ones. So the error is known
    best where it is asked for, and next to the edges of the range it is rather too large.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    usual : array, shape (m, 13)
        Coordinates of materials that studies meet.
    """
    material = slice(1, N_CHEBYSHEV)
    centre, spread = usual[:, material].mean(axis=0), np.cov(usual[:, material].T)
    away = points[:, material] - centre
    square = np.einsum("ni,ij,nj->n", away, np.linalg.inv(spread), away)
    near: Floats = np.exp(-0.5 * square / REACH**2) + LEAST
    return near


def _weighted_quantile(values: Floats, weights: Floats, share: float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, share * total[-1])])


def coverage(errors: Terms, points: Floats, left_out: Floats) -> list[float]:
    """Return which share of errors lies within the 90 % interval, one an output."""
    sd = np.exp(0.5 * features(errors.orders, points) @ errors.coefficients.T)
    within = np.abs(left_out) <= norm.ppf(0.5 * (1.0 + INSIDE)) * sd
    return [float(share) for share in within.mean(axis=0)]


def summary(worst: Sequence[float]) -> dict[str, float]:
    """Return rms, 95th percentile and largest of errors, one a curve [%]."""
    size = 100.0 * np.abs(np.asarray(worst, dtype=np.float64))
    if len(size) == 0:
        return {}
    return {
        "rms_pct": float(np.sqrt(np.mean(size**2))),
        "median_pct": float(np.median(size)),
        "p95_pct": float(np.quantile(size, 0.95)),
        "max_pct": float(np.max(size)),
    }


LIMIT_FAMILY = Family((0, 5, 5, 3), (0, 2, 2, 2), (2, 2, 1, 2, 2, 1, 2, 3, 3), (0, 1, 1, 1))
PRIOR = Prior(material=0.35, cause=0.25, noise=2e-2)
# the standard error grows with the square of each cause
ERRORS = Family((0, 0, 0, 0), (0, 0, 0, 0), 9 * (2,))
ROUNDS = 200
FOLDS = 10


@dataclass(frozen=True)
class Limit:
    """A fitted limit.

    Parameters
    ----------
    terms : Terms
        ln of the warped load, and its standard error.
    left_out : array
        Errors of the logarithm at runs left out whose limit is known [–].
    """

    terms: Terms
    left_out: Floats


def fit_limit(reaches: Sequence[Reach], span: TrainingRange, fine: Sequence[Reach] = ()) -> Limit:
    """Fit ln of the warped load of the reach.

    Many runs of a coarse mesh give the shape; how much earlier or later those of the ``fine`` mesh
    end, in the median, shifts it.

    Of a curve that is smooth to its end only a lower bound is known: such values are raised to
    the fit where that is above the bound, and the fit repeated, until nothing changes.
    """
    points, known, bounded = _table([r for r in reaches if r.load > 0.0], span)
    orders = LIMIT_FAMILY.orders
    scales = PRIOR.scales(orders)
    matrix = features(orders, points) * scales
    left_out = np.empty_like(known)
    for fold in range(FOLDS):
        out = np.arange(len(known)) % FOLDS == fold
        left_out[out] = known[out] - matrix[out] @ _fit(matrix[~out], known[~out], bounded[~out])
    best = Terms(orders, (scales * _fit(matrix, known, bounded))[None])
    best.coefficients[0, 0] += _shift(best, [r for r in fine if r.load > 0.0 and not r.open], span)
    errors = _errors(points[~bounded], left_out[~bounded])
    return Limit(stacked([best, errors]), left_out[~bounded])


def _shift(best: Terms, ended: Sequence[Reach], span: TrainingRange) -> float:
    """Return the median of ln(reach) less the fit at runs whose end is known; 0 if there are none.

    The first term is the constant.
    """
    if not ended:
        return 0.0
    points, known, _ = _table(ended, span)
    return float(np.median(known - features(best.orders, points) @ best.coefficients[0]))


def _fit(matrix: Floats, known: Floats, bounded: NDArray[np.bool_]) -> Floats:
    """Return scaled coefficients; a bounded value is raised to the fit where that is above it."""
    bound = np.minimum(known + 0.03, np.log(1.1 * LARGEST_WARPED))
    normal = matrix.T @ matrix + PRIOR.noise**2 * np.eye(matrix.shape[1])
    factor = cho_factor(normal)
    target = np.where(bounded, bound, known)
    for _ in range(ROUNDS):
        coefficients: Floats = cho_solve(factor, matrix.T @ target)
        raised = np.where(bounded, np.maximum(bound, matrix @ coefficients), known)
        if np.max(np.abs(raised - target)) < 1e-6:
            break
        target = raised
    return coefficients


def _table(
    reaches: Sequence[Reach], span: TrainingRange
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return coordinates without the load, ln of the warped load, and where it is a bound."""
    groups = np.column_stack([[r.load for r in reaches], [r.groups for r in reaches]])
    place = coordinates(groups, span)
    points = place.points.copy()
    points[:, 0] = 0.0
    points[:, SLACK], _ = scaled_cause("paper_slack", groups[:, SLACK])
    return points, np.log(groups[:, 0]) + place.warp, np.array([r.open for r in reaches])


def _errors(points: Floats, left_out: Floats) -> Terms:
    """Return the standard error as a constant and a part for the square of each cause, none < 0."""
    orders = ERRORS.orders
    even = orders[np.all(orders % 2 == 0, axis=1)]
    matrix = features(even, points)
    # the mean size of a normal error is √(2/π) of its standard deviation
    parts, _ = nnls(matrix, np.abs(left_out) * np.sqrt(0.5 * np.pi))
    return Terms(even, parts[None])


ANGLES = (0, 1)  # curvature and bend angle: smooth, fitted with their derivatives
STRETCH = (2,)  # a quantile over points, whose derivatives jump: fitted by its values


@dataclass(frozen=True)
class Plan:
    """With which terms, and how strongly expected to fall, the outputs are fitted.

    Parameters
    ----------
    outputs : tuple of int
        Fitted together.
    derivatives : bool
        Whether derivatives are used beside values.
    family, correction : Family
        Terms on the coarse mesh, and of the fine mesh's deviation from it.
    prior, correction_prior : Prior
        How fast their coefficients fall.
    """

    outputs: tuple[int, ...]
    derivatives: bool
    family: Family
    correction: Family
    prior: Prior
    correction_prior: Prior


POWERS = (3, 3, 1, 4, 2, 1, 2, 4, 4)
ONCE = (1, 1, 1, 2, 1, 1, 1, 2, 2)
PLANS = (
    Plan(
        ANGLES,
        True,
        Family((12, 8, 8, 5), (8, 5, 5, 4), POWERS, (4, 2, 2, 2), (1, 1, 1, 1)),
        Family((6, 4, 4, 4), (3, 2, 2, 2), ONCE, (1, 1, 1, 0)),
        Prior(0.65, 0.5, 0.5, 1e-2),
        Prior(0.5, 0.4, 0.3, 5e-2),
    ),
    Plan(
        STRETCH,
        False,
        Family((8, 5, 5, 4), (3, 2, 2, 1), ONCE, (0, 0, 0, 0)),
        Family((3, 2, 2, 1), (1, 1, 1, 0), ONCE),
        Prior(0.6, 0.45, 0.35, 3e-2),
        Prior(0.5, 0.4, 0.3, 1e-1),
    ),
)


@dataclass(frozen=True)
class Trained:
    """The fit of some outputs, and how it does at runs left out.

    Parameters
    ----------
    terms : Terms
        Both meshes' together.
    points : array, shape (n, 13)
        Where it was judged.
    left_out : array, shape (n, n_outputs)
        Relative errors of runs left out.
    worst : array, shape (n_fine, n_outputs)
        Largest error of each fine run left out, over its largest value [–].
    """

    terms: Terms
    points: Floats
    left_out: Floats
    worst: Floats


def train(
    coarse: tuple[Sequence[Curve], Sequence[PathSamples]],
    fine: tuple[Sequence[Curve], Sequence[PathSamples]],
    *,
    span: TrainingRange,
    length: float,
    mesh_error: float,
    record: dict[str, object],
    plans: Sequence[Plan] = PLANS,
) -> Surrogate:
    """Return a surrogate of the fine mesh.

    Parameters
    ----------
    coarse, fine : pair of sequences
        Curves and what was solved of them on either mesh; the fine curves are among the coarse.
    span : TrainingRange
        Range of load and groups.
    length : float
        Length of the actuator as moulded [mm].
    mesh_error : float
        Relative error of the fine mesh itself [–].
    record : dict
        What the design was; accuracy is added to it.
    plans : sequence of Plan
        Terms of the outputs, in their order.
    """
    many, few = (_observed(*runs, span=span, length=length) for runs in (coarse, fine))
    parts = [_train(many, few, plan, span) for plan in plans]
    ends, fine_ends = (
        [reach(c, s) for c, s in zip(*runs, strict=True) if is_answered(c, span)]
        for runs in (coarse, fine)
    )
    limit = fit_limit(ends, span, fine_ends)
    usual = _material_points(likely(span), span)
    errors = [
        fit_errors(part.points, part.left_out, nearness(part.points, usual)) for part in parts
    ]
    covered = [
        share
        for part, error in zip(parts, errors, strict=True)
        for share in coverage(error, part.points, part.left_out)
    ]
    accuracy = _accuracy(parts, limit, covered)
    facts = {
        "model_version": MODEL_VERSION,
        "coarse_curves": len(coarse[0]),
        "fine_curves": len(fine[0]),
        "curves_cut_short": sum(s.status != Status.CONVERGED for s in (*coarse[1], *fine[1])),
        "terms": len(stacked([part.terms for part in parts]).orders),
        "mesh_error_pct": 100.0 * mesh_error,
        "accuracy": accuracy,
    }
    return Surrogate(
        length=length,
        span=span,
        terms=stacked([part.terms for part in parts]),
        error=stacked(errors),
        limit=limit.terms,
        mesh_error=mesh_error,
        record=json.dumps(record | facts, indent=1),
    )


def _observed(
    curves: Sequence[Curve], samples: Sequence[PathSamples], *, span: TrainingRange, length: float
) -> dict[Curve, Observed]:
    """Return what each run says, without those that say nothing."""
    found = {
        curve: observe(curve, solved, span=span, length=length)
        for curve, solved in zip(curves, samples, strict=True)
        if is_answered(curve, span)
    }
    return {curve: run for curve, run in found.items() if run is not None}


def _material_points(curves: Sequence[Curve], span: TrainingRange) -> Floats:
    """Return coordinates of the materials of curves, without a load, (n, 13)."""
    places = np.array([Place.of(curve.material).values for curve in curves])
    return coordinates(np.column_stack([np.zeros(len(places)), places]), span).points


def _train(
    many: dict[Curve, Observed], few: dict[Curve, Observed], plan: Plan, span: TrainingRange
) -> Trained:
    orders, small = plan.family.orders, plan.correction.orders
    base = fit(
        (_rows(run, plan.family, plan, span) for run in many.values()),
        orders,
        plan.prior,
        outputs=len(plan.outputs),
    )
    gaps = {curve: _gap(run, base, plan, span) for curve, run in few.items()}
    shift = fit(gaps.values(), small, plan.correction_prior, outputs=len(plan.outputs))
    points, left_out, worst = [], [], []
    for curve, run in few.items():
        error = _left_out(run, many.get(curve), gaps[curve], base, shift, plan, span)
        worst.append(np.max(np.abs(error), axis=0))
        points.append(run.coordinates.points)
        left_out.append(error / run.weights[:, None])
    terms = stacked(
        [
            Terms(
                np.vstack([orders, small]),
                np.hstack([base.coefficients, shift.coefficients]),
            )
        ]
    )
    return Trained(terms, np.vstack(points), np.vstack(left_out), np.array(worst))


def _rows(run: Observed, family: Family, plan: Plan, span: TrainingRange) -> Rows:
    return rows_of(
        run, family.orders, outputs=list(plan.outputs), span=span, derivatives=plan.derivatives
    )


def _gap(run: Observed, base: Fit, plan: Plan, span: TrainingRange) -> Rows:
    """Return the equations of a fine run for its deviation from the coarse mesh's fit."""
    whole = _rows(run, plan.family, plan, span)
    part = _rows(run, plan.correction, plan, span)
    return Rows(part.matrix, whole.targets - whole.matrix @ base.coefficients.T, part.n_values)


def _left_out(
    run: Observed,
    twin: Observed | None,
    gap: Rows,
    base: Fit,
    shift: Fit,
    plan: Plan,
    span: TrainingRange,
) -> Floats:
    """Return the weighted errors of a fine run left out, together with its coarse twin."""
    error = (gap.targets - gap.matrix @ shift.without(gap).T)[: gap.n_values]
    if twin is None:
        return error
    change = base.without(_rows(twin, plan.family, plan, span)) - base.coefficients
    whole = _rows(run, plan.family, plan, span)
    return error - (whole.matrix @ change.T)[: gap.n_values]


def _accuracy(
    parts: Sequence[Trained], limit: Limit, covered: Sequence[float]
) -> dict[str, dict[str, float]]:
    """Return errors at runs left out: of each curve the largest, over its largest value."""
    worst = np.hstack([part.worst for part in parts])
    found = {
        name: summary(list(column)) | {"coverage_90": share}
        for name, column, share in zip(OUTPUTS, worst.T, covered, strict=True)
    }
    return found | {"limit": summary(list(limit.left_out))}
