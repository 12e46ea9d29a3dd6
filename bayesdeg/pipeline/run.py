"""The main job: read, calibrate, criticise, name the cause, extend, measure the gain, predict."""

import hashlib
import json
import platform
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import bayesdeg
from bayesdeg.criticism.convergence import Convergence, diagnose
from bayesdeg.criticism.gain import gain_table
from bayesdeg.criticism.residuals import level_table, predict_readings, where
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.ensemble import EFFORTS, to_datatree
from bayesdeg.measure.study import Study
from bayesdeg.pipeline import tables
from bayesdeg.pipeline.assemble import Assembly, assemble, level_grid
from bayesdeg.pipeline.calibrate import Fit, calibrate
from bayesdeg.pipeline.comparison import comparisons, rests_on
from bayesdeg.pipeline.explanation import unjudged_document, verdict_document
from bayesdeg.pipeline.judge import (
    JUDGE_EFFORTS,
    Judgement,
    effect_size,
    extended_model,
    judge,
)
from bayesdeg.pipeline.progress import Progress
from bayesdeg.prediction.bands import curvature_bands
from bayesdeg.prediction.rupture import rupture_table
from bayesdeg.report import columns
from bayesdeg.report.checkpoints import Checkpoints
from bayesdeg.report.folder import POSTERIOR, POSTERIOR_BASE, RUN, VERDICT, RunFolder

Floats = NDArray[np.float64]

LIBRARIES = ("numpy", "scipy", "scikit-fem", "numba", "emcee", "arviz", "pandas", "xarray")


@dataclass
class _Clock:
    """Wall time of the stages [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = round(time.perf_counter() - start, 2)


def run_study(
    study: Study,
    folder: RunFolder,
    checkpoints: Checkpoints,
    *,
    progress: Progress,
    executor: Executor | None = None,
) -> dict[str, object]:
    """Do the main job on a study and write the run folder, except for the page.

    Parameters
    ----------
    study : Study
        Checked; its settings hold effort and seed.
    folder : RunFolder
        Where the results go.
    checkpoints : Checkpoints
        Finished stages of an interrupted run.
    progress : Progress
        Shows the work.
    executor : Executor, optional
        For ensembles and folds.

    Returns
    -------
    dict
        The content of ``verdict.json``.
    """
    clock = _Clock()
    seeds = np.random.SeedSequence(study.settings.seed).spawn(5)
    generator = np.random.default_rng(seeds[0])
    effort = EFFORTS[study.settings.effort]
    with clock.stage("read"):
        assembly = assemble(study)
    with clock.stage("base"):
        base = calibrate(
            assembly.model,
            "base",
            effort=effort,
            seed=seeds[1],
            checkpoints=checkpoints,
            progress=progress,
            executor=executor,
        )
    final, judgement = base, None
    if assembly.model.actuator is not None:
        with clock.stage("verdict"):
            judgement = judge(
                assembly,
                base,
                effort=JUDGE_EFFORTS[study.settings.effort],
                seed=seeds[2],
                progress=progress,
                executor=executor,
            )
        extended = extended_model(base, judgement.decision)
        if extended is not None:
            with clock.stage("extended"):
                final = calibrate(
                    extended[0],
                    "final",
                    effort=effort,
                    seed=seeds[3],
                    checkpoints=checkpoints,
                    progress=progress,
                    executor=executor,
                    start=extended[1],
                )
            judgement = _with_sampled_sizes(judgement, final)
    diagnoses = {
        "base": diagnose(base.model, base.chain, effort),
        "final": diagnose(final.model, final.chain, effort),
    }
    progress.stage("predictions and tables")
    with clock.stage("predict"):
        _write_posteriors(folder, base, final, effort.kept, generator)
        _write_material(study, folder, base, final, diagnoses, generator)
        document = _write_actuator(study, folder, base, final, judgement, assembly, generator)
    folder.write_json(VERDICT, document)
    record = _record(study, assembly, base, final, diagnoses, judgement, clock.seconds)
    folder.write_json(RUN, record)
    return document


def fingerprint(study: Study) -> str:
    """Return a hash of everything that a run's results depend on."""
    settings = study.settings
    content = json.dumps(
        [bayesdeg.__version__, dict(study.hashes), settings.effort, settings.seed], sort_keys=True
    )
    return hashlib.sha256(content.encode()).hexdigest()


def _with_sampled_sizes(judgement: Judgement, final: Fit) -> Judgement:
    """Replace the leading cause's effect by that of its sampled posterior."""
    name = judgement.decision.causes[0]
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    values = final.model.table.named(flat)
    cause = next(c for c in final.model.causes if c.name == name)
    sizes = {p.name: effect_size(values[cause.qualified(p.name)], p.unit) for p in cause.parameters}
    candidates = tuple(
        replace(c, effect=sizes) if c.cause == name else c for c in judgement.candidates
    )
    return replace(judgement, candidates=candidates)


