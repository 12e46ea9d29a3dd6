r"""Refine an emulator by curves of its own mesh, solved where a posterior lies.

The difference between finite elements and emulator in ln of curvature, bend angle and strains is
fitted to the curves' values, and for smooth readings also to exact derivatives, by polynomials with
small expected coefficients; quantiles also to readings between the curves' equilibria,

.. math:: y(x) = Y(x) + a \cdot \varphi(x), \qquad
    a \sim N(0, N^{-1}), \quad N = S^{-2} + \sigma^{-2} A^T A
    + \frac{1}{m} \sum_{j=1}^m e_j^{-2} \varphi_j \varphi_j^T,

with A the rows of all curves, S prior standard deviations, and e the emulator's own error at m
other places where it is used, which weigh as one: its errors are correlated from place to place.
With the curves' rows alone, :math:`N_A = S^{-2} + \sigma^{-2} A^T A`, the stated standard error is

.. math:: s^2 = \varphi N_A^{-1} \varphi + \rho^2 e^2, \qquad
    \rho^2 = \varphi N_A^{-1} \varphi / \varphi S^2 \varphi,

at most e: :math:`\rho` is the share of the prior left by the curves. The scale is that of errors at
held-out curves.

The load at which curves end is corrected likewise, by a constant and its slopes in the material.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.demand import MEASURES
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.coordinates import coordinates
from bayesdeg.surrogate.fit import (
    FAMILY,
    FIRST,
    FLAT,
    NONE,
    SMALLEST,
    FitPlan,
    counted,
    coverage,
    fit_limit,
    gap_of,
    learned,
    like,
    summary,
    summed,
    terms_below,
)
from bayesdeg.surrogate.local import InputDraws
from bayesdeg.surrogate.regression import (
    ANGLES,
    INSIDE,
    INSIDE_SD,
    STEEPEST,
    STRETCH,
    Equations,
    Observed,
    Prior,
    Regression,
    fit,
    reach,
)
from bayesdeg.surrogate.surrogate import OUTPUTS, Surrogate
from bayesdeg.surrogate.terms import Family, Terms, features, stacked

Floats = NDArray[np.float64]

_WAVY = Family((12, 5, 5, 4), (4, 2, 2, 2), FIRST)
_KINKED = Family((28, 5, 5, 4), (4, 2, 2, 2), FIRST)
_FALLING, _SLOWLY_FALLING = Prior(0.8, 0.6, 0.6, 5e-2), Prior(0.9, 0.6, 0.6, 2e-2)
QUANTILE_WEIGHT = 0.02  # of derivatives: more improves one actuator in three and worsens two
REFINING = like(
    FitPlan(ANGLES, True, _WAVY, _WAVY, _FALLING, _FALLING),
    # where the most stretched region changes place, quantiles have kinks narrower than the steps of
    # a path: they need readings in between, and equally short waves (for a 90 mm actuator orders of
    # 12, 20, 28 and 40 leave 1.0, 0.5, 0.45 and 0.4 %; 40 worsens a 60 mm one). Their derivatives
    # are smoothed over points, and carry less information than those of angles
    FitPlan(
        *(STRETCH, True, _KINKED, _KINKED, _SLOWLY_FALLING, _SLOWLY_FALLING),
        weight=QUANTILE_WEIGHT,
        between=True,
    ),
)
"""Terms of the corrections: the remainder of an already fitted map is wavy, and its waves are
small."""
ENDS = Family((0, 1, 1, 1), FLAT, NONE)
"""Terms of the correction of where curves end."""
SHIFT = Family(FLAT, FLAT, NONE)
"""The same if few curves are seen to end: a single constant."""
SHARES = (0.3, 0.6, 1.0)
"""Shares of the largest load at which errors away from the posterior are evaluated."""
MOST_HELD = 600  # places at which it is held near zero: a few times the number of terms
RIDGE = 1e-3  # of a term's squared size, against all points together
FEWEST = 4  # minimum number of curves for holding out
FEWEST_ENDS = 2  # minimum number of ended curves for holding out
ENDS_FOR_SLOPES = 8  # twice the number of terms of ``ENDS``: slopes through two ends are scatter


class TooFewCurvesError(BayesdegError):
    """Most curves balloon immediately, or hardly bend: nothing to refine an emulator by."""


@dataclass(frozen=True)
class Refinement:
    """A refined emulator, and its versions without each of its curves.

    Parameters
    ----------
    surrogate : Surrogate
        Refined by all curves.
    without : tuple of Surrogate
        Refined by all but one curve, for each curve.
    """

    surrogate: Surrogate
    without: tuple[Surrogate, ...]


def refine(
    ground: Surrogate,
    curves: Sequence[Curve],
    samples: Sequence[PathSamples],
    asked: InputDraws,
    steepest: float = STEEPEST,
) -> Refinement:
    """Refine an emulator's curvature, bend angle, strains and limit by curves of its own mesh.

    The curves lie where a posterior does. At all inputs used, ``asked``, in units of 1, the
    emulator's errors are kept where the curves carry no information. Curves are used up to a growth
    d ln κ / d ln p of ``steepest``.

    Raises
    ------
    TooFewCurvesError
        If fewer than ``FEWEST`` curves are usable.
    """
    with threadpool_limits(1):  # sums over threads depend on their number
        solved = counted(curves, samples, ground.units)
        at_steps, all_along = (
            learned(solved, ground.span, ground.length, steepest, between=between)
            for between in (False, True)
        )
        if (count := len(at_steps)) < FEWEST:
            raise TooFewCurvesError(
                f"only {count} curves are usable where the posterior lies, too few for refinement"
            )
        counted_asked = asked.in_units(ground.units)
        at = [
            np.column_stack([share * counted_asked.load, counted_asked.groups]) for share in SHARES
        ]
        elsewhere = coordinates(np.vstack(at)).points
        elsewhere = elsewhere[np.all(np.isfinite(elsewhere), axis=1)]
        # runs usable at their steps are also usable in between
        known = {False: list(at_steps.values()), True: [all_along[curve] for curve in at_steps]}
        fitted = [_Correction.of(ground, known[plan.between], elsewhere, plan) for plan in REFINING]
        error, strain_error = _error_terms(ground, fitted, elsewhere)
        rest = replace(
            ground,
            error=error,
            strain_error=strain_error,
            limit=_limit(ground, solved, steepest),
            record=_record(ground, fitted, stacked([error, strain_error])),
        )
        whole = _corrected(rest, [(part, part.best.coefficients) for part in fitted])
        return Refinement(
            whole,
            tuple(
                _corrected(rest, [(part, part.without[k]) for part in fitted]) for k in range(count)
            ),
        )


@dataclass(frozen=True)
class _Correction:
    """A fitted correction of the outputs of a plan.

    Parameters
    ----------
    plan : FitPlan
    runs : list of Observed
    best : Regression
        Fit to all of them, held near zero elsewhere.
    alone : Regression
        Fit to the runs alone, which shows where they carry no information.
    without : list of array, shape (n_outputs, n_terms)
        Coefficients without one run.
    left_out : list of array, shape (n, n_outputs)
        Relative errors of each held-out run.
    unit_errors : list of array, shape (n,)
        Standard errors there for residuals of 1.
    """

    plan: FitPlan
    runs: Sequence[Observed]
    best: Regression
    alone: Regression
    without: list[Floats]
    left_out: list[Floats]
    unit_errors: list[Floats]

    @classmethod
    def of(
        cls, ground: Surrogate, runs: Sequence[Observed], elsewhere: Floats, plan: FitPlan
    ) -> "_Correction":
        """Fit the correction, holding out each run in turn; 0 ``elsewhere`` within own errors."""
        span = ground.span
        below, orders, count = terms_below(ground, plan), plan.family.orders, len(plan.outputs)
        gaps = [gap_of(run, plan.family, below, plan, span) for run in runs]
        held = _held_near_zero(ground, elsewhere, plan)
        alone = fit(gaps, orders, plan.prior, outputs=count)
        best = fit([*gaps, held], orders, plan.prior, outputs=count)
        without = [best.without(gap) for gap in gaps]
        left_out = [
            (gap.targets - gap.matrix @ rest.T)[: gap.n_values] / run.weights[:, None]
            for run, gap, rest in zip(runs, gaps, without, strict=True)
        ]
        unit_errors = []
        for gap in gaps:
            # with H = A N⁻¹ Aᵀ of the run's weighted rows, that of the others is H (I − H)⁻¹
            lifted = solve_triangular(alone.factor, (gap.matrix * alone.scales).T, lower=True)
            inner = lifted.T @ lifted
            variance = np.diag(inner @ np.linalg.inv(np.eye(len(inner)) - inner))[: gap.n_values]
            unit_errors.append(np.sqrt(np.maximum(variance, 0.0)))
        return cls(plan, runs, best, alone, without, left_out, unit_errors)

    @property
    def points(self) -> Floats:
        """Coordinates of all values, (n, 13)."""
        return np.vstack([run.coordinates.points for run in self.runs])

    @property
    def scale(self) -> Floats:
        """Residual for which nine tenths of held-out errors lie in the 90 % interval."""
        spread = np.abs(np.vstack(self.left_out)) / np.concatenate(self.unit_errors)[:, None]
        scale: Floats = np.quantile(spread, INSIDE, axis=0) / INSIDE_SD
        return scale

    def prior_error(self, points: Floats) -> Floats:
        """Return the standard error at points without any curve, for residuals of 1, (n,)."""
        scaled = features(self.alone.orders, points) * self.alone.scales
        spread: Floats = np.linalg.norm(scaled, axis=1) / self.plan.prior.noise
        return spread

    def unit_error(self, points: Floats) -> Floats:
        """Return the standard error at points for residuals of 1, (n,)."""
        scaled = features(self.alone.orders, points) * self.alone.scales
        lifted = solve_triangular(self.alone.factor, scaled.T, lower=True)
        return np.sqrt(np.sum(lifted**2, axis=0))


def _held_near_zero(ground: Surrogate, points: Floats, plan: FitPlan) -> Equations:
    """Return equations of zero correction, weighted by the rounding of paths over the error."""
    # An emulator's errors are correlated from place to place, so all together weigh as one: as many
    # independent ones would hold the correction at zero even at the curves.
    thinned = points[:: max(1, len(points) // MOST_HELD)]
    own = stacked([_of_output(ground.error, ground.strain_error, k) for k in plan.outputs])
    log_square = features(own.orders, thinned) @ own.coefficients.T
    weights = SMALLEST * np.exp(-0.5 * log_square.max(axis=1)) / np.sqrt(len(thinned))
    matrix = weights[:, None] * features(plan.family.orders, thinned)
    return Equations(matrix, np.zeros((len(thinned), len(plan.outputs))), len(thinned))


def _of_output(first: Terms, second: Terms, k: int) -> Terms:
    """Return the terms of one of ``OUTPUTS``, and then of ``MEASURES``."""
    return first.output(k) if k < len(OUTPUTS) else second.output(k - len(OUTPUTS))


def _corrected(ground: Surrogate, corrections: Sequence[tuple[_Correction, Floats]]) -> Surrogate:
    """Return the emulator with these corrections added to its outputs."""
    parts = [
        _of_output(ground.terms, ground.strains, k) for k in range(len(OUTPUTS) + len(MEASURES))
    ]
    for part, coefficients in corrections:
        for k, of_output in zip(part.plan.outputs, coefficients, strict=True):
            parts[k] = summed(parts[k], Terms(part.best.orders, of_output[None]))
    outputs, strains = parts[: len(OUTPUTS)], parts[len(OUTPUTS) :]
    return replace(ground, terms=stacked(outputs), strains=stacked(strains))


def _limit(
    ground: Surrogate, solved: tuple[Sequence[Curve], Sequence[PathSamples]], steepest: float
) -> Terms:
    """Return the load at which curves end, corrected if enough are seen to end, and its error."""
    ends = [reach(curve, one, steepest) for curve, one in zip(*solved, strict=True)]
    seen = sum(end.load > 0.0 and not end.open for end in ends)
    if seen < FEWEST_ENDS:
        return ground.limit
    family, own = ENDS if seen >= ENDS_FOR_SLOPES else SHIFT, ground.limit.output(1)
    found = fit_limit(ends, family=family, ground=ground.limit.output(0))
    first = np.all(own.orders == 0, axis=1)
    at_left_out = np.sqrt(0.5 * np.pi) * np.mean(np.abs(found.left_out))
    error = own.coefficients.copy()  # or that of held-out curves if larger
    error[0, first] = np.maximum(error[0, first], at_left_out)
    return stacked([found.terms.output(0), Terms(own.orders, error)])


def _error_terms(
    ground: Surrogate, fitted: Sequence[_Correction], far: Floats
) -> tuple[Terms, Terms]:
    """Return ln of the squared relative errors of ``OUTPUTS`` and of ``MEASURES``.

    The emulator's own error is reduced to the share left by the curves; that of the correction is
    added. Nine tenths of the errors at held-out curves lie within the 90 % interval.
    """
    parts: dict[int, Terms] = {}
    for part in fitted:
        near = part.points
        points = np.vstack([near, far])
        matrix = features(FAMILY.orders, points)
        weights = np.repeat([1.0 / len(near), 1.0 / len(far)], [len(near), len(far)])
        weighted = matrix * weights[:, None]
        penalty = RIDGE * np.eye(matrix.shape[1])
        penalty[0, 0] = 0.0  # the first term is the constant
        unit = np.concatenate([*part.unit_errors, part.unit_error(far)])
        left = np.minimum(unit / part.prior_error(points), 1.0)
        corrections = np.maximum(part.scale * unit[:, None], SMALLEST).T
        missed = np.abs(np.vstack(part.left_out)).T
        for k, correction, at_near in zip(part.plan.outputs, corrections, missed, strict=True):
            own = _of_output(ground.error, ground.strain_error, k)
            log_own = features(own.orders, points) @ own.coefficients[0]
            log_square = np.minimum(
                np.logaddexp(2.0 * np.log(correction), 2.0 * np.log(left) + log_own), log_own
            )
            level = np.linalg.solve(weighted.T @ matrix + penalty, weighted.T @ log_square)
            spread = at_near / np.exp(0.5 * matrix[: len(near)] @ level)
            level[0] += 2.0 * np.log(np.quantile(spread, INSIDE) / INSIDE_SD)
            parts[k] = Terms(FAMILY.orders, level[None])
    ordered = [parts[k] for k in sorted(parts)]
    return stacked(ordered[: len(OUTPUTS)]), stacked(ordered[len(OUTPUTS) :])


def _record(ground: Surrogate, fitted: Sequence[_Correction], error: Terms) -> str:
    """Return the emulator's record with held-out errors of the corrections."""
    record, names = json.loads(ground.record), (*OUTPUTS, *MEASURES)
    accuracy = dict(record.get("accuracy", {}))
    for part in fitted:
        outputs = list(part.plan.outputs)
        own = Terms(error.orders, error.coefficients[outputs])
        shares = coverage(own, part.points, np.vstack(part.left_out))
        worst = np.array(
            [
                np.max(np.abs(run.weights[:, None] * missed), axis=0)
                for run, missed in zip(part.runs, part.left_out, strict=True)
            ]
        )
        for k, column, share in zip(outputs, worst.T, shares, strict=True):
            accuracy[names[k]] = summary(list(column)) | {"coverage_90": share}
    record["accuracy"] = accuracy
    return json.dumps(record, indent=1)
