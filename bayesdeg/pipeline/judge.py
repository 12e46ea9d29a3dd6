"""The base fit becomes a verdict: misfit, causes, held-out specimens, decision."""

from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.candidates import Candidate, candidates
from bayesdeg.criticism.conflict import conflict
from bayesdeg.criticism.confusability import confusability
from bayesdeg.criticism.experiments import next_experiments_document, rank
from bayesdeg.criticism.experiments_candidates import candidate_experiments
from bayesdeg.criticism.held_out import HeldOut, by_level, joined, predict_folds
from bayesdeg.criticism.model_readings import Held, ModelReadings
from bayesdeg.criticism.rupture_misfit import rupture_misfit
from bayesdeg.criticism.search import Names, Search, SearchEffort, run_search
from bayesdeg.criticism.subject import Subject
from bayesdeg.criticism.trials import base_trial
from bayesdeg.criticism.verdict import Decision, Outcome, Support, decide, hold_out, supports
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, Evidence
from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.judgement import BASE, Judgement, extension, label
from bayesdeg.pipeline.progress import Progress

Floats = NDArray[np.float64]

JUDGE_EFFORTS = {
    "quick": SearchEffort(replicates=200, fitted=3, pairs=1, levels_out=False),
    "standard": SearchEffort(replicates=500, fitted=6, pairs=3, levels_out=True),
    "thorough": SearchEffort(replicates=2000, fitted=10, pairs=6, levels_out=True),
}
FEW_DRAWS = 100  # for what is compared beside the readings
BESIDE: tuple[Held, ...] = ("films", "statistics")
IN_QUESTION = 3  # rivals between which experiments are ranked


def judge(
    assembly: Assembly,
    fit: Fit,
    *,
    effort: SearchEffort,
    seed: np.random.SeedSequence,
    progress: Progress,
    executor: Executor | None = None,
) -> Judgement:
    """Judge the base fit of a study with readings of actuators or films.

    Parameters
    ----------
    assembly : Assembly
        Base model and candidates.
    fit : Fit
        Its calibration.
    effort : SearchEffort
        Replicates and trials.
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows each trial.
    executor : Executor, optional
        For trials and folds.
    """
    searching, folding, drawing = seed.spawn(3)
    generator = np.random.default_rng(drawing)
    search = _begun(assembly, fit, effort, searching, progress=progress, executor=executor)
    base = search.step(BASE)
    progress.stage("causes, one by one and together")
    chosen = run_search(search)
    final = search.step(chosen)
    draws = search.base.draws(generator, FEW_DRAWS)
    rupture = rupture_misfit(fit.model, draws, generator)
    contradicted = conflict(fit.model, draws)
    progress.stage("held-out specimens")
    held_out = hold_out(
        search,
        chosen,
        seed=folding,
        executor=executor,
        on_set=lambda names: progress.advance(1, label(names)),
    )
    everything = _all_held_out(search, chosen, held_out, seed=folding, executor=executor)
    supported = supports(search, chosen, everything)
    decision = decide(
        base,
        final,
        supported,
        rupture=rupture,
        contradicted=contradicted,
        on_rupture=_on_rupture(search),
    )
    names = extension(decision, tuple(supported)) if effort.levels_out else BASE
    judged = candidates(search, supported, everything, generator)
    return Judgement(
        misfit=base.misfit,
        left=final.misfit,
        rupture=rupture,
        contradicted=contradicted,
        candidates=(*judged, *_unjudged(assembly)),
        supported=tuple(supported),
        decision=decision,
        threshold=base.threshold,
        confusability=confusability(search.base.linear, search.causes, generator),
        held_out={label(names): found for names, found in held_out.items()},
        levels_out=_levels_out(search, names, seed=folding, executor=executor),
        search=search,
        experiments=_next(search, decision, supported, assembly, generator),
    )


