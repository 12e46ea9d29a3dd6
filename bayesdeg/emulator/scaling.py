"""Dimensionless groups: what the forward map really depends on, and the box that was trained.

The curvature of the actuator obeys κ s = f(p/C1, C2/C1, C3/C1, Et/(C1 s)), s the linear scale; so
C1, α and every error of pressure cost the emulator no dimension. The second group is replaced by
the softening C2/√(3 C1 C3), which is above −1 for every stable material, and the last two enter by
their logarithms.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import PAPER_THICKNESS, Inputs, dimensionless
from bayesdeg.actuator.material import Material

Floats = NDArray[np.float64]

# the paper's bending hardly matters: it is trained at one thickness over the linear scale
NOMINAL_SCALE = 0.853
GROUPS = ("softening", "log_stiffening", "log_paper")


@dataclass(frozen=True)
class TrainingBox:
    """The range of the groups over which an emulator is trained.

    Parameters
    ----------
    load : float
        Largest p/C1 [–]; the smallest is 0. See ``largest_load`` for stiffening materials.
    lower, upper : tuple of float
        Bounds of softening C2/√(3 C1 C3) [–], ln(C3/C1) [–] and ln(Et/(C1 s) / mm) [–].
    """

    load: float = 0.96
    lower: tuple[float, float, float] = (-0.65, float(np.log(4e-4)), float(np.log(2.5)))
    upper: tuple[float, float, float] = (0.6, float(np.log(0.5)), float(np.log(1500.0)))

    def unit(self, group: int, values: Floats) -> Floats:
        """Map a group from its range to [−1, 1]."""
        low, high = self.lower[group], self.upper[group]
        scaled: Floats = (2.0 * values - (low + high)) / (high - low)
        return scaled

    def largest_load(self, unit_stiffening: Floats) -> Floats:
        """Return the largest p/C1 for a material whose ln(C3/C1) is at this place of its range.

        Degraded material has a large C3/C1 and a large C1, hence small loads: no pressure of
        interest takes it further than 0.35 at the upper end.

        Examples
        --------
        >>> TrainingBox().largest_load(np.array([-1.0, 1.0])).tolist()
        [0.96, 0.35]
        """
        return np.interp(unit_stiffening, [0.1, 1.0], [self.load, 0.35])

    def material(self, unit: Floats) -> Material:
        """Return the material at a point of the unit cube [0, 1]³.

        Examples
        --------
        >>> round(TrainingBox().material(np.zeros(3)).c3_ratio, 6)
        0.0004
        """
        low, high = np.array(self.lower), np.array(self.upper)
        softening, stiffening, paper = low + (high - low) * unit
        c3 = float(np.exp(stiffening))
        return Material(
            c2_ratio=float(softening * np.sqrt(3.0 * c3)),
            c3_ratio=c3,
            paper_group=float(np.exp(paper)),
            paper_thickness=PAPER_THICKNESS / NOMINAL_SCALE,
        )


def groups(inputs: Inputs) -> tuple[Floats, Floats, Floats, Floats]:
    """Return load p/C1 and the three groups of ``GROUPS``; nan where the material is unstable.

    Shapes are kept: groups of the material alone stay free of the pressure axis.
    """
    load, c2, c3, paper = dimensionless(inputs)
    with np.errstate(invalid="ignore", divide="ignore"):
        return load, c2 / np.sqrt(3.0 * c3), np.log(c3), np.log(paper)
