"""Run finite element campaigns on any executor; stored solutions are never solved again."""

import json
import os
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field, replace
from math import inf
from typing import NamedTuple, NotRequired, TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls
from scipy.stats import norm
from sklearn.linear_model import GammaRegressor
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Curve, PathSamples, with_layer
from bayesdeg.actuator.demand import MEASURES, WEIBULL_MODULI
from bayesdeg.actuator.inputs import Asked
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import MODEL_VERSION, Backend, Status
from bayesdeg.emulator.coordinates import LARGEST_WARPED, SLACK, coordinates, scaled_cause
from bayesdeg.emulator.departure_training import (
    MovedCurve,
    departed,
    end_of,
    fit_departure,
    load_shift,
)
from bayesdeg.emulator.design import (
    SHARES,
    is_answered,
    likely,
    second_stage,
    space_filling,
    third_stage,
)
from bayesdeg.emulator.kept import (
    FIT_VERSION,
    Recipe,
    has_ground,
    mesh_error_of,
    refuse_whole_range,
)
from bayesdeg.emulator.local import LocalDesign, counted_in
from bayesdeg.emulator.regression import (
    DERIVATIVE_WEIGHT,
    STEEPEST,
    Equations,
    Observed,
    Prior,
    Reach,
    Regression,
    fit,
    half_ranges,
    observe,
    observe_force,
    reach,
    rows_of,
)
from bayesdeg.emulator.scaling import CAUSES, NAMES, ONE, Place, TrainingRange, Units
from bayesdeg.emulator.solutions import Kind, Run, Solution, SolutionStore
from bayesdeg.emulator.surrogate import OUTPUTS, FurtherTerms, Surrogate
from bayesdeg.emulator.terms import (
    N_CHEBYSHEV,
    Family,
    Terms,
    feature_gradients,
    features,
    stacked,
)
from bayesdeg.emulator.trained import default_surrogate
from bayesdeg.emulator.workers import Supervised, solve
from bayesdeg.errors import BayesdegError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

# cubic in load and material, quadratic in each cause
FAMILY = Family((3, 3, 3, 3), (1, 0, 0, 0), (2, 2, 0, 2, 2, 2, 2, 2, 2))
SMALLEST = 2e-4  # relative error attributed to rounding of the path
PENALTY = 1e-3
INSIDE = 0.9
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
        inside = _weighted_quantile(spread, weights, INSIDE)
        level[0] += 2.0 * np.log(inside / norm.ppf(0.5 * (1.0 + INSIDE)))
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


def _weighted_quantile(values: Floats, weights: Floats, share: float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, share * total[-1])])


def coverage(errors: Terms, points: Floats, left_out: Floats) -> list[float]:
    """Return the share of errors within the 90 % interval, one per output."""
    sd = np.exp(0.5 * features(errors.orders, points) @ errors.coefficients.T)
    within = np.abs(left_out) <= norm.ppf(0.5 * (1.0 + INSIDE)) * sd
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


LIMIT_FAMILY = Family((0, 5, 5, 3), (0, 2, 2, 2), (2, 2, 1, 2, 2, 1, 2, 3, 3), (0, 1, 1, 1))
PRIOR = Prior(material=0.35, cause=0.25, noise=2e-2)
# the standard error grows with the square of each cause
ERRORS = Family((0, 0, 0, 0), (0, 0, 0, 0), 9 * (2,))
# standard error of the fine mesh's ln(reach) if none of its curves was seen to end: for a soft
# 60 mm pneunet, with elements of 3 and 1.4 mm, two curves end 0.5 % later
UNKNOWN_SHIFT = 0.005
UNKNOWN_LIMIT = 0.05  # standard error of ln(reach) if no curve of an actuator was seen to end
# required errors per part of that standard error: for one study a dozen curves end, and an error of
# 0.3 of ln(reach) was stated where paper was a seventh thinner than nominal
ERRORS_FOR_PARTS = 8
ROUNDS, HALVINGS = 200, 12  # maximum Newton steps, and halvings of one
FOLDS = 10


@dataclass(frozen=True)
class FittedLimit:
    """A fitted limit.

    Parameters
    ----------
    terms : Terms
        ln of the warped load, and its standard error.
    left_out : array
        Errors of the logarithm at held-out runs with a known limit [–].
    """

    terms: Terms
    left_out: Floats


def fit_limit(
    reaches: Sequence[Reach],
    fine: Sequence[Reach] = (),
    *,
    family: Family = LIMIT_FAMILY,
    ground: Terms | None = None,
) -> FittedLimit:
    """Fit ln of the warped load of the reach, or its departure from that of ``ground``.

    Many runs of a coarse mesh give the shape; the median difference of the ``fine`` mesh's ends
    shifts it.

    A curve smooth to its end gives only a lower bound, which counts where the fit lies below it.
    """
    points, known, bounded = _table([r for r in reaches if r.load > 0.0])
    orders = family.orders
    scales = PRIOR.scales(orders)
    matrix = features(orders, points) * scales
    below = 0.0 * known if ground is None else _at(ground, points)
    bound = np.minimum(known + 0.03, np.log(1.1 * LARGEST_WARPED)) - below
    gaps, left_out = known - below, np.empty_like(known)
    for fold in range(FOLDS):
        out = np.arange(len(known)) % FOLDS == fold
        left_out[out] = gaps[out] - matrix[out] @ _fit(
            matrix[~out], gaps[~out], bound[~out], bounded[~out]
        )
    best = Terms(orders, (scales * _fit(matrix, gaps, bound, bounded))[None])
    whole = best if ground is None else summed(ground, best)
    ended = [r for r in fine if r.load > 0.0 and not r.open]
    whole.coefficients[0, 0] += _shift(whole, ended)
    errors = _errors(points[~bounded], left_out[~bounded])
    if fine and not ended:
        errors.coefficients[0, 0] = np.hypot(errors.coefficients[0, 0], UNKNOWN_SHIFT)
    return FittedLimit(stacked([whole, errors]), left_out[~bounded])


def _at(terms: Terms, points: Floats) -> Floats:
    """Return the first output at points, (n,)."""
    values: Floats = features(terms.orders, points) @ terms.coefficients[0]
    return values


