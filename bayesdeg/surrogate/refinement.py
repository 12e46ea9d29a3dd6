r"""Refine an emulator by curves of its own mesh, solved where a posterior lies.

The difference between finite elements and emulator in ln of curvature, bend angle, strains and load
at a swelling is fitted to the curves' values and derivatives, by polynomials with small expected
coefficients,

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
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

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
    SMALLEST,
    FitPlan,
    counted,
    coverage,
    gap_of,
    learned,
    like,
    summary,
    summed,
    terms_below,
    worst_errors,
)
from bayesdeg.surrogate.local import InputDraws
from bayesdeg.surrogate.regression import (
    ANGLES,
    INSIDE,
    INSIDE_SD,
    LOADS,
    STRETCH,
    Equations,
    Observed,
    Prior,
    Regression,
    fit,
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
    # where the most stretched region changes place, quantiles have kinks: they need short waves
    # (for a 90 mm actuator orders of 12, 20, 28 and 40 leave 1.0, 0.5, 0.45 and 0.4 %; 40 worsens a
    # 60 mm one). Their derivatives are smoothed over points, and say less than those of angles
    FitPlan(
        *(STRETCH, True, _KINKED, _KINKED, _SLOWLY_FALLING, _SLOWLY_FALLING), weight=QUANTILE_WEIGHT
    ),
)
"""Terms of the corrections: the remainder of an already fitted map is wavy, and its waves are
small."""
SHARES = (0.3, 0.6, 1.0)
"""Shares of the largest swelling at which errors away from the posterior are evaluated."""
MOST_HELD = 600  # places at which it is held near zero: a few times the number of terms
RIDGE = 1e-3  # of a term's squared size, against all points together
FEWEST = 4  # minimum number of curves for holding out


class TooFewCurvesError(BayesdegError):
    """Most curves hardly bend: nothing to refine an emulator by."""


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
) -> Refinement:
    """Refine an emulator's curvature, bend angle, strains and load by curves of its own mesh.

    The curves lie where a posterior does. At all inputs used, ``asked``, in units of 1, the
    emulator's errors are kept where the curves carry no information.

    Raises
    ------
    TooFewCurvesError
        If fewer than ``FEWEST`` curves are usable.
    """
    with threadpool_limits(1):  # sums over threads depend on their number
        solved = counted(curves, samples, ground.units)
        runs = list(learned(solved, ground.span, ground.length, ground.compliance).values())
        if (count := len(runs)) < FEWEST:
            raise TooFewCurvesError(
                f"only {count} curves are usable where the posterior lies, too few for refinement"
            )
        elsewhere = _along_curves(ground, asked.in_units(ground.units))
        fitted = [_Correction.of(ground, runs, elsewhere, plan) for plan in REFINING]
        rest = _with_errors(ground, fitted, elsewhere)
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
        below, orders, count = terms_below(ground, plan), plan.family.orders, len(plan.outputs)
        gaps = [gap_of(run, plan.family, below, plan) for run in runs]
        held = _held_near_zero(ground, elsewhere, plan)
        alone = fit(gaps, orders, plan.prior, outputs=count)
        best = fit([*gaps, held], orders, plan.prior, outputs=count)
        without = [best.without(gap) for gap in gaps]
        left_out = [
            (gap.targets - gap.matrix @ rest.T)[: gap.n_values]
            / run.weights_of(plan.outputs)[:, None]
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
    own = stacked([_split(_ERRORS, ground, k) for k in plan.outputs])
    log_square = features(own.orders, thinned) @ own.coefficients.T
    weights = SMALLEST * np.exp(-0.5 * log_square.max(axis=1)) / np.sqrt(len(thinned))
    matrix = weights[:, None] * features(plan.family.orders, thinned)
    return Equations(matrix, np.zeros((len(thinned), len(plan.outputs))), len(thinned))


_TERMS = ("terms", "strains", "load")
_ERRORS = ("error", "strain_error", "load_error")
Tables = tuple[str, str, str]


def _split(tables: Tables, ground: Surrogate, k: int) -> Terms:
    """Return the terms of one of ``OUTPUTS``, ``MEASURES`` and the load."""
    parts: list[Terms] = [getattr(ground, name) for name in tables]
    return stacked(parts).output(k)


def _with_tables(ground: Surrogate, tables: Tables, parts: Sequence[Terms]) -> Surrogate:
    """Return the emulator with terms of all outputs, in order."""
    ends = (len(OUTPUTS), len(OUTPUTS) + len(MEASURES))
    split = (parts[: ends[0]], parts[ends[0] : ends[1]], parts[ends[1] :])
    changes: dict[str, Any] = {n: stacked(part) for n, part in zip(tables, split, strict=True)}
    return replace(ground, **changes)


def _corrected(ground: Surrogate, corrections: Sequence[tuple[_Correction, Floats]]) -> Surrogate:
    """Return the emulator with these corrections added to its outputs."""
    parts = [_split(_TERMS, ground, k) for k in range(LOADS[0] + 1)]
    for part, coefficients in corrections:
        for k, of_output in zip(part.plan.outputs, coefficients, strict=True):
            parts[k] = summed(parts[k], Terms(part.best.orders, of_output[None]))
    return _with_tables(ground, _TERMS, parts)


def _along_curves(ground: Surrogate, asked: InputDraws) -> Floats:
    """Return coordinates along the curves of inputs that are used, (n, 13)."""
    swelling = ground.swelling(asked.groups, asked.load)
    parts = [np.column_stack([share * swelling, asked.groups]) for share in SHARES]
    return coordinates(np.vstack(parts)[np.tile(np.isfinite(swelling), len(SHARES))]).points


def _with_errors(ground: Surrogate, fitted: Sequence[_Correction], far: Floats) -> Surrogate:
    """Return the emulator with the errors that it has once it is corrected.

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
            own = _split(_ERRORS, ground, k)
            log_own = features(own.orders, points) @ own.coefficients[0]
            log_square = np.minimum(
                np.logaddexp(2.0 * np.log(correction), 2.0 * np.log(left) + log_own), log_own
            )
            level = np.linalg.solve(weighted.T @ matrix + penalty, weighted.T @ log_square)
            spread = at_near / np.exp(0.5 * matrix[: len(near)] @ level)
            level[0] += 2.0 * np.log(np.quantile(spread, INSIDE) / INSIDE_SD)
            parts[k] = Terms(FAMILY.orders, level[None])
    ordered = [parts[k] for k in sorted(parts)]
    corrected = _with_tables(ground, _ERRORS, ordered)
    return replace(corrected, record=_record(ground, fitted, stacked(ordered)))


def _record(ground: Surrogate, fitted: Sequence[_Correction], error: Terms) -> str:
    """Return the emulator's record with held-out errors of the corrections."""
    record, names = json.loads(ground.record), (*OUTPUTS, *MEASURES, "load")
    accuracy = dict(record.get("accuracy", {}))
    ordered = sorted(fitted, key=lambda part: part.plan.outputs)
    worst = worst_errors(ordered[0].runs, np.hstack([np.vstack(p.left_out) for p in ordered]))
    for part in ordered:
        outputs = list(part.plan.outputs)
        own = Terms(error.orders, error.coefficients[outputs])
        shares = coverage(own, part.points, np.vstack(part.left_out))
        for k, share in zip(outputs, shares, strict=True):
            accuracy[names[k]] = summary(list(worst[:, k])) | {"coverage_90": share}
    record["accuracy"] = accuracy
    return json.dumps(record, indent=1)
