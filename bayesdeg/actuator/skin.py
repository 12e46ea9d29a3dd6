"""The skin: constants that vary with the depth under exposed faces, the mean of D_R kept."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.body import Body

Floats = NDArray[np.float64]

SKIN_DEPTH = 0.5  # mm at moulded size, over which degradation falls by e from an exposed face


def skin_profile(body: Body, depth: float = SKIN_DEPTH) -> Floats:
    """Return the share of the skin's contrast at every quadrature point, (n_elements, n_points).

    ψ = (e^(−d/ℓ) − m)/(1 − m), d the depth under the nearest exposed face and m the volume mean
    of e^(−d/ℓ): ψ is 1 on the face, and its volume mean is 0. Since ln C is nearly linear in the
    degradation rate, ln C(x) = ln C + skin · ψ keeps the volume mean of the degradation rate.

    Parameters
    ----------
    body : Body
        With the depth of its quadrature points.
    depth : float
        Decay length ℓ [mm].

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> float(np.abs(skin_profile(box((1.0, 1.0, 1.0), divisions=(1, 1, 1)))).max())
    0.0
    """
    decay = np.exp(-body.depth / depth)
    mean = float(np.sum(decay * body.weights) / np.sum(body.weights))
    profile: Floats = (decay - mean) / (1.0 - mean)
    return profile
