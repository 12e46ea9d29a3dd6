r"""Homogeneous tests of an incompressible solid: what one stretch makes of the other two.

Every mode has the principal stretches :math:`\lambda^{e_1}, \lambda^{e_2}, \lambda^{e_3}` with
constant exponents that sum to zero, so every sum of powers of them, hence every invariant, is a
function of the one stretch :math:`\lambda`.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

type FloatArray = npt.NDArray[np.float64]
type ModeName = Literal["uniaxial", "equibiaxial", "planar"]
type MeasureName = Literal["nominal", "cauchy"]
type Modes = str | npt.ArrayLike
type Measures = str | npt.ArrayLike

EXPONENTS: dict[str, tuple[float, float, float]] = {
    "uniaxial": (1.0, -0.5, -0.5),
    "equibiaxial": (1.0, 1.0, -2.0),
    "planar": (1.0, 0.0, -1.0),
}
LOADED_AXES: dict[str, float] = {"uniaxial": 1.0, "equibiaxial": 2.0, "planar": 1.0}
MEASURES = ("nominal", "cauchy")


class Path(NamedTuple):
    """A scalar along a mode: its value and its first two derivatives by the stretch."""

    value: FloatArray
    slope: FloatArray
    curvature: FloatArray


def principal_stretches(stretch: npt.ArrayLike, mode: Modes) -> FloatArray:
    """Return the three principal stretches of a mode, along a new last axis.

    Raises
    ------
    ValueError
        If the mode is unknown.

    Examples
    --------
    >>> principal_stretches(2.0, "equibiaxial")
    array([2.  , 2.  , 0.25])
    """
    base = np.asarray(stretch, dtype=np.float64)[..., np.newaxis]
    return np.asarray(base ** _lookup(EXPONENTS, mode), dtype=np.float64)


def power_sum(stretch: npt.ArrayLike, mode: Modes, power: npt.ArrayLike) -> Path:
    r"""Return the sum of powers of the principal stretches, less 3, along a mode.

    .. math:: S_p(\lambda) = \lambda_1^p + \lambda_2^p + \lambda_3^p - 3

    S₂ is I₁ − 3 and, for an incompressible solid, S₋₂ is I₂ − 3.

    Parameters
    ----------
    stretch : array_like
        Stretch along the load [–], above 0.
    mode : str or array_like of str
        ``uniaxial``, ``equibiaxial`` or ``planar`` (pure shear); one for all or one for each
        stretch.
    power : array_like
        Power p [–].

    Returns
    -------
    Path
        S_p and its derivatives by the stretch, in the common shape of the arguments.

    Raises
    ------
    ValueError
        If the mode is unknown or a stretch is not above 0.

    Examples
    --------
    >>> float(power_sum(2.0, "uniaxial", 2.0).value)
    2.0
    """
    stretch = np.asarray(stretch, dtype=np.float64)
    if np.any(stretch <= 0.0):
        raise ValueError("a stretch must be above 0; 1 is undeformed")
    exponents = _lookup(EXPONENTS, mode) * np.asarray(power, dtype=np.float64)[..., np.newaxis]
    base = stretch[..., np.newaxis]
    # keeps the digits of a small strain, where the three powers nearly cancel against 3
    excess = np.expm1(exponents * np.log(base))
    slope = exponents * (1.0 + excess)
    return Path(
        excess.sum(axis=-1),
        slope.sum(axis=-1) / stretch,
        (slope * (exponents - 1.0)).sum(axis=-1) / np.square(stretch),
    )


def root_second_invariant(stretch: npt.ArrayLike, mode: Modes) -> Path:
    r"""Return :math:`\sqrt{I_2} - \sqrt 3` along a mode with its derivatives by the stretch.

    Parameters
    ----------
    stretch : array_like
        Stretch along the load [–], above 0.
    mode : str or array_like of str
        See `power_sum`.

    Returns
    -------
    Path

    Raises
    ------
    ValueError
        If the mode is unknown or a stretch is not above 0.

    Examples
    --------
    >>> round(float(root_second_invariant(2.0, "equibiaxial").value), 4)
    2.33
    """
    i2 = power_sum(stretch, mode, -2.0)
    root = np.sqrt(3.0 + i2.value)
    return chain(
        i2, energy=i2.value / (root + math.sqrt(3.0)), first=0.5 / root, second=-0.25 / root**3
    )


def chain(inner: Path, *, energy: FloatArray, first: FloatArray, second: FloatArray) -> Path:
    """Return the path of an energy, given it and its derivatives by the inner scalar."""
    slope = first * inner.slope
    return Path(energy, slope, second * np.square(inner.slope) + first * inner.curvature)


def loaded_axes(mode: Modes) -> FloatArray:
    """Return on how many axes the stretch of the mode is imposed by the same load.

    The nominal stress on each of them is the slope of the energy by the stretch, divided by this.

    Examples
    --------
    >>> float(loaded_axes("equibiaxial"))
    2.0
    """
    return _lookup(LOADED_AXES, mode)


def measure_factor(stretch: npt.ArrayLike, measure: Measures) -> FloatArray:
    """Return what the nominal stress is to be multiplied by: 1, or the stretch for Cauchy stress.

    Examples
    --------
    >>> measure_factor([1.5, 2.0], "cauchy")
    array([1.5, 2. ])
    """
    names = np.asarray(measure, dtype=object)
    unknown = [str(name) for name in names.ravel() if name not in MEASURES]
    if unknown:
        raise ValueError(f"unknown stress measure {unknown[0]!r}; one of {', '.join(MEASURES)}")
    return np.where(names == "cauchy", np.asarray(stretch, dtype=np.float64), 1.0)


def _lookup[Value](table: dict[str, Value], mode: Modes) -> FloatArray:
    names = np.asarray(mode, dtype=object)
    unknown = [str(name) for name in names.ravel() if name not in table]
    if unknown:
        raise ValueError(f"unknown mode {unknown[0]!r}; one of {', '.join(table)}")
    values = np.array([table[name] for name in names.ravel()], dtype=np.float64)
    return values.reshape(names.shape + values.shape[1:])
