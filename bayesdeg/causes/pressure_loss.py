"""Pressure loss: a leak between sensor and chambers.

Mechanism
    Air flows through a leak, and the tubing between sensor and actuator takes a share of the
    pressure, so that the chambers get a fraction of what is read. A gas expands on its way: the
    flow through a tube, or through a leak behind it, goes with the difference of the squares of
    absolute pressures, so that the share that is lost falls with pressure.

Equation
    p_true = √((1 − φ)(p + p₀)² + φ p₀²) − p₀, with p₀ = 101.325 kPa the pressure of the air
    outside and φ the share of the tubing in the resistance of both: of a small pressure φ is lost,
    of 200 kPa about 0.7 φ.

Typical size
    0–20 %: estimated from the flow resistance of thin tubing against a slow leak. A leak only takes
    away; a gauge that is off either way is ``gauge_gain``.

Revealed by
    A loss of curvature at every degradation rate, in a ratio that falls slowly with pressure: for
    φ = 0.2, 0.86 φ of 50 kPa are lost, and 0.70 φ of 200 kPa. The smaller the pressures, the less
    tells it from a stiffer casting (``film_mismatch``) by curvature alone, which depends on p/C1
    alone; a second pressure sensor can. A liquid in the place of air loses the same share of any
    pressure, which is read as a stiffer casting.

Refuted by
    A pressure sensor at the far end of the chambers that reads the same.

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
    """Return inputs at the pressure behind a leak, and counted from one alike.

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
    """Return the pressure left: φ p (p + 2 p₀)/(P₁ + P₂) is lost, so that φ = 0 changes no bit."""
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
            "fraction of a small pressure read that is lost before the chambers",
            0.0,
        ),
    ),
    mechanism="a leak: the pressure in the chambers is a fraction of that read",
    typical={"fraction": 0.1},
    revealed_by="a loss of curvature at every degradation rate, in a ratio that falls slowly with "
    "pressure; refuted by a second sensor at the far end",
    confusable_with=("film_mismatch", "gauge_gain", "wall_thickness", "shrinkage_reading"),
    on_inputs=lose_pressure,
)