def _all_held_out(
    search: Search,
    chosen: Names,
    actuators: dict[Names, HeldOut],
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None,
) -> dict[Names, HeldOut]:
    """Hold out films and means of replicates too, beside actuators.

    A model that is wrong for actuators is bent by them, and predicts them well; what bends it then
    is that it contradicts the films or the measured volume ratio.
    """
    subject = search.base.subject
    if not actuators or not isinstance(subject, ModelReadings) or subject.model.actuator is None:
        return actuators
    found = dict(actuators)
    for held in BESIDE:
        other = hold_out(search, chosen, seed=seed, of=partial(_holding, held), executor=executor)
        for names, beside in other.items():
            found[names] = joined(found[names], beside)
    return found


def _holding(held: Held, subject: Subject) -> Subject:
    assert isinstance(subject, ModelReadings)
    return replace(subject, held=held)


def _next(
    search: Search,
    decision: Decision,
    supported: list[Support],
    assembly: Assembly,
    generator: np.random.Generator,
) -> list[dict[str, object]]:
    """Rank what to measure next, to tell apart the models that are in question."""
    base = search.base
    assert isinstance(base.subject, ModelReadings)
    chosen = frozenset(one.cause for one in supported)
    untested: tuple[Cause, ...] = ()
    if decision.outcome is Outcome.ADEQUATE:
        return []
    if decision.outcome is Outcome.UNEXPLAINED:
        nearest = sorted(search.trials, key=search.factor)[-IN_QUESTION:]
        sets = dict.fromkeys([BASE, *nearest])
        untested = tuple(CATALOGUE[n] for n in assembly.unjudged if n in CATALOGUE)[:IN_QUESTION]
    else:
        others = {
            one.replaced(chosen, rival): gap
            for one in supported
            for rival, gap in one.rivals.items()
            if rival in one.inseparable or decision.outcome is Outcome.NAMED
        }
        near = sorted(others, key=lambda names: others[names])
        sets = dict.fromkeys([chosen, *(near[:IN_QUESTION] or [BASE])])
    trials = [search.trials[names] for names in sets]
    ranked = rank(trials, candidate_experiments(base.subject.model), generator, untested=untested)
    return next_experiments_document(ranked)


def _begun(
    assembly: Assembly,
    fit: Fit,
    effort: SearchEffort,
    seed: np.random.SeedSequence,
    *,
    progress: Progress,
    executor: Executor | None,
) -> Search:
    progress.stage("misfit, calibrated by simulation")
    return Search(
        base_trial(
            ModelReadings(fit.model),
            fit.laplace.mode,
            _posterior(fit),
            covariance=fit.laplace.covariance,
        ),
        assembly.candidates,
        effort,
        seed,
        executor=executor,
        on_fit=lambda names: progress.advance(1, names),
    )


def _on_rupture(search: Search) -> frozenset[str]:
    """Return the causes that act on rupture alone."""
    return frozenset(cause.name for cause in search.causes if cause.is_of_rupture_alone)


def _posterior(fit: Fit) -> Evidence:
    """Return the posterior's draws with the evidence: of the chain where the sample is poor."""
    if fit.evidence.effective >= FEWEST_EFFECTIVE:
        return fit.evidence
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    even = np.zeros(len(flat))
    return replace(fit.evidence, draws=flat, log_weights=even, effective=float(len(flat)))


def _levels_out(
    search: Search, names: Names, *, seed: np.random.SeedSequence, executor: Executor | None
) -> dict[str, HeldOut]:
    """Predict whole levels of degradation that were left out, if there are several."""
    fold = by_level(search.base.subject)
    if not names or fold.max() < 1:
        return {}
    return {
        label(one): predict_folds(search.trials[one], fold, seed=seed, executor=executor)
        for one in (BASE, names)
    }


def _unjudged(assembly: Assembly) -> list[Candidate]:
    return [
        Candidate(name, None, None, None, None, None, {}, fitted=False, why=why)
        for name, why in assembly.unjudged.items()
    ]
