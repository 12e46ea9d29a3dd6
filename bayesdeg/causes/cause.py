"""A cause: a named difference between what was recorded and what acted on the specimen."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.data.study import Study
from bayesdeg.material.strength import Strength
from bayesdeg.priors import LogNormal, Parameter

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

REFERENCE_DEGRADATION = 25.0
"""Degradation rate at which the sizes of degradation-dependent effects are stated [%]."""
GROWTH = Parameter(
    "growth",
    LogNormal(1.0, 0.5),
    "–",
    "power of the degradation rate with which the effect grows",
    1.0,
)
"""For effects of the soil that proceed faster or slower than the gel degrades.

An effect at a constant rate, while the degradation rate tends to some 30 %, has n = 1.4 to 2.1;
effects of water within hours have n near 0. 90 % of the prior lies between 0.44 and 2.3."""

Effect = Mapping[str, Floats]
"""Values of a cause's parameters by their short names, shaped to broadcast (walkers, 1, 1)."""


class Stage(IntEnum):
    """Where in the chain a cause acts; causes are applied in this order, then by name.

    The material's response to a load over time (RESPONSE) comes after the true load (LOAD).
    """

    DEGRADATION = 0
    MATERIAL = 1
    GEOMETRY = 2
    LOAD = 3
    RESPONSE = 4
    READING = 5


@dataclass(frozen=True)
class Conditions:
    """Set and recorded conditions of an experiment, readings in the order in which they were taken.

    The default is a fast first loading in a horizontal mount. Arrays that broadcast to
    (n_specimens, n_points) are expanded to that shape.

    Parameters
    ----------
    pressure : array, shape (n_specimens, n_points)
        As read by the sensor [kPa].
    degradation : array, shape (n_specimens, 1) or (walkers, n_specimens, 1)
        As measured, or as each walker has it [%].
    time : array
        Since the specimen's first row; nan where it was not recorded [s].
    cycle : array of int
        Loading cycle, from 1.
    unloading : array of bool
        Whether the pressure was on its way down.
    humidity : array
        Relative humidity of the room; nan where it was not recorded [%].
    mount : array of str
        ``horizontal``, ``hanging``, ``bending_up`` or ``bending_down``.
    temperature : array
        Of the room; nan where it was not recorded [°C].
    batch : array of int
        Number of the specimen's batch, as in `bayesdeg.data.batches.batch_numbers`; 0 is the
        reference batch.

    Raises
    ------
    ValueError
        If the shapes do not broadcast.

    Examples
    --------
    >>> conditions = Conditions(np.array([[20.0, 40.0]]), np.array([[0.0]]))
    >>> conditions.mount.tolist(), conditions.cycle.tolist()
    ([['horizontal', 'horizontal']], [[1, 1]])
    """

    pressure: Floats
    degradation: Floats
    time: Floats = field(default_factory=lambda: np.array(np.nan))
    cycle: NDArray[np.int64] = field(default_factory=lambda: np.array(1))
    unloading: Flags = field(default_factory=lambda: np.array(False))
    humidity: Floats = field(default_factory=lambda: np.array(np.nan))
    mount: NDArray[np.str_] = field(default_factory=lambda: np.array("horizontal"))
    temperature: Floats = field(default_factory=lambda: np.array(np.nan))
    batch: NDArray[np.int64] = field(default_factory=lambda: np.array(0))

    def __post_init__(self) -> None:
        """Broadcast recorded conditions to the shape of the readings."""
        rates = np.shape(self.degradation)[-2:]  # recorded conditions are the same for all walkers
        shape = np.broadcast_shapes(np.shape(self.pressure), rates)
        recorded = ("time", "cycle", "unloading", "humidity", "mount", "temperature", "batch")
        for name in recorded:
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), shape))

    @cached_property
    def room_humidity(self) -> Floats:
        """Median humidity of each specimen's test [%], (n_specimens,); nan where none is known.

        Examples
        --------
        >>> recorded = np.array([[60.0, np.nan, 61.0], [np.nan, np.nan, np.nan]])
        >>> Conditions(np.ones((2, 3)), np.zeros((2, 1)), humidity=recorded).room_humidity.tolist()
        [60.5, nan]
        """
        return _median_known(self.humidity)

    @cached_property
    def room_temperature(self) -> Floats:
        """Median temperature of each specimen's test [°C], (n_specimens,); nan where none is known.

        Examples
        --------
        >>> Conditions(np.ones((1, 3)), np.zeros((1, 1)), temperature=24.0).room_temperature
        array([24.])
        """
        return _median_known(self.temperature)


