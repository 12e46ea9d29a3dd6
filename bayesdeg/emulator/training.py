"""Solved runs to a surrogate: many of a coarse mesh, corrected by few of a fine one."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.status import Status
from bayesdeg.actuator.version import MODEL_VERSION
from bayesdeg.emulator.coordinates import coordinates
from bayesdeg.emulator.design import is_answered, likely
from bayesdeg.emulator.errors_of_fit import coverage, fit_errors, nearness, summary
from bayesdeg.emulator.families import Family
from bayesdeg.emulator.limits import Limit, fit_limit
from bayesdeg.emulator.observations import Observed, observe, reach
from bayesdeg.emulator.regression import Fit, Prior, Rows, fit, rows_of
from bayesdeg.emulator.scaling import Place, TrainingRange
from bayesdeg.emulator.surrogate import OUTPUTS, Surrogate
from bayesdeg.emulator.terms import Terms, stacked

Floats = NDArray[np.float64]

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
