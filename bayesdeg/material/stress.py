"""Stress and tangent of a hyperelastic law in each mode, and Yeoh's stress as a linear model."""

import numpy as np
import numpy.typing as npt

from bayesdeg.material.hyperelastic import HyperelasticLaw
from bayesdeg.material.modes import (
    FloatArray,
    Measures,
    Modes,
    loaded_axes,
    measure_factor,
    power_sum,
    root_second_invariant,
)


def energy(law: HyperelasticLaw, stretch: npt.ArrayLike, *, mode: Modes) -> FloatArray:
    """Return the strain energy per undeformed volume [MPa]; 0 at stretch 1.

    Parameters
    ----------
    law : HyperelasticLaw
        Constants in arrays broadcast against the stretch.
    stretch : array_like
        Stretch along the load [–], above 0.
    mode : str or array_like of str
        ``uniaxial``, ``equibiaxial`` or ``planar``.

    Raises
    ------
    ValueError
        If the mode is unknown or a stretch is not above 0.

    Examples
    --------
    >>> from bayesdeg.material.hyperelastic import NeoHookean
    >>> float(energy(NeoHookean(0.3), 2.0, mode="uniaxial"))
    0.6
    """
    return law.along(stretch, mode).value


def nominal_stress(law: HyperelasticLaw, stretch: npt.ArrayLike, *, mode: Modes) -> FloatArray:
    r"""Return the nominal stress on the loaded axes: force over undeformed area [MPa].

    .. math:: P = \frac{1}{n} \frac{dw}{d\lambda}

    where w(λ) is the energy along the mode and n the number of axes that carry the load, so that
    the pressure of incompressibility is eliminated by the stress-free faces.  Arguments and errors
    as `energy`.

    Examples
    --------
    >>> from bayesdeg.material.hyperelastic import NeoHookean
    >>> float(nominal_stress(NeoHookean(0.3), 2.0, mode="uniaxial"))  # 2 C1 (λ − λ⁻²)
    1.05
    """
    return law.along(stretch, mode).slope / loaded_axes(mode)


def cauchy_stress(law: HyperelasticLaw, stretch: npt.ArrayLike, *, mode: Modes) -> FloatArray:
    r"""Return the Cauchy stress on the loaded axes: force over deformed area [MPa].

    .. math:: \sigma = \lambda P

    For Yeoh's solid in uniaxial tension this is the right-hand side of Eq. 2 of Nagai et al.
    (2021), :math:`2 (\lambda^2 - \lambda^{-1}) \sum_i i C_i (I_1 - 3)^{i-1}`.  The expression
    before it, ∂W/∂λ₁, is a misprint: it should be λ₁ ∂W/∂λ₁ with λ₂ = λ₃ = λ₁^(−1/2).  Fitting this
    formula to nominal stress gives constants that are too low: C₁ of a neo-Hookean solid stretched
    to 3.1 by 32 %.  Arguments and errors as `energy`.

    References
    ----------
    Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485; doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> from bayesdeg.material.hyperelastic import NeoHookean
    >>> float(cauchy_stress(NeoHookean(0.3), 2.0, mode="uniaxial"))
    2.1
    """
    return np.asarray(stretch, dtype=np.float64) * nominal_stress(law, stretch, mode=mode)


def tangent(law: HyperelasticLaw, stretch: npt.ArrayLike, *, mode: Modes) -> FloatArray:
    """Return the slope of the nominal stress by the stretch [MPa].

    At stretch 1 in uniaxial tension it is Young's modulus, for Yeoh's solid 6 C₁.  Arguments and
    errors as `energy`.

    Examples
    --------
    >>> from bayesdeg.material.hyperelastic import Yeoh
    >>> round(float(tangent(Yeoh(0.3, -0.01, 0.002), 1.0, mode="uniaxial")), 12)
    1.8
    """
    return law.along(stretch, mode).curvature / loaded_axes(mode)


def yeoh_basis(stretch: npt.ArrayLike, mode: Modes, measure: Measures = "nominal") -> FloatArray:
    r"""Return the design matrix in which Yeoh's stress is linear.

    .. math:: \text{stress} = \sum_i B_i C_i, \qquad
        B_i = \frac{i (I_1 - 3)^{i-1}}{n} \frac{dI_1}{d\lambda} \;[\times \lambda]

    Parameters
    ----------
    stretch : array_like
        Stretch along the load [–], above 0.
    mode : str or array_like of str
        ``uniaxial``, ``equibiaxial`` or ``planar``; one for all or one for each stretch.
    measure : str or array_like of str
        ``nominal`` or ``cauchy``; one for all or one for each stretch.

    Returns
    -------
    ndarray, shape (..., 3)
        ``basis @ (C1, C2, C3)`` is the stress [MPa].

    Raises
    ------
    ValueError
        If a mode or measure is unknown or a stretch is not above 0.

    Examples
    --------
    >>> yeoh_basis(2.0, "uniaxial", "nominal")
    array([ 3.5, 14. , 42. ])
    """
    i1 = power_sum(stretch, mode, 2.0)
    first = measure_factor(stretch, measure) * i1.slope / loaded_axes(mode)
    x = i1.value
    return np.stack([first, 2.0 * x * first, 3.0 * np.square(x) * first], axis=-1)


def yeoh_tangent_basis(stretch: npt.ArrayLike, mode: Modes) -> FloatArray:
    """Return the slope of the nominal `yeoh_basis` by the stretch, shape (..., 3).

    Arguments and errors as `yeoh_basis`.

    Examples
    --------
    >>> yeoh_tangent_basis(1.0, "uniaxial")
    array([6., 0., 0.])
    """
    i1 = power_sum(stretch, mode, 2.0)
    x, square = i1.value, np.square(i1.slope)
    terms = [
        i1.curvature,
        2.0 * square + 2.0 * x * i1.curvature,
        6.0 * x * square + 3.0 * np.square(x) * i1.curvature,
    ]
    return np.stack(terms, axis=-1) / loaded_axes(mode)[..., np.newaxis]


def root_second_invariant_basis(
    stretch: npt.ArrayLike, mode: Modes, measure: Measures = "nominal"
) -> FloatArray:
    """Return the stress of unit C_s (√I₂ − √3), the further column beside `yeoh_basis`.

    Arguments and errors as `yeoh_basis`; the shape is that of the arguments, broadcast.

    Examples
    --------
    >>> round(float(root_second_invariant_basis(2.0, "equibiaxial")), 4)
    1.9387
    """
    slope = root_second_invariant(stretch, mode).slope / loaded_axes(mode)
    return measure_factor(stretch, measure) * slope
