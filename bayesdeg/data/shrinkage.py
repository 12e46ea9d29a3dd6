"""Masses of films: composition, volume ratio α and linear scale.

Source: doi:10.3389/frobt.2021.760485. Only water is lost; gelatin and glycerol stay. Eqs 10–11
define α as conditioned over cured volume (V_2/V_1), the text says "before and after curing" and
Eq. 17 uses V/V_0.

Masses of a film [g] are m_0 as poured, m_1 as cured and m_2 as conditioned; ``mass`` is that of the
same film in any of these states. They broadcast; the mixture is `USUAL` unless stated.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.data.settings import Mixture, MixtureRecipe

Floats = npt.NDArray[np.float64]
Masses = tuple[Floats, Floats, Floats]

USUAL = Mixture()
"""Gelatin, glycerol and water 2 : 1 : 8."""
SMALL = 1e-4
"""Relative step of derivatives; their error is one part in 1e8."""


def component_masses(
    mass_poured: npt.ArrayLike, mass: npt.ArrayLike, mixture: Mixture = USUAL
) -> tuple[Floats, Floats, Floats]:
    """Compute the masses of gelatin, glycerol and water in a film, Eqs 12–14 [g].

    Raises
    ------
    ValueError
        If a film weighs less than the gelatin and glycerol poured, or more than the poured mass.

    Examples
    --------
    30 g contain 30 × 2/11 g of gelatin and 30 × 1/11 g of glycerol; at 15 g the rest is water.

    >>> [round(float(mass), 4) for mass in component_masses(30.0, 15.0)]
    [5.4545, 2.7273, 6.8182]
    """
    poured, now = np.broadcast_arrays(np.asarray(mass_poured, float), np.asarray(mass, float))
    gelatin, glycerol, water = _parts(poured, now, mixture)
    if np.any(water < 0.0):
        lightest = float(np.min(now / poured))
        raise ValueError(
            f"a film has {lightest:.3g} of its poured mass, but gelatin and glycerol alone are "
            f"{mixture.solids:.3g}; check the masses or the mixture"
        )
    if np.any(now > poured):
        raise ValueError("a film weighs more than its poured mass; check the masses")
    return gelatin, glycerol, water


def film_volume(
    mass_poured: npt.ArrayLike, mass: npt.ArrayLike, mixture: Mixture = USUAL
) -> Floats:
    r"""Compute the volume of a film as the sum of its components, Eqs 7–10 [cm³].

    .. math:: V = m_{Gel}/\rho_{Gel} + m_{Gly}/\rho_{Gly} + m_w/\rho_w

    Examples
    --------
    5.4545/1.35 + 2.7273/1.26 + 6.8182/1.00:

    >>> round(float(film_volume(30.0, 15.0)), 4)
    13.0231
    """
    component_masses(mass_poured, mass, mixture)
    poured, now = np.broadcast_arrays(np.asarray(mass_poured, float), np.asarray(mass, float))
    return volume_of_parts(poured, now, mixture)


def volume_of_parts(poured: Floats, mass: Floats, mixture: Mixture) -> Floats:
    """Return `film_volume` [cm³] without its checks of the masses.

    A fully dry film would fail them for a slightly changed mixture, as error propagation needs.
    """
    gelatin, glycerol, water = _parts(poured, mass, mixture)
    volume: Floats = (
        gelatin / mixture.gelatin_density
        + glycerol / mixture.glycerol_density
        + water / mixture.water_density
    )
    return volume


def _parts(poured: Floats, mass: Floats, mixture: Mixture) -> tuple[Floats, Floats, Floats]:
    gelatin = mixture.gelatin / mixture.total * poured
    glycerol = mixture.glycerol / mixture.total * poured
    return gelatin, glycerol, mass - gelatin - glycerol


def density_by_mass_average(
    mass_poured: npt.ArrayLike, mass: npt.ArrayLike, mixture: Mixture = USUAL
) -> Floats:
    r"""Compute the density of a film by Eq. 15, the mass-weighted mean of densities [g/cm³].

    .. math:: \rho = (m_{Gel}\rho_{Gel} + m_{Gly}\rho_{Gly} + m_w\rho_w) / m

    The correct mass-weighted mean is harmonic, so this is about 2 % too high; it reproduces the
    source.

    Examples
    --------
    (5.4545 × 1.35 + 2.7273 × 1.26 + 6.8182)/15, where the exact value is 15/13.0231 = 1.1518:

    >>> round(float(density_by_mass_average(30.0, 15.0)), 4)
    1.1745
    """
    gelatin, glycerol, water = component_masses(mass_poured, mass, mixture)
    weighted = (
        gelatin * mixture.gelatin_density
        + glycerol * mixture.glycerol_density
        + water * mixture.water_density
    )
    return np.asarray(weighted / np.asarray(mass, float), float)


def volume_ratio(
    mass_poured: npt.ArrayLike,
    mass_cured: npt.ArrayLike,
    mass_conditioned: npt.ArrayLike,
    mixture: Mixture = USUAL,
) -> Floats:
    r"""Compute the volume ratio of conditioned to cured film, Eqs 11 and 17.

    .. math:: \alpha = V_2/V_1 = 1 + \beta, \quad \beta = \frac{m_2 - m_1}{\rho_w V_1}

    with the exact V_1 of `film_volume`.

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
    mixture: Mixture = USUAL,
) -> Floats:
    r"""Compute the volume ratio as the source does, Eqs 15–17.

    .. math:: \alpha = 1 + \frac{m_2 - m_1}{\rho_w} \frac{\rho_1}{m_1}

    with the density of `density_by_mass_average`.

    Examples
    --------
    1 − 5 × 1.1745/15, which is 1.2 % below the exact 0.6161:

    >>> round(float(volume_ratio_by_mass_average(30.0, 15.0, 10.0)), 4)
    0.6085
    """
    component_masses(mass_poured, mass_conditioned, mixture)
    cured, conditioned = np.asarray(mass_cured, float), np.asarray(mass_conditioned, float)
    volume = cured / density_by_mass_average(mass_poured, cured, mixture)
    return np.asarray(1.0 + (conditioned - cured) / (mixture.water_density * volume), float)


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
    """Average replicate films, at least one, with one value each.

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


def recipe_error(masses: Masses, recipe: MixtureRecipe) -> float:
    r"""Compute the standard error of the films' mean α due to their recipe.

    .. math:: \sigma^2 = \sum_k \left(\frac{\partial \bar\alpha}{\partial x_k} \sigma_k\right)^2

    over its parts and densities x. All films share the recipe, so this error does not decrease with
    their number; it adds in squares to the standard error of the mean.

    Examples
    --------
    A density of gelatin known to ± 0.05 g/cm³ moves V_1 = 13.0231 cm³ by 5.4545 × 0.05/1.35²:

    >>> from bayesdeg.data.settings import Known
    >>> films = (np.array([30.0]), np.array([15.0]), np.array([10.0]))
    >>> round(recipe_error(films, MixtureRecipe(gelatin_density=Known(1.35, 0.05))), 4)
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


