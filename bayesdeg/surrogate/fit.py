"""Fit the terms of an emulator and of its error to solved curves.

Many curves of a coarse mesh give the map, few of a fine mesh its deviation from it. Errors are
those of held-out runs.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls
from sklearn.linear_model import GammaRegressor

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.demand import MEASURES
from bayesdeg.actuator.inputs import Asked
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import MODEL_VERSION, Status
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.coordinates import LARGEST_WARPED, SLACK, coordinates, scaled_cause
from bayesdeg.surrogate.design import SHARES, is_answered, likely, space_filling
from bayesdeg.surrogate.local import counted_in
from bayesdeg.surrogate.regression import (
    ANGLES,
    DERIVATIVE_WEIGHT,
    EQUIVALENT,
    INSIDE,
    INSIDE_SD,
    STEEPEST,
    STRETCH,
    VOLUME,
    WEIBULL,
    Equations,
    Observed,
    Prior,
    Reach,
    fit,
    half_ranges,
    observe,
    observe_force,
    reach,
    rows_of,
)
from bayesdeg.surrogate.scaling import CAUSES, NAMES, ONE, Place, TrainingRange, Units
from bayesdeg.surrogate.surrogate import OUTPUTS, FurtherTerms, Surrogate
from bayesdeg.surrogate.terms import (
    N_CHEBYSHEV,
    Family,
    Terms,
    feature_gradients,
    features,
    stacked,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Solved = tuple[Sequence[Curve], Sequence[PathSamples]]

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


POWERS = (3, 3, 1, 4, 2, 1, 2, 4, 4)
NEAR_POWERS = (2, 2, 1, 3, 2, 1, 2, 3, 3)
ONCE = (1, 1, 1, 2, 1, 1, 1, 2, 2)
FIRST = len(CAUSES) * (1,)
NONE = len(CAUSES) * (0,)
FLAT = (0, 0, 0, 0)
# cubic in load and material, quadratic in each cause
FAMILY = Family((3, 3, 3, 3), (1, 0, 0, 0), (2, 2, 0, 2, 2, 2, 2, 2, 2))
LIMIT_FAMILY = Family((0, 5, 5, 3), (0, 2, 2, 2), (2, 2, 1, 2, 2, 1, 2, 3, 3), (0, 1, 1, 1))
SMOOTH = Family((10, 6, 6, 5), (6, 4, 4, 3), POWERS, (2, 1, 1, 1))
SHIFTED = Prior(0.5, 0.4, 0.3, 5e-2)
KINKED = Prior(0.5, 0.4, 0.3, 1e-1)
_ANGLES = FitPlan(
    ANGLES,
    True,
    Family((12, 8, 8, 5), (8, 5, 5, 4), POWERS, (4, 2, 2, 2), (1, 1, 1, 1)),
    Family((6, 4, 4, 4), (3, 2, 2, 2), ONCE, (1, 1, 1, 0)),
    Prior(0.65, 0.5, 0.5, 1e-2),
    SHIFTED,
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
# without one: a curve up to ballooning needs more orders in the load, and the part of the material
# range used by one study needs few
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
    """Return plans of all outputs: Weibull's measures like angles, equivalents like the stretch."""
    return (
        *(angles, stretch),
        *(replace(angles, outputs=WEIBULL), replace(stretch, outputs=EQUIVALENT)),
    )


PLANS = (
    *(_ANGLES, _STRETCH),
    # corners dominate and differ on the coarse mesh: the deviation from it has as many terms
    FitPlan(WEIBULL, True, SMOOTH, SMOOTH, _ANGLES.prior, Prior(0.6, 0.45, 0.35, 1e-2)),
    replace(_STRETCH, outputs=EQUIVALENT),
)
WHOLE = FitTerms(PLANS, FAMILY, LIMIT_FAMILY, replace(_ANGLES, outputs=VOLUME))
NEAR = FitTerms(
    like(_NEAR, _NEAR_STRETCH),
    Family((1, 0, 0, 0), FLAT, NONE),
    Family((0, 1, 1, 1), FLAT, FIRST),
    replace(_ALONE, outputs=VOLUME),  # the shipped emulator has none to depart from
)
BY_ITSELF = replace(NEAR, plans=like(_ALONE, _ALONE_STRETCH))
# a segment with straight channels hardly bends at first, and then grows by up to p^5.5 where its
# channels widen, along an entirely smooth path
OF_CHANNELS = replace(BY_ITSELF, steepest=8.0)

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


