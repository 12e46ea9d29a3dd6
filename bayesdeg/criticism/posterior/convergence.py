"""Convergence: R̂ across independent ensembles, and effective sample sizes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayesdeg.inference.density import Density
from bayesdeg.inference.sampling import EFFORTS, Chain, Effort, SamplerStatus

LARGEST_R_HAT = 1.2
"""R̂ above which ensembles contradict each other: the spread between them is two thirds of that
within one (Gelman and Rubin 1992, doi:10.1214/ss/1177011136). Every effort requires far less."""
FEWEST_DRAWS = 50.0
"""Effective draws below which the error of a mean exceeds a seventh of the standard deviation, and
the ends of a 90 % interval rest on two or three draws each."""


@dataclass(frozen=True)
class Convergence:
    """Diagnostics of one posterior.

    Parameters
    ----------
    names : tuple of str
        Parameters.
    r_hat, ess_bulk, ess_tail : tuple of float
        Rank-normalised split R̂ across ensembles, and effective sample sizes.
    steps, walkers, ensembles : int
        Size of the chain after burn-in.
    usable : bool
        Whether the criteria of the effort were met.
    tau : tuple of float
        Autocorrelation times [steps].
    effort : Effort
        Its criteria.
    more_helps : bool
        Whether a higher effort would meet the criteria; else the posterior is posed badly.
    shares : tuple of float
        Of the posterior's separate modes [–].
    """

    names: tuple[str, ...]
    r_hat: tuple[float, ...]
    ess_bulk: tuple[float, ...]
    ess_tail: tuple[float, ...]
    steps: int
    walkers: int
    ensembles: int
    usable: bool
    tau: tuple[float, ...]
    effort: Effort
    more_helps: bool
    shares: tuple[float, ...] = (1.0,)

    @property
    def is_converged(self) -> bool:
        """Whether it can be judged; ``usable`` requires all criteria of the effort."""
        return max(self.r_hat) <= LARGEST_R_HAT and min(self.ess_bulk) >= FEWEST_DRAWS

    @property
    def worst(self) -> int:
        """The parameter with the largest R̂."""
        return int(np.argmax(self.r_hat))

    @property
    def fewest(self) -> int:
        """The parameter with the smallest effective sample size: its draws are most correlated."""
        return int(np.argmin(self.ess_bulk))

    @property
    def rarest(self) -> int:
        """The parameter with the smallest effective sample size of the tails."""
        return int(np.argmin(self.ess_tail))


def diagnose(
    density: Density, chain: Chain, effort: Effort, *, shares: Sequence[float] = (1.0,)
) -> Convergence:
    """Return whether a chain is long enough, and if not, whether a longer one would be.

    ``shares`` are those of the posterior's separate modes that were found before.

    R̂ is that of Vehtari et al. (2021), doi:10.1214/20-BA1221, over ensembles, which are
    independent; the walkers of one ensemble are not.
    """
    standing, bulk = chain.judged(SamplerStatus()), chain.effective()
    ensembles, steps, walkers, _ = chain.vectors.shape
    times = ensembles * steps * walkers / bulk
    wanted = standing.steps_wanted(effort)
    longer = [e.longest for e in EFFORTS.values() if e.longest > effort.longest]
    return Convergence(
        density.table.names,
        tuple(chain.r_hat().tolist()),
        tuple(bulk.tolist()),
        tuple(chain.effective("tail").tolist()),
        steps,
        walkers,
        ensembles,
        standing.enough(effort),
        tuple(times.tolist()),
        effort,
        bool(longer) and (wanted < max(longer) or math.isinf(wanted)),
        tuple(shares),
    )
