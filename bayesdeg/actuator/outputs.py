"""What is read from an equilibrium: bend angle, curvature, stretch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator import kernels, surfaces
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.system import State

Floats = NDArray[np.float64]

PEAK_SHARE = 0.99  # share of the volume that is stretched less than the peak stretch


@dataclass(frozen=True)
class Reading:
    """What a camera would see of one equilibrium, at moulded size, and the peak stretch.

    Parameters
    ----------
    bend_angle : float
        Rotation of the free end face towards the paper [rad].
    arc_length : float
        Deformed length of the bottom line [mm].
    peak_stretch : float
        Largest principal stretch that 99 % of the volume stays below [–].
    """

    bend_angle: float
    arc_length: float
    peak_stretch: float

    @property
    def curvature(self) -> float:
        """Bend angle over arc length [1/mm]."""
        return self.bend_angle / self.arc_length


def read_state(mesh: ActuatorMesh, state: State, *, previous_angle: float = 0.0) -> Reading:
    """Return bend angle, arc length and peak stretch of an equilibrium.

    The bend angle is that of the rotation which fits the free end face best in the bending plane:
    θ = atan2(∫ Z' x dA, ∫ Z' z dA), with Z' the height over the face's centroid as moulded and
    (x, z) the deformed position. It is exact for a rigid rotation.

    Parameters
    ----------
    mesh : ActuatorMesh
        The half model.
    state : State
        An equilibrium.
    previous_angle : float
        Angle at the load before [rad]; the angle is unwrapped to the branch next to it.

    Returns
    -------
    Reading
        At moulded size: divide the curvature by the linear scale.
    """
    placed = mesh.nodes + state.displacement
    return Reading(
        bend_angle=_end_rotation(mesh, placed, previous_angle),
        arc_length=_arc_length(placed[mesh.bottom_line]),
        peak_stretch=volume_quantile(mesh, state, PEAK_SHARE),
    )


def volume_quantile(mesh: ActuatorMesh, state: State, share: float) -> float:
    """Return the largest principal stretch that a share of the volume stays below [–].

    Unlike the largest value, which is singular at re-entrant corners, it converges with the mesh.
    """
    stretch = np.empty_like(mesh.weights)
    kernels.principal_stretch(state.displacement, mesh.elements, mesh.gradients, stretch)
    order = np.argsort(stretch, axis=None)
    below = np.cumsum(mesh.weights.ravel()[order])
    return float(stretch.ravel()[order][np.searchsorted(below, share * below[-1])])


def _end_rotation(mesh: ActuatorMesh, placed: Floats, previous: float) -> float:
    shapes, _, _, weights = surfaces.face_shapes()
    grid = mesh.nodes[mesh.free_end]
    area = np.ptp(grid[:, :, 1], axis=1) * np.ptp(grid[:, :, 2], axis=1)
    at = area[:, None] * weights
    height = grid[:, :, 2] @ shapes.T
    arm = at * (height - np.sum(at * height) / np.sum(at))
    x, z = (placed[mesh.free_end][:, :, axis] @ shapes.T for axis in (0, 2))
    angle = float(np.arctan2(np.sum(arm * x), np.sum(arm * z)))
    return angle + 2.0 * np.pi * round((previous - angle) / (2.0 * np.pi))


def _arc_length(line: Floats) -> float:
    _, derivatives = surfaces.quadratic_shapes(surfaces.GAUSS_POINTS)
    pieces = np.stack([line[:-2:2], line[1:-1:2], line[2::2]], axis=1)
    speed = np.linalg.norm(np.einsum("qa,eai->eqi", derivatives, pieces), axis=2)
    return float(np.sum(speed @ surfaces.GAUSS_WEIGHTS))
