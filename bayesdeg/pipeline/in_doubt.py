"""What stands beside a verdict: readings that are hardly what they say, posteriors off priors."""

import numpy as np

from bayesdeg.criticism.conflict import Questioned, questioned
from bayesdeg.data.plausibility import Doubt, doubts
from bayesdeg.data.study import Study
from bayesdeg.pipeline.outline import outline
from bayesdeg.pipeline.results import Results

Json = dict[str, object]

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
