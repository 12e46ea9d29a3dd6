"""Why the tests at hand cannot reveal a cause, in words; None where they can."""

import numpy as np

from bayesdeg.causes.cause import Conditions
from bayesdeg.causes.history import known_time

FRESH = 0.5
"""A specimen recorded up to this never was in the soil [%]."""


def without_degraded(conditions: Conditions) -> str | None:
    """Say so where no actuator was degraded.

    Examples
    --------
    >>> without_degraded(Conditions(np.array([[20.0]]), np.array([[0.0]])))
    'no degraded actuator was tested'
    """
    return None if np.any(conditions.degradation > FRESH) else "no degraded actuator was tested"


def without_time(conditions: Conditions) -> str | None:
    """Say so where no time is known to have passed between readings.

    Examples
    --------
    >>> without_time(Conditions(np.array([[20.0]]), np.array([[0.0]])))
    'no time was recorded'
    """
    if not np.any(np.isfinite(conditions.time)):
        return "no time was recorded"
    passed = np.ptp(known_time(conditions), axis=-1)
    return None if np.any(passed > 0.0) else "no time passed between readings"
