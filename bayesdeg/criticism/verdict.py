"""Which cause, several, or that none can be named.

The chain of argument: (1) the misfit is calibrated by simulating from the fitted base model;
(2) a Gaussian-process discrepancy says how much there is to explain; (3) each candidate is nested
in an extended model and judged by its marginal likelihood, by the share of the misfit that it
removes and by held-out specimens, which must agree; (4) the threshold for naming is raised until
data without an effect are named in at most 5 % of cases; (5) rivals that cannot be told from the
best are reported beside it.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.linear import Linear, log_bayes_factor, overlap, sensitivities

Floats = NDArray[np.float64]

FALSE_NAME_RATE = 0.05
LEAST_FACTOR = float(np.log(20.0))
LEAST_EXPLAINED = 0.5
INSEPARABLE = float(np.log(20.0))
MISFIT_LEVEL = 0.02
CONFUSABLE = 0.9


class Outcome(StrEnum):
    """What can be said of the misfit."""

    ADEQUATE = "adequate"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class EffectSize:
    """Posterior of one parameter of a cause."""

    mean: float
    sd: float
    q05: float
    q95: float
    unit: str


@dataclass(frozen=True)
class Candidate:
    """How one cause fared.

    Parameters
    ----------
    cause : str
        Its name.
    log_bayes_factor : float or None
        Against the base model [nats]; None if it could not be judged.
    explained_fraction : float or None
        Share of the misfit statistic that it removes.
    elpd_diff, elpd_diff_se : float or None
        Gain in log predictive density on held-out specimens; None if it was not worth the effort.
    effect : mapping
        Posterior of each parameter.
    why : str
        Why it could not be judged; empty if it was.
    """

    cause: str
    log_bayes_factor: float | None
    explained_fraction: float | None
    elpd_diff: float | None
    elpd_diff_se: float | None
    effect: dict[str, EffectSize]
    why: str = ""


@dataclass(frozen=True)
class Decision:
    """The outcome and the causes that it is about."""

    outcome: Outcome
    causes: tuple[str, ...]


def naming_threshold(linear: Linear, causes: tuple[Cause, ...], replicates: Floats) -> float:
    """Return the log Bayes factor that naming takes: exceeded by 5 % of data without an effect.

    It is at least ln 20.

    Parameters
    ----------
    linear : Linear
        The base model.
    causes : tuple of Cause
        All that are tried: the largest factor counts.
    replicates : array, shape (n, n_specimens, n_points)
        Data simulated from the base model.
    """
    whitened = linear.whiten(replicates)
    largest = np.max(
        [log_bayes_factor(whitened, sensitivities(linear, cause)) for cause in causes], axis=0
    )
    return max(LEAST_FACTOR, float(np.quantile(largest, 1.0 - FALSE_NAME_RATE)))


def decide(candidates: list[Candidate], misfit: Misfit, threshold: float) -> Decision:
    """Return the outcome.

    A cause is supported if its log Bayes factor passes the threshold, it removes at least half of
    the misfit, and held-out specimens are predicted better by more than a standard error. A rival
    as probable as the best that was not tried on held-out specimens is not ruled out by that.
    """
    supported = [c for c in candidates if c.elpd_diff is not None and _is_possible(c, threshold)]
    if not supported:
        outcome = Outcome.UNEXPLAINED if misfit.p_value <= MISFIT_LEVEL else Outcome.ADEQUATE
        return Decision(outcome, ())
    best = max(supported, key=lambda c: c.log_bayes_factor or -np.inf)
    rivals = tuple(
        c.cause
        for c in candidates
        if _is_possible(c, threshold)
        and (c.log_bayes_factor or -np.inf) > (best.log_bayes_factor or 0.0) - INSEPARABLE
    )
    if len(rivals) > 1:
        return Decision(Outcome.AMBIGUOUS, rivals)
    return Decision(Outcome.NAMED, (best.cause,))


def probabilities(candidates: list[Candidate]) -> dict[str, float]:
    """Return posterior probabilities of the causes, equally likely before, as is no cause."""
    judged = {c.cause: c.log_bayes_factor for c in candidates if c.log_bayes_factor is not None}
    factors = np.array([0.0, *judged.values()])
    weights = np.exp(factors - factors.max())
    return dict(zip(judged, (weights / weights.sum())[1:].tolist(), strict=True))


def confusable_pairs(linear: Linear, causes: tuple[Cause, ...]) -> list[tuple[str, str]]:
    """Return the pairs of causes whose effects on this study's readings are nearly the same."""
    columns = {cause.name: sensitivities(linear, cause) for cause in causes}
    names = list(columns)
    return [
        (a, b)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if overlap(columns[a], columns[b]) > CONFUSABLE
    ]


def _is_possible(candidate: Candidate, threshold: float) -> bool:
    """Whether nothing that was measured speaks against a cause."""
    if candidate.log_bayes_factor is None:
        return False
    return (
        candidate.log_bayes_factor >= threshold
        and (candidate.explained_fraction or 0.0) >= LEAST_EXPLAINED
        and (candidate.elpd_diff is None or candidate.elpd_diff > (candidate.elpd_diff_se or 0.0))
    )
