"""What a run found, as the records that ``verdict.json`` and ``run.json`` hold."""

import json
import platform
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

import bayesdeg
from bayesdeg.actuator.reading import mechanics_of
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.absorption import Absorption, Displacement
from bayesdeg.criticism.checks.conflict import Conflict, Questioned, questioned
from bayesdeg.criticism.checks.count_misfit import CountedLevel, CountMisfit, can_be_counted
from bayesdeg.criticism.checks.residuals import (
    Concentration,
    CurvatureDeparture,
    ReadingsDeparture,
    StressDeparture,
    concentration,
    where,
    where_films,
    where_readings,
)
from bayesdeg.criticism.checks.rupture_misfit import RuptureMisfit
from bayesdeg.criticism.checks.suspects import Oddity
from bayesdeg.criticism.decide.candidates import Candidate
from bayesdeg.criticism.decide.counted import Counted
from bayesdeg.criticism.decide.verdict import Decision
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.data.plausibility import Doubt, doubts
from bayesdeg.data.study import Study
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.model import JointModel, Refusals, share_outside
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.curvature import ACTUATOR
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.observations.tensile import STRESS
from bayesdeg.pipeline.aside import FILES, Aside
from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.averaged import Averaged
from bayesdeg.pipeline.calibrate import Fit, refused_inputs
from bayesdeg.pipeline.checks import Checks
from bayesdeg.pipeline.explanation import explain
from bayesdeg.pipeline.films import CourseFit, Films
from bayesdeg.pipeline.forecast import model_document
from bayesdeg.pipeline.formula import OwnMap
from bayesdeg.pipeline.judge import Judgement, readings_misfit
from bayesdeg.pipeline.memory import peaks_of_memory
from bayesdeg.pipeline.missing import description_entry
from bayesdeg.pipeline.outline import outline
from bayesdeg.pipeline.vendor import vendor_check
from bayesdeg.prediction.predictive import specimens_tested
from bayesdeg.report.left_out import Guard, OptionalStage
from bayesdeg.report.record import (
    AbsorbedEntry,
    BasisEntry,
    CandidateEntry,
    ComparisonEntry,
    ConcentrationEntry,
    ContradictionEntry,
    ConvergenceEntry,
    CountedCauseEntry,
    CountedLevelEntry,
    EffectEntry,
    EmulatorEntry,
    ExperimentEntry,
    InDoubt,
    MemberEntry,
    MisfitEntry,
    MissingEntry,
    ModelEntry,
    NamingEntry,
    OutcomeEntry,
    QuestionedEntry,
    RunRecord,
    RuptureCountsEntry,
    RuptureEntry,
    StatisticEntry,
    SuspectEntry,
    VerdictRecord,
)
from bayesdeg.report.wording import NOTHING, sentences, worded


@dataclass(frozen=True)
class Results:
    """Everything that a run has found.

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
    averaged : Averaged, optional
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
    averaged: Averaged | None = None
    with_suspects: Decision | None = None

    @property
    def fits(self) -> dict[str, Fit]:
        """Both calibrations by their labels in the tables."""
        return {"base": self.base, "final": self.final}

    @property
    def course(self) -> CourseFit | None:
        """The course of degradation, as the films' moisture tells it."""
        return None if self.films is None else self.films.course

    @property
    def sampled(self) -> dict[str, Fit | CourseFit]:
        """Everything that was sampled: both calibrations, and the course of degradation."""
        return {**self.fits} if self.course is None else {**self.fits, "course": self.course}

    @property
    def counts_expected(self) -> CountMisfit | None:
        """Published counts of ruptures beside those that the model without such a cause expects."""
        counted = None if self.judgement is None else self.judgement.counted
        return self.counts if counted is None else counted.misfit


