"""Flaw embrittlement: flaws in highly degraded actuators lower their elongation limit.

Mechanism
    Fracture surfaces of films are smooth up to 20 % degradation and jagged at 25 %: pits and
    notches start cracks. A moulded actuator has more surface, more edges and larger flaws than a
    strip punched from a film, so the films' elongation at break overestimates its own, perhaps
    before films show any flaws.

Equation
    Flaws compete with ordinary defects: ln S(ε) = ln S₀(ε) + ρ(D) min (ln S_f − ln S₀), the minimum
    up to the strain ε, with S₀ the probability that a wall without flaws survives, S_f the same
    with a median lower by exp(−b) and a scatter of its logarithm of √(σ² + w²), and
    ρ(D) = r(D − D₀)/r(25 % − D₀) the number of flaws over that at 25 %, r(x) being the mean of
    max(x, 0) where x scatters by 1 %. Few flaws let few walls burst, but those as early as many do.
    The onset D₀ is inferred: its prior rests on the films' surfaces, not on counts of ruptures.

Typical size
    Two of three actuators burst below 240 kPa at 25 %, where 99 % of the simulated volume stays
    below a strain of 0.11, a fifth of the films' limit of 0.52: b of about 1.5.

Revealed by
    Ruptures at pressures that the films' elongation would bear, at high degradation rates only, and
    at scattered pressures. It acts on the actuators' rupture only: not on films, whose data include
    their own flaws, nor on curvature.

Refuted by
    Actuators at 25 % that reach the pressure which the films' limit allows; equally early ruptures
    of smooth fresh specimens.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, for fracture surfaces and counts
    of ruptures; Weibull (1951), J. Appl. Mech. 18:293, doi:10.1115/1.4010337, for flaws; Johnson
    (1964), The Statistical Treatment of Fatigue Experiments, for competing failure modes.
"""

import numpy as np
import scipy

from bayesdeg.causes.cause import (
    REFERENCE_DEGRADATION,
    Cause,
    Conditions,
    Effect,
    Floats,
    Stage,
    StrengthConditions,
)
from bayesdeg.material.strength import Strength
from bayesdeg.priors import Parameter, TruncatedNormal

SMOOTH = 20.0
"""Degradation rate up to which fracture surfaces of films are smooth [%]."""
BEGINNING = 1.0
"""Standard deviation of the onset from place to place [%]: rates are known no better, and a sharp
onset would put flaws in all specimens of a level or in none."""
LATEST = 24.0
"""Onset beyond which flaws would appear at once, not gradually [%]."""


def embrittle(strength: Strength, conditions: StrengthConditions, effect: Effect) -> Strength:
    """Return an elongation limit with flaws where degradation is beyond the onset."""
    share = flaw_ramp(conditions.degradation, effect["onset"])
    return strength.flawed(share, effect["cut"], effect["widening"])


def flaw_ramp(degradation: Floats, onset: Floats) -> Floats:
    """Return ρ(D) [–], the number of flaws over that at 25 %, for a rate and an onset [%].

    Near 0 below the onset, from there nearly straight, above 1 beyond 25 %.

    Examples
    --------
    >>> flaw_ramp(np.array([0.0, 17.0, 20.0, 22.5, 25.0]), np.array([20.0])).round(3).tolist()
    [0.0, 0.0, 0.08, 0.5, 1.0]
    """
    return _rising(degradation - onset) / _rising(REFERENCE_DEGRADATION - onset)


def _rising(beyond: Floats) -> Floats:
    """Return the mean of max(x, 0) [%] of normal rates about a distance beyond the onset."""
    u = beyond / BEGINNING
    density = np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi)
    found: Floats = BEGINNING * np.maximum(density + u * scipy.special.ndtr(u), 0.0)
    return found


def never_flawed(conditions: Conditions) -> str | None:
    """Say so where no actuator was degraded far enough to have flaws."""
    if np.any(conditions.degradation > SMOOTH):
        return None
    return f"no actuator was degraded by more than {SMOOTH:g} %"


CAUSE = Cause(
    name="flaw_embrittlement",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "cut",
            TruncatedNormal(0.0, 1.0, 0.0, np.inf),
            "–",
            "ln of the films' over the actuators' elongation limit with as many flaws as at 25 %",
            0.0,
        ),
        Parameter(
            "widening",
            TruncatedNormal(0.0, 0.4, 0.0, np.inf),
            "–",
            "scatter of the ln elongation limit added by flaws",
            0.0,
        ),
        # films are smooth up to 20 %; walls, edges and corners may have flaws well before
        Parameter(
            "onset",
            TruncatedNormal(SMOOTH, 7.0, 0.0, LATEST),
            "%",
            "degradation rate at which flaws begin",
            SMOOTH,
        ),
    ),
    mechanism="flaws in highly degraded actuators lower and scatter their elongation limit",
    typical={"cut": 1.5, "widening": 0.4, "onset": 20.0},
    revealed_by="ruptures below what the films' elongation would bear, at high degradation rates "
    "only; refuted by actuators at 25 % that reach the pressure the films' limit allows",
    on_strength=embrittle,
    blind=never_flawed,
    of_degradation=True,
)
