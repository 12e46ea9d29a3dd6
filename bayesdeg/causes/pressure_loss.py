"""Pressure loss: a leak between sensor and chambers.

Mechanism
    Air flows through a leak, and the pressure drop along the tubing between sensor and actuator
    leaves the chambers at a fraction of the reading. A gas expands on its way: the flow through a
    tube, or through a leak behind it, is proportional to the difference of the squares of absolute
    pressures, so the lost share falls with pressure.

Equation
    p_true = √((1 − φ)(p + p₀)² + φ p₀²) − p₀, with p₀ = 101.325 kPa the ambient pressure and φ the
    tubing's share of the total flow resistance: φ of a small pressure is lost, about 0.7 φ of
    200 kPa.

Typical size
    0–20 %: estimated from the flow resistance of thin tubing and a slow leak. A leak only lowers
    the pressure; a gauge that errs either way is ``gauge_gain``.

Revealed by
    A loss of curvature at every degradation rate, in a ratio that falls slowly with pressure: for
    φ = 0.2, 0.86 φ of 50 kPa are lost, and 0.70 φ of 200 kPa. At small pressures curvature alone,
    which depends on p/C1 only, hardly tells it from a stiffer casting (``film_mismatch``); a second
    pressure sensor does. A liquid instead of air loses the same share at any pressure, which looks
    like a stiffer casting.

Refuted by
    A pressure sensor at the far end of the chambers that agrees.

Source
    doi:10.3389/frobt.2021.760485 for the pneumatic setup; the size is estimated, not published.
    Isothermal flow in tubes: White (2011), Fluid Mechanics, 7th edition, section 9.7.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal

Floats = NDArray[np.float64]

ATMOSPHERE = 101.325  # kPa, of the standard atmosphere


def lose_pressure(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at the pressure behind the leak, with the reference pressure lowered alike.

    Examples
    --------
    >>> import numpy as np
    >>> one = np.ones((1, 1, 1))
    >>> inputs = Inputs(np.array([[[1.0, 200.0]]]), one, one, one, one, one)
    >>> tests = Conditions(inputs.pressure[0], np.zeros((1, 1)))
    >>> left = lose_pressure(inputs, tests, {"fraction": 0.2 * one}).pressure
    >>> (left / inputs.pressure).round(3).tolist()
    [[[0.801, 0.86]]]
    """
    lost, reference = effect["fraction"], inputs.reference_pressure
    return replace(
        inputs,
        pressure=_behind(inputs.pressure, lost),
        reference_pressure=None if reference is None else _behind(reference, lost),
    )


def _behind(pressure: Floats, lost: Floats) -> Floats:
    """Return the pressure left: φ p (p + 2 p₀)/(P₁ + P₂) is lost, exactly 0 for φ = 0."""
    before = pressure + ATMOSPHERE
    behind = np.sqrt((1.0 - lost) * before**2 + lost * ATMOSPHERE**2)
    found: Floats = pressure * (1.0 - lost * (before + ATMOSPHERE) / (before + behind))
    return found


CAUSE = Cause(
    name="pressure_loss",
    stage=Stage.LOAD,
    parameters=(
        Parameter(
            "fraction",
            TruncatedNormal(0.0, 0.1, 0.0, 0.9),
            "–",
            "fraction of a small recorded pressure lost before the chambers",
            0.0,
        ),
    ),
    mechanism="a leak: the pressure in the chambers is a fraction of the reading",
    typical={"fraction": 0.1},
    revealed_by="a loss of curvature at every degradation rate, in a ratio that falls slowly with "
    "pressure; refuted by a second sensor at the far end",
    confusable_with=("film_mismatch", "gauge_gain", "wall_thickness", "shrinkage_reading"),
    on_inputs=lose_pressure,
)
