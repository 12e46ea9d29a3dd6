r"""Blocked tip force against pressure: the tip is held in the bending direction.

The actuator is modelled as a straight clamped beam of uniform section: an elastomer of Young's
modulus E, area A and centroid height :math:`\bar z` above a paper, a membrane of stiffness
k = (E t) b. Pressure acts on the opening of a chamber, of area :math:`A_c` and centre :math:`z_c`.
Balance of axial force and moment gives the bending moment, that of the pressure about the neutral
axis,

.. math:: M = p A_c (z_c - z_n), \qquad z_n = \frac{E A \bar z}{E A + k}.

At the tip, M alone deflects a beam of bending stiffness B by M L²/(2 B), and the force F that holds
it by F L³/(3 B) the other way: as long as deflections are small,

.. math:: F = \frac{3}{2} \frac{M}{L},

whatever B is. Degradation acts only through the neutral axis: a stiffer elastomer moves it away
from the paper. Bulging walls, dividers and slots between the chambers, and large deflections are
ignored; the parameter ``force_gain`` covers their overall effect. Derived here from composite beam
theory. Finite elements (`bayesdeg.actuator.curve.ExactMap.tip_force`) give 0.35 of it for a fresh
default pneunet at 20 kPa, 0.54 at 200 kPa, and 0.56 to 0.58 where C1 is 1.6 MPa. So if the study
has curvatures and the emulator was trained for forces, forces are those of finite elements with the
tip held, `HeldTip`; the beam is for forces alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, override

import numpy as np
import pandera.pandas as pa
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Asked, Inputs
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import Acting, applied
from bayesdeg.data.batches import batch_order
from bayesdeg.data.settings import Dimensions
from bayesdeg.data.study import Study
from bayesdeg.data.tables import (
    BRANCH_NAMED,
    ONE_DEGRADATION,
    PRESSURE_PROCEEDS,
    SOMETHING_APPLIED,
    TIME_PROCEEDS,
    Table,
    number,
    of_actuators,
)
from bayesdeg.errors import Fault, StudyError
from bayesdeg.observations.curvature import actuator_parameters, mechanics_inputs, parts_of
from bayesdeg.observations.kinds import State
from bayesdeg.observations.noise import Linearised
from bayesdeg.observations.pressures import ReadAtPressures, pressure_tests
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.priors import HalfNormal, LogNormal, Normal, Parameter

Floats = NDArray[np.float64]

TIP_FORCE = "tip force"
TABLE = Table(
    "force",
    pa.DataFrameSchema(
        of_actuators({"tip_force_N": number()}),
        [ONE_DEGRADATION, BRANCH_NAMED, PRESSURE_PROCEEDS, TIME_PROCEEDS, SOMETHING_APPLIED],
        name="force.csv",
    ),
    supports="tip force against pressure",
)
_FORCE = (
    # finite elements give 0.32 to 0.68 over pressures, degradation rates and geometries
    Parameter("force_gain", LogNormal(0.43, 0.3), "–", "blocked tip force over that of a beam"),
    Parameter("force_noise", HalfNormal(0.05), "–", "proportional reading error of force"),
    # load cells for 1 N resolve some millinewtons
    Parameter("force_noise_floor", HalfNormal(0.02), "N", "constant reading error of force"),
)
LEAST = 1e-3  # smallest relative change of the force by which a cause is visible


def blocked_force(inputs: Inputs, mould: Dimensions) -> tuple[Floats, Floats]:
    """Return blocked tip forces of a beam, and their derivatives by ln stiffness.

    Parameters
    ----------
    inputs : Inputs
        Inputs of the mechanics; only the scale and the thickness of walls and roof are used.
    mould : Dimensions
        Dimensions as moulded [mm].

    Returns
    -------
    force, slope : array
        [N]; in the broadcast shape of the inputs.

    Examples
    --------
    >>> one = np.ones(1)
    >>> fresh = Inputs(100 * one, 0.3 * one, 0 * one, 0 * one, one, 3e4 * one)
    >>> force, slope = blocked_force(fresh, Dimensions())
    >>> force.round(3), slope.round(3)
    (array([0.39]), array([-0.108]))
    """
    thicker = 1.0 if inputs.wall_factor is None else inputs.wall_factor
    width = mould.width - 2.0 * thicker * mould.side_wall
    height = mould.height - mould.floor - thicker * mould.roof
    opening, centre = width * height, mould.floor + 0.5 * height
    whole = mould.width * mould.height
    area = whole - opening
    centroid = (0.5 * whole * mould.height - opening * centre) / area
    stretched = 0.0 if inputs.second_invariant is None else inputs.second_invariant
    modulus = 6.0 * inputs.c1 + np.sqrt(3.0) * stretched
    # in N; lengths scale linearly, areas quadratically
    elastomer = modulus * area * inputs.linear_scale**2
    paper = 1e-3 * inputs.paper_stiffness * mould.width * inputs.linear_scale
    axis = centroid * elastomer / (elastomer + paper)
    zero = 0.0 if inputs.reference_pressure is None else inputs.reference_pressure
    load = 1.5e-3 * (inputs.pressure - zero) * opening * inputs.linear_scale**2 / mould.length
    return load * (centre - axis), -load * axis * paper / (elastomer + paper)


def _forces(state: State[FilmsAndActuators], data: "TipForce") -> Linearised:
    """Linearise forces, smooth in the specimens' ln stiffness, at zero deviation."""
    values, parts = state.values, state.once(parts_of, data.tests)
    met = mechanics_inputs(state, data.tests, np.zeros((*parts.spread.shape, 1)))
    mean, slope = (
        values["force_gain"][:, None, None] * one for one in blocked_force(met, data.mould)
    )
    return data.of_mean(values, mean, slope, parts.spread)


