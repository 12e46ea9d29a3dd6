"""How fine a solution is, what it may spend, and how it ended."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import inf
from typing import Self


class Status(IntEnum):
    """How a solution ended; the member's ``advice`` says what it means and what to do."""

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
        """What the status means, in plain words."""
        return _ADVICE[self]


_ADVICE = {
    Status.CONVERGED: "equilibrium found",
    Status.LIMIT_POINT: "the actuator balloons before this pressure; there is no stable "
    "equilibrium near by: lower the pressure, or stiffen walls or material",
    Status.UNSTABLE_MATERIAL: "the constants soften without bound (C2 <= -sqrt(3 C1 C3), C3 < 0 "
    "or a negative second-invariant term): use constants of a stable material",
    Status.EFFORT_EXHAUSTED: "not converged within the allowed iterations: refine the pressure "
    "steps or report the parameters",
    Status.OUTSIDE_TRAINING: "outside the range on which the emulator was trained: narrow the "
    "priors or train an emulator on a wider range",
    Status.BUCKLED: "the shape loses its stability before this pressure although the actuator "
    "does not balloon, as where compressed paper wrinkles: lower the pressure, or check the "
    "paper's stiffness and thickness",
    Status.INVALID_INPUT: "an input is not a number or has an impossible sign, or nothing is left "
    "of a wall: check that C1 is above 0, and pressure, scale, paper and walls",
    Status.TIMED_OUT: "not finished within the time allowed: allow more time, or a coarser mesh",
}


class Backend(StrEnum):
    """What assembles the equations; solutions agree to rounding.

    KERNELS are compiled loops. SCIKIT_FEM takes the weak form, written as scikit-fem's forms: it
    is there to be read and to hold the kernels against, and assembles some forty times as long.
    """

    KERNELS = "kernels"
    SCIKIT_FEM = "scikit-fem"


@dataclass(frozen=True)
class PathEffort:
    """What a path may spend.

    Parameters
    ----------
    tolerance : float
        Largest displacement of the last step of Newton's method over the size of the body [–].
    iterations : int
        Steps of Newton's method at one load.
    halvings : int
        How often the smallest distance between loads may be halved.
    total : int
        Factorizations a path.
    seconds : float
        Wall time a path, looked at between steps [s].
    rate_tolerance : float
        Relative change at which the tangent of the path is taken for settled [–].
    first_step : float
        Largest displacement in the first step of the load over the size of the body [–].
    steps : int
        At least so many are made up to the last load.
    exact : bool
        Whether an equilibrium is found at every load asked for; otherwise the path is interpolated
        between the steps that its course needs, with an error below the tolerance.
    """

    tolerance: float = 4e-4
    iterations: int = 10
    halvings: int = 8
    total: int = 400
    seconds: float = inf
    rate_tolerance: float = 5e-4
    first_step: float = 0.03
    steps: int = 1
    exact: bool = False


@dataclass(frozen=True)
class Resolution:
    """How finely the space between two planes of the geometry is divided.

    Parameters
    ----------
    along, across, up : float
        Largest size of an element in x, y and z, before grading [mm].
    grading : float
        Between 0, for elements of one size, and 1: how much smaller elements are next to planes
        where re-entrant edges may stand, see ``graded`` [–].
    """

    along: float
    across: float
    up: float
    grading: float = 0.0

    def scaled(self, ratio: float) -> Self:
        """Return the resolution for an actuator that is so many times as large.

        Examples
        --------
        >>> Resolution(along=3.0, across=2.0, up=1.0).scaled(2.0).along
        6.0
        """
        along, across, up = (ratio * size for size in (self.along, self.across, self.up))
        return type(self)(along, across, up, self.grading)


COARSE = Resolution(along=3.5, across=2.5, up=5.0)
# on the default geometry within 1 % of the curvature of vanishing elements
CONVERGED = Resolution(along=1.2, across=1.05, up=1.0, grading=0.75)
FINE = Resolution(along=1.0, across=0.7, up=0.9, grading=0.75)


MODEL_VERSION = "3"  # raised when numbers change: stored solutions then count no more
