"""One model becomes a posterior: mode, evidence, chain; resumed where it was done before."""

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.convergence import Convergence, diagnose
from bayesdeg.inference.ensemble import Chain, Effort, sample
from bayesdeg.inference.laplace import Evidence, Laplace, approximate, evidence
from bayesdeg.inference.model import Model
from bayesdeg.inference.refusals import Refusals
from bayesdeg.pipeline.progress import Progress
from bayesdeg.report.checkpoints import Checkpoints

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """A calibrated model.

    Parameters
    ----------
    model : Model
        What was calibrated.
    laplace : Laplace
        Mode and curvature.
    evidence : Evidence
        Marginal likelihood.
    chain : Chain
        Posterior draws.
    diagnosis : Convergence
        Whether they may be used.
    """

    model: Model
    laplace: Laplace
    evidence: Evidence
    chain: Chain
    diagnosis: Convergence


def calibrate(
    model: Model,
    name: str,
    *,
    effort: Effort,
    seed: np.random.SeedSequence,
    checkpoints: Checkpoints,
    progress: Progress,
    executor: Executor | None = None,
    start: Floats | None = None,
) -> Fit:
    """Calibrate a model, or read its chain if it stands in the checkpoints.

    Parameters
    ----------
    model : Model
        What to calibrate.
    name : str
        Under which its chain is kept.
    effort : Effort
        Of sampling.
    seed : SeedSequence
        Everything random comes from it.
    checkpoints : Checkpoints
        Results of an interrupted run.
    progress : Progress
        Shows R̂ and effective sizes.
    executor : Executor, optional
        For the ensembles.
    start : array, optional
        A point near the mode.
    """
    approximation, chains = seed.spawn(2)
    generator = np.random.default_rng(approximation)
    progress.stage(f"{name}: mode and curvature")
    laplace = approximate(model, generator, start=start)
    importance = evidence(model, laplace, generator)
    progress.stage(f"{name}: sampling", total=effort.longest)
    stored = checkpoints.load(f"chain-{name}")
    if stored is not None and "refusals" in stored:
        chain = Chain(
            stored["vectors"],
            stored["log_prob"],
            stored["acceptance"],
            Refusals(*(int(number) for number in stored["refusals"])),
        )
        progress.advance(effort.longest, "taken from the interrupted run")
        return Fit(model, laplace, importance, chain, diagnose(model, chain, effort))

    def show(done: int, smallest: float, largest: float) -> None:
        note = f"{smallest:.0f} effective draws, R-hat {largest:.3f}"
        progress.advance(effort.chunk, note)

    chain = sample(model, importance, effort=effort, seed=chains, executor=executor, on_chunk=show)
    checkpoints.save(
        f"chain-{name}",
        {
            "vectors": chain.vectors,
            "log_prob": chain.log_prob,
            "acceptance": chain.acceptance,
            "refusals": np.array([chain.refusals.proposed, chain.refusals.refused]),
        },
    )
    return Fit(model, laplace, importance, chain, diagnose(model, chain, effort))