def _median_known(values: Floats) -> Floats:
    """Return the median of the known values along the last axis; nan where none is known."""
    known = np.ma.masked_invalid(values)
    median: Floats = np.ma.filled(np.ma.median(known, axis=-1), np.nan)
    return median


@dataclass(frozen=True)
class FilmConditions:
    """Conditions of tensile tests of films.

    Parameters
    ----------
    stretch : array, shape (n_specimens, n_points)
        Along the load [–].
    mode : array of str, shape (n_specimens,)
        ``uniaxial``, ``equibiaxial`` or ``planar``.
    cauchy : array of bool, shape (n_specimens, n_points)
        Whether the stress is labelled Cauchy; nominal otherwise.
    degradation : array, shape (n_specimens,)
        As measured [%].
    temperature : array, shape (n_specimens,)
        Of the room; nan where it was not recorded [°C].
    batch : array of int, shape (n_specimens,)
        As in `Conditions`.
    """

    stretch: Floats
    mode: NDArray[np.str_]
    cauchy: Flags
    degradation: Floats
    temperature: Floats = field(default_factory=lambda: np.array(np.nan))
    batch: NDArray[np.int64] = field(default_factory=lambda: np.array(0))

    def __post_init__(self) -> None:
        """Broadcast recorded conditions to one value per specimen."""
        shape = np.shape(self.degradation)
        for name in ("temperature", "batch"):
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), shape))


