"""Common factor: actuators break at a fixed share of their films' elongation limit.

Equation
    ln ε_max → ln ε_max − cut, at every degradation rate.

It stands for a size effect, or for strain concentrated where walls meet. It is not in the
catalogue: it may prevent naming a cause but is not named itself, since counts cannot tell which of
the two it is.
"""

import numpy as np

from bayesdeg.causes.cause import Cause, Effect, Stage, StrengthConditions
from bayesdeg.material.strength import Strength
from bayesdeg.priors import Parameter, TruncatedNormal


def _cut_alike(strength: Strength, conditions: StrengthConditions, effect: Effect) -> Strength:
    return strength.weakened(effect["cut"], np.zeros(1))


COMMON_FACTOR = Cause(
    name="common_factor",
    stage=Stage.MATERIAL,
    parameters=(
        # the factor is 1.6 in the median and below 4 in 95 of 100 draws
        Parameter(
            "cut",
            TruncatedNormal(0.0, 0.7, 0.0, np.inf),
            "–",
            "ln of the elongation limit of films over that of actuators, at all degradation rates",
            0.0,
        ),
    ),
    mechanism="a larger stressed volume or concentrated strain lowers all elongation limits alike",
    typical={"cut": 0.5},
    revealed_by="ruptures below the films' elongation limit, at all degradation rates",
    on_strength=_cut_alike,
)
