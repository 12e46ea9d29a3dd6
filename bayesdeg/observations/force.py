r"""Blocked tip force against pressure: the tip is held in the bending direction.

The actuator is a beam, straight and clamped at one end, of one section all along: an elastomer of
Young's modulus E, area A and centroid height :math:`\bar z` above a paper that is a membrane of
stiffness k = (E t) b. Pressure acts on the opening of a chamber, of area :math:`A_c` and centre
:math:`z_c`. Balance of axial force and of moment gives the moment that bends the beam, that of the
pressure about the neutral axis,

.. math:: M = p A_c (z_c - z_n), \qquad z_n = \frac{E A \bar z}{E A + k}.

At the tip, M alone deflects a beam of bending stiffness B by M L²/(2 B), and the force F that holds
it by F L³/(3 B) the other way: as long as deflections are small,

.. math:: F = \frac{3}{2} \frac{M}{L},

whatever B is. Degradation acts through the neutral axis alone: a stiffer elastomer moves it away
from the paper. Walls that bulge, dividers and slots between the chambers, and large deflections are
left out; what they do to the force as a whole is the parameter ``force_gain``. Derived here from
the theory of composite beams. Finite elements (`bayesdeg.actuator.curve.ExactMap.tip_force`) give
0.35 of it for a fresh default pneunet at 20 kPa, 0.54 at 200 kPa, and 0.56 to 0.58 where C1 is 1.6
MPa. So where curvatures are in the study, and the emulator is one that is trained for it, forces
are those of finite elements with the tip held, `HeldTip`; the beam is for forces alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from bayesdeg.errors import BayesdegError, Fault, StudyError
from bayesdeg.observations.curvature import actuator_parameters, inputs_met, parts_of
from bayesdeg.observations.kinds import State
from bayesdeg.observations.noise import Linearised
from bayesdeg.observations.pressures import ReadAtPressures, pressure_tests
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.priors import HalfNormal, LogNormal, Normal, Parameter, Uniform

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
    # finite elements give 0.32 to 0.68 of it, over pressures, degradation rates and geometries
    Parameter("force_gain", LogNormal(0.43, 0.3), "–", "blocked tip force over that of a beam"),
    Parameter("force_noise", HalfNormal(0.05), "–", "reading error of force, proportional"),
    # load cells for a newton resolve some millinewtons
    Parameter("force_noise_floor", HalfNormal(0.02), "N", "reading error of force, constant"),
)
_MEANING = "pressure over which reading errors of force stay alike"
SHORTEST_NOISE, LONGEST_NOISE = 0.005, 0.15  # of the pressure range, as of curvature
LEAST = 1e-3  # share of the force by which a cause must change it to be seen


def blocked_force(inputs: Inputs, mould: Dimensions) -> tuple[Floats, Floats]:
    """Return blocked tip forces of a beam, and their derivatives by ln stiffness.

    Parameters
    ----------
    inputs : Inputs
        What the mechanics met; of its shape the scale and the thickness of walls and roof count.
    mould : Dimensions
        As moulded [mm].

    Returns
    -------
    force, slope : array
        [N]; of the shape to which the inputs broadcast.

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
    # of N; both grow with the scale, areas with its square
    elastomer = modulus * area * inputs.linear_scale**2
    paper = 1e-3 * inputs.paper_stiffness * mould.width * inputs.linear_scale
    axis = centroid * elastomer / (elastomer + paper)
    zero = 0.0 if inputs.reference_pressure is None else inputs.reference_pressure
    load = 1.5e-3 * (inputs.pressure - zero) * opening * inputs.linear_scale**2 / mould.length
    return load * (centre - axis), -load * axis * paper / (elastomer + paper)


def _forces(state: State[FilmsAndActuators], data: "TipForce") -> Linearised:
    """Linearise forces at no deviation of the specimens' ln stiffness, in which they are smooth."""
    values, parts = state.values, state.once(parts_of, data.tests)
    met = inputs_met(state, data.tests, np.zeros((*parts.spread.shape, 1)))
    mean, slope = (
        values["force_gain"][:, None, None] * one for one in blocked_force(met, data.mould)
    )
    noise, floor = (values[f"force_noise{end}"][:, None, None] for end in ("", "_floor"))
    return Linearised(
        data.tests.read - mean,
        slope[..., None],
        floor**2 + (noise * mean) ** 2,
        parts.spread[..., None],
        values["force_noise_length"],
        np.zeros(len(mean)),
        data.tests.paths,
    )


