"""Records that write, check and read ``verdict.json`` and ``run.json``."""

from collections.abc import Mapping
from operator import not_
from typing import Annotated

from pydantic import AfterValidator, Field

from bayesdeg.criticism.outcome import MISFIT_LEVEL, Outcome
from bayesdeg.data.settings import CALIBRATED_LAWS, RUPTURE_CRITERIA
from bayesdeg.records import (
    Count,
    FileRecord,
    Names,
    NeededText,
    Number,
    Numbers,
    PositiveNumber,
    Record,
    RisingNumbers,
    Scalar,
    SeedNumber,
    Text,
    Texts,
    is_absent,
)


class EffectEntry(Record):
    """Posterior of one parameter of a cause, in `unit`."""

    mean: Number = None
    sd: Number = None
    q05: Number = None
    q95: Number = None
    unit: Text = ""


class CandidateEntry(Record):
    """One candidate cause; if it could not be judged, `probability` is None and `why` says why."""

    cause: Text = ""
    probability: Number = Field(default=None, description="null if the cause cannot be judged")
    log_bayes_factor: Number = Field(default=None, description="[nats]")
    log_bayes_factor_error: Number = Field(default=None, description="Monte Carlo error [nats]")
    elpd_diff: Number = Field(default=None, description="held-out log predictive gain [nats]")
    elpd_diff_se: Number = None
    explained_fraction: Number = Field(default=None, description="of the misfit beyond chance")
    effect: Mapping[str, EffectEntry] = Field(default={}, description="by parameter of the cause")
    mechanism: Text = ""
    naming_p_value: Number = Field(
        default=None,
        exclude_if=is_absent,
        description="share of data simulated without the cause that favour the best cause as much",
    )
    why: Text = Field(default="", exclude_if=is_absent, description="why it cannot be judged")
    judged_by: Text = Field(default="", exclude_if=is_absent, description="full fit or screening")


class ConcentrationEntry(Record):
    """The branch, cycle, hold or few specimens with most of the misfit."""

    kind: Text = ""
    members: Names = ()
    excess_pct: tuple[Number, ...] = ()
    share_of_misfit: Number = None
    share_of_readings: Number = None
    p_value: Number = None


class MisfitEntry(Record):
    """Misfit of the base model and the noise; None where there is nothing to judge."""

    rms_per_m: Number = Field(default=None, description="of curvature [1/m]")
    noise_per_m: Number = Field(default=None, description="of curvature [1/m]")
    p_value: Number = None
    replicates: Number = Field(default=None, description="simulated data sets behind p_value")
    where: Text = ""
    concentrated: ConcentrationEntry | None = None
    rms_MPa: Number = Field(  # noqa: N815  a unit
        default=None, exclude_if=is_absent, description="of stress [MPa]"
    )
    noise_MPa: Number = Field(  # noqa: N815  a unit
        default=None, exclude_if=is_absent, description="of stress [MPa]"
    )
    rms: Number = Field(default=None, exclude_if=is_absent, description="of `kind`, in `unit`")
    noise: Number = Field(default=None, exclude_if=is_absent, description="of `kind`, in `unit`")
    kind: Text = Field(
        default="",
        exclude_if=is_absent,
        description="kind of reading, if neither curvature nor stress",
    )
    unit: Text = Field(default="", exclude_if=is_absent, description="of `kind`")

    @property
    def sizes(self) -> tuple[float | None, float | None, str, str]:
        """Misfit and noise of the first kind of reading, its unit and its name."""
        if self.rms_per_m is not None:
            return self.rms_per_m, self.noise_per_m, "1/m", "curvature"
        if self.kind:
            return self.rms, self.noise, self.unit, self.kind
        return self.rms_MPa, self.noise_MPa, "MPa", "stress"

    @property
    def specimens(self) -> tuple[str, ...]:
        """The few specimens with most of the misfit, if any."""
        found = self.concentrated
        return () if found is None or found.kind != "specimen" else found.members


class PairEntry(Record):
    """How well an experiment is expected to separate two causes."""

    causes: Names = ()
    expected_log_bayes_factor: Number = None


