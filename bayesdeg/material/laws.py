r"""Five hyperelastic laws in comparable coordinates: stresses and slopes, vectorised.

Each law has coordinates u that are standard normal a priori, so that no law gets more freedom than
the others.  Two scales of the films make them dimensionless: G₀, the shear modulus of a neo-Hookean
fit, and X, the largest I₁ − 3 reached.  With
ξ = (I₁ − 3)/X and P the nominal stress of n loaded axes,

.. math::
    \begin{aligned}
    \text{all} &: & G &= G_0 e^{1.5 u_1} \\
    \text{neo-Hookean} &: & nP &= \tfrac{G}{2} I_1' \\
    \text{Yeoh} &: & nP &= \tfrac{G}{2} I_1' (1 + 2 u_2 \xi + 3 u_3 \xi^2) \\
    \text{Mooney–Rivlin} &: & nP &= \tfrac{G}{2} \left((1 - u_2) I_1' + u_2 I_2'\right) \\
    \text{Gent} &: & nP &= \tfrac{G}{2} I_1' \left(1 - (I_1 - 3)/J_m\right)^{-1},
        \quad J_m = X (1 + e^{1 + 1.5 u_2}) \\
    \text{Ogden} &: & nP &= \sum_{k=1}^3 \frac{2 G_k}{\alpha_k}
        \sum_i e_i \lambda^{e_i \alpha_k - 1}
    \end{aligned}

where a prime is the derivative with respect to stretch and :math:`\lambda^{e_i}` are the principal
stretches of the mode.  The terms of Ogden's law are a nearly neo-Hookean one, one that stiffens
at large stretch and one that acts like I₂: G₁ = G, G₂ = G₀ exp(−4 + 2 u₂), G₃ = G₀ exp(−4 + 2 u₃),
α₁ = 1.5 + 0.75 u₄, α₂ = 5 + 2 u₅ and α₃ = −2 + 0.75 u₆.

References
----------
Steinmann, Hossain, Possart (2012), Arch. Appl. Mech. 82, 1183; doi:10.1007/s00419-012-0610-z
(laws for rubber, compared on Treloar's data).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bayesdeg.data.settings import MaterialLaw
from bayesdeg.material.hyperelastic import (
    EXPONENTS,
    FloatArray,
    Gent,
    HyperelasticLaw,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    loaded_axes,
    measure_factor,
    power_sum,
)

SPREAD = 1.5
"""Prior standard deviation of ln G about ln G₀, and of other logarithms."""
TERMS = (0.0, SPREAD), (-4.0, 2.0), (-4.0, 2.0)
"""Medians and standard deviations of ln(G_k/G₀) of Ogden's terms; two of them add about 2 %."""
POWERS = (1.5, 0.75), (5.0, 2.0), (-2.0, 0.75)
"""The same of their powers α_k; for rubber 1.3, 5 and −2, doi:10.1098/rspa.1972.0026."""
SMALLEST_POWER = 1e-4
"""Smallest magnitude of an Ogden power; smaller ones are replaced by it, near the limit of 0."""


class StressBasis(NamedTuple):
    """Law-independent part of the stresses of tests; the last axis is the readings.

    Parameters
    ----------
    excess : array, shape (..., n_points)
        I₁ − 3 over the level's largest, ξ [–].
    first, second : array, shape (..., n_points)
        Stress of unit ∂W/∂I₁ and ∂W/∂I₂, in the recorded measure.
    log_stretch, share : array, shape (..., n_points)
        ln λ, and the measure's factor over n λ.
    exponents : array, shape (..., 1, 3)
        Of the principal stretches.
    """

    excess: FloatArray
    first: FloatArray
    second: FloatArray
    log_stretch: FloatArray
    share: FloatArray
    exponents: FloatArray

    def of(self, rows: npt.NDArray[np.intp]) -> "StressBasis":
        """Return selected tests, with repetition."""
        return StressBasis(*(part[rows] for part in self))


