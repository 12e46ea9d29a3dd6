"""What a film is made of: masses of its components, its volume and density, Eqs 7–10, 12–15.

Source: doi:10.3389/frobt.2021.760485. Only water is lost; gelatin and glycerol stay.
"""

from dataclasses import dataclass, fields

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

    @property
    def solids(self) -> float:
        """Share of what stays when all water is lost, gelatin and glycerol, by mass."""
        return (self.gelatin + self.glycerol) / self.total


@dataclass(frozen=True)
class Known:
    """A number with its standard uncertainty.

    Parameters
    ----------
    value : float
        The number.
    sd : float
        Its standard uncertainty, in the same unit; 0 where it is taken as exact.
    """

    value: float
    sd: float = 0.0


@dataclass(frozen=True)
class Recipe:
    """What a `Mixture` is made of and how well that is known; the defaults are taken as exact.

    All films of a study share it, so its errors are common to them and no average removes them.

    Parameters
    ----------
    gelatin, glycerol, water : Known
        Parts by mass.
    gelatin_density, glycerol_density, water_density : Known
        [g/cm³]

    Examples
    --------
    >>> Recipe(gelatin_density=Known(1.35, 0.05)).mixture == Mixture()
    True
    """

    gelatin: Known = Known(Mixture.gelatin)
    glycerol: Known = Known(Mixture.glycerol)
    water: Known = Known(Mixture.water)
    gelatin_density: Known = Known(Mixture.gelatin_density)
    glycerol_density: Known = Known(Mixture.glycerol_density)
    water_density: Known = Known(Mixture.water_density)

    @property
    def mixture(self) -> Mixture:
        """The mixture at the values given."""
        return Mixture(**{entry.name: getattr(self, entry.name).value for entry in fields(self)})


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
    gelatin, glycerol, water = _parts(poured, now, mixture)
    if np.any(water < 0.0):
        lightest = float(np.min(now / poured))
        raise ValueError(
            f"a film has {lightest:.3g} of the mass poured, but gelatin and glycerol alone are "
            f"{mixture.solids:.3g}; check the masses or the mixture"
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
    component_masses(mass_poured, mass, mixture)
    poured, now = np.broadcast_arrays(np.asarray(mass_poured, float), np.asarray(mass, float))
    return volume_of_parts(poured, now, mixture)


def volume_of_parts(poured: Floats, mass: Floats, mixture: Mixture) -> Floats:
    """Return what `film_volume` does [cm³], also of films lighter than their gelatin and glycerol.

    A film that is dry is so for a slightly changed mixture, by which errors are carried over.
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
