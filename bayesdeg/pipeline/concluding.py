"""What a run concludes: the verdict as a document, with what could not be computed."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.concentration import concentration, with_concentration
from bayesdeg.criticism.residuals import where, where_films
from bayesdeg.pipeline.document import unjudged_document, verdict_document
from bayesdeg.pipeline.explanation import explain
from bayesdeg.pipeline.judgement import Judgement, readings_misfit
from bayesdeg.pipeline.results import Results
from bayesdeg.report.left_out import Guard, Stage

Floats = NDArray[np.float64]
Json = dict[str, object]

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