def summed(*parts: Terms) -> Terms:
    """Return the sum of several terms of the same outputs."""
    orders = np.vstack([part.orders for part in parts])
    return stacked([Terms(orders, np.hstack([part.coefficients for part in parts]))])


def _shift(best: Terms, ended: Sequence[Reach]) -> float:
    """Return the median of ln(reach) minus the fit at runs with a known end; 0 if there are none.

    The first term is the constant.
    """
    if not ended:
        return 0.0
    points, known, _ = _table(ended)
    return float(np.median(known - _at(best, points)))


def _fit(matrix: Floats, known: Floats, bound: Floats, bounded: NDArray[np.bool_]) -> Floats:
    """Return scaled coefficients; a bound counts only where the fit lies below it.

    Newton steps: each is a linear fit to the known values and to the bounds violated by the last
    one, shortened if it violates so many others that the fit gets worse.
    """
    ridge = PRIOR.noise**2
    target = np.where(bounded, bound, known)

    def missed(coefficients: Floats) -> Floats:
        gap = target - matrix @ coefficients
        return np.where(bounded, np.maximum(gap, 0.0), gap)

    def loss(coefficients: Floats) -> float:
        gap = missed(coefficients)
        return float(gap @ gap + ridge * coefficients @ coefficients)

    best = np.zeros(matrix.shape[1])
    for _ in range(ROUNDS):
        counted = ~bounded | (missed(best) > 0.0)
        rows = matrix[counted]
        normal = rows.T @ rows + ridge * np.eye(matrix.shape[1])
        step = cho_solve(cho_factor(normal), rows.T @ target[counted]) - best
        shares = 0.5 ** np.arange(HALVINGS)
        better = next((best + s * step for s in shares if loss(best + s * step) < loss(best)), None)
        if better is None:
            break
        best = better
    return best


