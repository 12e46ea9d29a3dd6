"""The judgement of a base model, and the final model that follows from it."""

from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.between_terms import term_trials
from bayesdeg.analysis.calibrate import Fit, base_without_chain
from bayesdeg.analysis.designs import candidate_experiments
from bayesdeg.analysis.refuting import (
    BASE,
    REFUTING,
    Refuted,
    RefutingTests,
    label,
    terms_of,
    why_refuted,
)
from bayesdeg.assembly.assemble import Assembly
from bayesdeg.causes.catalogue import CATALOGUE, mechanism_of
from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.checks.absorption import Absorption, absorption
from bayesdeg.criticism.checks.conflict import conflict, questioned
from bayesdeg.criticism.checks.count_misfit import (
    OWN,
    PUBLISHED,
    CountMisfit,
    can_be_counted,
    count_misfit,
    own_counts,
    rupture_misfit,
)
from bayesdeg.criticism.checks.detectable import detectable_causes, detectable_misfit
from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.checks.misfit_columns import misfit_columns
from bayesdeg.criticism.checks.missing_terms import MissingTerms
from bayesdeg.criticism.checks.plausible_errors import implausible_errors
from bayesdeg.criticism.checks.shared_scatter import SharedScatter, shared_scatter
from bayesdeg.criticism.decide.alternatives import StatedSets
from bayesdeg.criticism.decide.candidates import (
    NOT_KNOWN,
    Confusability,
    candidates,
    confusability,
    effect_size,
)
from bayesdeg.criticism.decide.counted import Counted, CountedCause, judge_counts
from bayesdeg.criticism.decide.support import Support, support_without_rivals
from bayesdeg.criticism.decide.verdict import (
    CoarseMap,
    Decision,
    NotComputed,
    NotConverged,
    decide,
    uncalibrated,
)
from bayesdeg.criticism.experiments.ranking import (
    ActuatorTests,
    Experiment,
    next_experiments_document,
    rank,
)
from bayesdeg.criticism.findings import (
    Candidate,
    ColumnMisfit,
    Conflict,
    Detectable,
    ExperimentEntry,
    Questioned,
    RuptureMisfit,
)
from bayesdeg.criticism.fit.linear import neutral_sizes
from bayesdeg.criticism.fit.search import Names, Search, SearchEffort, Step, run_search
from bayesdeg.criticism.fit.side_by_side import later
from bayesdeg.criticism.fit.trials import CandidateFit, try_causes
from bayesdeg.criticism.holdout.held_out import HeldOut, by_level, in_folds, run_folds
from bayesdeg.criticism.outcome import MISFIT_LEVEL, Outcome
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.curvature import CURVATURE, Curvature
from bayesdeg.pages.left_out import Guard, OptionalStage
from bayesdeg.pages.wording import sentences, worded
from bayesdeg.progress import Progress, Silent

Floats = NDArray[np.float64]

DRAWS = 4000  # draws for the reliable value of a parameter