class ExperimentEntry(Record):
    """A proposed experiment, the causes it would separate, and its cost."""

    design: Text = ""
    separates: Names = ()
    expected_log_bayes_factor: Number = Field(default=None, description="[nats]")
    monte_carlo_error: Number = Field(default=None, exclude_if=is_absent)
    specimens: Number = Field(default=None, exclude_if=is_absent)
    readings: Number = Field(default=None, exclude_if=is_absent)
    per_specimen: Number = Field(
        default=None, exclude_if=is_absent, description="log Bayes factor a specimen [nats]"
    )
    pairs: tuple[PairEntry, ...] = ()


class NamingEntry(Record):
    """The log Bayes factor required for naming, and the simulated data behind it."""

    log_bayes_factor: Number = None
    replicates: Number = None


class RuptureEntry(Record):
    """Observed ruptures and the number that the base model expects."""

    burst: Number = None
    expected: Number = None
    deviance: Number = None
    p_value: Number = None


class CountedLevelEntry(Record):
    """Actuators of one degradation rate that burst, and what the model expects."""

    degradation_pct: Number = None
    pressure_kPa: Number = Field(  # noqa: N815  a unit
        default=None, description="up to which they were tested [kPa]"
    )
    tested: Number = None
    ruptured: Number = None
    probability: Number = Field(default=None, description="that one actuator bursts, not below 1/n")
    probability_q05: Number = None
    probability_q95: Number = None
    count_probability: Number = Field(default=None, description="of as many ruptures")


class CountedCauseEntry(Record):
    """Evidence of rupture counts for one cause, or for an equal reduction of all limits."""

    cause: Text = ""
    log_bayes_factor: Number = Field(default=None, description="[nats]")
    p_value: Number = Field(default=None, description="of the counts with this cause")


class RuptureCountsEntry(Record):
    """Probability of the rupture counts; none is stated below one in `draws`."""

    source: Text = ""
    levels: tuple[CountedLevelEntry, ...] = ()
    probability: Number = Field(default=None, description="of exactly these counts, not below 1/n")
    p_value: Number = Field(default=None, description="of counts no more probable than these")
    draws: Number = Field(default=None, description="n, posterior draws")
    contradicted: bool = Field(default=False, strict=True)
    criteria: Numbers = Field(default={}, description="p-values by the other criteria of rupture")
    explained_by: Names = Field(
        default=(), description="a cause, or several that cannot be told apart"
    )
    tried: tuple[CountedCauseEntry, ...] = ()
    sentence: Text = ""


class ContradictionEntry(Record):
    """The measured mean that the base model contradicts most."""

    quantity: Text = ""
    measured: Number = None
    standard_error: Number = None
    source: Text = ""
    calibrated: Number = None
    p_value: Number = None


class SuspectEntry(Record):
    """A reading or specimen that its own columns or the other readings make unlikely."""

    file: Text = ""
    specimen: Text | None = None
    column: Text | None = None
    value: Scalar = None
    why: Text = ""
    specimens: Names = Field(default=(), exclude_if=not_, description="if several")
    oddity: Text = Field(default="", exclude_if=is_absent, description="how it is odd")
    size: Number = Field(default=None, exclude_if=is_absent)
    score: Number = Field(
        default=None,
        exclude_if=is_absent,
        description="standard deviations from what all others predict",
    )
    p_value: Number = Field(
        default=None, exclude_if=is_absent, description="of such a score, times the number examined"
    )
    readings: Number = Field(
        default=None,
        exclude_if=is_absent,
        description="rows set aside; all rows of whole specimens",
    )
    set_aside: bool = Field(
        default=False,
        strict=True,
        exclude_if=not_,
        description="whether it is excluded from the calibration",
    )


class MissingTermEntry(Record):
    """A term in known quantities that removes part of a misfit; sizes in `unit`."""

    formula: Text = Field(default="", description="the reading with the term, b its size")
    columns: Names = Field(default=(), description="quantities that it depends on")
    size: Number = None
    q05: Number = None
    q95: Number = None
    unit: Text = ""
    share_of_misfit: Number = Field(default=None, description="with the terms before it")
    p_value: Number = None
    elpd_diff: Number = Field(default=None, description="held-out log predictive gain [nats]")
    elpd_diff_se: Number = None
    alike: Names = Field(default=(), description="terms that fit as well, the best first")
    count_alike: Number = Field(default=None, description="their number")


