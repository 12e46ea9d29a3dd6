"""Resolution, effort and status of a solution."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import inf
from typing import Self


class Status(IntEnum):
    """Status of a solution; its ``advice`` says what it means and what to do."""

    CONVERGED = 0
    LIMIT_POINT = 1
    UNSTABLE_MATERIAL = 2
    EFFORT_EXHAUSTED = 3
    OUTSIDE_TRAINING = 4
    BUCKLED = 5
    INVALID_INPUT = 6
    TIMED_OUT = 7

    @property
    def advice(self) -> str:
        """Meaning of the status and what to do, in plain words."""
        return _ADVICE[self]


_ADVICE = {
    Status.CONVERGED: "equilibrium found",
    Status.LIMIT_POINT: "the actuator balloons before this pressure; there is no stable "
    "equilibrium nearby: lower the pressure, or stiffen walls or material",
    Status.UNSTABLE_MATERIAL: "the material softens without bound (C2 <= -sqrt(3 C1 C3), C3 < 0 "
    "or a negative second-invariant term): use constants of a stable material",
    Status.EFFORT_EXHAUSTED: "not converged within the allowed iterations: refine the pressure "
    "steps, or report the parameters",
    Status.OUTSIDE_TRAINING: "outside the emulator's training range: narrow the "
    "priors, or train an emulator on a wider range",
    Status.BUCKLED: "the shape becomes unstable before this pressure although the actuator does "
    "not balloon, as where compressed paper wrinkles: lower the pressure, or check the paper's "
    "stiffness and thickness",
    Status.INVALID_INPUT: "an input is not a number or has an impossible sign, or a wall vanishes: "
    "check that C1 is above 0, and check pressure, scale, paper and walls",
    Status.TIMED_OUT: "not finished within the time allowed: allow more time or a coarser mesh",
}


class Backend(StrEnum):
    """Assembly of the equations; solutions agree to rounding.

    KERNELS are compiled loops. SCIKIT_FEM assembles the weak form written as scikit-fem forms: it
    is readable and verifies the kernels, but takes some forty times as long.
    """

    KERNELS = "kernels"
    SCIKIT_FEM = "scikit-fem"


@dataclass(frozen=True)
class PathEffort:
    """Limits of a path.

    Parameters
    ----------
    tolerance : float
        Largest displacement of the last step of Newton's method over the size of the body [–].
    iterations : int
        Steps of Newton's method at one load.
    halvings : int
        Maximum number of times the shortest load step is halved.
    total : int
        Maximum factorizations per path.
    seconds : float
        Maximum wall time per path, checked between steps [s].
    rate_tolerance : float
        Relative change of the path's tangent at convergence [–].
    first_step : float
        Largest displacement in the first step of the load over the size of the body [–].
    steps : int
        Minimum number of steps up to the last load.
    beyond : float
        Share by which the cavity volume grows beyond that of a limit point [–]. Above 0 the path is
        followed by its volume from rest. Only ``Actuator.sample`` does so: readings at given loads
        are found by the load.
    exact : bool
        Whether to find an equilibrium at every requested load; otherwise the path is interpolated
        between its steps, with an error below the tolerance.
    """

    tolerance: float = 4e-4
    iterations: int = 10
    halvings: int = 8
    total: int = 400
    seconds: float = inf
    rate_tolerance: float = 5e-4
    first_step: float = 0.03
    steps: int = 1
    beyond: float = 0.0
    exact: bool = False


@dataclass(frozen=True)
class Resolution:
    """Element sizes between planes of the geometry.

    Parameters
    ----------
    along, across, up : float
        Largest size of an element in x, y and z, before grading [mm].
    grading : float
        From 0, for uniform elements, to 1: how much smaller elements are next to planes with
        possible re-entrant edges, see ``graded`` [–].
    """

    along: float
    across: float
    up: float
    grading: float = 0.0

    def scaled(self, ratio: float) -> Self:
        """Return the resolution for an actuator larger by a factor.

        Examples
        --------
        >>> Resolution(along=3.0, across=2.0, up=1.0).scaled(2.0).along
        6.0
        """
        along, across, up = (ratio * size for size in (self.along, self.across, self.up))
        return type(self)(along, across, up, self.grading)


COARSE = Resolution(along=3.5, across=2.5, up=5.0)
# within 1 % of the converged curvature on the default geometry
CONVERGED = Resolution(along=1.2, across=1.05, up=1.0, grading=0.75)
FINE = Resolution(along=1.0, across=0.7, up=0.9, grading=0.75)


MODEL_VERSION = "4"  # raised when numbers change, which invalidates stored solutions
