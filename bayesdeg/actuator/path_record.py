"""Readings and derivatives of the equilibria that a path visits."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.linear import Factorization
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.newton import Step
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.sensitivity import derivatives
from bayesdeg.actuator.shape import Variation

Floats = NDArray[np.float64]


class PathRecord:
    """Reads the steps of a path, and differentiates while the solver holds their factors.

    Parameters
    ----------
    mesh : ActuatorMesh
        Whose outputs are read.
    problem : Problem
        That is followed.
    solver : Factorization
        With which it is followed.
    shapes : sequence of Variation
        Of the mesh, None where it cannot vary.
    wanted : frozenset of float, optional
        Loads to be recorded; by default all.
    enough : float
        Relative correction of an adjoint at which it is taken for settled.
    """

    def __init__(
        self,
        mesh: ActuatorMesh,
        problem: Problem,
        solver: Factorization,
        *,
        shapes: Sequence[Variation | None],
        wanted: frozenset[float] | None,
        enough: float,
    ) -> None:
        self._mesh, self._problem, self._solver = mesh, problem, solver
        self._shapes, self._wanted, self._enough = shapes, wanted, enough
        self._angle = 0.0
        self.loads, self.readings = list[float](), list[Floats]()
        self.gradients = list[Floats]()

    def visit(self, step: Step) -> None:
        """Record a converged step."""
        if step.factors is None or not (self._wanted is None or step.state.load in self._wanted):
            return
        reading = read_state(self._mesh, step.state, previous_angle=self._angle)
        self._angle = reading.bend_angle
        self.loads.append(step.state.load)
        self.readings.append(reading.values)
        self.gradients.append(
            derivatives(
                self._problem,
                self._solver,
                state=step.state,
                factors=step.factors,
                mesh=self._mesh,
                shapes=self._shapes,
                enough=self._enough,
            )
        )
