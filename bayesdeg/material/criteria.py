"""Failure criteria: which uniaxial stretch does as much harm as a multiaxial state.

Break tests are uniaxial, walls are stretched along two axes, and no criterion is established for
this material: the three here coincide in uniaxial tension and span a range elsewhere, in which the
principal stretch is the mildest.
"""

from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.optimize import elementwise

from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.modes import FloatArray
from bayesdeg.material.stress import cauchy_stress

type Criterion = Literal["principal_stretch", "cauchy_stress", "equivalent_strain"]

CRITERIA: tuple[Criterion, ...] = ("principal_stretch", "cauchy_stress", "equivalent_strain")


def hencky_equivalent_strain(stretches: npt.ArrayLike) -> FloatArray:
    r"""Return von Mises' equivalent of the logarithmic strain.

    .. math:: \varepsilon_{eq} = \sqrt{\tfrac23 \sum_i (\ln \lambda_i)^2}

    Parameters
    ----------
    stretches : array_like, shape (..., 3)
        Principal stretches [–] whose product is 1.

    Returns
    -------
    ndarray, shape (...)
        ln λ in uniaxial tension [–].

    Examples
    --------
    >>> round(float(hencky_equivalent_strain([2.0, 2.0, 0.25]) / np.log(2.0)), 12)
    2.0
    """
    strains = np.log(np.asarray(stretches, dtype=np.float64))
    return np.asarray(np.sqrt(2.0 / 3.0 * np.square(strains).sum(axis=-1)))


def largest_cauchy_stress(law: Yeoh, stretches: npt.ArrayLike) -> FloatArray:
    r"""Return the largest principal Cauchy stress [MPa] of a wall whose thinnest axis is free.

    .. math:: \sigma_1 = 2 \frac{dW}{dI_1} (\lambda_{max}^2 - \lambda_{min}^2)

    Gas pressure on the inner face is neglected, being small beside the wall's stress.

    Parameters
    ----------
    law : Yeoh
        Constants [MPa], which broadcast against the states.
    stretches : array_like, shape (..., 3)
        Principal stretches [–] whose product is 1.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(largest_cauchy_stress(Yeoh(0.25, 0.0, 0.0), [2.0, 1.0, 0.5]))
    1.875
    """
    squares = np.square(np.asarray(stretches, dtype=np.float64))
    c1, c2, c3 = (np.asarray(c, dtype=np.float64) for c in (law.c1, law.c2, law.c3))
    x = squares.sum(axis=-1) - 3.0
    first = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
    return np.asarray(2.0 * first * (squares.max(axis=-1) - squares.min(axis=-1)))


def equivalent_uniaxial_stretch(
    stretches: npt.ArrayLike, criterion: Criterion = "principal_stretch", law: Yeoh | None = None
) -> FloatArray:
    """Return the stretch in uniaxial tension at which the criterion sees the same.

    Parameters
    ----------
    stretches : array_like, shape (..., 3)
        Principal stretches [–] whose product is 1.
    criterion : str
        ``principal_stretch``, ``cauchy_stress`` (`largest_cauchy_stress`) or
        ``equivalent_strain`` (`hencky_equivalent_strain`).
    law : Yeoh, optional
        Needed for ``cauchy_stress`` only; nominal stress must rise with uniaxial stretch.

    Returns
    -------
    ndarray, shape (...)
        nan where no uniaxial stretch has that stress.

    Raises
    ------
    ValueError
        If the criterion is unknown, or is ``cauchy_stress`` without a law.

    Examples
    --------
    >>> float(equivalent_uniaxial_stretch([1.5, 1.5, 1 / 2.25], "equivalent_strain").round(12))
    2.25
    """
    if criterion == "principal_stretch":
        return np.asarray(stretches, dtype=np.float64).max(axis=-1)
    if criterion == "equivalent_strain":
        return np.exp(hencky_equivalent_strain(stretches))
    if criterion != "cauchy_stress":
        raise ValueError(f"unknown criterion {criterion!r}; one of {', '.join(CRITERIA)}")
    if law is None:
        raise ValueError("the criterion 'cauchy_stress' needs the material's law")
    return _stretch_at_stress(law, largest_cauchy_stress(law, stretches))


def utilisation(
    stretches: npt.ArrayLike,
    limit_stretch: npt.ArrayLike,
    *,
    criterion: Criterion = "principal_stretch",
    law: Yeoh | None = None,
) -> FloatArray:
    r"""Return how much of the elongation limit a state uses up; 1 is rupture.

    .. math:: u = \frac{\lambda_{eq} - 1}{\lambda_b - 1}

    Parameters
    ----------
    stretches : array_like, shape (..., 3)
        Principal stretches [–] whose product is 1.
    limit_stretch : array_like
        Uniaxial stretch at break λ_b [–], above 1.
    criterion, law
        As `equivalent_uniaxial_stretch`.

    Returns
    -------
    ndarray

    Raises
    ------
    ValueError
        As `equivalent_uniaxial_stretch`, and if a limit is not above 1.

    Examples
    --------
    >>> float(utilisation([1.5, 1.5, 1 / 2.25], 3.0))
    0.25
    """
    limit = np.asarray(limit_stretch, dtype=np.float64)
    if np.any(limit <= 1.0):
        raise ValueError("the limit stretch must be above 1")
    return (equivalent_uniaxial_stretch(stretches, criterion, law) - 1.0) / (limit - 1.0)


def _stretch_at_stress(law: Yeoh, stress: FloatArray) -> FloatArray:
    def excess(
        stretch: FloatArray, c1: FloatArray, c2: FloatArray, c3: FloatArray, wanted: FloatArray
    ) -> FloatArray:
        return cauchy_stress(Yeoh(c1, c2, c3), stretch, mode="uniaxial") - wanted

    arguments = tuple(
        np.asarray(array, dtype=np.float64)
        for array in np.broadcast_arrays(law.c1, law.c2, law.c3, stress)
    )
    start = np.ones_like(arguments[-1])
    bracket = elementwise.bracket_root(excess, start, start + 1.0, args=arguments, xmin=1.0)
    root = elementwise.find_root(excess, bracket.bracket, args=arguments)
    return np.where(root.success, root.x, np.nan)
