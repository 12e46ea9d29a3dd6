"""What is read from an equilibrium: bend angle, arc length, cavity volume, stretch.

Every reading comes with its rate along the path, and with its gradient by the nodes' positions,
from which adjoint derivatives follow.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator import surfaces
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.stretch import (
    Stretches,
    principal_stretch,
    pull_back,
    quantile_weights,
    weibull_strain,
)
from bayesdeg.actuator.system import State
from bayesdeg.measure.curvature import spline_curvature

Floats = NDArray[np.float64]

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
    shapes, _, _, weights = surfaces.face_shapes(mesh.body.element.order)
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
    points, weights = surfaces.gauss(order)
    _, derivatives = surfaces.line_shapes(order, points)
    nodes = np.stack([line[i : len(line) - order + i : order] for i in range(order + 1)], axis=1)
    tangent = np.einsum("qa,eai->eqi", derivatives, placed[nodes])
    speed = np.linalg.norm(tangent, axis=2)
    gradient = np.zeros_like(placed)
    pull = np.einsum("q,qa,eqi->eai", weights, derivatives, tangent / speed[..., None])
    np.add.at(gradient, nodes, pull)
    return float(np.sum(speed @ weights)), gradient


def _cavity_volume(mesh: ActuatorMesh, placed: Floats) -> tuple[float, Floats]:
    body, gradient = mesh.body, np.zeros_like(placed)
    volume = surfaces.cavity_volume(
        placed,
        body.cavity,
        surfaces.volume_form(body.element.order),
        1.0,
        gradient,
        np.empty((0, 0, 0), dtype=np.int32),
        np.empty(0),
    )
    return volume, gradient
