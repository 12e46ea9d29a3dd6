"""Fine finite element curves that no training sees, and how the emulator is asked for them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from forward_case import say
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Curve, CurveSolution
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import CONVERGED
from bayesdeg.actuator.outputs import OUTPUTS as READINGS
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import Finished, complete, missing
from bayesdeg.surrogate.design import study_like
from bayesdeg.surrogate.solutions import Kind, Run, SolutionStore

Floats = NDArray[np.float64]

CURVES, SEED = 40, 5
NEUTRAL = {"wall_factor": 1.0}
MATERIAL = ("c2_ratio", "c3_ratio", "paper_group", "paper_poisson", "bulk_ratio")
# paper of the nominal thickness over the scale of any part with α = 0.62 ± 0.15 [mm]
NOMINAL_PAPER = (0.1 / np.cbrt(0.77), 0.1 / np.cbrt(0.47))


@dataclass(frozen=True)
class HeldOut:
    """A curve that no training saw, and what the fine mesh says of it."""

    curve: Curve
    solution: CurveSolution
    seconds: float

    @property
    def causes(self) -> int:
        """How many causes are at work; a paper of another thickness than the nominal one is one."""
        at = vars(self.curve.material)
        names = {f.name for f in fields(MaterialGroups)} - {*MATERIAL, "paper_thickness"}
        acting = sum(at[name] != NEUTRAL.get(name, 0.0) for name in names)
        low, high = NOMINAL_PAPER
        return int(acting + (not low <= at["paper_thickness"] <= high))

    @property
    def inputs(self) -> Inputs:
        """What an emulator is asked for, with C1 = 1 MPa and at moulded size, as far as solved."""
        return inputs_of(self.curve, np.array(self.curve.loads[: len(self.solution.readings)]))

    @cached_property
    def truth(self) -> Floats:
        """Changes of curvature [1/m] and bend angle [deg], peak stretch less 1, (3, n_reached)."""
        rows = np.vstack([self.solution.rest, self.solution.readings])
        kappa, angle = rows[:, 0] / rows[:, 1] * 1e3, np.degrees(rows[:, 0])
        stretch = rows[:, READINGS.index("peak_stretch")] - 1.0
        return np.stack([kappa - kappa[0], angle - angle[0], stretch])[:, 1:]


def inputs_of(curve: Curve, loads: Floats) -> Inputs:
    """Return a curve's groups as the inputs of a part with C1 = 1 MPa, at moulded size."""
    m = curve.material

    def one(value: float) -> Floats:
        return np.array([value])

    return Inputs(
        pressure=1e3 * loads,
        c1=one(1.0),
        c2=one(m.c2_ratio),
        c3=one(m.c3_ratio),
        linear_scale=one(1.0),
        paper_stiffness=one(1e3 * m.paper_group),
        second_invariant=one(m.second_invariant_ratio),
        skin=one(m.skin),
        paper_thickness=one(m.paper_thickness),
        paper_slack=one(m.paper_slack),
        paper_mismatch=one(m.paper_mismatch),
        weight_along=one(1e6 * m.gravity_along),
        weight_up=one(1e6 * m.gravity_up),
        wall_factor=one(m.wall_factor),
        erosion=one(m.erosion),
    )


def show(finished: Finished) -> None:
    """Say how a run ended, and after what time."""
    say(f"  {finished.solution.status.name} after {finished.seconds:.1f} s")


def held_out(store: SolutionStore, *, count: int = CURVES) -> list[HeldOut]:
    """Return the held-out curves, those solved that the store lacks."""
    geometry = Geometry(Dimensions())
    curves = study_like(count, seed=SEED)
    wanted = [Run(geometry, CONVERGED, curve, Kind.CURVE) for curve in curves]
    left = len(missing(wanted, store))
    say(f"{len(wanted) - left} of {len(wanted)} held-out curves stand in the store")

    found = complete(wanted, store, on_run=show)
    return list(_paired(wanted, found, store))


def _paired(
    wanted: Sequence[Run], found: Sequence[object], store: SolutionStore
) -> Sequence[HeldOut]:
    seconds = store.seconds()
    return [
        HeldOut(run.curve, solution, seconds[run.key()])
        for run, solution in zip(wanted, found, strict=True)
        if isinstance(solution, CurveSolution)
    ]