@dataclass(frozen=True)
class Judgement:
    """The results behind a verdict.

    Parameters
    ----------
    misfit, left : Misfit
        Of the base model, and of the one with all causes that the evidence favours.
    rupture : RuptureMisfit or None
        Whether the base model expects the ruptures; None where there are none to judge.
    counted : Counted or None
        How probable published counts of ruptures are, and what explains them; None without any.
    own_counts : CountMisfit or None
        How probable the number of the study's own actuators that burst is.
    missing : Description, optional
        What the misfit looks like, where no cause accounts for it.
    counts_fitted : bool
        Whether the cause that explains published counts is part of the model that predicts.
    contradicted : Conflict or None
        The measured mean that the base model contradicts most; None where none was measured.
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
    experiments : tuple of ExperimentEntry
        What to measure next, as in ``verdict.json``.
    alike : tuple of str
        Causes that could not be judged since another form of the law reads like them.
    shared : tuple of SharedScatter
        Whether specimens that the favoured causes let scatter one by one deviate level by level.
    questioned : tuple of Questioned
        Parameters that the base model takes far off their priors.
    absorbed : Absorption or None
        What the base model's parameters took up; None where that could not be computed.
    sampled : bool
        Whether the model with the causes was calibrated, so that predictions are made with it.
    stated : StatedSets or None
        Which sets of causes of the readings may be right; None where the evidence favours none, or
        it could not be computed.
    detectable : Detectable or None
        The smallest detectable misfit; None if unknown.
    refuted : mapping of frozenset of str to tuple of Reason
        Sets of causes within odds of 20 of the best that a test refuted, and why.
    """

    misfit: Misfit
    left: Misfit
    rupture: RuptureMisfit | None
    contradicted: Conflict | None
    candidates: tuple[Candidate, ...]
    supported: tuple[Support, ...]
    decision: Decision
    threshold: float
    confusability: Confusability
    held_out: dict[str, HeldOut]
    levels_out: dict[str, HeldOut]
    search: Search
    experiments: tuple[ExperimentEntry, ...]
    alike: tuple[str, ...] = ()
    shared: tuple[SharedScatter, ...] = ()
    questioned: tuple[Questioned, ...] = ()
    sampled: bool = True
    counted: Counted | None = None
    own_counts: CountMisfit | None = None
    counts_fitted: bool = True
    absorbed: Absorption | None = None
    missing: "Description | None" = None
    stated: StatedSets | None = None
    detectable: Detectable | None = None
    refuted: Refuted = field(default_factory=dict)

    @property
    def predicted_with(self) -> tuple[str, ...]:
        """Causes in the predictive model."""
        if not self.sampled:
            return ()
        fitted = self.of_counts if self.counts_fitted else None
        of_counts = () if fitted is None else (fitted.name,)
        return tuple(sorted((*self.of_readings, *of_counts)))

    @property
    def of_readings(self) -> Names:
        """Causes in the predictive model that the readings show."""
        return extension(self.decision, self.supported)

    @property
    def of_counts(self) -> CountedCause | None:
        """The cause that explains published counts, if decided."""
        found = None if self.counted is None else self.counted.best
        spoken_for = {*self.decision.causes, *(n for one in self.decision.one_of for n in one)}
        return found if found is not None and found.name in spoken_for else None

    @property
    def chosen(self) -> Names:
        """The set of causes that the evidence favours."""
        return frozenset(one.cause for one in self.supported)

    @property
    def steps(self) -> tuple[Step, Step]:
        """Tests of the base model, and of the model with all favoured causes."""
        return self.search.step(BASE), self.search.step(self.chosen)

    @property
    def possible(self) -> tuple[Names, ...]:
        """Sets of causes that may be right, the favoured one first; none if a misfit is left."""
        if self.decision.outcome in (Outcome.UNEXPLAINED, Outcome.NOT_JUDGED):
            return ()
        if not self.decision.causes:
            return (BASE,)
        if self.left.p_value <= MISFIT_LEVEL:
            return ()
        others = [one.replaced(self.chosen, r) for one in self.supported for r in one.inseparable]
        further = [] if self.stated is None else [m.names for m in self.stated.members if m.fitted]
        return tuple(dict.fromkeys((self.chosen, *others, *further)))

    def draws(self, name: str, generator: np.random.Generator) -> Floats:
        """Draw a base parameter, averaged over the sets that may be right by their evidence.

        Empty if no set may be right: then no value of the parameter is reliable.
        """
        if not self.possible:
            return np.empty(0)
        factors = np.array([self.search.factor(names) for names in self.possible])
        weights = np.exp(factors - factors.max())
        counts = generator.multinomial(DRAWS, weights / weights.sum())
        found = [
            self.search.trials[names].named_draws(name, generator, count=count)
            for names, count in zip(self.possible, counts, strict=True)
        ]
        return np.concatenate(found)


@dataclass(frozen=True)
class Description:
    """Description of a misfit that no cause accounts for.

    Parameters
    ----------
    step : Step
        The model whose misfit it is: the base model, or with the causes that are named.
    found : MissingTerms
        The terms in known quantities that would remove it.
    columns : tuple of ColumnMisfit
        In which columns it sits.
    experiments : tuple of ExperimentEntry
        What would tell the best terms apart, as in ``verdict.json``.
    """

    step: Step
    found: MissingTerms
    columns: tuple[ColumnMisfit, ...]
    experiments: tuple[ExperimentEntry, ...] = ()

    @property
    def chief(self) -> ColumnMisfit | None:
        """The column with the largest share; of similar ones, that with the fewest levels.

        A column with many levels, such as specimens, absorbs what one with few levels explains as
        well.
        """
        largest = max((one.share_of_misfit for one in self.columns), default=0.0)
        near = [one for one in self.columns if one.share_of_misfit >= MOSTLY * largest]
        return min(near, key=lambda one: len(one.levels), default=None)


