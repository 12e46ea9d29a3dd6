"""Masses of films → volume ratio α and linear scale: Eqs 11, 16, 17 of the source.

Source: doi:10.3389/frobt.2021.760485. Eqs 10–11 define α as conditioned over cured volume
(V_2/V_1), the text speaks of "before and after curing" and Eq. 17 of V/V_0, so conditioned over
poured volume is offered too.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.measure.mixture import (
    Mixture,
    Recipe,
    component_masses,
    density_by_mass_average,
    film_volume,
    volume_of_parts,
)

Floats = npt.NDArray[np.float64]
Masses = tuple[Floats, Floats, Floats]

SMALL = 1e-4
"""Step of derivatives, as a share of the value: its error is a part in 1e8."""


def volume_ratio(
    mass_poured: npt.ArrayLike,
    mass_cured: npt.ArrayLike,
    mass_conditioned: npt.ArrayLike,
    mixture: Mixture | None = None,
) -> Floats:
    r"""Compute the volume ratio of conditioned to cured film, Eqs 11 and 17.

    .. math:: \alpha = V_2/V_1 = 1 + \beta, \quad \beta = \frac{m_2 - m_1}{\rho_w V_1}

    with the exact V_1 of `film_volume`.

    Parameters
    ----------
    mass_poured, mass_cured, mass_conditioned : array_like, broadcastable
        m_0, m_1, m_2 [g].
    mixture : Mixture, optional
        Default 2 : 1 : 8.

    Returns
    -------
    numpy.ndarray
        α [–]

    Examples
    --------
    1 − 5/13.0231:

    >>> round(float(volume_ratio(30.0, 15.0, 10.0)), 4)
    0.6161
    """
    conditioned = film_volume(mass_poured, mass_conditioned, mixture)
    return conditioned / film_volume(mass_poured, mass_cured, mixture)


def volume_ratio_by_mass_average(
    mass_poured: npt.ArrayLike,
    mass_cured: npt.ArrayLike,
    mass_conditioned: npt.ArrayLike,
    mixture: Mixture | None = None,
) -> Floats:
    r"""Compute the volume ratio as the source does, Eqs 15–17.

    .. math:: \alpha = 1 + \frac{m_2 - m_1}{\rho_w} \frac{\rho_1}{m_1}

    with the density of `density_by_mass_average`.

    Parameters
    ----------
    mass_poured, mass_cured, mass_conditioned : array_like, broadcastable
        m_0, m_1, m_2 [g].
    mixture : Mixture, optional
        Default 2 : 1 : 8.

    Returns
    -------
    numpy.ndarray
        α [–]

    Examples
    --------
    1 − 5 × 1.1745/15, which is 1.2 % below the exact 0.6161:

    >>> round(float(volume_ratio_by_mass_average(30.0, 15.0, 10.0)), 4)
    0.6085
    """
    mixture = mixture or Mixture()
    component_masses(mass_poured, mass_conditioned, mixture)
    cured, conditioned = np.asarray(mass_cured, float), np.asarray(mass_conditioned, float)
    volume = cured / density_by_mass_average(mass_poured, cured, mixture)
    return np.asarray(1.0 + (conditioned - cured) / (mixture.water_density * volume), float)


def volume_ratio_to_mould(
    mass_poured: npt.ArrayLike, mass_conditioned: npt.ArrayLike, mixture: Mixture | None = None
) -> Floats:
    r"""Compute the volume ratio of conditioned film to what was poured, V_2/V_0.

    Parameters
    ----------
    mass_poured, mass_conditioned : array_like, broadcastable
        m_0 and m_2 [g].
    mixture : Mixture, optional
        Default 2 : 1 : 8.

    Returns
    -------
    numpy.ndarray
        [–]

    Examples
    --------
    8.0231/28.0231:

    >>> round(float(volume_ratio_to_mould(30.0, 10.0)), 4)
    0.2863
    """
    conditioned = film_volume(mass_poured, mass_conditioned, mixture)
    return conditioned / film_volume(mass_poured, mass_poured, mixture)


@dataclass(frozen=True)
class Mean:
    """The mean of replicates.

    Parameters
    ----------
    value : float
        Mean.
    standard_error : float
        Of the mean; nan for a single replicate.
    sd : float
        Standard deviation of a single replicate; nan for a single replicate.
    count : int
        Number of replicates.
    """

    value: float
    standard_error: float
    sd: float
    count: int


def mean_of_replicates(values: npt.ArrayLike) -> Mean:
    """Average replicate films.

    Parameters
    ----------
    values : array_like, shape (n,)
        One value a film, at least one film.

    Returns
    -------
    Mean

    Raises
    ------
    ValueError
        If there is no value.

    Examples
    --------
    >>> mean = mean_of_replicates([0.55, 0.62, 0.69])
    >>> round(mean.value, 4), round(mean.sd, 4), round(mean.standard_error, 4)
    (0.62, 0.07, 0.0404)
    """
    films = np.asarray(values, float).ravel()
    if films.size == 0:
        raise ValueError("there is no film to average")
    sd = float(np.std(films, ddof=1)) if films.size > 1 else float("nan")
    return Mean(float(np.mean(films)), sd / float(np.sqrt(films.size)), sd, films.size)


def recipe_error(masses: Masses, recipe: Recipe) -> float:
    r"""Compute the standard error of the films' mean α that comes from their recipe.

    .. math:: \sigma^2 = \sum_k \left(\frac{\partial \bar\alpha}{\partial x_k} \sigma_k\right)^2

    over its parts and densities x. All films share the recipe, so this error does not fall with
    their number; it adds in squares to the standard error of the mean.

    Parameters
    ----------
    masses : tuple of numpy.ndarray
        m_0, m_1, m_2 of each film [g].
    recipe : Recipe
        Its values and their standard uncertainties.

    Returns
    -------
    float
        [–]

    Examples
    --------
    A density of gelatin known to ± 0.05 g/cm³ moves V_1 = 13.0231 cm³ by 5.4545 × 0.05/1.35²:

    >>> from bayesdeg.measure.mixture import Known
    >>> films = (np.array([30.0]), np.array([15.0]), np.array([10.0]))
    >>> round(recipe_error(films, Recipe(gelatin_density=Known(1.35, 0.05))), 4)
    0.0044
    """
    terms = [
        _slope(masses, recipe.mixture, entry.name) * known.sd
        for entry in fields(recipe)
        if (known := getattr(recipe, entry.name)).sd > 0.0
    ]
    return math.hypot(*terms)


def _slope(masses: Masses, mixture: Mixture, name: str) -> float:
    """Return the derivative of the mean α by a part or a density."""
    value: float = getattr(mixture, name)
    step = SMALL * value
    poured, cured, conditioned = masses
    up, down = (
        np.mean(volume_of_parts(poured, conditioned, m) / volume_of_parts(poured, cured, m))
        for m in (replace(mixture, **{name: value + change}) for change in (step, -step))
    )
    return float(up - down) / (2.0 * step)


def film_masses(table: pd.DataFrame) -> Masses:
    """Return m_0, m_1, m_2 of each film of ``shrinkage.csv`` [g]."""
    poured, cured, conditioned = (
        table[f"mass_{state}_g"].to_numpy(np.float64)
        for state in ("poured", "cured", "conditioned")
    )
    return poured, cured, conditioned


def mean_over_films(masses: Masses, recipe: Recipe) -> tuple[Mean, float]:
    """Average α over films, with the errors that they do not share and that of their recipe.

    Parameters
    ----------
    masses : tuple of numpy.ndarray
        m_0, m_1, m_2 of each film [g].
    recipe : Recipe
        Of all of them.

    Returns
    -------
    mean : Mean
        Its standard error has both.
    dof : float
        Degrees of freedom of that standard error: n − 1 of the scatter, which is estimated, and
        more the larger the share of the recipe's error, which is stated (Welch and Satterthwaite).

    Examples
    --------
    >>> films = (np.full(2, 30.0), np.array([15.0, 16.0]), np.array([10.0, 10.5]))
    >>> mean_over_films(films, Recipe())[1]
    1.0
    """
    mean = mean_of_replicates(volume_ratio(*masses, recipe.mixture))
    common = recipe_error(masses, recipe)
    if not common > 0.0:
        return mean, mean.count - 1.0
    total = math.hypot(mean.standard_error, common)
    scatter = mean.standard_error / total
    dof = (mean.count - 1.0) / scatter**4 if scatter > 0.0 else math.inf
    return replace(mean, standard_error=total), dof


def linear_scale(volume_ratio: npt.ArrayLike) -> Floats:
    """Compute the length of the part over that of the mould, s = α^(1/3), for equal shrinkage.

    Parameters
    ----------
    volume_ratio : array_like
        α, above 0 [–].

    Returns
    -------
    numpy.ndarray
        s [–]

    Examples
    --------
    >>> round(float(linear_scale(0.62)), 3)
    0.853
    """
    return np.asarray(np.cbrt(np.asarray(volume_ratio, float)), float)


def linear_scale_error(volume_ratio: npt.ArrayLike, error: npt.ArrayLike) -> Floats:
    r"""Carry the standard error of the volume ratio over to the linear scale, by the delta method.

    .. math:: \sigma_s = \sigma_\alpha / (3 \alpha^{2/3})

    Parameters
    ----------
    volume_ratio, error : array_like, broadcastable
        α and its standard error [–].

    Returns
    -------
    numpy.ndarray
        σ_s [–]

    Examples
    --------
    0.07/(3 × 0.62^(2/3)):

    >>> round(float(linear_scale_error(0.62, 0.07)), 4)
    0.0321
    """
    return np.asarray(error, float) / (3.0 * linear_scale(volume_ratio) ** 2)