class LevelMisfitEntry(Record):
    """Share of a misfit in one level of a column."""

    level: Text = ""
    readings: Number = None
    share_of_misfit: Number = None
    excess: Number = Field(default=None, description="measured less simulated, on average")
    excess_pct: Number = Field(default=None, description="the same over the simulated [%]")


class ColumnMisfitEntry(Record):
    """Shares of a misfit in the levels of a column; sizes are of `kind`, in `unit`."""

    column: Text = ""
    share_of_misfit: Number = None
    kind: Text = ""
    unit: Text = ""
    levels: tuple[LevelMisfitEntry, ...] = ()


class DescriptionEntry(Record):
    """Description of a misfit that no cause accounts for."""

    sentence: Text = ""
    with_causes: Names = Field(default=(), description="causes in the model with this misfit")
    terms: tuple[MissingTermEntry, ...] = ()
    columns: tuple[ColumnMisfitEntry, ...] = ()
    p_value: Number = Field(default=None, description="of the best of all terms")
    tried: Number = Field(default=None, description="terms that were tried")
    replicates: Number = Field(default=None, description="simulated data sets behind p_value")
    next_experiments: tuple[ExperimentEntry, ...] = Field(
        default=(), description="experiments that would tell the best terms apart"
    )


class OutcomeEntry(Record):
    """An outcome and its causes, as at the top of ``verdict.json``."""

    outcome: Outcome
    causes: Names = ()
    one_of: tuple[Names, ...] = ()


class QuestionedEntry(Record):
    """A parameter calibrated to a value that its prior all but excludes; None is no bound.

    The bounds are those of the interval that holds 99.9 % of the prior.
    """

    parameter: Text = ""
    meaning: Text = ""
    unit: Text = ""
    median: Number = None
    prior_low: Number = None
    prior_high: Number = None
    p_value: Number = None
    displacement: Number = Field(default=None, exclude_if=is_absent)
    pushed_by: tuple[Names, ...] = Field(default=(), exclude_if=not_)


class AbsorbedEntry(Record):
    """A parameter of the base model that absorbs a model error.

    "All else" is all other information: the prior, films and means of replicates, without the
    readings by which the model is judged.
    """

    parameter: Text = ""
    meaning: Text = ""
    unit: Text = ""
    median: Number = None
    all_else_low: Number = None
    all_else_median: Number = None
    all_else_high: Number = None
    measured: Number = None
    measured_se: Number = None
    source: Text = ""
    displacement: Number = None
    p_value: Number = None
    pushed_by: tuple[Names, ...] = ()
    explained_share: Number = None
    median_after: Number = None
    displacement_after: Number = None


class LeftOutEntry(Record):
    """A stage that could not be computed, and why."""

    stage: Text = ""
    why: Text = ""


class UnusedEntry(Record):
    """Rows of a file that no likelihood uses."""

    file: Text = ""
    rows: Number = None
    specimens: Names = ()
    why: Text = Field(default="", description="the reason, as a key")
    sentence: Text = ""


class MapNoiseEntry(Record):
    """Difference between two calls of a forward map with the same values."""

    kind: Text = ""
    unit: Text = ""
    sd: Number = None


class ForwardMapEntry(Record):
    """How often a user's forward map has no finite answer, and its noise.

    Shares count parameter vectors at which some reading has no finite prediction.
    """

    prior_draws: Number = None
    prior_unanswered: Number = Field(default=None, description="share [–]")
    proposals: Number = None
    proposals_unanswered: Number = Field(default=None, description="share [–]")
    noise: tuple[MapNoiseEntry, ...] = Field(default=(), exclude_if=not_)


class InDoubt(Record):
    """Warnings to read before a verdict is used."""

    unused: tuple[UnusedEntry, ...] = ()
    not_converged: Names = Field(
        default=(),
        description="calibrations that missed the criteria of their effort, with diagnostics",
    )
    suspects: tuple[SuspectEntry, ...] = ()
    parameters_in_question: tuple[QuestionedEntry, ...] = ()
    with_suspects: OutcomeEntry | None = Field(default=None, exclude_if=is_absent)
    forward_map: ForwardMapEntry | None = Field(default=None, exclude_if=is_absent)


