"""Causes of the catalogue in the published experiment: which can act, and on what.

Unpublished conditions of the experiment are assumed: one loading from 0 to 240 kPa in steps of
20 kPa, read every 30 s, in a horizontal mount, in a room at 60 % relative humidity. A cause acts
through its own hooks, at sizes drawn from its own prior.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import special

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause, Conditions, Degradation
from bayesdeg.priors import Normal, TruncatedNormal
from bayesdeg.surrogate.surrogate import Surrogate
from nagai_2021.published import DEGRADATIONS, LEVELS, PRESSURES, Materials

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Values = Mapping[str, Floats]
"""Draws of a cause's parameters by their qualified names, each (n,)."""

INTERVAL = 30.0
"""Time between readings; assumed [s]."""
ROOM = 60.0
"""Relative humidity while testing; stated [%]."""
STEPS = np.concatenate([[0.0], PRESSURES])
READINGS, LAST = slice(1, None), slice(-1, None)
"""What of the steps is read: all but 0 kPa; the largest pressure alone."""


@dataclass(frozen=True)
class Misread:
    """What a cause makes of D_R, by level.

    Parameters
    ----------
    shift, scatter : array, shape (n, 6)
        True less recorded D_R, and its sd over specimens [points].
    """

    shift: Floats
    scatter: Floats


def conditions() -> Conditions:
    """Return what the experiment is taken to have set and recorded, one row a level."""
    pressure = np.broadcast_to(STEPS, (len(LEVELS), len(STEPS)))
    time = INTERVAL * np.arange(len(STEPS), dtype=np.float64)
    return Conditions(pressure, LEVELS[:, None], time=time, humidity=np.array(ROOM))


def cannot_bend(cause: Cause) -> str | None:
    """Say why a cause can't show in curvatures of this experiment; None if it can."""
    if cause.is_of_rupture_alone:
        return "changes ruptures alone"
    if "actuator" not in cause.acts_on:
        tests = " and ".join(sorted(cause.acts_on))
        return f"acts on {tests} tests alone, of which no curve was published"
    return cause.blind(conditions())


def cannot_burst(cause: Cause) -> str | None:
    """Say why a cause can't change ruptures of this experiment; None if it can."""
    if not cause.acts_on & {"actuator", "rupture"}:
        return cannot_bend(cause)
    return cause.blind(conditions())


def able(reason_of: Callable[[Cause], str | None]) -> tuple[dict[str, Cause], dict[str, str]]:
    """Return the causes that can act, and of the others why not."""
    reasons = {name: reason_of(cause) for name, cause in CATALOGUE.items()}
    acting = {name: CATALOGUE[name] for name, reason in reasons.items() if reason is None}
    return acting, {name: reason for name, reason in reasons.items() if reason is not None}


def values_at(cause: Cause, scores: Floats) -> dict[str, Floats]:
    """Return a cause's parameters at standard normal scores of their priors, (n, n_parameters)."""
    quantiles = special.ndtr(scores)
    return {
        cause.qualified(p.name): p.law.quantile(quantiles[:, i])
        for i, p in enumerate(cause.parameters)
    }


def size_of(cause: Cause, values: Values) -> Floats:
    """Return the draws of a cause's first parameter, its size."""
    return values[cause.qualified(cause.parameters[0].name)]


def widened(cause: Cause, factor: float) -> Cause:
    """Return a cause with the sd of its size's prior times a factor, the bounds kept."""
    first, *rest = cause.parameters
    law = cast(Normal | TruncatedNormal, first.law)
    return replace(cause, parameters=(replace(first, law=replace(law, sd=factor * law.sd)), *rest))


def misread(cause: Cause, values: Values) -> Misread:
    """Return what a cause makes of the recorded D_R, (n, 6)."""
    here, count = conditions(), len(next(iter(values.values())))
    state = Degradation(LEVELS[:, None], np.zeros((len(LEVELS), 1)))
    if cause.on_degradation is not None:
        state = cause.on_degradation(state, here, cause.effect(values))
    shape = (count, len(LEVELS), 1)
    value, sd = (np.broadcast_to(v, shape)[..., 0] for v in (state.value, state.sd))
    return Misread(value - LEVELS, sd)


def predict(
    surrogate: Surrogate,
    materials: Materials,
    degradation: Floats,
    *,
    cause: Cause | None = None,
    values: Values | None = None,
    read: slice = READINGS,
) -> Prediction:
    """Return what is read where the true D_R is given, (n, 6, n_read), by a cause's hooks.

    Parameters
    ----------
    surrogate : Surrogate
        The mechanics.
    materials : Materials
        One row a draw, (n,).
    degradation : array, shape (6,) or (n, 6)
        True D_R at each level, whose recorded one stays [%].
    cause, values : optional
        What acts, and its parameters.
    read : slice
        Of `STEPS`.
    """
    here = conditions()
    inputs = materials.inputs(degradation, STEPS[None, None])
    effect = {} if cause is None or values is None else cause.effect(values)
    if cause is not None and cause.on_inputs is not None:
        inputs = cause.on_inputs(inputs, here, effect)
    # the whole history counts for what lags; only what is read has to be simulated
    prediction = surrogate(_cut(inputs, read))
    if cause is not None and cause.on_reading is not None:
        prediction = cause.on_reading(prediction, _cut(here, read), effect)
    return prediction


def within_grid(degradation: Floats) -> Floats:
    """Return D_R cut to the grid on which materials are known to be stable [%]."""
    return np.clip(degradation, DEGRADATIONS[0], DEGRADATIONS[-1])


def weighted_quantiles(values: Floats, weights: Floats) -> dict[str, float]:
    """Return median and 90 % interval of weighted draws."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) / weights.sum()
    at = np.minimum(np.searchsorted(reached, (0.05, 0.5, 0.95)), len(values) - 1)
    return dict(zip(("q05", "median", "q95"), values[order][at].tolist(), strict=True))


def _cut[Record: (Inputs, Conditions)](record: Record, read: slice) -> Record:
    """Return inputs or conditions with some of their steps alone."""
    given = {field.name: getattr(record, field.name) for field in fields(record)}
    stepped = {n: v for n, v in given.items() if np.shape(v)[-1:] == STEPS.shape}
    return replace(record, **{name: values[..., read] for name, values in stepped.items()})
