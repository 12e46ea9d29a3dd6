"""Fit the terms of an emulator and of its error to solved curves.

Many curves of a coarse mesh give the map, few of a fine mesh its deviation from it. Errors are
those of held-out runs.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import GammaRegressor

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.demand import MEASURES
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import MODEL_VERSION
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.coordinates import coordinates
from bayesdeg.surrogate.design import is_answered, typical
from bayesdeg.surrogate.local import counted_in
from bayesdeg.surrogate.regression import (
    ANGLES,
    DERIVATIVE_WEIGHT,
    EQUIVALENT,
    INSIDE,
    INSIDE_SD,
    LOADS,
    STRETCH,
    WEIBULL,
    Equations,
    Observed,
    Prior,
    compliance_of,
    fit,
    observe,
    observe_force,
    rows_of,
)
from bayesdeg.surrogate.scaling import CAUSES, ONE, Place, TrainingRange, Units
from bayesdeg.surrogate.solutions import ANSWERS
from bayesdeg.surrogate.surrogate import OUTPUTS, FurtherTerms, Surrogate
from bayesdeg.surrogate.terms import N_CHEBYSHEV, Family, Terms, features, stacked

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Solved = tuple[Sequence[Curve], Sequence[PathSamples]]
Learned = dict[Curve, Observed]

# ---- what is fitted with which terms


@dataclass(frozen=True)
class FitPlan:
    """Terms and priors with which outputs are fitted.

    Parameters
    ----------
    outputs : tuple of int
        Outputs fitted together.
    derivatives : bool
        Whether derivatives are used besides values: over a wide range not those of quantiles.
    family, correction : Family
        Terms on the coarse mesh, and of the fine mesh's deviation from it.
    prior, correction_prior : Prior
        Expected decay of their coefficients.
    weight : float
        Weight of a derivative over half of its group's range, relative to a value.
    """

    outputs: tuple[int, ...]
    derivatives: bool
    family: Family
    correction: Family
    prior: Prior
    correction_prior: Prior
    weight: float = DERIVATIVE_WEIGHT


@dataclass(frozen=True)
class FitTerms:
    """Terms with which an emulator is fitted.

    Parameters
    ----------
    plans : tuple of FitPlan
        Plans of ``OUTPUTS``, of ``MEASURES`` and of the load, in order.
    errors : Family
        Terms of the logarithm of squared errors.
    force : FitPlan
        Plan of the force of a held tip.
    """

    plans: tuple[FitPlan, ...]
    errors: Family
    force: FitPlan


POWERS = (3, 3, 1, 4, 2, 1, 2, 4, 4)
NEAR_POWERS = (2, 2, 1, 3, 2, 1, 2, 3, 3)
ONCE = (1, 1, 1, 2, 1, 1, 1, 2, 2)
FIRST = len(CAUSES) * (1,)
NONE = len(CAUSES) * (0,)
FLAT = (0, 0, 0, 0)
# cubic in swelling and material, quadratic in each cause
FAMILY = Family((3, 3, 3, 3), (1, 0, 0, 0), (2, 2, 0, 2, 2, 2, 2, 2, 2))
SMOOTH = Family((10, 6, 6, 5), (6, 4, 4, 3), POWERS, (2, 1, 1, 1))
OF_FINE = Family((4, 2, 2, 2), (2, 1, 1, 1), tuple(min(2, power) for power in POWERS))
SHIFTED = Prior(0.5, 0.4, 0.3, 1e-2)
KINKED = Prior(0.5, 0.4, 0.3, 1e-1)
# chosen by `benchmarks/path_coordinates.py`
_LOADS = FitPlan(
    LOADS,
    True,
    Family((12, 8, 8, 5), (8, 5, 5, 4), POWERS, (4, 2, 2, 2), (1, 1, 1, 1)),
    OF_FINE,
    Prior(0.65, 0.5, 0.5, 1e-3),
    SHIFTED,
)
_ANGLES = replace(
    _LOADS,
    outputs=ANGLES,
    family=Family((10, 6, 6, 4), (6, 4, 4, 3), POWERS, (4, 2, 2, 2), (1, 1, 1, 1)),
)
_STRETCH = FitPlan(
    STRETCH,
    False,
    Family((8, 5, 5, 4), (3, 2, 2, 1), ONCE, FLAT),
    Family((3, 2, 2, 1), (1, 1, 1, 0), ONCE),
    Prior(0.6, 0.45, 0.35, 3e-2),
    KINKED,
)
# with the emulator of a different actuator: the departure is smooth, and few runs suffice
_NEAR = FitPlan(
    ANGLES,
    True,
    Family((6, 4, 4, 4), (3, 2, 2, 2), NEAR_POWERS, (1, 1, 1, 1)),
    Family((3, 2, 2, 2), (1, 1, 1, 1), FIRST),
    Prior(0.6, 0.5, 0.4, 3e-3),
    SHIFTED,
)
_NEAR_STRETCH = replace(
    _STRETCH,
    family=Family((3, 2, 2, 2), (1, 1, 1, 0), ONCE),
    correction=Family((2, 1, 1, 1), FLAT, ONCE),
)
# without one: a whole curve needs more orders in the swelling, and the part of the material range
# used by one study needs few
_ALONE = replace(
    _NEAR,
    family=Family((12, 4, 4, 3), (7, 2, 2, 2), NEAR_POWERS, (3, 1, 1, 1)),
    prior=Prior(0.8, 0.5, 0.5, 3e-3),
)
_ALONE_STRETCH = replace(
    _NEAR_STRETCH,
    family=Family((8, 2, 2, 2), (3, 1, 1, 1), ONCE),
    prior=Prior(0.7, 0.45, 0.35, 1e-2),
)


def like(angles: FitPlan, stretch: FitPlan) -> tuple[FitPlan, ...]:
    """Return plans of all outputs: equivalents like the stretch, all others like angles."""
    return (
        *(angles, stretch),
        *(replace(angles, outputs=WEIBULL), replace(stretch, outputs=EQUIVALENT)),
        replace(angles, outputs=LOADS),
    )


PLANS = (
    *(_ANGLES, _STRETCH),
    # corners dominate and differ on the coarse mesh: the deviation from it has as many terms
    FitPlan(WEIBULL, True, SMOOTH, SMOOTH, _ANGLES.prior, Prior(0.6, 0.45, 0.35, 1e-2)),
    replace(_STRETCH, outputs=EQUIVALENT),
    _LOADS,
)
WHOLE = FitTerms(PLANS, FAMILY, replace(_LOADS, outputs=(0,)))
NEAR = FitTerms(
    like(_NEAR, _NEAR_STRETCH), Family((1, 0, 0, 0), FLAT, NONE), replace(_ALONE, outputs=(0,))
)
BY_ITSELF = replace(NEAR, plans=like(_ALONE, _ALONE_STRETCH))

# ---- errors

SMALLEST = 2e-4  # relative error attributed to rounding of the path
PENALTY = 1e-3
# weight of runs by how close their material is to those of studies: scale in standard deviations,
# and smallest weight
REACH, LEAST = 2.0, 0.02
NARROWEST = 1e-6  # least spread of materials, of half the range: keeps the covariance invertible


def fit_errors(points: Floats, left_out: Floats, weights: Floats, family: Family = FAMILY) -> Terms:
    """Return ln of the squared relative errors as terms.

    Their mean square is fitted by a gamma regression; the level is then set so that nine tenths of
    the errors lie within the 90 % interval of a normal law.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    left_out : array, shape (n, n_outputs)
        Relative errors of held-out runs [–].
    weights : array, shape (n,)
        Weight of each, see ``nearness``.
    family : Family
        Family of the terms.
    """
    orders = family.orders
    matrix = features(orders, points)
    coefficients = []
    for column in left_out.T:
        squares = np.maximum(column**2, SMALLEST**2)
        scale = float(np.average(squares, weights=weights))
        model = GammaRegressor(alpha=PENALTY, max_iter=2000, tol=1e-6)
        model.fit(matrix[:, 1:], squares / scale, sample_weight=weights)
        level = np.concatenate([[model.intercept_ + np.log(scale)], model.coef_])
        spread = np.sqrt(squares) / np.exp(0.5 * matrix @ level)
        order = np.argsort(spread)
        total = np.cumsum(weights[order])
        inside = float(spread[order][np.searchsorted(total, INSIDE * total[-1])])
        level[0] += 2.0 * np.log(inside / INSIDE_SD)
        coefficients.append(level)
    return Terms(orders, np.array(coefficients))


def nearness(points: Floats, usual: Floats) -> Floats:
    """Return exp(−d²/8) + 0.02 with d the distance from usual materials, (n,).

    d is the Mahalanobis distance, with the mean and covariance of the usual materials. The error is
    then accurate where the emulator is used, and conservative near the edges of the range.

    Parameters
    ----------
    points : array, shape (n, 13)
        Coordinates.
    usual : array, shape (m, 13)
        Coordinates of materials typical of studies.
    """
    material = slice(1, N_CHEBYSHEV)
    centre, spread = usual[:, material].mean(axis=0), np.cov(usual[:, material].T)
    spread += NARROWEST**2 * np.eye(len(spread))
    away = points[:, material] - centre
    square = np.einsum("ni,ij,nj->n", away, np.linalg.inv(spread), away)
    near: Floats = np.exp(-0.5 * square / REACH**2) + LEAST
    return near


def coverage(errors: Terms, points: Floats, left_out: Floats) -> list[float]:
    """Return the share of errors within the 90 % interval, one per output."""
    sd = np.exp(0.5 * features(errors.orders, points) @ errors.coefficients.T)
    within = np.abs(left_out) <= INSIDE_SD * sd
    return [float(share) for share in within.mean(axis=0)]


def summary(worst: Sequence[float]) -> dict[str, float]:
    """Return rms, 95th percentile and maximum of errors, one per curve [%]."""
    size = 100.0 * np.abs(np.asarray(worst, dtype=np.float64))
    if len(size) == 0:
        return {}
    return {
        "rms_pct": float(np.sqrt(np.mean(size**2))),
        "median_pct": float(np.median(size)),
        "p95_pct": float(np.quantile(size, 0.95)),
        "max_pct": float(np.max(size)),
    }


def summed(*parts: Terms) -> Terms:
    """Return the sum of several terms of the same outputs."""
    orders = np.vstack([part.orders for part in parts])
    return stacked([Terms(orders, np.hstack([part.coefficients for part in parts]))])


# ---- training


@dataclass(frozen=True)
class Trained:
    """The fit of some outputs, and its errors at held-out runs.

    Parameters
    ----------
    terms : Terms
        Terms of both meshes together.
    points : array, shape (n, 13)
        Coordinates of the errors.
    left_out : array, shape (n, n_outputs)
        Relative errors at held-out runs.
    """

    terms: Terms
    points: Floats
    left_out: Floats


def learned(runs: Solved, span: TrainingRange, length: float, compliance: float) -> Learned:
    """Return the usable data of the runs of a mesh; see `regression.observe`.

    Raises
    ------
    BayesdegError
        If no run is usable.
    """
    found = {
        curve: run
        for curve, solved in zip(*runs, strict=True)
        if is_answered(curve, span)
        and (run := observe(curve, solved, length=length, compliance=compliance)) is not None
    }
    if not found:
        raise BayesdegError(
            "no curve of a mesh has enough equilibria for training: the study hardly bends its "
            "actuator; check pressures and priors"
        )
    return found


def train(
    coarse: Solved,
    fine: Solved,
    *,
    span: TrainingRange,
    length: float,
    mesh_error: float,
    record: dict[str, object],
    terms: FitTerms = WHOLE,
    usual: Sequence[Curve] = (),
    ground: Surrogate | None = None,
    units: Units = ONE,
) -> Surrogate:
    """Train an emulator of the fine mesh.

    Parameters
    ----------
    coarse, fine : pair of sequences
        Curves and their solutions on either mesh; the fine curves are among the coarse ones.
    span : TrainingRange
        Range of load and groups.
    length : float
        Length of the actuator as moulded [mm].
    mesh_error : float
        Relative error of the fine mesh itself [–].
    record : dict
        Description of the design; accuracy is added to it.
    terms : FitTerms
        Terms of the fit; by default those of the whole range.
    usual : sequence of Curve, optional
        Curves of materials at which the error is most accurate; by default those of studies.
    ground : Surrogate, optional
        An emulator of a different actuator: only the departure from it is fitted.
    units : Units
        Units of load and paper in the span; curves and samples are in units of 1.
    """
    coarse, fine = (counted(*runs, units) for runs in (coarse, fine))
    compliance = compliance_of(zip(*coarse, strict=True), length)
    many, few = (learned(runs, span, length, compliance) for runs in (coarse, fine))
    met = _material_points([counted_in(c, units) for c in usual] or typical(span, USUAL, seed=0))
    if not usual:
        many, few = ({c: _weighed(run, met) for c, run in runs.items()} for runs in (many, few))
    parts = [_train(many, few, plan, terms_below(ground, plan)) for plan in terms.plans]
    errors = [_error_of(part, met, terms) for part in parts]
    covered = [
        share
        for part, error in zip(parts, errors, strict=True)
        for share in coverage(error, part.points, part.left_out)
    ]
    worst = worst_errors(few.values(), np.hstack([part.left_out for part in parts]))
    accuracy = {
        name: summary(list(column)) | {"coverage_90": share}
        for name, column, share in zip((*OUTPUTS, *MEASURES, "load"), worst.T, covered, strict=True)
    }
    n = sum(max(plan.outputs) < len(OUTPUTS) for plan in terms.plans)  # the others are of MEASURES
    outputs = stacked([part.terms for part in parts[:n]])
    facts = {
        "model_version": MODEL_VERSION,
        "coarse_curves": len(coarse[0]),
        "fine_curves": len(fine[0]),
        "curves_cut_short": sum(one.status not in ANSWERS for one in (*coarse[1], *fine[1])),
        "terms": len(outputs.orders) + len(parts[-1].terms.orders),
        "mesh_error_pct": 100.0 * mesh_error,
        "accuracy": accuracy,
    }
    return Surrogate(
        length=length,
        compliance=compliance,
        span=span,
        load=parts[-1].terms,
        load_error=errors[-1],
        terms=outputs,
        error=stacked(errors[:n]),
        strains=stacked([part.terms for part in parts[n:-1]]),
        strain_error=stacked(errors[n:-1]),
        mesh_error=mesh_error,
        record=json.dumps(record | facts, indent=1),
        units=units,
    )


def _weighed(run: Observed, usual: Floats) -> Observed:
    """Return a run that counts the less, the farther it is from usual materials."""
    near = float(nearness(run.coordinates.points[:1], usual)[0])
    return replace(run, importance=np.sqrt(near))


USUAL = 128  # curves typical of studies, at whose materials errors are most accurate


def worst_errors(runs: Iterable[Observed], left_out: Floats) -> Floats:
    """Return the largest error of each run and output at a given load, over its largest value.

    Outputs at a given swelling err by e, and the load by e_q: at a given load together by
    e − e_q d ln κ/d ln q. They count up to `TO` of the largest load.

    Parameters
    ----------
    runs : iterable of Observed
        The runs.
    left_out : array, shape (n, n_outputs)
        Errors of all their readings, in turn; those of the load come last.
    """
    worst, first = [], 0
    for run in runs:
        errors = left_out[first : (first := first + len(run.load))].copy()
        with np.errstate(invalid="ignore"):
            errors[:, :-1] -= run.growth[:, None] * errors[:, -1:]
        errors[:, :-1] *= run.weights[:, None]
        worst.append(np.max(np.abs(errors[run.before_limit]), axis=0, initial=0.0))
    return np.array(worst)


def _error_of(part: Trained, met: Floats, chosen: FitTerms) -> Terms:
    """Return ln of the squared relative errors of a fit as terms."""
    return fit_errors(part.points, part.left_out, nearness(part.points, met), chosen.errors)


def with_forces(
    surrogate: Surrogate,
    coarse: Solved,
    fine: Solved,
    *,
    usual: Sequence[Curve],
    terms: FitTerms,
) -> Surrogate:
    """Return an emulator that also predicts the blocked tip force.

    It is fitted to curves with the tip held; the error is most accurate at the ``usual`` ones.

    Raises
    ------
    BayesdegError
        If no curve is usable for the force.
    """
    units, span = surrogate.units, surrogate.span
    many, few = (
        {
            curve: run
            for curve, solved in zip(*counted(*runs, units), strict=True)
            if is_answered(curve, span)
            and (run := observe_force(curve, solved, length=surrogate.length))
        }
        for runs in (coarse, fine)
    )
    if not (many and few):
        raise BayesdegError("no curve with the tip held has enough equilibria for training")
    met = _material_points([counted_in(curve, units) for curve in usual])
    part, record = _train(many, few, terms.force), json.loads(surrogate.record)
    error = _error_of(part, met, terms)
    ends = np.cumsum([len(run.load) for run in few.values()])[:-1]
    of_runs = np.split(part.left_out[:, 0], ends)
    worst = [
        float(np.max(np.abs(run.weights * missed)))
        for run, missed in zip(few.values(), of_runs, strict=True)
    ]
    share = coverage(error, part.points, part.left_out)[0]
    record["accuracy"]["tip_force"] = summary(worst) | {"coverage_90": share}
    force = FurtherTerms(part.terms, error)
    return replace(surrogate, force=force, record=json.dumps(record, indent=1))


def counted(
    curves: Sequence[Curve], samples: Sequence[PathSamples], units: Units
) -> tuple[list[Curve], list[PathSamples]]:
    """Return curves and solutions with load and paper in different units."""
    size = np.ones(len(INPUTS))
    size[INPUTS.index("load")], size[INPUTS.index("paper_group")] = units.load, units.paper
    return [counted_in(curve, units) for curve in curves], [
        replace(
            one,
            loads=one.loads / units.load,
            gradients=one.gradients * size,
            limit_load=one.limit_load / units.load,
        )
        for one in samples
    ]


def _material_points(curves: Sequence[Curve]) -> Floats:
    """Return coordinates of the materials of curves, without a load, (n, 13)."""
    places = np.array([Place.of(curve.material).values for curve in curves])
    return coordinates(np.column_stack([np.zeros(len(places)), places])).points


def terms_below(ground: Surrogate | None, plan: FitPlan) -> tuple[Terms, ...]:
    """Return an emulator's terms for the outputs of a plan; none without an emulator."""
    if ground is None:
        return ()
    if plan.outputs == LOADS:
        return (ground.load,)
    table, first = ground.terms, 0
    if min(plan.outputs) >= len(OUTPUTS):
        table, first = ground.strains, len(OUTPUTS)
    coefficients = table.coefficients[[k - first for k in plan.outputs]]
    there = np.any(coefficients != 0.0, axis=0)
    return (Terms(table.orders[there], coefficients[:, there]),)


