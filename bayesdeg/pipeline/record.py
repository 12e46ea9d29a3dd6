"""What is recorded of the run itself: ``run.json``."""

import json
import platform
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np

import bayesdeg
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.measure.study import Study
from bayesdeg.pipeline.comparison import comparisons, rests_on
from bayesdeg.pipeline.results import Results

LIBRARIES = ("numpy", "scipy", "scikit-fem", "numba", "emcee", "arviz", "pandas", "xarray")


def run_document(study: Study, results: Results, seconds: dict[str, float]) -> dict[str, object]:
    """Return the content of ``run.json``: versions, seed, hashes, effort, times, counts."""
    settings, judgement = study.settings, results.judgement
    libraries = {name: version(name) for name in LIBRARIES}
    return {
        "title": settings.title or study.name,
        "study": study.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "virtual": settings.virtual,
        "note": settings.note,
        "seed": settings.seed,
        "effort": settings.effort,
        "version": bayesdeg.__version__,
        "versions": libraries | {"python": platform.python_version()},
        "hashes": dict(study.hashes),
        "seconds": seconds,
        "counts": _counts(results),
        "missing": [{"what": w, "cost": cost} for w, cost in results.assembly.missing],
        "rests_on": rests_on(study),
        "convergence": _convergence(results),
        "emulator": _emulator(results),
        "misfit": {
            "observed": None if judgement is None else judgement.misfit.statistic,
            "name": "log-likelihood ratio of a smooth discrepancy",
        },
        "comparisons": comparisons(study, results.final),
    }


def _counts(results: Results) -> dict[str, int]:
    failed, outside = 0, 0
    if isinstance(results.base.model.forward, Surrogate):
        failed = int(json.loads(results.base.model.forward.record)["curves_cut_short"])
        outside = int(np.sum(~np.isfinite(results.final.chain.log_prob)))
    return {
        "posterior draws, base": results.base.chain.log_prob.size,
        "posterior draws, final": results.final.chain.log_prob.size,
        "posterior draws outside the emulator's range": outside,
        "finite element curves of the emulator that met a limit point": failed,
    }


def _convergence(results: Results) -> dict[str, object]:
    return {
        label: {
            "r_hat_max": max(fit.diagnosis.r_hat),
            "ess_min": min(fit.diagnosis.ess_bulk),
            "sentence": fit.diagnosis.sentence,
            "usable": fit.diagnosis.usable,
        }
        for label, fit in results.fits.items()
    }


def _emulator(results: Results) -> dict[str, object]:
    forward = results.base.model.forward
    if not isinstance(forward, Surrogate):
        return {}
    trained = json.loads(forward.record)
    error = float(np.hypot(trained["left_out_rms_pct"], trained["mesh_error_pct"]))
    record = (
        f"{trained['coarse_curves']} curves of a coarse mesh, corrected by "
        f"{trained['fine_curves']} of a fine one; curves left out are predicted to "
        f"{trained['left_out_rms_pct']:.2f} % rms, {trained['left_out_p95_pct']:.2f} % at the "
        f"95th percentile; the fine mesh itself is within {trained['mesh_error_pct']:.2f} % rms "
        "of a finer one"
    )
    return {"error_pct": error, "record": record, "training": trained}
