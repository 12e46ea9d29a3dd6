"""Stretch over the volume: measures that converge with the mesh."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.system import State

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Stretches:
    """The largest principal stretch at every quadrature point.

    Parameters
    ----------
    value : array, shape (n_elements, n_points)
        λ [–].
    slope : array, shape (n_elements, n_points, 3, 3)
        ∂λ/∂F = n ⊗ N, the principal axes in space and in the undeformed body [–].
    """

    value: Floats
    slope: Floats

    def rate(self, body: Body, velocity: Floats) -> Floats:
        """Return dλ for a displacement (n_nodes, 3) at every point, (n_elements, n_points)."""
        change = np.empty_like(self.slope)
        kernels.deformation(velocity, body.elements, body.gradients, change)
        change -= np.eye(3)
        rate: Floats = np.einsum("eqij,eqij->eq", self.slope, change)
        return rate


def principal_stretch(body: Body, state: State) -> Stretches:
    """Return the largest principal stretch and its derivative at every quadrature point."""
    f = np.empty((*body.weights.shape, 3, 3))
    kernels.deformation(state.displacement, body.elements, body.gradients, f)
    value = np.empty(body.weights.shape)
    largest_stretch(f, value)
    return Stretches(value, f)


@njit(cache=True)
def largest_stretch(f: Floats, value: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``value`` with the largest principal stretch and ``f`` with ∂λ/∂F = n ⊗ N.

    Eigenvalues of C = FᵀF by the trigonometric formula, the axis as the longest product of two
    rows of C − λ² I, and λ² once more as the axis's Rayleigh quotient.
    """
    axis, moved = np.empty(3), np.empty(3)
    c, d = np.empty((3, 3)), np.empty((3, 3))
    for e in range(value.shape[0]):
        for q in range(value.shape[1]):
            here = f[e, q]
            for i in range(3):
                for j in range(i, 3):
                    c[i, j] = c[j, i] = (
                        here[0, i] * here[0, j] + here[1, i] * here[1, j] + here[2, i] * here[2, j]
                    )
            _longest_axis(c, d, axis)
            length = 0.0
            for i in range(3):
                moved[i] = here[i, 0] * axis[0] + here[i, 1] * axis[1] + here[i, 2] * axis[2]
                length += moved[i] * moved[i]
            length = np.sqrt(length)
            value[e, q] = length
            for i in range(3):
                for j in range(3):
                    here[i, j] = moved[i] / length * axis[j]


