"""Specimens as they really are, and readings with their errors."""

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.inference.path_density import INDEPENDENT
from bayesdeg.laboratory.truth import Truth

Floats = npt.NDArray[np.float64]


def draw_specimens(
    names: pd.Series,
    truth: Truth,
    *,
    degradation: Floats,
    sd: Floats,
    generator: np.random.Generator,
) -> pd.DataFrame:
    r"""Draw what each specimen really is.

    .. math:: D = D_{believed} + \sigma_D z_1, \quad \ln(C/C(D)) = \sigma_C z_2, \quad
        \ln(\varepsilon_b/\varepsilon_b(D)) = \sigma_\varepsilon z_3

    Parameters
    ----------
    names : pandas.Series of str, length n
        The specimens.
    truth : Truth
        Material and scatter.
    degradation, sd : array, shape (n,)
        Degradation rate that is believed and its standard error [%].
    generator : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    pandas.DataFrame
        By ``specimen_id``: ``degradation_pct`` [%], ``ln_stiffness`` (deviation from the mean
        of the material), ``limit_stretch`` at which it breaks.

    Examples
    --------
    >>> fresh = draw_specimens(
    ...     pd.Series(["a"]), Truth(stiffness_scatter=0.0, elongation_scatter=0.0),
    ...     degradation=np.zeros(1), sd=np.zeros(1), generator=np.random.default_rng(0),
    ... )
    >>> round(float(fresh.loc["a", "limit_stretch"]), 3)
    3.098
    """
    z = generator.standard_normal((3, len(names)))
    true = degradation + sd * z[0]
    elongation = (truth.limit_stretch(true) - 1.0) * np.exp(truth.elongation_scatter * z[2])
    return pd.DataFrame(
        {
            "degradation_pct": true,
            "ln_stiffness": truth.stiffness_scatter * z[1],
            "limit_stretch": 1.0 + elongation,
        },
        index=pd.Index(names, name="specimen_id"),
    )


def constants_of(specimens: pd.DataFrame, truth: Truth) -> Floats:
    """Return C1, C2, C3 [MPa] of each specimen, shape (n, 3)."""
    factor = np.exp(specimens["ln_stiffness"].to_numpy())
    return truth.constants(specimens["degradation_pct"].to_numpy()) * factor[:, None]


def stated_sd(table: pd.DataFrame, truth: Truth) -> Floats:
    """Return the standard error of the degradation rate on each row [%].

    Where the table states none it is that of the truth; fresh specimens were never in the soil
    and have none.
    """
    assumed = np.where(table["degradation_pct"] > 0.0, truth.degradation_sd, 0.0)
    return np.where(table["degradation_sd_pct"].isna(), assumed, table["degradation_sd_pct"])


def noise(value: Floats, z: Floats, *, floor: float | Floats, share: float) -> Floats:
    r"""Return errors of reading with standard deviation :math:`\sqrt{f^2 + (s v)^2}`."""
    return np.hypot(floor, share * value) * z


def alike_along(place: Floats, z: Floats, *, specimen: npt.ArrayLike, length: float) -> Floats:
    r"""Make independent normals alike along each specimen's path, as errors of reading are.

    The correlation of two readings i ≠ j of a specimen is (1 − w) exp(−|s_i − s_j|/ℓ), by the
    Cholesky factor of their covariance; w is `bayesdeg.inference.path_density.INDEPENDENT`.

    Parameters
    ----------
    place : array, shape (n,)
        s, length of path up to each reading.
    z : array, shape (n,)
        Independent standard normals.
    specimen : array_like, shape (n,)
        Whose path it is.
    length : float
        ℓ, in the unit of s; at 0 the normals stay as they are.

    Returns
    -------
    array, shape (n,)

    Examples
    --------
    >>> at, z = np.array([0.0, 1e9]), np.array([1.0, 3.0])
    >>> alike_along(at, z, specimen=["a", "a"], length=1.0).round(3).tolist()
    [1.0, 3.0]
    """
    if length == 0.0:
        return z
    alike = np.empty_like(z)
    owner, names = pd.factorize(np.asarray(specimen))
    for k in range(len(names)):
        rows = np.flatnonzero(owner == k)
        rows = rows[np.argsort(place[rows], kind="stable")]
        distance = np.abs(place[rows, None] - place[rows])
        common = (1.0 - INDEPENDENT) * np.exp(-distance / length)
        alike[rows] = np.linalg.cholesky(common + INDEPENDENT * np.eye(len(rows))) @ z[rows]
    return alike


def significant(values: Floats, digits: int) -> Floats:
    """Round to significant digits.

    Examples
    --------
    >>> significant(np.array([0.00123456, 0.0, 12.3456]), 3).tolist()
    [0.00123, 0.0, 12.3]
    """
    return np.array([float(f"{value:.{digits}g}") for value in values])
