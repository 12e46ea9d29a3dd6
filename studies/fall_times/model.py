"""Times of fall from rest, without drag unless that cause is active."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

type Values = Mapping[str, NDArray[np.float64]]

GRAVITY = 9.81  # m/s²


def fall_time(values: Values, x: Values) -> NDArray[np.float64]:
    """Return times [s] of v' = g − c v², arcosh(exp(c h))/√(c g); √(2h/g) for c = 0.

    Values are arrays of draws (k,), by the names of the parameters; inputs are columns of
    readings.csv (n,), or (k, n) where a cause changed them. The answer is (k, n).
    """
    height, draws = x["height_m"], len(next(iter(values.values())))
    gravity = values["g"][:, None] if "g" in values else GRAVITY
    drag = values["drag.coefficient"][:, None] if "drag.coefficient" in values else 0.0
    free = np.sqrt(2.0 * height / gravity)
    c = np.maximum(drag * height, 1e-12)
    longer = np.arccosh(np.exp(c)) / np.sqrt(2.0 * c)
    return np.broadcast_to(free * np.where(c > 1e-9, longer, 1.0), (draws, height.shape[-1]))
