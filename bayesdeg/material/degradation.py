"""Material constants as polynomials of the degradation rate D_R, held by their values at nodes.

Values at nodes are quantities of the material itself, so that priors can be stated for them and
the sampler finds them little correlated; the coefficients of the powers of D_R are neither.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from bayesdeg.material.modes import FloatArray
from bayesdeg.material.stability import BoolArray, satisfies_baker_ericksen

type Nodes = tuple[float, ...]

NODES: tuple[Nodes, ...] = (
    (0.0,),
    (0.0, 25.0),
    (0.0, 12.5, 25.0),
    (0.0, 25.0 / 3.0, 50.0 / 3.0, 25.0),
)
"""Evenly spaced nodes of each order [%]."""
SMALLEST_SPACING = 1.0
"""Levels of degradation [%] closer than this count as one."""


def nodes_for(degradations: npt.ArrayLike, order: int = 2) -> Nodes:
    """Return the nodes of the highest polynomial that the data can support.

    Parameters
    ----------
    degradations : array_like
        Degradation rates of the specimens [%].
    order : int
        Order wanted: 0, 1, 2 or 3.

    Returns
    -------
    tuple of float
        Those of ``NODES``; for a single level, that level.  The order is at most the number of
        distinct levels less one.

    Raises
    ------
    ValueError
        If there are no levels, one is not finite, or the order is none of 0, 1, 2, 3.

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
        raise ValueError("degradation levels must be finite, and there must be one at least")
    distinct = _count_distinct(levels)
    if distinct == 1:
        return (round(float(levels.mean()), 1),)
    return NODES[min(order, distinct - 1)]


def lagrange_weights(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    r"""Return the weights of the values at the nodes in the value at D_R.

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


def lagrange_slopes(degradation: npt.ArrayLike, nodes: Nodes) -> FloatArray:
    """Return the derivative of `lagrange_weights` by D_R [1/%], shape (..., n_nodes).

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
        If two nodes coincide or their number is not that of the values.

    Examples
    --------
    >>> polynomial([0.0, 1.0, 4.0], [0.0, 6.25, 25.0], (0.0, 12.5, 25.0))  # (D / 12.5)²
    array([0.  , 0.25, 4.  ])
    """
    return _combine(lagrange_weights(degradation, nodes), values_at_nodes)


def derivative(
    values_at_nodes: npt.ArrayLike, degradation: npt.ArrayLike, nodes: Nodes
) -> FloatArray:
    """Return the derivative of `polynomial` by D_R, in the unit of the values per %.

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
    r"""Return Yeoh's constants at D_R, each a polynomial of it.

    At the nodes :math:`C_2 = r \sqrt{3 C_1 C_3}`, so r > −1 is stable there exactly (see
    `stability.satisfies_baker_ericksen`); between them see `is_stable`.

    Parameters
    ----------
    c1_nodes, c3_nodes : array_like, shape (..., n_nodes)
        C₁ and C₃ at the nodes [MPa], not negative.
    c2_ratio_nodes : array_like, shape (..., n_nodes)
        r at the nodes [–].
    degradation : array_like
        Degradation rate D_R [%]; shapes as in `polynomial`.
    nodes : tuple of float
        Distinct nodes [%].

    Returns
    -------
    tuple of ndarray
        C₁, C₂, C₃ [MPa].

    Raises
    ------
    ValueError
        If two nodes coincide or their number is not that of the values.

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
    points: int = 51,
) -> BoolArray:
    """Return whether C₁ > 0, C₃ > 0 and C₂ > −√(3 C₁ C₃) for every D_R from 0 to the largest.

    Parameters
    ----------
    c1_nodes, c2_ratio_nodes, c3_nodes : array_like, shape (..., n_nodes)
        As in `yeoh_constants`.
    largest_degradation : float
        Largest D_R that is going to be asked for [%].
    nodes : tuple of float
        Distinct nodes [%].
    points : int
        Levels examined.

    Returns
    -------
    ndarray of bool, shape (...)

    Raises
    ------
    ValueError
        If two nodes coincide or their number is not that of the values.

    Examples
    --------
    >>> is_stable(
    ...     [[0.3, 1.6]], [[-0.5, -0.5]], [[0.01, 0.1]], largest_degradation=25, nodes=(0.0, 25.0)
    ... )
    array([ True])
    """
    grid = np.linspace(0.0, largest_degradation, points)
    c1, c2, c3 = yeoh_constants(c1_nodes, c2_ratio_nodes, c3_nodes, grid, nodes)
    return np.asarray(np.all((c3 > 0.0) & satisfies_baker_ericksen(c1, c2, c3), axis=-1))


def young_modulus(c1: npt.ArrayLike, root_term: npt.ArrayLike = 0.0) -> FloatArray:
    r"""Return Young's modulus at zero strain, Y = 6 C₁ + √3 r [MPa].

    Parameters
    ----------
    c1 : array_like
        C₁ of Yeoh's law [MPa].
    root_term : array_like, broadcastable
        r of a further energy r (√I₂ − √3) [MPa].

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
        raise ValueError(f"nodes must differ from each other, not {nodes}")
    others = np.array([np.delete(places, i) for i in range(places.size)])
    return others, np.prod(places[:, np.newaxis] - others, axis=-1)


def _count_distinct(levels: FloatArray) -> int:
    count, start = 1, levels[0]
    for level in levels:
        if level - start >= SMALLEST_SPACING:
            count, start = count + 1, level
    return count
