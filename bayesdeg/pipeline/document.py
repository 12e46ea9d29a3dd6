"""The verdict as the document that others' tools read."""

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.candidates import Candidate
from bayesdeg.criticism.concentration import Concentration
from bayesdeg.criticism.conflict import Conflict
from bayesdeg.criticism.model_readings import STRESS
from bayesdeg.criticism.rupture_misfit import RuptureMisfit
from bayesdeg.criticism.verdict import Outcome
from bayesdeg.pipeline.explanation import explain
from bayesdeg.pipeline.judgement import Judgement, readings_misfit

Json = dict[str, object]

NOTHING_TO_JUDGE = (
    "There are no readings of an actuator and no tensile curves in this study, so there is no "
    "misfit to judge and no cause is named."
)
SHOWN = "What the material law gets right is shown with the published statistics."


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
        "candidates": [candidate_document(c) for c in judgement.candidates],
        "confusable": [list(pair) for pair in judgement.confusability.pairs()],
        "false_name_rate": base.false_name_rate,
        "naming": {"log_bayes_factor": judgement.threshold, "replicates": len(base.chance)},
        "predicted_with": list(judgement.predicted_with),
        "misfit": {
            "rms_per_m": rms,
            "noise_per_m": noise,
            "p_value": judgement.misfit.p_value,
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


def unjudged_document(unjudged: dict[str, str], held_out: str = "", failed: str = "") -> Json:
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
    """
    return {
        "outcome": str(Outcome.NOT_JUDGED),
        "causes": [],
        "one_of": [],
        "explanation": f"{_of_failure(failed)} {held_out}".strip()
        if failed
        else f"{NOTHING_TO_JUDGE} {held_out or SHOWN}",
        "candidates": [
            candidate_document(Candidate(n, *5 * (None,), {}, fitted=False, why=w))
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


def candidate_document(candidate: Candidate, mechanism: str | None = None) -> Json:
    """Return the entry of ``candidates`` in ``verdict.json``.

    Parameters
    ----------
    candidate : Candidate
        How a cause fared.
    mechanism : str, optional
        Of the cause; by default that of the catalogue, empty if it is not of the catalogue.
    """
    known = CATALOGUE.get(candidate.cause)
    if mechanism is None:
        mechanism = known.mechanism if known else ""
    entry: Json = {
        "cause": candidate.cause,
        "probability": candidate.probability,
        "log_bayes_factor": candidate.log_bayes_factor,
        "log_bayes_factor_error": candidate.log_bayes_factor_error,
        "elpd_diff": candidate.elpd_diff,
        "elpd_diff_se": candidate.elpd_diff_se,
        "explained_fraction": candidate.explained_fraction,
        "effect": {name: vars(size) for name, size in candidate.effect.items()},
        "mechanism": mechanism,
    }
    if candidate.naming_p_value is not None:
        entry["naming_p_value"] = candidate.naming_p_value
    if candidate.why:
        entry["why"] = candidate.why
    else:
        entry["judged_by"] = "full fit" if candidate.fitted else "screening"
    return entry
