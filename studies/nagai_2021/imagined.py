"""Imagined experiments: their deviations from the simulation under a model, and their R²."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nagai_2021.published import SPECIMENS, Curves

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

ERROR_STEP = 5.0
NODES_OF_ERROR = ERROR_STEP * np.array([-1.0, 0.0, 1.0])
"""D_R errors at which an alteration is known [points]; it is held beyond."""


@dataclass(frozen=True)
class Model:
    """What the experiment may differ by; each sd has a half-normal prior with this scale.

    Parameters
    ----------
    degradation : float
        sd of the D_R error [points]; 0 for none.
    stiffness : float
        sd of the ln stiffness error at every level [–]; 0 for none.
    noise, floor : float
        Reading noise, proportional [–] and constant [1/m].
    noise_spread : float
        sd of the ln reading noise from level to level [–].
    mean_curve : bool
        R² on the mean curve of three specimens, not on pooled points.
    """

    degradation: float = 0.0
    stiffness: float = 0.0
    noise: float = 0.02
    floor: float = 0.1
    noise_spread: float = 0.3
    mean_curve: bool = False


@dataclass(frozen=True)
class Unknowns:
    """Draws of the sds from their priors, each (n,), as `Model` names them."""

    degradation: Floats
    degradation_share: Floats
    stiffness: Floats
    stiffness_share: Floats
    noise: Floats
    floor: Floats
    noise_spread: Floats


@dataclass(frozen=True)
class Alteration:
    """What else experiments differ by, one row a draw.

    Parameters
    ----------
    ratio : array, shape (n, 6, 3, n_pressures)
        Readings over those of the simulation where D_R is off by `NODES_OF_ERROR` [–].
    shift, scatter : array, shape (n, 6)
        Mean, and sd over specimens, of a further D_R error [points].
    inside : array of bool, shape (n,)
        Where all readings can be simulated; elsewhere it counts as explaining nothing.
    """

    ratio: Singles
    shift: Singles
    scatter: Singles
    inside: NDArray[np.bool_]

    def take(self, rows: slice) -> "Alteration":
        """Return some of the draws."""
        return Alteration(**{name: values[rows] for name, values in vars(self).items()})


@dataclass(frozen=True)
class Place:
    """Where in the experiment: number and value of the level [%], and number of inner draws."""

    number: int
    level: float
    inner: int


def draw_unknowns(model: Model, generator: np.random.Generator, count: int) -> Unknowns:
    """Draw the sds from their priors."""

    def half_normal(scale: float) -> Floats:
        return scale * np.abs(generator.standard_normal(count))

    return Unknowns(
        half_normal(model.degradation),
        generator.uniform(size=count),
        half_normal(model.stiffness),
        generator.uniform(size=count),
        half_normal(model.noise),
        half_normal(model.floor),
        half_normal(model.noise_spread),
    )


def imagine(
    curves: Curves,
    unknowns: Unknowns,
    generator: np.random.Generator,
    place: Place,
    *,
    mean: bool,
    altered: Alteration | None = None,
    further: np.random.Generator | None = None,
) -> Floats:
    """Return ln(1 − R²) of imagined experiments at a level, (n, inner).

    What an alteration needs of chance it takes from the generator ``further``, so that experiments
    with and without it share their noise.
    """
    shape = (len(curves), place.inner, SPECIMENS)
    error = _partly_common(unknowns.degradation, unknowns.degradation_share, generator, shape)
    stiffness = _partly_common(unknowns.stiffness, unknowns.stiffness_share, generator, shape)
    error = error * (place.level > 0.0)
    if altered is not None and further is not None:
        error = error + _further_error(altered, place, further, shape)
    kappa = _curvature(curves, place, error, stiffness)
    if altered is not None:
        kappa = kappa * _ratio(altered, place, error)
    experiment = kappa + _noise(unknowns, kappa, generator)
    simulation = np.exp(curves.log_curvature[:, None, None, int(place.level)])
    if mean:
        experiment = experiment.mean(axis=2, keepdims=True)
    difference = np.broadcast_to(simulation, experiment.shape)
    pooled = unexplained(*(one.reshape(*shape[:2], -1) for one in (experiment, difference)))
    return np.log(np.maximum(pooled, 1e-9)).astype(np.float64)


def unexplained(experiment: Floats | Singles, simulation: Floats | Singles) -> Floats:
    """Return 1 − R² = SSE/SST over the last axis, to which a reading of 0 at 0 kPa is added."""
    count = experiment.shape[-1] * 13 // 12
    total = np.square(experiment).sum(axis=-1) - experiment.sum(axis=-1) ** 2 / count
    return np.asarray(np.square(experiment - simulation).sum(axis=-1) / total)


def interpolate(values: Singles, degradation: Floats | Singles) -> Singles:
    """Put parabolas through the grid of D_R, (n, n_grid, P) at (n or 1, m) → (n, m, P)."""
    first = np.clip(np.rint(degradation).astype(int) - 1, 0, values.shape[1] - 3)
    t = (degradation - first - 1.0).astype(np.float32)[..., None]
    rows = np.arange(len(values))[:, None]
    below, middle, above = (values[rows, first + k] for k in range(3))
    between: Singles = middle + 0.5 * t * (above - below + t * (above + below - 2 * middle))
    return between


def _curvature(curves: Curves, place: Place, error: Singles, stiffness: Singles) -> Singles:
    """Return κ with errors of D_R and ln stiffness, (n, inner, specimens, n_pressures) [1/m]."""
    at = np.clip(place.level + error, 0.0, curves.log_curvature.shape[1] - 1.0)
    flat = at.reshape(len(curves), -1)
    log_kappa = interpolate(curves.log_curvature, flat).reshape(*error.shape, -1)
    growth = interpolate(curves.growth, flat).reshape(*error.shape, -1)
    kappa: Singles = np.exp(log_kappa - growth * stiffness[..., None])
    return kappa


def _further_error(
    altered: Alteration,
    place: Place,
    further: np.random.Generator,
    shape: tuple[int, int, int],
) -> Singles:
    shift, scatter = (v[:, place.number, None, None] for v in (altered.shift, altered.scatter))
    if not scatter.any():
        return shift
    error: Singles = shift + scatter * further.standard_normal(shape, dtype=np.float32)
    return error


def _ratio(altered: Alteration, place: Place, error: Singles) -> Singles:
    """Return the alteration's ratio at errors of D_R, (n, inner, specimens, n_pressures) [–]."""
    ratio = altered.ratio[:, place.number]
    if not error.any():
        return ratio[:, None, None, 1]
    shape = np.broadcast_shapes(error.shape, (len(ratio), 1, 1))
    flat = np.broadcast_to(error, shape).reshape(len(ratio), -1)
    at = np.clip(flat / ERROR_STEP + 1.0, 0.0, 2.0)
    return interpolate(ratio, at).reshape(*shape, -1)


def _noise(unknowns: Unknowns, kappa: Singles, generator: np.random.Generator) -> Singles:
    ratio = generator.standard_normal((*kappa.shape[:2], 1, 1), dtype=np.float32)
    ratio = np.exp(ratio * unknowns.noise_spread.astype(np.float32)[:, None, None, None])
    relative, floor = (
        v.astype(np.float32)[:, None, None, None] for v in (unknowns.noise, unknowns.floor)
    )
    noise = generator.standard_normal(kappa.shape, dtype=np.float32)
    spread: Singles = ratio * np.hypot(relative * kappa, floor) * noise
    return spread


def _partly_common(
    sd: Floats, share: Floats, generator: np.random.Generator, shape: tuple[int, int, int]
) -> Singles:
    common = generator.standard_normal((*shape[:2], 1), dtype=np.float32)
    own = generator.standard_normal(shape, dtype=np.float32)
    weights = (sd * np.sqrt(share), sd * np.sqrt(1.0 - share))
    of_level, of_specimen = (w.astype(np.float32)[:, None, None] for w in weights)
    error: Singles = of_level * common + of_specimen * own
    return error