def extended_model(judgement: Judgement) -> tuple[JointModel, Floats] | None:
    """Return the model with the named or leading causes; None if there are none.

    If a cause explains rupture counts, these are part of its data.
    """
    counted = judgement.of_counts
    if counted is not None:
        return counted.trial.subject, counted.trial.mode
    names = extension(judgement.decision, judgement.supported)
    if not names:
        return None
    trial = judgement.search.trials[names]
    return trial.subject, trial.mode


def extension(decision: Decision, supported: tuple[Support, ...]) -> Names:
    """Return the causes of the final model: all that the evidence favours, if any is named.

    Of inseparable causes the best is used. It predicts the readings as well as the others, but may
    differ elsewhere: a wrong scale and thicker walls give the same curvatures but different bend
    angles. Reports of ambiguous outcomes therefore say which one they use.
    """
    return frozenset(one.cause for one in supported) if decision.causes else BASE


def readings_misfit(
    judgement: Judgement, kind: str = CURVATURE
) -> tuple[float | None, float | None]:
    """Return rms residuals of one kind of reading under the base model, and the noise.

    The noise is what remains after all favoured causes and a smooth discrepancy: specimen scatter
    and reading errors. In the unit of the kind (1/m, MPa); None if it was not read.
    """
    search = judgement.search
    rows = search.base.subject.places.kind == kind
    if not rows.any():
        return None, None
    chosen = judgement.steps[1]
    found = []
    for trial, explained in (
        (search.base, np.zeros(len(rows))),
        (chosen.trial, chosen.misfit.discrepancy),
    ):
        residual = trial.subject.observed - trial.linear.prediction - explained
        found.append(float(np.sqrt(np.mean(residual[rows] ** 2))))
    return found[0], found[1]


def not_converged(name: str, fit: Fit) -> NotConverged | None:
    """Return the reason why a calibration cannot be judged; None if its sampler converged."""
    found = fit.diagnosis
    if found.is_converged:
        return None
    return NotConverged(name, max(found.r_hat), min(found.ess_bulk))


def with_sampled_sizes(judgement: Judgement, final: Fit) -> Judgement:
    """Replace the effects of the final model's causes by those of its sampled posterior.

    If its sampler has not converged nothing is judged, and the base model predicts.
    """
    unsettled = not_converged("model with the causes", final)
    if unsettled is not None:
        decision = Decision(Outcome.NOT_JUDGED, (), reasons=(unsettled,))
        return replace(judgement, decision=decision, sampled=False)
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    values = final.model.table.named(flat)
    sizes = {
        cause.name: {
            p.name: effect_size(values[cause.qualified(p.name)], p.unit) for p in cause.parameters
        }
        for cause in final.model.causes
    }
    found = tuple(
        c.model_copy(update={"effect": sizes[c.cause]}) if c.cause in sizes else c
        for c in judgement.candidates
    )
    return replace(judgement, candidates=found)


def levels_out(
    search: Search, names: Names, *, seed: np.random.SeedSequence, executor: Executor | None
) -> dict[str, HeldOut]:
    """Predict whole held-out degradation levels, if there are several."""
    fold = by_level(search.base.subject)
    if not names or fold.max() < 1:
        return {}
    plans = [in_folds(search.trials[one], fold, seed) for one in (BASE, names)]
    found = run_folds(plans, executor)
    return {label(one): held_out for one, held_out in zip((BASE, names), found, strict=True)}