def verdict_document(
    judgement: Judgement,
    where: str,
    experiments: Sequence[Mapping[str, object]] = (),
    *,
    note: str = "",
    concentrated: Concentration | None = None,
    explanation: str | None = None,
) -> VerdictRecord:
    """Return the content of ``verdict.json`` for a study whose readings could be judged.

    Parameters
    ----------
    judgement : Judgement
        The verdict.
    where : str
        Where the misfit sits.
    experiments : sequence, optional
        What to measure next, with the keys of `bayesdeg.report.record.ExperimentEntry`.
    note : str
        What is wrong with modes of tension that were predicted only.
    concentrated : Concentration, optional
        The branch, cycle, hold or few specimens in which most of the misfit sits.
    explanation : str, optional
        In place of what `bayesdeg.pipeline.explanation.explain` says.
    """
    said = explain(judgement, where) if explanation is None else explanation
    decision, base = judgement.decision, judgement.steps[0]
    return VerdictRecord(
        outcome=decision.outcome,
        causes=decision.causes,
        one_of=decision.one_of,
        sets=decision.sets,
        alternatives=decision.alternatives,
        explanation=f"{said} {note}".strip(),
        candidates=tuple(_candidate(c, judgement) for c in judgement.candidates),
        confusable=tuple(judgement.confusability.pairs()),
        false_name_rate=base.false_name_rate,
        naming=NamingEntry(log_bayes_factor=judgement.threshold, replicates=len(base.chance)),
        predicted_with=judgement.predicted_with,
        misfit=_misfit(judgement, where, concentrated),
        ruptures=_ruptures(judgement.rupture),
        rupture_counts=_rupture_counts(judgement),
        contradicted=_contradicted(judgement.contradicted),
        absorbed=_absorbed(judgement.absorbed),
        next_experiments=tuple(ExperimentEntry.model_validate(one) for one in experiments),
        description=description_entry(judgement),
    )


def _misfit(judgement: Judgement, where: str, found: Concentration | None) -> MisfitEntry:
    """Return the misfit of the curvatures; of stresses or other readings where there are none."""
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
        concentrated=None if found is None else _concentrated(found),
        rms_MPa=stress[0],
        noise_MPa=stress[1],
        rms=other[0],
        noise=other[1],
        kind=kind,
        unit=unit,
    )


def _other_kind(judgement: Judgement) -> tuple[str, str]:
    """Return what was read first of what has no tables of its own, and its unit."""
    scales = judgement.search.base.subject.scales
    return next(((kind, scale.unit) for kind, scale in scales.items()), ("", ""))


def _concentrated(found: Concentration) -> ConcentrationEntry:
    return ConcentrationEntry(
        kind=found.kind,
        members=found.members,
        excess_pct=found.excess,
        share_of_misfit=found.share,
        share_of_readings=found.readings,
        p_value=found.p_value,
    )


def _ruptures(found: RuptureMisfit | None) -> RuptureEntry | None:
    return None if found is None else RuptureEntry.of(found)


def _rupture_counts(judgement: Judgement) -> tuple[RuptureCountsEntry, ...]:
    """Return what was made of counts of ruptures, published ones first."""
    counted, own = judgement.counted, judgement.own_counts
    degrades = judgement.search.base.subject.degrades
    found = () if counted is None else (_with_causes(counted, degrades=degrades),)
    return (*found, *(() if own is None else (counts_entry(own, degrades=degrades),)))


def _with_causes(counted: Counted, *, degrades: bool) -> RuptureCountsEntry:
    said = worded(counted if counted.misfit.contradicts else counted.misfit, degrades=degrades)
    return counts_entry(counted.misfit).model_copy(
        update={
            "explained_by": counted.explained_by,
            "criteria": dict(counted.criteria),
            "tried": tuple(
                CountedCauseEntry(
                    cause=one.name,
                    log_bayes_factor=one.support.log_bayes_factor,
                    p_value=one.left.p_value,
                )
                for one in counted.tried
            ),
            "sentence": said,
        }
    )


