"""What is read from an equilibrium: bend angle, arc length, cavity volume, stretch.

Every reading comes with its rate along the path, and with its gradient by the nodes' positions,
from which adjoint derivatives follow.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.system import State
from bayesdeg.data.curvature import spline_curvature

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


PEAK_SHARE = 0.99  # share of the volume that is stretched less than the peak stretch
WEIBULL_MODULI = (5.0, 10.0, 20.0)
OUTPUTS = (
    "bend_angle",
    "arc_length",
    "cavity_volume",
    "peak_stretch",
    *(f"weibull_strain_{modulus:g}" for modulus in WEIBULL_MODULI),
)


@dataclass(frozen=True)
class Reading:
    """What is read of one equilibrium at moulded size.

    Parameters
    ----------
    values : array, shape (n_outputs,)
        In the order of ``OUTPUTS``: rotation of the free end face towards the paper [rad];
        deformed length of the bottom line [mm]; volume of the cavity of the half model [mm³];
        largest principal stretch that 99 % of the volume stays below [–]; and for each modulus m
        the strain (1/V ∫ ε^m dV)^(1/m), ε the largest principal strain λ − 1 [–].
    rates : array, shape (n_outputs,)
        Their derivatives by the load, along the path.
    """

    values: Floats
    rates: Floats

    @property
    def bend_angle(self) -> float:
        """Rotation of the free end face towards the paper [rad]."""
        return float(self.values[0])

    @property
    def arc_length(self) -> float:
        """Deformed length of the bottom line [mm]."""
        return float(self.values[1])

    @property
    def curvature(self) -> float:
        """Bend angle over arc length [1/mm]."""
        return self.bend_angle / self.arc_length

    @property
    def peak_stretch(self) -> float:
        """Largest principal stretch that 99 % of the volume stays below [–]."""
        return float(self.values[3])


def read_state(
    mesh: ActuatorMesh, state: State, *, rate: State | None = None, previous_angle: float = 0.0
) -> Reading:
    """Return what is read of an equilibrium.

    The bend angle is that of the rotation which fits the free end face best in the bending plane:
    θ = atan2(∫ Z' x dA, ∫ Z' z dA), with Z' the height over the face's centroid as moulded and
    (x, z) the deformed position. It is exact for a rigid rotation.

    Parameters
    ----------
    mesh : ActuatorMesh
        The half model.
    state : State
        An equilibrium.
    rate : State, optional
        The path's tangent there; without it the rates are zero.
    previous_angle : float
        Angle at the load before [rad]; the angle is unwrapped to the branch next to it.
    """
    body = mesh.body
    velocity = np.zeros_like(body.nodes) if rate is None else rate.displacement
    stretches = principal_stretch(body, state)
    stretching = stretches.rate(body, velocity)
    lines = _line_readings(mesh, body.nodes + state.displacement, previous_angle)
    strains = _strain_readings(body, stretches)
    values = [value for value, _ in (*lines, *strains)]
    rates = [
        *(np.sum(gradient * velocity) for _, gradient in lines),
        *(np.sum(factors * stretching) for _, factors in strains),
    ]
    return Reading(np.array(values), np.array(rates))


def reading_gradients(mesh: ActuatorMesh, state: State) -> Floats:
    """Return the derivatives of all readings by the nodes' positions, (n_outputs, n_nodes, 3)."""
    body = mesh.body
    stretches = principal_stretch(body, state)
    lines = _line_readings(mesh, body.nodes + state.displacement, 0.0)
    strains = _strain_readings(body, stretches)
    return np.stack(
        [
            *(gradient for _, gradient in lines),
            *(pull_back(body, stretches, factors) for _, factors in strains),
        ]
    )


def _line_readings(
    mesh: ActuatorMesh, placed: Floats, previous_angle: float
) -> list[tuple[float, Floats]]:
    """Angle, arc length and volume, with their gradients by the nodes' positions."""
    return [
        _end_rotation(mesh, placed, previous_angle),
        _arc_length(mesh, placed),
        _cavity_volume(mesh, placed),
    ]


def _strain_readings(body: Body, stretches: Stretches) -> list[tuple[float, Floats]]:
    """Measures of stretch, with their derivatives by the stretch of every point."""
    return [
        quantile_weights(stretches.value, body.weights, PEAK_SHARE),
        *(weibull_strain(stretches.value, body.weights, modulus) for modulus in WEIBULL_MODULI),
    ]


def traced_curvature(mesh: ActuatorMesh, state: State) -> float:
    """Return the mean curvature of a spline through the bottom line's nodes [1/mm].

    This is how an image tool reads a traced line, see ``measure.curvature.spline_curvature``; the
    contract's curvature is the bend angle over the arc length.
    """
    line = (mesh.body.nodes + state.displacement)[mesh.bottom_line]
    return spline_curvature(line[:, (0, 2)]) * 1e-3


def _end_rotation(mesh: ActuatorMesh, placed: Floats, previous: float) -> tuple[float, Floats]:
    shapes, _, _, weights = kernels.face_shapes(mesh.body.element.order)
    grid = mesh.body.nodes[mesh.free_end]
    area = np.ptp(grid[:, :, 1], axis=1) * np.ptp(grid[:, :, 2], axis=1)
    at = area[:, None] * weights
    height = grid[:, :, 2] @ shapes.T
    arm = (at * (height - np.sum(at * height) / np.sum(at))) @ shapes
    moments = np.zeros(len(placed))
    np.add.at(moments, mesh.free_end, arm)
    sine, cosine = moments @ placed[:, 0], moments @ placed[:, 2]
    gradient = np.zeros_like(placed)
    square = sine * sine + cosine * cosine
    gradient[:, 0], gradient[:, 2] = cosine / square * moments, -sine / square * moments
    angle = float(np.arctan2(sine, cosine))
    return angle + 2.0 * np.pi * round((previous - angle) / (2.0 * np.pi)), gradient


def _arc_length(mesh: ActuatorMesh, placed: Floats) -> tuple[float, Floats]:
    order, line = mesh.body.element.order, mesh.bottom_line
    points, weights = kernels.gauss(order)
    _, derivatives = kernels.line_shapes(order, points)
    nodes = np.stack([line[i : len(line) - order + i : order] for i in range(order + 1)], axis=1)
    tangent = np.einsum("qa,eai->eqi", derivatives, placed[nodes])
    speed = np.linalg.norm(tangent, axis=2)
    gradient = np.zeros_like(placed)
    pull = np.einsum("q,qa,eqi->eai", weights, derivatives, tangent / speed[..., None])
    np.add.at(gradient, nodes, pull)
    return float(np.sum(speed @ weights)), gradient


def _cavity_volume(mesh: ActuatorMesh, placed: Floats) -> tuple[float, Floats]:
    body, gradient = mesh.body, np.zeros_like(placed)
    volume = kernels.cavity_volume(
        placed,
        body.cavity,
        kernels.volume_form(body.element.order),
        1.0,
        gradient,
        np.empty((0, 0, 0), dtype=np.int32),
        np.empty(0),
    )
    return volume, gradient
