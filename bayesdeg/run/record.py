"""Findings of a run, and the content of ``verdict.json`` in numbers and words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.analysis.calibrate import Fit
from bayesdeg.analysis.checks import Checks
from bayesdeg.analysis.films import CourseFit, Films
from bayesdeg.analysis.judge import (
    NOT_IN_BRIEF,
    Description,
    Judgement,
    not_converged,
    readings_misfit,
)
from bayesdeg.assembly.aside import FILES, Exclusion, unused_rows
from bayesdeg.assembly.assemble import Assembly
from bayesdeg.assembly.outline import outline
from bayesdeg.causes.catalogue import CATALOGUE, mechanism_of
from bayesdeg.criticism.checks.conflict import questioned
from bayesdeg.criticism.checks.count_misfit import CountMisfit
from bayesdeg.criticism.checks.residuals import (
    CurvatureDeparture,
    ReadingsDeparture,
    StressDeparture,
    concentration,
    where,
    where_films,
    where_readings,
)
from bayesdeg.criticism.checks.suspects import Anomaly
from bayesdeg.criticism.decide.counted import Counted
from bayesdeg.criticism.decide.verdict import Decision, NotConverged, share_explained, uncalibrated
from bayesdeg.criticism.findings import (
    Candidate,
    Concentration,
    CountedCauseEntry,
    DescriptionEntry,
    EffectSize,
    MissingTermEntry,
    Questioned,
    RuptureCountsEntry,
)
from bayesdeg.criticism.fit.search import FALSE_NAME_RATE
from bayesdeg.criticism.holdout.gain import mode_table
from bayesdeg.criticism.outcome import MISFIT_LEVEL, Outcome
from bayesdeg.data.plausibility import Doubt, doubts
from bayesdeg.data.study import Study
from bayesdeg.inference.model import Refusals
from bayesdeg.observations.curvature import ACTUATOR, Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.observations.tensile import STRESS
from bayesdeg.pages.left_out import Guard, OptionalStage
from bayesdeg.pages.record import (
    ForwardMapEntry,
    InDoubt,
    MisfitEntry,
    NamingEntry,
    OutcomeEntry,
    SuspectEntry,
    UnusedEntry,
    VerdictRecord,
)
from bayesdeg.pages.wording import SPACE, sentences, worded
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.priors import Choice, Parameter


@dataclass(frozen=True)
class Results:
    """All findings of a run.

    Parameters
    ----------
    assembly : Assembly
        Base model, candidates, missing data.
    base, final : Fit
        Calibrations of the base model and of the one with the leading cause; the same where no
        cause leads.
    judgement : Judgement or None
        None where there are no actuator readings.
    checks : Checks, optional
        What the final calibration rests on.
    films : Films, optional
        What the films alone say.
    counts : CountMisfit, optional
        How probable published counts of ruptures are, where nothing was judged.
    averaged : Posterior, optional
        Draws over the causes that cannot be told apart, where there are several.
    with_suspects : Decision, optional
        What is decided with all that was set aside, where something was.
    """

    assembly: Assembly
    base: Fit
    final: Fit
    judgement: Judgement | None
    checks: Checks | None = None
    films: Films | None = None
    counts: CountMisfit | None = None
    averaged: Posterior | None = None
    with_suspects: Decision | None = None

    @property
    def fits(self) -> dict[str, Fit]:
        """Both calibrations by their labels in tables."""
        return {"base": self.base, "final": self.final}

    @property
    def course(self) -> CourseFit | None:
        """The course of degradation from the films' moisture."""
        return None if self.films is None else self.films.course

    @property
    def sampled(self) -> dict[str, Fit | CourseFit]:
        """All sampled models: both calibrations, and the course of degradation."""
        return {**self.fits} if self.course is None else {**self.fits, "course": self.course}

    @property
    def counts_expected(self) -> CountMisfit | None:
        """Published rupture counts and those that the model without a cause of rupture expects."""
        counted = None if self.judgement is None else self.judgement.counted
        return self.counts if counted is None else counted.misfit