class VerdictRecord(FileRecord):
    """The content of ``verdict.json``.

    Examples
    --------
    >>> VerdictRecord.read({"outcome": "ambiguous"}).judged
    True
    >>> VerdictRecord.read({"outcome": "fine"})
    Traceback (most recent call last):
    ...
    bayesdeg.records.RecordError: 'outcome' must be 'adequate', 'named', 'ambiguous', ...
    """

    outcome: Outcome
    causes: Names = Field(default=(), description="named, or that cannot be told apart")
    one_of: tuple[Names, ...] = ()
    sets: tuple[Names, ...] = Field(
        default=(), description="one cause of each list acts; a named one is alone in its list"
    )
    alternatives: tuple[Names, ...] = Field(
        default=(), description="sets of causes of which one acts, if not combinations from lists"
    )
    explanation: Text = ""
    candidates: tuple[CandidateEntry, ...] = Field(default=(), description="best first")
    confusable: tuple[Names, ...] = ()
    false_name_rate: Number = None
    naming: NamingEntry | None = None
    predicted_with: Names = ()
    misfit: MisfitEntry = MisfitEntry()
    ruptures: RuptureEntry | None = None
    rupture_counts: tuple[RuptureCountsEntry, ...] = Field(
        default=(), description="published, and from the study's own actuators"
    )
    contradicted: ContradictionEntry | None = None
    next_experiments: tuple[ExperimentEntry, ...] = ()
    absorbed: tuple[AbsorbedEntry, ...] = ()
    description: DescriptionEntry | None = Field(
        default=None,
        exclude_if=is_absent,
        description="description of a misfit that no cause accounts for",
    )
    suspects: tuple[SuspectEntry, ...] = ()
    parameters_in_question: tuple[QuestionedEntry, ...] = ()
    unused: tuple[UnusedEntry, ...] = Field(default=(), description="rows that no likelihood uses")
    not_converged: Names = ()
    with_suspects: OutcomeEntry | None = Field(
        default=None,
        exclude_if=is_absent,
        description="the outcome with nothing set aside; present only if something was",
    )
    forward_map: ForwardMapEntry | None = Field(
        default=None, exclude_if=is_absent, description="for a study with its own forward map"
    )
    left_out: tuple[LeftOutEntry, ...] = ()

    @property
    def is_directed(self) -> bool:
        """Whether only the directed test, not the overall misfit, supports the causes."""
        p_value = self.misfit.p_value
        return bool(self.causes) and p_value is not None and p_value > MISFIT_LEVEL

    @property
    def judged(self) -> bool:
        """Whether the simulation was judged: data existed and the stages succeeded.

        Only the outcome says so: films have no misfit in curvature, and causes that the data cannot
        tell apart have no probability.
        """
        return self.outcome is not Outcome.NOT_JUDGED

    def candidate(self, cause: str) -> CandidateEntry | None:
        """Return the entry of a cause, or None if it was not tried."""
        return next((entry for entry in self.candidates if entry.cause == cause), None)

    def why_left_out(self, stage: str) -> str:
        """Return why a stage was left out; empty if it was not."""
        return next((entry.why for entry in self.left_out if entry.stage == stage), "")


class ComparisonEntry(Record):
    """A prediction and the published value of the same quantity."""

    quantity: Text = ""
    degradation_pct: Number = None
    predicted: Text = ""
    published: Text = ""
    source: Text = ""


class ConvergenceEntry(Record):
    """Whether the posterior of a model is usable, and why."""

    r_hat_max: Number = None
    ess_min: Number = None
    sentence: Text = ""
    usable: bool = Field(default=True, strict=True)


class AccuracyEntry(Record):
    """Accuracy of an emulator for a quantity, on curves that it was not trained on."""

    quantity: Text = ""
    rms_pct: Number = None
    p95_pct: Number = None
    max_pct: Number = None
    coverage_90: Number = Field(default=None, description="share inside its own 90 % interval")


