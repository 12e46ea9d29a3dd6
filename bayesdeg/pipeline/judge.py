"""The base fit becomes a verdict: misfit, causes, held-out specimens, decision."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.candidates import Candidate, candidates
from bayesdeg.criticism.conflict import Conflict, Questioned, conflict, questioned
from bayesdeg.criticism.confusability import NOT_KNOWN, Confusability, confusability
from bayesdeg.criticism.discrepancy import too_few
from bayesdeg.criticism.experiments import next_experiments_document, rank
from bayesdeg.criticism.experiments_candidates import candidate_experiments
from bayesdeg.criticism.held_out import HeldOut
from bayesdeg.criticism.linear import neutral_sizes
from bayesdeg.criticism.model_readings import ModelReadings
from bayesdeg.criticism.rupture_misfit import RuptureMisfit, rupture_misfit
from bayesdeg.criticism.search import Names, Search, SearchEffort, run_search
from bayesdeg.criticism.shared_scatter import SharedScatter, shared_scatter
from bayesdeg.criticism.side_by_side import later
from bayesdeg.criticism.step import Step
from bayesdeg.criticism.support import Support, supports
from bayesdeg.criticism.trials import Trial, try_causes
from bayesdeg.criticism.verdict import Decision, Outcome, decide, uncalibrated
from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.holding_out import held_out_and_all, levels_out
from bayesdeg.pipeline.judgement import BASE, Judgement, extension, label
from bayesdeg.pipeline.progress import Progress
from bayesdeg.report.left_out import Guard, Stage

JUDGE_EFFORTS = {
    "quick": SearchEffort(replicates=200, fitted=3, pairs=1, levels_out=False),
    "standard": SearchEffort(replicates=500, fitted=6, pairs=3, levels_out=True),
    "thorough": SearchEffort(replicates=2000, fitted=10, pairs=6, levels_out=True),
}
MOST_OF_FILMS = 20_000  # replicates where a p-value is near the level: films cost next to nothing
FEW_DRAWS = 100  # for what is compared beside the readings
REFUTING = (Stage.HELD_OUT, Stage.SHARED_SCATTER)  # tests that a cause must pass to be named
Beside = tuple[RuptureMisfit | None, Conflict | None, tuple[Questioned, ...]]
IN_QUESTION = 3  # rivals between which experiments are ranked


def judge(
    assembly: Assembly,
    base: Trial,
    *,
    effort: SearchEffort,
    seed: np.random.SeedSequence,
    progress: Progress,
    executor: Executor | None = None,
    guard: Guard | None = None,
) -> Judgement:
    """Judge the base model of a study with readings of actuators or films.

    Parameters
    ----------
    assembly : Assembly
        Base model and candidates.
    base : Trial
        The base model, calibrated.
    effort : SearchEffort
        Replicates and trials.
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows each trial.
    executor : Executor, optional
        For trials and folds.
    guard : Guard, optional
        Leaves out what fails; by default nothing is left out and faults are raised.
    """
    guard = guard or Guard(strict=True)
    searching, folding, drawing = seed.spawn(3)
    generator = np.random.default_rng(drawing)
    search = Search(base, assembly.candidates, _on(assembly, effort), searching, executor=executor)
    search.on_fit = partial(progress.advance, 1)
    rupture, confused = _begun(search, generator)
    chosen, alone, final = _searched(search, progress)
    beside = _beside(base, rupture, generator, guard)
    held_out, everything = _held_out(search, chosen, folding, progress, guard)
    supported = supports(search, chosen, everything)
    shared = guard.attempt(Stage.SHARED_SCATTER, shared_scatter, final.trial, final.simulated) or []
    decision = _decided((alone, final), supported, beside, assembly, shared, guard)
    names = extension(decision, tuple(supported)) if effort.levels_out else BASE
    judged = candidates(search, supported, everything, generator)
    return Judgement(
        misfit=alone.misfit,
        left=final.misfit,
        rupture=beside[0],
        contradicted=beside[1],
        questioned=beside[2],
        candidates=(*judged, *_unjudged(assembly)),
        supported=tuple(supported),
        decision=decision,
        threshold=alone.threshold,
        confusability=guard.attempt(Stage.CONFUSABILITY, confused) or NOT_KNOWN,
        held_out={label(names): found for names, found in held_out.items()},
        levels_out=_levels_out(search, names, folding, guard),
        search=search,
        shared=tuple(shared),
        experiments=guard.attempt(
            Stage.EXPERIMENTS, _next, search, decision, supported, assembly, generator
        )
        or [],
        alike=tuple(cause.name for cause in assembly.alike),
    )


def _on(assembly: Assembly, effort: SearchEffort) -> SearchEffort:
    """Return the effort with as many replicates as p-values near the level may need of films."""
    return replace(effort, most=MOST_OF_FILMS) if assembly.model.actuator is None else effort


def _searched(search: Search, progress: Progress) -> tuple[Names, Step, Step]:
    """Return what the data support, and what is known without a cause and with all of that."""
    progress.stage("misfit, calibrated by simulation")
    alone = search.step(BASE)
    progress.stage("causes, one by one and together")
    chosen = run_search(search)
    return chosen, alone, search.step(chosen)


def _held_out(
    search: Search,
    chosen: Names,
    seed: np.random.SeedSequence,
    progress: Progress,
    guard: Guard,
) -> tuple[dict[Names, HeldOut], dict[Names, HeldOut]]:
    """Return what `held_out_and_all` does; nothing where it could not be computed."""
    progress.stage("held-out specimens")
    found = guard.attempt(
        Stage.HELD_OUT,
        held_out_and_all,
        search,
        chosen,
        seed=seed,
        executor=search.executor,
        on_set=partial(_told, progress),
    )
    return found or ({}, {})


def _levels_out(
    search: Search, names: Names, seed: np.random.SeedSequence, guard: Guard
) -> dict[str, HeldOut]:
    """Return what `levels_out` does; nothing where it could not be computed."""
    found = guard.attempt(
        Stage.LEVELS_OUT, levels_out, search, names, seed=seed, executor=search.executor
    )
    return found or {}


def _told(progress: Progress, names: Names) -> None:
    progress.advance(1, label(names))


def _begun(
    search: Search, generator: np.random.Generator
) -> tuple[Callable[[], RuptureMisfit | None], Callable[[], Confusability]]:
    """Begin what rests on the base model alone, beside the search; the calls return what it is."""
    base = search.base
    assert isinstance(base.subject, ModelReadings)
    first, second, drawing = generator.spawn(3)
    draws = base.draws(drawing, FEW_DRAWS)
    return (
        later(partial(rupture_misfit, base.subject.model, draws, first), search.executor),
        later(partial(confusability, base.linear, search.causes, second), search.executor),
    )


def _beside(
    base: Trial,
    begun: Callable[[], RuptureMisfit | None],
    generator: np.random.Generator,
    guard: Guard,
) -> Beside:
    """Return what the base model makes of ruptures, of measured means, and of the priors."""
    assert isinstance(base.subject, ModelReadings)
    model, draws = base.subject.model, base.draws(generator, FEW_DRAWS)
    rupture = guard.attempt(Stage.RUPTURE_MISFIT, begun)
    if rupture is not None and np.isnan(rupture.p_value):
        few = too_few(rupture.known, rupture.drawn)
        guard.note(Stage.RUPTURE_MISFIT, f"The verdict takes no notice of ruptures: {few}.")
        rupture = None
    contradicted = guard.attempt(Stage.CONFLICT, conflict, model, draws)
    off_prior = guard.attempt(Stage.CONFLICT, questioned, model, draws) or ()
    return rupture, contradicted, off_prior


def _decided(
    steps: tuple[Step, Step],
    supported: list[Support],
    beside: Beside,
    assembly: Assembly,
    shared: list[SharedScatter],
    guard: Guard,
) -> Decision:
    if not steps[0].misfit.is_calibrated:
        why = uncalibrated(steps[0].misfit)
        guard.note(Stage.CALIBRATION, f"Whether the base model is adequate is not known: {why}.")
    silent = frozenset(cause.name for cause in assembly.candidates if cause.is_of_rupture_alone)
    return decide(
        *steps,
        supported,
        rupture=beside[0],
        contradicted=beside[1],
        questioned=beside[2],
        on_rupture=silent,
        alike=tuple(cause.name for cause in assembly.alike),
        shared=shared,
        untested=[_untested(s, guard) for s in REFUTING if s in guard.stages],
    )


def _untested(stage: Stage, guard: Guard) -> str:
    """Say that a test which might have refuted a cause could not be made."""
    return f"{stage}: {guard.why(stage)}".removesuffix(".")


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
    if decision.outcome is Outcome.NOT_JUDGED and not supported:
        return []
    if decision.outcome is Outcome.UNEXPLAINED:
        nearest = sorted(search.trials, key=search.factor)[-IN_QUESTION:]
        sets = dict.fromkeys([BASE, *nearest])
        untested = tuple(CATALOGUE[n] for n in assembly.unjudged if n in CATALOGUE)[:IN_QUESTION]
    elif not supported:
        return _beside_the_law(base, assembly, generator)
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
    ranked = rank(
        trials,
        candidate_experiments(base.subject.model),
        generator,
        untested=untested,
        executor=search.executor,
    )
    return next_experiments_document(ranked)


def _beside_the_law(
    base: Trial, assembly: Assembly, generator: np.random.Generator
) -> list[dict[str, object]]:
    """Rank what would show causes that read like another form of the law in the tests so far."""
    trials = [try_causes(base, c, neutral_sizes(c), generator) for c in assembly.alike]
    ranked = rank([base, *trials], candidate_experiments(assembly.model), generator)
    return next_experiments_document(ranked)


def _unjudged(assembly: Assembly) -> list[Candidate]:
    return [
        Candidate(name, None, None, None, None, None, {}, fitted=False, why=why)
        for name, why in assembly.unjudged.items()
    ]
