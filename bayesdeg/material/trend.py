r"""Material constants as polynomials of the degradation rate D_R that are stable by construction.

In Bernstein form, with :math:`t = (D - D_0)/(D_n - D_0)` between the first and the last node,

.. math:: C(D) = \sum_k b_k B_k(t), \qquad B_k(t) = \binom{n}{k} t^k (1 - t)^{n-k},

the control values b_k are those of the curve at both ends, and pull it between them.  B_k ≥ 0, so
positive control values make a positive constant, and with :math:`b^{(2)}_k = r_k
\sqrt{3 b^{(1)}_k b^{(3)}_k}`, r_k > −1, the Cauchy–Schwarz inequality gives

.. math:: C_2 > -\sum_k B_k \sqrt{3 b^{(1)}_k b^{(3)}_k} \ge -\sqrt{3 C_1 C_3}

at every degradation rate: no control values of this kind make an unstable material.

References
----------
Farouki (2012), The Bernstein polynomial basis: a centennial retrospective;
doi:10.1016/j.cagd.2012.03.001.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayesdeg.material.degradation import Nodes
from bayesdeg.material.modes import FloatArray


class Controls(NamedTuple):
    """Control values of Yeoh's constants, each of shape (..., n_nodes).

    Parameters
    ----------
    c1, c3 : array
        Of C₁ and C₃, positive [MPa].
    ratio : array
        r, larger than −1 [–].
    """

    c1: FloatArray
    ratio: FloatArray
    c3: FloatArray

    @property
    def c2(self) -> FloatArray:
        """Control values of C₂ [MPa]."""
        return self.ratio * np.sqrt(3.0 * self.c1 * self.c3)


def bernstein_weights(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    """Return B_k at degradation rates [%], shape (..., n_nodes).

    Examples
    --------
    >>> bernstein_weights(12.5, (0.0, 12.5, 25.0))
    array([0.25, 0.5 , 0.25])
    """
    return _bernstein(_place(degradation, nodes), len(nodes) - 1)


def bernstein_slopes(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    """Return dB_k/dD_R [1/%] at degradation rates [%], shape (..., n_nodes).

    Examples
    --------
    >>> bernstein_slopes(3.0, (0.0, 25.0))
    array([-0.04,  0.04])
    """
    place, order = _place(degradation, nodes), len(nodes) - 1
    if order == 0:
        return np.zeros((*place.shape, 1))
    lower = _bernstein(place, order - 1)
    nothing = np.zeros((*place.shape, 1))
    left = np.concatenate([nothing, lower], axis=-1)
    right = np.concatenate([lower, nothing], axis=-1)
    slopes: FloatArray = order / (nodes[-1] - nodes[0]) * (left - right)
    return slopes


def constants(controls: Controls, weights: FloatArray) -> FloatArray:
    """Return C₁, C₂, C₃ [MPa], or their derivatives by D_R [MPa/%].

    Parameters
    ----------
    controls : Controls
        Of shape (n, n_nodes).
    weights : array, shape (S, n_nodes) or (n, S, n_nodes)
        `bernstein_weights`, or `bernstein_slopes` for the derivatives.

    Returns
    -------
    array, shape (n, S, 3)

    Examples
    --------
    >>> ends = Controls(*np.array([[[0.3, 1.6]], [[-0.5, -0.5]], [[0.001, 0.1]]]))
    >>> constants(ends, bernstein_weights([25.0], (0.0, 25.0))).round(4)
    array([[[ 1.6   , -0.3464,  0.1   ]]])
    """
    values = np.stack([controls.c1, controls.c2, controls.c3], axis=-1)
    combined: FloatArray = np.matmul(weights, values)
    return combined


def _place(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    level = np.asarray(degradation, dtype=np.float64)
    if len(nodes) == 1:
        return np.zeros_like(level)
    if not nodes[-1] > nodes[0]:
        raise ValueError(f"nodes must increase, not {nodes}")
    place: FloatArray = (level - nodes[0]) / (nodes[-1] - nodes[0])
    return place


def _bernstein(place: FloatArray, order: int) -> FloatArray:
    terms = [
        math.comb(order, k) * place**k * (1.0 - place) ** (order - k) for k in range(order + 1)
    ]
    return np.stack(terms, axis=-1)
