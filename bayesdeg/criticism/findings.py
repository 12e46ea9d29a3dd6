"""Findings of a criticism as records: computed, written to files, and read back as they are."""

from collections.abc import Mapping

import numpy as np
from pydantic import Field
from pydantic.json_schema import SkipJsonSchema

from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.records import Names, Number, Numbers, Real, Record, Text, entry, inner, is_absent

NAN = float("nan")


class EffectSize(Record):
    """Posterior of one parameter of a cause, in `unit`."""

    mean: Number = entry("posterior mean, in `unit`")
    sd: Number = entry("posterior standard deviation")
    q05: Number = entry("5 % quantile")
    q95: Number = entry("95 % quantile")
    unit: Text = entry("unit of the four", "")


class Candidate(Record):
    """One candidate cause; if it could not be judged, `probability` is null and `why` says why."""

    cause: Text = entry("name of the cause", "")
    probability: Number = entry(
        "posterior probability among the causes judged; null where it was not judged"
    )
    log_bayes_factor: Number = entry(
        "evidence for it: for a named cause relative to the model with the other named causes, for "
        "the rest relative to the base model [nats]"
    )
    log_bayes_factor_error: Number = entry("Monte Carlo standard error of that [nats]")
    elpd_diff: Number = entry("gain in log predictive density of held-out specimens [nats]")
    elpd_diff_se: Number = entry("standard error of that [nats]")
    explained_fraction: Number = entry(
        "share of the misfit beyond chance that it removes; for a named cause, together with the "
        "others"
    )
    effect: Mapping[str, EffectSize] = entry("its parameters by their short names", {})
    mechanism: Text = entry("what happens, in a sentence", "")
    naming_p_value: Number = entry(
        "share of data sets simulated without an effect in which the best of all causes gains as "
        "much",
        omitted=is_absent,
    )
    why: Text = entry("why it was not judged or not named", "", omitted=is_absent)
    judged_by: Text = entry(
        "`full fit`, or `screening` where it was too far behind for one", "", omitted=is_absent
    )


class Concentration(Record):
    """The branch, cycle, hold or few specimens with most of the misfit."""

    kind: Text = entry("`branch`, `cycle`, `hold` or `specimen`", "")
    members: Names = entry(
        "`unloading`; `cycle 2` or `cycles after the first`; `readings after a hold`; or the names "
        "of specimens",
        (),
    )
    excess_pct: tuple[Real, ...] = entry(
        "of the simulated, by how much each lies above the other readings, as far as that differs "
        "from the simulation [%]",
        (),
    )
    share_of_misfit: Real = entry("share of the misfit statistic in them", NAN)
    share_of_readings: Real = entry("share of all readings that are theirs", NAN)
    p_value: Real = entry(
        "share of simulated data sets in which the best of all groups gains as much", NAN
    )


class DetectableCause(Record):
    """The size at which a cause would have been named."""

    cause: Text = entry("name of the cause", "")
    parameter: Text = entry("its parameter", "")
    size: Real = entry(
        "size at which it would have been named in nine of ten such studies, in `unit`", NAN
    )
    unit: Text = entry("unit of the size", "")


class Detectable(Record):
    """The smallest misfit that nine of ten repetitions of a study would detect."""

    kind: Text = entry("kind of the readings", "")
    misfit_pct: Real = entry(
        "largest value of a smooth misfit, over the largest reading of its kind, after the "
        "parameters are fitted again [%]",
        NAN,
    )
    specimens: int = Field(
        default=0, description="specimens with such readings; 0 if they have no scatter"
    )
    causes: tuple[DetectableCause, ...] = entry(
        "sizes of the nearest causes; those that no plausible size would reveal are left out", ()
    )


class RuptureMisfit(Record):
    """Observed ruptures and the number that the base model expects."""

    burst: Real = entry("number of actuators that burst", NAN)
    expected: Real = entry("how many burst in data simulated from the base model, on average", NAN)
    deviance: Real = entry(
        "−2 Σ ln of the probability of what each actuator did, averaged over the posterior", NAN
    )
    p_value: Real = entry("share of simulated data sets that are at least as improbable", NAN)
    known: SkipJsonSchema[int] = inner("simulated data sets with a probability", 0)
    drawn: SkipJsonSchema[int] = inner("simulated data sets", 0)


class CountedLevel(Record):
    """Actuators of one degradation rate that burst, and what the model expects."""

    degradation_pct: Real = entry("degradation rate [%]", NAN)
    pressure_kPa: Real = entry(  # noqa: N815  a unit
        "pressure up to which they were tested [kPa]", NAN
    )
    tested: Real = entry("number of actuators", NAN)
    ruptured: Real = entry("number of them that burst", NAN)
    probability: Real = entry(
        "probability that one of them bursts, averaged over the posterior and the scatter of "
        "specimens",
        NAN,
    )
    probability_q05: Real = entry("5 % quantile of it over the posterior", NAN)
    probability_q95: Real = entry("95 % quantile of it over the posterior", NAN)
    count_probability: Real = entry("probability of as many ruptures at this rate", NAN)

    def not_below(self, least: float) -> "CountedLevel":
        """Return it with no probability below the least that the draws resolve."""
        names = ("probability", "probability_q05", "probability_q95", "count_probability")
        return self.model_copy(update={name: max(getattr(self, name), least) for name in names})