def verdict_document(
    judgement: Judgement,
    where: str,
    *,
    note: str = "",
    concentrated: Concentration | None = None,
    explanation: str | None = None,
) -> VerdictRecord:
    """Return the content of ``verdict.json`` for a judged study.

    Parameters
    ----------
    judgement : Judgement
        The verdict.
    where : str
        Where the misfit sits.
    note : str
        What is wrong with modes of tension that were predicted only.
    concentrated : Concentration, optional
        The branch, cycle, hold or few specimens in which most of the misfit sits.
    explanation : str, optional
        In place of what `explain` says.
    """
    said = explain(judgement, where) if explanation is None else explanation
    decision, base, absorbed = judgement.decision, judgement.steps[0], judgement.absorbed
    degrades = judgement.search.base.subject.world.degrades
    counted, own = judgement.counted, judgement.own_counts
    found = () if counted is None else (_with_causes(counted, degrades=degrades),)
    return VerdictRecord(
        outcome=decision.outcome,
        causes=decision.causes,
        one_of=decision.one_of,
        sets=decision.sets,
        alternatives=decision.alternatives,
        explanation=f"{said} {note}".strip(),
        candidates=judgement.candidates,
        confusable=tuple(judgement.confusability.pairs()),
        false_name_rate=base.false_name_rate,
        naming=NamingEntry(log_bayes_factor=judgement.threshold, replicates=len(base.chance)),
        predicted_with=judgement.predicted_with,
        misfit=_misfit(judgement, where, concentrated),
        detectable=judgement.detectable,
        ruptures=judgement.rupture,
        rupture_counts=(*found, *(() if own is None else (counts_entry(own, degrades=degrades),))),
        contradicted=judgement.contradicted,
        absorbed=() if absorbed is None else absorbed.in_question,
        next_experiments=judgement.experiments,
        description=None if judgement.missing is None else _described(judgement.missing),
    )


def _misfit(judgement: Judgement, where: str, found: Concentration | None) -> MisfitEntry:
    """Return the misfit of the curvatures, or else of stresses or other readings."""
    rms, noise = readings_misfit(judgement)
    stress = readings_misfit(judgement, STRESS) if rms is None else (None, None)
    kind, unit = _other_kind(judgement) if rms is None else ("", "")
    other = readings_misfit(judgement, kind) if kind else (None, None)
    return MisfitEntry(
        rms_per_m=rms,
        noise_per_m=noise,
        p_value=judgement.misfit.p_value,
        replicates=len(judgement.misfit.null),
        where=where,
        concentrated=found,
        rms_MPa=stress[0],
        noise_MPa=stress[1],
        rms=other[0],
        noise=other[1],
        kind=kind,
        unit=unit,
    )


def _other_kind(judgement: Judgement) -> tuple[str, str]:
    """Return the first kind of reading without its own tables, and its unit."""
    scales = judgement.search.base.subject.scales
    return next(((kind, scale.unit) for kind, scale in scales.items()), ("", ""))


def _with_causes(counted: Counted, *, degrades: bool) -> RuptureCountsEntry:
    """Return the entry of published counts, with the causes that may explain them."""
    tried = (
        CountedCauseEntry(
            cause=one.name,
            log_bayes_factor=one.support.log_bayes_factor,
            p_value=one.left.p_value,
        )
        for one in counted.tried
    )
    found = {
        "explained_by": counted.explained_by,
        "criteria": dict(counted.criteria),
        "tried": tuple(tried),
        "sentence": worded(
            counted if counted.misfit.contradicts else counted.misfit, degrades=degrades
        ),
    }
    return counts_entry(counted.misfit).model_copy(update=found)


def counts_entry(found: CountMisfit, *, degrades: bool = True) -> RuptureCountsEntry:
    """Return the entry of counts in ``verdict.json``, with no probability below 1/draws.

    Parameters
    ----------
    found : CountMisfit
        Counts beside what the model expects.
    degrades : bool
        Whether anything of the study does.
    """
    least = 1.0 / max(found.draws, 1)
    return RuptureCountsEntry(
        source=found.source,
        levels=tuple(one.not_below(least) for one in found.levels),
        probability=max(float(np.exp(found.log_probability)), least) if found.levels else None,
        p_value=found.p_value,
        draws=found.draws,
        contradicted=found.contradicts,
        sentence=worded(found, degrades=degrades)
        if found.levels
        else sentences("findings", "counts_not_judged", one=found),
    )


def _described(found: Description) -> DescriptionEntry:
    terms = (
        MissingTermEntry(
            formula=one.term.formula,
            columns=one.term.columns,
            size=one.size,
            q05=one.low,
            q95=one.high,
            unit=one.term.unit,
            share_of_misfit=one.share,
            p_value=one.p_value,
            elpd_diff=one.held_out,
            elpd_diff_se=one.held_out_se,
            alike=tuple(other.term.formula for other in one.alike),
            count_alike=one.count_alike,
        )
        for one in found.found.terms
    )
    return DescriptionEntry(
        sentence=worded(found, degrades=found.step.trial.subject.world.degrades),
        with_causes=tuple(sorted(found.step.trial.names)),
        terms=tuple(terms),
        columns=found.columns,
        p_value=found.found.p_value,
        tried=found.found.tried,
        replicates=found.found.replicates,
        next_experiments=found.experiments,
    )


