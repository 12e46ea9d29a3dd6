"""How far the emulator is from fine finite element curves that its training never saw."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from forward_case import say
from numpy.typing import NDArray
from scipy.stats import norm

from bayesdeg.actuator.curve import Curve, CurveSolution, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import CONVERGED
from bayesdeg.actuator.outputs import OUTPUTS as READINGS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.emulator.campaign import Finished, Kind, Run, complete, missing
from bayesdeg.emulator.held_out import study_like
from bayesdeg.emulator.observations import reach
from bayesdeg.emulator.scaling import CAUSES, Place
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.surrogate import OUTPUTS, Surrogate
from bayesdeg.measure.settings import Dimensions

Floats = NDArray[np.float64]

CURVES, SEED = 40, 5
STORE = Path(".cache/campaign")
HALF_WIDTH = float(norm.ppf(0.95))  # of a 90 % interval, in standard errors


@dataclass(frozen=True)
class HeldOut:
    """A curve that no training saw, and what the fine mesh says of it."""

    curve: Curve
    solution: CurveSolution

    @property
    def reached(self) -> int:
        return len(self.solution.readings)

    @property
    def n_causes(self) -> int:
        place = Place.of(self.curve.material)
        neutral = dict.fromkeys((c.name for c in CAUSES), 0.0) | {c.name: c.neutral for c in CAUSES}
        found = dict(zip((g.name for g in _groups()), place.values, strict=True))
        acting = {name for name, value in neutral.items() if abs(found[name] - value) > 1e-9}
        # the thickness is a cause only where the paper is not the nominal one at the part's scale
        return len(acting - {"paper_thickness"}) + _other_paper(self.curve)

    @cached_property
    def truth(self) -> Floats:
        """Changes of curvature and bend angle, and peak stretch less 1, (3, n_reached)."""
        rows = np.vstack([self.solution.rest, self.solution.readings])
        angle, length = rows[:, 0], rows[:, 1]
        kappa = angle / length * 1e3
        stretch = rows[:, READINGS.index("peak_stretch")] - 1.0
        change = np.stack([kappa - kappa[0], np.degrees(angle - angle[0]), stretch])
        return change[:, 1:]
