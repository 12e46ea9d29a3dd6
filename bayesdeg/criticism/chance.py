"""Monte Carlo p-values."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

Floats = NDArray[np.float64]

DOUBT = 1e-3
"""Probability of so few or so many exceedances, if the p-value equals the level, below which its
side is clear: one in a thousand verdicts of studies with a p-value exactly at the level would
depend on the seed, and hardly any other."""


def chance_of(statistic: Floats | float, null: Floats, *, fewest: int = 0) -> Floats:
    """Return the Monte Carlo p-value (1 + #)/(1 + n), # the number of exceedances.

    The data count among the simulated sets, so that the p-value of a correct model is uniform and
    never 0.

    The statistic is that of the data, (...), the null that of n data sets simulated without an
    effect, (..., n); nan with fewer than `fewest` of these.

    References
    ----------
    Davison and Hinkley (1997), Bootstrap Methods and their Application, section 4.2.

    Examples
    --------
    >>> null = np.arange(99.0)
    >>> float(chance_of(98.0, null)), float(chance_of(1.0, null, fewest=200))
    (0.02, nan)
    """
    count = null.shape[-1]
    larger = np.sum(null >= np.asarray(statistic)[..., None], axis=-1)
    found: Floats = (1 + larger) / (1 + count) if count >= fewest else np.full(larger.shape, np.nan)
    return found


def is_clear(statistic: float, null: Floats, level: float) -> bool:
    """Return whether the side of a level on which a p-value lies is clear.

    The number of data sets beyond the observed one is binomial. If as few, or as many, are
    improbable for a p-value at the level, more data sets would not change the side.

    As in `chance_of`, the null is that of n simulated data sets, (n,).

    References
    ----------
    Besag and Clifford (1991), doi:10.1093/biomet/78.2.301, for sequential Monte Carlo p-values.

    Examples
    --------
    >>> null = np.arange(200.0)
    >>> is_clear(196.0, null, 0.05), is_clear(192.0, null, 0.05), is_clear(150.0, null, 0.05)
    (False, False, True)
    """
    larger = int(np.sum(null >= statistic))
    law = binom(len(null), level)
    return bool(min(law.cdf(larger), law.sf(larger - 1)) < DOUBT)
