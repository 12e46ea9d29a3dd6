"""Direct measurements of the part and of its load: what each cause says they would read.

The sizes of errors and of scatter from part to part are assumed: a calliper or a microscope on a
soft part, a second gauge of the class of the first.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import NEUTRAL, Inputs
from bayesdeg.causes.cause import Conditions, Degradation, Stage
from bayesdeg.causes.erosion import NOMINAL_WALL
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named
from bayesdeg.material.degradation import young_modulus

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LENGTH_ERROR = 0.01  # of the length: 0.5 mm in 50 mm, calliper and moulding
WALL_ERROR = 0.05 / NOMINAL_WALL  # 0.05 mm under a microscope
WALL_SCATTER = 0.02  # of the thickness, from part to part
STRIP_ERROR = 0.05  # of the stiffness of a small strip, beside the specimens' scatter
PAPER_ERROR = 0.05  # of the stiffness of a strip of paper, with its scatter
GAUGE_ERROR = 1.0  # kPa
WEIGHING_ERROR = 1.0  # points of the degradation rate of one weighed piece


@dataclass(frozen=True)
class Part:
    """The part as it really is in the eyes of a model.

    Parameters
    ----------
    inputs : Inputs
        With what causes make of material, geometry and load; broadcast over (n, S, R).
    degradation : Degradation
        What is believed of the degradation rates, broadcast over (n, S, 1).
    values : mapping
        Named values, (n,).
    """

    inputs: Inputs
    degradation: Degradation
    values: Named

    def of(self, name: str) -> Floats:
        """Return an input, neutral where no cause changed it."""
        value = getattr(self.inputs, name)
        return np.asarray(NEUTRAL[name] if value is None else value)


@dataclass(frozen=True)
class Quantity:
    """What is measured of a part.

    Parameters
    ----------
    mean, variance : callable
        Reading expected, and its variance with the scatter of parts, broadcast over (n, S, R).
    """

    mean: Callable[[Part], Floats]
    variance: Callable[[Part], Floats]


@dataclass(frozen=True)
class PartMeasurements:
    """Direct measurements on parts.

    Parameters
    ----------
    quantity : Quantity
        What is measured.
    degradation, degradation_sd : array, shape (S, 1)
        Of each kind of specimen, as recorded, and its standard error [%].
    pressure : array, shape (S, R)
        As read by the sensor while it is measured [kPa].
    copies : int
        Specimens of each kind.
    """

    quantity: Quantity
    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    copies: int

    @property
    def read(self) -> Flags:
        """Where there is a reading."""
        return np.ones(self.pressure.shape, dtype=bool)

    def expected(self, model: Model, values: Named) -> Floats:
        """Return readings expected."""
        return self._whole(values, self.quantity.mean(self._part(model, values)))

    def covariance(self, model: Model, values: Named) -> Floats:
        """Return their covariance; errors are independent."""
        variance = self._variance(model, values)
        return variance[..., None] * np.eye(variance.shape[-1])

    def simulated(self, model: Model, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new parts."""
        mean, variance = self.expected(model, values), self._variance(model, values)
        drawn: Floats = mean + np.sqrt(variance) * generator.standard_normal(mean.shape)
        return drawn

    def _variance(self, model: Model, values: Named) -> Floats:
        return self._whole(values, self.quantity.variance(self._part(model, values)))

    def _whole(self, values: Named, readings: Floats) -> Floats:
        return np.broadcast_to(readings, (len(values["volume_ratio"]), *self.pressure.shape))

    def _part(self, model: Model, values: Named) -> Part:
        conditions = Conditions(self.pressure, self.degradation)
        believed = Degradation(self.degradation, self.degradation_sd)
        for cause in model.causes:
            if cause.on_degradation is not None:
                believed = cause.on_degradation(believed, conditions, cause.effect(values))
        shape = (len(values["stiffness_scatter"]), len(self.degradation))
        level = np.broadcast_to(believed.value[..., 0], shape)
        c1, c2, c3 = np.moveaxis(model.constants(values, level)[..., None], 2, 0)
        inputs = Inputs(
            pressure=self.pressure,
            c1=c1,
            c2=c2,
            c3=c3,
            linear_scale=np.cbrt(values["volume_ratio"])[:, None, None],
            paper_stiffness=values["paper_stiffness"][:, None, None],
        )
        for cause in model.causes:
            # what is a response of the material to the load is no property of the part
            if cause.on_inputs is not None and cause.stage <= Stage.LOAD:
                inputs = cause.on_inputs(inputs, conditions, cause.effect(values))
        return Part(inputs, believed, values)


def _wall(part: Part) -> Floats:
    """Return the thickness of the roof over that in the mould; one of its faces is exposed."""
    thickness: Floats = (
        part.inputs.linear_scale * part.of("wall_factor") - part.of("erosion") / NOMINAL_WALL
    )
    return thickness


def _log_stiffness(part: Part) -> Floats:
    """Return ln of Young's modulus [MPa] of the part's material."""
    total: Floats = np.log(young_modulus(part.inputs.c1, part.of("second_invariant")))
    return total


def _strip_variance(part: Part) -> Floats:
    variance: Floats = part.values["stiffness_scatter"][:, None, None] ** 2 + STRIP_ERROR**2
    return variance


def _scale(part: Part) -> Floats:
    return part.inputs.linear_scale


def _scale_variance(part: Part) -> Floats:
    variance: Floats = (LENGTH_ERROR * part.inputs.linear_scale) ** 2
    return variance


def _wall_variance(part: Part) -> Floats:
    variance: Floats = WALL_ERROR**2 + (WALL_SCATTER * _wall(part)) ** 2
    return variance


def _log_paper(part: Part) -> Floats:
    stiffness: Floats = np.log(part.inputs.paper_stiffness)
    return stiffness


def _paper_variance(part: Part) -> Floats:
    return np.array(PAPER_ERROR**2)


def _pressure(part: Part) -> Floats:
    return part.inputs.pressure


def _gauge_variance(part: Part) -> Floats:
    return np.array(GAUGE_ERROR**2)


def _degradation(part: Part) -> Floats:
    return part.degradation.value


def _weighing_variance(part: Part) -> Floats:
    variance: Floats = part.degradation.sd**2 + WEIGHING_ERROR**2
    return variance


# functions of the module, which can be sent to other processes
LENGTH = Quantity(mean=_scale, variance=_scale_variance)
WALL = Quantity(mean=_wall, variance=_wall_variance)
STRIP = Quantity(mean=_log_stiffness, variance=_strip_variance)
PAPER = Quantity(mean=_log_paper, variance=_paper_variance)
GAUGE = Quantity(mean=_pressure, variance=_gauge_variance)
WEIGHED = Quantity(mean=_degradation, variance=_weighing_variance)
