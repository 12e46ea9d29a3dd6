"""Which Yeoh constants describe a stable solid, C₂ being negative as it often is."""

import numpy as np
import numpy.typing as npt

from bayesdeg.material.modes import FloatArray, Modes
from bayesdeg.material.stress import yeoh_tangent_basis

type BoolArray = npt.NDArray[np.bool_]


def satisfies_baker_ericksen(c1: npt.ArrayLike, c2: npt.ArrayLike, c3: npt.ArrayLike) -> BoolArray:
    r"""Return whether the larger principal stretch always carries the larger stress.

    For a solid of I₁ alone, the Baker–Ericksen inequalities are

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


def smallest_positive_ratio(c3_over_c1: npt.ArrayLike) -> FloatArray:
    """Return −√(3 C₃/C₁): C₂/C₁ must exceed it for dW/dI₁ > 0 at every strain.

    Examples
    --------
    >>> smallest_positive_ratio([0.03, 0.12])
    array([-0.3, -0.6])
    """
    return -np.sqrt(3.0 * np.asarray(c3_over_c1, dtype=np.float64))


def smallest_monotone_ratio(
    c3_over_c1: npt.ArrayLike, *, largest_stretch: float, mode: Modes, points: int = 2000
) -> FloatArray:
    r"""Return the smallest C₂/C₁ with which nominal stress never falls up to a stretch.

    The slope of the nominal stress is linear in the constants, :math:`T_1 C_1 + T_2 C_2 + T_3 C_3`,
    with T₂ > 0 above stretch 1, so the bound is

    .. math:: \frac{C_2}{C_1} \ge \max_{1 < \lambda \le \lambda_{max}}
        - \frac{T_1 + T_3 \, C_3 / C_1}{T_2}

    Of the three modes equibiaxial tension is the strictest.

    Parameters
    ----------
    c3_over_c1 : array_like
        C₃/C₁ [–].
    largest_stretch : float
        Stretch up to which stress must rise [–], above 1.
    mode : str
        ``uniaxial``, ``equibiaxial`` or ``planar``.
    points : int
        Stretches examined; the error of the bound falls with the square of their spacing.

    Returns
    -------
    ndarray
        Smallest admissible C₂/C₁ [–], in the shape of the argument.

    Raises
    ------
    ValueError
        If the mode is unknown or the stretch is not above 1.

    Examples
    --------
    >>> bound = smallest_monotone_ratio(0.01, largest_stretch=3.2, mode="equibiaxial")
    >>> round(float(bound), 3)
    -0.114
    """
    basis = yeoh_tangent_basis(_stretches(largest_stretch, points), mode)
    ratio = np.asarray(c3_over_c1, dtype=np.float64)[..., np.newaxis]
    bound: FloatArray = np.max(-(basis[:, 0] + ratio * basis[:, 2]) / basis[:, 1], axis=-1)
    return bound


def is_monotone(
    c1: npt.ArrayLike,
    c2: npt.ArrayLike,
    c3: npt.ArrayLike,
    *,
    largest_stretch: float,
    mode: Modes,
    points: int = 200,
) -> BoolArray:
    """Return whether nominal stress rises all the way from stretch 1 to the largest.

    Parameters
    ----------
    c1, c2, c3 : array_like
        Yeoh's constants [MPa].
    largest_stretch : float
        Stretch up to which stress must rise [–], above 1.
    mode : str
        ``uniaxial``, ``equibiaxial`` or ``planar``.
    points : int
        Stretches examined.

    Returns
    -------
    ndarray of bool

    Raises
    ------
    ValueError
        If the mode is unknown or the stretch is not above 1.

    Examples
    --------
    >>> is_monotone(1.0, [-0.11, -0.12], 0.01, largest_stretch=3.2, mode="equibiaxial")
    array([ True, False])
    """
    basis = yeoh_tangent_basis(_stretches(largest_stretch, points), mode)
    constants = np.stack(np.broadcast_arrays(c1, c2, c3), axis=-1).astype(np.float64)
    return np.asarray(np.all(constants @ basis.T > 0.0, axis=-1))


def _stretches(largest_stretch: float, points: int) -> FloatArray:
    if not largest_stretch > 1.0:
        raise ValueError(f"the largest stretch must be above 1, not {largest_stretch!r}")
    return np.linspace(1.0, largest_stretch, points + 1)[1:]
