"""Creep: the material keeps deforming while a pressure is held.

Mechanism
    A tensile test takes seconds; a pressure step is held for longer before it is read. Bending
    grows during the hold, and recovery lags when the pressure is released.

Equation
    Boltzmann's superposition, in load:
    p_eff(t_j) = p_j + a Σ_{i ≤ j} (p_i − p_{i−1}) (1 − exp(−(t_j − t_{i−1})/τ)),
    where the step of a reading is made right after the previous reading. Time counts from the
    specimen's first row, whose hold time is unknown. The paper is assumed to creep alike.

Typical size
    a = 0.01–0.17, growing over seconds to minutes, in cast silicone arms; gelatin gels creep
    further over hours. A fresh default actuator balloons at 261 ± 4 kPa, and the emulator refuses
    p_eff above 252 kPa: the step to 240 kPa from a = 0.05 on. A third of prior draws keep every
    reading of a study up to 240 kPa; 99 % of all readings are kept. A stress that relaxes by a
    share g creeps by a = g/(1 − g). Solved at every integration point, with paper that does not
    creep, the rule misses 12 % of the effect, and 21 % of measured growth in a silicone arm
    (`benchmarks/rules.py`). One time constant replaces a spectrum: with a single relaxation time,
    most of the remaining error is at the end of unloading.

Revealed by
    Curvature that exceeds the simulation by more the longer steps are held; unloading that lies
    above loading. With holds much longer than τ the ratio is constant, as for softer material.

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
    """Return inputs at the pressure that would bend as far at once as the loading history did."""
    steps = np.diff(inputs.pressure, axis=-1, prepend=0.0)
    late = lagging(steps, known_time(conditions), effect["time_constant"])
    # rounding may give a slightly negative pressure at the end of unloading
    return replace(inputs, pressure=np.maximum(inputs.pressure + effect["amount"] * late, 0.0))


CAUSE = Cause(
    name="creep",
    stage=Stage.RESPONSE,
    parameters=(
        Parameter(
            "amount",
            TruncatedNormal(0.0, 0.12, 0.0, 1.0),
            "–",
            "relative growth of the load's effect under a pressure held indefinitely",
            0.0,
        ),
        Parameter("time_constant", LogNormal(30.0, 1.0), "s", "time constant of that growth", 30.0),
    ),
    mechanism="the material creeps under constant pressure",
    typical={"amount": 0.15, "time_constant": 30.0},
    revealed_by="curvature that grows with the time a pressure is held and lags on unloading; "
    "refuted by the same curvature after short and long holds",
    confusable_with=("humidity_drift", "film_mismatch", "mullins", "hysteresis"),
    needs=("time_s",),
    on_inputs=creep_under_load,
    blind=without_time,
)
