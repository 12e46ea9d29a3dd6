"""What was published beside what the posterior says, and which statement rests on which data."""

import json
import platform
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

import bayesdeg
from bayesdeg.data.study import Study
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.model import Model, Refusals, share_outside
from bayesdeg.pipeline.calibrate import Fit, refused_inputs
from bayesdeg.pipeline.forecast import model_document
from bayesdeg.pipeline.results import Results
from bayesdeg.report.left_out import Guard, Stage
from bayesdeg.report.wording import NOTHING

Json = dict[str, object]


def comparisons(study: Study, fit: Fit) -> list[Json]:
    """Return every published statistic beside the posterior's own, 90 % intervals.

    What the model predicts no number of, as counts of ruptures, stands beside nothing.
    """
    if study.summary is None:
        return []
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    values = fit.model.table.named(flat[:: max(1, len(flat) // 2000)])
    rows: list[Json] = []
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
        unit = str(row["unit"]).replace("–", "")
        sd = "" if np.isnan(row["sd"]) else f" ± {row['sd']:g}"
        rows.append(
            {
                "quantity": row["quantity"],
                "degradation_pct": None if np.isnan(level[0]) else float(level[0]),
                "predicted": NOTHING if draws is None else f"{_interval(draws)} {unit}".strip(),
                "published": f"{row['value']:g}{sd} {unit}".strip(),
                "source": row["source"],
            }
        )
    return rows


def _interval(draws: NDArray[np.float64]) -> str:
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


def rests_on(study: Study, model: Model) -> list[Json]:
    """Return which statement rests on which data."""
    specimens = "virtual experiment" if study.settings.virtual else "measured"
    statements = []
    if study.tensile is not None:
        count = study.tensile["specimen_id"].nunique()
        statements.append(
            ("Yeoh constants against degradation", f"tensile.csv, {count} specimens ({specimens})")
        )
    if study.actuator is not None:
        count = study.actuator["specimen_id"].nunique()
        statements.append(
            ("verdict, gain, curvature bands", f"actuator.csv, {count} specimens ({specimens})")
        )
    if study.breaks is not None:
        statements.append(
            (
                "elongation limit and rupture",
                f"break.csv, {len(study.breaks)} specimens ({specimens})",
            )
        )
    if study.shrinkage is not None:
        statements.append(
            ("volume ratio α", f"shrinkage.csv, {len(study.shrinkage)} films ({specimens})")
        )
    if study.summary is not None:
        used = {s.quantity for s in model.statistics if not s.source.startswith("shrinkage.csv")}
        used |= set() if model.published is None else {"r_squared"}
        names = sorted({str(q) for q in study.summary["quantity"] if q in used})
        shown = sorted({str(q) for q in study.summary["quantity"] if q not in used})
        if names:
            statements.append((f"also used as data: {', '.join(names)}", "summary.csv (published)"))
        if shown:
            statements.append((f"shown, not fitted: {', '.join(shown)}", "summary.csv (published)"))
    return [{"statement": statement, "rests_on": basis} for statement, basis in statements]


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
MEASURES = ("rms_pct", "p95_pct", "max_pct", "coverage_90")
LIBRARIES = ("numpy", "scipy", "scikit-fem", "numba", "emcee", "arviz", "pandas", "xarray")


def run_document(
    study: Study, results: Results, seconds: dict[str, float], guard: Guard | None = None
) -> dict[str, object]:
    """Return the content of ``run.json``: versions, seed, hashes, effort, times, counts."""
    settings, judgement = study.settings, results.judgement
    guard = guard or Guard(strict=True)
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
        "rests_on": rests_on(study, results.base.model),
        "convergence": _convergence(results),
        "emulator": _emulator(results, guard),
        "model": model_document(results.base.model),
        "misfit": {
            "observed": None if judgement is None else judgement.misfit.statistic,
            "name": "log-likelihood ratio of a smooth discrepancy",
        },
        "comparisons": guard.attempt(Stage.COMPARISONS, comparisons, study, results.final) or [],
        "checks": guard.attempt(Stage.CHECKS_IN_WORDS, _checks, results) or {},
    }


def _checks(results: Results) -> dict[str, str]:
    """Return what checks and films came to, in plain words."""
    said = {} if results.checks is None else results.checks.sentences()
    return said if results.films is None else said | results.films.sentences()


def _counts(results: Results) -> dict[str, int]:
    forward = results.base.model.forward
    outside, cut = 0, None
    if isinstance(forward, Surrogate):
        cut = emulator_facts(forward.record)["curves_cut_short"]
        outside = round(_outside(results.final) * results.final.chain.log_prob.size)
    counts = {
        "posterior draws, base": results.base.chain.log_prob.size,
        "posterior draws, final": results.final.chain.log_prob.size,
        "posterior draws outside the emulator's range": outside,
    }
    for label, fit in results.fits.items():
        counts[f"proposals of the sampler, {label}"] = fit.chain.refusals.proposed
        counts[f"proposals refused by the emulator, {label}"] = fit.chain.refusals.refused
    name = "finite element curves of the emulator that met a limit point"
    return counts | ({name: int(cut)} if isinstance(cut, int) else {})


def _outside(fit: Fit) -> float:
    """Return the share of a posterior that lies outside the emulator's range, from some draws."""
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    return share_outside(fit.model, vectors[:: max(1, len(vectors) // LOOKED_AT)])


def _convergence(results: Results) -> dict[str, object]:
    return {
        label: {
            "r_hat_max": max(fit.diagnosis.r_hat),
            "ess_min": min(fit.diagnosis.ess_bulk),
            "sentence": fit.diagnosis.sentence,
            "usable": fit.diagnosis.usable,
        }
        for label, fit in results.sampled.items()
    }


def _emulator(results: Results, guard: Guard) -> dict[str, object]:
    forward = results.base.model.forward
    if not isinstance(forward, Surrogate):
        return {}
    facts = emulator_facts(forward.record)
    chains = {id(fit.chain): fit.chain.refusals for fit in results.fits.values()}
    refusals = sum(chains.values(), start=Refusals())
    refused = {}
    if results.final.model.actuator is not None:
        refused = guard.attempt(Stage.REFUSED, refused_inputs, results.final) or {}
    words = (
        refusal_words(refusals),
        outside_words(_outside(results.final)),
        _refused_words(refused),
    )
    said = " ".join(part for part in words if part)
    return facts | {
        "refusals": said,
        "refused_inputs": refused,
        "training": json.loads(forward.record),
    }


def _refused_words(refused: dict[str, str]) -> str:
    """Say which inputs of new specimens are refused."""
    if not refused:
        return ""
    return f"Of new specimens in the same tests it refuses: {'; '.join(refused.values())}."


def emulator_facts(record: str) -> dict[str, object]:
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
    >>> facts["coarse_curves"], facts["accuracy"]
    (64, [{'quantity': 'limit', 'rms_pct': None, 'p95_pct': 1.5, 'max_pct': None, 'coverage_90': None}])
    """  # noqa: E501
    trained = json.loads(record)
    by_quantity = trained.get("accuracy", {})
    if not by_quantity and "left_out_rms_pct" in trained:
        older = {
            "rms": "left_out_rms_pct",
            "p95": "left_out_p95_pct",
            "max": "left_out_largest_pct",
        }
        by_quantity = {"curvature": {f"{k}_pct": trained.get(key) for k, key in older.items()}}
    accuracy = [
        {"quantity": quantity, **{measure: entry.get(measure) for measure in MEASURES}}
        for quantity, entry in by_quantity.items()
    ]
    facts = {key: trained.get(key) for key in FACTS}
    rms = by_quantity.get("curvature", {}).get("rms_pct")
    error = None if rms is None else float(np.hypot(rms, facts["mesh_error_pct"] or 0.0))
    return facts | {"accuracy": accuracy, "error_pct": error, "record": _sentence(facts, rms)}


def _sentence(facts: dict[str, object], rms: float | None) -> str:
    parts = []
    if facts["coarse_curves"] is not None:
        few = facts["fine_curves"]
        parts.append(
            f"{facts['coarse_curves']} curves of a coarse mesh"
            + ("" if few is None else f", corrected by {few} of a fine one")
        )
    if rms is not None:
        parts.append(f"curves that it was not trained on are predicted to {rms:.2f} % rms")
    if facts["mesh_error_pct"] is not None:
        parts.append(
            f"the fine mesh itself is within {facts['mesh_error_pct']:.2f} % rms of a finer one"
        )
    return "; ".join(parts)


def outside_words(share: float) -> str:
    """Say what share of the posterior lies where the emulator has no answer; nothing if none does.

    Examples
    --------
    >>> outside_words(0.25).split(", ")[0]
    "25 % of the posterior lies outside the emulator's range"
    """
    if share == 0.0:
        return ""
    return (
        f"{100.0 * share:.2g} % of the posterior lies outside the emulator's range, where the "
        "likelihood only leads back inside and nothing is predicted: intervals that rest on it "
        "may be cut off."
    )


def refusal_words(refusals: Refusals) -> str:
    """Say how many proposals the emulator refused, and what to do if they are many.

    Examples
    --------
    >>> refusal_words(Refusals(200_000, 50))
    'The emulator refused 50 of 200000 proposals of the sampler (0.025 %) as outside its training.'
    """
    if not refusals.proposed:
        return ""
    if not refusals.refused:
        return f"None of the {refusals.proposed} proposals of the sampler was outside its training."
    said = (
        f"The emulator refused {refusals.refused} of {refusals.proposed} proposals of the sampler "
        f"({100.0 * refusals.share:.2g} %) as outside its training."
    )
    if refusals.share <= WORRYING:
        return said
    return (
        f"{said} That is more than {100.0 * WORRYING:g} %: the posterior may be cut off where the "
        "emulator ends. Give narrower priors in study.toml to the parameters that lead there, or "
        "leave out the readings next to ballooning, and see whether the result moves."
    )
