"""Conflicts of the readings with other information: means of replicates, and priors.

Curves alone cannot tell a stiffer actuator from a larger one: a wrong model may fit them with a
volume ratio that contradicts the measured one. Student's law of such a mean yields to that, and a
prior in place of a mean yields to many readings. Data simulated from the fitted model do not
reveal it, since they come from that same volume ratio.
"""

from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.findings import Conflict, Questioned
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.means import Means
from bayesdeg.priors import Distribution, Flat, Parameter

Floats = NDArray[np.float64]

PRIOR_VALUES = 20_000  # prior draws: tails are known to 5e-5, for some 30 parameters to 0.0015
INTERVAL = 0.999  # prior interval, as shown


def conflict(model: JointModel, vectors: Floats) -> Conflict | None:
    r"""Compare measured means with a posterior.

    .. math:: p = 2 P(T_\nu > |s - E| / \sqrt{se^2 + sd^2})

    with E and sd those of the posterior, which already includes the mean, so p is rather too large.

    Vectors (k, n_parameters) are posterior draws. None if the model has no measured means.

    References
    ----------
    Evans and Moshonov (2006), doi:10.1214/06-BA129, for conflicts between what is known beforehand
    and data; Student's law is that of a mean of few replicates.
    """
    values = model.table.named(vectors)
    state = model.state(values)
    found = []
    for statistic, expected in chain.from_iterable(o.compared(state) for o in model.of_kind(Means)):
        wanted, sd = float(np.mean(expected)), float(np.std(expected))
        far = abs(statistic.value - wanted) / float(np.hypot(statistic.se, sd))
        dof = statistic.dof
        one = Conflict(
            quantity=statistic.quantity,
            measured=statistic.value,
            standard_error=statistic.se,
            source=statistic.source,
            calibrated=wanted,
            p_value=float(2.0 * (stats.norm.sf(far) if np.isinf(dof) else stats.t.sf(far, dof))),
            calibrated_sd=sd,
        )
        found.append(one)
    if not found:
        return None
    worst = min(found, key=lambda one: one.p_value)
    return worst.model_copy(update={"p_value": min(1.0, worst.p_value * len(found))})


def questioned(model: JointModel, vectors: Floats) -> tuple[Questioned, ...]:
    r"""Return the parameters calibrated to values that their priors all but exclude.

    .. math:: p = m P(\pi(\theta) \le \pi(\theta_{50}))

    with :math:`\pi` the prior density in the users' unit, :math:`\theta_{50}` the posterior median
    and m the number of parameters; `MISFIT_LEVEL` over some 20 of them is the 99.9 % interval. The
    posterior already includes the prior, so p is rather too large. A uniform or flat prior is never
    contradicted, nor is the prior of an error by readings that are more accurate.

    Vectors (k, n_parameters) are posterior draws. Parameters of causes are left out: their sizes
    are judged with the causes.

    References
    ----------
    Evans and Moshonov (2006), doi:10.1214/06-BA129.
    """
    values = model.table.named(vectors)
    medians = {parameter: float(np.median(values[parameter.name])) for parameter in model.base}
    p_values = {
        one: min(1.0, surprise(one.law, value) * len(medians)) for one, value in medians.items()
    }
    # flat laws, which have no quantiles, never get here
    off = [one for one in medians if p_values[one] <= MISFIT_LEVEL]
    found = [questioned_at(one, medians[one], p_values[one]) for one in off]
    return tuple(sorted(found, key=lambda one: one.p_value))


def questioned_at(parameter: Parameter, median: float, p_value: float) -> Questioned:
    """Return the record of a parameter calibrated to a median, with its 99.9 % prior interval."""
    low, high = parameter.law.quantile(np.array([0.5 - 0.5 * INTERVAL, 0.5 + 0.5 * INTERVAL]))
    return Questioned(
        parameter=parameter.name,
        meaning=parameter.meaning,
        unit=parameter.unit,
        median=median,
        prior_low=float(low),
        prior_high=float(high),
        p_value=p_value,
    )


def surprise(law: Distribution, value: float) -> float:
    """Return the probability of values no more probable than this one.

    Examples
    --------
    >>> from bayesdeg.priors import Normal, Uniform
    >>> round(surprise(Normal(0.0, 1.0), 1.96), 3), surprise(Uniform(0.0, 1.0), 0.999)
    (0.05, 1.0)
    """
    if isinstance(law, Flat):
        return 1.0
    drawn = law.quantile((np.arange(PRIOR_VALUES) + 0.5) / PRIOR_VALUES)
    density = float(law.log_density(value))
    # a constant density is the same in all digits but the last
    as_small = law.log_density(drawn) <= density + 1e-9 * max(1.0, abs(density))
    return float(chance_of(1.0, as_small.astype(np.float64)))
