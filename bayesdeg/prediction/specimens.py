"""New specimens drawn from a posterior: what each of them does under pressure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.inference.ensemble import Chain
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named
from bayesdeg.material.strength import rupture_probability
from bayesdeg.prediction.bands import at_conditions, draw_values

Floats = NDArray[np.float64]

DRAWS, STRATA = 800, 6
_EDGE = 2.0**-40  # of which the normal law has finite quantiles


@dataclass(frozen=True)
class Specimens:
    """Specimens that have not been tested: several of each posterior draw.

    Parameters
    ----------
    model : Model
        Predicts them.
    values : mapping
        Named values, one a specimen, the specimens of a draw side by side, (n,).
    score : array, shape (n,)
        Deviation of each specimen's ln stiffness in standard deviations.
    strata : int
        Specimens of a draw.
    """

    model: Model
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
    model: Model,
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
    model, chain : Model, Chain
        Model and its posterior.
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
    values = {n: np.repeat(v[:: specimens.strata], strata) for n, v in specimens.values.items()}
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


def _burst(grid: Model, values: Named, prediction: Prediction) -> Floats:
    """Return the probability that each specimen has burst, (n, n_pressures)."""
    strength = grid.strength(values)
    stretch = prediction.peak_stretch[:, 0]
    stretch = np.where(prediction.status[:, 0] == 0, np.maximum(stretch, 1.0), 1.0)
    # the error of the forward map adds to the scatter of the strain at break
    share = np.nan_to_num(prediction.peak_stretch_sd[:, 0]) / np.maximum(stretch - 1.0, 1e-12)
    scatter = np.hypot(strength.scatter, share)
    return rupture_probability(stretch, 1.0 + strength.median, scatter, "lognormal")