class CountedCauseEntry(Record):
    """Evidence of rupture counts for one cause, or for an equal reduction of all limits."""

    cause: Text = entry("its name", "")
    log_bayes_factor: Number = entry(
        "of the model with it relative to the one without, both fitted to readings and counts "
        "[nats]"
    )
    p_value: Number = entry("probability of counts no more probable than these, with it")


class RuptureCountsEntry(Record):
    """Probability of the rupture counts; none is stated below one in `draws`."""

    source: Text = entry("the file that gives them", "")
    levels: tuple[CountedLevel, ...] = entry("one entry for each degradation rate", ())
    probability: Number = entry("probability of exactly these counts, all rates together")
    p_value: Number = entry(
        "probability of counts that are no more probable than these; below 0.01 they contradict "
        "the model"
    )
    draws: Number = entry("posterior draws on which the probabilities rest")
    contradicted: bool = Field(
        default=False,
        strict=True,
        description="whether the counts contradict the model with the causes that the readings "
        "favour",
    )
    criteria: Numbers = entry("p-values of the counts by the other criteria of rupture", {})
    explained_by: Names = entry(
        "the cause of rupture that explains them, or several that counts cannot tell apart", ()
    )
    tried: tuple[CountedCauseEntry, ...] = entry(
        "causes of rupture that were tried, best first; `common_factor` lowers all limits equally, "
        "as a size effect would",
        (),
    )
    sentence: Text = entry("the same in words", "")


class Conflict(Record):
    """The measured mean that the base model contradicts most."""

    quantity: Text = entry("which", "")
    measured: Real = entry("as measured", NAN)
    standard_error: Real = entry("standard error of the measured mean", NAN)
    source: Text = entry("source of the mean", "")
    calibrated: Real = entry("calibrated value of the model", NAN)
    p_value: Real = entry(
        "probability of a mean at least as far off, times the number of means compared", NAN
    )
    calibrated_sd: SkipJsonSchema[Real] = inner("posterior standard deviation of that value")


class Questioned(Record):
    """A parameter calibrated to a value that its prior all but excludes; null is no bound.

    The bounds are those of the interval that holds 99.9 % of the prior.
    """

    parameter: Text = entry("name", "")
    meaning: Text = entry("what it is", "")
    unit: Text = entry("unit of the values", "")
    median: Real = entry("posterior median", NAN)
    prior_low: Real = entry("lower end of the prior interval", NAN)
    prior_high: Real = entry("upper end of the prior interval", NAN)
    p_value: Real = entry(
        "prior probability of values no more probable, times the number of parameters", NAN
    )
    displacement: Number = entry(
        "shift of the base posterior from all other information, in standard deviations of that",
        omitted=is_absent,
    )
    pushed_by: tuple[Names, ...] = entry(
        "sets of causes any of which would push it there", (), omitted=lambda sets: not sets
    )


MOVED = 1.645
"""Least shift of a parameter in question, in standard deviations of all else: out of the 90 %
interval. Weak readings may contradict all else without moving the parameter."""


class Displacement(Record):
    """A calibrated parameter of the base model, and its value from all other information.

    That is "all else": the prior, films and means of replicates, without the readings by which the
    model is judged. Values are in `unit`; nan is "not known", as the prior of a flat law.
    """

    parameter: Text = entry("name in the posterior", "")
    meaning: Text = entry("what it is", "")
    unit: Text = entry("unit of its values", "")
    base_q50: Real = entry("posterior median of the base model", NAN, key="median")
    all_else_q05: Real = entry("5 % quantile given all else", NAN, key="all_else_low")
    all_else_q50: Real = entry("median given all else", NAN, key="all_else_median")
    all_else_q95: Real = entry("95 % quantile given all else", NAN, key="all_else_high")
    measured: Real = entry("a measurement of the parameter alone, if there is one", NAN)
    measured_se: Real = entry("standard error of that", NAN)
    measured_source: Text = entry("source of that measurement", "", key="source")
    moved_sd: Real = entry(
        "shift of the base posterior's mean from that of all else, in sd of all else, on the "
        "sampler's scale",
        NAN,
        key="displacement",
    )
    p_adjusted: Real = entry(
        "of the readings alone against all else, adjusted for all parameters judged",
        NAN,
        key="p_value",
    )
    pushed_by: tuple[Names, ...] = entry(
        "sets of causes any of which would push it there; empty if none in the catalogue would", ()
    )
    pushed_share: Real = entry(
        "share of the shift that the first of them explains", NAN, key="explained_share"
    )
    after_q50: Real = entry(
        "posterior median with the causes that the evidence favours; null if there are none",
        NAN,
        key="median_after",
    )
    after_moved_sd: Real = entry(
        "shift from all else with these causes", NAN, key="displacement_after"
    )
    prior_q05: SkipJsonSchema[Real] = inner("5 % quantile of the prior")
    prior_q50: SkipJsonSchema[Real] = inner("median of the prior")
    prior_q95: SkipJsonSchema[Real] = inner("95 % quantile of the prior")
    base_q05: SkipJsonSchema[Real] = inner("5 % quantile of the base posterior")
    base_q95: SkipJsonSchema[Real] = inner("95 % quantile of the base posterior")
    after_q05: SkipJsonSchema[Real] = inner("5 % quantile with the causes that evidence favours")
    after_q95: SkipJsonSchema[Real] = inner("95 % quantile with these causes")
    learned: SkipJsonSchema[Real] = inner(
        "s²/U, the share of the variance removed by the readings; 0 where they do not show it", 0.0
    )
    score_sd: SkipJsonSchema[Real] = inner(
        "the shift in sd of what a correct model gives, moved_sd/√learned, if judged"
    )
    p_alone: SkipJsonSchema[Real] = inner(
        "of the readings alone against all else, if judged", column="p_value"
    )

    @property
    def is_judged(self) -> bool:
        """Whether the readings could have contradicted all else."""
        return not np.isnan(self.p_alone)

    @property
    def in_question(self) -> bool:
        """Whether the readings contradict all else beyond chance and have moved the parameter."""
        return self.is_judged and self.p_adjusted <= MISFIT_LEVEL and abs(self.moved_sd) > MOVED