def unjudged_document(
    unjudged: dict[str, str],
    held_out: str = "",
    failed: str = "",
    *,
    unsettled: str = "",
    published: bool = False,
) -> VerdictRecord:
    """Return the content of ``verdict.json`` if nothing was judged.

    The study has no readings to judge, or judging or sampling failed.

    Parameters
    ----------
    unjudged : dict of str to str
        Causes, and why each cannot be judged.
    held_out : str
        What is wrong with modes of tension that were predicted only.
    failed : str
        Why judging failed; empty where there was nothing to judge.
    unsettled : str
        That the base model has not converged; empty if it has.
    published : bool
        Whether published statistics are shown next to what the model makes of them.
    """
    facts = {"failed": failed, "held_out": held_out, "published": published, "unsettled": unsettled}
    return VerdictRecord(
        outcome=Outcome.NOT_JUDGED,
        explanation=sentences("run", "unjudged", **facts),
        candidates=tuple(
            Candidate(cause=name, mechanism=mechanism_of(name), why=why)
            for name, why in unjudged.items()
        ),
    )


Floats = NDArray[np.float64]

OF_VERDICT = (
    OptionalStage.RUPTURE_MISFIT,
    OptionalStage.RUPTURE_COUNTS,
    OptionalStage.CONFLICT,
    OptionalStage.ABSORPTION,
    OptionalStage.LEVELS_OUT,
    OptionalStage.EXPERIMENTS,
    OptionalStage.CONFUSABILITY,
    OptionalStage.EXTENDED,
    OptionalStage.WHERE,
)
"""Notes about missing tests, if no reason of the decision already says so."""


def verdict_of(results: Results, residual: Floats | None, note: str, guard: Guard) -> VerdictRecord:
    """Return the content of ``verdict.json``.

    If judging failed, or its outcome cannot be written, it says so.

    Parameters
    ----------
    results : Results
        What was found.
    residual : array, optional
        Residuals of curvature under the base model [1/m]; None where they are not known.
    note : str
        What is wrong with modes of tension that were predicted only.
    guard : Guard
        Knows what was left out, and leaves out what fails.
    """
    found = None
    if results.judgement is not None:
        found = guard.attempt(
            OptionalStage.VERDICT, _verdict, results, results.judgement, residual, note, guard
        )
    if found is not None:
        return found
    unjudged, failed = results.assembly.unjudged, guard.why(OptionalStage.VERDICT)
    unsettled = not_converged("base model", results.base)
    why = "the verdict was left out" if failed else "the base model has not converged"
    if failed or unsettled:
        unjudged = {cause.name: why for cause in results.assembly.candidates} | unjudged
    shown = bool(results.base.model.data_of(Means).statistics)
    said = "" if unsettled is None else worded(unsettled)
    document = unjudged_document(unjudged, note, failed, unsettled=said, published=shown)
    counted: tuple[RuptureCountsEntry, ...] = ()
    if results.counts is not None:
        counted = (counts_entry(results.counts, degrades=results.base.model.world.degrades),)
    return document.model_copy(update={"rupture_counts": counted})


def _verdict(
    results: Results, judgement: Judgement, residual: Floats | None, note: str, guard: Guard
) -> VerdictRecord:
    linear = judgement.search.base.linear
    departure = guard.attempt(OptionalStage.WHERE, _departure, results, judgement, residual)
    found = guard.attempt(
        OptionalStage.CONCENTRATION,
        concentration,
        linear,
        judgement.steps[0].simulated,
        judgement.misfit.statistic,
    )
    degrades = results.base.model.world.degrades
    place = "" if departure is None else worded(departure, most=found, degrades=degrades)
    said = guard.attempt(OptionalStage.EXPLANATION, explain, judgement, place)
    missing = " ".join(guard.why(stage) for stage in OF_VERDICT)
    return verdict_document(
        judgement,
        place,
        note=f"{note} {missing}".strip(),
        concentrated=found,
        explanation=said or f"The verdict is: {judgement.decision.outcome}.",
    )


