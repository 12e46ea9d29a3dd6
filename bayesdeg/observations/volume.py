r"""Volume taken up by the chambers under pressure, read together with curvature.

With ΔV(m) the predicted volume of a specimen whose ln stiffness deviates by m,

.. math:: y = \Delta V(m) + g\,s + \varepsilon, \qquad m \sim N(0, \tau^2), \quad g \sim N(0, 1)

with s the emulator's standard error, of the same sign in all specimens, and ε correlated along the
path like every reading error. m is that of the curvatures of the same specimen: the density is
conditional on these, so :math:`N(0, \tau^2)` is replaced by the posterior of m given curvatures,
and both together are the density of all readings.

The volume reveals changes of the shape swept per bend: different wall thickness, eroded faces, a
stiff skin, and the size of the part, whose cube it scales with. It cannot tell a lost pressure from
a stiffer material: both outputs are functions of p/C1 and of the paper's stiffness over C1, and
only a force involves a stress.

Derived here from the linear model of `bayesdeg.observations.noise`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Asked
from bayesdeg.data.batches import batch_order
from bayesdeg.data.study import Study
from bayesdeg.observations.curvature import (
    ActuatorCurves,
    Curvature,
    draw_readings,
    linearise_actuators,
    parts_of,
)
from bayesdeg.observations.kinds import Deviations, Observations, State
from bayesdeg.observations.noise import Linearised, learnt_deviations
from bayesdeg.observations.pressures import ReadAtPressures, pressure_tests
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.priors import HalfNormal, Normal, Parameter

Floats = NDArray[np.float64]

VOLUME = "cavity volume"
SHARE_OF_STROKE = 0.02
"""Prior constant reading error over the largest recorded volume: a syringe or piston is graduated
in fiftieths to hundredths of its stroke."""
_PROPORTIONAL = Parameter(
    # a syringe and its tubes expand under pressure, and the air in them is compressed
    "volume_noise",
    HalfNormal(0.05),
    "–",
    "proportional reading error of volume",
)
EMULATOR_ERROR = Parameter(
    "emulator_error_volume",
    Normal(0.0, 1.0),
    "–",
    "emulator error common to all volumes, in standard errors",
)


@dataclass(frozen=True)
class CavityVolume(ReadAtPressures):
    """Increase of cavity volumes over zero pressure, on specimens whose curvature was read.

    Parameters
    ----------
    tests : PressureTests
        The readings.
    curves : ActuatorCurves, optional
        Curves of the same specimens, as in the model.
    """

    name: ClassVar[str] = "volume"
    order: ClassVar[int] = 22
    follows: ClassVar[str] = "actuator"
    shares: ClassVar[str] = "actuator"
    uses_forward: ClassVar[bool] = True
    asks: ClassVar[Asked] = "cavity_volume"
    reading: ClassVar[str] = VOLUME
    column: ClassVar[str] = "cavity_volume_ml"
    output: ClassVar[str] = "cavity_volume"
    floors: ClassVar[Mapping[str, str]] = {"volume_noise_floor": column}

    curves: ActuatorCurves | None = None

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        floor = HalfNormal(SHARE_OF_STROKE * max(float(np.abs(self.observed).max()), _LEAST))
        return (
            _PROPORTIONAL,
            Parameter("volume_noise_floor", floor, "ml", "constant reading error of volume"),
            self.length_parameter(),
        )

    @property
    @override
    def error_parameters(self) -> tuple[Parameter, ...]:
        return (EMULATOR_ERROR,)

    @override
    def linked(self, others: tuple[Observations, ...]) -> "CavityVolume | None":
        """Return it conditioned on a model's curvatures; None if these are of different tests."""
        curves = next((one.tests for one in others if isinstance(one, Curvature)), self.curves)
        if curves is None or curves is self.curves:
            return self
        alike = curves.specimens == self.labels and curves.mask.shape == self.tests.mask.shape
        return replace(self, curves=curves) if alike else None

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        return state.once(_volumes, self)

    @override
    def conditioned(self, state: State[FilmsAndActuators]) -> Linearised:
        if self.curves is None:
            return self.linearised(state)
        return state.once(_given, self, self.curves)

    @override
    def deviations(self, state: State[FilmsAndActuators]) -> Deviations:
        return self.of_own_deviations(state)

    @override
    def drawn_deviations(
        self, state: State[FilmsAndActuators], generator: np.random.Generator
    ) -> Floats:
        """Return the deviations with which the curvatures were drawn."""
        if self.curves is None:
            return super().drawn_deviations(state, generator)
        return state.once(draw_readings, self.curves, generator).deviation


_LEAST = 1e-6  # ml, so that a law exists if all readings are zero


def _volumes(state: State[FilmsAndActuators], data: CavityVolume) -> Linearised:
    """Linearise volumes at zero deviation of the specimens' ln stiffness."""
    spread = state.once(parts_of, data.tests).spread
    return _linearised(state, data, np.zeros(spread.shape), spread)


def _given(
    state: State[FilmsAndActuators], data: CavityVolume, beside: ActuatorCurves
) -> Linearised:
    """Linearise volumes about the deviations inferred from the curvatures of the same specimens."""
    curves, _ = state.once(linearise_actuators, beside)
    return _linearised(state, data, *learnt_deviations(curves))


def _linearised(
    state: State[FilmsAndActuators], data: CavityVolume, centre: Floats, spread: Floats
) -> Linearised:
    found = data.answered(state, centre[..., None])
    mean = found.value + data.common_error(state.values) * found.sd
    return data.of_mean(state.values, mean, -found.slope, spread)


def from_study(study: Study) -> tuple[CavityVolume, ...]:
    """Return the volumes of a study, if any."""
    batches = batch_order(study.tensile, study.actuator)
    tests = pressure_tests(study.actuator, CavityVolume.column, batches)
    return () if tests is None else (CavityVolume(tests),)
