"""Dry air: degraded actuators tested in drier air than the films break at a lower strain.

Mechanism
    Water and glycerol keep a gelatin gel tough: its elongation at break peaks at one humidity and
    falls in drier air. Films are stored and torn at that humidity; an actuator loaded step by step
    in drier air loses water during the test, and a degraded one, which holds less, loses a larger
    share of it.

Equation
    Median elongation limit times exp(−b ρ), scatter of its logarithm √(σ² + (w ρ)²), with
    ρ = (D/25 %) max(67 % − RH, 0)/(67 % − 60 %), D the degradation rate and RH the humidity of the
    room, the median of the specimen's test. Where none was recorded, RH = 60 %. The scatter grows
    because specimens tested at different times dry by different amounts; air moister than the
    storage has no effect.

Typical size
    Stored at 67 % relative humidity, where elongation peaks, and tested near 60 %, two of three
    actuators at 25 % burst below a fifth of the films' limit: b about 1.5. How much a limit falls
    for a loss of 7 points of humidity is not published; the prior is an estimate, and
    proportionality of the log reduction to the loss is an assumption.

Revealed by
    Ruptures at pressures that the films' elongation would bear, the more so the more degraded the
    specimen and the drier the room; tests at the films' storage humidity do not show them. Counts
    in one room do not tell it from flaws. It acts on the actuators' rupture only: not on films,
    nor on curvature, on which humidity drift acts.

Refuted by
    Equally early ruptures at the films' storage humidity; smooth fracture surfaces up to one
    degradation rate and jagged ones beyond.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, for the humidities and the counts
    of ruptures; the size is estimated, not published.
"""

import numpy as np

from bayesdeg.causes.cause import (
    REFERENCE_DEGRADATION,
    Cause,
    Conditions,
    Effect,
    Floats,
    Stage,
    StrengthConditions,
)
from bayesdeg.causes.history import SAME_HUMIDITY, STORED_HUMIDITY, TESTED_HUMIDITY, dryness
from bayesdeg.material.strength import Strength
from bayesdeg.priors import Parameter, TruncatedNormal


def dry(strength: Strength, conditions: StrengthConditions, effect: Effect) -> Strength:
    """Lower and scatter limits more, the more degraded the specimen and the drier the room.

    Examples
    --------
    >>> films, rates = Strength(np.array([[2.0, 0.5, 0.5]]), np.full((1, 3), 0.1)), [[0, 25, 25]]
    >>> tests = StrengthConditions(np.array(rates), np.array([60.0, 60.0, 67.0]), np.zeros((1, 3)))
    >>> size = {"cut": np.array([[np.log(5.0)]]), "widening": np.array([[0.0]])}
    >>> dry(films, tests, size).median
    array([[2. , 0.1, 0.5]])
    """
    degraded = np.maximum(conditions.degradation, 0.0) / REFERENCE_DEGRADATION
    share = degraded * lost_humidity(conditions.humidity)
    return strength.weakened(effect["cut"] * share, effect["widening"] * share)


def lost_humidity(humidity: Floats) -> Floats:
    """Return max(67 % − RH, 0)/(67 % − 60 %) [–]; 1 where the humidity is not known.

    Examples
    --------
    >>> lost_humidity(np.array([75.0, 67.0, 53.0, np.nan])).tolist()
    [0.0, 0.0, 2.0, 1.0]
    """
    known = np.where(np.isnan(humidity), TESTED_HUMIDITY, humidity)
    return np.maximum(dryness(known), 0.0)


def never_dry(conditions: Conditions) -> str | None:
    """Say so where no degraded actuator was tested in dry air."""
    degraded = np.any(conditions.degradation > 0.0, axis=-1)
    if not np.any(degraded):
        return "no degraded actuator was tested"
    if not np.any(np.isfinite(conditions.humidity)):
        return "the humidity of the room was not recorded"
    lost = lost_humidity(conditions.room_humidity) * (STORED_HUMIDITY - TESTED_HUMIDITY)
    if np.all(lost[degraded] < SAME_HUMIDITY):
        return (
            f"degraded actuators were tested in air as humid as the storage, {STORED_HUMIDITY:g} %"
        )
    return None


CAUSE = Cause(
    name="dry_embrittlement",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "cut",
            TruncatedNormal(0.0, 1.0, 0.0, np.inf),
            "–",
            "ln of the films' over the actuators' elongation limit at a degradation rate of 25 % "
            "in air 7 points of relative humidity drier than the storage",
            0.0,
        ),
        Parameter(
            "widening",
            TruncatedNormal(0.0, 0.4, 0.0, np.inf),
            "–",
            "scatter of the ln elongation limit added by such drying at a degradation rate of 25 %",
            0.0,
        ),
    ),
    mechanism="degraded actuators tested in drier air than the films break at a lower strain",
    typical={"cut": 1.5, "widening": 0.4},
    revealed_by="ruptures below what the films' elongation would bear, the more so the more "
    "degraded the specimen and the drier the room; refuted by equally early ruptures at the "
    "humidity at which the films were stored",
    confusable_with=("flaw_embrittlement", "uneven_degradation"),
    needs=("humidity_pct",),
    on_strength=dry,
    blind=never_dry,
    of_degradation=True,
)
