r"""Leave-one-out predictions of specimens.

Its predictive density is the ratio of two evidences,

.. math:: p(y_i \mid y_{-i}) = p(y) / p(y_{-i}),

which is estimated from draws of both posteriors, with and without the specimen, by bridge sampling
or, if they hardly overlap, from two importance samples: for a surprising specimen the mean of
p(y_i | θ) over the second posterior alone rests on few draws.

The expected log predictive density of specimen i is

.. math:: \mathrm{elpd}_i = \ln \int p(y_i \mid \theta)\, p(\theta \mid y_{-i})\, d\theta

with y_i all its readings. Single readings of a curve are not left out, since their neighbours
predict them and would hide any fault.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.fit.side_by_side import in_order
from bayesdeg.criticism.holdout.held_out import (
    FEWEST,
    LARGEST_K,
    largest_k,
    recalibrated,
    smoothed,
    specimen_density,
    standard_error,
)
from bayesdeg.inference.importance import about_mode, refitted
from bayesdeg.inference.laplace import approximate, weighted
from bayesdeg.inference.model import JointModel, blocks_of, without
from bayesdeg.inference.sampling import EFFORTS, Chain

Floats = NDArray[np.float64]

ENOUGH_EFFECTIVE = 150.0  # draws: a log evidence is then known to 0.08
LARGEST_ERROR = (
    0.08  # error of a log density by bridge sampling above which a different method is tried
)
NO_MEAN = 1.0  # shape of the weights' tail above which their mean is meaningless
STEPS = 200  # most iterations of the bridge's fixed point


class LeftOutPrediction(NamedTuple):
    """Log predictive density of a held-out specimen, and its Monte Carlo standard error."""

    log_density: float
    error: float


def predict_left_out(
    model: JointModel,
    specimen: str,
    draws: Floats,
    log_weights: Floats,
    *,
    effective: float,
    reached: bool,
    seed: np.random.SeedSequence,
) -> LeftOutPrediction:
    """Calibrate a model without one specimen and predict it.

    Proposals come first from a distribution fitted to the weighted draws, which includes ridges
    that one about the mode misses. If it performs badly, or the draws do not suffice, the model is
    calibrated again from its mode.

    The weighted draws are those of the posterior given all specimens, with weights that take the
    specimen out as far as they can; `reached` says whether they reach where the posterior without
    it lies.
    """
    training = without(model, [specimen])
    testing = without(model, [name for name in blocks_of(model) if name != specimen])
    best = draws[int(np.argmax(log_weights))]
    posterior = None
    if reached:
        known = weighted(draws, log_weights)
        posterior = refitted(training, known, np.random.default_rng(seed))
    generator = np.random.default_rng(seed)
    if (
        posterior is None
        or not posterior.effective >= FEWEST * ENOUGH_EFFECTIVE
        or not posterior.pareto_k <= LARGEST_K
    ):
        posterior = recalibrated(
            training, generator, seed, start=best, enough=ENOUGH_EFFECTIVE, effort=EFFORTS["quick"]
        )
    possible = np.isfinite(posterior.log_weights)
    weights = posterior.log_weights[possible] - logsumexp(posterior.log_weights[possible])
    density, error = bridge(
        _density(testing, draws),
        _density(testing, posterior.draws[possible]),
        weights,
        effective=(effective, posterior.effective),
    )
    if error > LARGEST_ERROR:  # the two posteriors hardly overlap: use their evidences
        top = approximate(model, generator, start=best)
        whole = about_mode(model, top, generator)
        wide = float(np.hypot(whole.error, posterior.error))
        if wide < error:
            return LeftOutPrediction(whole.log_evidence - posterior.log_evidence, wide)
    return LeftOutPrediction(density, error)


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
        Estimate and its Monte Carlo standard error; −inf and inf where no draw without the
        specimen answers its readings.

    Notes
    -----
    Source: Bennett (1976), doi:10.1016/0021-9991(76)90078-4, the optimal bridge of Meng and Wong
    (1996), Statistica Sinica 6, 831.
    """
    if not np.any(np.isfinite(outside)):  # no draw without the specimen can predict its readings
        return -np.inf, np.inf
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


def _density(testing: JointModel, draws: Floats) -> Floats:
    return specimen_density(testing, testing.table.named(draws))[2][:, 0]


Flags = NDArray[np.bool_]

LOO_DRAWS = 1000  # of each ensemble
# below, the normal law for a sum of elpd is rough: Sivula et al. (2020), arXiv:2008.10296
FEW_SPECIMENS = 100