def mean_over_films(masses: Masses, recipe: MixtureRecipe) -> tuple[Mean, float]:
    """Average α over films, with their independent errors and that of the recipe.

    Returns
    -------
    mean : Mean
        Its standard error includes both.
    dof : float
        Degrees of freedom of that standard error (Welch and Satterthwaite): n − 1 for the
        estimated scatter alone, more the larger the share of the recipe's stated error.

    Examples
    --------
    >>> films = (np.full(2, 30.0), np.array([15.0, 16.0]), np.array([10.0, 10.5]))
    >>> mean_over_films(films, MixtureRecipe())[1]
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


def mean_as_printed(masses: Masses, recipe: MixtureRecipe) -> Mean:
    """Average α over films by Eqs 15–17 as printed, with densities averaged by mass.

    To be shown next to `mean_over_films`, which is used. Its standard error is that of the films
    only, without that of the recipe.

    Examples
    --------
    >>> films = (np.full(2, 30.0), np.full(2, 15.0), np.full(2, 10.0))
    >>> round(mean_as_printed(films, MixtureRecipe()).value, 4)
    0.6085
    """
    return mean_of_replicates(volume_ratio_by_mass_average(*masses, recipe.mixture))


def linear_scale(volume_ratio: npt.ArrayLike) -> Floats:
    """Compute the length of the part over that of the mould, s = α^(1/3), for equal shrinkage.

    Examples
    --------
    >>> round(float(linear_scale(0.62)), 3)
    0.853
    """
    return np.asarray(np.cbrt(np.asarray(volume_ratio, float)), float)
