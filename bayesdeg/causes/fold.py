"""Apply causes one after another; their hooks are called nowhere else."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.priors import Parameter, ParameterTable

Floats = NDArray[np.float64]
Hook = Literal["on_degradation", "on_inputs", "on_reading", "on_stress", "on_strength"]


class Acting(NamedTuple):
    """A cause and the size at which it acts."""

    cause: Cause
    effect: Effect


def acting(
    causes: Iterable[Cause], values: Mapping[str, Floats], *, axes: int = 2
) -> tuple[Acting, ...]:
    """Return causes with their sizes from named values (n,), with trailing axes added."""
    return tuple(Acting(cause, cause.effect(values, axes=axes)) for cause in causes)


def applied[T](hook: Hook, value: T, conditions: Any, causes: Iterable[Acting], *more: Any) -> T:
    """Apply one hook of all causes to a value, each to what those before it left.

    Parameters
    ----------
    hook : str
        Which of the hooks of a `bayesdeg.causes.cause.Cause`; causes without it change nothing.
    value
        What the first cause is given.
    conditions
        What the experiment set or recorded, as the hook expects it.
    causes : iterable of Acting
        In the order of `bayesdeg.causes.catalogue.in_order`.
    *more
        What the hook takes after its effect.

    Examples
    --------
    >>> from bayesdeg.causes.catalogue import find
    >>> from bayesdeg.causes.cause import Conditions
    >>> from bayesdeg.actuator.inputs import Inputs
    >>> offset, one = find("pressure_offset"), np.ones(1)
    >>> sizes = acting([offset], {"pressure_offset.offset": np.array([2.0])})
    >>> tests = Conditions(np.array([[20.0, 40.0]]), np.array([[0.0]]))
    >>> recorded = Inputs(tests.pressure, one, one, one, one, one)
    >>> applied("on_inputs", recorded, tests, sizes).pressure
    array([[[18., 38.]]])
    """
    for cause, effect in causes:
        act = getattr(cause, hook)
        if act is not None:
            value = act(value, conditions, effect, *more)
    return value


def with_causes(base: Iterable[Parameter], causes: Iterable[Cause]) -> ParameterTable:
    """Return a model's table followed by the causes' parameters, prefixed by the cause's name."""
    extra = (replace(p, name=cause.qualified(p.name)) for cause in causes for p in cause.parameters)
    return ParameterTable((*base, *extra))