def _write_posteriors(
    folder: RunFolder, base: Fit, final: Fit, kept: int, generator: np.random.Generator
) -> None:
    for name, fit in ((POSTERIOR_BASE, base), (POSTERIOR, final)):
        tree = to_datatree(fit.model, fit.chain.thinned(kept), generator)
        folder.write_posterior(name, tree)


def _write_material(
    study: Study,
    folder: RunFolder,
    base: Fit,
    final: Fit,
    diagnoses: dict[str, Convergence],
    generator: np.random.Generator,
) -> None:
    fits = {"base": base, "final": final}
    folder.write_table(
        columns.CONSTANTS,
        pd.concat([tables.constants(fit, label, generator) for label, fit in fits.items()]),
    )
    folder.write_table(
        columns.PARAMETERS,
        pd.concat(
            [
                tables.parameters(fit.model, fit.chain, diagnoses[label], label)
                for label, fit in fits.items()
            ]
        ),
    )
    if base.model.tensile is not None:
        folder.write_table(
            columns.TENSILE,
            pd.concat([tables.tensile(study, f, label, generator) for label, f in fits.items()]),
        )
    elongation = tables.elongation(final, generator)
    if elongation is not None:
        folder.write_table(columns.ELONGATION, elongation)
    folder.write_table(columns.MEASURED, tables.measured(study))


def _write_actuator(
    study: Study,
    folder: RunFolder,
    base: Fit,
    final: Fit,
    judgement: Judgement | None,
    assembly: Assembly,
    generator: np.random.Generator,
) -> dict[str, object]:
    if judgement is None or base.model.actuator is None:
        return unjudged_document(assembly.unjudged)
    observed, levels = [], []
    published = _published_r_squared(study)
    for label, fit in (("base", base), ("final", final)):
        readings = predict_readings(fit.model, fit.chain, generator)
        observed.append(tables.observations(fit.model, label, readings))
        levels.append(level_table(fit.model, readings, published).assign(model=label))
        if label == "base":
            residual = base.model.actuator.curvature - readings.mean
    folder.write_table(columns.OBSERVATIONS, pd.concat(observed))
    folder.write_table(columns.LEVELS, pd.concat(levels))
    folder.write_table(columns.GAIN, gain_table(base.model, judgement.held_out))
    null = judgement.misfit.null
    folder.write_table(
        columns.MISFIT_NULL, pd.DataFrame({"replicate": np.arange(len(null)), "statistic": null})
    )
    top = float(np.max(base.model.actuator.pressure))
    grid, pressure = level_grid(final.model), np.arange(0.0, top + 1e-9, 10.0)
    bands = curvature_bands(
        final.model, final.chain, generator, degradation=grid, pressure=pressure
    )
    folder.write_table(columns.BANDS, bands)
    if "elongation_scatter" in final.model.table.names:
        rupture = rupture_table(
            final.model, final.chain, generator, degradation=grid, pressure=pressure
        )
        folder.write_table(columns.RUPTURE, rupture)
    return verdict_document(judgement, where(base.model, residual, judgement.misfit.noise))


def _published_r_squared(study: Study) -> dict[float, float]:
    if study.summary is None:
        return {}
    rows = study.summary[study.summary["quantity"] == "r_squared"]
    return {
        float(level): float(value)
        for level, value in zip(rows["degradation_pct"], rows["value"], strict=True)
    }


def _record(
    study: Study,
    assembly: Assembly,
    base: Fit,
    final: Fit,
    diagnoses: dict[str, Convergence],
    judgement: Judgement | None,
    seconds: dict[str, float],
) -> dict[str, object]:
    settings, forward = study.settings, base.model.forward
    emulator: dict[str, object] = {}
    if isinstance(forward, Surrogate):
        trained = json.loads(forward.record)
        emulator = {"error_pct": trained["left_out_rms_pct"], "record": forward.record}
    return {
        "title": settings.title or study.name,
        "study": study.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "virtual": settings.virtual,
        "note": settings.note,
        "seed": settings.seed,
        "effort": settings.effort,
        "version": bayesdeg.__version__,
        "versions": {name: version(name) for name in LIBRARIES}
        | {"python": platform.python_version()},
        "hashes": dict(study.hashes),
        "seconds": seconds,
        "counts": {
            "posterior draws, base": base.chain.log_prob.size,
            "posterior draws, final": final.chain.log_prob.size,
            "draws outside the emulator's range": int(np.sum(~np.isfinite(final.chain.log_prob))),
        },
        "missing": [{"what": what, "cost": cost} for what, cost in assembly.missing],
        "rests_on": rests_on(study),
        "convergence": {
            label: {
                "r_hat_max": max(d.r_hat),
                "ess_min": min(d.ess_bulk),
                "sentence": d.sentence,
            }
            for label, d in diagnoses.items()
        },
        "emulator": emulator,
        "misfit": {
            "observed": None if judgement is None else judgement.misfit.statistic,
            "name": "log-likelihood ratio of a smooth discrepancy",
        },
        "comparisons": comparisons(study, final),
    }
