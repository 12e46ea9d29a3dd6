"""Where further runs tell most: where they lower the predictive error, weighted by the prior.

The posterior variance of a linear fit depends on where runs were made and not on what they found;
times the size of the errors that were found there it says how wrong a prediction may be. A run at
row r lowers the variance at row j by K_rj²/(1 + K_rr), K the covariance of the predictions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from bayesdeg.actuator.curve import Curve
from bayesdeg.emulator.coordinates import Coordinates, coordinates
from bayesdeg.emulator.families import feature_gradients, features
from bayesdeg.emulator.regression import DERIVATIVE_WEIGHT, Prior, half_ranges
from bayesdeg.emulator.scaling import Place, TrainingRange
from bayesdeg.emulator.terms import Terms

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SHARES = (0.3, 0.65, 1.0)  # of a curve's largest load, where it is looked at


@dataclass(frozen=True)
class Question:
    """A linear fit that further runs shall sharpen.

    Parameters
    ----------
    orders : array, shape (n_terms, 13)
        Its terms.
    prior : Prior
        Of its coefficients.
    normal : array, shape (n_terms, n_terms)
        Σ AᵢᵀAᵢ of the runs so far, columns scaled by the prior.
    errors : Terms
        ln of squared relative errors, the first output's.
    """

    orders: Indices
    prior: Prior
    normal: Floats
    errors: Terms


def most_telling(
    question: Question,
    candidates: Sequence[Curve],
    count: int,
    *,
    likely: Sequence[Curve],
    span: TrainingRange,
    on_pick: Callable[[int], None] = lambda index: None,
) -> list[int]:
    """Return which candidates to solve, one after another, each in view of those before.

    A candidate is judged by the sum over its readings of what each alone would gain; once it is
    chosen, its readings and derivatives count together.

    Parameters
    ----------
    question : Question
        What is fitted, and the runs so far.
    candidates : sequence of Curve
        Runs that could be made.
    count : int
        How many shall be made.
    likely : sequence of Curve
        Draws from the prior, over which the predictive variance is averaged.
    span : TrainingRange
        Of the emulator.
    on_pick : callable, optional
        Called with the index of each.
    """
    scales = question.prior.scales(question.orders)
    normal = question.normal + question.prior.noise**2 * np.eye(len(scales))
    places = [_places(curve, span) for curve in candidates]
    targets = np.vstack([_places(curve, span).points for curve in likely])
    sizes = np.exp(features(question.errors.orders, targets) @ question.errors.coefficients[0])
    weights = np.tile(np.square(SHARES), len(likely)) * sizes
    offered = scales * features(question.orders, np.vstack([p.points for p in places]))
    wanted = scales * features(question.orders, targets)
    picked: list[int] = []
    for _ in range(count):
        factor = cholesky(normal, lower=True)
        at, to = (solve_triangular(factor, rows.T, lower=True) for rows in (offered, wanted))
        lowered = np.square(at.T @ to) @ weights / (1.0 + np.sum(at * at, axis=0))
        gain = lowered.reshape(len(candidates), -1).sum(axis=1)
        gain[picked] = 0.0
        best = int(np.argmax(gain))
        picked.append(best)
        on_pick(best)
        rows = _rows(places[best], question.orders, span) * scales
        normal += rows.T @ rows
    return picked


def _places(curve: Curve, span: TrainingRange) -> Coordinates:
    place = Place.of(curve.material)
    loads = np.array(SHARES) * curve.loads[-1] / place.modulus
    found = coordinates(np.column_stack([loads, np.tile(place.values, (len(loads), 1))]), span)
    found.points[:, 0] = np.minimum(found.points[:, 0], 1.0)
    return found


def _rows(place: Coordinates, orders: Indices, span: TrainingRange) -> Floats:
    """Return what a run would add: values and derivatives."""
    slopes = feature_gradients(orders, place.points)
    sizes = DERIVATIVE_WEIGHT * half_ranges(span)
    along = np.einsum("npt,npk->nkt", slopes, place.jacobian) * sizes[None, :, None]
    weighted = np.array(SHARES)[:, None, None] * along
    values = np.array(SHARES)[:, None] * features(orders, place.points)
    return np.vstack([values, weighted.reshape(-1, len(orders))])
