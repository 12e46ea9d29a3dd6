"""How far curves go: the load at which they steepen or end, over the groups."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls

from bayesdeg.emulator.coordinates import LARGEST_WARPED, SLACK, coordinates, scaled_cause
from bayesdeg.emulator.families import Family, features
from bayesdeg.emulator.observations import Reach
from bayesdeg.emulator.regression import Prior
from bayesdeg.emulator.scaling import TrainingRange
from bayesdeg.emulator.terms import Terms, stacked

Floats = NDArray[np.float64]

FAMILY = Family((0, 5, 5, 3), (0, 2, 2, 2), (2, 2, 1, 2, 2, 1, 2, 3, 3), (0, 1, 1, 1))
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
    orders = FAMILY.orders
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
