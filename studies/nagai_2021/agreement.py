"""Question (a): what can make simulation and experiment agree as the published R² say.

An imagined experiment differs from the simulation only by what a model allows:

    κ_exp(p) = κ_sim(p; D_R + e) · f + noise,   e = 0 at D_R = 0,

with e a D_R error and f the effect of a relative error of stiffness, both in part common to the
specimens of a level and in part a specimen's own. Given the unknowns the six R² are independent, so
their likelihood is the product of six densities of ln(1 − R²), each estimated from inner draws with
a kernel as wide as rounding and a tolerance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from nagai_2021.published import LEVELS, R_SQUARED, SPECIMENS, Curves

Floats = NDArray[np.float64]

TARGET = np.log(1.0 - R_SQUARED)
TOLERANCE = np.hypot(0.1, 0.0005 / np.sqrt(3.0) / (1.0 - R_SQUARED))
"""sd of the kernel on ln(1 − R²): 10 %, and the rounding of the published value."""
CHUNK = 500


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


MODELS = {
    "noise only": Model(),
    "D_R error": Model(degradation=2.0),
    "stiffness error": Model(stiffness=0.1),
    "D_R and stiffness error": Model(degradation=2.0, stiffness=0.1),
}
VARIANTS: dict[str, dict[str, float | bool]] = {
    "as stated": {},
    "R² on the mean curve": {"mean_curve": True},
    "D_R error prior 1 point": {"degradation": 1.0},
    "D_R error prior 4 points": {"degradation": 4.0},
    "large reading noise (5 %, 0.3 1/m)": {"noise": 0.05, "floor": 0.3},
    "reading noise equal at all levels": {"noise_spread": 0.0},
}


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
class Fit:
    """How well a model explains the published R².

    Parameters
    ----------
    log_likelihood : array, shape (n, 6)
        By outer draw and level.
    sample : array, shape (n, n_inner, 6)
        The imagined ln(1 − R²).
    unknowns : Unknowns
        The draws.
    """

    log_likelihood: Floats
    sample: Floats
    unknowns: Unknowns

    def log_evidence(self, levels: slice = slice(None)) -> tuple[float, float]:
        """Return ln evidence of the R² at some levels and its Monte Carlo standard error."""
        total = self.log_likelihood[:, levels].sum(axis=1)
        weight = np.exp(total - total.max())
        error = weight.std(ddof=1) / weight.mean() / np.sqrt(len(weight))
        return float(logsumexp(total) - np.log(len(total))), float(error)

    def weights(self) -> Floats:
        """Return posterior weights of the draws, summing to 1."""
        total = self.log_likelihood.sum(axis=1)
        weight: Floats = np.exp(total - logsumexp(total))
        return weight


def fit(curves: Curves, model: Model, generator: np.random.Generator, *, inner: int) -> Fit:
    """Estimate the likelihood of the six published R² for every draw of the unknowns."""
    unknowns = _draw_unknowns(model, generator, len(curves))
    logs, samples = [], []
    for start in range(0, len(curves), CHUNK):
        rows = slice(start, start + CHUNK)
        some = Unknowns(**{name: values[rows] for name, values in vars(unknowns).items()})
        part = Curves(curves.log_curvature[rows], curves.growth[rows])
        y = np.stack(
            [
                _imagine(part, some, generator, level=level, inner=inner, mean=model.mean_curve)
                for level in LEVELS
            ],
            axis=-1,
        )
        z = (TARGET - y) / TOLERANCE
        density = logsumexp(-0.5 * z**2, axis=1) - np.log(inner)
        logs.append(density - np.log(TOLERANCE * np.sqrt(2.0 * np.pi)))
        samples.append(y)
    return Fit(np.concatenate(logs), np.concatenate(samples), unknowns)


def variant(model: Model, changes: dict[str, float | bool]) -> Model:
    """Return a model under other assumptions; what it does not allow stays excluded."""
    return replace(
        model,
        **{k: v for k, v in changes.items() if k != "degradation" or model.degradation > 0.0},  # type: ignore[arg-type]
    )


def unexplained(experiment: Floats, simulation: Floats) -> Floats:
    """Return 1 − R² = SSE/SST over the last axis, to which a reading of 0 at 0 kPa is added."""
    count = experiment.shape[-1] * 13 // 12
    total = np.square(experiment).sum(axis=-1) - experiment.sum(axis=-1) ** 2 / count
    return np.asarray(np.square(experiment - simulation).sum(axis=-1) / total)


def required_error(curves: Curves) -> Floats:
    """Return the error of D_R that alone gives each published R², (n, 6, 2) [points].

    The last axis is the size of an error towards less and towards more degradation; nan where
    none within the grid of D_R does, as towards less at 0 %.
    """
    shifts = np.arange(-12.0, 12.01, 0.1)
    found = np.full((len(curves), len(LEVELS), 2), np.nan)
    for i, level in enumerate(LEVELS):
        inside = (level + shifts >= 0.0) & (level + shifts <= curves.log_curvature.shape[1] - 1)
        here = shifts[inside]
        shifted = np.exp(_interpolate(curves.log_curvature, level + here[None, :]))
        simulated = np.exp(curves.log_curvature[:, None, int(level)])
        # the root is nearly linear in the error, which interpolation then follows
        misfit = np.sqrt(unexplained(shifted.astype(np.float64), simulated.astype(np.float64)))
        published = np.sqrt(1.0 - R_SQUARED[i])
        for side, way in enumerate((here <= 0.0, here >= 0.0)):
            if way.sum() < 2:
                continue
            order = np.argsort(np.abs(here[way]), kind="stable")
            sizes, values = np.abs(here[way])[order], misfit[:, way][:, order]
            reached = values[:, -1] >= published
            for row in np.flatnonzero(reached):
                found[row, i, side] = np.interp(published, values[row], sizes)
    return found


def absolute_misfit(curves: Curves) -> Floats:
    """Return the RMS misfit in curvature that each published R² means, (n, 6) [1/m]."""
    kappa = curves.at_levels()
    count = kappa.shape[-1] + 1
    variance = np.square(kappa).sum(axis=-1) / count - (kappa.sum(axis=-1) / count) ** 2
    misfit: Floats = np.sqrt((1.0 - R_SQUARED) * variance)
    return misfit


def _draw_unknowns(model: Model, generator: np.random.Generator, count: int) -> Unknowns:
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


def _imagine(
    curves: Curves,
    unknowns: Unknowns,
    generator: np.random.Generator,
    *,
    level: float,
    inner: int,
    mean: bool,
) -> Floats:
    """Return ln(1 − R²) of imagined experiments at a level, (n, inner)."""
    shape = (len(curves), inner, SPECIMENS)
    error = _partly_common(unknowns.degradation, unknowns.degradation_share, generator, shape)
    stiffness = _partly_common(unknowns.stiffness, unknowns.stiffness_share, generator, shape)
    at = np.clip(level + error * (level > 0.0), 0.0, curves.log_curvature.shape[1] - 1.0)
    flat = at.reshape(len(curves), -1)
    log_kappa = _interpolate(curves.log_curvature, flat).reshape(*shape, -1)
    growth = _interpolate(curves.growth, flat).reshape(*shape, -1)
    kappa = np.exp(log_kappa - growth * stiffness[..., None])
    ratio = generator.standard_normal((*shape[:2], 1, 1), dtype=np.float32)
    ratio = np.exp(ratio * unknowns.noise_spread.astype(np.float32)[:, None, None, None])
    relative, floor = (
        v.astype(np.float32)[:, None, None, None] for v in (unknowns.noise, unknowns.floor)
    )
    noise = generator.standard_normal(kappa.shape, dtype=np.float32)
    experiment = kappa + ratio * np.hypot(relative * kappa, floor) * noise
    simulation = np.exp(curves.log_curvature[:, None, None, int(level)])
    if mean:
        experiment = experiment.mean(axis=2, keepdims=True)
    difference = np.broadcast_to(simulation, experiment.shape)
    pooled = unexplained(experiment.reshape(*shape[:2], -1), difference.reshape(*shape[:2], -1))
    return np.log(np.maximum(pooled, 1e-9)).astype(np.float64)


def _partly_common(
    sd: Floats, share: Floats, generator: np.random.Generator, shape: tuple[int, int, int]
) -> NDArray[np.float32]:
    common = generator.standard_normal((*shape[:2], 1), dtype=np.float32)
    own = generator.standard_normal(shape, dtype=np.float32)
    weights = (sd * np.sqrt(share), sd * np.sqrt(1.0 - share))
    of_level, of_specimen = (w.astype(np.float32)[:, None, None] for w in weights)
    error: NDArray[np.float32] = of_level * common + of_specimen * own
    return error


def _interpolate(values: NDArray[np.float32], degradation: Floats) -> NDArray[np.float32]:
    """Put parabolas through the grid of D_R, (n, n_grid, P) at (n or 1, m) → (n, m, P)."""
    first = np.clip(np.rint(degradation).astype(int) - 1, 0, values.shape[1] - 3)
    t = (degradation - first - 1.0).astype(np.float32)[..., None]
    rows = np.arange(len(values))[:, None]
    below, middle, above = (values[rows, first + k] for k in range(3))
    between: NDArray[np.float32] = middle + 0.5 * t * (
        above - below + t * (above + below - 2 * middle)
    )
    return between
