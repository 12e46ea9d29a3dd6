r"""Incompressible hyperelastic laws: stress and tangent in homogeneous tests of each mode.

Every mode has the principal stretches :math:`\lambda^{e_1}, \lambda^{e_2}, \lambda^{e_3}` with
constant exponents that sum to zero, so every sum of powers of them, hence every invariant, is a
function of a single stretch :math:`\lambda`.

Constants may be arrays: they broadcast against the stretch.  All energies are per undeformed
volume [MPa = mJ/mm³].
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

type FloatArray = npt.NDArray[np.float64]
type Modes = str | npt.ArrayLike
type Measures = str | npt.ArrayLike

EXPONENTS: dict[str, tuple[float, float, float]] = {
    "uniaxial": (1.0, -0.5, -0.5),
    "equibiaxial": (1.0, 1.0, -2.0),
    "planar": (1.0, 0.0, -1.0),
}
LOADED_AXES: dict[str, float] = {"uniaxial": 1.0, "equibiaxial": 2.0, "planar": 1.0}
MEASURES = ("nominal", "cauchy")


class ModePath(NamedTuple):
    """A scalar along a mode: its value and first two derivatives with respect to the stretch."""

    value: FloatArray
    slope: FloatArray
    curvature: FloatArray


def power_sum(stretch: npt.ArrayLike, mode: Modes, power: npt.ArrayLike) -> ModePath:
    r"""Return the sum of powers of the principal stretches minus 3, along a mode.

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
    ModePath
        S_p and its derivatives with respect to the stretch, in the common shape of the arguments.

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
    return ModePath(
        excess.sum(axis=-1),
        slope.sum(axis=-1) / stretch,
        (slope * (exponents - 1.0)).sum(axis=-1) / np.square(stretch),
    )


def root_second_invariant(stretch: npt.ArrayLike, mode: Modes) -> ModePath:
    r"""Return :math:`\sqrt{I_2} - \sqrt 3` along a mode with its stretch derivatives.

    Parameters
    ----------
    stretch : array_like
        Stretch along the load [–], above 0.
    mode : str or array_like of str
        See `power_sum`.

    Returns
    -------
    ModePath

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


def chain(
    inner: ModePath, *, energy: FloatArray, first: FloatArray, second: FloatArray
) -> ModePath:
    """Apply the chain rule: the path of an energy, given its derivatives by the inner scalar."""
    slope = first * inner.slope
    return ModePath(energy, slope, second * np.square(inner.slope) + first * inner.curvature)


def loaded_axes(mode: Modes) -> FloatArray:
    """Return the number of axes on which the mode's load imposes the stretch.

    The nominal stress on each of them is dW/dλ divided by this.

    Examples
    --------
    >>> float(loaded_axes("equibiaxial"))
    2.0
    """
    return _lookup(LOADED_AXES, mode)


def measure_factor(stretch: npt.ArrayLike, measure: Measures) -> FloatArray:
    """Return the factor on the nominal stress: 1, or the stretch for Cauchy stress.

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