@njit(cache=True)
def _longest_axis(c: Floats, d: Floats, axis: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``axis`` with the unit eigenvector of the largest eigenvalue; ``d`` is spare."""
    mean = (c[0, 0] + c[1, 1] + c[2, 2]) / 3.0
    square = 0.0
    for i in range(3):
        for j in range(3):
            d[i, j] = c[i, j] - (mean if i == j else 0.0)
            square += d[i, j] * d[i, j]
    size = np.sqrt(square / 6.0)
    axis[0], axis[1], axis[2] = 1.0, 0.0, 0.0
    if not size > 1e-14 * mean:
        return
    determinant = (
        d[0, 0] * (d[1, 1] * d[2, 2] - d[1, 2] * d[2, 1])
        - d[0, 1] * (d[1, 0] * d[2, 2] - d[1, 2] * d[2, 0])
        + d[0, 2] * (d[1, 0] * d[2, 1] - d[1, 1] * d[2, 0])
    )
    half = min(1.0, max(-1.0, 0.5 * determinant / (size * size * size)))
    top = mean + 2.0 * size * np.cos(np.arccos(half) / 3.0)
    for i in range(3):
        d[i, i] = c[i, i] - top
    longest = 0.0
    for i in range(3):
        k = (i + 1) % 3
        x = d[i, 1] * d[k, 2] - d[i, 2] * d[k, 1]
        y = d[i, 2] * d[k, 0] - d[i, 0] * d[k, 2]
        z = d[i, 0] * d[k, 1] - d[i, 1] * d[k, 0]
        length = np.sqrt(x * x + y * y + z * z)
        if length > longest:
            longest = length
            axis[0], axis[1], axis[2] = x / length, y / length, z / length


def volume_quantile(stretch: Floats, weights: Floats, share: float) -> float:
    """Return the stretch that a share of the volume stays below [–].

    Between the quadrature points, ordered by stretch, the share grows linearly. Unlike the
    largest value, which is singular at re-entrant corners, a quantile converges with the mesh.

    Parameters
    ----------
    stretch, weights : array
        Stretch and volume of every quadrature point.
    share : float
        Between 0 and 1.

    Examples
    --------
    >>> volume_quantile(np.array([1.0, 1.2, 1.1]), np.ones(3), 0.5)
    1.1
    """
    order, left, right, part = quantile_points(stretch, weights, share)
    values = stretch.ravel()[order]
    return float((1.0 - part) * values[left] + part * values[right])


def quantile_points(
    stretch: Floats, weights: Floats, share: float
) -> tuple[NDArray[np.int64], int, int, float]:
    """Return the order by stretch, the two places next to a quantile, and the second's part."""
    order = np.argsort(stretch, axis=None, kind="stable")
    weight = weights.ravel()[order]
    middle = np.cumsum(weight) - 0.5 * weight
    wanted = share * weight.sum()
    right = int(np.clip(np.searchsorted(middle, wanted), 1, len(middle) - 1))
    left = right - 1
    part = float(np.clip((wanted - middle[left]) / (middle[right] - middle[left]), 0.0, 1.0))
    return order, left, right, part


def quantile_weights(stretch: Floats, weights: Floats, share: float) -> tuple[float, Floats]:
    """Return ``volume_quantile`` and its derivative by the stretch of every point.

    The derivative is exact as long as the order of the points by stretch stays.
    """
    order, left, right, part = quantile_points(stretch, weights, share)
    factors = np.zeros(stretch.size)
    factors[order[left]], factors[order[right]] = 1.0 - part, part
    return float(factors @ stretch.ravel()), factors.reshape(stretch.shape)


def weibull_strain(stretch: Floats, weights: Floats, modulus: float) -> tuple[float, Floats]:
    """Return (1/V ∫ ε^m dV)^(1/m), ε = λ − 1, and its derivative by the stretch of every point.

    V times its m-th power is ``weibull_integral``; as a strain it does not vanish for large m.
    """
    strain = np.maximum(stretch - 1.0, 0.0)
    largest = float(strain.max())
    if largest < 1e-12:
        return 0.0, np.zeros_like(stretch)
    shares = weights / weights.sum()
    # relative to the largest, lest high powers of small strains vanish
    mean = float(np.sum(shares * (strain / largest) ** modulus))
    value = largest * mean ** (1.0 / modulus)
    return value, shares * (strain / value) ** (modulus - 1.0)


def weibull_integral(stretch: Floats, weights: Floats, modulus: float) -> float:
    """Return ∫ ε^m dV, ε = λ − 1 the largest principal strain [mm³].

    With strengths that follow Weibull's law, the probability that a volume survives is
    exp(−∫ (ε/ε₀)^m dV/V₀); doi:10.1115/1.4010337. It converges with the mesh as long as m times
    the order of the strain's singularity at sharp corners stays below 2.

    Parameters
    ----------
    stretch, weights : array
        Largest principal stretch and volume of every quadrature point [–, mm³].
    modulus : float
        m [–].

    Examples
    --------
    >>> round(weibull_integral(np.array([1.5, 1.0]), np.array([2.0, 3.0]), 2.0), 12)
    0.5
    """
    return float(np.sum(weights * np.maximum(stretch - 1.0, 0.0) ** modulus))


def pull_back(body: Body, stretches: Stretches, factors: Floats) -> Floats:
    """Return Σ factor ∂λ/∂x over quadrature points, (n_nodes, 3) [1/mm]."""
    element, point = np.nonzero(factors)
    weighted = factors[element, point][:, None, None] * stretches.slope[element, point]
    pull = np.einsum("kij,kja->kai", weighted, body.gradients[element, point], optimize=True)
    gradient = np.zeros_like(body.nodes)
    np.add.at(gradient, body.elements[element], pull)
    return gradient