def _table(reaches: Sequence[Reach]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return coordinates without the load, ln of the warped load, and whether it is a bound."""
    groups = np.column_stack([[r.load for r in reaches], [r.groups for r in reaches]])
    place = coordinates(groups)
    points = place.points.copy()
    points[:, 0] = 0.0
    points[:, SLACK], _ = scaled_cause("paper_slack", groups[:, SLACK])
    return points, np.log(groups[:, 0]) + place.warp, np.array([r.open for r in reaches])


def _errors(points: Floats, left_out: Floats) -> Terms:
    """Return the standard error as a constant plus a non-negative part per squared cause.

    For few errors it is a constant: parts of causes that hardly varied in them would be unbounded
    where they do.
    """
    if len(left_out) == 0:
        return Terms(FAMILY.orders[:1], np.full((1, 1), UNKNOWN_LIMIT))
    orders = ERRORS.orders
    even = orders[np.all(orders % 2 == 0, axis=1)]
    if len(left_out) < ERRORS_FOR_PARTS * len(even):
        even = even[:1]
    matrix = features(even, points)
    # the mean absolute normal error is √(2/π) of its standard deviation
    parts, _ = nnls(matrix, np.abs(left_out) * np.sqrt(0.5 * np.pi))
    return Terms(even, parts[None])


ANGLES = (0, 1)  # curvature and bend angle: smooth, fitted with their derivatives
STRETCH = (2,)  # a quantile over points, wavy: over a wide range only its values are fitted


@dataclass(frozen=True)
class FitPlan:
    """Terms and priors with which outputs are fitted.

    Parameters
    ----------
    outputs : tuple of int
        Outputs fitted together.
    derivatives : bool
        Whether derivatives are used besides values.
    family, correction : Family
        Terms on the coarse mesh, and of the fine mesh's deviation from it.
    prior, correction_prior : Prior
        Expected decay of their coefficients.
    weight : float
        Weight of a derivative over half of its group's range, relative to a value.
    between : bool
        Whether readings between the equilibria are used.
    """

    outputs: tuple[int, ...]
    derivatives: bool
    family: Family
    correction: Family
    prior: Prior
    correction_prior: Prior
    weight: float = DERIVATIVE_WEIGHT
    between: bool = False


POWERS = (3, 3, 1, 4, 2, 1, 2, 4, 4)
ONCE = (1, 1, 1, 2, 1, 1, 1, 2, 2)
_MEASURED = tuple(len(OUTPUTS) + k for k in range(len(MEASURES)))
WEIBULL, EQUIVALENT = _MEASURED[: len(WEIBULL_MODULI)], _MEASURED[len(WEIBULL_MODULI) :]
SMOOTH = Family((10, 6, 6, 5), (6, 4, 4, 3), POWERS, (2, 1, 1, 1))
_ANGLES = FitPlan(
    ANGLES,
    True,
    Family((12, 8, 8, 5), (8, 5, 5, 4), POWERS, (4, 2, 2, 2), (1, 1, 1, 1)),
    Family((6, 4, 4, 4), (3, 2, 2, 2), ONCE, (1, 1, 1, 0)),
    Prior(0.65, 0.5, 0.5, 1e-2),
    Prior(0.5, 0.4, 0.3, 5e-2),
)
_STRETCH = FitPlan(
    STRETCH,
    False,
    Family((8, 5, 5, 4), (3, 2, 2, 1), ONCE, (0, 0, 0, 0)),
    Family((3, 2, 2, 1), (1, 1, 1, 0), ONCE),
    Prior(0.6, 0.45, 0.35, 3e-2),
    Prior(0.5, 0.4, 0.3, 1e-1),
)
PLANS = (
    _ANGLES,
    _STRETCH,
    # corners dominate and differ on the coarse mesh: the deviation from it has as many terms
    FitPlan(WEIBULL, True, SMOOTH, SMOOTH, _ANGLES.prior, Prior(0.6, 0.45, 0.35, 1e-2)),
    replace(_STRETCH, outputs=EQUIVALENT),
)


@dataclass(frozen=True)
class FitTerms:
    """Terms with which an emulator is fitted.

    Parameters
    ----------
    plans : tuple of FitPlan
        Plans of ``OUTPUTS`` and ``MEASURES``, in order.
    errors, limit : Family
        Terms of the logarithm of squared errors, and of the limit.
    volume : FitPlan
        Plan of the cavity volume, fitted if all runs have it.
    steepest : float
        Growth d ln κ / d ln p up to which curves are used [–].
    """

    plans: tuple[FitPlan, ...]
    errors: Family
    limit: Family
    volume: FitPlan
    steepest: float = STEEPEST


VOLUME = (len(OUTPUTS) + len(MEASURES),)
WHOLE = FitTerms(PLANS, FAMILY, LIMIT_FAMILY, replace(_ANGLES, outputs=VOLUME))
# with the emulator of a different actuator: the departure is smooth, and few runs suffice
_NEAR = FitPlan(
    ANGLES,
    True,
    Family((6, 4, 4, 4), (3, 2, 2, 2), (2, 2, 1, 3, 2, 1, 2, 3, 3), (1, 1, 1, 1)),
    Family((3, 2, 2, 2), (1, 1, 1, 1), (1, 1, 1, 1, 1, 1, 1, 1, 1)),
    Prior(0.6, 0.5, 0.4, 3e-3),
    Prior(0.5, 0.4, 0.3, 5e-2),
)
_NEAR_STRETCH = FitPlan(
    STRETCH,
    False,
    Family((3, 2, 2, 2), (1, 1, 1, 0), ONCE),
    Family((2, 1, 1, 1), (0, 0, 0, 0), ONCE),
    Prior(0.6, 0.45, 0.35, 3e-2),
    Prior(0.5, 0.4, 0.3, 1e-1),
)
# without one: a curve up to ballooning needs more orders in the load, and the part of the material
# range used by one study needs few
_ALONE = replace(
    _NEAR,
    family=Family((12, 4, 4, 3), (7, 2, 2, 2), (2, 2, 1, 3, 2, 1, 2, 3, 3), (3, 1, 1, 1)),
    prior=Prior(0.8, 0.5, 0.5, 3e-3),
)
_ALONE_STRETCH = replace(
    _NEAR_STRETCH,
    family=Family((8, 2, 2, 2), (3, 1, 1, 1), ONCE),
    prior=Prior(0.7, 0.45, 0.35, 1e-2),
)
NEAR = FitTerms(
    (
        _NEAR,
        _NEAR_STRETCH,
        replace(_NEAR, outputs=WEIBULL),
        replace(_NEAR_STRETCH, outputs=EQUIVALENT),
    ),
    Family((1, 0, 0, 0), (0, 0, 0, 0), 9 * (0,)),
    Family((0, 1, 1, 1), (0, 0, 0, 0), 9 * (1,)),
    replace(_ALONE, outputs=VOLUME),  # the shipped emulator has none to depart from
)
BY_ITSELF = FitTerms(
    (
        _ALONE,
        _ALONE_STRETCH,
        replace(_ALONE, outputs=WEIBULL),
        replace(_ALONE_STRETCH, outputs=EQUIVALENT),
    ),
    NEAR.errors,
    NEAR.limit,
    NEAR.volume,
)
# a segment with straight channels hardly bends at first, and then grows by up to p^5.5 where its
# channels widen, along an entirely smooth path
OF_CHANNELS = replace(BY_ITSELF, steepest=8.0)


Solved = tuple[Sequence[Curve], Sequence[PathSamples]]


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
        Relative errors of held-out runs.
    worst : array, shape (n_fine, n_outputs)
        Largest error of each held-out fine run, over its largest value [–].
    """

    terms: Terms
    points: Floats
    left_out: Floats
    worst: Floats


def _cut_short(*samples: PathSamples) -> int:
    return sum(one.status != Status.CONVERGED for one in samples)


def _of_outputs(terms: FitTerms) -> int:
    """Return the number of plans of ``OUTPUTS``, which come before ``MEASURES``."""
    return sum(max(plan.outputs) < len(OUTPUTS) for plan in terms.plans)


def learned(
    runs: Solved,
    span: TrainingRange,
    length: float,
    steepest: float,
    *,
    between: bool = False,
) -> dict[Curve, Observed]:
    """Return the usable data of the runs of a mesh; see `regression.observe`.

    Raises
    ------
    BayesdegError
        If no run is usable.
    """
    found = _observed(*runs, span=span, length=length, steepest=steepest, between=between)
    if not found:
        raise BayesdegError(
            "no curve of a mesh has enough equilibria for training: the study hardly bends its "
            "actuator, or all its curves balloon immediately; check pressures and priors"
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
    terms: FitTerms | None = None,
    usual: Sequence[Curve] | None = None,
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
    terms : FitTerms, optional
        Terms of the fit; by default those of the whole range.
    usual : sequence of Curve, optional
        Curves of materials at which the error is most accurate; by default those of `likely`.
    ground : Surrogate, optional
        An emulator of a different actuator: only the departure from it is fitted.
    units : Units
        Units of load and paper in the span; curves and samples are in units of 1.
    """
    coarse, fine = (counted(*runs, units) for runs in (coarse, fine))
    chosen = terms or WHOLE
    many, few = (learned(r, span, length, chosen.steepest) for r in (coarse, fine))
    parts = [_train(many, few, plan, span, terms_below(ground, plan)) for plan in chosen.plans]
    limit = _limit(coarse, fine, span, chosen, ground)
    met = _material_points(likely(span) if usual is None else [counted_in(c, units) for c in usual])
    errors = [_error_of(part, met, chosen) for part in parts]
    further, also = _further(many, few, chosen, span, met)
    n = _of_outputs(chosen)
    outputs = stacked([part.terms for part in parts[:n]])
    facts = _curve_facts(coarse, fine) | {
        "terms": len(outputs.orders),
        "mesh_error_pct": 100.0 * mesh_error,
        "accuracy": _accuracy(parts, errors, limit) | also,
    }
    return Surrogate(
        length=length,
        span=span,
        terms=outputs,
        error=stacked(errors[:n]),
        limit=limit.terms,
        strains=stacked([part.terms for part in parts[n:]]),
        strain_error=stacked(errors[n:]),
        mesh_error=mesh_error,
        record=json.dumps(record | facts, indent=1),
        units=units,
        further=further,
    )


def _curve_facts(coarse: Solved, fine: Solved) -> dict[str, object]:
    return {
        "model_version": MODEL_VERSION,
        "coarse_curves": len(coarse[0]),
        "fine_curves": len(fine[0]),
        "curves_cut_short": _cut_short(*coarse[1], *fine[1]),
    }


def _error_of(part: Trained, met: Floats, chosen: FitTerms) -> Terms:
    """Return ln of the squared relative errors of a fit as terms."""
    return fit_errors(part.points, part.left_out, nearness(part.points, met), chosen.errors)


def _further(
    many: dict[Curve, Observed],
    few: dict[Curve, Observed],
    chosen: FitTerms,
    span: TrainingRange,
    met: Floats,
) -> tuple[dict[Asked, FurtherTerms], dict[str, dict[str, float]]]:
    """Fit outputs besides the shape, if all runs have them; return their accuracy too."""
    runs = (*many.values(), *few.values())
    if not all(np.all(np.isfinite(run.values[:, VOLUME])) for run in runs):
        return {}, {}
    part = _train(many, few, chosen.volume, span)
    error = _error_of(part, met, chosen)
    within = coverage(error, part.points, part.left_out)[0]
    accuracy = summary(list(part.worst[:, 0])) | {"coverage_90": within}
    return {"cavity_volume": FurtherTerms(part.terms, error)}, {"cavity_volume": accuracy}


def with_forces(
    surrogate: Surrogate,
    coarse: Solved,
    fine: Solved,
    *,
    usual: Sequence[Curve],
    terms: FitTerms,
) -> Surrogate:
    """Return an emulator that also predicts the blocked tip force.

    Parameters
    ----------
    surrogate : Surrogate
        Emulator of the free actuator.
    coarse, fine : pair of sequences
        Curves and their solutions with the tip held, on either mesh.
    usual : sequence of Curve
        Curves at which the error is most accurate.
    terms : FitTerms
        The force is fitted with those of the volume.

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
            and (run := observe_force(curve, solved, span=span, length=surrogate.length))
        }
        for runs in (coarse, fine)
    )
    if not (many and few):
        raise BayesdegError("no curve with the tip held has enough equilibria for training")
    part = _train(many, few, replace(terms.volume, outputs=(0,)), span)
    met = _material_points([counted_in(curve, units) for curve in usual])
    error = _error_of(part, met, terms)
    record = json.loads(surrogate.record)
    within = coverage(error, part.points, part.left_out)[0]
    record["accuracy"]["tip_force"] = summary(list(part.worst[:, 0])) | {"coverage_90": within}
    answers = {**surrogate.further, "tip_force": FurtherTerms(part.terms, error)}
    return replace(surrogate, further=answers, record=json.dumps(record, indent=1))


