"""Calibration of models: mode, importance sample and chains, with a time estimate."""

import math
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import NotRequired, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.actuator.reading import mechanics_of
from bayesdeg.criticism.fit.trials import CandidateFit, base_trial
from bayesdeg.criticism.posterior.convergence import Convergence, diagnose
from bayesdeg.inference.density import Density
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, Evidence, Laplace, approximate
from bayesdeg.inference.model import JointModel, near_films
from bayesdeg.inference.modes import find_modes
from bayesdeg.inference.sampling import EFFORTS, Chain, Effort, SamplerStatus, sample
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.checkpoints import Pieces, Stages
from bayesdeg.progress import Progress
from bayesdeg.surrogate.surrogate import Surrogate


def steps_left(standing: SamplerStatus, effort: Effort) -> float:
    """Return the estimated number of remaining steps, at most to the limit; nan if unknown.

    A new period starts with no kept steps, so the criteria may be met only in a later one.

    Examples
    --------
    >>> effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
    >>> steps_left(SamplerStatus(100, kept=50, effective=250.0, r_hat=1.02, times=5.0), effort)
    50.0
    >>> steps_left(SamplerStatus(100, kept=50, effective=200.0, r_hat=1.03, times=5.0), effort)
    250.0
    """
    wanted, done = standing.steps_wanted(effort), 0
    if math.isnan(wanted):
        return math.nan
    if standing.enough(effort):
        return 0.0
    first, *periods = effort.periods(settled=standing.settled)
    for looks in periods:
        kept = 0
        for look in looks:
            kept += look
            reached = sum(first) + done + kept
            if kept >= wanted and reached > standing.steps:
                return float(reached - standing.steps)
        done += kept
    return float(max(effort.longest - standing.steps, 0))


@dataclass(frozen=True)
class Pace:
    """Start of sampling, for the time of a step.

    Parameters
    ----------
    began : float
        Of a clock [s].
    """

    began: float = field(default_factory=time.perf_counter)

    def left(self, standing: SamplerStatus, effort: Effort) -> float:
        """Return the remaining seconds; nan if not known yet."""
        computed = standing.steps - standing.resumed
        if computed == 0:
            return math.nan
        return (time.perf_counter() - self.began) / computed * steps_left(standing, effort)


