"""Records that write, check and read ``verdict.json`` and ``run.json``."""

from collections.abc import Collection, Mapping
from operator import not_
from typing import Annotated

from pydantic import AfterValidator, Field

from bayesdeg.criticism.findings import (
    Candidate,
    Concentration,
    Conflict,
    DescriptionEntry,
    Detectable,
    Displacement,
    ExperimentEntry,
    Questioned,
    RuptureCountsEntry,
    RuptureMisfit,
)
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
    entry,
    is_absent,
)


class MisfitEntry(Record):
    """Misfit of the base model and the noise; None where there is nothing to judge."""

    rms_per_m: Number = entry("root mean square residual of the base model's curvatures [1/m]")
    noise_per_m: Number = entry("expected from noise and scatter [1/m]")
    p_value: Number = entry(
        "share of data sets simulated from the base model whose misfit is as large"
    )
    replicates: Number = entry("simulated data sets behind that share")
    where: Text = entry("pressures, degradation rates and specimens at which readings depart", "")
    concentrated: Concentration | None = entry(
        "the branch, cycle, hold or few specimens with most of the misfit; null if none"
    )
    rms_MPa: Number = entry(  # noqa: N815  a unit
        "the same of stresses, where there are no curvatures [MPa]", omitted=is_absent
    )
    noise_MPa: Number = entry(  # noqa: N815  a unit
        "expected from noise and scatter [MPa]", omitted=is_absent
    )
    rms: Number = entry("the same of `kind`, in `unit`", omitted=is_absent)
    noise: Number = entry("expected from noise and scatter, in `unit`", omitted=is_absent)
    kind: Text = entry("kind of reading, if neither curvature nor stress", "", omitted=is_absent)
    unit: Text = entry("unit of `kind`", "", omitted=is_absent)

    @property
    def sizes(self) -> tuple[float | None, float | None, str, str]:
        """Misfit and noise of the first kind of reading, its unit and its name."""
        if self.rms_per_m is not None:
            return self.rms_per_m, self.noise_per_m, "1/m", "curvature"
        if self.kind:
            return self.rms, self.noise, self.unit, self.kind
        return self.rms_MPa, self.noise_MPa, "MPa", "stress"

    @property
    def is_within_chance(self) -> bool:
        """Whether chance alone often gives such a misfit; false where none was judged."""
        return self.p_value is not None and self.p_value > MISFIT_LEVEL

    @property
    def specimens(self) -> tuple[str, ...]:
        """The few specimens with most of the misfit, if any."""
        found = self.concentrated
        return () if found is None or found.kind != "specimen" else found.members


class NamingEntry(Record):
    """The log Bayes factor required for naming, and the simulated data behind it."""

    log_bayes_factor: Number = entry("threshold that a cause has to pass to be named [nats]")
    replicates: Number = entry("number of data sets simulated to find it")


class SuspectEntry(Record):
    """A reading or specimen that its own columns or the other readings make unlikely."""

    file: Text = entry("its file", "")
    specimen: Text | None = entry("its specimen")
    column: Text | None = entry("its column, if any")
    value: Scalar = entry("value in that column")
    why: Text = entry("what is unlikely about it, and a possible reason", "")
    specimens: Names = entry("specimens, if several", (), omitted=not_)
    oddity: Text = entry(
        "how the other specimens contradict it; `beyond` for readings that no curve reaches; "
        "absent if found from its columns alone",
        "",
        omitted=is_absent,
    )
    size: Number = entry(
        "size: of ln stiffness, a fraction, or an offset in kPa", omitted=is_absent
    )
    score: Number = entry("standard deviations from what all others predict", omitted=is_absent)
    p_value: Number = entry(
        "probability of such a score by chance, times the number examined", omitted=is_absent
    )
    readings: Number = entry("rows set aside; all rows of whole specimens", omitted=is_absent)
    set_aside: bool = Field(
        default=False,
        strict=True,
        exclude_if=not_,
        description="whether it is excluded from calibration and verdict",
    )


class OutcomeEntry(Record):
    """An outcome and its causes, as at the top of ``verdict.json``."""

    outcome: Outcome = Field(description="as above")
    causes: Names = entry("as above", ())
    one_of: tuple[Names, ...] = entry("as above", ())
    without: Names = entry(
        "parts of a verdict that this one leaves out to save time", (), omitted=not_
    )


class LeftOutEntry(Record):
    """A stage that could not be computed, and why."""

    stage: Text = entry("which", "")
    why: Text = entry("why", "")


class UnusedEntry(Record):
    """Rows of a file that no likelihood uses."""

    file: Text = entry("file that holds them", "")
    rows: Number = entry("how many")
    specimens: Names = entry("specimens of these rows", ())
    why: Text = entry(
        "reason as a key: `after_burst`, `outside_stretch_range`, `undeformed`, `unloaded`, "
        "`beyond_reach` or `set_aside`",
        "",
    )
    sentence: Text = entry("the same in words", "")


class MapNoiseEntry(Record):
    """Difference between two calls of a forward map with the same values."""

    kind: Text = entry("which kind", "")
    unit: Text = entry("unit of the readings", "")
    sd: Number = entry("standard deviation of the map's own noise")


class ForwardMapEntry(Record):
    """How often a user's forward map has no finite answer, and its noise.

    Shares count parameter vectors at which some reading has no finite prediction.
    """

    prior_draws: Number = entry("prior draws at which it was evaluated")
    prior_unanswered: Number = entry(
        "share of them at which some prediction is NaN or infinite [–]"
    )
    proposals: Number = entry("parameter vectors that the samplers proposed")
    proposals_unanswered: Number = entry(
        "share of them at which some prediction is NaN or infinite [–]"
    )
    noise: tuple[MapNoiseEntry, ...] = entry(
        "kinds of readings whose predictions differ between two calls with the same values; absent "
        "if none do",
        (),
        omitted=not_,
    )