SMALL = ("skin", "paper_mismatch", "gravity_along", "gravity_up")
"""Causes whose whole effect is smooth and a few percent, comparable to errors of many terms."""
_SMOOTH = Family((0, 0, 0, 0), (4, 3, 3, 2), tuple(2 * (cause.name in SMALL) for cause in CAUSES))
_AGAIN = Prior(0.8, 0.6, 0.6, 5e-2)
OLD, OLD_CURVES, OLD_SEED = 0.03, 256, 5
"""Weight of the previous terms, number of curves of the whole range at which they count, and their
seed: no curve was newly solved there."""


def with_small_effects(
    surrogate: Surrogate, curves: Sequence[Curve], samples: Sequence[PathSamples]
) -> Surrogate:
    r"""Return an emulator in which single `SMALL` causes have few, smooth terms.

    Among the terms of all causes, theirs err by a third of the effect and more, since errors count
    there over half of a group's range. With h that half range, y ln of curvature or bend angle from
    the curves' exact derivatives, Y all other terms, and S the previous terms of these causes,

    .. math:: \min_a \sum h^2 \left(\partial_g y - \partial_g Y
        - \partial_g (a \cdot \varphi)\right)^2 + w^2 \sum (a \cdot \varphi - S)^2,

    the first sum over the curves' equilibria and the causes g, the second, with w `OLD`, over
    `OLD_CURVES` of the whole range. Without a cause nothing changes.

    Parameters
    ----------
    surrogate : Surrogate
        Emulator of the fine mesh.
    curves, samples : sequences
        Curves with one cause each, and their solutions.

    Raises
    ------
    BayesdegError
        If no curve is usable.
    """
    span = surrogate.span
    whole = terms_below(surrogate, _ANGLES)[0]
    mine = _of_small_causes_alone(whole.orders)
    rest, old = (Terms(whole.orders[k], whole.coefficients[:, k]) for k in (~mine, mine))
    runs = learned((curves, samples), span, surrogate.length, STEEPEST)
    orders = _SMOOTH.orders[_of_small_causes_alone(_SMOOTH.orders)]
    before = _as_before(old, orders, span)
    best = fit(
        [*(_slopes_of(run, orders, rest, span) for run in runs.values()), before],
        orders,
        _AGAIN,
        outputs=len(ANGLES),
    )
    changed = summed(rest, Terms(orders, best.coefficients))
    terms = stacked(
        [(changed if k in ANGLES else surrogate.terms).output(k) for k in range(len(OUTPUTS))]
    )
    record = json.loads(surrogate.record)
    record |= {"terms": len(terms.orders), "fine_curves": record["fine_curves"] + len(curves)}
    return replace(surrogate, terms=terms, record=json.dumps(record, indent=1))


def _slopes_of(run: Observed, orders: Indices, rest: Terms, span: TrainingRange) -> Equations:
    """Return the equations of a run's derivatives by `SMALL` causes, over half of their ranges."""
    axes = [NAMES.index(name) for name in SMALL]
    sizes, place = half_ranges(span), run.coordinates
    slopes, below = (feature_gradients(which, place.points) for which in (orders, rest.orders))
    matrix, targets = [], []
    for k in axes:
        along, known = (
            np.einsum("npt,np->nt", part, place.jacobian[:, :, k]) for part in (slopes, below)
        )
        wanted = run.gradients[:, list(ANGLES), k] - place.warp_gradient[:, k, None]
        matrix.append(sizes[k] * along)
        targets.append(sizes[k] * (wanted - known @ rest.coefficients.T))
    return Equations(np.vstack(matrix), np.vstack(targets), 0)