@dataclass(frozen=True)
class TipForce(ReadAtPressures):
    """Blocked tip forces of actuators.

    Parameters
    ----------
    tests : PressureTests
        What was read.
    mould : Dimensions
        Of the actuators.
    recorded : frozenset of str
        Columns in which the file gives something.
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
        length = Uniform(SHORTEST_NOISE * largest, LONGEST_NOISE * largest)
        shared = (of_parts["volume_ratio"], of_parts["paper_stiffness"])
        return (*shared, *_FORCE, Parameter("force_noise_length", length, "kPa", _MEANING))

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        return state.once(_forces, self)

    @override
    def reveals(self, cause: Cause) -> bool:
        """Return whether a cause of its typical size changes forces, in tests like these."""
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
    "error of the emulator common to all tip forces, in its own standard errors",
)
# of a load cell and of how the tip rests on it: friction, and an edge that is no line
_CELL = Parameter("force_gain", LogNormal(1.0, 0.05), "–", "blocked tip force read over computed")


@dataclass(frozen=True)
class HeldTip(ReadAtPressures):
    """Blocked tip forces of actuators that finite elements answer, beside curvatures of others.

    Parameters
    ----------
    tests : PressureTests
        What was read.
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
        largest = float(self.tests.conditions.pressure.max())
        length = Uniform(SHORTEST_NOISE * largest, LONGEST_NOISE * largest)
        noise = (one for one in _FORCE if one.name != _CELL.name)
        return (_CELL, *noise, Parameter("force_noise_length", length, "kPa", _MEANING))

    @property
    @override
    def error_parameters(self) -> tuple[Parameter, ...]:
        return (EMULATOR_ERROR,)

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        return state.once(_held_forces, self)


def _held_forces(state: State[FilmsAndActuators], data: HeldTip) -> Linearised:
    """Linearise forces at no deviation of the specimens' ln stiffness.

    F = C1 f(p/C1), so that stiffer by a part in a hundred it changes by F − p ∂F/∂p hundredths.
    """
    values, parts = state.values, state.once(parts_of, data.tests)
    met = inputs_met(state, data.tests, np.zeros((*parts.spread.shape, 1)))
    found = state.world.forward(replace(met, asked=data.asks)).further
    if found is None:
        raise BayesdegError("the forward map of this model does not answer tip forces")
    shape = (*parts.spread.shape, data.tests.mask.shape[1])
    error = values.get(EMULATOR_ERROR.name, np.zeros(len(state)))[:, None, None]
    gain = values["force_gain"][:, None, None]
    mean = np.broadcast_to(gain * (found.value + error * found.sd), shape)
    noise, floor = (values[f"force_noise{end}"][:, None, None] for end in ("", "_floor"))
    return Linearised(
        data.tests.read - mean,
        np.broadcast_to(gain * (found.value - found.slope), shape)[..., None],
        floor**2 + (noise * mean) ** 2,
        parts.spread[..., None],
        values["force_noise_length"],
        np.zeros(len(state)),
        data.tests.paths,
    )


def from_study(study: Study) -> tuple[TipForce | HeldTip, ...]:
    """Return the tip forces of a study, if there are any.

    Where curvatures are there too finite elements answer both; without them a beam does.
    """
    table = study.table(TABLE.name)
    tests = (
        None
        if table is None
        else pressure_tests(table, "tip_force_N", batch_order(study.tensile, study.actuator))
    )
    if tests is None:
        return ()
    if study.actuator is not None:
        return (HeldTip(tests),)
    mould, constraint = study.geometry, study.settings.constraint
    if not (isinstance(mould, Dimensions) and constraint.is_membrane and not constraint.height):
        problem = "is of an actuator whose tip force is not computed"
        remedy = "it is that of pneunets with paper on the bottom: remove the file"
        raise StudyError([Fault(TABLE.file, problem, remedy)])
    return (TipForce(tests, mould, study.recorded.get(TABLE.name, frozenset())),)
