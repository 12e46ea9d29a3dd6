"""Fits and judgement become the files of the run folder."""

from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.criticism import loo_pit, statistics
from bayesdeg.criticism.discrepancy import too_few
from bayesdeg.criticism.gain import gain_table, mode_table
from bayesdeg.criticism.loo_pit import LooPit
from bayesdeg.criticism.model_readings import ModelReadings
from bayesdeg.criticism.residuals import (
    CurvatureFit,
    level_table,
    predict_readings,
)
from bayesdeg.criticism.statistics_of_residuals import misfit_frame
from bayesdeg.criticism.step import Step
from bayesdeg.data.study import Study
from bayesdeg.inference.ensemble import EFFORTS
from bayesdeg.pipeline import tables
from bayesdeg.pipeline.assemble import level_grid
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.concluding import verdict_of
from bayesdeg.pipeline.decisions import decisions
from bayesdeg.pipeline.deformed import Begun, write_deformed
from bayesdeg.pipeline.files import Files
from bayesdeg.pipeline.judgement import Judgement
from bayesdeg.pipeline.results import Results
from bayesdeg.prediction.predictive import curvature_bands, rupture_table
from bayesdeg.report import columns
from bayesdeg.report.folder import POSTERIOR, POSTERIOR_BASE, POSTERIOR_COURSE, RunFolder
from bayesdeg.report.left_out import Guard, Stage, table_stage

Floats = NDArray[np.float64]
Json = dict[str, object]


def write_results(
    study: Study,
    folder: RunFolder,
    results: Results,
    generator: np.random.Generator,
    guard: Guard | None = None,
    *,
    pictures: Begun | None = None,
    deformed: bool = True,
) -> Json:
    """Write posteriors and tables; return the content of ``verdict.json``.

    Parameters
    ----------
    study : Study
        What was run.
    folder : RunFolder
        Where the files go.
    results : Results
        What was found.
    generator : Generator
        Draws what is predicted.
    guard : Guard, optional
        Leaves out what fails; by default nothing is left out and faults are raised.
    pictures : callable, optional
        What waits for the deformed actuators, where they are being solved already.
    deformed : bool
        Whether to solve them at all.
    """
    guard = guard or Guard(strict=True)
    files = Files(folder, guard)
    kept = EFFORTS[study.settings.effort].kept
    for name, fit in ((POSTERIOR_BASE, results.base), (POSTERIOR, results.final)):
        files.posterior(name, fit, generator, kept=kept)
    if results.checks is not None:
        for name, compute in results.checks.tables().items():
            files.table(name, compute)
    _write_films(files, results, generator, kept=kept)
    note = _write_material(study, files, results, generator)
    residual = None
    if results.base.model.actuator is not None:
        _write_predictions(files, results.final, generator)
        if deformed:
            geometry = Geometry(study.settings.dimensions)
            draw = partial(write_deformed, begun=pictures)
            guard.attempt(Stage.DEFORMED, draw, folder, results.final, geometry)
        residual = _write_readings(study, files, results, generator)
        files.table(columns.DECISIONS, lambda: decisions(results.fits, generator))
    if results.judgement is not None:
        _write_held_out(files, results.judgement)
        _write_criticism(files, results.judgement)
    files.remove_others()
    return verdict_of(results, residual, note, guard)


def _write_held_out(files: Files, judgement: Judgement) -> None:
    """Write how well specimens, modes of tension and levels that took no part are predicted."""
    subject = judgement.search.base.subject
    if judgement.held_out:
        files.table(columns.GAIN, lambda: gain_table(subject, judgement.held_out))
        if isinstance(subject, ModelReadings) and subject.holds_out_modes:
            files.table(columns.GAIN_MODES, lambda: mode_table(subject, judgement.held_out))
    if judgement.levels_out:
        files.table(columns.GAIN_LEVELS, lambda: gain_table(subject, judgement.levels_out))


def _write_criticism(files: Files, judgement: Judgement) -> None:
    """Write statistics, what there is to explain, and the fit to held-out readings."""
    base, final = judgement.steps
    files.table(columns.STATISTICS, lambda: _statistics(base, files.guard))
    parts = {"base": base} if base is final else {"base": base, "final": final}
    files.table(columns.DISCREPANCY, lambda: _discrepancies(parts))
    if judgement.held_out:
        files.table(columns.LOO_PIT, lambda: _loo_pit(judgement, tuple(parts), files.guard))
    null = judgement.misfit.null
    files.table(
        columns.MISFIT_NULL,
        lambda: pd.DataFrame({"statistic": null, "replicate": np.arange(len(null))}),
    )


