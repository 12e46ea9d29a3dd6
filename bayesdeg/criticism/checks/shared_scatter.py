"""Test whether specimens that a cause lets scatter independently deviate level by level.

A cause that widens the scatter of degradation rates implies independent deviations of the
specimens. A batch that was mixed wrongly or stored elsewhere deviates as a whole: a wider scatter
absorbs that too, but is the wrong explanation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.checks.discrepancy import FEWEST, log_ratios
from bayesdeg.criticism.fit.linear import columns_of, is_seen
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.data.levels import levels

Floats = NDArray[np.float64]

SHARES = np.array([0.25, 0.5, 0.75, 0.95])
"""Tried correlations of specimens of one level."""


@dataclass(frozen=True)
class SharedScatter:
    """How much better a shared scatter explains the readings of a level's specimens.

    Parameters
    ----------
    cause : str
        Which widens the scatter.
    statistic : float
        Largest log-likelihood ratio of a shared scatter against one of each specimen's own [nats].
    share : float
        The correlation between specimens of a level at which that is reached.
    p_value : float
        Share of data simulated from the model with at least this statistic, (1 + #)/(1 + n); nan
        where there are too few such data.
    replicates : int
        Those data.
    """

    cause: str
    statistic: float
    share: float
    p_value: float
    replicates: int = 0

    @property
    def is_tested(self) -> bool:
        """Whether there were enough data for the test."""
        return not np.isnan(self.p_value)

    @property
    def is_more_than_chance(self) -> bool:
        """Whether specimens of a level deviate together."""
        return self.p_value <= MISFIT_LEVEL


def shared_scatter(trial: CandidateFit, simulated: Floats) -> list[SharedScatter]:
    r"""Test the scatter that each active cause adds to actuators against one shared by a level.

    With :math:`b_k = J_k \sqrt{\tau_k^2 - \tau_{0k}^2}` what one standard deviation of the added
    scatter does to the readings of specimen k, and :math:`\Sigma` their covariance without any
    correlation between specimens, the statistic is the largest of

    .. math:: \ln N(y; \mu, \Sigma + \rho \sum_{k \neq l} b_k b_l^T) - \ln N(y; \mu, \Sigma)

    over correlations :math:`\rho`, the sum over specimens of the same level.

    In the data sets (n, n_readings), simulated from the model, every specimen has its own
    deviation. One result for each cause that widens the scatter; none where specimens have no
    deviations.

    References
    ----------
    Atenafu et al. (2012), doi:10.1186/1471-2288-12-126, on correlations within classes.
    """
    found = []
    subject, linear = trial.subject, trial.linear
    for cause in subject.causes:
        own = subject.deviations(trial.mode)
        unseen = ~is_seen(linear.whiten_columns(linear.jacobian))
        neutral = trial.mode.copy()
        for column, parameter in zip(columns_of(subject, cause), cause.parameters, strict=True):
            if unseen[column]:
                neutral[column] = float(parameter.law.to_unconstrained(parameter.neutral or 0.0))
        without = subject.deviations(neutral).spread
        added = linear.whiten_columns(own.slope * np.sqrt(np.maximum(own.spread - without, 0.0)))
        if not np.any(is_seen(added)):
            continue
        level = levels(own.level)[1]
        other = (level[:, None] == level) & ~np.eye(len(level), dtype=bool)
        basis, triangle = np.linalg.qr(added)
        values, turned = np.linalg.eigh(triangle @ other @ triangle.T)
        vectors, signal = basis @ turned, SHARES[:, None] * values
        ratios = log_ratios(signal, linear.observed[None] @ vectors)[:, 0]
        chance = log_ratios(signal, linear.whiten(simulated) @ vectors).max(axis=0)
        best = int(np.argmax(ratios))
        p_value = float(chance_of(ratios[best], chance, fewest=FEWEST))
        statistic, share = float(ratios[best]), float(SHARES[best])
        found.append(SharedScatter(cause.name, statistic, share, p_value, len(simulated)))
    return found