JUDGE_EFFORTS = {
    "quick": SearchEffort(replicates=200, fitted=3, pairs=1, levels_out=False),
    "standard": SearchEffort(replicates=500, fitted=6, pairs=3, levels_out=True),
    "thorough": SearchEffort(replicates=2000, fitted=10, pairs=6, levels_out=True),
}
OWN_MAP = SearchEffort(replicates=500, fitted=4, pairs=3)
"""For a user's forward map, which is fast."""
OWN_EFFORTS = JUDGE_EFFORTS | {"standard": OWN_MAP}
MOST = 4_000
"""Replicates if a p-value is near the deciding level: its Monte Carlo error is then 0.003."""
MOST_OF_FILMS = 20_000  # they cost almost nothing
BRIEF = SearchEffort(replicates=100, fitted=1, pairs=0, most=400)
NOT_IN_BRIEF = (
    OptionalStage.SETS,
    OptionalStage.HELD_OUT,
    OptionalStage.STRUCTURE,
    OptionalStage.RUPTURE_COUNTS,
)
"""What a second verdict, made for comparison only, leaves out: most of the time of a search."""
FEW_DRAWS = 100  # for the data compared besides the readings
COUNT_DRAWS = 1000  # for a study's own rupture counts
MOSTLY = 0.9  # fraction of the largest share that counts as similar
IN_QUESTION = 3  # rivals for ranking experiments


def judge_model(
    model: JointModel,
    causes: tuple[Cause, ...],
    *,
    seed: int,
    effort: SearchEffort = OWN_MAP,
    progress: Progress | None = None,
    guard: Guard | None = None,
) -> Judgement:
    """Fit a model without a cause and judge it.

    Parameters
    ----------
    model : JointModel
        With its readings.
    causes : tuple of Cause
        The catalogue.
    seed : int
        Of every random number.
    effort : SearchEffort
        What the search may cost.
    progress, guard : optional
        As of `judge`.
    """
    base = base_without_chain(model, np.random.SeedSequence(seed))
    again = np.random.SeedSequence(seed)
    assembly = Assembly(model, causes, {}, ())
    return judge(assembly, base, effort=effort, seed=again, progress=progress, guard=guard)


