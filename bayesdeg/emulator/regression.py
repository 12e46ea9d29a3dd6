"""Least squares over many terms: coefficients are expected to fall with their order.

The prior standard deviation of a coefficient falls by a factor with every order in load, material
or cause, so that there may be more terms than the runs alone would determine. Whole runs are left
out by the block form of the leave-one-out identity.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from bayesdeg.emulator.families import feature_gradients, features
from bayesdeg.emulator.observations import FLOOR, Observed
from bayesdeg.emulator.scaling import CAUSES, MATERIAL, TrainingRange
from bayesdeg.emulator.terms import N_CHEBYSHEV

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

DERIVATIVE_WEIGHT = 0.2  # of a derivative over half of its group's range, against a value


@dataclass(frozen=True)
class Prior:
    """How fast coefficients fall with their order.

    Parameters
    ----------
    load, material, cause : float
        Factor an order [–].
    noise : float
        Standard deviation of the residual over that of the first coefficient [–].
    """

    load: float = 0.6
    material: float = 0.45
    cause: float = 0.35
    noise: float = 1e-2

    def scales(self, orders: Indices) -> Floats:
        """Return the prior standard deviation of every coefficient over that of the first."""
        scales: Floats = (
            self.load ** orders[:, 0]
            * self.material ** orders[:, 1:N_CHEBYSHEV].sum(axis=1)
            * self.cause ** orders[:, N_CHEBYSHEV:].sum(axis=1)
        )
        return scales


@dataclass(frozen=True)
class Rows:
    """Weighted equations of one run: ``matrix @ coefficients = targets``.

    The first ``n_values`` are those of the values; the others are of derivatives.
    """

    matrix: Floats
    targets: Floats
    n_values: int


def half_ranges(span: TrainingRange) -> Floats:
    """Return the size of load and groups that derivatives are taken over, (13,)."""
    causes = [max(c.high - c.neutral, c.neutral - c.low) for c in CAUSES]
    material = [0.5 * (g.high - g.low) for g in MATERIAL]
    return np.array([0.5 * span.load, *material, *causes])


def rows_of(
    run: Observed,
    orders: Indices,
    *,
    outputs: Sequence[int],
    span: TrainingRange,
    derivatives: bool = True,
) -> Rows:
    """Return the equations of a run for some outputs, of their values and derivatives."""
    place, w = run.coordinates, run.weights[:, None]
    values = features(orders, place.points)
    matrix = [w * values]
    targets = [w * (run.values[:, outputs] - place.warp[:, None])]
    if derivatives:
        slopes = feature_gradients(orders, place.points)
        sizes = DERIVATIVE_WEIGHT * half_ranges(span)
        for k in np.flatnonzero(run.known & np.all(np.isfinite(run.gradients), axis=(0, 1))):
            along = np.einsum("npt,np->nt", slopes, place.jacobian[:, :, k])
            wanted = run.gradients[:, outputs, k] - place.warp_gradient[:, k, None]
            matrix.append(sizes[k] * w * along)
            targets.append(sizes[k] * w * wanted)
        if np.all(np.isfinite(run.first[outputs])):
            start = place.points[:1].copy()
            start[0, 0] = -1.0
            start[0, N_CHEBYSHEV:] = _at_rest(run)
            matrix.append(FLOOR * features(orders, start))
            targets.append(FLOOR * (run.first[None, outputs] - place.warp[:1, None]))
    return Rows(np.vstack(matrix), np.vstack(targets), len(values))


def _at_rest(run: Observed) -> Floats:
    """Return the causes' coordinates at zero load: slack paper is then not felt at all."""
    causes = run.coordinates.points[0, N_CHEBYSHEV:].copy()
    slack = [c.name for c in CAUSES].index("paper_slack")
    causes[slack] = float(not run.tight)
    return causes


@dataclass(frozen=True)
class Fit:
    """A regression, with all that leaving out runs needs.

    Parameters
    ----------
    orders : array, shape (n_terms, 13)
    coefficients : array, shape (n_outputs, n_terms)
    scales : array, shape (n_terms,)
    factor : array
        Cholesky factor of the scaled normal matrix.
    """

    orders: Indices
    coefficients: Floats
    scales: Floats
    factor: Floats

    def without(self, rows: Rows) -> Floats:
        """Return the coefficients that a fit without one run's rows would have.

        a₋ᵢ = a − N⁻¹ Aᵢᵀ (I − Hᵢ)⁻¹ eᵢ, Hᵢ = Aᵢ N⁻¹ Aᵢᵀ.
        """
        scaled = rows.matrix * self.scales
        lifted = cho_solve((self.factor, True), scaled.T)
        residual = rows.targets - rows.matrix @ self.coefficients.T
        inner = np.eye(len(scaled)) - scaled @ lifted
        change = lifted @ np.linalg.solve(inner, residual)
        without: Floats = self.coefficients - (self.scales[:, None] * change).T
        return without


def fit(rows: Iterable[Rows], orders: Indices, prior: Prior, *, outputs: int) -> Fit:
    """Return the most probable coefficients for the equations of all runs, taken one by one."""
    scales = prior.scales(orders)
    normal = prior.noise**2 * np.eye(len(orders))
    right = np.zeros((len(orders), outputs))
    for part in rows:
        scaled = part.matrix * scales
        normal += scaled.T @ scaled
        right += scaled.T @ part.targets
    factor, _ = cho_factor(normal, lower=True)
    coefficients = scales[:, None] * cho_solve((factor, True), right)
    return Fit(orders, coefficients.T, scales, factor)