def _statistics(base: Step, guard: Guard) -> pd.DataFrame:
    drawn, known = base.misfit.drawn, len(base.simulated)
    if known < statistics.FEWEST:
        why = f"The statistics are not available: {too_few(known, drawn)}."
        guard.note(table_stage(columns.STATISTICS), why)
    return statistics.frame(statistics.statistics_table(base.trial.linear, base.simulated, drawn))


def _discrepancies(parts: dict[str, Step]) -> pd.DataFrame:
    misfits = [misfit_frame(s.trial.linear, s.misfit, name) for name, s in parts.items()]
    return pd.concat(misfits, ignore_index=True)


def _loo_pit(judgement: Judgement, names: tuple[str, ...], guard: Guard) -> pd.DataFrame | None:
    """Return the fit to held-out readings; None where too few of them could be predicted."""
    held_out = list(judgement.held_out.values())
    observed = judgement.search.base.subject.observed
    known: dict[str, LooPit] = {}
    for name, one in zip(names, (held_out[0], held_out[-1]), strict=False):
        rows = np.all(np.isfinite(one.draws), axis=0)
        found = loo_pit.loo_pit(one.draws[:, rows], observed[rows])
        if found.is_available:
            known[name] = found
        else:
            guard.note(table_stage(columns.LOO_PIT), found.sentence)
    return loo_pit.frame(known) if known else None


def _write_films(
    files: Files, results: Results, generator: np.random.Generator, *, kept: int
) -> None:
    if results.films is None:
        return
    for name, compute in results.films.tables(generator).items():
        files.table(name, compute)
    if results.films.course is not None:
        files.posterior(POSTERIOR_COURSE, results.films.course, generator, kept=kept)


def _write_material(
    study: Study, files: Files, results: Results, generator: np.random.Generator
) -> str:
    """Write the tables of the material; return what is wrong with held-out modes of tension."""
    fits = results.fits.items()
    files.table(
        columns.CONSTANTS,
        lambda: _joined([tables.constants(fit, label, generator) for label, fit in fits]),
    )
    files.table(
        columns.PARAMETERS,
        lambda: _joined([tables.parameters(fit, label) for label, fit in results.sampled.items()]),
    )
    films = None
    if study.tensile is not None:
        films = files.table(
            columns.TENSILE,
            lambda: _joined([tables.tensile(study, fit, label, generator) for label, fit in fits]),
        )
    files.table(columns.ELONGATION, lambda: tables.elongation(results.final, generator))
    files.table(columns.MEASURED, lambda: tables.measured(study))
    if films is None:
        return ""
    return files.guard.attempt(Stage.HELD_OUT_MODES, tables.held_out_modes, films) or ""


def _joined(frames: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(frames, ignore_index=True)


def _write_readings(
    study: Study, files: Files, results: Results, generator: np.random.Generator
) -> Floats | None:
    """Write predictions at the readings; return the residuals of the base model [1/m], if known."""
    found = files.guard.attempt(Stage.READINGS, _predicted, results, generator)
    if found is None:
        return None
    published = _published_r_squared(study)
    fits = results.fits
    files.table(
        columns.OBSERVATIONS,
        lambda: _joined([tables.observations(fits[n].model, n, r) for n, r in found.items()]),
    )
    files.table(
        columns.LEVELS,
        lambda: _joined(
            [level_table(fits[n].model, r, published).assign(model=n) for n, r in found.items()]
        ),
    )
    data = results.base.model.actuator
    assert data is not None
    return data.curvature - found["base"].mean


def _predicted(results: Results, generator: np.random.Generator) -> dict[str, CurvatureFit]:
    return {
        label: predict_readings(fit.model, fit.chain, generator)
        for label, fit in results.fits.items()
    }


def _write_predictions(files: Files, fit: Fit, generator: np.random.Generator) -> None:
    assert fit.model.actuator is not None
    grid = level_grid(fit.model)
    pressure = np.arange(0.0, float(np.max(fit.model.actuator.pressure)) + 1e-9, 10.0)
    files.table(
        columns.BANDS,
        lambda: curvature_bands(
            fit.model, fit.chain, generator, degradation=grid, pressure=pressure
        ),
    )
    files.table(
        columns.RUPTURE,
        lambda: (
            rupture_table(fit.model, fit.chain, generator, degradation=grid, pressure=pressure)
            if "elongation_scatter" in fit.model.table.names
            else pd.DataFrame(columns=[c.name for c in columns.TABLES[columns.RUPTURE]])
        ),
    )


def _published_r_squared(study: Study) -> dict[float, float]:
    if study.summary is None:
        return {}
    rows = study.summary[study.summary["quantity"] == "r_squared"]
    return {
        float(level): float(value)
        for level, value in zip(rows["degradation_pct"], rows["value"], strict=True)
    }
