"""Whether the readings contradict what was measured beside them: means of replicates.

Curves alone cannot tell a stiffer actuator from a larger one: a model that is wrong may still fit
them, by a volume ratio that nobody measured. Student's law of such a mean gives way to that.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from bayesdeg.inference.data import Statistic
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Conflict:
    """The measured mean that the calibrated model contradicts most.

    Parameters
    ----------
    statistic : Statistic
        What was measured.
    wanted, wanted_sd : float
        What the calibrated model has instead, in the quantity's unit.
    p_value : float
        Probability of a mean at least as far off, times the number of means that were compared.
    """

    statistic: Statistic
    wanted: float
    wanted_sd: float
    p_value: float


def conflict(model: Model, vectors: Floats) -> Conflict | None:
    r"""Compare measured means with a posterior.

    .. math:: p = 2 P(T_\nu > |s - E| / \sqrt{se^2 + sd^2})

    with E and sd those of the posterior, which knows the mean already: p is rather too large.

    Parameters
    ----------
    model : Model
        With statistics; else there is nothing to compare: None.
    vectors : array, shape (k, n_parameters)
        Posterior draws.

    References
    ----------
    Evans and Moshonov (2006), doi:10.1214/06-BA129, for conflicts between what is known beforehand
    and data; Student's law is that of a mean of few replicates.
    """
    values = model.table.named(vectors)
    found = [_of(statistic, model.expected(values, statistic)) for statistic in model.statistics]
    if not found:
        return None
    worst = min(found, key=lambda one: one.p_value)
    chance = min(1.0, worst.p_value * len(found))
    return Conflict(worst.statistic, worst.wanted, worst.wanted_sd, chance)


def _of(statistic: Statistic, expected: Floats) -> Conflict:
    wanted, sd = float(np.mean(expected)), float(np.std(expected))
    far = abs(statistic.value - wanted) / float(np.hypot(statistic.se, sd))
    dof = statistic.dof
    chance = float(2.0 * (stats.norm.sf(far) if np.isinf(dof) else stats.t.sf(far, dof)))
    return Conflict(statistic, wanted, sd, chance)
