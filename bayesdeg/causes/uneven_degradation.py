"""Uneven degradation: an actuator breaks at its most degraded spot, not at its mean rate.

Mechanism
    A degradation rate is a loss of moisture of a whole specimen: a mean over places that microbes
    reached sooner or later, faces and cores, thin walls and thick ones. Stiffness is a mean too,
    but a wall tears where it is weakest, which is where it is most degraded.

Equation
    The most degraded place has the rate D(1 + δ), and the limit there is the films' at that rate,
    to first order by their own trend: median elongation limit times exp(−b D δ) with
    b = max(−d ln ε_b/dD, 0) of the films at D. The scatter stays.

Typical size
    δ about 0.15. A wall whose core has lost half of what its faces have, with a parabola between,
    has faces at 1.2 of the mean; the worst of five places with a standard deviation of a tenth is
    at 1.12 on average. Hence a half-normal prior of 0.2. For the films of the source, whose limit
    falls from 105 % at 12.5 % to 52 % at 25 % (b = 0.056 per point), δ = 0.15 lowers the limit at
    25 % by a fifth, and 0.4, two prior standard deviations, by 43 %. Two of three actuators burst
    there at a fifth of the films' limit, which would require δ = ln 5/(0.056 · 25) = 1.15, a 25 %
    actuator degraded by 54 % somewhere: alone it does not explain these ruptures.

Revealed by
    Ruptures somewhat below what the films' elongation at the recorded rate would bear, at all
    degraded levels, the more so the steeper the films' limit falls. It acts on the actuators'
    rupture only: not on films, whose limit includes their own unevenness, nor on curvature, where
    the skin of a wall shows as degraded skin.

Refuted by
    Degraded actuators that reach the pressure which the films' limit allows; equal moisture in
    pieces cut from all over one actuator; equally early ruptures of fresh specimens.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, for the films' limits and for
    microbes that were not equally active everywhere, so that degradation of the actuators may be
    inhomogeneous; the size is estimated, not published.
"""

import numpy as np

from bayesdeg.causes.blindness import without_degraded
from bayesdeg.causes.cause import Cause, Effect, Stage, StrengthConditions
from bayesdeg.material.strength import Strength
from bayesdeg.priors import Parameter, TruncatedNormal


def at_most_degraded(
    strength: Strength, conditions: StrengthConditions, effect: Effect
) -> Strength:
    """Return the films' limit at the rate of the most degraded place, D(1 + δ).

    Examples
    --------
    >>> films = Strength(np.array([[2.0, 0.52]]), np.array([[0.1, 0.1]]))
    >>> rates, slope = np.array([[0.0, 25.0]]), np.full((1, 2), np.log(52 / 105) / 12.5)
    >>> tests = StrengthConditions(rates, np.full(2, np.nan), slope)
    >>> at_most_degraded(films, tests, {"excess": np.array([[0.15]])}).median.round(3)
    array([[2.   , 0.421]])
    """
    further = effect["excess"] * np.maximum(conditions.degradation, 0.0)
    cut = np.maximum(-conditions.film_slope, 0.0) * further
    return strength.weakened(cut, np.zeros(1))


CAUSE = Cause(
    name="uneven_degradation",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "excess",
            TruncatedNormal(0.0, 0.2, 0.0, np.inf),
            "–",
            "degradation rate of an actuator's most degraded spot over its mean, minus 1",
            0.0,
        ),
    ),
    mechanism="an actuator breaks at its most degraded spot, where the limit strain is lowest",
    typical={"excess": 0.15},
    revealed_by="ruptures somewhat below what the films' elongation would bear, at all degraded "
    "levels; refuted by equal moisture in pieces cut from all over one actuator",
    confusable_with=("flaw_embrittlement", "dry_embrittlement"),
    on_strength=at_most_degraded,
    blind=without_degraded,
    of_degradation=True,
)