def _of_small_causes_alone(orders: Indices) -> NDArray[np.bool_]:
    """Return which terms have a single cause, one of `SMALL`, (n_terms,)."""
    acting = orders[:, N_CHEBYSHEV:] > 0
    small = np.array([cause.name in SMALL for cause in CAUSES])
    alone: NDArray[np.bool_] = (acting.sum(axis=1) == 1) & acting[:, small].any(axis=1)
    return alone


def _as_before(old: Terms, orders: Indices, span: TrainingRange) -> Equations:
    """Return equations of no change at curves over the whole range, one of `SMALL` in each."""
    generator, points = np.random.default_rng(OLD_SEED), []
    neutral = {group.name: group.neutral for group in CAUSES}
    for curve in space_filling(span, OLD_CURVES, seed=OLD_SEED):
        place = Place.of(curve.material)
        cause = CAUSES[[c.name for c in CAUSES].index(str(generator.choice(SMALL)))]
        values = dict(zip(NAMES[1:], place.values, strict=True)) | neutral
        values[cause.name] = generator.uniform(cause.low, cause.high)
        loads = np.array(SHARES) * curve.loads[-1] / place.modulus
        points += [[load, *values.values()] for load in loads]
    at = coordinates(np.array(points)).points
    at[:, 0] = np.minimum(at[:, 0], 1.0)
    targets = features(old.orders, at) @ old.coefficients.T
    return Equations(OLD * features(orders, at), OLD * targets, len(at))


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


def _limit(
    coarse: Solved,
    fine: Solved,
    span: TrainingRange,
    terms: FitTerms,
    ground: Surrogate | None,
) -> FittedLimit:
    """Fit where curves end."""
    ends, fine_ends = (
        [reach(c, s, terms.steepest) for c, s in zip(*runs, strict=True) if is_answered(c, span)]
        for runs in (coarse, fine)
    )
    below = None if ground is None else ground.limit.output(0)
    return fit_limit(ends, fine_ends, family=terms.limit, ground=below)


def _observed(
    curves: Sequence[Curve],
    samples: Sequence[PathSamples],
    *,
    span: TrainingRange,
    length: float,
    steepest: float,
    between: bool = False,
) -> dict[Curve, Observed]:
    """Return the data of each usable run."""
    found = {
        curve: observe(curve, solved, span=span, length=length, steepest=steepest, between=between)
        for curve, solved in zip(curves, samples, strict=True)
        if is_answered(curve, span)
    }
    return {curve: run for curve, run in found.items() if run is not None}


def _material_points(curves: Sequence[Curve]) -> Floats:
    """Return coordinates of the materials of curves, without a load, (n, 13)."""
    places = np.array([Place.of(curve.material).values for curve in curves])
    return coordinates(np.column_stack([np.zeros(len(places)), places])).points


def terms_below(ground: Surrogate | None, plan: FitPlan) -> tuple[Terms, ...]:
    """Return an emulator's terms for the outputs of a plan; empty without one."""
    if ground is None:
        return ()
    table, first = ground.terms, 0
    if min(plan.outputs) >= len(OUTPUTS):
        table, first = ground.strains, len(OUTPUTS)
    coefficients = table.coefficients[[k - first for k in plan.outputs]]
    there = np.any(coefficients != 0.0, axis=0)
    return (Terms(table.orders[there], coefficients[:, there]),)


def _train(
    many: dict[Curve, Observed],
    few: dict[Curve, Observed],
    plan: FitPlan,
    span: TrainingRange,
    below: tuple[Terms, ...] = (),
) -> Trained:
    """Fit the departure of the coarse mesh from the ground, and of the fine one from both."""

    def coarse(run: Observed) -> Equations:
        return gap_of(run, plan.family, below, plan, span)

    base = fit(
        map(coarse, many.values()), plan.family.orders, plan.prior, outputs=len(plan.outputs)
    )
    under = (*below, Terms(base.orders, base.coefficients))
    gaps = {curve: gap_of(run, plan.correction, under, plan, span) for curve, run in few.items()}
    shift = fit(
        gaps.values(), plan.correction.orders, plan.correction_prior, outputs=len(plan.outputs)
    )
    points, left_out, worst = [], [], []
    for curve, run in few.items():
        error = _without(gaps[curve], shift)
        if curve in many:  # hold out the coarse twin too
            change = base.without(coarse(many[curve])) - base.coefficients
            error = error - (_rows(run, base.orders, plan, span).matrix @ change.T)[: len(error)]
        worst.append(np.max(np.abs(error), axis=0))
        points.append(run.coordinates.points)
        left_out.append(error / run.weights[:, None])
    terms = summed(*under, Terms(shift.orders, shift.coefficients))
    return Trained(terms, np.vstack(points), np.vstack(left_out), np.array(worst))


def _rows(run: Observed, orders: Indices, plan: FitPlan, span: TrainingRange) -> Equations:
    return rows_of(
        run,
        orders,
        outputs=list(plan.outputs),
        span=span,
        derivatives=plan.derivatives,
        weight=plan.weight,
    )


def gap_of(
    run: Observed,
    family: Family,
    below: Sequence[Terms],
    plan: FitPlan,
    span: TrainingRange,
) -> Equations:
    """Return the equations of a run for its deviation from a sum of terms."""
    part = _rows(run, family.orders, plan, span)
    targets = part.targets
    for terms in below:
        targets = targets - _rows(run, terms.orders, plan, span).matrix @ terms.coefficients.T
    return Equations(part.matrix, targets, part.n_values)


def _without(gap: Equations, shift: Regression) -> Floats:
    """Return the weighted errors of values of a held-out run."""
    return (gap.targets - gap.matrix @ shift.without(gap).T)[: gap.n_values]