def counts_entry(found: CountMisfit, *, degrades: bool = True) -> RuptureCountsEntry:
    """Return what ``verdict.json`` says of counts: no probability below one in all draws.

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
        levels=tuple(_counted_level(one, least) for one in found.levels),
        probability=max(float(np.exp(found.log_probability)), least) if found.levels else None,
        p_value=found.p_value,
        draws=found.draws,
        contradicted=found.contradicts,
        sentence=worded(found, degrades=degrades)
        if found.levels
        else sentences("findings", "counts_not_judged", one=found),
    )


def _counted_level(one: CountedLevel, least: float) -> CountedLevelEntry:
    return CountedLevelEntry(
        degradation_pct=one.degradation,
        pressure_kPa=one.pressure,
        tested=one.tested,
        ruptured=one.ruptured,
        probability=max(one.probability, least),
        probability_q05=max(one.low, least),
        probability_q95=max(one.high, least),
        count_probability=max(one.chance, least),
    )


def _absorbed(found: Absorption | None) -> tuple[AbsorbedEntry, ...]:
    """Return the parameters that took up what the model lacks, the farthest off first."""
    return () if found is None else tuple(_taken_up(found, one) for one in found.in_question)


def _taken_up(found: Absorption, one: Displacement) -> AbsorbedEntry:
    pushes, after, direct = found.pushed_by(one), found.returned(one), one.measured
    return AbsorbedEntry(
        parameter=one.parameter.name,
        meaning=one.parameter.meaning,
        unit=one.parameter.unit,
        median=one.posterior.median,
        all_else_low=one.all_else.low,
        all_else_median=one.all_else.median,
        all_else_high=one.all_else.high,
        measured=None if direct is None else direct.value,
        measured_se=None if direct is None else direct.se,
        source="" if direct is None else direct.source,
        displacement=one.moved,
        p_value=one.adjusted,
        pushed_by=tuple(push.causes for push in pushes),
        explained_share=pushes[0].share(one) if pushes else None,
        median_after=None if after is None else after.posterior.median,
        displacement_after=None if after is None else after.moved,
    )


def _contradicted(found: Conflict | None) -> ContradictionEntry | None:
    if found is None:
        return None
    measured = found.statistic
    return ContradictionEntry(
        quantity=measured.quantity,
        measured=measured.value,
        standard_error=measured.se,
        source=measured.source,
        calibrated=found.wanted,
        p_value=found.p_value,
    )


def unjudged_document(
    unjudged: dict[str, str], held_out: str = "", failed: str = "", *, published: bool = False
) -> VerdictRecord:
    """Return the content of ``verdict.json`` where nothing was judged.

    Either the study has no readings to judge, or judging them failed.

    Parameters
    ----------
    unjudged : dict of str to str
        Causes, and why each cannot be judged.
    held_out : str
        What is wrong with modes of tension that were predicted only.
    failed : str
        Why judging failed; empty where there was nothing to judge.
    published : bool
        Whether published statistics are shown next to what the model makes of them.
    """
    facts = {"failed": failed, "held_out": held_out, "published": published}
    return VerdictRecord(
        outcome=Outcome.NOT_JUDGED,
        explanation=sentences("run", "unjudged", **facts),
        candidates=tuple(
            CandidateEntry(cause=name, mechanism=_mechanism(name), why=why)
            for name, why in unjudged.items()
        ),
    )


def _candidate(candidate: Candidate, judgement: Judgement) -> CandidateEntry:
    own = {cause.name: cause.mechanism for cause in judgement.search.causes}
    fit = "full fit" if candidate.fitted else "screening"
    return CandidateEntry(
        cause=candidate.cause,
        probability=candidate.probability,
        log_bayes_factor=candidate.log_bayes_factor,
        log_bayes_factor_error=candidate.log_bayes_factor_error,
        elpd_diff=candidate.elpd_diff,
        elpd_diff_se=candidate.elpd_diff_se,
        explained_fraction=candidate.explained_fraction,
        effect={name: EffectEntry.of(size) for name, size in candidate.effect.items()},
        mechanism=own.get(candidate.cause) or _mechanism(candidate.cause),
        naming_p_value=candidate.naming_p_value,
        why=candidate.why,
        judged_by="" if candidate.why else fit,
    )


def _mechanism(cause: str) -> str:
    known = CATALOGUE.get(cause)
    return known.mechanism if known else ""


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
"""What a reader of the verdict misses, where no reason of the decision says it already."""


def verdict_of(results: Results, residual: Floats | None, note: str, guard: Guard) -> VerdictRecord:
    """Return the content of ``verdict.json``.

    Where judging failed, or its outcome cannot be put into words and numbers, it says so.

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
    if failed:
        tried = {cause.name: "the verdict was left out" for cause in results.assembly.candidates}
        unjudged = tried | unjudged
    shown = bool(results.base.model.statistics)
    document = unjudged_document(unjudged, note, failed, published=shown)
    counted: tuple[RuptureCountsEntry, ...] = ()
    if results.counts is not None:
        counted = (counts_entry(results.counts, degrades=results.base.model.degrades),)
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
    degrades = results.base.model.degrades
    place = "" if departure is None else worded(departure, most=found, degrades=degrades)
    said = guard.attempt(OptionalStage.EXPLANATION, explain, judgement, place)
    missing = " ".join(guard.why(stage) for stage in OF_VERDICT)
    return verdict_document(
        judgement,
        place,
        judgement.experiments,
        note=f"{note} {missing}".strip(),
        concentrated=found,
        explanation=said or f"The verdict is: {judgement.decision.outcome}.",
    )