class EmulatorEntry(Record):
    """The emulator that replaced the finite element model; empty if there was none."""

    design: Text = ""
    model_version: Text = Field(default="", description="of the finite element model")
    coarse_curves: Number = None
    fine_curves: Number = None
    curves_cut_short: Number = None
    mesh_error_pct: Number = None
    accuracy: tuple[AccuracyEntry, ...] = ()
    error_pct: Number = Field(
        default=None, description="in curvature, including the mesh error [%]"
    )
    record: Text = Field(default="", description="how it was trained, in words")
    refusals: Text = Field(default="", description="how many proposals it refused, in words")
    refused_inputs: Texts = Field(default={}, description="for new specimens, and why")
    training: Mapping[str, object] = Field(
        default={}, description="its own record, which identifies it"
    )

    @property
    def facts(self) -> Mapping[str, str]:
        """Design, version and numbers of curves, as far as known."""
        told = {
            "design": self.design,
            "version of the finite element model": self.model_version,
            "curves of the coarse mesh": self.coarse_curves,
            "curves of the fine mesh": self.fine_curves,
        }
        return {label: str(fact) for label, fact in told.items() if not is_absent(fact)}


class BurstEntry(Record):
    """Actuators that burst, as they were recorded or published."""

    degradation_pct: Number = None
    burst: Number = Field(default=None, description="number that burst")
    tested: Number = Field(default=None, description="number tested, if known")
    pressure_kPa: Number = Field(  # noqa: N815  a unit
        default=None, description="pressure at which it burst; null if not recorded"
    )
    survived_kPa: Number = Field(  # noqa: N815  a unit
        default=None, description="largest pressure survived before; null if none recorded"
    )
    source: Text = ""


class MemberEntry(Record):
    """One of the sets of causes over which predictions are averaged."""

    causes: Names = ()
    probability: Number = Field(default=None, description="among those that cannot be told apart")


def _known_law(name: str) -> str:
    if name and name not in CALIBRATED_LAWS:
        raise ValueError(f"must be one of {', '.join(CALIBRATED_LAWS)}, not {name!r}")
    return name


def _known_criterion(name: str) -> str:
    if name and name not in RUPTURE_CRITERIA:
        raise ValueError(f"must be one of {', '.join(RUPTURE_CRITERIA)}, not {name!r}")
    return name


class ModelEntry(Record):
    """What predicting with a posterior needs besides its draws."""

    parameters: Names = Field(default=(), description="of the base model")
    nodes_pct: RisingNumbers = ()
    elongation_nodes_pct: RisingNumbers = ()
    paper_thickness_mm: PositiveNumber = None
    largest_pressure_kPa: PositiveNumber = None  # noqa: N815  a unit
    measured: Mapping[str, tuple[Number, ...]] = Field(default={}, description="ranges by name")
    rupture_criterion: Annotated[Text, AfterValidator(_known_criterion)] = Field(
        default="",
        exclude_if=is_absent,
        description="measure that is compared with the elongation at break",
    )
    rupture_size_ratio: Number = Field(
        default=None,
        exclude_if=is_absent,
        description="volume of the moulded actuator over that of a stretched film",
    )
    reading_operator: Text = Field(
        default="", exclude_if=is_absent, description="how curvature was read, if not by its angle"
    )
    reading_points: Number = Field(
        default=None, exclude_if=is_absent, description="number of points it was read from"
    )
    reading_of_line: bool = Field(
        default=False,
        exclude_if=not_,
        description="whether the bend angle was read from the same points",
    )
    material_law: Annotated[Text, AfterValidator(_known_law)] = Field(
        default="", exclude_if=is_absent, description="material law, if not Yeoh's"
    )
    stiffening: PositiveNumber = Field(
        default=None, exclude_if=is_absent, description="C3/C1, where C3 is not a parameter"
    )
    rupture_checks: Count = Field(
        default=None,
        description="films broken and actuators loaded: no probability of rupture is below 1/n",
    )
    bursts: tuple[BurstEntry, ...] = Field(
        default=(), description="ruptures of actuators, recorded and published"
    )
    averaged: tuple[MemberEntry, ...] = Field(
        default=(),
        description="sets of causes that cannot be told apart, averaged in posterior_averaged.nc",
    )