def _train(many: Learned, few: Learned, plan: FitPlan, below: tuple[Terms, ...] = ()) -> Trained:
    """Fit the departure of the coarse mesh from the ground, and of the fine one from both."""

    def coarse(run: Observed) -> Equations:
        return gap_of(run, plan.family, below, plan)

    base = fit(
        map(coarse, many.values()), plan.family.orders, plan.prior, outputs=len(plan.outputs)
    )
    under = (*below, Terms(base.orders, base.coefficients))
    gaps = {curve: gap_of(run, plan.correction, under, plan) for curve, run in few.items()}
    shift = fit(
        gaps.values(), plan.correction.orders, plan.correction_prior, outputs=len(plan.outputs)
    )
    points, left_out = [], []
    for curve, run in few.items():
        gap = gaps[curve]
        error = (gap.targets - gap.matrix @ shift.without(gap).T)[: gap.n_values]
        if curve in many:  # hold out the coarse twin too
            change = base.without(coarse(many[curve])) - base.coefficients
            rows = _rows(run, base.orders, plan)
            error = error - (rows.matrix @ change.T)[: len(error)]
        points.append(run.coordinates.points)
        left_out.append(error / run.weights_of(plan.outputs)[:, None])
    terms = summed(*under, Terms(shift.orders, shift.coefficients))
    return Trained(terms, np.vstack(points), np.vstack(left_out))


def _rows(run: Observed, orders: Indices, plan: FitPlan) -> Equations:
    outputs = list(plan.outputs)
    return rows_of(run, orders, outputs=outputs, derivatives=plan.derivatives, weight=plan.weight)


def gap_of(run: Observed, family: Family, below: Sequence[Terms], plan: FitPlan) -> Equations:
    """Return the equations of a run for its deviation from a sum of terms."""
    part = _rows(run, family.orders, plan)
    targets = part.targets
    for terms in below:
        rows = _rows(run, terms.orders, plan)
        targets = targets - rows.matrix @ terms.coefficients.T
    return Equations(part.matrix, targets, part.n_values)
