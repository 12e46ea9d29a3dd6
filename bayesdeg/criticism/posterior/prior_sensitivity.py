r"""Sensitivity of a posterior to power scaling of priors and likelihood.

A density p is scaled to :math:`p^\alpha`, by weights :math:`p^{\alpha - 1}` on the stored draws,
and the cumulative Jensen–Shannon distance between the distributions of a quantity before and after
is taken per doubling of α. Scaling the likelihood in the same way shows whether the data matter
too.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
import pandas as pd
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.priors import Named, ParameterTable

Floats = NDArray[np.float64]

ALPHAS = (0.99, 1.01)


@dataclass(frozen=True)
class Scaling:
    """Weights of stored draws for a part of the log density scaled slightly down and up.

    All (n_chains, n_draws); the weights down and up each sum to 1.
    """

    log_density: Floats
    lower: Floats
    upper: Floats

    @classmethod
    def of(cls, log_density: Floats) -> Self:
        """Scale a part, such as the log prior; the largest weights are smoothed."""
        if np.ptp(log_density) == 0.0:  # a flat prior, of which every power is the same
            even = np.full_like(log_density, 1.0 / log_density.size)
            return cls(log_density, even, even)
        logs = (_log_weights(log_density, alpha) for alpha in ALPHAS)
        lower, upper = (np.exp(w - logsumexp(w)) for w in logs)
        return cls(log_density, lower, upper)


def power_scaling(draws: Floats, scaling: Scaling) -> float:
    """Return the change of a quantity's distribution per doubling of the power of a density.

    Draws are of shape (n_chains, n_draws).

    Examples
    --------
    >>> from scipy.stats import norm
    >>> draws = norm.ppf((np.arange(4000) + 0.5) / 4000).reshape(4, 1000)
    >>> round(power_scaling(draws, Scaling.of(norm.logpdf(draws))), 2)  # nothing but a prior
    0.08
    """
    if np.ptp(draws) == 0.0:
        return 0.0
    weights = (scaling.lower, scaling.upper)
    return float(array_stats.power_scale_sense(draws, *weights, *ALPHAS))


def noise_of(draws: Floats, scaling: Scaling) -> float:
    """Return the sensitivity of draws of one ensemble to the densities of another.

    These are unrelated, but have the same number of draws and autocorrelation.
    """
    turned = [power_scaling(np.roll(draws, turn, axis=0), scaling) for turn in range(1, len(draws))]
    return float(np.mean(turned)) if turned else 0.0


def _log_weights(log_density: Floats, alpha: float) -> Floats:
    # a part on which nearly all draws agree, such as no ruptures, has no tail to smooth
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Number of tail draws", UserWarning)
        try:
            smooth: Floats = array_stats.power_scale_lw(log_density, alpha=alpha, axis=(0, 1))
        except ValueError:
            return (alpha - 1.0) * log_density
    return smooth if np.all(np.isfinite(smooth)) else (alpha - 1.0) * log_density


def conclusions(model: JointModel, values: Named) -> dict[str, Floats]:
    """Return the conclusions of the report by name.

    C1 and the elongation limit without degradation and at the last node, the volume ratio, the
    stiffness of the paper, and the size of each active cause.

    In the users' units, each (n,); those that the model has no parameters for are left out.
    """
    found: dict[str, Floats] = {}
    if isinstance(model.world, FilmsAndActuators):
        c1 = model.world.constants(values, _ends(model.world.nodes))[..., 0]
        found = _against_degradation("C1", c1, model.world.nodes, degrades=model.world.degrades)
    named = {"volume_ratio": "volume ratio", "paper_stiffness": "paper stiffness"}
    found |= {words: values[name] for name, words in named.items() if name in values}
    if "elongation_scatter" in values:
        nodes = model.world.elongation_nodes
        limit = model.world.elongation(values, _ends(nodes))
        found |= _against_degradation(
            "elongation limit", limit, nodes, degrades=model.world.degrades
        )
    for cause in model.causes:
        for parameter in cause.parameters:
            words = f"{cause.name.replace('_', ' ')}: {parameter.name.replace('_', ' ')}"
            found[words] = values[cause.qualified(parameter.name)]
    return found


def _ends(nodes: tuple[float, ...]) -> Floats:
    return np.unique([0.0, max(nodes)])


def _against_degradation(
    name: str, draws: Floats, nodes: tuple[float, ...], *, degrades: bool
) -> dict[str, Floats]:
    if not degrades:
        return {name: draws[:, 0]}
    return {f"{name} at {end:.3g} %": draws[:, i] for i, end in enumerate(_ends(nodes))}


NOTICEABLE = 0.05  # noticeable sensitivity; about 0.3 standard deviations per doubling
DRAWS = 1000  # draws of each ensemble
ABOVE_NOISE = 1.5  # multiple of the sensitivity of unrelated draws below which there is none


class Diagnosis(StrEnum):
    """Diagnosis from the sensitivities to prior and likelihood."""

    DATA = "data"
    PRIOR = "prior"
    BOTH = "prior and data"
    NEITHER = "neither"


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity of the posterior of one quantity to prior and likelihood.

    Parameters
    ----------
    quantity : str
        A parameter, or a conclusion.
    conclusion : bool
        Which of both.
    prior, likelihood : float
        Distances per doubling.
    prior_noise, likelihood_noise : float
        What draws would show of either that have nothing to do with it.
    shift : float
        Change of the posterior mean over its standard deviation per doubling of the prior's power.
    hangs_on : str
        Parameter whose own prior matters most; empty where priors do not matter.
    rests_on : str
        Kind of data that matters most.
    """

    quantity: str
    conclusion: bool
    prior: float
    likelihood: float
    prior_noise: float
    likelihood_noise: float
    shift: float
    hangs_on: str
    rests_on: str

    @property
    def diagnosis(self) -> Diagnosis:
        """Whether prior or data shape the quantity."""
        by_prior = noticeable(self.prior, self.prior_noise)
        by_data = noticeable(self.likelihood, self.likelihood_noise)
        if by_prior:
            return Diagnosis.BOTH if by_data else Diagnosis.PRIOR
        return Diagnosis.DATA if by_data else Diagnosis.NEITHER


