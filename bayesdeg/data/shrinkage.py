"""Masses of films: what a film is made of, volume ratio α and linear scale.

Source: doi:10.3389/frobt.2021.760485. Only water is lost; gelatin and glycerol stay.

Source: doi:10.3389/frobt.2021.760485. Eqs 10–11 define α as conditioned over cured volume
(V_2/V_1), the text speaks of "before and after curing" and Eq. 17 of V/V_0, so conditioned over
poured volume is offered too.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Mixture:
    """What is poured: parts by mass and densities [g/cm³].

    The densities are assumed, since the source states none: gelatin is found between 1.27 and
    1.44, glycerol at 1.26, water at 1.00.

    Parameters
    ----------
    gelatin, glycerol, water : float
        Parts by mass M_Gel : M_Gly : M_0w.
    gelatin_density, glycerol_density, water_density : float
        [g/cm³]
    """

    gelatin: float = 2.0
    glycerol: float = 1.0
    water: float = 8.0
    gelatin_density: float = 1.35
    glycerol_density: float = 1.26
    water_density: float = 1.00

    @property
    def total(self) -> float:
        """Sum of the parts, M_0."""
        return self.gelatin + self.glycerol + self.water


def component_masses(
    mass_poured: npt.ArrayLike, mass: npt.ArrayLike, mixture: Mixture | None = None
) -> tuple[Floats, Floats, Floats]:
    """Compute the masses of gelatin, glycerol and water in a film, Eqs 12–14.

    Parameters
    ----------
    mass_poured : array_like
        m_0 [g].
    mass : array_like, broadcastable
        The same film in any later state, m_0, m_1 or m_2 [g].
    mixture : Mixture, optional
        Default 2 : 1 : 8.

    Returns
    -------
    gelatin, glycerol, water : numpy.ndarray
        [g]

    Raises
    ------
    ValueError
        If a film weighs less than the gelatin and glycerol poured, or more than was poured.

    Examples
    --------
    30 g hold 30 × 2/11 g of gelatin and 30 × 1/11 g of glycerol; at 15 g the rest is water.

    >>> [round(float(mass), 4) for mass in component_masses(30.0, 15.0)]
    [5.4545, 2.7273, 6.8182]
    """
    mixture = mixture or Mixture()
    poured, now = np.broadcast_arrays(np.asarray(mass_poured, float), np.asarray(mass, float))
    gelatin = mixture.gelatin / mixture.total * poured
    glycerol = mixture.glycerol / mixture.total * poured
    water = now - gelatin - glycerol
    if np.any(water < 0.0):
        lightest = float(np.min(now / poured))
        solids = (mixture.gelatin + mixture.glycerol) / mixture.total
        raise ValueError(
            f"a film has {lightest:.3g} of the mass poured, but gelatin and glycerol alone are "
            f"{solids:.3g}; check the masses or the mixture"
        )
    if np.any(now > poured):
        raise ValueError("a film weighs more than was poured; check the masses")
    return gelatin, glycerol, water


def film_volume(
    mass_poured: npt.ArrayLike, mass: npt.ArrayLike, mixture: Mixture | None = None
) -> Floats:
    r"""Compute the volume of a film as the sum of its components, Eqs 7–10.

    .. math:: V = m_{Gel}/\rho_{Gel} + m_{Gly}/\rho_{Gly} + m_w/\rho_w

    Parameters
    ----------
    mass_poured, mass : array_like, broadcastable
        m_0 and the mass in the state asked for [g].
    mixture : Mixture, optional
        Default 2 : 1 : 8.

    Returns
    -------
    numpy.ndarray
        [cm³]

    Examples
    --------
    5.4545/1.35 + 2.7273/1.26 + 6.8182/1.00:

    >>> round(float(film_volume(30.0, 15.0)), 4)
    13.0231
    """
    mixture = mixture or Mixture()
    gelatin, glycerol, water = component_masses(mass_poured, mass, mixture)
    return (
        gelatin / mixture.gelatin_density
        + glycerol / mixture.glycerol_density
        + water / mixture.water_density
    )


def density_by_mass_average(
    mass_poured: npt.ArrayLike, mass: npt.ArrayLike, mixture: Mixture | None = None
) -> Floats:
    r"""Compute the density of a film as Eq. 15 has it: the average of densities by mass.

    .. math:: \rho = (m_{Gel}\rho_{Gel} + m_{Gly}\rho_{Gly} + m_w\rho_w) / m

    Densities average harmonically by mass, so this is about 2 % too high; it is here to repeat
    the source.

    Parameters
    ----------
    mass_poured, mass : array_like, broadcastable
        m_0 and m_1 [g].
    mixture : Mixture, optional
        Default 2 : 1 : 8.

    Returns
    -------
    numpy.ndarray
        [g/cm³]

    Examples
    --------
    (5.4545 × 1.35 + 2.7273 × 1.26 + 6.8182)/15, where the exact value is 15/13.0231 = 1.1518:

    >>> round(float(density_by_mass_average(30.0, 15.0)), 4)
    1.1745
    """
    mixture = mixture or Mixture()
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
