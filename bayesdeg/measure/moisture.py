"""Moisture content, degradation rate and mass loss: Eqs 3–6 of doi:10.3389/frobt.2021.760485.

The degradation rate D_R is a proxy: it is the loss of retained water, not of mass. Eq. 4 divides
by the moist mass (wet basis), the control experiment behind Eq. 6 by the dry mass (dry basis);
D_R means wet basis throughout, and what needs the other basis converts it here.
"""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

#: Slope of Eq. 6: mass loss over degradation rate, dry basis.
MASS_LOSS_SLOPE = 0.8574


def moisture_content(mass_equilibrated: npt.ArrayLike, mass_dry: npt.ArrayLike) -> Floats:
    r"""Compute the moisture content on the wet basis, Eq. 4.

    .. math:: M_C = 100 (M_0 - M_d) / M_0

    Parameters
    ----------
    mass_equilibrated, mass_dry : array_like, broadcastable
        M_0 and M_d, both above 0, in the same unit.

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    1.00 g of film that dries to 0.80 g held 20 % of moisture.

    >>> round(float(moisture_content(1.0, 0.8)), 12)
    20.0
    """
    moist, dry = np.asarray(mass_equilibrated, float), np.asarray(mass_dry, float)
    return np.asarray(100.0 * (moist - dry) / moist, float)


def moisture_content_dry_basis(mass_equilibrated: npt.ArrayLike, mass_dry: npt.ArrayLike) -> Floats:
    r"""Compute the moisture content on the dry basis, as in the control experiment.

    .. math:: M_C = 100 (M_{e} - M') / M'

    Parameters
    ----------
    mass_equilibrated, mass_dry : array_like, broadcastable
        M_e and M', both above 0, in the same unit.

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    The same film holds 0.20 g of water on 0.80 g.

    >>> round(float(moisture_content_dry_basis(1.0, 0.8)), 12)
    25.0
    """
    moist, dry = np.asarray(mass_equilibrated, float), np.asarray(mass_dry, float)
    return np.asarray(100.0 * (moist - dry) / dry, float)


def degradation_rate(moisture: npt.ArrayLike, moisture_initial: npt.ArrayLike) -> Floats:
    r"""Compute the degradation rate, Eq. 3.

    .. math:: D_R = -100 (M_C - M_{C0}) / M_{C0}

    Parameters
    ----------
    moisture, moisture_initial : array_like, broadcastable
        Mean moisture contents after and before degradation, on one and the same basis [%].

    Returns
    -------
    numpy.ndarray
        [%]; scatter may make it slightly negative.

    Examples
    --------
    A fall from 20 % to 15 % of moisture is a degradation rate of 25 %.

    >>> float(degradation_rate(15.0, 20.0))
    25.0
    """
    after, before = np.asarray(moisture, float), np.asarray(moisture_initial, float)
    return np.asarray(100.0 * (before - after) / before, float)


def to_dry_basis(degradation_pct: npt.ArrayLike, *, moisture_initial_pct: npt.ArrayLike) -> Floats:
    r"""Convert a degradation rate from the wet to the dry basis.

    With w_0 the wet-basis moisture fraction before degradation and w = w_0 (1 − D/100) after,

    .. math:: D_{dry} = 100 \left(1 - \frac{w (1 - w_0)}{w_0 (1 - w)}\right)

    Parameters
    ----------
    degradation_pct : array_like
        Wet basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis, between 0 and 100 [%].

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    At 20 % moisture, 25 % is 1 − (0.15 × 0.80)/(0.20 × 0.85) = 29.4 %.

    >>> round(float(to_dry_basis(25.0, moisture_initial_pct=20.0)), 3)
    29.412
    """
    before = np.asarray(moisture_initial_pct, float) / 100.0
    left = 1.0 - np.asarray(degradation_pct, float) / 100.0
    return np.asarray(100.0 * (1.0 - left * (1.0 - before) / (1.0 - before * left)), float)


def to_wet_basis(degradation_pct: npt.ArrayLike, *, moisture_initial_pct: npt.ArrayLike) -> Floats:
    r"""Convert a degradation rate from the dry to the wet basis; inverse of `to_dry_basis`.

    With d_0 = w_0/(1 − w_0) and d = d_0 (1 − D/100) the dry-basis moisture fractions,

    .. math:: D_{wet} = 100 \left(1 - \frac{d}{w_0 (1 + d)}\right)

    Parameters
    ----------
    degradation_pct : array_like
        Dry basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis, between 0 and 100 [%].

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    >>> round(float(to_wet_basis(29.4117647, moisture_initial_pct=20.0)), 6)
    25.0
    """
    before = np.asarray(moisture_initial_pct, float) / 100.0
    dry = before / (1.0 - before) * (1.0 - np.asarray(degradation_pct, float) / 100.0)
    return np.asarray(100.0 * (1.0 - dry / (before * (1.0 + dry))), float)


def mass_loss(mass: npt.ArrayLike, mass_initial: npt.ArrayLike) -> Floats:
    r"""Compute the mass loss, Eq. 5.

    .. math:: M_{loss} = -100 (M' - M'_0) / M'_0

    Parameters
    ----------
    mass, mass_initial : array_like, broadcastable
        Dry masses M' and M'_0 after and before degradation, in the same unit.

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    >>> round(float(mass_loss(0.45, 0.60)), 12)
    25.0
    """
    after, before = np.asarray(mass, float), np.asarray(mass_initial, float)
    return np.asarray(100.0 * (before - after) / before, float)


def mass_loss_from_degradation(
    degradation_pct: npt.ArrayLike,
    *,
    moisture_initial_pct: npt.ArrayLike,
    slope: float = MASS_LOSS_SLOPE,
) -> Floats:
    r"""Estimate the mass loss from the degradation rate of a film, Eq. 6.

    .. math:: M_{loss} = 0.8574 \, D_{R, dry}

    The slope was found with both moisture contents on the dry basis, so that a degradation rate
    of films is converted first. It was found in a solution of bromelain, not in soil.

    Parameters
    ----------
    degradation_pct : array_like
        Wet basis [%].
    moisture_initial_pct : array_like
        M_C0 on the wet basis [%].
    slope : float
        Mass loss over degradation rate, dry basis [–].

    Returns
    -------
    numpy.ndarray
        [%]

    Examples
    --------
    0.8574 × 29.41 %:

    >>> round(float(mass_loss_from_degradation(25.0, moisture_initial_pct=20.0)), 2)
    25.22
    """
    dry = to_dry_basis(degradation_pct, moisture_initial_pct=moisture_initial_pct)
    return slope * dry