def film_tests(
    stretch: FloatArray,
    modes: npt.ArrayLike,
    largest: FloatArray,
    *,
    cauchy: npt.NDArray[np.bool_] | None = None,
) -> StressBasis:
    """Return the law-independent part of the stresses of tests.

    Parameters
    ----------
    stretch : array, shape (n_films, n_points)
        Stretch along the load [–].
    modes : array of str, shape (n_films,)
        Mode of loading of each film.
    largest : array, shape (n_films,)
        The scale X of each film: the largest I₁ − 3 of its level [–].
    cauchy : array of bool, shape (n_films, n_points), optional
        Where Cauchy stress was recorded; default: nowhere.

    Examples
    --------
    >>> tests = film_tests(np.array([[2.0]]), ["uniaxial"], np.array([4.0]))
    >>> tests.excess.tolist(), tests.first.tolist()
    ([[0.5]], [[3.5]])
    """
    names = np.asarray(modes, dtype=object)[:, None]
    measure = np.where(np.zeros(stretch.shape, bool) if cauchy is None else cauchy,
                       "cauchy", "nominal")  # fmt: skip
    factor = measure_factor(stretch, measure) / loaded_axes(names)
    i1, i2 = power_sum(stretch, names, 2.0), power_sum(stretch, names, -2.0)
    return StressBasis(
        i1.value / np.asarray(largest)[:, None],
        factor * i1.slope,
        factor * i2.slope,
        np.log(stretch),
        factor / stretch,
        np.array([EXPONENTS[str(name)] for name in names[:, 0]])[:, None, :],
    )


def largest_excess(
    stretch: FloatArray, modes: npt.ArrayLike, mask: npt.NDArray[np.bool_]
) -> FloatArray:
    """Return the largest I₁ − 3 of each film [–], (n_films,).

    Examples
    --------
    >>> largest_excess(np.array([[1.5, 2.0, 9.0]]), ["uniaxial"], np.array([[True, True, False]]))
    array([2.])
    """
    i1 = power_sum(stretch, np.asarray(modes, dtype=object)[:, None], 2.0).value
    return np.asarray(np.where(mask, i1, 0.0).max(axis=-1), dtype=np.float64)


type Response = tuple[FloatArray, FloatArray]
"""Stresses over G₀, (..., n_points), and their derivatives by u, (..., n_points, n_coordinates)."""


@dataclass(frozen=True)
class LawForm:
    """A law in coordinates that are standard normal a priori.

    Parameters
    ----------
    name : str
        One of `bayesdeg.data.settings.MATERIAL_LAWS`.
    size : int
        Number of its constants.
    response : callable
        Maps coordinates (..., size) and tests to a `Response`.
    constants : callable
        Maps coordinates (size,), G₀ [MPa] and X [–] to named constants with units.
    solid : callable
        Maps these constants to the law itself.
    starts : tuple of tuple of float
        Starting points of the fit; the best result is kept.
    """

    name: MaterialLaw
    size: int
    response: Callable[[FloatArray, StressBasis], Response]
    constants: Callable[[FloatArray, float, float], dict[str, float]]
    solid: Callable[[Mapping[str, float]], HyperelasticLaw]
    starts: tuple[tuple[float, ...], ...] = ()

    @property
    def all_starts(self) -> tuple[tuple[float, ...], ...]:
        """Starting points of fits; by default the medians."""
        return self.starts or ((0.0,) * self.size,)


def _modulus(u: FloatArray) -> FloatArray:
    """Return half of G/G₀, with a trailing axis for readings."""
    half: FloatArray = 0.5 * np.exp(SPREAD * u[..., :1])
    return half


def _with_modulus(stress: FloatArray, *slopes: FloatArray) -> Response:
    """Return the response of a law whose stress is proportional to G."""
    return stress, np.stack([SPREAD * stress, *slopes], axis=-1)


def _neo_hookean(u: FloatArray, tests: StressBasis) -> Response:
    return _with_modulus(_modulus(u) * tests.first)


def _yeoh(u: FloatArray, tests: StressBasis) -> Response:
    base, x = _modulus(u) * tests.first, tests.excess
    second, third = 2.0 * x, 3.0 * x * x
    stress = base * (1.0 + u[..., 1:2] * second + u[..., 2:3] * third)
    return _with_modulus(stress, base * second, base * third)


def _mooney_rivlin(u: FloatArray, tests: StressBasis) -> Response:
    half, change = _modulus(u), tests.second - tests.first
    return _with_modulus(half * (tests.first + u[..., 1:2] * change), half * change)


def _gent(u: FloatArray, tests: StressBasis) -> Response:
    beyond = np.exp(1.0 + SPREAD * u[..., 1:2])  # J_m = X (1 + beyond)
    left = 1.0 - tests.excess / (1.0 + beyond)
    stress = _modulus(u) * tests.first / left
    slope = -stress / left * tests.excess * SPREAD * beyond / np.square(1.0 + beyond)
    return _with_modulus(stress, slope)