class InDoubt(Record):
    """Warnings to read before a verdict is used."""

    unused: tuple[UnusedEntry, ...] = ()
    not_converged: Names = Field(
        default=(),
        description="calibrations that missed the criteria of their effort, with diagnostics",
    )
    suspects: tuple[SuspectEntry, ...] = ()
    parameters_in_question: tuple[Questioned, ...] = ()
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

    outcome: Outcome = Field(
        description="`adequate`, `named`, `ambiguous`, `unexplained` or `not_judged`"
    )
    causes: Names = entry(
        "the named causes; for an ambiguous outcome, those that these data cannot tell apart", ()
    )
    one_of: tuple[Names, ...] = entry(
        "sets of causes, from each of which one more acts that cannot be identified", ()
    )
    sets: tuple[Names, ...] = entry(
        "lists from each of which one cause acts, every combination being supported; a named cause "
        "is alone in its list; empty where nothing is, or where the possible sets are not "
        "combinations from lists",
        (),
    )
    alternatives: tuple[Names, ...] = entry(
        "sets of causes of which one acts, the most plausible first, where they are not "
        "combinations from lists",
        (),
    )
    explanation: Text = entry("one paragraph in plain words", "")
    candidates: tuple[Candidate, ...] = entry(
        "every cause that was tried, best first, also those that cannot be judged", ()
    )
    confusable: tuple[Names, ...] = entry(
        "pairs of causes that a study of this design could confuse, by simulation", ()
    )
    false_name_rate: Number = entry(
        "share of data sets simulated without an effect in which some cause passes the naming "
        "threshold"
    )
    naming: NamingEntry | None = None
    predicted_with: Names = entry(
        "causes in the model that bands, ruptures and decisions are predicted with", ()
    )
    misfit: MisfitEntry = MisfitEntry()
    detectable: Detectable | None = entry(
        "the smallest misfit that this study could have detected; null if no p-value is known"
    )
    ruptures: RuptureMisfit | None = entry("null where no actuator could be judged by its rupture")
    rupture_counts: tuple[RuptureCountsEntry, ...] = entry(
        "rupture counts and what the model expects, published ones first, then of the study's own "
        "actuators; no probability is below one in `draws`",
        (),
    )
    contradicted: Conflict | None = entry(
        "the measured mean that the base model contradicts most; null if it contradicts none"
    )
    next_experiments: tuple[ExperimentEntry, ...] = entry(
        "experiments that would best tell apart the causes in question, best first", ()
    )
    absorbed: tuple[Displacement, ...] = entry(
        "parameters of the base model that absorb a model error, the most displaced first", ()
    )
    description: DescriptionEntry | None = entry(
        "description of a misfit that no cause, or no cause fully, accounts for; otherwise absent",
        omitted=is_absent,
    )
    suspects: tuple[SuspectEntry, ...] = entry(
        "readings and specimens that are unlikely, such as one in a different unit", ()
    )
    parameters_in_question: tuple[Questioned, ...] = entry(
        "parameters calibrated to values that their priors all but exclude", ()
    )
    unused: tuple[UnusedEntry, ...] = entry("rows of the study's files that no likelihood uses", ())
    not_converged: Names = entry(
        "calibrations that missed the criteria of their effort, each with its diagnostics", ()
    )
    with_suspects: OutcomeEntry | None = entry(
        "outcome of the study with nothing set aside, judged briefly; absent if nothing was",
        omitted=is_absent,
    )
    forward_map: ForwardMapEntry | None = entry(
        "where your forward map has no finite answer, and its noise; absent for actuators and "
        "films",
        omitted=is_absent,
    )
    left_out: tuple[LeftOutEntry, ...] = entry("stages that could not be computed, and why", ())

    @property
    def is_directed(self) -> bool:
        """Whether only the directed test, not the overall misfit, supports the causes."""
        return bool(self.causes) and self.misfit.is_within_chance

    @property
    def judged(self) -> bool:
        """Whether the simulation was judged: data existed and the stages succeeded.

        Only the outcome says so: films have no misfit in curvature, and causes that the data cannot
        tell apart have no probability.
        """
        return self.outcome is not Outcome.NOT_JUDGED

    def candidate(self, cause: str) -> Candidate | None:
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


def _one_of(names: Collection[str]) -> AfterValidator:
    """Return a check of a field that is one of these names, or empty."""

    def known(name: str) -> str:
        if name and name not in names:
            raise ValueError(f"must be one of {', '.join(names)}, not {name!r}")
        return name

    return AfterValidator(known)


class ModelEntry(Record):
    """What predicting with a posterior needs besides its draws."""

    parameters: Names = Field(default=(), description="of the base model")
    nodes_pct: RisingNumbers = ()
    elongation_nodes_pct: RisingNumbers = ()
    paper_thickness_mm: PositiveNumber = None
    largest_pressure_kPa: PositiveNumber = None  # noqa: N815  a unit
    measured: Mapping[str, tuple[Number, ...]] = Field(default={}, description="ranges by name")
    rupture_criterion: Annotated[Text, _one_of(RUPTURE_CRITERIA)] = Field(
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
    material_law: Annotated[Text, _one_of(CALIBRATED_LAWS)] = Field(
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
    parameters_in_question: tuple[Questioned, ...] = ()
    unused: tuple[UnusedEntry, ...] = Field(default=(), description="rows that no likelihood uses")
    posteriors: Texts = Field(default={}, description="SHA-256 of the posteriors")
    update: UpdateEntry | None = Field(
        default=None, exclude_if=is_absent, description="readings added since the run"
    )
    left_out: tuple[LeftOutEntry, ...] = ()
