"""How fine a mesh is, apart from the mesh."""

from dataclasses import dataclass


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


COARSE = Resolution(along=3.5, across=2.5, up=5.0)
# on the default geometry within 1 % of the curvature of vanishing elements
CONVERGED = Resolution(along=1.2, across=1.05, up=1.0, grading=0.75)
FINE = Resolution(along=1.0, across=0.7, up=0.9, grading=0.75)