def _ogden(u: FloatArray, tests: StressBasis) -> Response:
    stress, slopes = np.zeros(tests.share.shape), list[tuple[FloatArray, FloatArray]]()
    for k, (centre, spread) in enumerate(POWERS):
        term, by_power = _power_term(centre + spread * u[..., 3 + k : 4 + k], tests)
        modulus, width = TERMS[k]
        g = np.exp(modulus + width * u[..., k : k + 1])
        stress = stress + g * term
        slopes.append((width * g * term, spread * g * by_power))
    by_moduli, by_powers = zip(*slopes, strict=True)
    return stress, np.stack([*by_moduli, *by_powers], axis=-1)


def _power_term(power: FloatArray, tests: StressBasis) -> Response:
    r"""Return an Ogden term of unit shear modulus, and its derivative by α.

    With :math:`S = \sum_i e_i \lambda^{\alpha e_i}`, stress = (2/α) S × share.  As the exponents
    sum to zero, S is a sum of expm1, which stays accurate as α goes to 0.
    """
    alpha = np.where(np.abs(power) < SMALLEST_POWER, SMALLEST_POWER, power)
    sums, by_power = np.zeros(tests.share.shape), np.zeros(tests.share.shape)
    for k in range(3):  # summing over a last axis of three dominates the cost
        e = tests.exponents[..., k]
        grown = np.expm1(alpha * e * tests.log_stretch)
        sums += e * grown
        by_power += e * e * (1.0 + grown)
    share = 2.0 * tests.share / alpha
    stress = share * sums
    return stress, share * by_power * tests.log_stretch - stress / alpha


def _neo_hookean_constants(u: FloatArray, scale: float, _largest: float) -> dict[str, float]:
    return {"c1_MPa": 0.5 * scale * float(np.exp(SPREAD * u[0]))}


def _yeoh_constants(u: FloatArray, scale: float, largest: float) -> dict[str, float]:
    c1 = 0.5 * scale * float(np.exp(SPREAD * u[0]))
    c2, c3 = c1 * float(u[1]) / largest, c1 * float(u[2]) / largest**2
    return {"c1_MPa": c1, "c2_MPa": c2, "c3_MPa": c3}


def _mooney_rivlin_constants(u: FloatArray, scale: float, _largest: float) -> dict[str, float]:
    both = 0.5 * scale * float(np.exp(SPREAD * u[0]))
    return {"c1_MPa": both * (1.0 - float(u[1])), "c01_MPa": both * float(u[1])}


def _gent_constants(u: FloatArray, scale: float, largest: float) -> dict[str, float]:
    limit = largest * (1.0 + float(np.exp(1.0 + SPREAD * u[1])))
    return {"mu_MPa": scale * float(np.exp(SPREAD * u[0])), "j_m": limit}


def _ogden_constants(u: FloatArray, scale: float, _largest: float) -> dict[str, float]:
    found = {}
    for k, ((centre, spread), (modulus, width)) in enumerate(zip(POWERS, TERMS, strict=True)):
        power = centre + spread * float(u[3 + k])
        found[f"mu_{k + 1}_MPa"] = 2.0 * scale * float(np.exp(modulus + width * u[k])) / power
        found[f"alpha_{k + 1}"] = power
    return found


FORMS: Mapping[str, LawForm] = {
    form.name: form
    for form in (
        LawForm(
            "yeoh",
            3,
            _yeoh,
            _yeoh_constants,
            lambda c: Yeoh(c["c1_MPa"], c["c2_MPa"], c["c3_MPa"]),
        ),
        LawForm(
            "neo_hookean", 1, _neo_hookean, _neo_hookean_constants,
            lambda c: NeoHookean(c["c1_MPa"]),
        ),
        LawForm(
            "mooney_rivlin", 2, _mooney_rivlin, _mooney_rivlin_constants,
            lambda c: MooneyRivlin(c["c1_MPa"], c["c01_MPa"]),
        ),
        LawForm("gent", 2, _gent, _gent_constants, lambda c: Gent(c["mu_MPa"], c["j_m"])),
        LawForm(
            "ogden",
            6,
            _ogden,
            _ogden_constants,
            lambda c: Ogden(
                [c[f"mu_{k}_MPa"] for k in (1, 2, 3)], [c[f"alpha_{k}"] for k in (1, 2, 3)]
            ),
            # softer at small strain than a neo-Hookean solid, as the second is
            ((0.0,) * 6, (0.0, -1.0, 0.0, -0.5, 0.0, 0.0)),
        ),
    )
}  # fmt: skip
"""All laws by name, the actuator model's first."""

CONSTANTS = (
    *("c1_MPa", "c2_MPa", "c3_MPa", "c01_MPa", "mu_MPa", "j_m"),
    *("mu_1_MPa", "alpha_1", "mu_2_MPa", "alpha_2", "mu_3_MPa", "alpha_3"),
)
"""Names of the constants of all laws, with their units."""
