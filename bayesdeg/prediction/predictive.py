"""New specimens drawn from a posterior: curvature bands and rupture probability."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.material.strength import rupture_probability
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.curvature import ActuatorCurves
from bayesdeg.priors import Named

Floats = NDArray[np.float64]

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def at_conditions(model: JointModel, degradation: Floats, pressure: Floats) -> JointModel:
    """Return the model for one specimen at each degradation rate, over all pressures.

    Parameters
    ----------
    model : JointModel
        A calibrated model.
    degradation : array, shape (n_levels,)
        Known exactly [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor [kPa].
    """
    shape = (len(degradation), len(pressure))
    curves = ActuatorCurves(
        specimens=tuple(f"{level:g} %" for level in degradation),
        degradation=degradation[:, None],
        degradation_sd=np.zeros((shape[0], 1)),
        pressure=np.broadcast_to(pressure, shape).copy(),
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        mask=np.ones(shape, dtype=bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.zeros(shape, dtype=bool),
        recorded=np.ones(shape, dtype=bool),
        ruptured=np.zeros(shape, dtype=bool),
        cycle=np.ones(shape, dtype=np.int64),
        branch=np.full(shape, "loading"),
        time=np.full(shape, np.nan),
        humidity=np.full(shape, np.nan),
        mount=np.full(shape, "horizontal"),
    )
    return model.of_actuators(curves)


def draw_values(
    model: JointModel, chain: Chain, generator: np.random.Generator, draws: int
) -> dict[str, Floats]:
    """Return named values of random draws from a chain."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return model.table.named(flat[generator.integers(len(flat), size=draws)])


def curvature_bands(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
    draws: int = 1000,
) -> pd.DataFrame:
    """Return quantiles of the curvature of a further specimen, without reading noise.

    Parameters
    ----------
    model, chain : JointModel, Chain
        JointModel and its posterior.
    generator : Generator
        Draws parameters and the specimen's own stiffness.
    degradation, pressure : array
        Levels [%] and pressures as read [kPa].
    draws : int
        Number of specimens drawn.

    Returns
    -------
    DataFrame
        Columns ``degradation_pct``, ``pressure_kPa``, ``q05`` … ``q95`` [1/m]; nan where more
        than half of the draws lie outside the range of the forward map.
    """
    grid = at_conditions(model, degradation, pressure)
    values = draw_values(model, chain, generator, draws)
    deviation = grid.draw_deviation(values, generator)
    curvature = grid.curvature(values, deviation).curvature
    usable = np.mean(np.isfinite(curvature), axis=0) > 0.5
    safe = np.where(usable, curvature, 0.0)
    bands = np.where(usable, np.nanquantile(safe, QUANTILES, axis=0), np.nan)
    levels, pressures = np.meshgrid(degradation, pressure, indexing="ij")
    columns = {f"q{round(100 * q):02d}": bands[i].ravel() for i, q in enumerate(QUANTILES)}
    return pd.DataFrame(
        {"degradation_pct": levels.ravel(), "pressure_kPa": pressures.ravel()} | columns
    )


DRAWS, STRATA = 800, 6
_EDGE = 2.0**-40  # of which the normal law has finite quantiles


@dataclass(frozen=True)
class Specimens:
    """Specimens that have not been tested: several of each posterior draw.

    Parameters
    ----------
    model : JointModel
        Predicts them.
    values : mapping
        Named values, one a specimen, the specimens of a draw side by side, (n,).
    score : array, shape (n,)
        Deviation of each specimen's ln stiffness in standard deviations.
    strata : int
        Specimens of a draw.
    """

    model: JointModel
    values: Named
    score: Floats
    strata: int


@dataclass(frozen=True)
class Response:
    """What specimens do under pressures.

    Parameters
    ----------
    curvature : array, shape (n, n_pressures)
        Without reading noise [1/m]; nan where the forward map has no answer.
    burst : array, shape (n_draws, n_pressures)
        Probability that a specimen of a draw has burst up to a pressure. One for which the forward
        map has no answer counts as burst, since it balloons or nothing is known of it.
    """

    curvature: Floats
    burst: Floats

    @property
    def answered(self) -> Floats:
        """Share of the specimens for which there is an answer, (n_pressures,)."""
        share: Floats = np.mean(np.isfinite(self.curvature), axis=0)
        return share


def draw_specimens(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    draws: int = DRAWS,
    strata: int = STRATA,
) -> Specimens:
    """Draw parameters, and specimens of each, their stiffness spread evenly over its law.

    The k-th of m specimens has the score Φ⁻¹((k + u)/m), with one u a draw, uniform in [0, 1): each
    is a random specimen, and a mean over them has less error than over as many independent ones.

    Parameters
    ----------
    model, chain : JointModel, Chain
        JointModel and its posterior.
    generator : Generator
        Draws parameters and u.
    draws, strata : int
        Draws, and specimens of each.
    """
    values = draw_values(model, chain, generator, draws)
    place = (np.arange(strata) + generator.random((draws, 1))) / strata
    score = ndtri(np.clip(place, _EDGE, 1.0 - _EDGE)).ravel()
    return Specimens(model, {n: np.repeat(v, strata) for n, v in values.items()}, score, strata)


def finer(specimens: Specimens, strata: int) -> Specimens:
    """Return more specimens of the same draws, at the middles of equal shares of the law.

    Parameters
    ----------
    specimens : Specimens
        Of which the draws are taken.
    strata : int
        Specimens of a draw.
    """
    named = specimens.values  # noqa: PD011
    values = {n: np.repeat(v[:: specimens.strata], strata) for n, v in named.items()}
    draws = len(specimens.score) // specimens.strata
    score = np.tile(ndtri((np.arange(strata) + 0.5) / strata), draws)
    return Specimens(specimens.model, values, score, strata)


def respond(specimens: Specimens, degradation: float, pressure: Floats) -> Response:
    """Return what specimens do on a prompt first loading in a horizontal mount.

    Parameters
    ----------
    specimens : Specimens
        Drawn once, so that answers at several pressures are those of the same specimens.
    degradation : float
        Known exactly [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor, rising [kPa].
    """
    grid = at_conditions(specimens.model, np.array([degradation]), pressure)
    deviation = specimens.score[:, None, None] * grid.deviation_sd(specimens.values)
    prediction = grid.curvature(specimens.values, deviation)
    answered = prediction.status[:, 0] == 0
    known = _burst(grid, specimens.values, prediction) if grid.has_elongation else 0.0
    burst = np.where(answered, known, 1.0).reshape(-1, specimens.strata, len(pressure))
    return Response(np.where(answered, prediction.curvature[:, 0], np.nan), burst.mean(axis=1))


def _burst(grid: JointModel, values: Named, prediction: Prediction) -> Floats:
    """Return the probability that each specimen has burst, (n, n_pressures)."""
    strength = grid.strength(values)
    stretch = prediction.peak_stretch[:, 0]
    stretch = np.where(prediction.status[:, 0] == 0, np.maximum(stretch, 1.0), 1.0)
    # the error of the forward map adds to the scatter of the strain at break
    share = np.nan_to_num(prediction.peak_stretch_sd[:, 0]) / np.maximum(stretch - 1.0, 1e-12)
    scatter = np.hypot(strength.scatter, share)
    return rupture_probability(stretch, 1.0 + strength.median, scatter, "lognormal")


def specimens_tested(model: JointModel) -> int:
    """Return how many films were broken and actuators loaded: what knows of rupture at all.

    The law of the limit, its scatter and the strain demanded were checked on no more. Films behind
    a published mean count too, as do actuators of which only the number that burst is known.
    """
    films = 0 if model.breaks is None else len(model.breaks.specimens)
    means = (s for s in model.statistics if s.quantity == "elongation_at_break")
    films += sum(round(s.dof) + 1 for s in means if np.isfinite(s.dof))
    own = 0 if model.actuator is None else len(model.actuator.specimens)
    others = sum(float(one.tests.tested.sum()) for one in model.of_kind(RuptureCounts))
    return films + own + int(others)


def fewest_checks(specimens: int, draws: int) -> int:
    """Return N, one in which is the least probability that is known: specimens, or else draws."""
    return max(1, min(specimens or draws, draws))


def not_below(probability: Floats, checks: int) -> Floats:
    """Return probabilities of rupture that are at least one in so many checks.

    What is less rests on the tail of a law that no specimen has seen.

    Examples
    --------
    >>> not_below(np.array([2e-80, 0.5, np.nan]), 50)
    array([0.02, 0.5 ,  nan])
    """
    return np.maximum(probability, 1.0 / checks)


# Gauss–Hermite rule for the specimen's own stiffness
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)