def _departure(
    results: Results, judgement: Judgement, residual: Floats | None
) -> CurvatureDeparture | StressDeparture | ReadingsDeparture | None:
    """Return where the misfit sits; None where the readings could not be predicted."""
    linear = judgement.search.base.linear
    if results.base.model.actuator is None:
        kind, unit = _other_kind(judgement)
        return where_readings(linear, kind, unit) if kind else where_films(linear)
    noise = readings_misfit(judgement)[1]
    return None if residual is None else where(results.base.model, residual, noise or 0.0)


DRAWS = 4000  # of a posterior, for its medians


def in_doubt(study: Study, results: Results, found: Sequence[Doubt] | None = None) -> InDoubt:
    """Return what a reader of the verdict should know before it is used.

    Parameters
    ----------
    study : Study
        What was run.
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
    return InDoubt(
        suspects=suspects_of(study, results, found),
        parameters_in_question=_off_priors(results),
        with_suspects=_outcome(results.with_suspects),
    )


def _outcome(decision: Decision | None) -> OutcomeEntry | None:
    if decision is None:
        return None
    found = {"outcome": decision.outcome, "causes": decision.causes, "one_of": decision.one_of}
    return OutcomeEntry.model_validate(found)


def suspects_of(
    study: Study, results: Results, found: Sequence[Doubt] | None = None
) -> tuple[SuspectEntry, ...]:
    """Return what is unlikely of a study: what the others contradict, then what its columns say."""
    assembly = results.assembly
    whole = assembly.whole or study
    if found is None:
        known = isinstance(assembly.model.world, FilmsAndActuators)
        found = doubts(whole, outline(whole).expected) if known else ()
    odd = [_odd(one, results, whole) for one in assembly.aside if one.suspect is not None]
    out = {(one.table, n) for one in assembly.aside if one.suspect is None for n in one.specimens}
    return (*odd, *(_suspect(doubt, out) for doubt in found))


def _suspect(doubt: Doubt, out: Collection[tuple[str | None, str]]) -> SuspectEntry:
    fault = doubt.fault
    set_aside = (FILES.get(fault.file), fault.specimen) in out and doubt.is_alone
    return SuspectEntry(
        file=fault.file,
        specimen=fault.specimen,
        column=fault.column,
        value=fault.value,
        why=f"{doubt}; it is set aside" if set_aside else str(doubt),
        set_aside=set_aside,
    )


def _odd(one: Aside, results: Results, whole: Study) -> SuspectEntry:
    """Return a suspect that the other specimens contradict, in words and numbers."""
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


MOST_LOGS = 20.0  # of a size that is a logarithm, for one that is none
ALIKE = 0.35
"""How far the stiffness of two specimens may be off that of each other's degradation rate, over
the difference of both: the scatter of specimens is some tenth of such a difference."""


def _exchanged_with(one: Aside, results: Results, whole: Study) -> str:
    """Return the suspect for which another could have been taken; empty if there is none."""
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
        first, second = np.log(model.constants(values, ends)[0, :, 0])
        assert one.suspect is not None
        assert other.suspect is not None
        off = max(
            abs(one.suspect.size - (second - first)), abs(other.suspect.size + (second - first))
        )
        if off <= ALIKE * abs(second - first):
            return other.specimens[0]
    return ""


def _is_stiffness(one: Aside) -> bool:
    way = None if one.suspect is None else one.suspect.hypothesis.oddity
    return way is Oddity.RESPONSE and len(one.specimens) == 1


def _off_priors(results: Results) -> tuple[QuestionedEntry, ...]:
    fit = results.final
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    step = max(1, len(vectors) // DRAWS)
    absorbed = None if results.judgement is None else results.judgement.absorbed
    return tuple(_question(one, absorbed) for one in questioned(fit.model, vectors[::step]))


def _question(one: Questioned, absorbed: Absorption | None) -> QuestionedEntry:
    low, high = one.expected
    displaced = None if absorbed is None else absorbed.of(one.parameter.name)
    known = displaced is not None and not np.isnan(displaced.moved)
    pushes = absorbed.pushed_by(displaced) if absorbed and displaced and known else ()
    return QuestionedEntry(
        parameter=one.parameter.name,
        meaning=one.parameter.meaning,
        unit=one.parameter.unit,
        median=one.value,
        prior_low=low,
        prior_high=high,
        p_value=one.p_value,
        displacement=displaced.moved if displaced and known else None,
        pushed_by=tuple(push.causes for push in pushes),
    )


def comparisons(study: Study, fit: Fit, counts: CountMisfit | None = None) -> list[ComparisonEntry]:
    """Return every published statistic beside the posterior's own, 90 % intervals.

    Of counts of ruptures it is the number that the model expects without a cause of rupture. What
    it predicts no number of stands beside nothing.
    """
    if study.summary is None:
        return []
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    values = fit.model.table.named(flat[:: max(1, len(flat) // 2000)])
    rows: list[ComparisonEntry] = []
    for row in study.summary.to_dict("records"):
        level = np.array([float(row["degradation_pct"])])
        if row["quantity"] == "young_modulus":
            draws = fit.model.young_modulus(values, level)[:, 0]
        elif row["quantity"] == "elongation_at_break" and "elongation_scatter" in values:
            draws = fit.model.elongation(values, level)[:, 0]
        elif row["quantity"] == "volume_ratio" and "volume_ratio" in values:
            draws = values["volume_ratio"]
        else:
            draws = None
        predicted = NOTHING if draws is None else _interval(draws)
        if row["quantity"] == "ruptured_count":
            predicted = _expected_ruptures(counts, level[0])
        unit = str(row["unit"]).replace("–", "")
        sd = "" if np.isnan(row["sd"]) else f" ± {row['sd']:g}"
        rows.append(
            ComparisonEntry(
                quantity=str(row["quantity"]),
                degradation_pct=None if np.isnan(level[0]) else float(level[0]),
                predicted=predicted if predicted == NOTHING else f"{predicted} {unit}".strip(),
                published=f"{row['value']:g}{sd} {unit}".strip(),
                source=str(row["source"]),
            )
        )
    return rows


FEWEST_RUPTURES = 0.05
"""Expected ruptures that are told as a number: fewer than one in twenty such studies."""


def _expected_ruptures(counts: CountMisfit | None, degradation: float) -> str:
    """Word how many actuators of a level the model expects to burst."""
    levels = () if counts is None else counts.levels
    found = [one.tested * one.probability for one in levels if one.degradation == degradation]
    if not found:
        return NOTHING
    few = found[0] < FEWEST_RUPTURES
    return f"fewer than {FEWEST_RUPTURES:g}" if few else f"{found[0]:.2g}"


def _interval(draws: NDArray[np.float64]) -> str:
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


@dataclass(frozen=True)
class Basis:
    """A file that statements of the report rest on.

    Parameters
    ----------
    file : str
        Its name.
    supports : str
        The statements; empty of published statistics.
    count : int, optional
        Its specimens or films; None of published statistics.
    counts : str
        What is counted.
    virtual : bool
        Whether they are of a virtual experiment.
    quantities : tuple of str
        Published ones.
    use : str
        One of `USES`: whether the model is fitted to them, held against them, or they are shown.
    """

    file: str
    supports: str = ""
    count: int | None = None
    counts: str = ""
    virtual: bool = False
    quantities: tuple[str, ...] = ()
    use: str = "fitted"


def bases(study: Study, model: JointModel) -> Iterator[Basis]:
    """Yield which data the statements of the report rest on."""
    virtual = study.settings.virtual
    for name, table in TABLES.items():
        frame = study.given(name)
        if frame is not None and table.supports:
            count = int(frame[next(iter(table.columns))].nunique())
            said = table.supports_in(degrades=study.degrades)
            yield Basis(table.file, said, count, table.counts, virtual)
    if study.summary is not None:
        used = {s.quantity for s in model.statistics if not s.source.startswith("shrinkage.csv")}
        used |= set() if model.published is None else {"r_squared"}
        held = {"ruptured_count", "tested_count"} - used if can_be_counted(model) else set()
        for use in USES:
            named = {str(q) for q in study.summary["quantity"] if _use(q, used, held) == use}
            if named:
                yield Basis("summary.csv", quantities=tuple(sorted(named)), use=use)


USES = ("fitted", "held against the model", "shown")


def _use(quantity: str, fitted: set[str], held: set[str]) -> str:
    """Return what is made of a published statistic."""
    return USES[0] if quantity in fitted else USES[1] if quantity in held else USES[2]


def rests_on(study: Study, model: JointModel) -> list[BasisEntry]:
    """Return which statement rests on which data, in words."""
    return [
        BasisEntry(
            statement=sentences("run", "statement", one=one),
            rests_on=sentences("run", "basis", one=one),
        )
        for one in bases(study, model)
    ] + [
        BasisEntry(
            statement=sentences("run", "dimension", one=one),
            rests_on=sentences("run", "dimension_basis", one=one),
        )
        for one in study.settings.uncertain
        if one.parameter.name in model.table.names
    ]


def _rests_on_own(study: Study, own: OwnMap) -> list[BasisEntry]:
    """Return what the statements on a forward map of one's own rest on."""
    given = "readings.csv" if study.settings.forward is not None else "readings given in Python"
    origin = "virtual experiment" if study.settings.virtual else "measured"
    counts = [len(np.unique(block.places.specimen)) for block in own.readings]
    read = ", ".join(
        f"{len(block.y)} of {block.name} on {count} specimens"
        for block, count in zip(own.readings, counts, strict=True)
    )
    return [
        BasisEntry(statement="verdict, gain, posterior", rests_on=f"{given}: {read} ({origin})"),
        BasisEntry(statement="what is predicted", rests_on=own.source),
    ]


