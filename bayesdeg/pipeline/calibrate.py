"""One model becomes a posterior: mode, evidence, chain; resumed where it was done before."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NotRequired, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.criticism.convergence import Convergence, diagnose
from bayesdeg.inference.chain import Chain, Effort, Standing
from bayesdeg.inference.density import Density
from bayesdeg.inference.ensemble import sample
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import Evidence, Laplace, approximate
from bayesdeg.inference.least_squares import near_films
from bayesdeg.inference.model import Model
from bayesdeg.inference.modes import find_modes
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.time_left import Pace, steps_left, words
from bayesdeg.report.checkpoints import Pieces, Stages

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


class Sampled(Protocol):
    """Any density that was sampled, such as a `Fit`."""

    @property
    def model(self) -> Density:
        """What was sampled."""
        ...

    @property
    def chain(self) -> Chain:
        """Posterior draws."""
        ...

    @property
    def diagnosis(self) -> Convergence:
        """Whether they may be used."""
        ...


class Options(TypedDict):
    """How to calibrate; see `fitted`."""

    effort: Effort
    seed: np.random.SeedSequence
    checkpoints: Stages
    progress: Progress
    executor: NotRequired[Executor | None]
    start: NotRequired[Floats | None]


def calibrate(model: Model, name: str, **options: Unpack[Options]) -> Fit:
    """Calibrate a model, from where an interrupted run stopped.

    Parameters
    ----------
    model : Model
        What to calibrate.
    name : str
        Under which its chain is kept.
    **options
        As of `fitted`.
    """
    return Fit(model, *fitted(model, name, **options))


def fitted(
    model: Density,
    name: str,
    *,
    effort: Effort,
    seed: np.random.SeedSequence,
    checkpoints: Stages,
    progress: Progress,
    executor: Executor | None = None,
    start: Floats | None = None,
) -> tuple[Laplace, Evidence, Chain, Convergence]:
    """Calibrate any density: its mode, its evidence, and draws that are long enough or say so.

    Parameters
    ----------
    model : Density
        What to calibrate.
    name : str
        Under which its chain is kept.
    effort : Effort
        Of sampling.
    seed : SeedSequence
        Everything random comes from it.
    checkpoints : Stages
        Results of an interrupted run, or nothing.
    progress : Progress
        Shows R̂, effective sizes and the time left.
    executor : Executor, optional
        For the ensembles.
    start : array, optional
        A point near the mode.
    """
    approximation, chains = seed.spawn(2)
    progress.stage(f"{name}: mode and curvature")
    begun = checkpoints.load(f"begun-{name}")
    if begun is None:
        begun = _begun(model, approximation, effort.starts, executor=executor, start=start)
        checkpoints.save(f"begun-{name}", begun)
    laplace = Laplace(begun["mode"], begun["covariance"], float(begun["log_density"]))
    importance = Evidence(
        float(begun["log_evidence"]),
        float(begun["error"]),
        begun["draws"],
        begun["log_weights"],
        float(begun["effective"]),
    )
    store = checkpoints.chain(name)
    show = _Shown(name, effort, progress, store)
    chain = sample(
        model,
        importance,
        effort=effort,
        seed=chains,
        executor=executor,
        on_chunk=show,
        store=store,
    )
    diagnosis = diagnose(model, chain, effort, shares=begun["shares"].tolist())
    return laplace, importance, chain, diagnosis


class _Shown:
    """Shows how far sampling is: the share of the work, in hundredths, and the criteria."""

    def __init__(self, name: str, effort: Effort, progress: Progress, store: Pieces) -> None:
        self._effort, self._progress, self._store = effort, progress, store
        self._pace, self._shown = Pace(), 0.0
        progress.stage(f"{name}: sampling", total=100.0)

    def __call__(self, standing: Standing) -> None:
        left = steps_left(standing, self._effort)
        # while the moves are fitted, what is left is not known: it is not nothing
        share = 0.0 if np.isnan(left) else 100.0 * standing.steps / (standing.steps + left)
        done = max(share - self._shown, 0.0)
        self._shown += done
        self._progress.advance(done, "; ".join(part for part in self._notes(standing) if part))

    def _notes(self, standing: Standing) -> Iterator[str]:
        if self._store.damaged:
            names = ", ".join(path.name for path in self._store.damaged)
            yield f"damaged and computed again: {names}"
        if standing.enough(self._effort) and standing.resumed == standing.steps:
            yield "taken from the interrupted run"  # first: a narrow terminal cuts the rest
        if standing.kept == 0:
            yield f"fitting the moves, {standing.steps} steps"
        else:
            yield f"{standing.effective:.0f} effective draws, R-hat {standing.r_hat:.3f}"
        if not standing.enough(self._effort):
            yield words(self._pace.left(standing, self._effort))


def _begun(
    model: Density,
    seed: np.random.SeedSequence,
    starts: int,
    *,
    executor: Executor | None,
    start: Floats | None,
) -> dict[str, Floats]:
    """Find the mode, an importance sample, and the shares of separate modes."""
    generator = np.random.default_rng(seed)
    # one thread: the same bits whatever the machine's number of them
    with threadpool_limits(limits=1):
        if start is None and isinstance(model, Model):
            start = near_films(model, generator)
        laplace = approximate(model, generator, start=start)
        found, shares = about_mode(model, laplace, generator), [1.0]
        if starts > 0:
            modes = find_modes(model, generator, known=[laplace], starts=starts, executor=executor)
            if modes.warning:
                found, shares = modes.posterior, [mode.weight for mode in modes.modes]
                laplace = modes.modes[0].laplace
    return {
        "mode": laplace.mode,
        "covariance": laplace.covariance,
        "log_density": np.array(laplace.log_density),
        "log_evidence": np.array(found.log_evidence),
        "error": np.array(found.error),
        "draws": found.draws,
        "log_weights": found.log_weights,
        "effective": np.array(found.effective),
        "shares": np.array(shares),
    }