def judge(
    assembly: Assembly,
    base: CandidateFit,
    *,
    effort: SearchEffort,
    seed: np.random.SeedSequence,
    progress: Progress | None = None,
    executor: Executor | None = None,
    guard: Guard | None = None,
) -> Judgement:
    """Judge a calibrated model of a study or of a user's forward map.

    Parameters
    ----------
    assembly : Assembly
        Candidates, and why others are none.
    base : CandidateFit
        The base model, calibrated.
    effort : SearchEffort
        Replicates and trials.
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress, optional
        Shows each trial.
    executor : Executor, optional
        For trials and folds.
    guard : Guard, optional
        Leaves out what fails; by default nothing is left out and faults are raised.
    """
    guard, progress = guard or Guard(strict=True), progress or Silent()
    searching, folding, drawing = seed.spawn(3)
    generator = np.random.default_rng(drawing)
    forward = any(one.uses_forward for one in base.subject.criticised)
    effort = replace(effort, most=MOST if forward else MOST_OF_FILMS)
    search = Search(base, assembly.candidates, effort, searching, executor=executor)
    search.on_fit = partial(progress.advance, 1)

    # other processes test the base model during the search, and count ruptures after it
    for_rupture, for_confusion, for_draws = generator.spawn(3)
    draws = base.draws(for_draws, FEW_DRAWS)
    rupturing = later(partial(rupture_misfit, base.subject, draws, for_rupture), executor)
    confusing = later(partial(confusability, base.linear, search.causes, for_confusion), executor)
    progress.stage("misfit, calibrated by simulation")
    alone = search.step(BASE)
    progress.stage("causes, one by one and together")
    favoured = run_search(search)
    for_counts = seed.spawn(1)[0]

    def counts_with(trial: CandidateFit) -> Callable[[], CountsJudged] | None:
        if not can_be_counted(trial.subject):
            return None
        generator = np.random.default_rng(for_counts)
        about = (trial, assembly.counts, assembly.of_counts, generator)
        return later(partial(_judged_counts, *about), executor)

    counting = counts_with(search.trials[favoured])
    draws = base.draws(generator, FEW_DRAWS)
    rupture = guard.attempt(OptionalStage.RUPTURE_MISFIT, rupturing)
    if rupture is not None and np.isnan(rupture.p_value):
        guard.note(
            OptionalStage.RUPTURE_MISFIT, sentences("findings", "ruptures_not_judged", one=rupture)
        )
        rupture = None
    contradicted = guard.attempt(OptionalStage.CONFLICT, conflict, base.subject, draws)
    off_prior = guard.attempt(OptionalStage.CONFLICT, questioned, base.subject, draws) or ()
    best, refuted = RefutingTests(search, assembly, folding, progress, guard).best(favoured)
    chosen, final, structure, shared = best.names, best.final, best.structure, best.shared
    supported, stated = best.supported, best.stated
    if chosen != favoured:
        counting = counts_with(final.trial)
    absorbed = guard.attempt(OptionalStage.ABSORPTION, absorption, search, chosen)
    both = None
    if counting is not None:
        both = guard.attempt(OptionalStage.RUPTURE_COUNTS, counting)
    counted, own = both or (None, None)

    if not alone.misfit.is_calibrated:
        few = uncalibrated(alone.misfit)
        guard.note(OptionalStage.CALIBRATION, sentences("findings", "not_calibrated", one=few))
    shown = guard.attempt(OptionalStage.DETECTABLE, _detectable, alone, search)
    errors = guard.attempt(
        OptionalStage.ERRORS, implausible_errors, final.trial.linear, final.simulated
    )
    tried = (*assembly.candidates, *assembly.of_counts)
    alike = tuple(cause.name for cause in assembly.alike)
    decision = decide(
        alone,
        final,
        [*supported, *(() if counted is None else counted.supported)],
        rupture=rupture,
        counts=None if counted is None else counted.misfit,
        contradicted=contradicted,
        questioned=off_prior,
        on_rupture=frozenset(cause.name for cause in tried if cause.is_of_rupture_alone),
        alike=alike,
        shared=shared,
        structure=structure,
        stated=stated,
        detectable=shown,
        errors=errors,
        coarse=coarse_map(base),
        untested=[NotComputed(s, guard.why(s)) for s in REFUTING if s in guard.stages],
    )
    judged = candidates(
        search,
        supported,
        best.everything,
        generator,
        why_refuted(refuted, chosen, degrades=search.base.subject.world.degrades),
    )
    unjudged = (
        Candidate(cause=name, mechanism=mechanism_of(name), why=why)
        for name, why in assembly.unjudged.items()
    )
    confused = guard.attempt(OptionalStage.CONFUSABILITY, confusing) or NOT_KNOWN
    levels = None
    if search.effort.levels_out:
        names = extension(decision, tuple(supported))
        levels = guard.attempt(
            OptionalStage.LEVELS_OUT, levels_out, search, names, seed=folding, executor=executor
        )
    experiments = guard.attempt(
        OptionalStage.EXPERIMENTS, _next, search, decision, (supported, stated), assembly, generator
    )
    return Judgement(
        misfit=alone.misfit,
        left=final.misfit,
        rupture=rupture,
        contradicted=contradicted,
        questioned=off_prior,
        candidates=_with_counted([*judged, *unjudged], counted),
        supported=tuple(supported),
        decision=decision,
        threshold=alone.threshold,
        confusability=confused,
        held_out={label(names): found for names, found in best.held_out.items() if names <= chosen},
        levels_out=levels or {},
        search=search,
        shared=tuple(shared),
        experiments=experiments or (),
        alike=alike,
        counted=counted,
        own_counts=own,
        absorbed=absorbed,
        missing=_missing((alone, final), decision, assembly, guard, seed, executor),
        stated=stated,
        detectable=shown,
        refuted=refuted,
    )


def _detectable(alone: Step, search: Search) -> Detectable | None:
    """Return the smallest detectable misfit, and the detectable sizes of the nearest causes."""
    linear = alone.trial.linear
    found = detectable_misfit(linear, alone.misfit, alone.simulated)
    if found is None:
        return None
    nearest = sorted(alone.screened.values(), key=lambda one: -one.log_bayes_factor)
    causes = [one.cause for one in nearest]
    sizes = detectable_causes(linear, causes, alone.threshold)
    return found.model_copy(update={"causes": sizes})


