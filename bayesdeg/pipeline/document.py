"""The verdict as the document that others' tools read."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.conflict import Conflict, Questioned, questioned
from bayesdeg.criticism.checks.residuals import (
    Concentration,
    concentration,
    where,
    where_films,
    with_concentration,
)
from bayesdeg.criticism.checks.rupture_misfit import RuptureMisfit
from bayesdeg.criticism.decide.candidates import Candidate
from bayesdeg.criticism.decide.verdict import Outcome
from bayesdeg.data.plausibility import Doubt, doubts
from bayesdeg.data.study import Study
from bayesdeg.observations.tensile import STRESS
from bayesdeg.pipeline.explanation import explain
from bayesdeg.pipeline.judge import Judgement, readings_misfit
from bayesdeg.pipeline.outline import outline
from bayesdeg.pipeline.results import Results
from bayesdeg.report.left_out import Guard, Stage

Json = dict[str, object]

NOTHING_TO_JUDGE = (
    "There are no readings of an actuator and no tensile curves in this study, so there is no "
    "misfit to judge and no cause is named."
)
SHOWN = "What the material law makes of the published statistics is shown beside them."


def verdict_document(
    judgement: Judgement,
    where: str,
    experiments: list[Json] | None = None,
    *,
    note: str = "",
    concentrated: Concentration | None = None,
    explanation: str | None = None,
) -> Json:
    """Return the content of ``verdict.json`` for a study whose readings could be judged.

    Parameters
    ----------
    judgement : Judgement
        The verdict.
    where : str
        Where the misfit sits.
    experiments : list, optional
        What to measure next.
    note : str
        What is wrong with modes of tension that were predicted only.
    concentrated : Concentration, optional
        The branch, cycle, hold or few specimens in which most of the misfit sits.
    explanation : str, optional
        In place of what `bayesdeg.pipeline.explanation.explain` says.
    """
    said = explain(judgement, where) if explanation is None else explanation
    decision, base = judgement.decision, judgement.steps[0]
    rms, noise = readings_misfit(judgement)
    return {
        "outcome": str(decision.outcome),
        "causes": list(decision.causes),
        "one_of": [list(names) for names in decision.one_of],
        "explanation": f"{said} {note}".strip(),
        "candidates": [_candidate(c) for c in judgement.candidates],
        "confusable": [list(pair) for pair in judgement.confusability.pairs()],
        "false_name_rate": base.false_name_rate,
        "naming": {"log_bayes_factor": judgement.threshold, "replicates": len(base.chance)},
        "predicted_with": list(judgement.predicted_with),
        "misfit": {
            "rms_per_m": rms,
            "noise_per_m": noise,
            "p_value": judgement.misfit.p_value,
            "replicates": len(judgement.misfit.null),
            "where": where,
            "concentrated": _concentrated(concentrated),
            **_of_films(judgement, rms),
        },
        "ruptures": _ruptures(judgement.rupture),
        "contradicted": _contradicted(judgement.contradicted),
        "next_experiments": experiments or [],
    }


def _concentrated(found: Concentration | None) -> Json | None:
    if found is None:
        return None
    return {
        "kind": found.kind,
        "members": list(found.members),
        "excess_pct": list(found.excess),
        "share_of_misfit": found.share,
        "share_of_readings": found.readings,
        "p_value": found.p_value,
    }


def _ruptures(found: RuptureMisfit | None) -> Json | None:
    if found is None:
        return None
    return {
        "burst": found.burst,
        "expected": found.expected,
        "deviance": found.deviance,
        "p_value": found.p_value,
    }


def _contradicted(found: Conflict | None) -> Json | None:
    if found is None:
        return None
    measured = found.statistic
    return {
        "quantity": measured.quantity,
        "measured": measured.value,
        "standard_error": measured.se,
        "source": measured.source,
        "calibrated": found.wanted,
        "p_value": found.p_value,
    }


def _of_films(judgement: Judgement, rms: float | None) -> Json:
    """Return the misfit of the stresses [MPa] where there are no curvatures."""
    if rms is not None:
        return {}
    of_stress, noise = readings_misfit(judgement, STRESS)
    return {"rms_MPa": of_stress, "noise_MPa": noise}


def unjudged_document(
    unjudged: dict[str, str], held_out: str = "", failed: str = "", *, published: bool = False
) -> Json:
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
        Whether published statistics are shown beside what the model makes of them.
    """
    return {
        "outcome": str(Outcome.NOT_JUDGED),
        "causes": [],
        "one_of": [],
        "explanation": f"{_of_failure(failed)} {held_out}".strip()
        if failed
        else f"{NOTHING_TO_JUDGE} {held_out or (SHOWN if published else '')}".strip(),
        "candidates": [
            _candidate(Candidate(n, *5 * (None,), {}, fitted=False, why=w))
            for n, w in unjudged.items()
        ],
        "confusable": [],
        "false_name_rate": None,
        "naming": None,
        "predicted_with": [],
        "misfit": {"rms_per_m": None, "noise_per_m": None, "p_value": None, "where": ""},
        "ruptures": None,
        "contradicted": None,
        "next_experiments": [],
    }