@dataclass(frozen=True)
class Degradation:
    """Estimated degradation rate of the specimens.

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
class StrengthConditions:
    """State of actuators at their elongation limit: one value per specimen.

    Parameters
    ----------
    degradation : array, shape (walkers, n_specimens)
        Estimated [%].
    humidity : array, shape (n_specimens,)
        Relative humidity of the room [%]; nan where it was not recorded.
    film_slope : array, shape (walkers, n_specimens)
        d ln ε_b/dD of the films' median elongation limit at these rates [1/%].
    """

    degradation: Floats
    humidity: Floats
    film_slope: Floats


def grown(conditions: Conditions, effect: Effect) -> Floats:
    """Return (D/25 %)^n, the share of its full size that an effect with `GROWTH` has reached [–].

    Parameters
    ----------
    conditions : Conditions
        With degradation rates D [%].
    effect : mapping
        With n as ``growth``, shape (walkers, 1, 1).

    Returns
    -------
    array, shape (walkers, n_specimens, 1)

    Examples
    --------
    >>> at = Conditions(pressure=np.zeros((1, 1)), degradation=np.array([[12.5]]))
    >>> float(grown(at, {"growth": np.array(2.0)})[0, 0])
    0.25
    """
    share: Floats = (conditions.degradation / REFERENCE_DEGRADATION) ** effect["growth"]
    return share


def scaled_stiffness(inputs: Inputs, factor: Floats) -> Inputs:
    """Return inputs of a body stiffer by a factor, with the paper unchanged.

    Parameters
    ----------
    inputs : Inputs
        As other causes left them.
    factor : array, shape (walkers, n_specimens or 1, 1)
        On all constants [–].
    """
    second = inputs.second_invariant
    return replace(
        inputs,
        c1=factor * inputs.c1,
        c2=factor * inputs.c2,
        c3=factor * inputs.c3,
        second_invariant=None if second is None else factor * second,
    )


def never_blind(given: Conditions | FilmConditions | Study) -> None:
    """Return None: every test can reveal the cause, and it has a meaning in every study."""


@dataclass(frozen=True)
class Cause:
    """Entry of the catalogue.

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
        Values of all parameters at a size met in practice.
    revealed_by : str
        Which data reveal it, and which would refute it.
    confusable_with : tuple of str
        Causes with a similar signature in curvature alone.
    twins : tuple of str
        Causes that no reading of curvature, angle or volume can tell from it: their evidence
        differs only through priors of size and errors of the rules.
    needs : tuple of str
        Columns of actuator.csv without which it cannot be judged.
    of_degradation : bool
        Whether it concerns degradation or shrinkage: a study without either has no such cause.
    corrects : tuple of str
        Parameters of the model that it treats as misread.
    on_degradation, on_inputs, on_reading : callable, optional
        How it changes the degradation rates, the inputs of the forward map and the prediction;
        a hook not given has no effect.
    on_stress : callable, optional
        How it changes the stresses (walkers, n_specimens, n_points) [MPa] that tensile tests of
        films read; the last argument holds Yeoh's constants (walkers, n_specimens, 3) [MPa]. It is
        linear in both together, so it maps a derivative of the stress, given with the derivative
        of the constants, in the same way.
    on_strength : callable, optional
        How it changes the elongation limit of actuators in given states; the effect has shape
        (walkers, 1).
    blind : callable
        Says why tests cannot reveal it although the columns exist; None if they can.
    blind_in : callable
        Says why it has no meaning in a study; None if it has one.
    blind_on_films : callable
        Says why tensile tests alone, without actuators, cannot reveal it; None if they can.
    """

    name: str
    stage: Stage
    parameters: tuple[Parameter, ...]
    mechanism: str
    typical: Mapping[str, float]
    revealed_by: str
    confusable_with: tuple[str, ...] = ()
    twins: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    of_degradation: bool = False
    corrects: tuple[str, ...] = ()
    on_degradation: Callable[[Degradation, Conditions, Effect], Degradation] | None = None
    # take Inputs, Conditions and Prediction, or what a user's own forward map takes
    on_inputs: Callable[[Any, Any, Effect], Any] | None = None
    on_reading: Callable[[Any, Any, Effect], Any] | None = None
    on_stress: Callable[[Floats, FilmConditions, Effect, Floats], Floats] | None = None
    on_strength: Callable[[Strength, StrengthConditions, Effect], Strength] | None = None
    blind: Callable[[Conditions], str | None] = never_blind
    blind_in: Callable[[Study], str | None] = never_blind
    blind_on_films: Callable[[FilmConditions], str | None] = never_blind

    def qualified(self, parameter: str) -> str:
        """Return the parameter's name in a posterior: prefixed with that of the cause."""
        return f"{self.name}.{parameter}"

    def effect(self, values: Mapping[str, Floats], *, axes: int = 2) -> Effect:
        """Pick this cause's parameters from named values (walkers,), with trailing axes added."""
        new = (1,) * axes
        given = {p.name: np.asarray(values[self.qualified(p.name)]) for p in self.parameters}
        return {name: value.reshape(*value.shape, *new) for name, value in given.items()}

    @property
    def acts_on(self) -> frozenset[str]:
        """Kinds of tests whose readings it changes: ``actuator``, ``tensile``, ``rupture``.

        A cause that changes the strain of an actuator also changes its rupture; not counted here.
        """
        actuator = (self.on_degradation, self.on_inputs, self.on_reading)
        hooks = {"actuator": actuator, "tensile": (self.on_stress,), "rupture": (self.on_strength,)}
        return frozenset(test for test, given in hooks.items() if any(given))

    @property
    def is_of_rupture_alone(self) -> bool:
        """Whether it acts on rupture only, so that no reading of a curve shows it."""
        return self.acts_on == {"rupture"}
