"""What a run folder says of the verdict and of the run, as frozen records."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from bayesdeg.criticism.checks.discrepancy import MISFIT_LEVEL
from bayesdeg.report.emulator import Emulator, emulator_of
from bayesdeg.report.fields import (
    Json,
    RunFaultError,
    each_of,
    entries_of,
    mapping_of,
    number_map_of,
    number_of,
    pairs_of,
    strings_of,
    text_map_of,
    text_of,
    texts_of,
)


class Outcome(StrEnum):
    """What the criticism of the base model came to."""

    ADEQUATE = "adequate"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"
    NOT_JUDGED = "not_judged"


@dataclass(frozen=True)
class Effect:
    """Posterior of one parameter of a cause, in `unit`."""

    name: str
    mean: float | None
    sd: float | None
    q05: float | None
    q95: float | None
    unit: str


@dataclass(frozen=True)
class Candidate:
    """One cause that was tried, or that could not be: then `probability` is None, `why` says so."""

    cause: str
    probability: float | None
    log_bayes_factor: float | None
    elpd_diff: float | None
    elpd_diff_se: float | None
    explained_fraction: float | None
    effects: tuple[Effect, ...]
    why: str
    mechanism: str
    naming_p_value: float | None = None


@dataclass(frozen=True)
class Misfit:
    """How far the base model is off, beside the noise; None where there is nothing to judge.

    `specimens` are those few in which most of the misfit sits, if it does; `replicates` is the
    number of simulated data sets behind the p-value.
    """

    rms_per_m: float | None
    noise_per_m: float | None
    p_value: float | None
    where: str
    rms_mpa: float | None = None
    noise_mpa: float | None = None
    specimens: tuple[str, ...] = ()
    replicates: float | None = None


@dataclass(frozen=True)
class Experiment:
    """A further experiment and the causes it would tell apart."""

    design: str
    separates: tuple[str, ...]
    expected_log_bayes_factor: float | None


@dataclass(frozen=True)
class InQuestion:
    """A parameter calibrated to what its prior all but excludes; bounds None where there is none.

    The bounds are those of the interval that holds 99.9 % of the prior.
    """

    parameter: str
    meaning: str
    unit: str
    median: float | None
    prior_low: float | None
    prior_high: float | None


@dataclass(frozen=True)
class Verdict:
    """The content of ``verdict.json``."""

    outcome: Outcome
    causes: tuple[str, ...]
    explanation: str
    candidates: tuple[Candidate, ...]
    confusable: tuple[tuple[str, ...], ...]
    false_name_rate: float | None
    misfit: Misfit
    next_experiments: tuple[Experiment, ...]
    predicted_with: tuple[str, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()
    suspects: tuple[str, ...] = ()
    in_question: tuple[InQuestion, ...] = ()
    naming_replicates: float | None = None

    @property
    def is_directed(self) -> bool:
        """Whether causes were found by the test directed at them, where the misfit shows none."""
        p_value = self.misfit.p_value
        return bool(self.causes) and p_value is not None and p_value > MISFIT_LEVEL

    @property
    def judged(self) -> bool:
        """Whether the simulation was judged: there was data for it, and the stages worked.

        The outcome alone says so. Misfit and candidates do not: films have no misfit in curvature,
        and causes that no data tell apart have no probability.
        """
        return self.outcome is not Outcome.NOT_JUDGED

    def candidate(self, cause: str) -> Candidate | None:
        """Return what was found for a cause, or None if it was not tried."""
        return next((entry for entry in self.candidates if entry.cause == cause), None)


@dataclass(frozen=True)
class Comparison:
    """A prediction beside the published value of the same quantity."""

    quantity: str
    degradation_pct: float | None
    predicted: str
    published: str
    source: str


@dataclass(frozen=True)
class Run:
    """The content of ``run.json``."""

    title: str
    study: str
    created: str
    virtual: bool
    note: str
    seed: str
    effort: str
    version: str
    versions: Mapping[str, str]
    hashes: Mapping[str, str]
    seconds: Mapping[str, float]
    counts: Mapping[str, float]
    missing: tuple[tuple[str, str], ...]
    rests_on: tuple[tuple[str, str], ...]
    convergence: Mapping[str, "Convergence"]
    emulator: Emulator
    misfit_observed: float | None
    misfit_name: str
    comparisons: tuple[Comparison, ...]
    checks: Mapping[str, str]


@dataclass(frozen=True)
class Convergence:
    """Whether the posterior of a model may be used, and why."""

    r_hat_max: float | None
    ess_min: float | None
    sentence: str
    usable: bool


def verdict_of(content: Json) -> Verdict:
    """Check the content of ``verdict.json``.

    Raises
    ------
    RunFaultError
        If a key that is needed is missing or a value is of the wrong kind.

    Examples
    --------
    >>> verdict_of({"outcome": "ambiguous"}).judged
    True
    >>> verdict_of({"outcome": "fine"})
    Traceback (most recent call last):
    ...
    bayesdeg.report.fields.RunFaultError: 'outcome' must be adequate or named or ambiguous or ...
    """
    word = content.get("outcome")
    if word not in list(Outcome):
        raise RunFaultError(f"'outcome' must be {' or '.join(Outcome)}, not {word!r}")
    misfit = mapping_of(content, "misfit")
    return Verdict(
        Outcome(str(word)),
        texts_of(content, "causes"),
        text_of(content, "explanation"),
        each_of(content, "candidates", _candidate),
        tuple(strings_of(pair, "confusable") for pair in entries_of(content, "confusable")),
        number_of(content, "false_name_rate"),
        Misfit(
            number_of(misfit, "rms_per_m"),
            number_of(misfit, "noise_per_m"),
            number_of(misfit, "p_value"),
            text_of(misfit, "where"),
            number_of(misfit, "rms_MPa"),
            number_of(misfit, "noise_MPa"),
            _specimens(mapping_of(misfit, "concentrated")),
            number_of(misfit, "replicates"),
        ),
        each_of(content, "next_experiments", _experiment),
        texts_of(content, "predicted_with"),
        pairs_of(content, "left_out", ("stage", "why")),
        each_of(content, "suspects", lambda entry: text_of(entry, "why")),
        each_of(content, "parameters_in_question", _in_question),
        number_of(mapping_of(content, "naming"), "replicates"),
    )


def run_of(content: Json) -> Run:
    """Check the content of ``run.json``.

    Raises
    ------
    RunFaultError
        If the title is missing or a value is of the wrong kind.

    Examples
    --------
    >>> run_of({"title": "Treloar", "virtual": False, "seconds": {"sample": 2}}).seconds
    {'sample': 2.0}
    """
    if not text_of(content, "title"):
        raise RunFaultError("'title' is missing")
    if not isinstance(content.get("virtual", False), bool):
        raise RunFaultError("'virtual' must be true or false")
    misfit = mapping_of(content, "misfit")
    convergence = mapping_of(content, "convergence")
    return Run(
        title=text_of(content, "title"),
        study=text_of(content, "study"),
        created=text_of(content, "created"),
        virtual=content.get("virtual") is True,
        note=text_of(content, "note"),
        seed=text_of(content, "seed"),
        effort=text_of(content, "effort"),
        version=text_of(content, "version"),
        versions=text_map_of(content, "versions"),
        hashes=text_map_of(content, "hashes"),
        seconds=number_map_of(content, "seconds"),
        counts=number_map_of(content, "counts"),
        missing=pairs_of(content, "missing", ("what", "cost")),
        rests_on=pairs_of(content, "rests_on", ("statement", "rests_on")),
        convergence={model: _convergence(mapping_of(convergence, model)) for model in convergence},
        emulator=emulator_of(mapping_of(content, "emulator")),
        misfit_observed=number_of(misfit, "observed"),
        misfit_name=text_of(misfit, "name"),
        comparisons=each_of(content, "comparisons", _comparison),
        checks=text_map_of(content, "checks"),
    )


def _candidate(entry: Json) -> Candidate:
    effects = mapping_of(entry, "effect")
    return Candidate(
        text_of(entry, "cause"),
        number_of(entry, "probability"),
        number_of(entry, "log_bayes_factor"),
        number_of(entry, "elpd_diff"),
        number_of(entry, "elpd_diff_se"),
        number_of(entry, "explained_fraction"),
        tuple(_effect(name, mapping_of(effects, name)) for name in effects),
        text_of(entry, "why"),
        text_of(entry, "mechanism"),
        number_of(entry, "naming_p_value"),
    )


def _in_question(entry: Json) -> InQuestion:
    return InQuestion(
        text_of(entry, "parameter"),
        text_of(entry, "meaning"),
        text_of(entry, "unit"),
        number_of(entry, "median"),
        number_of(entry, "prior_low"),
        number_of(entry, "prior_high"),
    )


def _specimens(concentrated: Json) -> tuple[str, ...]:
    is_of_specimens = text_of(concentrated, "kind") == "specimen"
    return texts_of(concentrated, "members") if is_of_specimens else ()


def _effect(name: str, entry: Json) -> Effect:
    mean, sd, q05, q95 = (number_of(entry, key) for key in ("mean", "sd", "q05", "q95"))
    return Effect(name, mean, sd, q05, q95, text_of(entry, "unit"))


def _experiment(entry: Json) -> Experiment:
    return Experiment(
        text_of(entry, "design"),
        texts_of(entry, "separates"),
        number_of(entry, "expected_log_bayes_factor"),
    )


def _convergence(entry: Json) -> Convergence:
    return Convergence(
        number_of(entry, "r_hat_max"),
        number_of(entry, "ess_min"),
        text_of(entry, "sentence"),
        entry.get("usable") is not False,
    )


def _comparison(entry: Json) -> Comparison:
    texts = (text_of(entry, key) for key in ("predicted", "published", "source"))
    return Comparison(text_of(entry, "quantity"), number_of(entry, "degradation_pct"), *texts)
