"""What chance alone gives: Monte Carlo p-values."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def chance_of(statistic: Floats | float, null: Floats, *, fewest: int = 0) -> Floats:
    """Return how often chance gives at least as much, (1 + #)/(1 + n).

    Data count among those that were simulated, so that the p-value of a right model is uniform,
    and never 0.

    Parameters
    ----------
    statistic : float or array, shape (...)
        Of the data.
    null : array, shape (..., n)
        The same of n data sets simulated without an effect.
    fewest : int
        Simulated data sets below which nothing is known: then it is nan.

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