def coarse_map(base: CandidateFit) -> CoarseMap | None:
    """Return by how much the forward map errs over the readings; None if by less than them.

    Both are rms over the readings of curvature, at the mode.
    """
    model = base.subject
    state = model.tests(model.table.named(base.mode[None]))
    ratio = max((one.map_error_ratio(state) for one in model.of_kind(Curvature)), default=0.0)
    return CoarseMap(ratio) if ratio > 1.0 else None


def judge_briefly(
    assembly: Assembly,
    base: CandidateFit,
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
) -> Decision:
    """Judge a base model by its misfit and the best single cause, without `NOT_IN_BRIEF`.

    Parameters
    ----------
    assembly : Assembly
        Candidates, and why others are none.
    base : CandidateFit
        The base model, calibrated.
    seed : SeedSequence
        Everything random comes from it.
    executor : Executor, optional
        For trials.
    """
    searching, drawing = seed.spawn(2)
    generator = np.random.default_rng(drawing)
    search = Search(base, assembly.candidates, BRIEF, searching, executor=executor)
    alone = final = search.step(BASE)
    supported: list[Support] = []
    best = max(search.fit(BASE, search.leaders(BASE)), key=search.factor, default=BASE)
    if best and search.passes(BASE, best):
        final = search.step(best)
        for cause in best:
            one = support_without_rivals(search, best, cause, {})
            chance = search.step(BASE).chance_of(one.log_bayes_factor)
            supported.append(replace(one, chance=chance))
    draws = base.draws(generator, FEW_DRAWS)
    rupture = rupture_misfit(base.subject, draws, generator)
    return decide(
        alone,
        final,
        supported,
        rupture=None if rupture is None or np.isnan(rupture.p_value) else rupture,
        contradicted=conflict(base.subject, draws),
        questioned=questioned(base.subject, draws),
        alike=tuple(cause.name for cause in assembly.alike),
        shared=[] if final is alone else shared_scatter(final.trial, final.simulated),
        held_out=False,
    )


def count_misfits(
    model: JointModel,
    counts: RuptureCounts | None,
    vectors: Floats,
    generator: np.random.Generator,
) -> tuple[CountMisfit | None, CountMisfit | None]:
    """Return the probability of published rupture counts, and of the study's own, under a model."""
    if not can_be_counted(model):
        return None, None
    own = own_counts(model)
    return (
        None if counts is None else count_misfit(model, counts, vectors, generator, PUBLISHED),
        None if own is None else count_misfit(model, own, vectors, generator, OWN),
    )


CountsJudged = tuple[Counted | None, CountMisfit | None]


def _judged_counts(
    trial: CandidateFit,
    counts: RuptureCounts | None,
    causes: tuple[Cause, ...],
    generator: np.random.Generator,
) -> CountsJudged:
    first, second = generator.spawn(2)
    # one thread: the same sums in the same order, hence the same bits, in any process
    with threadpool_limits(limits=1):
        draws = trial.draws(first, COUNT_DRAWS)
        own = count_misfits(trial.subject, None, draws, first)[1]
        return None if counts is None else judge_counts(trial, counts, causes, second), own


def _with_counted(judged: list[Candidate], counted: Counted | None) -> tuple[Candidate, ...]:
    """Return the candidates with the evidence of rupture counts, the most probable first."""
    found = {} if counted is None else counted.candidates
    both = [found.get(one.cause, one) for one in judged]
    known = {one.cause for one in both}
    both += [one for name, one in found.items() if name not in known]
    if not found:
        return tuple(both)
    return tuple(sorted(both, key=lambda one: 1.0 if one.probability is None else -one.probability))


def _missing(
    steps: tuple[Step, Step],
    decision: Decision,
    assembly: Assembly,
    guard: Guard,
    seed: np.random.SeedSequence,
    executor: Executor | None,
) -> Description | None:
    """Return the description of an unexplained misfit; None if there is none."""
    alone, final = steps
    named = decision.outcome in (Outcome.NAMED, Outcome.AMBIGUOUS)
    remains = named and final.misfit.p_value <= MISFIT_LEVEL
    if decision.outcome is not Outcome.UNEXPLAINED and not remains:
        return None
    step = final if named else alone
    found = guard.attempt(OptionalStage.MISSING_TERMS, _described, step, assembly)
    if found is None:
        return None
    generator = np.random.default_rng(seed.spawn(1)[0])
    told = guard.attempt(OptionalStage.EXPERIMENTS, _between_terms, found, generator, executor)
    return replace(found, experiments=tuple(told or ()))


