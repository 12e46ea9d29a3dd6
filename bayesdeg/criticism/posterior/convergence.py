"""May this posterior be used? R̂ across independent ensembles, effective sizes, in plain words."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayesdeg.inference.density import Density
from bayesdeg.inference.modes import words
from bayesdeg.inference.sampling import EFFORTS, Chain, Effort, Standing


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
    tau : tuple of float
        Autocorrelation times [steps].
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
    tau: tuple[float, ...]


def diagnose(
    density: Density, chain: Chain, effort: Effort, *, shares: Sequence[float] = (1.0,)
) -> Convergence:
    """Say whether a chain is long enough, and what to do if not.

    ``shares`` are those of the posterior's separate modes that were found before.

    R̂ is that of Vehtari et al. (2021), doi:10.1214/20-BA1221, over ensembles, which are
    independent of one another; the walkers of one ensemble are not.
    """
    names, standing = density.table.names, chain.judged(Standing())
    r_hat, bulk, tail = chain.r_hat(), chain.effective(), chain.effective("tail")
    ensembles, steps, walkers, _ = chain.vectors.shape
    time = ensembles * steps * walkers / bulk
    worst, fewest, rarest = int(np.argmax(r_hat)), int(np.argmin(bulk)), int(np.argmin(tail))
    figures = (
        f"largest R-hat {r_hat[worst]:.3f} ({names[worst]}), smallest effective sample size "
        f"{bulk[fewest]:.0f} ({names[fewest]}) and of the tails {tail[rarest]:.0f} "
        f"({names[rarest]}), longest autocorrelation time {time[fewest]:.1f} of {steps} steps"
    )
    usable = standing.enough(effort)
    if usable:
        sentence = f"The sampler has converged: {figures}."
    else:
        sentence = (
            f"The sampler stopped at its limit before its criteria were met ({figures}; wanted "
            f"R-hat at most {effort.r_hat:g}, {effort.effective:.0f} effective draws and "
            f"{effort.times:g} autocorrelation times): means and intervals are rough; "
            f"{_remedy(standing, effort, names[worst])}."
        )
    sentence = " ".join(part for part in (sentence, words(shares)) if part)
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
        tuple(float(v) for v in time),
    )


def _remedy(standing: Standing, effort: Effort, worst: str) -> str:
    """Say what to do: more steps where they would do, else a better posed posterior."""
    wanted = standing.steps_wanted(effort)
    longer = [e.longest for e in EFFORTS.values() if e.longest > effort.longest]
    if longer and (wanted < max(longer) or math.isinf(wanted)):
        return "run again with a higher --effort"
    return (
        f"no effort would be enough: give {worst} a narrower prior if something is known of it, or "
        "add the data that it rests on"
    )