def _departure(
    results: Results, judgement: Judgement, residual: Floats | None
) -> CurvatureDeparture | StressDeparture | ReadingsDeparture | None:
    """Return where the misfit lies; None if the readings could not be predicted."""
    linear = judgement.search.base.linear
    if not results.base.model.of_kind(Curvature):
        kind, unit = _other_kind(judgement)
        return where_readings(linear, kind, unit) if kind else where_films(linear)
    noise = readings_misfit(judgement)[1]
    return None if residual is None else where(results.base.model, residual, noise or 0.0)


DRAWS = 4000  # draws of a posterior for medians


def in_doubt(results: Results, found: Sequence[Doubt] | None = None) -> InDoubt:
    """Return warnings to read before the verdict is used.

    Parameters
    ----------
    results : Results
        Of which the final calibration is held against its priors.
    found : sequence of Doubt, optional
        What is unlikely of the study, where that is known already.

    Returns
    -------
    InDoubt
        Readings and specimens that are unlikely, and parameters that are calibrated to what their
        priors all but exclude.
    """
    assembly = results.assembly
    aside = (*assembly.beyond, *assembly.aside)
    unused = unused_rows(assembly.study, assembly.whole, aside)
    decided = () if results.judgement is None else results.judgement.decision.reasons
    decided_with = results.with_suspects
    return InDoubt(
        unused=tuple(
            UnusedEntry(
                file=one.file,
                rows=one.rows,
                specimens=one.specimens,
                why=str(one.why),
                sentence=sentences("run", "unused", one=one),
            )
            for one in unused
        ),
        not_converged=(
            *(
                f"{name} model: {worded(fit.diagnosis)}"
                for name, fit in results.fits.items()
                if not fit.diagnosis.usable and (name == "base" or fit is not results.base)
            ),
            # a final model that did not converge is excluded: the base model predicts
            *(worded(one) for one in decided if isinstance(one, NotConverged)),
        ),
        suspects=suspects_of(results, found),
        parameters_in_question=tuple(_off_priors(results)),
        with_suspects=None if decided_with is None else _brief(decided_with),
        forward_map=forward_map_of(results),
    )


def _brief(decided: Decision) -> OutcomeEntry:
    """Return the entry of a verdict that was made briefly."""
    return OutcomeEntry.of(decided).model_copy(update={"without": tuple(map(str, NOT_IN_BRIEF))})


def forward_map_of(results: Results) -> ForwardMapEntry | None:
    """Return where the user's forward map fails, for prior draws and all proposals."""
    known = results.assembly.answers
    if known is None:
        return None
    chains = {id(fit.chain): fit.chain.refusals for fit in results.fits.values()}
    refusals = sum(chains.values(), start=Refusals())
    found = {"proposals": refusals.proposed, "proposals_unanswered": refusals.share}
    return known.model_copy(update=found)


def suspects_of(results: Results, found: Sequence[Doubt] | None = None) -> tuple[SuspectEntry, ...]:
    """Return the doubtful data of a study: contradicted by the others, then by their columns."""
    assembly = results.assembly
    whole = assembly.whole
    if found is None:
        known = isinstance(assembly.model.world, FilmsAndActuators)
        found = doubts(whole, outline(whole).expected) if known else ()
    odd = [_odd(one, results, whole) for one in assembly.aside if one.suspect is not None]
    seen = (one for one in assembly.aside if one.is_out and one.suspect is None)
    out = {(one.table, name) for one in seen for name in one.specimens}
    beyond = [
        SuspectEntry(
            file=f"{one.table}.csv",
            specimen=one.specimens[0] if len(one.specimens) == 1 else None,
            specimens=one.specimens if len(one.specimens) > 1 else (),
            why=sentences(
                "findings", "beyond", one=one, lowest=min(p for _, p, *_ in one.readings)
            ),
            oddity="beyond",
            readings=len(one.readings),
            set_aside=True,
        )
        for one in assembly.beyond
    ]
    by_columns = []
    for doubt in found:
        fault = doubt.fault
        set_aside = (FILES.get(fault.file), fault.specimen) in out and doubt.is_alone
        by_columns.append(
            SuspectEntry(
                file=fault.file,
                specimen=fault.specimen,
                column=fault.column,
                value=fault.value,
                why=f"{doubt}; it is set aside" if set_aside else str(doubt),
                set_aside=set_aside,
            )
        )
    return (*odd, *beyond, *by_columns)


