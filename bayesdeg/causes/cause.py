"""What a cause is: a named difference between what was recorded and what the mechanics met."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.laws import Parameter

Floats = NDArray[np.float64]

Effect = Mapping[str, Floats]
"""Values of a cause's parameters by their short names, shaped to broadcast (walkers, 1, 1)."""


class Stage(IntEnum):
    """Where in the chain a cause acts; causes are applied in this order, then by name."""

    DEGRADATION = 0
    MATERIAL = 1
    GEOMETRY = 2
    LOAD = 3
    READING = 4


@dataclass(frozen=True)
class Conditions:
    """What the experiment set or recorded, shaped to broadcast over (specimens, pressures).

    Parameters
    ----------
    pressure : array, shape (n_specimens, n_pressures)
        As read by the sensor [kPa].
    degradation : array, shape (n_specimens, 1)
        As measured [%].
    """

    pressure: Floats
    degradation: Floats


@dataclass(frozen=True)
class Degradation:
    """What is believed of the specimens' degradation rate.

    Parameters
    ----------
    value : array, broadcasts over (walkers, specimens, 1)
        Degradation rate [%].
    sd : array, broadcasts over (walkers, specimens, 1)
        Its standard deviation from specimen to specimen [%].
    """

    value: Floats
    sd: Floats


@dataclass(frozen=True)
class Cause:
    """One entry of the catalogue.

    Parameters
    ----------
    name : str
        Fixed name, as in the study file and ``verdict.json``.
    stage : Stage
        Where it acts.
    parameters : tuple of Parameter
        Its unknowns, each with prior, unit and neutral value; the first is its size.
    mechanism : str
        One sentence in plain words.
    typical : Mapping
        Values of all parameters at a size that is met in practice.
    revealed_by : str
        What data shows it, and what data would refute it.
    confusable_with : tuple of str
        Causes with a like signature in curvature alone.
    needs : tuple of str
        Columns of actuator.csv without which it cannot be judged.
    on_degradation, on_inputs, on_reading : callable, optional
        What it does to the degradation rates, to the inputs of the forward map, to the
        prediction; one that is not given means no effect.
    """

    name: str
    stage: Stage
    parameters: tuple[Parameter, ...]
    mechanism: str
    typical: Mapping[str, float]
    revealed_by: str
    confusable_with: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    on_degradation: Callable[[Degradation, Conditions, Effect], Degradation] | None = None
    on_inputs: Callable[[Inputs, Conditions, Effect], Inputs] | None = None
    on_reading: Callable[[Prediction, Conditions, Effect], Prediction] | None = None

    def qualified(self, parameter: str) -> str:
        """Return the parameter's name in a posterior: prefixed with that of the cause."""
        return f"{self.name}.{parameter}"

    def effect(self, values: Mapping[str, Floats]) -> Effect:
        """Pick this cause's parameters from named values of shape (walkers,)."""
        return {
            p.name: np.asarray(values[self.qualified(p.name)])[..., None, None]
            for p in self.parameters
        }
