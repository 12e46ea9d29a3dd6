"""May this posterior be used? R̂ across independent ensembles, effective sizes, in plain words."""

from dataclasses import dataclass

import numpy as np

from bayesdeg.inference.ensemble import Chain, Effort
from bayesdeg.inference.model import Model


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
    sentence : str
        What it means, and what to do.
    """

    names: tuple[str, ...]
    r_hat: tuple[float, ...]
    ess_bulk: tuple[float, ...]
    ess_tail: tuple[float, ...]
    steps: int
    walkers: int
    ensembles: int
    usable: bool
    sentence: str


def diagnose(model: Model, chain: Chain, effort: Effort) -> Convergence:
    """Say whether a chain is long enough, and what to do if not.

    R̂ is that of Vehtari et al. (2021), doi:10.1214/20-BA1221, over ensembles, which are
    independent of one another; the walkers of one ensemble are not.
    """
    names = model.table.names
    r_hat, bulk, tail = chain.r_hat(), chain.effective(), chain.effective("tail")
    ensembles, steps, walkers, _ = chain.vectors.shape
    worst, fewest = int(np.argmax(r_hat)), int(np.argmin(bulk))
    figures = (
        f"largest R-hat {r_hat[worst]:.3f} ({names[worst]}), smallest effective sample size "
        f"{bulk[fewest]:.0f} ({names[fewest]})"
    )
    usable = bool(r_hat[worst] <= effort.r_hat and bulk[fewest] >= effort.effective)
    if usable:
        sentence = f"The sampler has converged: {figures}."
    else:
        sentence = (
            f"The sampler stopped at its limit before its criteria were met ({figures}; wanted "
            f"R-hat at most {effort.r_hat:g} and {effort.effective:.0f} effective draws): means "
            f"and intervals are rough; run again with a higher --effort."
        )
    return Convergence(
        names,
        tuple(float(v) for v in r_hat),
        tuple(float(v) for v in bulk),
        tuple(float(v) for v in tail),
        steps,
        walkers,
        ensembles,
        usable,
        sentence,
    )