def _odd(one: Exclusion, results: Results, whole: Study) -> SuspectEntry:
    """Return the entry of a suspect that the other specimens contradict."""
    assert one.suspect is not None
    suspect, hypothesis = one.suspect, one.suspect.hypothesis
    partner = _exchanged_with(one, results, whole)
    stiffer = float(np.exp(np.clip(suspect.size, -MOST_LOGS, MOST_LOGS)))
    facts = {"one": one, "odd": suspect, "way": hypothesis, "partner": partner, "stiffer": stiffer}
    lines = one.table == ACTUATOR and whole.line_points is not None
    return SuspectEntry(
        file=whole.lines_file if lines else f"{one.table}.csv" if one.table else "",
        specimen=one.specimens[0] if len(one.specimens) == 1 else None,
        specimens=one.specimens if len(one.specimens) > 1 else (),
        why=sentences("findings", "suspect", **facts),
        oddity=str(hypothesis.oddity),
        size=suspect.size,
        score=suspect.score,
        p_value=suspect.p_value,
        readings=len(one.readings) if one.readings else int(hypothesis.rows.sum()),
        set_aside=one.is_out,
    )


MOST_LOGS = 20.0  # relative change from a logarithmic size
ALIKE = 0.35
"""Allowed deviation of the stiffness of two specimens from that of each other's degradation rate,
over the difference of both: specimen scatter is about a tenth of such a difference."""


def _exchanged_with(one: Exclusion, results: Results, whole: Study) -> str:
    """Return the suspect with which another could have been swapped; empty if there is none."""
    table = whole.table(one.table) if one.table else None
    same = (other for other in results.assembly.aside if other.table == one.table)
    others = [other for other in same if other is not one and _is_stiffness(other)]
    if table is None or not others or not _is_stiffness(one):
        return ""
    rate = table.drop_duplicates("specimen_id").set_index("specimen_id")["degradation_pct"]
    model, chain = results.final.model, results.final.chain
    middle = np.mean(chain.vectors.reshape(-1, chain.vectors.shape[-1]), axis=0)
    values = model.table.named(middle[None])
    for other in others:
        ends = np.array([float(rate[one.specimens[0]]), float(rate[other.specimens[0]])])
        first, second = np.log(model.world.constants(values, ends)[0, :, 0])
        assert one.suspect is not None
        assert other.suspect is not None
        # the softer one deviates by more than its stiffness, since its curve steepens
        stiffer, softer = sorted([one.suspect.size, other.suspect.size], reverse=True)
        expected = abs(second - first)
        exchanged = (one.suspect.size > other.suspect.size) == (second > first)
        off = max(abs(stiffer - expected), expected + softer)
        if exchanged and off <= ALIKE * expected:
            return other.specimens[0]
    return ""


def _is_stiffness(one: Exclusion) -> bool:
    way = None if one.suspect is None else one.suspect.hypothesis.oddity
    return way is Anomaly.RESPONSE and len(one.specimens) == 1


def _off_priors(results: Results) -> Iterator[Questioned]:
    """Yield the parameters far off their priors, with what pushed them there if that is known."""
    fit = results.final
    absorbed = None if results.judgement is None else results.judgement.absorbed
    for one in questioned(fit.model, fit.chain.spread(DRAWS)):
        displaced = None if absorbed is None else absorbed.of(one.parameter)
        if absorbed is None or displaced is None or np.isnan(displaced.moved_sd):
            yield one
        else:
            pushes = tuple(push.causes for push in absorbed.pushed_by(displaced))
            moved = displaced.moved_sd if np.isfinite(displaced.moved_sd) else None
            yield one.model_copy(update={"displacement": moved, "pushed_by": pushes})


LARGEST_LOSS = 0.05  # share of simulated data sets lost before the reader is warned
SMALL_CHANCE = 0.05  # p-value of ruptures below which a sentence is written
FEW_ERRORS = 2.0  # standard errors within which a gain may be zero
LIKELY = 0.5  # probability of a cause above which the text says why it is not named


def _shown(judgement: Judgement) -> list[str]:
    """Return the sizes of causes that would have shown, in words."""
    found = () if judgement.detectable is None else judgement.detectable.causes
    return [
        f"{one.cause.replace('_', ' ')} of {abs(one.size):.2g} {one.unit}".rstrip(" –")
        for one in found
    ]