class LevelMisfit(Record):
    """The misfit in one level of a column."""

    level: Text = entry("which", "")
    readings: Real = entry("number of readings there", NAN)
    share_of_misfit: Real = entry(
        "share of the misfit there, by a scale and a trend of this level alone", NAN
    )
    excess: Real = entry(
        "measured less simulated on average, the parameters fitted again, in the unit of the "
        "reading",
        NAN,
    )
    excess_pct: Real = entry("the same over the mean size of the simulated [%]", NAN)


class ColumnMisfit(Record):
    """The misfit in the levels of one column; sizes are of `kind`, in `unit`."""

    column: Text = entry("the column", "")
    share_of_misfit: Real = entry(
        "share of the misfit that lies between its levels; shares do not add up", NAN
    )
    kind: Text = entry("kind of reading of `excess`", "")
    unit: Text = entry("unit of `excess`", "")
    levels: tuple[LevelMisfit, ...] = entry("its levels, or thirds of its readings", ())

    @property
    def worst(self) -> LevelMisfit:
        """The level with the largest share."""
        return max(self.levels, key=lambda one: one.share_of_misfit)


class PairEntry(Record):
    """How well an experiment is expected to separate two causes."""

    causes: Names = entry("the two", ())
    expected_log_bayes_factor: Number = entry("as above, of this pair [nats]")


class ExperimentEntry(Record):
    """A proposed experiment, the causes it would separate, and its cost."""

    design: Text = entry("what to do", "")
    separates: Names = entry("the two causes, or terms, that it separates", ())
    expected_log_bayes_factor: Number = entry(
        "evidence for the true one that it adds on average [nats]"
    )
    monte_carlo_error: Number = entry("Monte Carlo standard error of that", omitted=is_absent)
    specimens: Number = entry("new specimens that it takes", omitted=is_absent)
    readings: Number = entry("readings that it takes", omitted=is_absent)
    per_specimen: Number = entry(
        "expected log Bayes factor for each specimen that it takes [nats]", omitted=is_absent
    )
    pairs: tuple[PairEntry, ...] = entry("every pair in question for which it was computed", ())


class MissingTermEntry(Record):
    """A term in known quantities that removes part of a misfit; sizes in `unit`."""

    formula: Text = entry("how the reading is written with the term, b its size", "")
    columns: Names = entry("quantities that it depends on", ())
    size: Number = entry("posterior mean of b, in `unit`")
    q05: Number = entry("5 % quantile")
    q95: Number = entry("95 % quantile")
    unit: Text = entry("unit of the three", "")
    share_of_misfit: Number = entry(
        "share of the misfit statistic removed with it and those before it"
    )
    p_value: Number = entry(
        "share of simulated data sets in which the best of all terms gains as much"
    )
    elpd_diff: Number = entry(
        "log predictive density that held-out specimens gain by it; null where none can be held "
        "out [nats]"
    )
    elpd_diff_se: Number = entry("standard error of that")
    alike: Names = entry("terms that fit as well, at most five, the best first", ())
    count_alike: Number = entry("number of terms that fit as well")


class DescriptionEntry(Record):
    """Description of a misfit that no cause accounts for."""

    sentence: Text = entry("the same in words", "")
    with_causes: Names = entry("causes in the model with this misfit; none for the base model", ())
    terms: tuple[MissingTermEntry, ...] = entry(
        "the terms in known quantities that would remove it: none, one or two", ()
    )
    columns: tuple[ColumnMisfit, ...] = entry(
        "columns with the misfit, the largest share first", ()
    )
    p_value: Number = entry("of the best of all terms, whether or not it is given")
    tried: Number = entry("number of terms that were tried")
    replicates: Number = entry("simulated data sets behind `p_value`")
    next_experiments: tuple[ExperimentEntry, ...] = entry(
        "experiments that would tell the best terms apart, as `next_experiments` of the verdict", ()
    )
