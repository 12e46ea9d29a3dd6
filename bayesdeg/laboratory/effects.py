"""An effect to be hidden in an experiment: a cause of the catalogue at a given size."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from bayesdeg.causes.catalogue import find, in_order
from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.errors import BayesdegError
from bayesdeg.laws import Parameter
from bayesdeg.measure.nearest import nearest


@dataclass(frozen=True)
class HiddenEffect:
    """A cause with values for all its parameters.

    Parameters
    ----------
    cause : Cause
        What acts.
    values : mapping of str to float
        By the parameters' short names, each in its unit.
    """

    cause: Cause
    values: Mapping[str, float]

    @property
    def effect(self) -> Effect:
        """The values as the hooks of the cause take them, for a single walker."""
        named = {self.cause.qualified(name): np.array([v]) for name, v in self.values.items()}
        return self.cause.effect(named)


def parse_effect(text: str) -> tuple[Cause, dict[str, float]]:
    """Read an effect from the command line.

    Parameters
    ----------
    text : str
        ``cause=value`` for the first parameter of the cause, its size, or
        ``cause.parameter=value``.

    Returns
    -------
    cause : Cause
    values : dict of str to float
        Only what the text gives.

    Raises
    ------
    BayesdegError
        If there is no such cause or parameter, or the value is no number or an impossible one;
        the message says what would be right.

    Examples
    --------
    >>> cause, values = parse_effect("pressure_offset=14")
    >>> cause.name, values
    ('pressure_offset', {'offset': 14.0})
    >>> parse_effect("degradation_misread.shft=3")
    Traceback (most recent call last):
    ...
    bayesdeg.errors.BayesdegError: degradation_misread has no parameter 'shft'; did you mean 'shift'?
    """  # noqa: E501
    target, equals, value = (part.strip() for part in text.partition("="))
    name, dot, short = target.partition(".")
    cause = find(name)
    parameter = _parameter(cause, short) if dot else cause.parameters[0]
    if not equals:
        example = f"{target}={cause.typical[parameter.name]:g}"
        raise BayesdegError(f"{text!r} gives no value; write for example {example}")
    return cause, {parameter.name: _number(value, cause, parameter)}


def parse_effects(texts: Iterable[str]) -> tuple[HiddenEffect, ...]:
    """Read all effects of a command line; parameters that are not given are neutral.

    Parameters
    ----------
    texts : iterable of str
        As in `parse_effect`; several may give parameters of the same cause.

    Returns
    -------
    tuple of HiddenEffect
        In the order in which causes are applied.

    Raises
    ------
    BayesdegError
        As `parse_effect`, or if a parameter is given twice.

    Examples
    --------
    >>> [hidden] = parse_effects(["degradation_misread.scatter=1"])
    >>> hidden.values
    {'shift': 0.0, 'scatter': 1.0}
    """
    causes: dict[str, Cause] = {}
    given: dict[str, dict[str, float]] = {}
    for text in texts:
        cause, values = parse_effect(text)
        causes[cause.name] = cause
        before = given.setdefault(cause.name, {})
        for twice in before.keys() & values.keys():
            raise BayesdegError(f"{cause.qualified(twice)} is given twice; give it once")
        before |= values
    return tuple(
        HiddenEffect(cause, {p.name: _value(cause, p, given) for p in cause.parameters})
        for cause in in_order(causes.values())
    )


def _value(cause: Cause, parameter: Parameter, given: Mapping[str, Mapping[str, float]]) -> float:
    neutral = 0.0 if parameter.neutral is None else parameter.neutral
    return given[cause.name].get(parameter.name, neutral)


def _parameter(cause: Cause, short: str) -> Parameter:
    names = [p.name for p in cause.parameters]
    if short not in names:
        best = nearest(short, names)
        hint = f"did you mean {best!r}?" if best else f"it has {', '.join(names)}"
        raise BayesdegError(f"{cause.name} has no parameter {short!r}; {hint}")
    return cause.parameters[names.index(short)]


def _number(text: str, cause: Cause, parameter: Parameter) -> float:
    name, unit = cause.qualified(parameter.name), parameter.unit
    example = f"give a number [{unit}], for example {cause.typical[parameter.name]:g}"
    try:
        value = float(text)
    except ValueError:
        raise BayesdegError(f"{name}: {text!r} is not a number; {example}") from None
    if not math.isfinite(value) or not math.isfinite(float(parameter.law.log_density(value))):
        raise BayesdegError(f"{name}: {text} is impossible under {parameter.law}; {example}")
    return value