def model_of(base: JointModel, final: JointModel, study: Study) -> ModelEntry:
    """Return what predictions need; counts that the final model is fitted to are checks too."""
    tested = specimens_tested(final) or None
    return model_document(base, study).model_copy(update={"rupture_checks": tested})


def _model_of(results: Results, study: Study) -> ModelEntry:
    found = model_of(results.base.model, results.final.model, study)
    members = () if results.averaged is None else results.averaged.members
    entries = tuple(MemberEntry(causes=m.causes, probability=m.probability) for m in members)
    return found.model_copy(update={"averaged": entries})


# share of refused proposals above which the posterior may be cut off
WORRYING = 0.01
LOOKED_AT = 1000  # posterior draws
FACTS = (
    "design",
    "model_version",
    "coarse_curves",
    "fine_curves",
    "curves_cut_short",
    "mesh_error_pct",
)
LIBRARIES = ("numpy", "scipy", "scikit-fem", "numba", "emcee", "arviz", "pandas", "xarray")


def run_document(
    study: Study,
    results: Results,
    seconds: dict[str, float],
    guard: Guard | None = None,
    doubted: InDoubt | None = None,
) -> RunRecord:
    """Return the content of ``run.json``: versions, seed, hashes, effort, times, counts."""
    settings, judgement = study.settings, results.judgement
    guard, doubted = guard or Guard(strict=True), doubted or InDoubt()
    own = results.assembly.own
    expected = results.counts_expected
    compared = guard.attempt(OptionalStage.COMPARISONS, comparisons, study, results.final, expected)
    return RunRecord(
        title=settings.title or study.name,
        study=study.name,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        virtual=settings.virtual,
        degrades=own is not None or study.degrades,
        note=settings.note,
        seed=settings.seed,
        effort=settings.effort,
        version=bayesdeg.__version__,
        versions=library_versions(),
        hashes=dict(study.hashes),
        seconds=seconds,
        memory=peaks_of_memory(),
        counts=draw_counts(results) | _proposal_counts(results),
        missing=tuple(MissingEntry(what=w, cost=c) for w, c in results.assembly.missing),
        rests_on=tuple(_rests_on_own(study, own) if own else rests_on(study, results.base.model)),
        convergence=_convergence(results),
        emulator=emulator_entry(results, guard),
        model=None if own else _model_of(results, study),
        forward=own.source if own else "",
        misfit=StatisticEntry(
            observed=None if judgement is None else judgement.misfit.statistic,
            name="log-likelihood ratio of a smooth discrepancy",
        ),
        comparisons=tuple(compared or ()),
        checks=guard.attempt(OptionalStage.CHECKS_IN_WORDS, _checks, study, results) or {},
        suspects=doubted.suspects,
        parameters_in_question=doubted.parameters_in_question,
    )