def words(seconds: float) -> str:
    """Format a time; empty if unknown.

    Examples
    --------
    >>> words(42.0), words(400.0), words(float("nan"))
    ('about 42 s left', 'about 7 min left', '')
    """
    if math.isnan(seconds):
        return ""
    return f"about {seconds:.0f} s left" if seconds < 90.0 else f"about {seconds / 60:.0f} min left"


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """A calibrated model.

    Parameters
    ----------
    model : JointModel
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

    model: JointModel
    laplace: Laplace
    evidence: Evidence
    chain: Chain
    diagnosis: Convergence


class Sampled(Protocol):
    """Any sampled density, such as a `Fit`."""

    @property
    def model(self) -> Density:
        """The sampled density."""
        ...

    @property
    def chain(self) -> Chain:
        """Posterior draws."""
        ...

    @property
    def diagnosis(self) -> Convergence:
        """Whether the draws are usable."""
        ...


class Options(TypedDict):
    """Settings of a calibration; see `fitted`."""

    effort: Effort
    seed: np.random.SeedSequence
    checkpoints: Stages
    progress: Progress
    executor: NotRequired[Executor | None]
    start: NotRequired[Floats | None]


def calibrate(model: JointModel, name: str, **options: Unpack[Options]) -> Fit:
    """Calibrate a model, resuming an interrupted run.

    Parameters
    ----------
    model : JointModel
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
    """Calibrate any density: mode, evidence, and draws with convergence diagnostics.

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
    """Shows progress of sampling: percentage of the work, and the criteria."""

    def __init__(self, name: str, effort: Effort, progress: Progress, store: Pieces) -> None:
        self._effort, self._progress, self._store = effort, progress, store
        self._pace, self._shown = Pace(), 0.0
        progress.stage(f"{name}: sampling", total=100.0)

    def __call__(self, standing: SamplerStatus) -> None:
        left = steps_left(standing, self._effort)
        # while the moves are fitted, the remaining work is unknown, not zero
        share = 0.0 if np.isnan(left) else 100.0 * standing.steps / (standing.steps + left)
        done = max(share - self._shown, 0.0)
        self._shown += done
        self._progress.advance(done, "; ".join(part for part in self._notes(standing) if part))

    def _notes(self, standing: SamplerStatus) -> Iterator[str]:
        if self._store.damaged:
            names = ", ".join(path.name for path in self._store.damaged)
            yield f"damaged, computed again: {names}"
        if standing.enough(self._effort) and standing.resumed == standing.steps:
            yield "resumed from the interrupted run"  # first: a narrow terminal cuts the rest
        if standing.kept == 0:
            yield f"tuning the proposals, {standing.steps} steps"
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
    # one thread: the same bits whatever the number of cores
    with threadpool_limits(limits=1):
        if start is None and isinstance(model, JointModel):
            start = near_films(model, generator)
        laplace = approximate(model, generator, start=start)
        found, shares = about_mode(model, laplace, generator), [1.0]
        if starts > 0:
            modes = find_modes(model, generator, known=[laplace], starts=starts, executor=executor)
            if len(modes.modes) > 1:
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


def awake() -> None:
    """Do nothing: makes a worker process import what calibrations need."""


def base_of(fit: Fit) -> CandidateFit:
    """Return the base trial of a calibrated model.

    Parameters
    ----------
    fit : Fit
        Its draws are those of the importance sample, or of the chain where that sample is poor.
    """
    known = fit.evidence if _enough(fit.evidence) else _of_chain(fit.evidence, fit.chain)
    return base_trial(fit.model, fit.laplace.mode, known)


def base_without_chain(
    model: JointModel, seed: np.random.SeedSequence, *, chain: bool = True
) -> CandidateFit:
    """Fit a base model as far as its verdict needs; sample a chain only if it is used.

    Parameters
    ----------
    model : JointModel
        With its readings.
    seed : SeedSequence
        Everything random comes from it.
    chain : bool
        Whether to sample one where the importance sample is poor.
    """
    approximation, chains = seed.spawn(2)
    generator = np.random.default_rng(approximation)
    laplace = approximate(model, generator, start=near_films(model, generator))
    known = about_mode(model, laplace, generator)
    if chain and not _enough(known):
        known = _of_chain(known, sample(model, known, effort=EFFORTS["quick"], seed=chains))
    return base_trial(model, laplace.mode, known)


def _enough(posterior: Evidence) -> bool:
    return posterior.effective >= FEWEST_EFFECTIVE


def _of_chain(posterior: Evidence, chain: Chain) -> Evidence:
    """Replace a poor importance sample by the draws of a chain."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    even = np.zeros(len(flat))
    return replace(posterior, draws=flat, log_weights=even, effective=float(len(flat)))


DRAWS = 400


class Listener:
    """A forward map that records its inputs.

    Parameters
    ----------
    forward : ForwardMap
        Gives the answers.
    """

    def __init__(self, forward: ForwardMap) -> None:
        self._forward = forward
        self.heard: list[Inputs] = []

    def __call__(self, inputs: Inputs) -> Prediction:
        """Evaluate the forward map."""
        self.heard.append(inputs)
        return self._forward(inputs)


def refused_inputs(fit: Fit) -> dict[str, str]:
    """Return the inputs of new specimens that the emulator refuses, in words by name.

    For draws from the posterior, each with new deviations of the specimens in the same tests.

    Parameters
    ----------
    fit : Fit
        Of a model with actuator readings; another forward map than an emulator refuses nothing.
    """
    forward = mechanics_of(fit.model.world.forward)
    if not isinstance(forward, Surrogate):
        return {}
    listener = Listener(forward)
    model = fit.model.with_world(forward=listener)
    values = model.table.named(fit.chain.spread(DRAWS))
    tests, kind = model.tests(values), model.data_of(Curvature)
    kind.predicted(tests, kind.drawn_deviations(tests, np.random.default_rng(0)))
    return forward.refusals(listener.heard[0])