def _accuracy(
    parts: Sequence[Trained], errors: Sequence[Terms], limit: FittedLimit
) -> dict[str, dict[str, float]]:
    """Return errors at held-out runs: the largest per curve, over its largest value."""
    covered = [
        share
        for part, error in zip(parts, errors, strict=True)
        for share in coverage(error, part.points, part.left_out)
    ]
    worst = np.hstack([part.worst for part in parts])
    found = {
        name: summary(list(column)) | {"coverage_90": share}
        for name, column, share in zip((*OUTPUTS, *MEASURES), worst.T, covered, strict=True)
    }
    return found | {"limit": summary(list(limit.left_out))}


__all__ = ["Finished", "Kind", "Run", "Solution", "complete", "missing"]

# interval of checks whether workers are reachable [s]
_PATIENCE = 2.0
# deaths of a worker alone with one run, after which the run is given up
_DEATHS = 3


@dataclass(frozen=True)
class Finished:
    """A finished run, passed to ``on_run``.

    Parameters
    ----------
    run : Run
        A run missing from the store when the campaign began.
    solution : Solution
        Its solution, of any status.
    seconds : float
        Its time; 0 if another campaign solved it in the meantime [s].
    """

    run: Run
    solution: Solution
    seconds: float


def missing(runs: Sequence[Run], store: SolutionStore, *, timeout: float = inf) -> list[Run]:
    """Return the runs that ``complete`` would solve, without duplicates."""
    return [run for run in dict.fromkeys(runs) if store.get(run, timeout=timeout) is None]


def complete(
    runs: Sequence[Run],
    store: SolutionStore,
    *,
    executor: Executor | None = None,
    timeout: float = inf,
    on_run: Callable[[Finished], None] | None = None,
) -> list[Solution]:
    """Return the solutions of all runs, in order, solving only those missing from the store.

    Every solution is written immediately and atomically; so a killed campaign resumes where it
    stopped, and several may share one store. A run that fails or times out is a solution too, with
    that status. All are solved with one thread of linear algebra, so that the numbers are the same
    wherever they were solved.

    Parameters
    ----------
    runs : sequence of Run
        The required runs.
    store : SolutionStore
        A damaged solution in it is named in a warning and solved again; one that timed out is
        retried if more time is allowed now.
    executor : Executor, optional
        Executor; by default serial, in this process.
    timeout : float
        Maximum wall time of a run, from its start [s].
    on_run : callable, optional
        Called after each run that was missing.

    Raises
    ------
    BayesdegError
        If the store cannot be written, or if workers or scheduler are lost permanently. Existing
        solutions stay in the store.
    RuntimeError
        If a worker raised; names the run. Runs in progress are stored before.
    """
    store.clean()
    known = {run: store.get(run, timeout=timeout) for run in dict.fromkeys(runs)}
    queue = deque(run for run, solution in known.items() if solution is None)
    campaign = _Campaign(store, timeout, on_run or (lambda _: None), queue)
    if executor is None:
        _solve_here(campaign)
    else:
        _solve_over(campaign, executor)
    found = known | campaign.solutions
    return [solution for run in runs if (solution := found[run]) is not None]


@dataclass
class _Campaign:
    """State of a campaign: remaining runs and solutions."""

    store: SolutionStore
    timeout: float
    on_run: Callable[[Finished], None]
    queue: deque[Run]
    solutions: dict[Run, Solution] = field(default_factory=dict)

    def next_run(self) -> Run | None:
        """Return the next run that is still unsolved."""
        while self.queue:
            run = self.queue.popleft()
            solution = self.store.get(run, timeout=self.timeout)
            if solution is None:
                return run
            self._found(Finished(run, solution, 0.0))
        return None

    def finish(self, run: Run, solution: Solution, seconds: float) -> None:
        """Store a solution."""
        if not self.store.put(run, solution, seconds=seconds, timeout=self.timeout):
            # another campaign works on the same runs: continue elsewhere
            self.queue.rotate(-round(0.62 * len(self.queue)))
            solution = self.store.get(run) or solution
        self._found(Finished(run, solution, seconds))

    def _found(self, finished: Finished) -> None:
        self.solutions[finished.run] = finished.solution
        self.on_run(finished)


def _solve_here(campaign: _Campaign) -> None:
    while (run := campaign.next_run()) is not None:
        try:
            solution, seconds = solve(run, run.key(), campaign.timeout)
        except Exception as fault:
            raise _unexpected(run, fault) from fault
        campaign.finish(run, solution, seconds)


def _solve_over(campaign: _Campaign, executor: Executor) -> None:
    flight = _ActiveRuns(campaign, executor)
    try:
        while flight.launch():
            flight.land()
    finally:
        for future in flight.runs:
            future.cancel()
    if flight.failure is not None:
        raise flight.failure


