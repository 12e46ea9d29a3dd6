"""The base fit becomes a verdict: misfit, candidates, held-out specimens, decision."""

from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.catalogue import find
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.discrepancy import Misfit, explained, measure, replicate, statistic_of
from bayesdeg.criticism.gain import HeldOut, difference, predict_held_out
from bayesdeg.criticism.linear import (
    Linear,
    linearise,
    most_probable_size,
    sensitivities,
    with_neutral,
)
from bayesdeg.criticism.verdict import (
    Candidate,
    Decision,
    EffectSize,
    confusable_pairs,
    decide,
    naming_threshold,
)
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, Evidence, approximate, weighted
from bayesdeg.inference.model import Model
from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.progress import Progress

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class JudgeEffort:
    """What judging may cost.

    Parameters
    ----------
    replicates : int
        Data sets simulated to calibrate misfit and naming.
    tested : int
        Candidates that are tried on held-out specimens.
    """

    replicates: int
    tested: int


JUDGE_EFFORTS = {
    "quick": JudgeEffort(replicates=200, tested=1),
    "standard": JudgeEffort(replicates=500, tested=2),
    "thorough": JudgeEffort(replicates=2000, tested=6),
}


@dataclass(frozen=True)
class Judgement:
    """Everything that the verdict rests on.

    Parameters
    ----------
    misfit : Misfit
        Of the base model.
    candidates : tuple of Candidate
        All that were tried, best first.
    decision : Decision
        Outcome and causes.
    threshold : float
        Log Bayes factor needed to be named.
    confusable : list of (str, str)
        Pairs that these readings cannot tell apart.
    held_out : dict of str to HeldOut
        By name of the model, ``base`` first.
    """

    misfit: Misfit
    candidates: tuple[Candidate, ...]
    decision: Decision
    threshold: float
    confusable: list[tuple[str, str]]
    held_out: dict[str, HeldOut]


@dataclass(frozen=True)
class _Trial:
    cause: Cause
    model: Model
    mode: Floats
    log_bayes_factor: float
    explained: float
    posterior: Evidence


def judge(
    assembly: Assembly,
    fit: Fit,
    *,
    effort: JudgeEffort,
    seed: np.random.SeedSequence,
    progress: Progress,
    executor: Executor | None = None,
) -> Judgement:
    """Judge the base fit of a study with actuator readings.

    Parameters
    ----------
    assembly : Assembly
        Base model and candidates.
    fit : Fit
        Its calibration.
    effort : JudgeEffort
        Replicates and held-out trials.
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows each trial.
    executor : Executor, optional
        For the folds.
    """
    first, folds, trials_seed = seed.spawn(3)
    generator = np.random.default_rng(first)
    progress.stage("misfit, calibrated by simulation")
    linear = linearise(fit.model, fit.laplace.mode)
    misfit = measure(linear, fit.chain, generator, replicates=effort.replicates)
    simulated = replicate(linear, fit.chain, generator, effort.replicates)
    causes = assembly.candidates
    threshold = naming_threshold(linear, causes, simulated) if causes else np.inf
    progress.stage("candidates", total=len(causes))
    trials = []
    for cause, child in zip(causes, trials_seed.spawn(len(causes)), strict=True):
        trials.append(_try(cause, fit, linear, misfit, np.random.default_rng(child)))
        progress.advance(1, cause.name)
    trials.sort(key=lambda trial: -trial.log_bayes_factor)
    tested = [t for t in trials if t.log_bayes_factor > 0.0][: effort.tested]
    progress.stage("held-out specimens", total=1 + len(tested))
    held_out = {
        "base": predict_held_out(fit.model, fit.laplace.mode, seed=folds, executor=executor)
    }
    progress.advance(1, "base")
    for trial in tested:
        name = f"base+{trial.cause.name}"
        held_out[name] = predict_held_out(trial.model, trial.mode, seed=folds, executor=executor)
        progress.advance(1, trial.cause.name)
    candidates = [_candidate(t, held_out, np.random.default_rng(trials_seed)) for t in trials]
    unjudged = [
        Candidate(name, None, None, None, None, {}, why) for name, why in assembly.unjudged.items()
    ]
    return Judgement(
        misfit,
        (*candidates, *unjudged),
        decide(candidates, misfit, threshold),
        threshold,
        confusable_pairs(linear, causes),
        held_out,
    )


