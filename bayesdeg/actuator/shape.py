"""How residual and readings change as walls grow and faces erode: the same bricks moved.

All nodes move in proportion to the wall factor and to the erosion, so the mesh is moved a little
along that direction, and everything is evaluated at the same displacement.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.material import Material
from bayesdeg.actuator.mesh import ActuatorMesh, reshaped
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.system import State, System
from bayesdeg.errors import GeometryError

Floats = NDArray[np.float64]

SHAPE_INPUTS = ("wall_factor", "erosion")
STEP = 1e-7  # of the wall factor [–] and of the erosion [mm]
APART = 1e-5  # between the two meshes whose difference is the direction


@dataclass(frozen=True)
class Variation:
    """A mesh and its equations at one shape input plus ``STEP``."""

    mesh: ActuatorMesh
    problem: Problem

    def derivatives(self, here: "Evaluated", adjoints: Sequence[State]) -> Floats:
        """Return derivatives of all readings by the shape input at an equilibrium, (n_outputs,).

        dg/dm = ∂g/∂m − λᵤᵀ ∂R/∂m − λₚᵀ ∂r/∂m, with R the residual of the forces, r that of the
        volume, and (λᵤ, λₚ) the adjoint of the reading g. The partial derivatives are
        differences over ``STEP``, good to about 1e-7 of the whole.
        """
        there = evaluated(self.mesh, self.problem, here.state)
        force, volume = there.force - here.force, there.volume - here.volume
        through = [np.sum(a.displacement * force) + np.sum(a.pressure * volume) for a in adjoints]
        return (there.readings - here.readings - np.array(through)) / STEP


@dataclass(frozen=True)
class Evaluated:
    """Readings and residuals of a mesh at a state."""

    state: State
    readings: Floats
    force: Floats
    volume: Floats


def evaluated(mesh: ActuatorMesh, problem: Problem, state: State) -> Evaluated:
    """Return readings and residuals of a mesh at a state."""
    residual = problem.linearise(state, tangent=False)
    readings = read_state(mesh, state).values
    return Evaluated(state, readings, residual.force, residual.volume_residual)


def variations(
    nominal: ActuatorMesh, system: System, material: Material
) -> tuple[Variation | None, ...]:
    """Return the variations of ``SHAPE_INPUTS`` about a material's walls and erosion.

    Parameters
    ----------
    nominal : ActuatorMesh
        Before walls and faces are moved.
    system : System
        Of the nominal mesh.
    material : Material
        With the wall factor and the erosion to vary about.

    Returns
    -------
    tuple
        None where the geometry does not allow an input to vary.
    """
    at = {"wall_factor": material.wall_factor, "erosion": material.erosion}
    here = reshaped(nominal, **at)
    # towards the neutral value, where there is an actuator for certain
    towards = {
        "wall_factor": APART if material.wall_factor < 1.0 else -APART,
        "erosion": -APART if material.erosion > APART else APART,
    }
    found: list[Variation | None] = []
    for name in SHAPE_INPUTS:
        try:
            other = reshaped(nominal, **at | {name: at[name] + towards[name]})
        except GeometryError:
            found.append(None)
            continue
        found.append(_moved(here, other, system, material, share=STEP / towards[name]))
    return tuple(found)


def _moved(
    here: ActuatorMesh, other: ActuatorMesh, system: System, material: Material, *, share: float
) -> Variation:
    """Return the mesh moved by a share of the way to another."""
    body = here.body.placed_at(here.body.nodes + share * (other.body.nodes - here.body.nodes))
    depth = here.body.depth + share * (other.body.depth - here.body.depth)
    mesh = replace(here, body=replace(body, depth=depth))
    return Variation(mesh, Problem(system.with_body(mesh.body), material))
