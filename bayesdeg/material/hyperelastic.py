"""Incompressible hyperelastic laws; `stress` has their stress in each mode.

Constants may be arrays: they broadcast against the stretch.  All energies are per undeformed
volume [MPa = mJ/mm³].
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bayesdeg.material.modes import (
    FloatArray,
    Modes,
    Path,
    chain,
    power_sum,
    root_second_invariant,
)


class HyperelasticLaw(Protocol):
    """A strain-energy function of an incompressible isotropic solid."""

    @property
    def shear_modulus(self) -> FloatArray:
        """Shear modulus at zero strain [MPa]; Young's modulus is three times it."""
        ...

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> Path:
        """Return the energy [MPa] along a mode with its derivatives by the stretch."""
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

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> Path:
        """Return the energy along a mode."""
        c1 = np.asarray(self.c1, dtype=np.float64)
        x = power_sum(stretch, mode, 2.0)
        return Path(c1 * x.value, c1 * x.slope, c1 * x.curvature)


@dataclass(frozen=True)
class Yeoh:
    r"""Yeoh's solid, :math:`W = \sum_{i=1}^{3} C_i (I_1 - 3)^i`.

    Parameters
    ----------
    c1, c2, c3 : array_like
        Constants [MPa]; C₂ is often negative, see `stability`.

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

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> Path:
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
    r"""Yeoh's solid with a term in the second invariant.

    .. math:: W = \sum_{i=1}^{3} C_i (I_1 - 3)^i + C_s (\sqrt{I_2} - \sqrt 3)

    A term in I₂ itself grows with the fourth power of an equibiaxial stretch; its root grows with
    the second, as I₁ does, and so extrapolates soberly from one mode to another.

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

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> Path:
        """Return the energy along a mode."""
        yeoh = Yeoh(self.c1, self.c2, self.c3).along(stretch, mode)
        root = root_second_invariant(stretch, mode)
        c_s = np.asarray(self.c_s, dtype=np.float64)
        return Path(*(term + c_s * extra for term, extra in zip(yeoh, root, strict=True)))


@dataclass(frozen=True)
class Gent:
    r"""Gent's solid of limited extensibility.

    .. math:: W = -\tfrac12 \mu J_m \ln\!\left(1 - \frac{I_1 - 3}{J_m}\right)

    Energy, stress and tangent are infinite from I₁ − 3 = J_m on.

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

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> Path:
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
        return Path(
            np.where(within, path.value, np.inf),
            np.where(within, path.slope, np.copysign(np.inf, i1.slope)),
            np.where(within, path.curvature, np.inf),
        )


@dataclass(frozen=True)
class Ogden:
    r"""Ogden's solid.

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

    def along(self, stretch: npt.ArrayLike, mode: Modes) -> Path:
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
        return Path(*sums)
