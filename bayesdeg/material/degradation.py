r"""Material constants as polynomials of the degradation rate D_R, given by values at nodes.

Values at nodes are properties of the material itself: priors can be stated for them, and the
sampler finds them little correlated. Neither holds for the coefficients of the powers of D_R.

In Bernstein form, with :math:`t = (D - D_0)/(D_n - D_0)` between the first and the last node,

.. math:: C(D) = \sum_k b_k B_k(t), \qquad B_k(t) = \binom{n}{k} t^k (1 - t)^{n-k},

the control values b_k are those of the curve at both ends, and attract it in between.  B_k ≥ 0, so
positive control values make a positive constant, and with :math:`b^{(2)}_k = r_k
\sqrt{3 b^{(1)}_k b^{(3)}_k}`, r_k > −1, the Cauchy–Schwarz inequality gives

.. math:: C_2 > -\sum_k B_k \sqrt{3 b^{(1)}_k b^{(3)}_k} \ge -\sqrt{3 C_1 C_3}

at every degradation rate: such control values always give a stable material.

References
----------
Farouki (2012), The Bernstein polynomial basis: a centennial retrospective;
doi:10.1016/j.cagd.2012.03.001.
"""

import math
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayesdeg.material.hyperelastic import FloatArray

type BoolArray = npt.NDArray[np.bool_]


def satisfies_baker_ericksen(c1: npt.ArrayLike, c2: npt.ArrayLike, c3: npt.ArrayLike) -> BoolArray:
    r"""Return whether the larger principal stretch always carries the larger stress.

    For a solid with W(I₁), the Baker–Ericksen inequalities are

    .. math:: \frac{dW}{dI_1} = C_1 + 2 C_2 (I_1 - 3) + 3 C_3 (I_1 - 3)^2 > 0 \quad
        \text{for all } I_1 \ge 3,

    which holds if and only if C₁ > 0, C₃ ≥ 0 and C₂ > −√(3 C₁ C₃) or C₂ ≥ 0.  They are necessary
    for ellipticity.

    Parameters
    ----------
    c1, c2, c3 : array_like
        Yeoh's constants [MPa].

    Returns
    -------
    ndarray of bool

    References
    ----------
    Baker, Ericksen (1954), J. Wash. Acad. Sci. 44, 33.

    Examples
    --------
    >>> satisfies_baker_ericksen(1.0, [-0.17, -0.18], 0.01)
    array([ True, False])
    """
    c1, c2, c3 = (np.asarray(c, dtype=np.float64) for c in (c1, c2, c3))
    stiffens = (c2 >= 0.0) | (np.square(c2) < 3.0 * c1 * c3)
    return np.asarray((c1 > 0.0) & (c3 >= 0.0) & stiffens)


type Nodes = tuple[float, ...]

NODES: tuple[Nodes, ...] = (
    (0.0,),
    (0.0, 25.0),
    (0.0, 12.5, 25.0),
    (0.0, 25.0 / 3.0, 50.0 / 3.0, 25.0),
)
"""Evenly spaced nodes of each order [%]."""
STABILITY_LEVELS = 51
"""Degradation rates at which stability is examined."""
SMALLEST_SPACING = 1.0
"""Levels of degradation [%] closer than this count as one."""


def nodes_for(degradations: npt.ArrayLike, order: int = 2) -> Nodes:
    """Return the nodes of the highest polynomial that the data support.

    Parameters
    ----------
    degradations : array_like
        Degradation rates of the specimens [%].
    order : int
        Desired order: 0, 1, 2 or 3.

    Returns
    -------
    tuple of float
        A row of ``NODES``; for a single level, that level.  The order is at most the number of
        distinct levels minus one.

    Raises
    ------
    ValueError
        If there are no levels, a level is not finite, or the order is not 0, 1, 2 or 3.

    Examples
    --------
    >>> nodes_for([0, 0, 25.2, 24.9])
    (0.0, 25.0)
    >>> nodes_for([14.8, 15.1])
    (14.9,)
    """
    levels = np.sort(np.asarray(degradations, dtype=np.float64).ravel())
    if order not in range(len(NODES)):
        raise ValueError(f"the order must be 0, 1, 2 or 3, not {order!r}")
    if levels.size == 0 or not np.all(np.isfinite(levels)):
        raise ValueError("at least one degradation level is needed, and all must be finite")
    distinct, start = 1, levels[0]
    for level in levels:
        if level - start >= SMALLEST_SPACING:
            distinct, start = distinct + 1, level
    if distinct == 1:
        return (round(float(levels.mean()), 1),)
    return NODES[min(order, distinct - 1)]