# ---- where curves end

PRIOR = Prior(material=0.35, cause=0.25, noise=2e-2)
# the standard error grows with the square of each cause
ERRORS = Family(FLAT, FLAT, len(CAUSES) * (2,))
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
    below = 0.0 * known if ground is None else _first_output(ground, points)
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
    if ended:
        at, ends, _ = _table(ended)
        # the first term is the constant
        whole.coefficients[0, 0] += float(np.median(ends - _first_output(whole, at)))
    errors = _errors(points[~bounded], left_out[~bounded])
    if fine and not ended:
        errors.coefficients[0, 0] = np.hypot(errors.coefficients[0, 0], UNKNOWN_SHIFT)
    return FittedLimit(stacked([whole, errors]), left_out[~bounded])


def _first_output(terms: Terms, points: Floats) -> Floats:
    """Return the first output at points, (n,)."""
    values: Floats = features(terms.orders, points) @ terms.coefficients[0]
    return values


def summed(*parts: Terms) -> Terms:
    """Return the sum of several terms of the same outputs."""
    orders = np.vstack([part.orders for part in parts])
    return stacked([Terms(orders, np.hstack([part.coefficients for part in parts]))])


def _fit(matrix: Floats, known: Floats, bound: Floats, bounded: NDArray[np.bool_]) -> Floats:
    """Return scaled coefficients; a bound counts only where the fit lies below it."""
    # Newton steps: each is a linear fit to the known values and to the bounds violated by the last
    # one, shortened if it violates so many others that the fit gets worse
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
    """Return the standard error as a constant plus a non-negative part per squared cause."""
    if len(left_out) == 0:
        return Terms(FAMILY.orders[:1], np.full((1, 1), UNKNOWN_LIMIT))
    orders = ERRORS.orders
    even = orders[np.all(orders % 2 == 0, axis=1)]
    # parts of causes that hardly varied would be unbounded where they do
    if len(left_out) < ERRORS_FOR_PARTS * len(even):
        even = even[:1]
    matrix = features(even, points)
    # the mean absolute normal error is √(2/π) of its standard deviation
    parts, _ = nnls(matrix, np.abs(left_out) * np.sqrt(0.5 * np.pi))
    return Terms(even, parts[None])


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
        Relative errors of held-out runs.
    worst : array, shape (n_fine, n_outputs)
        Largest error of each held-out fine run, over its largest value [–].
    """

    terms: Terms
    points: Floats
    left_out: Floats
    worst: Floats


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
    found = {
        curve: run
        for curve, solved in zip(*runs, strict=True)
        if is_answered(curve, span)
        and (
            run := observe(
                curve, solved, span=span, length=length, steepest=steepest, between=between
            )
        )
        is not None
    }
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
        Curves of materials at which the error is most accurate; by default those of `likely`.
    ground : Surrogate, optional
        An emulator of a different actuator: only the departure from it is fitted.
    units : Units
        Units of load and paper in the span; curves and samples are in units of 1.
    """
    coarse, fine = (counted(*runs, units) for runs in (coarse, fine))
    many, few = (learned(r, span, length, terms.steepest) for r in (coarse, fine))
    parts = [_train(many, few, plan, span, terms_below(ground, plan)) for plan in terms.plans]
    ends, fine_ends = (
        [reach(c, s, terms.steepest) for c, s in zip(*runs, strict=True) if is_answered(c, span)]
        for runs in (coarse, fine)
    )
    below = None if ground is None else ground.limit.output(0)
    limit = fit_limit(ends, fine_ends, family=terms.limit, ground=below)
    met = _material_points([counted_in(c, units) for c in usual] or likely(span))
    errors = [_error_of(part, met, terms) for part in parts]
    worst = np.hstack([part.worst for part in parts])
    covered = [
        share
        for part, error in zip(parts, errors, strict=True)
        for share in coverage(error, part.points, part.left_out)
    ]
    accuracy = {
        name: summary(list(column)) | {"coverage_90": share}
        for name, column, share in zip((*OUTPUTS, *MEASURES), worst.T, covered, strict=True)
    } | {"limit": summary(list(limit.left_out))}
    further: dict[Asked, FurtherTerms] = {}
    if all(np.all(np.isfinite(run.values[:, VOLUME])) for run in (*many.values(), *few.values())):
        further["cavity_volume"], accuracy["cavity_volume"] = _train_further(
            many, few, terms.volume, span, met, terms
        )
    n = sum(max(plan.outputs) < len(OUTPUTS) for plan in terms.plans)  # the others are of MEASURES
    outputs = stacked([part.terms for part in parts[:n]])
    facts = {
        "model_version": MODEL_VERSION,
        "coarse_curves": len(coarse[0]),
        "fine_curves": len(fine[0]),
        "curves_cut_short": sum(one.status != Status.CONVERGED for one in (*coarse[1], *fine[1])),
        "terms": len(outputs.orders),
        "mesh_error_pct": 100.0 * mesh_error,
        "accuracy": accuracy,
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


def _error_of(part: Trained, met: Floats, chosen: FitTerms) -> Terms:
    """Return ln of the squared relative errors of a fit as terms."""
    return fit_errors(part.points, part.left_out, nearness(part.points, met), chosen.errors)


def _train_further(
    many: dict[Curve, Observed],
    few: dict[Curve, Observed],
    plan: FitPlan,
    span: TrainingRange,
    met: Floats,
    chosen: FitTerms,
) -> tuple[FurtherTerms, dict[str, float]]:
    """Fit an output besides the shape; return its accuracy too."""
    part = _train(many, few, plan, span)
    error = _error_of(part, met, chosen)
    within = coverage(error, part.points, part.left_out)[0]
    accuracy = summary(list(part.worst[:, 0])) | {"coverage_90": within}
    return FurtherTerms(part.terms, error), accuracy


def with_forces(
    surrogate: Surrogate,
    coarse: Solved,
    fine: Solved,
    *,
    usual: Sequence[Curve],
    terms: FitTerms,
) -> Surrogate:
    """Return an emulator that also predicts the blocked tip force.

    It is fitted to curves with the tip held, with the terms of the volume; the error is most
    accurate at the ``usual`` ones.

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
    met = _material_points([counted_in(curve, units) for curve in usual])
    plan = replace(terms.volume, outputs=(0,))
    record = json.loads(surrogate.record)
    force, record["accuracy"]["tip_force"] = _train_further(many, few, plan, span, met, terms)
    answers = {**surrogate.further, "tip_force": force}
    return replace(surrogate, further=answers, record=json.dumps(record, indent=1))


SMALL = ("skin", "paper_mismatch", "gravity_along", "gravity_up")
"""Causes whose whole effect is smooth and a few percent, comparable to errors of many terms."""
_SMOOTH = Family(FLAT, (4, 3, 3, 2), tuple(2 * (cause.name in SMALL) for cause in CAUSES))
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
    `OLD_CURVES` of the whole range. Without a cause nothing changes. Each curve, of the fine mesh,
    has one cause.

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


def _material_points(curves: Sequence[Curve]) -> Floats:
    """Return coordinates of the materials of curves, without a load, (n, 13)."""
    places = np.array([Place.of(curve.material).values for curve in curves])
    return coordinates(np.column_stack([np.zeros(len(places)), places])).points


def terms_below(ground: Surrogate | None, plan: FitPlan) -> tuple[Terms, ...]:
    """Return an emulator's terms for the outputs of a plan; none without an emulator."""
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
        gap = gaps[curve]
        error = (gap.targets - gap.matrix @ shift.without(gap).T)[: gap.n_values]
        if curve in many:  # hold out the coarse twin too
            change = base.without(coarse(many[curve])) - base.coefficients
            rows = _rows(run, base.orders, plan, span)
            error = error - (rows.matrix @ change.T)[: len(error)]
        worst.append(np.max(np.abs(error), axis=0))
        points.append(run.coordinates.points)
        left_out.append(error / run.weights[:, None])
    terms = summed(*under, Terms(shift.orders, shift.coefficients))
    return Trained(terms, np.vstack(points), np.vstack(left_out), np.array(worst))


def _rows(run: Observed, orders: Indices, plan: FitPlan, span: TrainingRange) -> Equations:
    return rows_of(
        *(run, orders),
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
        rows = _rows(run, terms.orders, plan, span)
        targets = targets - rows.matrix @ terms.coefficients.T
    return Equations(part.matrix, targets, part.n_values)
