"""Pressure loss: a leak between sensor and chambers.

Mechanism
    What fills the chambers flows through a leak, and the tubing between sensor and actuator takes a
    share of the pressure, so that the chambers get a fraction of what is read. A liquid flows in
    proportion to a difference of pressures, a gas in proportion to that of their squares, since it
    expands on its way: in a tube and in the leak behind it alike, laminar or not. So the share that
    a gas loses falls with pressure.

Equation
    p_true = (1 − φ) p of a liquid, √((1 − φ)(p + p₀)² + φ p₀²) − p₀ of a gas, with p₀ = 101.325 kPa
    the pressure of the air outside, and between them (1 − γ) of the first and γ of the second.
    Both lose φ of a small pressure.

Typical size
    0–20 %: estimated from the flow resistance of thin tubing against a slow leak. A leak only takes
    away; a gauge that is off either way is ``gauge_gain``.

Revealed by
    A loss of curvature at every degradation rate, in a ratio that is constant in pressure or falls
    with it. That of a liquid cannot be told from a stiffer casting (``film_mismatch``) by curvature
    alone, which depends on p/C1 alone; blocked force or a second pressure sensor can.

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
    >>> gas = {"fraction": 0.2 * one, "gas_share": one}
    >>> (lose_pressure(inputs, tests, gas).pressure / inputs.pressure).round(3).tolist()
    [[[0.801, 0.86]]]
    """
    lost, gas = effect["fraction"], effect["gas_share"]
    reference = inputs.reference_pressure
    return replace(
        inputs,
        pressure=_behind(inputs.pressure, lost, gas),
        reference_pressure=None if reference is None else _behind(reference, lost, gas),
    )


def _behind(pressure: Floats, lost: Floats, gas: Floats) -> Floats:
    """Return the pressure left; a gas loses φ p (p + 2 p₀)/(P₁ + P₂), as its squares say."""
    before = pressure + ATMOSPHERE
    behind = np.sqrt((1.0 - lost) * before**2 + lost * ATMOSPHERE**2)
    of_liquid = (1.0 - gas) + gas * (pressure + 2.0 * ATMOSPHERE) / (before + behind)
    found: Floats = pressure * (1.0 - lost * of_liquid)
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
        Parameter(
            "gas_share",
            TruncatedNormal(0.5, 1.0, 0.0, 1.0),
            "–",
            "1 where a larger pressure loses as a gas does, 0 as a liquid",
            0.0,
        ),
    ),
    mechanism="a leak: the pressure in the chambers is a fraction of that read",
    typical={"fraction": 0.1, "gas_share": 0.0},
    revealed_by="a loss of curvature in a ratio that is constant in pressure or, of a gas, falls "
    "with it, at every degradation rate; refuted by a second sensor at the far end",
    confusable_with=("film_mismatch", "gauge_gain", "wall_thickness", "shrinkage_reading"),
    on_inputs=lose_pressure,
)