def noticeable(distance: float, noise: float) -> bool:
    """Return whether a sensitivity is noticeable beyond the noise of its draws.

    The squares of both add up, as noise and effect are independent.

    Examples
    --------
    >>> noticeable(0.06, 0.01), noticeable(0.06, 0.04), noticeable(0.3, 0.25)
    (True, False, False)
    """
    return distance >= max(float(np.hypot(NOTICEABLE, noise)), ABOVE_NOISE * noise)


@dataclass(frozen=True)
class PriorSensitivity:
    """Sensitivities of conclusions and parameters, conclusions first."""

    rows: tuple[Sensitivity, ...]

    @property
    def on_priors(self) -> tuple[Sensitivity, ...]:
        """Conclusions that priors shape noticeably, those that rest on data the least first."""
        shaped = (Diagnosis.PRIOR, Diagnosis.BOTH)
        moved = [row for row in self.rows if row.conclusion and row.diagnosis in shaped]
        return tuple(sorted(moved, key=lambda row: row.likelihood - row.prior))

    @property
    def on_data(self) -> tuple[str, ...]:
        """All other conclusions."""
        moved = self.on_priors
        return tuple(row.quantity for row in self.rows if row.conclusion and row not in moved)

    def table(self) -> pd.DataFrame:
        """Return one row per quantity: the columns of ``prior_sensitivity.csv``."""
        return pd.DataFrame(
            [
                {
                    "quantity": row.quantity,
                    "kind": "conclusion" if row.conclusion else "parameter",
                    "prior": row.prior,
                    "likelihood": row.likelihood,
                    "prior_noise": row.prior_noise,
                    "likelihood_noise": row.likelihood_noise,
                    "shift_sd": row.shift,
                    "diagnosis": str(row.diagnosis),
                    "hangs_on": row.hangs_on,
                    "rests_on": row.rests_on,
                }
                for row in self.rows
            ]
        )


def prior_sensitivity(model: JointModel, chain: Chain) -> PriorSensitivity:
    """Return the sensitivities of conclusions and parameters, from stored draws.

    Notes
    -----
    Densities are those in the users' units, as the priors are stated; another scale would be
    another family of priors about the same one.

    Source: Kallioinen et al. (2023), doi:10.1007/s11222-023-10366-5.
    """
    vectors = chain.thinned(DRAWS).vectors
    shape = (len(vectors), -1)
    values = model.table.named(vectors.reshape(-1, vectors.shape[-1]))
    stated = conclusions(model, values)
    blocks = model.log_likelihood(values).items()
    log_prior = {name: v.reshape(shape) for name, v in log_priors(model.table, values).items()}
    log_likelihood = {kind: v.sum(axis=-1).reshape(shape) for kind, v in blocks}
    parts = [
        {name: Scaling.of(part) for name, part in density.items()}
        for density in (log_prior, log_likelihood)
    ]
    # a model without data has no likelihood, and the sum is 0
    nothing = np.zeros((len(vectors), len(values[model.table.names[0]]) // len(vectors)))
    whole = [Scaling.of(sum(density.values(), nothing)) for density in (log_prior, log_likelihood)]
    rows = []
    log_density = whole[0].log_density
    for name, flat in (stated | values).items():
        draws = flat.reshape(shape)
        by_prior, by_data = (power_scaling(draws, part) for part in whole)
        prior_noise, data_noise = (noise_of(draws, part) for part in whole)
        spread = float(np.std(draws))
        covariance = float(np.mean((draws - draws.mean()) * (log_density - log_density.mean())))
        rows.append(
            Sensitivity(
                quantity=name,
                conclusion=name in stated,
                prior=by_prior,
                likelihood=by_data,
                prior_noise=prior_noise,
                likelihood_noise=data_noise,
                shift=float(np.log(2.0)) * covariance / spread if spread > 0.0 else 0.0,
                hangs_on=_largest(draws, parts[0]) if noticeable(by_prior, prior_noise) else "",
                rests_on=_largest(draws, parts[1]) if name in stated else "",
            )
        )
    return PriorSensitivity(tuple(rows))


def log_priors(table: ParameterTable, values: Named) -> dict[str, Floats]:
    """Return the log prior density of each parameter in its own unit, each (n,)."""
    return {p.name: p.law.log_density(values[p.name]) for p in table.parameters}


def _largest(draws: Floats, parts: Mapping[str, Scaling]) -> str:
    """Return the part that matters most, after subtracting the noise of its draws."""

    def excess(name: str) -> float:
        return power_scaling(draws, parts[name]) ** 2 - noise_of(draws, parts[name]) ** 2

    return max(parts, key=excess, default="")
