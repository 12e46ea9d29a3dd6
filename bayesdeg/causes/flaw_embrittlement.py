"""Flaw embrittlement: flaws of far degraded actuators cut their elongation limit.

Mechanism
    Fracture surfaces of films are smooth up to 20 % degradation and jagged at 25 %: pits and
    notches start cracks. A moulded actuator has more surface, more edges and larger flaws than a
    strip punched from a film, so the films' elongation at break, which holds for films, is too high
    for it, and that perhaps before films show any.

Equation
    A part breaks where either a wall reaches the films' limit, or a flaw tears: hazards add. Of
    flaws there are ρ(D) times as many as at 25 %, with ρ(D) = max(D − D₀, 0)/(25 % − D₀) from an
    onset D₀ on. With Weibull's law for both, of scales s = (√6/π) σ and s' = (√6/π) √(σ² + w²) of
    ln ε, the median limit is cut by u(ρ), the root of

        exp(−u/s) + ρ (1 − exp(−b/s)) exp((b − u)/s') = 1,

    which is b at 25 %, 0 up to the onset, and b + s' ln ρ where flaws decide. Its scatter is the
    slope of the hazard there,

        1/s(ρ) = exp(−u/s)/s + (1 − exp(−u/s))/s',

    σ up to the onset and √(σ² + w²) where flaws decide. The onset is inferred: its prior knows the
    films' surfaces, and no count of ruptures.

Typical size
    Two of three actuators burst below 240 kPa at 25 %, where 99 % of the simulated volume stays
    below a strain of 0.11, a fifth of the films' limit of 0.52: b of about 1.5.

Revealed by
    Ruptures at pressures that the films' elongation would bear, at high degradation rates only,
    and at scattered pressures. It acts on the actuators' rupture, not on films (their flaws are in
    their own data), and not on curvature.

Refuted by
    Actuators at 25 % that reach the pressure which the films' limit allows; ruptures as early in
    smooth fresh specimens.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, for fracture surfaces and counts
    of ruptures; Weibull (1951), J. Appl. Mech. 18:293, doi:10.1115/1.4010337, for flaws.
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
    StrengthConditions,
)
from bayesdeg.priors import Parameter, TruncatedNormal

SMOOTH = 20.0
"""Degradation rate up to which fracture surfaces of films are smooth [%]."""
LATEST = 24.0
"""Onset beyond which flaws would be there at once, not by degrees [%]."""
GUMBEL = float(np.sqrt(6.0) / np.pi)
"""Scale of Gumbel's law over its standard deviation: ln ε has that law where ε has Weibull's."""
SMALLEST_SCATTER = 1e-3
"""Below which films scatter no more than anything is measured; it keeps the scales apart from 0."""
STEPS = 6
"""Of Newton's method: the cut is right to 1e-9 for all scales up to ten times apart."""


def embrittle(strength: Strength, conditions: StrengthConditions, effect: Effect) -> Strength:
    """Return a lower and more scattered elongation limit where degradation is beyond the onset.

    Examples
    --------
    >>> films = Strength(np.full((1, 4), 0.5), np.full((1, 1), 0.1))
    >>> rates = np.array([[15.0, 20.0, 20.5, 25.0]])
    >>> tests = StrengthConditions(rates, np.full(4, np.nan), np.zeros((1, 4)))
    >>> flaws = {"cut": np.ones(1), "widening": np.array([0.24]), "onset": np.array([20.0])}
    >>> flawed = embrittle(films, tests, {name: one[:, None] for name, one in flaws.items()})
    >>> np.log(0.5 / flawed.median).round(2) + 0.0  # a tenth of the flaws cut half as much
    array([[0.  , 0.  , 0.53, 1.  ]])
    >>> flawed.scatter.round(2)
    array([[0.1 , 0.1 , 0.26, 0.26]])
    """
    ramp = flaw_ramp(conditions.degradation, effect["onset"])
    scatter = np.maximum(strength.scatter, SMALLEST_SCATTER)
    wide = np.hypot(scatter, effect["widening"])
    own, flawed = GUMBEL * scatter, GUMBEL * wide
    with np.errstate(divide="ignore"):  # no flaws: ln 0
        number = np.log(ramp) + np.log(-np.expm1(-effect["cut"] / own)) + effect["cut"] / flawed
    cut, share = competing(own, flawed, number)
    widened = 1.0 / (share / wide + (1.0 - share) / scatter)
    added = np.where(share > 0.0, widened**2 - scatter**2, 0.0)
    return strength.weakened(cut, np.sqrt(np.maximum(added, 0.0)))


def competing(own: Floats, other: Floats, number: Floats) -> tuple[Floats, Floats]:
    """Return by how much a second hazard cuts a median, and its share of the hazard there.

    The cut is the root u of exp(−u/own) + exp(number − u/other) = 1, by Newton's method on the
    logarithm of the left side, which is convex and falls: from the left each step falls short.

    Parameters
    ----------
    own, other : array
        Scales of the logarithm in both laws, the first the smaller.
    number : array
        ln of the second hazard over the first at the first law's median; −∞ where there is none.

    Examples
    --------
    >>> cut, share = competing(np.array([0.1]), np.array([0.1]), np.array([0.0]))
    >>> (cut / np.log(2.0)).round(6), share  # twice as many weak points
    (array([0.1]), array([0.5]))
    """
    cut = np.maximum(number * other, 0.0) + 0.0 * own
    for _ in range(STEPS):
        first, second = -cut / own, number - cut / other
        both = np.logaddexp(first, second)
        share = np.exp(second - both)
        cut = cut + both / (share / other + (1.0 - share) / own)
    return cut, np.exp(number - cut / other)


def flaw_ramp(degradation: Floats, onset: Floats) -> Floats:
    """Return ρ(D): 0 up to the onset, 1 at 25 %; both in percent.

    Examples
    --------
    >>> flaw_ramp(np.array([0.0, 20.0, 22.5, 25.0]), np.array([20.0])).tolist()
    [0.0, 0.0, 0.5, 1.0]
    """
    return np.maximum(degradation - onset, 0.0) / (REFERENCE_DEGRADATION - onset)


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
            "ln of the films' over the actuators' elongation limit at a degradation rate of 25 %",
            0.0,
        ),
        Parameter(
            "widening",
            TruncatedNormal(0.0, 0.4, 0.0, np.inf),
            "–",
            "scatter of ln elongation limit that flaws add at a degradation rate of 25 %",
            0.0,
        ),
        # films are smooth up to 20 %; walls, edges and corners may have flaws well before
        Parameter(
            "onset",
            TruncatedNormal(SMOOTH, 7.0, 0.0, LATEST),
            "%",
            "degradation rate up to which flaws leave the elongation limit as it is",
            SMOOTH,
        ),
    ),
    mechanism="flaws of far degraded actuators cut their elongation limit and widen its scatter",
    typical={"cut": 1.5, "widening": 0.4, "onset": 20.0},
    revealed_by="ruptures below what the films' elongation would bear, at high degradation rates "
    "only; refuted by actuators at 25 % that reach the pressure which it allows",
    on_strength=embrittle,
    blind=never_flawed,
    of_degradation=True,
)