def rupture_table(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
    draws: int = 500,
    specimens: int = 0,
) -> pd.DataFrame:
    """Return the probability that a specimen bursts up to a pressure.

    A specimen bursts where the largest principal stretch that 99 % of its volume stays below
    passes its uniaxial elongation limit (log-normal about a median that depends on D_R). The
    probability averages over specimens; its 5 and 95 % quantiles are over the posterior. None of
    them is below one in the number of specimens that were tested, or of draws if that is not given.

    Returns
    -------
    DataFrame
        Columns ``degradation_pct``, ``pressure_kPa``, ``probability``, ``probability_q05``,
        ``probability_q95`` [–]; a draw whose stretch lies outside the forward map's range counts
        as nan and is left out.
    """
    grid = at_conditions(model, degradation, pressure)
    values = draw_values(model, chain, generator, draws)
    strength = grid.strength(values)
    limit, scatter = 1.0 + strength.median[..., None], strength.scatter[..., None]
    sd = grid.deviation_sd(values)
    total = np.zeros((draws, len(degradation), len(pressure)))
    for node, weight in zip(_NODES, _WEIGHTS / np.sum(_WEIGHTS), strict=True):
        prediction = grid.curvature(values, node * sd)
        stretch = np.where(prediction.status == 0, np.maximum(prediction.peak_stretch, 1.0), np.nan)
        share = prediction.peak_stretch_sd / np.maximum(stretch - 1.0, 1e-12)
        total += weight * _probability(stretch, limit, np.hypot(scatter, share))
    levels, pressures = np.meshgrid(degradation, pressure, indexing="ij")
    usable = np.mean(np.isfinite(total), axis=0) > 0.5
    safe = np.where(usable, total, 0.0)
    low, high = np.where(usable, np.nanquantile(safe, [0.05, 0.95], axis=0), np.nan)
    mean = np.where(usable, np.nanmean(safe, axis=0), np.nan)
    checks = fewest_checks(specimens, draws)
    pressed = pressures > 0.0  # without pressure nothing bursts
    mean, low, high = (
        np.where(pressed, not_below(part, checks), part) for part in (mean, low, high)
    )
    return pd.DataFrame(
        {
            "degradation_pct": levels.ravel(),
            "pressure_kPa": pressures.ravel(),
            "probability": mean.ravel(),
            "probability_q05": low.ravel(),
            "probability_q95": high.ravel(),
        }
    )


def _probability(stretch: Floats, limit: Floats, scatter: Floats) -> Floats:
    known = np.isfinite(stretch)
    probability = rupture_probability(np.where(known, stretch, 1.0), limit, scatter, "lognormal")
    return np.where(known, probability, np.nan)
