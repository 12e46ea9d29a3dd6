r"""One specimen predicted by a model that is calibrated anew without it.

Its predictive density is the ratio of two evidences,

.. math:: p(y_i \mid y_{-i}) = p(y) / p(y_{-i}),

which is estimated from draws of both posteriors, with and without the specimen, by bridge sampling,
or, where they hardly overlap, from two importance samples: the mean of p(y_i | θ) over the second
posterior alone rests on few draws where the specimen is a surprise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.specimen_density import specimen_density
from bayesdeg.inference.ensemble import EFFORTS, sample
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import (
    FEWEST_EFFECTIVE,
    Evidence,
    approximate,
)
from bayesdeg.inference.model import Model
from bayesdeg.inference.subset import blocks_of, without

Floats = NDArray[np.float64]

ENOUGH_EFFECTIVE = 150.0  # draws: a log evidence is then known to 0.08
DRAWS = 3000
LARGEST_ERROR = 0.08  # of a log density by bridge sampling, before another way is tried
STEPS = 200  # of the bridge's fixed point, most


@dataclass(frozen=True)
class Prediction:
    """Log predictive density of a specimen that took no part in the calibration.

    Parameters
    ----------
    log_density, error : float
        Estimate and its Monte Carlo standard error.
    effective : float
        Effective number of draws that it rests on.
    """

    log_density: float
    error: float
    effective: float


def predict_left_out(
    model: Model,
    specimen: str,
    draws: Floats,
    log_weights: Floats,
    *,
    effective: float,
    seed: np.random.SeedSequence,
) -> Prediction:
    """Calibrate a model without one specimen and predict it.

    The posterior is an importance sample about its mode; where that has too few draws, chains of
    emcee.

    Parameters
    ----------
    model : Model
        With all specimens.
    specimen : str
        Which one is left out.
    draws : array, shape (n, n_parameters)
        Posterior given all specimens.
    log_weights : array, shape (n,)
        Log importance weights that take the specimen out, as far as they can.
    effective : float
        Effective number of the draws.
    seed : SeedSequence
        Everything random comes from it.
    """
    generator = np.random.default_rng(seed)
    training = without(model, [specimen])
    testing = without(model, [name for name in _names(model) if name != specimen])
    best = draws[int(np.argmax(log_weights))]
    laplace = approximate(training, generator, start=best)
    posterior = about_mode(training, laplace, generator, enough=ENOUGH_EFFECTIVE)
    if posterior.effective < FEWEST_EFFECTIVE:
        posterior = _chain(training, posterior, seed)
    possible = np.isfinite(posterior.log_weights)
    weights = posterior.log_weights[possible] - logsumexp(posterior.log_weights[possible])
    density, error = bridge(
        _density(testing, draws),
        _density(testing, posterior.draws[possible]),
        weights,
        effective=(effective, posterior.effective),
    )
    if error > LARGEST_ERROR:  # the two posteriors hardly overlap: from their evidences themselves
        top = approximate(model, generator, start=best)
        whole = about_mode(model, top, generator)
        wide = float(np.hypot(whole.error, posterior.error))
        if wide < error:
            return Prediction(
                whole.log_evidence - posterior.log_evidence, wide, posterior.effective
            )
    return Prediction(density, error, posterior.effective)


def bridge(
    inside: Floats, outside: Floats, log_weights: Floats, *, effective: tuple[float, float]
) -> tuple[float, float]:
    """Return the log predictive density of a specimen from draws with and without it.

    Parameters
    ----------
    inside : array, shape (n,)
        ln p(y_i | θ) at draws from the posterior given all specimens.
    outside, log_weights : array, shape (m,)
        The same at weighted draws from the posterior without this one; the weights sum to 1.
    effective : tuple of float
        Effective numbers of both.

    Returns
    -------
    log_density, error : float
        Estimate and its Monte Carlo standard error.

    Notes
    -----
    Source: Bennett (1976), doi:10.1016/0021-9991(76)90078-4, the optimal bridge of Meng and Wong
    (1996), Statistica Sinica 6, 831.
    """
    share = np.log(effective) - np.log(sum(effective))
    log_ratio = 0.5 * (float(np.median(inside)) + float(logsumexp(log_weights + outside)))
    for _ in range(STEPS):
        up = outside - np.logaddexp(share[0] + outside, share[1] + log_ratio)
        down = -np.logaddexp(share[0] + inside, share[1] + log_ratio)
        forth, back = logsumexp(log_weights + up), logsumexp(down) - np.log(len(down))
        change, log_ratio = float(forth - back) - log_ratio, float(forth - back)
        if abs(change) < 1e-9:
            break
    variance = np.sum(np.exp(2.0 * log_weights) * np.expm1(up - forth) ** 2)
    variance += np.mean(np.expm1(down - back) ** 2) / effective[0]
    return log_ratio, float(np.sqrt(variance))


def _chain(training: Model, begun: Evidence, seed: np.random.SeedSequence) -> Evidence:
    """Return draws of emcee, equally weighted, from walkers at a poor importance sample."""
    chain = sample(training, begun, effort=EFFORTS["quick"], seed=seed)
    vectors = chain.thinned(DRAWS // len(chain.vectors)).vectors
    flat = vectors.reshape(-1, vectors.shape[-1])
    effective = min(float(np.min(chain.effective())), float(len(flat)))
    return Evidence(float("nan"), float("nan"), flat, np.zeros(len(flat)), effective)


def _density(testing: Model, draws: Floats) -> Floats:
    return specimen_density(testing, testing.table.named(draws))[2][:, 0]


def _names(model: Model) -> tuple[str, ...]:
    return tuple(blocks_of(model, ("tensile", "actuator", "breaks")))