type _OfRates = Callable[[npt.ArrayLike, Nodes], FloatArray]

FEW = 1000
"""Sets of degradation rates whose weights are cached: those of specimens, not of draws."""


def _remembered(work: _OfRates) -> _OfRates:
    """Cache what depends on degradation rates and nodes only: densities recompute it often."""

    @lru_cache(maxsize=64)
    def known(raw: bytes, shape: tuple[int, ...], nodes: Nodes) -> FloatArray:
        found = work(np.frombuffer(raw).reshape(shape), nodes)
        found.setflags(write=False)
        return found

    @wraps(work)
    def remembered(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
        level = np.asarray(degradation, dtype=np.float64)
        if level.size > FEW:
            return work(level, nodes)
        return known(level.tobytes(), level.shape, nodes)

    return remembered


@_remembered
def lagrange_weights(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    r"""Return the Lagrange weights of the nodal values at D_R.

    .. math:: w_i(D) = \prod_{j \ne i} \frac{D - D_j}{D_i - D_j}

    Parameters
    ----------
    degradation : array_like
        Degradation rate D_R [%].
    nodes : tuple of float
        Distinct nodes [%].

    Returns
    -------
    ndarray, shape (..., n_nodes)

    Raises
    ------
    ValueError
        If two nodes coincide.

    Examples
    --------
    >>> lagrange_weights(6.25, (0.0, 12.5, 25.0))
    array([ 0.375,  0.75 , -0.125])
    """
    factors, spacing = _node_differences(degradation, nodes)
    return np.prod(factors, axis=-1) / spacing


@_remembered
def lagrange_slopes(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    """Return the derivative of `lagrange_weights` with respect to D_R [1/%], shape (..., n_nodes).

    Arguments and errors as `lagrange_weights`.

    Examples
    --------
    >>> lagrange_slopes(3.0, (0.0, 25.0))
    array([-0.04,  0.04])
    """
    factors, spacing = _node_differences(degradation, nodes)
    count = factors.shape[-1]
    without = [np.prod(np.delete(factors, k, axis=-1), axis=-1) for k in range(count)]
    total: FloatArray = sum(without, start=np.zeros(factors.shape[:-1]))
    return total / spacing


def polynomial(
    values_at_nodes: npt.ArrayLike, degradation: npt.ArrayLike, nodes: Nodes
) -> FloatArray:
    """Return the polynomial of D_R through the values at the nodes.

    Parameters
    ----------
    values_at_nodes : array_like, shape (..., n_nodes)
        Values at the nodes; leading axes are walkers.
    degradation : array_like, shape (), (S,) or (..., S)
        Degradation rate D_R [%]; the same for all walkers, or with their axes in front.
    nodes : tuple of float
        Distinct nodes [%].

    Returns
    -------
    ndarray, shape (...) or (..., S)
        In the unit of the values.

    Raises
    ------
    ValueError
        If two nodes coincide or their number differs from that of the values.

    Examples
    --------
    >>> polynomial([0.0, 1.0, 4.0], [0.0, 6.25, 25.0], (0.0, 12.5, 25.0))  # (D / 12.5)²
    array([0.  , 0.25, 4.  ])
    """
    return _combine(lagrange_weights(degradation, nodes), values_at_nodes)


def derivative(
    values_at_nodes: npt.ArrayLike, degradation: npt.ArrayLike, nodes: Nodes
) -> FloatArray:
    """Return the derivative of `polynomial` with respect to D_R, in the unit of the values per %.

    Arguments and errors as `polynomial`.

    Examples
    --------
    >>> derivative([0.0, 1.0, 4.0], 12.5, (0.0, 12.5, 25.0))
    array(0.16)
    """
    return _combine(lagrange_slopes(degradation, nodes), values_at_nodes)


def yeoh_constants(
    c1_nodes: npt.ArrayLike,
    c2_ratio_nodes: npt.ArrayLike,
    c3_nodes: npt.ArrayLike,
    degradation: npt.ArrayLike,
    nodes: Nodes,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    r"""Return Yeoh's constants at D_R, each a polynomial in D_R.

    At the nodes :math:`C_2 = r \sqrt{3 C_1 C_3}`, so the material is stable there if r > −1 (see
    `satisfies_baker_ericksen`); between them see `is_stable`.

    C₁, C₃ [MPa], not negative, and r [–] at the nodes are (..., n_nodes); shapes and errors are
    otherwise those of `polynomial`.

    References
    ----------
    Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485, quadratic trends of the constants;
    doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> c1, c2, c3 = yeoh_constants([0.3, 1.6], [-0.5, -0.5], [0.001, 0.1], 25.0, (0.0, 25.0))
    >>> round(float(c2), 4)
    -0.3464
    """
    c1, ratio, c3 = (
        np.asarray(values, dtype=np.float64) for values in (c1_nodes, c2_ratio_nodes, c3_nodes)
    )
    weights = lagrange_weights(degradation, nodes)
    c2 = ratio * np.sqrt(3.0 * c1 * c3)
    return _combine(weights, c1), _combine(weights, c2), _combine(weights, c3)


def is_stable(
    c1_nodes: npt.ArrayLike,
    c2_ratio_nodes: npt.ArrayLike,
    c3_nodes: npt.ArrayLike,
    *,
    largest_degradation: float,
    nodes: Nodes,
) -> BoolArray:
    """Return whether C₁ > 0, C₃ > 0 and C₂ > −√(3 C₁ C₃) for every D_R from 0 to the largest.

    Other arguments and errors as `yeoh_constants`; ``largest_degradation`` is in %.

    Examples
    --------
    >>> is_stable(
    ...     [[0.3, 1.6]], [[-0.5, -0.5]], [[0.01, 0.1]], largest_degradation=25, nodes=(0.0, 25.0)
    ... )
    array([ True])
    """
    grid = np.linspace(0.0, largest_degradation, STABILITY_LEVELS)
    c1, c2, c3 = yeoh_constants(c1_nodes, c2_ratio_nodes, c3_nodes, grid, nodes)
    return np.asarray(np.all((c3 > 0.0) & satisfies_baker_ericksen(c1, c2, c3), axis=-1))


def young_modulus(c1: npt.ArrayLike, root_term: npt.ArrayLike = 0.0) -> FloatArray:
    r"""Return Young's modulus at zero strain, Y = 6 C₁ + √3 r [MPa].

    Parameters
    ----------
    c1 : array_like
        C₁ of Yeoh's law [MPa].
    root_term : array_like, broadcastable
        r of an additional energy r (√I₂ − √3) [MPa].

    Examples
    --------
    >>> float(young_modulus(0.25))
    1.5
    >>> round(float(young_modulus(0.25, 0.125)), 4)
    1.7165
    """
    modulus = 6.0 * np.asarray(c1, dtype=np.float64)
    return np.asarray(modulus + np.sqrt(3.0) * np.asarray(root_term, dtype=np.float64))


def _combine(weights: FloatArray, values_at_nodes: npt.ArrayLike) -> FloatArray:
    values = np.asarray(values_at_nodes, dtype=np.float64)
    combined: FloatArray = np.matmul(weights, values[..., np.newaxis])[..., 0]
    return combined


def _node_differences(degradation: npt.ArrayLike, nodes: Nodes) -> tuple[FloatArray, FloatArray]:
    others, spacing = _other_nodes(tuple(nodes))
    degradation = np.asarray(degradation, dtype=np.float64)
    factors: FloatArray = degradation[..., np.newaxis, np.newaxis] - others
    return factors, spacing


@lru_cache(maxsize=16)
def _other_nodes(nodes: Nodes) -> tuple[FloatArray, FloatArray]:
    """Return the nodes other than each, (n_nodes, n_nodes - 1), and the product of distances."""
    places = np.asarray(nodes, dtype=np.float64)
    if np.unique(places).size != places.size:
        raise ValueError(f"nodes must be distinct, got {nodes}")
    others = np.array([np.delete(places, i) for i in range(places.size)])
    return others, np.prod(places[:, np.newaxis] - others, axis=-1)


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


@_remembered
def bernstein_weights(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    """Return B_k at degradation rates [%], shape (..., n_nodes).

    Examples
    --------
    >>> bernstein_weights(12.5, (0.0, 12.5, 25.0))
    array([0.25, 0.5 , 0.25])
    """
    return _bernstein(_place(degradation, nodes), len(nodes) - 1)


@_remembered
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
    """Return C₁, C₂, C₃ [MPa], or their derivatives with respect to D_R [MPa/%].

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
        raise ValueError(f"nodes must increase, got {nodes}")
    place: FloatArray = (level - nodes[0]) / (nodes[-1] - nodes[0])
    return place


def _bernstein(place: FloatArray, order: int) -> FloatArray:
    terms = [
        math.comb(order, k) * place**k * (1.0 - place) ** (order - k) for k in range(order + 1)
    ]
    return np.stack(terms, axis=-1)