def library_versions() -> dict[str, str]:
    """Return the versions of the libraries that a run is made with, and of Python."""
    return {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()}


def _checks(study: Study, results: Results) -> dict[str, str]:
    """Return what checks, films and a vendor's figures came to, in plain words."""
    said = {} if results.checks is None else results.checks.sentences()
    absorbed = None if results.judgement is None else results.judgement.absorbed
    if absorbed is not None:
        said["absorption"] = worded(absorbed, degrades=study.degrades)
    final = results.final
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    vendor = vendor_check(study, final.model, flat)
    if vendor is not None:
        said["vendor"] = worded(vendor, degrades=study.degrades)
    return said if results.films is None else said | results.films.sentences()


def draw_counts(results: Results) -> dict[str, int]:
    """Return how many draws the posteriors have, and how many the emulator has no answer for."""
    count = results.final.chain.log_prob.size
    emulated = _emulated(results) is not None
    return {
        "posterior draws, base": results.base.chain.log_prob.size,
        "posterior draws, final": count,
        "posterior draws outside the emulator's range": (
            round(_outside(results.final) * count) if emulated else 0
        ),
    }


def _proposal_counts(results: Results) -> dict[str, int]:
    """Return how many proposals of the sampler the emulator refused, and its curves cut short."""
    forward, counts = _emulated(results), dict[str, int]()
    cut = None if forward is None else emulator_facts(forward.record).curves_cut_short
    for label, fit in results.fits.items():
        counts[f"proposals of the sampler, {label}"] = fit.chain.refusals.proposed
        counts[f"proposals refused by the emulator, {label}"] = fit.chain.refusals.refused
    name = "finite element curves of the emulator that met a limit point"
    return counts | ({} if cut is None else {name: int(cut)})


