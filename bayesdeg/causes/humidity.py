"""How much drier the room is than the air in which films and parts were stored."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STORED = 67.0
"""Relative humidity in which films and parts are stored [%]."""
TESTED = 60.0
"""Relative humidity of the room where none was recorded [%]."""
SAME = 0.5
"""Humidities that differ by less are the same to a hygrometer [%]."""


def dryness(humidity: Floats) -> Floats:
    """Return (67 % − RH)/(67 % − 60 %) [–]: 0 in the storage air, 1 in the usual test air.

    Source of both humidities: Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> dryness(np.array([67.0, 60.0, 46.0])).tolist()
    [0.0, 1.0, 3.0]
    """
    return (STORED - humidity) / (STORED - TESTED)