def _between_terms(
    found: Description, generator: np.random.Generator, executor: Executor | None
) -> tuple[ExperimentEntry, ...]:
    """Rank experiments that would tell apart terms that fit about equally well."""
    trial = found.step.trial
    trials = term_trials(trial, found.found, generator)
    experiments = candidate_experiments(trial.subject) if trials else ()
    ranked = rank(trials, experiments, generator, executor=executor)
    return next_experiments_document(ranked, partial(worded, degrades=trial.subject.world.degrades))


def _described(step: Step, assembly: Assembly) -> Description:
    found = terms_of(step, assembly)
    linear, batches = step.trial.linear, assembly.batches
    columns = misfit_columns(linear, step.simulated, step.misfit, batches=batches)
    return Description(step, found, columns)


def _next(
    search: Search,
    decision: Decision,
    favoured: tuple[list[Support], StatedSets | None],
    assembly: Assembly,
    generator: np.random.Generator,
) -> tuple[ExperimentEntry, ...]:
    """Rank the next experiments by how well they tell apart the models in question."""
    base, (supported, stated) = search.base, favoured
    chosen = frozenset(one.cause for one in supported)
    untested: tuple[Cause, ...] = ()
    if decision.outcome is Outcome.ADEQUATE:
        return ()
    if decision.outcome is Outcome.NOT_JUDGED and not supported:
        return ()
    if decision.outcome is Outcome.UNEXPLAINED:
        nearest = sorted(search.trials, key=search.factor)[-IN_QUESTION:]
        sets = dict.fromkeys([BASE, *nearest])
        untested = _shown_by(candidate_experiments(base.subject), assembly.unjudged)
    elif not supported and not assembly.alike:
        return ()  # no reading is in question
    elif not supported:
        return _beside_the_law(base, assembly, generator)
    else:
        others = {
            one.replaced(chosen, rival): gap
            for one in supported
            for rival, gap in one.rivals.items()
            if rival in one.inseparable or decision.outcome is Outcome.NAMED
        }
        if stated is not None:
            others |= {one.names: one.behind for one in stated.elsewhere}
        near = sorted(others, key=lambda names: others[names])
        sets = dict.fromkeys([chosen, *(near[:IN_QUESTION] or [BASE])])
    trials = [search.trials[names] for names in sets]
    ranked = rank(
        trials,
        candidate_experiments(base.subject),
        generator,
        untested=untested,
        executor=search.executor,
    )
    return next_experiments_document(ranked, partial(worded, degrades=base.subject.world.degrades))


def _shown_by(experiments: Iterable[Experiment], names: Iterable[str]) -> tuple[Cause, ...]:
    """Return the first few unjudged causes that a proposed actuator test may show.

    Causes of the material come last: if the batch or temperature of a specimen is not recorded,
    they act as a factor on its stiffness, which specimen scatter or a judged cause absorbs, so they
    leave no misfit.
    """
    tests = [
        one.measurement.curves.conditions
        for one in experiments
        if isinstance(one.measurement, ActuatorTests)
    ]
    causes = [CATALOGUE[name] for name in names if name in CATALOGUE]
    shown = [cause for cause in causes if any(cause.blind(test) is None for test in tests)]
    return tuple(sorted(shown, key=lambda cause: cause.stage <= Stage.MATERIAL)[:IN_QUESTION])


def _beside_the_law(
    base: CandidateFit, assembly: Assembly, generator: np.random.Generator
) -> tuple[ExperimentEntry, ...]:
    """Rank experiments for causes that look like a different form of the law in earlier tests."""
    trials = [try_causes(base, c, neutral_sizes(c), generator) for c in assembly.alike]
    ranked = rank([base, *trials], candidate_experiments(base.subject), generator)
    return next_experiments_document(ranked, partial(worded, degrades=base.subject.world.degrades))
