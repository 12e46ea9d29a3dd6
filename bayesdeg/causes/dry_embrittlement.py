"""Dry air: degraded actuators tested in air drier than that of the films break at less strain.

Mechanism
    Water and glycerol keep a gelatin gel tough: its elongation at break peaks at one humidity and
    falls where it is drier. Films are stored and torn at that humidity; an actuator that is loaded
    step by step in drier air loses water while it is tested, and a degraded one, which holds less,
    the larger share of what it has.

Equation
    Median elongation limit times exp(−b D/25 %), scatter of its logarithm √(σ² + (w D/25 %)²), with
    D the degradation rate: specimens that were tested at other times dried by other amounts.

Typical size
    Stored at 67 % relative humidity, where elongation peaks, tested near 60 %: two of three
    actuators burst at 25 % under a fifth of the films' limit, b of about 1.5. How much a limit
    falls for a loss of 7 points of humidity is not published; the prior is an estimate.

Revealed by
    Ruptures at pressures that the films' elongation would bear, the more so the more degraded;
    tests at the humidity at which the films were stored would not show them. Counts alone do not
    tell it from flaws. It acts on the actuators' rupture, not on films, and not on curvature, which
    is that of humidity drift.

Refuted by
    Ruptures as early where the air is that in which the films were stored; smooth fracture surfaces
    up to one degradation rate and jagged ones beyond.

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
    Strength,
)
from bayesdeg.priors import Parameter, TruncatedNormal


def dry(strength: Strength, degradation: Floats, effect: Effect) -> Strength:
    """Return an elongation limit that is lower and more scattered the more an actuator is degraded.

    Examples
    --------
    >>> films = Strength(np.array([[2.0, 0.5]]), np.array([[0.1, 0.1]]))
    >>> size = {"cut": np.array([[np.log(5.0)]]), "widening": np.array([[0.0]])}
    >>> dry(films, np.array([[0.0, 25.0]]), size).median
    array([[2. , 0.1]])
    """
    share = np.maximum(degradation, 0.0) / REFERENCE_DEGRADATION
    return strength.weakened(effect["cut"] * share, effect["widening"] * share)


def never_dry(conditions: Conditions) -> str | None:
    """Say so where no actuator was degraded, or nothing is known of the air."""
    if not np.any(conditions.degradation > 0.0):
        return "no degraded actuator was tested"
    if not np.any(np.isfinite(conditions.humidity)):
        return "the humidity of the room was not recorded"
    return None


CAUSE = Cause(
    name="dry_embrittlement",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "cut",
            TruncatedNormal(0.0, 1.0, 0.0, np.inf),
            "–",
            "ln of the films' over the actuators' elongation limit at a degradation rate of 25 %",
            0.0,
        ),
        Parameter(
            "widening",
            TruncatedNormal(0.0, 0.4, 0.0, np.inf),
            "–",
            "scatter of ln elongation limit that drying adds at a degradation rate of 25 %",
            0.0,
        ),
    ),
    mechanism="degraded actuators tested in air drier than that of the films break at less strain",
    typical={"cut": 1.5, "widening": 0.4},
    revealed_by="ruptures below what the films' elongation would bear, the more so the more "
    "degraded; refuted by ruptures as early at the humidity at which the films were stored",
    confusable_with=("flaw_embrittlement",),
    needs=("humidity_pct",),
    on_strength=dry,
    blind=never_dry,
)