def explain(judgement: Judgement, where: str) -> str:
    """Return the explanation: what is wrong, why, how sure, what else it could be.

    Parameters
    ----------
    judgement : Judgement
        The verdict.
    where : str
        Where the misfit is, in a sentence.
    """
    misfit, decision, candidates = judgement.misfit, judgement.decision, judgement.candidates
    counted, degrades = judgement.counted, judgement.search.base.subject.world.degrades
    count = len(misfit.null)

    # the causes decided on, with the sizes of their parameters
    tried = {cause.name: cause for cause in judgement.search.causes}
    known = {name: tried[name] if name in tried else CATALOGUE[name] for name in decision.causes}
    effects = {one.cause: one.effect for one in candidates}
    causes = [
        {
            "name": name,
            "mechanism": cause.mechanism,
            "sizes": [
                _size(parameter, effects[name][parameter.name])
                for parameter in cause.parameters
                if parameter.name in effects.get(name, ())
            ],
        }
        for name, cause in known.items()
    ]

    # the best replacement for a named cause, and its deficit in evidence
    rivals = [
        (gap, {"name": name, "cause": one.cause, "gap": gap})
        for one in judgement.supported
        if one.cause in decision.causes
        for name, gap in one.rivals.items()
    ]
    judged = [c for c in candidates if c.log_bayes_factor is not None]

    contradicted = counted is not None and counted.misfit.contradicts
    others = [one.p_value for one in (judgement.rupture, judgement.contradicted) if one is not None]
    by_counts_alone = (
        contradicted
        and all(p > MISFIT_LEVEL for p in (misfit.p_value, *others))
        and not (judgement.supported or judgement.questioned)
        and not any(one.is_more_than_chance for one in judgement.shared)
    )
    said = sentences(
        "verdict",
        "explanation",
        j=judgement,
        degrades=degrades,
        counts=worded(counted, degrades=degrades) if contradicted else "",
        by_counts_alone=by_counts_alone,
        where=where,
        outcome=str(decision.outcome),
        catalogue=known,
        shown=_shown(judgement),
        causes=causes,
        named_or=" or ".join(decision.causes),
        favoured=" and ".join(one.cause for one in judgement.supported),
        reasons="; ".join(worded(one, degrades=degrades) for one in decision.reasons),
        uncalibrated="" if misfit.is_calibrated else worded(uncalibrated(misfit)),
        count=count,
        larger=round(misfit.p_value * (count + 1) - 1) if np.isfinite(misfit.p_value) else 0,
        # the cause that the table shows as likely
        likely=next((c for c in candidates if (c.probability or 0.0) >= LIKELY), None),
        nearest=max(judged, key=lambda c: c.log_bayes_factor or 0.0, default=None),
        rival=min(rivals, key=lambda one: one[0])[1] if rivals else None,
        refuted=[
            {
                "name": " and ".join(sorted(names)),
                "several": len(names) > 1,
                "why": "; ".join(worded(one, degrades=degrades) for one in why),
            }
            for names, why in judgement.refuted.items()
            if names != judgement.chosen
        ],
        shares=_shares(judgement),
        modes=_modes(judgement),
        level=MISFIT_LEVEL,
        false_name_rate=FALSE_NAME_RATE,
        small_chance=SMALL_CHANCE,
        largest_loss=LARGEST_LOSS,
        few_errors=FEW_ERRORS,
    )
    return said.replace(SPACE, " ")


def _shares(judgement: Judgement) -> tuple[float, float] | None:
    """Return the explained share of the misfit on either scale; None if unknown."""
    calibrated = judgement.misfit.is_calibrated and judgement.left.is_calibrated
    if not calibrated or judgement.misfit.statistic <= judgement.misfit.by_chance:
        return None
    own, common = share_explained(*judgement.steps)
    return round(own, 3), round(common, 3)


def _modes(judgement: Judgement) -> list[dict[str, object]]:
    """Return the errors of held-out modes before and after [MPa]."""
    subject, held_out = judgement.search.base.subject, judgement.held_out
    if not subject.holds_out_modes or len(held_out) < 2:
        return []
    ends = {name: held_out[name] for name in (next(iter(held_out)), list(held_out)[-1])}
    error = mode_table(subject, ends).pivot(index="mode", columns="model", values="rmse_MPa")
    return [
        {"name": str(mode), "before": float(row.iloc[0]), "after": float(row.iloc[1])}
        for mode, row in error[list(ends)].iterrows()
    ]


def _size(parameter: Parameter, effect: EffectSize) -> str:
    """Word the size of a cause's parameter; that of a choice has no interval."""
    unit = "" if effect.unit == "–" else f" {effect.unit}"
    size = f"{parameter.meaning}: {effect.mean:.3g}{unit}"
    if isinstance(parameter.law, Choice):
        return size
    return f"{size}, 90 % interval {effect.q05:.3g} to {effect.q95:.3g}"