class HyperelasticLaw(Protocol):
    """A strain-energy function of an incompressible isotropic solid."""

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus at zero strain [MPa]; Young's modulus is three times it."""
        ...

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy [MPa] along a mode with its stretch derivatives."""
        ...


@dataclass(frozen=True)
class NeoHookean:
    r"""Neo-Hookean solid, :math:`W = C_1 (I_1 - 3)`.

    Parameters
    ----------
    c1 : array_like
        C₁ [MPa].
    """

    c1: npt.ArrayLike

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus 2 C₁ [MPa]."""
        return 2.0 * np.asarray(self.c1, dtype=np.float64)

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy along a mode."""
        c1 = np.asarray(self.c1, dtype=np.float64)
        x = power_sum(stretch, mode, 2.0)
        return ModePath(c1 * x.value, c1 * x.slope, c1 * x.curvature)


@dataclass(frozen=True)
class Yeoh:
    r"""Yeoh solid, :math:`W = \sum_{i=1}^{3} C_i (I_1 - 3)^i`.

    Parameters
    ----------
    c1, c2, c3 : array_like
        Constants [MPa]; C₂ is often negative.

    References
    ----------
    Yeoh (1993), Rubber Chem. Technol. 66, 754; doi:10.5254/1.3538343.
    """

    c1: npt.ArrayLike
    c2: npt.ArrayLike
    c3: npt.ArrayLike

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus 2 C₁ [MPa]."""
        return 2.0 * np.asarray(self.c1, dtype=np.float64)

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy along a mode."""
        c1, c2, c3 = (np.asarray(c, dtype=np.float64) for c in (self.c1, self.c2, self.c3))
        i1 = power_sum(stretch, mode, 2.0)
        x = i1.value
        return chain(
            i1,
            energy=x * (c1 + x * (c2 + x * c3)),
            first=c1 + x * (2.0 * c2 + 3.0 * c3 * x),
            second=2.0 * c2 + 6.0 * c3 * x,
        )


@dataclass(frozen=True)
class YeohRootSecondInvariant:
    r"""Yeoh solid with a term in the second invariant.

    .. math:: W = \sum_{i=1}^{3} C_i (I_1 - 3)^i + C_s (\sqrt{I_2} - \sqrt 3)

    A term in I₂ itself grows with the fourth power of an equibiaxial stretch; its root grows with
    the second, as I₁ does, and so extrapolates safely to other modes.

    Parameters
    ----------
    c1, c2, c3, c_s : array_like
        Constants [MPa].

    References
    ----------
    Carroll (2011), J. Elast. 103, 173 (the root of I₂); doi:10.1007/s10659-010-9279-0.
    """

    c1: npt.ArrayLike
    c2: npt.ArrayLike
    c3: npt.ArrayLike
    c_s: npt.ArrayLike

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus 2 C₁ + C_s / √3 [MPa]."""
        return np.asarray(Yeoh(self.c1, self.c2, self.c3).shear_modulus) + np.asarray(
            self.c_s
        ) / math.sqrt(3.0)

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy along a mode."""
        yeoh = Yeoh(self.c1, self.c2, self.c3).along(stretch, mode)
        root = root_second_invariant(stretch, mode)
        c_s = np.asarray(self.c_s, dtype=np.float64)
        return ModePath(*(term + c_s * extra for term, extra in zip(yeoh, root, strict=True)))


@dataclass(frozen=True)
class MooneyRivlin:
    r"""Mooney–Rivlin solid, :math:`W = C_{10} (I_1 - 3) + C_{01} (I_2 - 3)`.

    Parameters
    ----------
    c10, c01 : array_like
        Constants [MPa].

    References
    ----------
    Mooney (1940), J. Appl. Phys. 11, 582; doi:10.1063/1.1712836.
    """

    c10: npt.ArrayLike
    c01: npt.ArrayLike

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus 2 (C₁₀ + C₀₁) [MPa]."""
        both = np.asarray(self.c10, dtype=np.float64) + np.asarray(self.c01, dtype=np.float64)
        return np.asarray(2.0 * both, dtype=np.float64)

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy along a mode."""
        c10, c01 = (np.asarray(c, dtype=np.float64) for c in (self.c10, self.c01))
        i1, i2 = power_sum(stretch, mode, 2.0), power_sum(stretch, mode, -2.0)
        return ModePath(*(c10 * first + c01 * second for first, second in zip(i1, i2, strict=True)))


@dataclass(frozen=True)
class Gent:
    r"""Gent solid of limited extensibility.

    .. math:: W = -\tfrac12 \mu J_m \ln\!\left(1 - \frac{I_1 - 3}{J_m}\right)

    Energy, stress and tangent are infinite for I₁ − 3 ≥ J_m.

    Parameters
    ----------
    mu : array_like
        Shear modulus μ [MPa].
    j_m : array_like
        Limit J_m of I₁ − 3 [–].

    References
    ----------
    Gent (1996), Rubber Chem. Technol. 69, 59; doi:10.5254/1.3538357.
    """

    mu: npt.ArrayLike
    j_m: npt.ArrayLike

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus μ [MPa]."""
        return np.asarray(self.mu, dtype=np.float64)

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy along a mode."""
        mu, j_m = np.asarray(self.mu, dtype=np.float64), np.asarray(self.j_m, dtype=np.float64)
        i1 = power_sum(stretch, mode, 2.0)
        within = i1.value < j_m
        share = np.where(within, i1.value / j_m, 0.0)
        first = 0.5 * mu / (1.0 - share)
        path = chain(
            i1,
            energy=-0.5 * mu * j_m * np.log1p(-share),
            first=first,
            second=first / (j_m * (1.0 - share)),
        )
        return ModePath(
            np.where(within, path.value, np.inf),
            np.where(within, path.slope, np.copysign(np.inf, i1.slope)),
            np.where(within, path.curvature, np.inf),
        )


@dataclass(frozen=True)
class Ogden:
    r"""Ogden solid.

    .. math:: W = \sum_k \frac{\mu_k}{\alpha_k}
        (\lambda_1^{\alpha_k} + \lambda_2^{\alpha_k} + \lambda_3^{\alpha_k} - 3)

    Parameters
    ----------
    mu, alpha : array_like, shape (..., n_terms)
        Constants μ_k [MPa] and exponents α_k [–], none of which is 0.

    References
    ----------
    Ogden (1972), Proc. R. Soc. A 326, 565; doi:10.1098/rspa.1972.0026.
    """

    mu: npt.ArrayLike
    alpha: npt.ArrayLike

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus Σ μ_k α_k / 2 [MPa]."""
        product = np.asarray(self.mu, dtype=np.float64) * np.asarray(self.alpha, dtype=np.float64)
        return np.asarray(0.5 * product.sum(axis=-1), dtype=np.float64)

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> ModePath:
        """Return the energy along a mode."""
        mu, alpha = np.broadcast_arrays(
            np.atleast_1d(np.asarray(self.mu, dtype=np.float64)),
            np.atleast_1d(np.asarray(self.alpha, dtype=np.float64)),
        )
        terms = [power_sum(stretch, mode, alpha[..., k]) for k in range(alpha.shape[-1])]
        weights = [mu[..., k] / alpha[..., k] for k in range(alpha.shape[-1])]
        sums = (
            np.sum([w * term[part] for w, term in zip(weights, terms, strict=True)], axis=0)
            for part in range(3)
        )
        return ModePath(*sums)


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
    >>> float(energy(NeoHookean(0.3), 2.0, mode="uniaxial"))
    0.6
    """
    return law.along(stretch, mode).value


def nominal_stress(law: HyperelasticLaw, stretch: npt.ArrayLike, *, mode: Modes) -> FloatArray:
    r"""Return the nominal stress on the loaded axes: force over undeformed area [MPa].

    .. math:: P = \frac{1}{n} \frac{dw}{d\lambda}

    where w(λ) is the energy along the mode and n the number of axes that carry the load, so that
    the hydrostatic pressure is eliminated by the stress-free faces.  Arguments and errors
    as `energy`.

    Examples
    --------
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
    >>> float(cauchy_stress(NeoHookean(0.3), 2.0, mode="uniaxial"))
    2.1
    """
    return np.asarray(stretch, dtype=np.float64) * nominal_stress(law, stretch, mode=mode)


def tangent(law: HyperelasticLaw, stretch: npt.ArrayLike, *, mode: Modes) -> FloatArray:
    """Return the derivative of the nominal stress with respect to the stretch [MPa].

    At stretch 1 in uniaxial tension it is Young's modulus, for Yeoh's solid 6 C₁.  Arguments and
    errors as `energy`.

    Examples
    --------
    >>> round(float(tangent(Yeoh(0.3, -0.01, 0.002), 1.0, mode="uniaxial")), 12)
    1.8
    """
    return law.along(stretch, mode).curvature / loaded_axes(mode)


def yeoh_basis(stretch: npt.ArrayLike, mode: Modes, measure: Measures = "nominal") -> FloatArray:
    r"""Return the design matrix of Yeoh's stress, which is linear in its constants.

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


def root_second_invariant_basis(
    stretch: npt.ArrayLike, mode: Modes, measure: Measures = "nominal"
) -> FloatArray:
    """Return the stress of unit C_s (√I₂ − √3), an extra column for `yeoh_basis`.

    Arguments and errors as `yeoh_basis`; the shape is that of the arguments, broadcast.

    Examples
    --------
    >>> round(float(root_second_invariant_basis(2.0, "equibiaxial")), 4)
    1.9387
    """
    slope = root_second_invariant(stretch, mode).slope / loaded_axes(mode)
    return measure_factor(stretch, measure) * slope