def _of_failure(why: str) -> str:
    return (
        f"The verdict could not be computed, so no cause is named, and nothing is said of whether "
        f"the simulation is adequate. {why} The base model was calibrated, and what follows from "
        "it is written. Run the study again with another --seed; if that fails too, please send "
        "us left_out.txt of the run folder."
    )


def _candidate(candidate: Candidate) -> Json:
    known = CATALOGUE.get(candidate.cause)
    entry: Json = {
        "cause": candidate.cause,
        "probability": candidate.probability,
        "log_bayes_factor": candidate.log_bayes_factor,
        "log_bayes_factor_error": candidate.log_bayes_factor_error,
        "elpd_diff": candidate.elpd_diff,
        "elpd_diff_se": candidate.elpd_diff_se,
        "explained_fraction": candidate.explained_fraction,
        "effect": {name: vars(size) for name, size in candidate.effect.items()},
        "mechanism": known.mechanism if known else "",
    }
    if candidate.naming_p_value is not None:
        entry["naming_p_value"] = candidate.naming_p_value
    if candidate.why:
        entry["why"] = candidate.why
    else:
        entry["judged_by"] = "full fit" if candidate.fitted else "screening"
    return entry


Floats = NDArray[np.float64]

OF_VERDICT = (
    Stage.RUPTURE_MISFIT,
    Stage.CONFLICT,
    Stage.LEVELS_OUT,
    Stage.EXPERIMENTS,
    Stage.CONFUSABILITY,
    Stage.EXTENDED,
    Stage.WHERE,
)
"""What a reader of the verdict misses, where no reason of the decision says it already."""


def verdict_of(results: Results, residual: Floats | None, note: str, guard: Guard) -> Json:
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
            Stage.VERDICT, _verdict, results, results.judgement, residual, note, guard
        )
    if found is not None:
        return found
    unjudged, failed = results.assembly.unjudged, guard.why(Stage.VERDICT)
    if failed:
        tried = {cause.name: "the verdict was left out" for cause in results.assembly.candidates}
        unjudged = tried | unjudged
    shown = bool(results.base.model.statistics)
    return unjudged_document(unjudged, note, failed, published=shown)


def _verdict(
    results: Results, judgement: Judgement, residual: Floats | None, note: str, guard: Guard
) -> Json:
    linear = judgement.search.base.linear
    place = guard.attempt(Stage.WHERE, _place, results, judgement, residual) or ""
    found = guard.attempt(
        Stage.CONCENTRATION,
        concentration,
        linear,
        judgement.steps[0].simulated,
        judgement.misfit.statistic,
    )
    place = with_concentration(place, found) if place else ""
    said = guard.attempt(Stage.EXPLANATION, explain, judgement, place)
    missing = " ".join(guard.why(stage) for stage in OF_VERDICT)
    return verdict_document(
        judgement,
        place,
        judgement.experiments,
        note=f"{note} {missing}".strip(),
        concentrated=found,
        explanation=said or f"The verdict is: {judgement.decision.outcome}.",
    )


def _place(results: Results, judgement: Judgement, residual: Floats | None) -> str:
    """Say where the misfit sits; empty where the readings could not be predicted."""
    if results.base.model.actuator is None:
        return where_films(judgement.search.base.linear)
    noise = readings_misfit(judgement)[1]
    return "" if residual is None else where(results.base.model, residual, noise or 0.0)


DRAWS = 4000  # of a posterior, for its medians


def in_doubt(study: Study, results: Results) -> Json:
    """Return what a reader of the verdict should know, as keys of ``verdict.json``.

    Parameters
    ----------
    study : Study
        What was run.
    results : Results
        Of which the final calibration is held against its priors.

    Returns
    -------
    dict
        ``suspects``: readings and specimens that are unlikely. ``parameters_in_question``: those
        that are calibrated to what their priors all but exclude.
    """
    found = doubts(study, outline(study).expected)
    return {
        "suspects": [_suspect(doubt) for doubt in found],
        "parameters_in_question": _off_priors(results),
    }


def _suspect(doubt: Doubt) -> Json:
    fault = doubt.fault
    return {
        "file": fault.file,
        "specimen": fault.specimen,
        "column": fault.column,
        "value": fault.value,
        "why": str(doubt),
    }


def _off_priors(results: Results) -> list[Json]:
    fit = results.final
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    step = max(1, len(vectors) // DRAWS)
    return [_question(one) for one in questioned(fit.model, vectors[::step])]


def _question(one: Questioned) -> Json:
    low, high = one.expected
    finite = {"prior_low": low, "prior_high": high}
    return {
        "parameter": one.parameter.name,
        "meaning": one.parameter.meaning,
        "unit": one.parameter.unit,
        "median": one.value,
        **{name: value if np.isfinite(value) else None for name, value in finite.items()},
        "p_value": one.p_value,
    }
