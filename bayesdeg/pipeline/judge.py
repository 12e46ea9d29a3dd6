"""The base fit becomes a verdict: misfit, causes, held-out specimens, decision."""

from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.candidates import Candidate, candidates, effect_size
from bayesdeg.criticism.confusability import Confusability, confusability
from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.experiments import next_experiments_document, rank
from bayesdeg.criticism.experiments_candidates import candidate_experiments
from bayesdeg.criticism.held_out import HeldOut, by_level, predict_folds, predict_one_by_one
from bayesdeg.criticism.model_readings import CURVATURE, ModelReadings
from bayesdeg.criticism.rupture_misfit import RuptureMisfit, rupture_misfit
from bayesdeg.criticism.search import Names, Search, SearchEffort, Step, run_search
from bayesdeg.criticism.trials import base_trial
from bayesdeg.criticism.verdict import INSEPARABLE, Decision, Outcome, Support, decide, supports
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, Evidence
from bayesdeg.inference.model import Model
from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.progress import Progress

Floats = NDArray[np.float64]

BASE: Names = frozenset()
JUDGE_EFFORTS = {
    "quick": SearchEffort(replicates=200, fitted=3, pairs=1, levels_out=False),
    "standard": SearchEffort(replicates=500, fitted=6, pairs=3, levels_out=True),
    "thorough": SearchEffort(replicates=2000, fitted=10, pairs=6, levels_out=True),
}
RUPTURE_DRAWS = 100
IN_QUESTION = 3  # rivals between which experiments are ranked


@dataclass(frozen=True)
class Judgement:
    """Everything that the verdict rests on.

    Parameters
    ----------
    misfit, left : Misfit
        Of the base model, and of the one with all causes that the evidence favours.
    rupture : RuptureMisfit or None
        Whether the base model expects the ruptures; None where there are none to judge.
    candidates : tuple of Candidate
        All that were tried, best first.
    supported : tuple of Support
        What speaks for those that the evidence favours.
    decision : Decision
        Outcome and causes.
    threshold : float
        Log Bayes factor needed to be named.
    confusability : Confusability
        What this study could not tell apart.
    held_out, levels_out : dict of str to HeldOut
        Specimens, and whole levels, that took no part; by name of the model, ``base`` first.
    search : Search
        The fitted sets of causes.
    experiments : list
        What to measure next, as in ``verdict.json``.
    """

    misfit: Misfit
    left: Misfit
    rupture: RuptureMisfit | None
    candidates: tuple[Candidate, ...]
    supported: tuple[Support, ...]
    decision: Decision
    threshold: float
    confusability: Confusability
    held_out: dict[str, HeldOut]
    levels_out: dict[str, HeldOut]
    search: Search
    experiments: list[dict[str, object]]

    @property
    def steps(self) -> tuple[Step, Step]:
        """What is known of the base model, and with all that the evidence favours."""
        chosen = frozenset(one.cause for one in self.supported)
        return self.search.step(BASE), self.search.step(chosen)


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
    rupture = rupture_misfit(fit.model, search.base.draws(generator, RUPTURE_DRAWS), generator)
    progress.stage("held-out specimens")
    held_out = _hold_out(search, chosen, seed=folding, progress=progress, executor=executor)
    supported = supports(search, chosen, held_out)
    decision = decide(base, final, supported, rupture=rupture, on_rupture=_on_rupture(search))
    names = extension(decision, tuple(supported)) if effort.levels_out else BASE
    judged = candidates(search, supported, held_out, generator)
    return Judgement(
        misfit=base.misfit,
        left=final.misfit,
        rupture=rupture,
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
            chosen - {one.cause} | {rival}: gap
            for one in supported
            for rival, gap in one.rivals.items()
            if gap < INSEPARABLE or decision.outcome is Outcome.NAMED
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
        base_trial(ModelReadings(fit.model), fit.laplace.mode, _posterior(fit)),
        assembly.candidates,
        effort,
        seed,
        executor=executor,
        on_fit=lambda names: progress.advance(1, names),
    )


def _on_rupture(search: Search) -> frozenset[str]:
    """Return the causes that act on rupture alone."""
    return frozenset(cause.name for cause in search.causes if cause.acts_on == {"rupture"})


def label(names: Names) -> str:
    """Return the name of a model in tables.

    Examples
    --------
    >>> label(frozenset({"gravity", "creep"}))
    'base+creep+gravity'
    """
    return "+".join(("base", *sorted(names)))


def extended_model(judgement: Judgement) -> tuple[Model, Floats] | None:
    """Return the model with the named causes, or the leading one; None if there is none."""
    names = extension(judgement.decision, judgement.supported)
    if not names:
        return None
    trial = judgement.search.trials[names]
    assert isinstance(trial.subject, ModelReadings)
    return trial.subject.model, trial.mode


def extension(decision: Decision, supported: tuple[Support, ...]) -> Names:
    """Return the causes that join the final model: all that the evidence favours, if any is named.

    Of inseparable ones the best joins: predictions are nearly the same with each.
    """
    return frozenset(one.cause for one in supported) if decision.causes else BASE


def readings_misfit(judgement: Judgement) -> tuple[float | None, float | None]:
    """Return RMS residuals of the curvatures under the base model, and what is left [1/m].

    What is left after all that the evidence favours, and a smooth discrepancy, are taken off: the
    scatter of specimens and the errors of reading. None where there are no curvatures.
    """
    search = judgement.search
    rows = search.base.subject.places.kind == CURVATURE
    if not rows.any():
        return None, None
    chosen = search.step(frozenset(one.cause for one in judgement.supported))
    found = []
    for trial, explained in (
        (search.base, np.zeros(len(rows))),
        (chosen.trial, chosen.misfit.discrepancy),
    ):
        residual = trial.subject.observed - trial.linear.prediction - explained
        found.append(float(np.sqrt(np.mean(residual[rows] ** 2))))
    return found[0], found[1]


def with_sampled_sizes(judgement: Judgement, final: Fit) -> Judgement:
    """Replace the effects of the final model's causes by those of its sampled posterior."""
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    values = final.model.table.named(flat)
    sizes = {
        cause.name: {
            p.name: effect_size(values[cause.qualified(p.name)], p.unit) for p in cause.parameters
        }
        for cause in map(find, extension(judgement.decision, judgement.supported))
    }
    found = tuple(
        replace(c, effect=sizes[c.cause]) if c.cause in sizes else c for c in judgement.candidates
    )
    return replace(judgement, candidates=found)


def _posterior(fit: Fit) -> Evidence:
    """Return the posterior's draws with the evidence: of the chain where the sample is poor."""
    if fit.evidence.effective >= FEWEST_EFFECTIVE:
        return fit.evidence
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    even = np.zeros(len(flat))
    return replace(fit.evidence, draws=flat, log_weights=even, effective=float(len(flat)))


def _hold_out(
    search: Search,
    chosen: Names,
    *,
    seed: np.random.SeedSequence,
    progress: Progress,
    executor: Executor | None,
) -> dict[Names, HeldOut]:
    """Predict held-out specimens with the set, without each of its causes, and with none."""
    if len(search.base.subject.groups) < 2:
        return {}
    sets = dict.fromkeys([BASE, *(chosen - {name} for name in sorted(chosen)), chosen])
    found = {}
    for names in sets:
        found[names] = predict_one_by_one(search.trials[names], seed=seed, executor=executor)
        progress.advance(1, label(names))
    return found


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