@dataclass
class _ActiveRuns:
    """The runs submitted to an executor: never many more than it has workers.

    If a worker dies, all runs of its pool are suspect; they are retried one at a time to find the
    one that kills workers.
    """

    campaign: _Campaign
    executor: Executor
    runs: dict[Future[tuple[Solution, float]], Run] = field(default_factory=dict)
    suspects: deque[Run] = field(default_factory=deque)
    alone: bool = False
    deaths: Counter[Run] = field(default_factory=Counter)
    failure: Exception | None = None

    def launch(self) -> bool:
        """Submit runs up to capacity; return whether any run is in progress."""
        while self.failure is None and len(self.runs) < self._room():
            self.alone = bool(self.suspects)
            run = self.suspects.popleft() if self.suspects else self.campaign.next_run()
            if run is None:
                break
            try:
                future = self.executor.submit(solve, run, run.key(), self.campaign.timeout)
            except BrokenExecutor as fault:
                raise BayesdegError(
                    "a worker process died, and the executor opens no new one; solutions so far "
                    "are stored: run the same command again to resume"
                ) from fault
            self.runs[future] = run
        return bool(self.runs)

    def _room(self) -> int:
        if self.suspects or (self.alone and self.runs):
            return 1
        # a second run per worker, so that none waits while results are stored
        workers = self.executor.workers if isinstance(self.executor, Supervised) else None
        return 2 * (workers or os.cpu_count() or 1)

    def land(self) -> None:
        """Wait for results, store them, and handle lost ones."""
        done, _ = wait(self.runs, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
        if any(_broken(future) for future in done):
            done, _ = wait(self.runs)  # a broken pool ends them all
        broken = [self.runs[future] for future in done if _broken(future)]
        for future in done:
            run = self.runs.pop(future)
            if not _broken(future):
                self._take(run, future)
        if broken:
            self._suspect(broken)
        if isinstance(self.executor, Supervised):
            self.executor.check()

    def _take(self, run: Run, future: Future[tuple[Solution, float]]) -> None:
        fatal = self.executor.fatal if isinstance(self.executor, Supervised) else ()
        if future.cancelled():
            self.failure = self.failure or BayesdegError(f"{run} was cancelled externally")
        elif (fault := future.exception()) is None:
            self.campaign.finish(run, *future.result())
        elif isinstance(fault, fatal):
            self.failure = self.failure or _deadly(run)
        else:
            self.failure = self.failure or _unexpected(run, fault)

    def _suspect(self, runs: list[Run]) -> None:
        warnings.warn(
            f"a worker process died; {len(runs)} runs are retried, one at a time", stacklevel=5
        )
        self.suspects.extend(runs)
        if len(runs) == 1:
            self.deaths[runs[0]] += 1
            if self.deaths[runs[0]] >= _DEATHS:
                self.failure = self.failure or _deadly(runs[0])


def _broken(future: Future[tuple[Solution, float]]) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def _unexpected(run: Run, fault: BaseException) -> Exception:
    if isinstance(fault, BayesdegError):  # already says what to do
        return fault
    error = RuntimeError(f"{run} raised {fault!r}")
    error.__cause__ = fault
    return error


def _deadly(run: Run) -> BayesdegError:
    return BayesdegError(
        f"worker processes die whenever they solve the {run}: if memory is short, use fewer "
        "workers or a coarser mesh; all other solutions stay in the store"
    )


WHOLE_RANGE = "scrambled Sobol' over the material, none to four causes at work in each"
LOCAL = "where one study may ask, as a departure from the emulator of the default geometry"
ALONE = "where one study may ask"


def runs(
    geometry: Moulded, recipe: Recipe | None = None, design: LocalDesign | None = None
) -> list[Run]:
    """Return the training runs of an emulator of a geometry, the coarse mesh first.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> len(runs(Geometry(Dimensions()), Recipe(coarse_runs=4, fine_runs=2)))
    6
    """
    recipe = recipe or Recipe()
    coarse, fine = _curves(recipe, design)
    ways = (False, True) if design is not None and design.with_forces else (False,)
    both = ((recipe.coarse_mesh, coarse), (recipe.fine_mesh, fine))
    found = [
        Run(
            *(geometry, mesh, with_layer(geometry, curve), Kind.SAMPLES, held),
            backend=recipe.backend,
        )
        for held in ways
        for mesh, curves in both
        for curve in curves
    ]
    found += [run for held in ways for run in _moved(geometry, recipe, design, held)]
    return found + _runs_of_single_causes(geometry, recipe, design)


def _runs_of_single_causes(
    geometry: Moulded, recipe: Recipe, design: LocalDesign | None
) -> list[Run]:
    """Return the runs that train small causes in an emulator of the whole range."""
    if design is not None or not recipe.has_further_stages:
        return []
    curves = third_stage(TrainingRange())
    return [
        Run(geometry, recipe.fine_mesh, curve, Kind.SAMPLES, backend=recipe.backend)
        for curve in curves
    ]


def _moved(
    geometry: Moulded, recipe: Recipe, design: LocalDesign | None, held: bool
) -> Iterator[Run]:
    """Yield the runs with dimensions moved, in the order of ``LocalDesign.moved``."""
    if design is None:
        return
    for one in design.moved:
        shape = one.geometry(geometry, design.dimensions)
        mesh = recipe.fine_mesh if one.is_fine else recipe.coarse_mesh
        curve = with_layer(shape, one.curve)
        yield Run(
            *(shape, mesh, curve, Kind.SAMPLES, held), origin=geometry, backend=recipe.backend
        )


def _curves(recipe: Recipe, design: LocalDesign | None) -> tuple[list[Curve], list[Curve]]:
    """Return the curves for the coarse and the fine mesh; the latter are among the former."""
    if design is not None:
        first, second = design.nominal
        return list(first), list(second)
    span = TrainingRange()
    coarse = space_filling(span, recipe.coarse_runs, seed=recipe.seed)
    fine = coarse[: recipe.fine_runs]
    if not recipe.has_further_stages:
        return coarse, fine
    further, finer = second_stage(span, coarse, recipe.fine_runs)
    return [*coarse, *further], [*fine, *finer]


def build(
    geometry: Moulded,
    store: SolutionStore,
    *,
    recipe: Recipe | None = None,
    design: LocalDesign | None = None,
    executor: Executor | None = None,
    timeout: float = inf,
    on_run: Callable[[Finished], None] | None = None,
) -> Surrogate:
    """Solve missing runs and train an emulator of a geometry.

    Parameters
    ----------
    geometry : Moulded
        The actuator as moulded.
    store : SolutionStore
        Finite element solutions; an interrupted campaign resumes from it.
    recipe : Recipe, optional
        Meshes and numbers of curves.
    design : LocalDesign, optional
        Curves of one study, instead of the recipe's over the whole range.
    executor : Executor, optional
        Executor of the runs.
    timeout : float
        Time after which a run is given up, from its start [s].
    on_run : callable, optional
        Called after each run that was missing.
    """
    if design is None:
        refuse_whole_range(geometry)
    recipe = recipe or Recipe()
    wanted = runs(geometry, recipe, design)
    found = complete(wanted, store, executor=executor, timeout=timeout, on_run=on_run)
    pairs = [
        (run, solution)
        for run, solution in zip(wanted, found, strict=True)
        if isinstance(solution, PathSamples)
    ]
    solved = dict(pairs)
    # sums over threads depend on their number
    with threadpool_limits(1):
        if design is not None and design.only_departure:
            ready = replace(default_surrogate(), span=design.span)
            return _with_departure(ready, geometry, recipe, design, solved)
        surrogate = _train_all(geometry, recipe, design, pairs)
        if design is None or not design.dimensions:
            return surrogate
        return _with_departure(surrogate, geometry, recipe, design, solved)


Solutions = Mapping[Run, PathSamples]


def _train_all(
    geometry: Moulded,
    recipe: Recipe,
    design: LocalDesign | None,
    pairs: Sequence[tuple[Run, PathSamples]],
) -> Surrogate:
    """Train on all solutions of the nominal actuator."""
    single = set(_runs_of_single_causes(geometry, recipe, design))
    coarse, fine, *forces = (
        _split(
            [
                (run, found)
                for run, found in pairs
                if run.origin is None and run.resolution == mesh and run.held is held
                if run not in single
            ]
        )
        for held in (False, True)
        for mesh in (recipe.coarse_mesh, recipe.fine_mesh)
    )
    place = _place_of(geometry, design)
    surrogate = train(
        coarse,
        fine,
        length=geometry.dimensions.length,
        mesh_error=mesh_error_of(geometry),
        record=_record_of(geometry, recipe, design),
        **place,
    )
    if single:
        return with_small_effects(surrogate, *_split([p for p in pairs if p[0] in single]))
    if design is None or not design.with_forces:
        return surrogate
    return with_forces(surrogate, *forces, usual=design.usual, terms=place.get("terms", WHOLE))


def _place_of(geometry: Moulded, design: LocalDesign | None) -> "_Place":
    """Return range and terms of an emulator's training."""
    if design is None:
        return {"span": TrainingRange()}
    place: _Place = {"span": design.span, "usual": design.usual, "units": design.units}
    place["terms"] = local_terms(geometry)
    if has_ground(geometry):
        place["ground"] = default_surrogate()
    return place


def local_terms(geometry: Moulded) -> FitTerms:
    """Return the terms of an emulator for one study."""
    if has_ground(geometry):
        return NEAR
    return OF_CHANNELS if geometry.dimensions.kind == "cylindrical" else BY_ITSELF


def _with_departure(
    surrogate: Surrogate,
    geometry: Moulded,
    recipe: Recipe,
    design: LocalDesign,
    solved: Solutions,
) -> Surrogate:
    """Return an emulator that also covers the uncertain dimensions.

    Raises
    ------
    BayesdegError
        If curves with changed dimensions are insufficient.
    """
    steepest = _place_of(geometry, design).get("terms", WHOLE).steepest
    free = _differences(surrogate, geometry, recipe, design, solved, steepest, held=False)
    held = (
        _differences(surrogate, geometry, recipe, design, solved, steepest, held=True)
        if design.with_forces
        else []
    )
    moved = {k for found in free for k in np.flatnonzero(found.one.away)}
    if len(moved) < len(design.dimensions) or design.with_forces != bool(held):
        raise BayesdegError(
            "curves with a changed uncertain dimension end too early to be usable; give it a "
            "narrower law"
        )
    shapes, forces = ([(one, away) for one, away, _ in part] for part in (free, held))
    ends = [(one, end) for one, _, end in free]
    found = fit_departure(design.dimensions, shapes, forces, ends, design.span)
    record = json.loads(surrogate.record)
    record["dimensions_moved"] = found.facts
    return replace(surrogate, departure=found.departure, record=json.dumps(record, indent=1))


def _pairs(
    geometry: Moulded, recipe: Recipe, design: LocalDesign, solved: Solutions, *, held: bool
) -> Iterator[tuple[MovedCurve, tuple[Curve, PathSamples], tuple[Curve, PathSamples]]]:
    """Yield moved curves paired with their unmoved twins, in the design's units."""
    runs_moved = _moved(geometry, recipe, design, held)
    for one, run in zip(design.moved, runs_moved, strict=True):
        curve = with_layer(geometry, one.curve)
        still = replace(run, geometry=geometry, curve=curve, origin=None)
        if run not in solved or still not in solved:
            continue
        curves, samples = counted(
            [still.curve, run.curve], [solved[still], solved[run]], design.units
        )
        first, second = zip(curves, samples, strict=True)
        yield one, first, second


def _differences(
    surrogate: Surrogate,
    geometry: Moulded,
    recipe: Recipe,
    design: LocalDesign,
    solved: Solutions,
    steepest: float,
    *,
    held: bool,
) -> list["_Departed"]:
    """Return departures of usable moved curves."""
    span, length = design.span, surrogate.length
    found = []
    for one, *both in _pairs(geometry, recipe, design, solved, held=held):
        if not is_answered(both[0][0], span):
            continue
        still, moved = (
            observe_force(curve, path, span=span, length=length)
            if held
            else observe(curve, path, span=span, length=length, steepest=steepest)
            for curve, path in both
        )
        away = departed(still, moved) if still is not None and moved is not None else None
        if still is not None and away is not None:
            end = None if held else end_of(both[0], both[1], steepest)
            found.append(_Departed(one, away, load_shift(still, away) if end is None else end))
    return found


class _Departed(NamedTuple):
    """A moved curve, its departure, and the change of ln of the load at its end."""

    one: MovedCurve
    away: Observed
    end: float


def _record_of(geometry: Moulded, recipe: Recipe, design: LocalDesign | None) -> dict[str, object]:
    """Return the training data of an emulator, as recorded in its file."""
    alike = has_ground(geometry)
    record: dict[str, object] = {
        "design": WHOLE_RANGE if design is None else LOCAL if alike else ALONE,
        "fit_version": FIT_VERSION,
        "seed": recipe.seed,
        "coarse_mesh_mm": vars(recipe.coarse_mesh),
        "fine_mesh_mm": vars(recipe.fine_mesh),
        "dimensions_mm": {n: v for n, v in vars(geometry.dimensions).items() if n != "path"},
    }
    if recipe.backend is not Backend.KERNELS:
        record["backend"] = recipe.backend
    return record if alike else record | {"geometry": geometry.record()}


class _Place(TypedDict):
    """Differences between an emulator of the whole range and one of a study."""

    span: TrainingRange
    terms: NotRequired[FitTerms]
    usual: NotRequired[Sequence[Curve]]
    ground: NotRequired[Surrogate]
    units: NotRequired[Units]


def _split(pairs: list[tuple[Run, PathSamples]]) -> tuple[list[Curve], list[PathSamples]]:
    return [run.curve for run, _ in pairs], [solution for _, solution in pairs]