def _try(
    cause: Cause, fit: Fit, linear: Linear, misfit: Misfit, generator: np.random.Generator
) -> _Trial:
    """Fit the model extended by one cause and compare it with the base model."""
    model = fit.model.extended(cause)
    start = with_neutral(fit.laplace.mode, fit.model, cause)
    columns = sensitivities(linear, cause)
    where = [model.table.names.index(cause.qualified(p.name)) for p in cause.parameters]
    guess = start.copy()
    guess[where] += most_probable_size(linear.observed, columns, cause)
    both = np.stack([start, guess])
    best = both[int(np.argmax(model.log_prob(both, truncate=False)))]
    laplace = approximate(model, generator, start=best)
    posterior = about_mode(model, laplace, generator)
    factor = posterior.log_evidence - fit.evidence.log_evidence
    if posterior.effective < FEWEST_EFFECTIVE:
        posterior = _from_prior(model, cause, fit, generator)
        factor = posterior.log_evidence
    # the mode, or where that is outside the bounds of a prior, the most probable draw
    points = np.vstack([laplace.mode, posterior.draws])
    top = points[int(np.argmax(model.log_prob(points)))]
    after = replace(misfit, statistic=statistic_of(linearise(model, top)))
    return _Trial(cause, model, top, factor, explained(misfit, after), posterior)


def _from_prior(
    model: Model, cause: Cause, fit: Fit, generator: np.random.Generator, draws: int = 3000
) -> Evidence:
    """Average the likelihood ratio over the base posterior and the cause's prior.

    Its mean is the Bayes factor itself; it serves where the mode lies outside the prior, as for
    an effect of the wrong sign.
    """
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    known = flat[generator.integers(len(flat), size=draws)]
    base = dict(zip(fit.model.table.names, known.T, strict=True))
    prior = {
        cause.qualified(p.name): p.law.to_unconstrained(p.law.sample(generator, draws))
        for p in cause.parameters
    }
    points = np.stack([(base | prior)[name] for name in model.table.names], axis=1)
    own = model.table.log_prior(points) - fit.model.table.log_prior(known)
    ratio = model.log_prob(points) - fit.model.log_prob(known) - own
    return weighted(points, ratio)


def _candidate(
    trial: _Trial, held_out: dict[str, HeldOut], generator: np.random.Generator
) -> Candidate:
    name = f"base+{trial.cause.name}"
    gain = difference(held_out[name], held_out["base"]) if name in held_out else (None, None)
    return Candidate(
        cause=trial.cause.name,
        log_bayes_factor=max(trial.log_bayes_factor, -1e3),
        explained_fraction=trial.explained,
        elpd_diff=gain[0],
        elpd_diff_se=gain[1],
        effect=_effects(trial, generator),
    )


def _effects(trial: _Trial, generator: np.random.Generator) -> dict[str, EffectSize]:
    if trial.posterior.effective == 0.0:
        return {}
    values = trial.model.table.named(trial.posterior.resample(generator, 2000))
    return {
        p.name: effect_size(values[trial.cause.qualified(p.name)], p.unit)
        for p in trial.cause.parameters
    }


def effect_size(draws: Floats, unit: str) -> EffectSize:
    """Summarise posterior draws of one parameter of a cause."""
    low, high = np.quantile(draws, [0.05, 0.95])
    return EffectSize(float(np.mean(draws)), float(np.std(draws)), float(low), float(high), unit)


def extended_model(assembly: Assembly, fit: Fit, decision: Decision) -> tuple[Model, Floats] | None:
    """Return the model with the leading cause, and a start for its mode; None if none is named."""
    if not decision.causes:
        return None
    cause = next(c for c in assembly.candidates if c.name == decision.causes[0])
    return fit.model.extended(cause), with_neutral(fit.laplace.mode, fit.model, cause)


def with_sampled_sizes(judgement: Judgement, final: Fit) -> Judgement:
    """Replace the leading cause's effect by that of its sampled posterior."""
    name = judgement.decision.causes[0]
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    values = final.model.table.named(flat)
    cause = find(name)
    sizes = {p.name: effect_size(values[cause.qualified(p.name)], p.unit) for p in cause.parameters}
    candidates = tuple(
        replace(c, effect=sizes) if c.cause == name else c for c in judgement.candidates
    )
    return replace(judgement, candidates=candidates)