def _emulated(results: Results) -> Surrogate | None:
    """Return the emulator that stood for the mechanics, if one did."""
    world = results.base.model.world
    forward = mechanics_of(world.forward) if isinstance(world, FilmsAndActuators) else None
    return forward if isinstance(forward, Surrogate) else None


def _outside(fit: Fit) -> float:
    """Return the share of a posterior that lies outside the emulator's range, from some draws."""
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    return share_outside(fit.model, vectors[:: max(1, len(vectors) // LOOKED_AT)])


def _convergence(results: Results) -> dict[str, ConvergenceEntry]:
    return {
        label: ConvergenceEntry(
            r_hat_max=max(fit.diagnosis.r_hat),
            ess_min=min(fit.diagnosis.ess_bulk),
            sentence=worded(fit.diagnosis),
            usable=bool(fit.diagnosis.usable),
        )
        for label, fit in results.sampled.items()
    }


def emulator_entry(results: Results, guard: Guard) -> EmulatorEntry:
    """Return what stood for the mechanics, and what of a posterior and its sampling it refuses."""
    forward = _emulated(results)
    if forward is None:
        return EmulatorEntry()
    chains = {id(fit.chain): fit.chain.refusals for fit in results.fits.values()}
    refusals = sum(chains.values(), start=Refusals())
    refused = {}
    if results.final.model.actuator is not None:
        refused = guard.attempt(OptionalStage.REFUSED, refused_inputs, results.final) or {}
    words = (
        refusal_words(refusals),
        outside_words(_outside(results.final)),
        _refused_words(refused),
    )
    return emulator_facts(forward.record).model_copy(
        update={
            "refusals": " ".join(part for part in words if part),
            "refused_inputs": refused,
            "training": json.loads(forward.record),
        }
    )


def _refused_words(refused: dict[str, str]) -> str:
    """Say which inputs of new specimens are refused."""
    if not refused:
        return ""
    return f"Of new specimens in the same tests it refuses: {'; '.join(refused.values())}."


def emulator_facts(record: str) -> EmulatorEntry:
    """Return what a trained emulator's record says of itself, as far as it says it.

    Parameters
    ----------
    record : str
        JSON. Every key may be missing: ``design``, ``model_version``, ``coarse_curves``,
        ``fine_curves``, ``curves_cut_short``, ``mesh_error_pct``, and ``accuracy``, which maps a
        quantity to ``rms_pct``, ``p95_pct``, ``max_pct`` [%] and ``coverage_90`` [–] on curves
        that were not trained on.

    Examples
    --------
    >>> facts = emulator_facts('{"coarse_curves": 64, "accuracy": {"limit": {"p95_pct": 1.5}}}')
    >>> facts.coarse_curves, facts.accuracy[0].quantity, facts.accuracy[0].p95_pct
    (64, 'limit', 1.5)
    """
    trained = json.loads(record)
    by_quantity = trained.get("accuracy", {})
    if not by_quantity and "left_out_rms_pct" in trained:
        older = {
            "rms": "left_out_rms_pct",
            "p95": "left_out_p95_pct",
            "max": "left_out_largest_pct",
        }
        by_quantity = {"curvature": {f"{k}_pct": trained.get(key) for k, key in older.items()}}
    entries = [{"quantity": name} | measured for name, measured in by_quantity.items()]
    facts = EmulatorEntry.read({name: trained.get(name) for name in FACTS} | {"accuracy": entries})
    rms = by_quantity.get("curvature", {}).get("rms_pct")
    error = None if rms is None else float(np.hypot(rms, facts.mesh_error_pct or 0.0))
    return facts.model_copy(update={"error_pct": error, "record": _sentence(facts, rms)})


def _sentence(facts: EmulatorEntry, rms: float | None) -> str:
    return sentences("run", "trained", facts=facts, rms=rms)


def outside_words(share: float) -> str:
    """Say what share of the posterior lies where the emulator has no answer; nothing if none does.

    Examples
    --------
    >>> outside_words(0.25).split(", ")[0]
    "25 % of the posterior lies outside the emulator's range"
    """
    return sentences("run", "outside", share=share)


def refusal_words(refusals: Refusals) -> str:
    """Say how many proposals the emulator refused, and what to do if they are many.

    Examples
    --------
    >>> refusal_words(Refusals(200_000, 50))
    'The emulator refused 50 of 200000 proposals of the sampler (0.025 %) as outside its training.'
    """
    facts = {"proposed": refusals.proposed, "refused": refusals.refused, "worrying": WORRYING}
    return sentences("run", "refusals", **facts)
