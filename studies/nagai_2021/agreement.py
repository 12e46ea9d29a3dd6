"""Question (a): which errors explain the published R² between simulation and experiment.

An imagined experiment differs from the simulation only by what a model allows:

    κ_exp(p) = κ_sim(p; D_R + e) · f + noise,   e = 0 at D_R = 0,

with e a D_R error and f the effect of a relative error of stiffness, both partly common to the
specimens of a level and partly independent. Given the unknowns the six R² are independent, so their
likelihood is the product of six densities of ln(1 − R²), each estimated from inner draws with a
kernel as wide as rounding and a tolerance. A cause of the catalogue adds an `Alteration`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from nagai_2021.imagined import (
    Alteration,
    Model,
    Place,
    Unknowns,
    draw_unknowns,
    imagine,
    interpolate,
    unexplained,
)
from nagai_2021.published import LEVELS, R_SQUARED, Curves

Floats = NDArray[np.float64]

TARGET = np.log(1.0 - R_SQUARED)
TOLERANCE = np.hypot(0.1, 0.0005 / np.sqrt(3.0) / (1.0 - R_SQUARED))
"""sd of the kernel on ln(1 − R²): 10 %, and the rounding of the published value."""
CHUNK = 500

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


def fit(
    curves: Curves,
    model: Model,
    generator: np.random.Generator,
    *,
    inner: int,
    unknowns: Unknowns | None = None,
    altered: Alteration | None = None,
) -> Fit:
    """Estimate the likelihood of the six published R² for every draw of the unknowns.

    The unknowns are drawn from their priors if they are not given.
    """
    unknowns = unknowns or draw_unknowns(model, generator, len(curves))
    further = generator.spawn(1)[0]
    samples = []
    for start in range(0, len(curves), CHUNK):
        rows = slice(start, start + CHUNK)
        some = Unknowns(**{name: values[rows] for name, values in vars(unknowns).items()})
        part = Curves(curves.log_curvature[rows], curves.growth[rows])
        now = None if altered is None else altered.take(rows)
        y = [
            imagine(
                part,
                some,
                generator,
                Place(i, level, inner),
                mean=model.mean_curve,
                altered=now,
                further=further,
            )
            for i, level in enumerate(LEVELS)
        ]
        samples.append(np.stack(y, axis=-1))
    sample = np.concatenate(samples)
    return Fit(_log_density(sample, altered), sample, unknowns)


def variant(model: Model, changes: dict[str, float | bool]) -> Model:
    """Return a model under other assumptions; what it does not allow stays excluded."""
    return replace(
        model,
        **{k: v for k, v in changes.items() if k != "degradation" or model.degradation > 0.0},  # type: ignore[arg-type]
    )


def ordering(sample: Floats) -> dict[str, float]:
    """Return how often R² at 0 % falls below that at 5 %, and as far below as published."""
    gap = sample[..., 0] - sample[..., 1]
    return {
        "fresh_below_5_pct": float(np.mean(gap > 0.0)),
        "as_far_below": float(np.mean(gap >= TARGET[0] - TARGET[1])),
    }


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
        shifted = np.exp(interpolate(curves.log_curvature, level + here[None, :]))
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


def _log_density(sample: Floats, altered: Alteration | None) -> Floats:
    z = (TARGET - sample) / TOLERANCE
    density = logsumexp(-0.5 * z**2, axis=1) - np.log(sample.shape[1])
    density -= np.log(TOLERANCE * np.sqrt(2.0 * np.pi))
    if altered is None:
        return np.asarray(density)
    return np.where(altered.inside[:, None], density, -np.inf)
