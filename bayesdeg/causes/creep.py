"""Creep: the material goes on yielding while a pressure is held.

Mechanism
    A tensile test takes seconds, a pressure step is held for longer before it is read. The bends
    of held steps grow, and when pressure is let out the part comes back late.

Equation
    Boltzmann's superposition, in load:
    p_eff(t_j) = p_j + a Σ_{i ≤ j} (p_i − p_{i−1}) (1 − exp(−(t_j − t_{i−1})/τ)),
    where the step of a reading is made right after the reading before it. Time is that since the
    specimen's first row, of which no hold is known. The paper is taken to yield alike.

Typical size
    a = 0.01–0.17, growing over seconds to minutes, in cast silicone arms; gels of gelatin creep
    further over hours. A fresh default actuator balloons at 261 ± 4 kPa, and the emulator refuses
    p_eff above 252 kPa: its step to 240 kPa from a = 0.05 on. A third of prior draws leave every
    reading of a study up to 240 kPa, and 99 % of all readings are left. A stress that relaxes by a
    share g creeps by a = g/(1 − g); solved at every integration point, on paper that does not
    creep, the rule leaves 12 % of the effect, and 21 % of measured growth in a silicone arm
    (`benchmarks/rules.py`). One time constant stands for a spectrum of them: of relaxation with
    one, most of what is left is at the end of unloading.

Revealed by
    Curvature that exceeds the simulated one the longer the steps were held; unloading that lags
    above loading. With holds much longer than τ it is a constant ratio, like softer material.

Refuted by
    The same curvature after a short and after a long hold.

Source
    Boltzmann (1878), Ann. Phys. 241:430, doi:10.1002/andp.18782411107; Gilsenan and Ross-Murphy
    (2001), Int. J. Biol. Macromol. 29:53, for creep of gelatin gels.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import without_time
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.causes.history import known_time, lagging
from bayesdeg.priors import LogNormal, Parameter, TruncatedNormal


def creep_under_load(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at the pressure that, applied at once, bends as far as the history did."""
    steps = np.diff(inputs.pressure, axis=-1, prepend=0.0)
    late = lagging(steps, known_time(conditions), effect["time_constant"])
    # rounding may leave less than nothing at the end of unloading
    return replace(inputs, pressure=np.maximum(inputs.pressure + effect["amount"] * late, 0.0))


CAUSE = Cause(
    name="creep",
    stage=Stage.RESPONSE,
    parameters=(
        Parameter(
            "amount",
            TruncatedNormal(0.0, 0.12, 0.0, 1.0),
            "–",
            "growth of the load's effect under a pressure held for ever",
            0.0,
        ),
        Parameter("time_constant", LogNormal(30.0, 1.0), "s", "time constant of that growth", 30.0),
    ),
    mechanism="the material yields further while a pressure is held",
    typical={"amount": 0.15, "time_constant": 30.0},
    revealed_by="curvature that grows with the time a pressure is held, and lags on unloading; "
    "refuted by the same curvature after short and long holds",
    confusable_with=("humidity_drift", "film_mismatch", "mullins"),
    needs=("time_s",),
    on_inputs=creep_under_load,
    blind=without_time,
)
