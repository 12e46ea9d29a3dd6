r"""Hysteresis: friction or backlash between the pressure that is set and that in the chambers.

Mechanism
    The valve of a regulator moves only once the difference of its two forces exceeds its friction;
    a worn thread has as much play. On the way up the chambers stay below the reading, on the way
    down above it. After a reversal they keep their pressure until the reading has moved through
    both. Air that is held back in the tubing does the same.

Equation
    The play operator of half-width w: P_j = max(p_j − w, min(p_j + w, P_{j−1})), with empty
    chambers at first, P = 0. A new cycle begins at a reading of zero, where P is at most w. So
    P = p − w on loading and p + w on unloading, except for readings within 2 w of a reversal, and
    the first ones, below w, where P = 0. P never exceeds the largest reading, so the emulator's
    range is never left.

Typical size
    Data sheets of proportional regulators state a hysteresis of up to 0.5 % of full scale, 2 w =
    4.5 kPa of 900 kPa; of regulators set by hand, w is 5–10 kPa, estimated.

Revealed by
    Unloading above loading by the same pressure 2 w, whatever the pressure, the hold and the cycle.
    Creep has more of it the longer a pressure is held, Mullins softening has none at the largest
    pressures, and later cycles repeat neither. Loading alone looks like ``pressure_offset``.

Refuted by
    A pressure sensor at the chambers that agrees on both branches; a loop that closes with slower
    or fewer steps.

Source
    Choudhury, Thornhill, Shah (2005), Control Eng. Pract. 13:641,
    doi:10.1016/j.conengprac.2004.05.005, for friction and dead band of pneumatic valves; Visintin
    (1994), Differential Models of Hysteresis, doi:10.1007/978-3-662-11557-2, for the operator.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Flags, Floats, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def lag_behind(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at the pressure that friction lets into the chambers."""
    begins = np.diff(conditions.cycle, axis=-1, prepend=conditions.cycle[:, :1]) != 0
    return replace(inputs, pressure=played(inputs.pressure, effect["friction"], begins))


def played(pressure: Floats, friction: Floats, begins: Flags) -> Floats:
    r"""Return the play of readings that begin at zero.

    Each reading limits what was before it to p − w ≤ P ≤ p + w. Limits applied one after another
    are again limits, so those of all readings are joined in pairs, fours, eights, ….

    Parameters
    ----------
    pressure : array, shape (walkers or 1, n_specimens or 1, n_points)
        p, in the order in which it was read, at least 0 [kPa].
    friction : array, shape (walkers, 1, 1)
        w [kPa].
    begins : array of bool, shape (n_specimens, n_points)
        Readings before which the pressure went down to zero; of the first, it is known.

    Returns
    -------
    array, shape (walkers, n_specimens, n_points)

    Examples
    --------
    >>> path = np.array([[[4.0, 40.0, 60.0, 50.0, 20.0, 40.0]]])
    >>> again = np.array([[False, False, False, False, False, True]])
    >>> played(path, np.full((1, 1, 1), 6.0), again)
    array([[[ 0., 34., 54., 54., 26., 34.]]])
    """
    low = pressure - friction
    high = np.where(begins, np.maximum(low, friction), pressure + friction)
    low, high = np.broadcast_arrays(low, high)
    reach = 1
    while reach < pressure.shape[-1]:
        ends = low[..., reach:], high[..., reach:]
        low, high = (
            np.concatenate([one[..., :reach], np.clip(one[..., :-reach], *ends)], axis=-1)
            for one in (low, high)
        )
        reach *= 2
    chambers: Floats = np.clip(0.0, low, high)  # empty at first
    return chambers


def without_both_branches(conditions: Conditions) -> str | None:
    """Say so where no actuator was read on its way up and on its way down.

    Examples
    --------
    >>> without_both_branches(Conditions(np.array([[20.0, 40.0]]), np.array([[0.0]])))
    'no actuator was read on both loading and unloading'
    """
    down = conditions.unloading
    both = np.any(down, axis=-1) & np.any(~down & (conditions.pressure > 0.0), axis=-1)
    return None if np.any(both) else "no actuator was read on both loading and unloading"


CAUSE = Cause(
    name="hysteresis",
    stage=Stage.LOAD,
    parameters=(
        Parameter(
            "friction",
            TruncatedNormal(0.0, 5.0, 0.0, 50.0),
            "kPa",
            "pressure by which the chambers lag behind the reading, half the width of the loop",
            0.0,
        ),
    ),
    mechanism="friction or backlash of the regulator or tubing: the pressure in the chambers is "
    "lower than the reading on loading and higher on unloading",
    typical={"friction": 6.0},
    revealed_by="unloading above loading by the same pressure at every pressure, hold and cycle; "
    "refuted by a sensor at the chambers that agrees on both branches",
    confusable_with=("creep", "mullins", "pressure_offset"),
    needs=("branch",),
    on_inputs=lag_behind,
    blind=without_both_branches,
)
