r"""Mullins effect: after a large stretch the material is softer at smaller ones.

Mechanism
    The first loading breaks weak bonds. Up to the largest load so far the material is softer from
    then on; beyond it, it follows the virgin curve. Stiff, degraded specimens are stretched less by
    the same pressure, and soften less.

Equation
    With q the load that a virgin specimen would need for the same shape and q_m the largest so far,
    p = η q with η = 1 − b erf((q_m² − q²)/(w C1²)): the factor of Ogden and Roxburgh, with an
    energy that grows as (q/C1)². The paper is assumed to soften alike. Compared with that law at
    every integration point, with unchanged paper, the rule misses 4 % of the effect at degradation
    rates of 0 to 25 %, with b 4 % below 1/r since the paper does not soften
    (`benchmarks/rules.py`).

Typical size
    b = 0.05–0.3 in weakly filled elastomers; assumed for the gel. w = 0.1 is reached at some 90 kPa
    in a fresh actuator. q never exceeds q_m, so the emulator's range is never left.

Revealed by
    Unloading and later cycles above the first loading, and back on it beyond its largest pressure,
    regardless of holds.

Refuted by
    A second loading that repeats the first; a lag on unloading that recovers with time.

Source
    Ogden and Roxburgh (1999), Proc. R. Soc. A 455:2861, doi:10.1098/rspa.1999.0431.
"""

from dataclasses import replace

import numpy as np
import scipy

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Floats, Stage
from bayesdeg.priors import LogNormal, Parameter, TruncatedNormal

ROUNDS = 30  # of Newton's method and bisection, about six suffice
EXACT = 1e-10  # relative change at convergence
SHARPEST = 1e-12  # width of the onset; below it, the onset is a step
LEAST = 1e-200  # load below which the gain is lost in rounding
KILO = 1e-3  # kPa in MPa


def soften_below_largest(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at the load that virgin material would need for the same shape."""
    largest = np.maximum.accumulate(inputs.pressure, axis=-1)
    scale = inputs.c1 / KILO * np.sqrt(np.maximum(effect["onset"], SHARPEST))
    load = inputs.pressure / scale
    q = unsoftened(load, largest / scale, effect["softening"])
    below = (load > LEAST) & (inputs.pressure < largest)
    gain = np.where(below, q / np.where(below, load, 1.0), 1.0)
    return replace(inputs, pressure=inputs.pressure * gain)


def unsoftened(load: Floats, largest: Floats, softening: Floats) -> Floats:
    """Return q of p = q (1 − b erf(q_m² − q²)), between p and q_m.

    Parameters
    ----------
    load, largest : array
        p and q_m, which broadcast together, over √w C1 [–].
    softening : array
        b [–].

    Examples
    --------
    >>> from scipy.special import erf
    >>> one = np.ones(1)
    >>> q = unsoftened(0.5 * one, 1.5 * one, 0.2 * one)
    >>> (q * (1.0 - 0.2 * erf(1.5**2 - q**2))).round(9)
    array([0.5])
    """
    load, largest, softening = np.broadcast_arrays(load, largest, softening)
    low, high, q = load.copy(), largest.copy(), load.copy()
    for _ in range(ROUNDS):
        gap = largest**2 - q**2
        eta = 1.0 - softening * scipy.special.erf(gap)
        above = q * eta - load
        low, high = np.where(above < 0.0, q, low), np.where(above < 0.0, high, q)
        slope = eta + 4.0 / np.sqrt(np.pi) * softening * q**2 * np.exp(-(gap**2))
        guess = q - above / slope
        guess = np.where((guess >= low) & (guess <= high), guess, 0.5 * (low + high))
        change, q = np.abs(guess - q), guess
        if np.all((change <= EXACT * largest) | ~np.isfinite(change)):
            break
    return q


def ratio_to_largest(pressure: Floats) -> Floats:
    """Return pressures over the specimen's largest so far; 1 before any.

    Examples
    --------
    >>> ratio_to_largest(np.array([[0.0, 40.0, 20.0, 80.0]])).tolist()
    [[1.0, 1.0, 0.5, 1.0]]
    """
    largest = np.maximum.accumulate(pressure, axis=-1)
    ratio: Floats = np.where(largest > 0.0, pressure / np.where(largest > 0.0, largest, 1.0), 1.0)
    return ratio


def first_loading_only(conditions: Conditions) -> str | None:
    """Say so where no actuator was read below its largest pressure so far."""
    pressure = conditions.pressure
    again = (pressure > 0.0) & (ratio_to_largest(pressure) < 1.0)
    return None if np.any(again) else "no reading after the first loading"


CAUSE = Cause(
    name="mullins",
    stage=Stage.RESPONSE,
    parameters=(
        Parameter(
            "softening",
            TruncatedNormal(0.0, 0.15, 0.0, 0.9),
            "–",
            "share of the stiffness at small loads lost after a much larger load",
            0.0,
        ),
        Parameter(
            "onset",
            LogNormal(0.1, 1.0),
            "–",
            "square of pressure over C1 at which softening sets in",
            0.1,
        ),
    ),
    mechanism="the first loading softens the material up to the largest pressure it reached",
    typical={"softening": 0.2, "onset": 0.1},
    revealed_by="unloading and later cycles above the first loading, regardless of holds; refuted "
    "by a second loading that repeats the first",
    confusable_with=("creep", "hysteresis"),
    on_inputs=soften_below_largest,
    blind=first_loading_only,
)