@dataclass(frozen=True)
class LeaveOneOut:
    """Predictions of specimens by a model calibrated without each in turn.

    Parameters
    ----------
    specimens, kinds : tuple of str
        Name of each specimen, and what was read on it.
    elpd : array, shape (n_specimens,)
        Log predictive density of all its readings given the other specimens.
    error : array, shape (n_specimens,)
        Monte Carlo standard error of it.
    in_sample : array, shape (n_specimens,)
        The same given all specimens, itself included.
    pareto_k : array, shape (n_specimens,)
        Shape of the tail of the importance weights; above ``threshold`` they cannot be relied on.
    refitted : array of bool, shape (n_specimens,)
        Whether the model was recalibrated without it.
    threshold : float
        Largest acceptable ``pareto_k``.
    """

    specimens: tuple[str, ...]
    kinds: tuple[str, ...]
    elpd: Floats
    error: Floats
    in_sample: Floats
    pareto_k: Floats
    refitted: Flags
    threshold: float

    @property
    def influence(self) -> Floats:
        """Gain in log density of each specimen by its own readings."""
        return self.in_sample - self.elpd

    @property
    def most_influential(self) -> int:
        """The specimen whose own readings add most."""
        return int(np.argmax(self.influence))

    @property
    def refits(self) -> tuple[str, ...]:
        """Specimens without which the model was calibrated again."""
        return tuple(name for name, one in zip(self.specimens, self.refitted, strict=True) if one)

    @property
    def is_rough(self) -> bool:
        """Whether the specimens are too few for a standard error of a normal law."""
        return len(self.specimens) < FEW_SPECIMENS

    @property
    def total(self) -> float:
        """Sum of elpd over specimens."""
        return float(np.sum(self.elpd))

    @property
    def total_error(self) -> float:
        """Standard error of the sum, from the scatter over specimens; nan for a single one."""
        return standard_error(self.elpd)

    def table(self) -> pd.DataFrame:
        """Return one row per specimen: the columns of ``leave_one_out.csv``."""
        return pd.DataFrame(
            {
                "specimen_id": self.specimens,
                "kind": self.kinds,
                "elpd": self.elpd,
                "elpd_error": self.error,
                "influence": self.influence,
                "pareto_k": self.pareto_k,
                "refitted": self.refitted.astype(int),
            }
        )


def leave_one_out(
    model: JointModel,
    chain: Chain,
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_refit: Callable[[str], None] | None = None,
) -> LeaveOneOut:
    """Predict each specimen from all others by Pareto-smoothed importance sampling.

    The posterior draws are weighted by 1/p(y_i | θ), the largest weights smoothed by a Pareto law;
    if its shape k shows that too few draws carry the weight, the model is calibrated again without
    that specimen.

    `on_refit` is called after each refit with the specimen's name.

    Raises
    ------
    ValueError
        If the model has no specimens.

    Notes
    -----
    Summary statistics are of other people's specimens; they stay in the model.

    Source: Vehtari, Gelman and Gabry (2017), doi:10.1007/s11222-016-9696-4; threshold of k:
    Vehtari et al. (2024), https://jmlr.org/papers/v25/19-556.html.
    """
    draws = chain.thinned(LOO_DRAWS).vectors
    draws = draws.reshape(len(draws), -1, draws.shape[-1])
    flat = draws.reshape(-1, draws.shape[-1])
    names, kinds, density = specimen_density(model, model.table.named(flat))
    if not names:
        raise ValueError("there are no specimens to leave out")
    relative = relative_efficiency(chain, len(flat))
    smooth = smoothed(density.reshape(*draws.shape[:2], -1), relative)
    threshold = largest_k(len(flat))
    refitted = ~(smooth.pareto_k <= threshold)
    rows = np.flatnonzero(refitted)
    jobs = zip(rows, seed.spawn(len(rows)), strict=True)
    elpd, error = smooth.elpd.copy(), smooth.error.copy()
    reached = smooth.pareto_k < NO_MEAN
    work = [(names[row], smooth.log_weights[:, row], reached[row], child) for row, child in jobs]
    refit = partial(_refit, model, flat, relative * len(flat))
    for row, found in zip(rows, in_order(refit, work, executor), strict=True):
        elpd[row], error[row] = found.log_density, found.error
        if on_refit is not None:
            on_refit(names[row])
    inside = smooth.in_sample
    return LeaveOneOut(names, kinds, elpd, error, inside, smooth.pareto_k, refitted, threshold)


def relative_efficiency(chain: Chain, kept: int) -> float:
    """Return the effective number of draws of a chain over the number kept, at most 1."""
    return float(np.clip(np.mean(chain.effective("mean")) / kept, 1e-3, 1.0))


def _refit(
    model: JointModel,
    draws: Floats,
    effective: float,
    job: tuple[str, Floats, bool, np.random.SeedSequence],
) -> LeftOutPrediction:
    specimen, log_weights, reached, seed = job
    return predict_left_out(
        model, specimen, draws, log_weights, effective=effective, reached=reached, seed=seed
    )