class StatisticEntry(Record):
    """The misfit statistic of this study."""

    observed: Number = None
    name: Text = ""


class MissingEntry(Record):
    """Missing data, and what that costs."""

    what: Text = ""
    cost: Text = ""


class BasisEntry(Record):
    """A statement of the report and the data behind it."""

    statement: Text = ""
    rests_on: Text = ""


class TakenInEntry(Record):
    """How further readings were added to the posterior of one model."""

    method: Text = Field(default="", description="weights, refit or mode")
    effective: Number = Field(default=None, description="effective draws")
    pareto_k: Number = Field(default=None, description="of their weights; reliable up to 0.7")
    weights_effective: Number = Field(
        default=None, description="effective draws of the earlier posterior under the new readings"
    )
    weights_pareto_k: Number = None
    log_density: Number = Field(
        default=None, description="of the new readings given the earlier ones [nats]"
    )


class UpdateEntry(Record):
    """Readings added to a finished run; the verdict is the earlier one."""

    run: Text = Field(default="", description="the run folder that was updated")
    times: Number = Field(default=None, description="updates since the study was run")
    specimens: Names = Field(default=(), description="those with new readings")
    readings: Number = Field(default=None, description="new rows")
    added_sha256: Text = Field(default="", description="SHA-256 of added.csv")
    posteriors: Mapping[str, TakenInEntry] = Field(default={}, description="by model")
    as_before: Names = Field(default=(), description="files kept from the earlier run")
    not_averaged: tuple[MemberEntry, ...] = Field(
        default=(),
        description="sets of causes over which the earlier run was averaged; predictions are now "
        "those with the first",
    )


class RunRecord(FileRecord):
    """The content of ``run.json``.

    Examples
    --------
    >>> RunRecord.read({"title": "Treloar", "seconds": {"sample": 2}}).seconds
    {'sample': 2}
    >>> RunRecord.read({})
    Traceback (most recent call last):
    ...
    bayesdeg.records.RecordError: 'title' is missing
    """

    title: NeededText
    study: Text = ""
    created: Text = Field(default="", description="date and time, ISO 8601")
    virtual: bool = Field(default=False, strict=True)
    degrades: bool = Field(
        default=True,
        strict=True,
        exclude_if=bool,
        description="false if nothing in the study degrades",
    )
    note: Text = ""
    seed: SeedNumber = None
    effort: Text = ""
    version: Text = Field(default="", description="of bayesdeg")
    versions: Texts = Field(default={}, description="of the libraries")
    hashes: Texts = Field(default={}, description="SHA-256 of the files of the study")
    seconds: Numbers = Field(default={}, description="wall time by stage [s]")
    memory: Numbers = Field(
        default={},
        description="largest resident memory by process [MB], if available",
    )
    counts: Numbers = Field(default={}, description="of draws, proposals and refusals")
    missing: tuple[MissingEntry, ...] = ()
    rests_on: tuple[BasisEntry, ...] = ()
    convergence: Mapping[str, ConvergenceEntry] = Field(default={}, description="by model")
    emulator: EmulatorEntry = EmulatorEntry()
    model: ModelEntry | None = None
    forward: Text = Field(
        default="", exclude_if=is_absent, description="where the user's forward map is defined"
    )
    forward_map: ForwardMapEntry | None = Field(
        default=None, exclude_if=is_absent, description="as in verdict.json"
    )
    misfit: StatisticEntry = StatisticEntry()
    comparisons: tuple[ComparisonEntry, ...] = ()
    checks: Texts = Field(default={}, description="result of each check, in words")
    suspects: tuple[SuspectEntry, ...] = ()
    parameters_in_question: tuple[QuestionedEntry, ...] = ()
    unused: tuple[UnusedEntry, ...] = Field(default=(), description="rows that no likelihood uses")
    posteriors: Texts = Field(default={}, description="SHA-256 of the posteriors")
    update: UpdateEntry | None = Field(
        default=None, exclude_if=is_absent, description="readings added since the run"
    )
    left_out: tuple[LeftOutEntry, ...] = ()