@dataclass(frozen=True)
class TipForce(ReadAtPressures):
    """Blocked tip forces of actuators.

    Parameters
    ----------
    tests : PressureTests
        The readings.
    mould : Dimensions
        Dimensions of the actuators.
    recorded : frozenset of str
        Columns with data in the file.
    """

    name: ClassVar[str] = "force"
    order: ClassVar[int] = 25
    priority: ClassVar[int] = 2
    beside: ClassVar[bool] = True
    reading: ClassVar[str] = TIP_FORCE
    column: ClassVar[str] = "tip_force_N"
    output: ClassVar[str] = "tip_force"
    floors: ClassVar[Mapping[str, str]] = {"force_noise_floor": column}

    mould: Dimensions
    recorded: frozenset[str] = frozenset()

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        largest = float(self.tests.conditions.pressure.max())
        of_parts = {p.name: p for p in actuator_parameters(largest)}
        shared = (of_parts["volume_ratio"], of_parts["paper_stiffness"])
        return (*shared, *_FORCE, self.length_parameter())

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        return state.once(_forces, self)

    @override
    def reveals(self, cause: Cause) -> bool:
        """Return whether a cause of typical size changes forces in such tests."""
        conditions = self.tests.conditions
        if not set(cause.needs) <= self.recorded or cause.blind(conditions) is not None:
            return False
        if cause.on_degradation is not None:
            return True
        one = np.ones((1, 1, 1))
        plain = Inputs(
            conditions.pressure * one, 0.3 * one, 0 * one, 0 * one, 0.85 * one, 3e4 * one
        )
        acting = (Acting(cause, {name: size * one for name, size in cause.typical.items()}),)
        met = applied("on_inputs", plain, conditions, acting)
        before, after = (blocked_force(one, self.mould)[0] for one in (plain, met))
        return bool(np.max(np.abs(after - before)) > LEAST * np.max(before))


EMULATOR_ERROR = Parameter(
    "emulator_error_force",
    Normal(0.0, 1.0),
    "–",
    "emulator error common to all tip forces, in standard errors",
)
# covers the load cell and the tip contact: friction, and an edge that is not a line
_CELL = Parameter("force_gain", LogNormal(1.0, 0.05), "–", "measured over computed tip force")


@dataclass(frozen=True)
class HeldTip(ReadAtPressures):
    """Blocked tip forces of actuators by finite elements, in addition to curvatures of others.

    Parameters
    ----------
    tests : PressureTests
        The readings.
    """

    name: ClassVar[str] = "force"
    order: ClassVar[int] = 25
    priority: ClassVar[int] = 1
    beside: ClassVar[bool] = True
    uses_forward: ClassVar[bool] = True
    asks: ClassVar[Asked] = "tip_force"
    reading: ClassVar[str] = TIP_FORCE
    column: ClassVar[str] = "tip_force_N"
    output: ClassVar[str] = "tip_force"
    floors: ClassVar[Mapping[str, str]] = {"force_noise_floor": column}

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        noise = (one for one in _FORCE if one.name != _CELL.name)
        return (_CELL, *noise, self.length_parameter())

    @property
    @override
    def error_parameters(self) -> tuple[Parameter, ...]:
        return (EMULATOR_ERROR,)

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        return state.once(_held_forces, self)


def _held_forces(state: State[FilmsAndActuators], data: HeldTip) -> Linearised:
    """Linearise forces at zero deviation of the specimens' ln stiffness.

    F = C1 f(p/C1), so its derivative by ln stiffness is F − p ∂F/∂p.
    """
    values, spread = state.values, state.once(parts_of, data.tests).spread
    found = data.answered(state, np.zeros((*spread.shape, 1)))
    gain = values["force_gain"][:, None, None]
    mean = gain * (found.value + data.common_error(values) * found.sd)
    return data.of_mean(values, mean, gain * (found.value - found.slope), spread)


def from_study(study: Study) -> tuple[TipForce | HeldTip, ...]:
    """Return the tip forces of a study, if any.

    With curvatures, finite elements predict both; without them, a beam model does.
    """
    batches = batch_order(study.tensile, study.actuator)
    tests = pressure_tests(study.table(TABLE.name), TipForce.column, batches)
    if tests is None:
        return ()
    if study.actuator is not None:
        return (HeldTip(tests),)
    mould, constraint = study.geometry, study.settings.layer
    if not (isinstance(mould, Dimensions) and constraint.is_membrane and not constraint.height):
        problem = "is for an actuator whose tip force cannot be computed"
        remedy = "remove the file: only pneunets with paper on the bottom are supported"
        raise StudyError([Fault(TABLE.file, problem, remedy)])
    return (TipForce(tests, mould, study.recorded.get(TABLE.name, frozenset())),)
