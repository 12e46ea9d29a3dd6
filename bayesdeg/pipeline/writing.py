"""Fits and judgement become the files of the run folder."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.criticism import loo_pit, statistics
from bayesdeg.criticism.concentration import concentration, with_concentration
from bayesdeg.criticism.gain import gain_table, mode_table
from bayesdeg.criticism.model_readings import ModelReadings
from bayesdeg.criticism.residuals import level_table, predict_readings, where, where_films
from bayesdeg.criticism.statistics_of_residuals import misfit_frame
from bayesdeg.inference.ensemble import EFFORTS, to_datatree
from bayesdeg.measure.study import Study
from bayesdeg.pipeline import tables
from bayesdeg.pipeline.assemble import level_grid
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.decisions import decisions
from bayesdeg.pipeline.deformed import write_deformed
from bayesdeg.pipeline.document import unjudged_document, verdict_document
from bayesdeg.pipeline.films import Films
from bayesdeg.pipeline.judgement import Judgement, readings_misfit
from bayesdeg.pipeline.results import Results
from bayesdeg.prediction.bands import curvature_bands
from bayesdeg.prediction.rupture import rupture_table
from bayesdeg.report import columns
from bayesdeg.report.folder import POSTERIOR, POSTERIOR_BASE, POSTERIOR_COURSE, RunFolder

Floats = NDArray[np.float64]


def write_results(
    study: Study, folder: RunFolder, results: Results, generator: np.random.Generator
) -> dict[str, object]:
    """Write posteriors and tables; return the content of ``verdict.json``."""
    kept = EFFORTS[study.settings.effort].kept
    for name, fit in ((POSTERIOR_BASE, results.base), (POSTERIOR, results.final)):
        tree = to_datatree(fit.model, fit.chain.thinned(kept), generator)
        folder.write_posterior(name, tree)
    if results.checks is not None:
        for name, frame in results.checks.tables().items():
            folder.write_table(name, frame)
    if results.films is not None:
        _write_films(folder, results.films, generator, kept=kept)
    held_out = _write_material(study, folder, results, generator)
    if results.judgement is None:
        return unjudged_document(results.assembly.unjudged, held_out)
    residual = None
    if results.base.model.actuator is not None:
        _write_predictions(folder, results.final, generator)
        write_deformed(folder, results.final, Geometry(study.settings.dimensions))
        residual = _write_readings(study, folder, results, generator)
        folder.write_table(columns.DECISIONS, decisions(results.fits, generator))
    base, judgement = results.base.model, results.judgement
    subject = judgement.search.base.subject
    if judgement.held_out:
        folder.write_table(columns.GAIN, gain_table(subject, judgement.held_out))
        if isinstance(subject, ModelReadings) and subject.holds_out_modes:
            folder.write_table(columns.GAIN_MODES, mode_table(subject, judgement.held_out))
    if judgement.levels_out:
        folder.write_table(columns.GAIN_LEVELS, gain_table(subject, judgement.levels_out))
    _write_criticism(folder, judgement)
    null = pd.DataFrame({"statistic": judgement.misfit.null})
    folder.write_table(columns.MISFIT_NULL, null.assign(replicate=np.arange(len(null))))
    _, noise = readings_misfit(judgement)
    linear = judgement.search.base.linear
    place = where_films(linear) if residual is None else where(base, residual, noise or 0.0)
    found = concentration(linear, judgement.steps[0].simulated, judgement.misfit.statistic)
    return verdict_document(
        judgement,
        with_concentration(place, found),
        judgement.experiments,
        note=held_out,
        concentrated=found,
    )


def _write_criticism(folder: RunFolder, judgement: Judgement) -> None:
    """Write statistics, what there is to explain, and the fit to held-out readings."""
    base, final = judgement.steps
    table = statistics.statistics_table(base.trial.linear, base.simulated)
    folder.write_table(columns.STATISTICS, statistics.frame(table))
    parts = {"base": base} if base is final else {"base": base, "final": final}
    misfits = [misfit_frame(s.trial.linear, s.misfit, name) for name, s in parts.items()]
    folder.write_table(columns.DISCREPANCY, pd.concat(misfits, ignore_index=True))
    held_out = list(judgement.held_out.values())
    if not held_out:
        return
    pairs = dict(zip(parts, (held_out[0], held_out[-1]), strict=False))
    observed = base.trial.subject.observed
    known = {
        name: loo_pit.loo_pit(one.draws[:, rows], observed[rows])
        for name, one in pairs.items()
        for rows in [np.all(np.isfinite(one.draws), axis=0)]
    }
    folder.write_table(columns.LOO_PIT, loo_pit.frame(known))


def _write_films(
    folder: RunFolder, films: Films, generator: np.random.Generator, *, kept: int
) -> None:
    for name, frame in films.tables(generator).items():
        folder.write_table(name, frame)
    if films.course is not None:
        tree = to_datatree(films.course.model, films.course.chain.thinned(kept), generator)
        folder.write_posterior(POSTERIOR_COURSE, tree)


def _write_material(
    study: Study, folder: RunFolder, results: Results, generator: np.random.Generator
) -> str:
    """Write the tables of the material; return what is wrong with held-out modes of tension."""
    fits = results.fits.items()
    by_label = {
        columns.CONSTANTS: [tables.constants(fit, label, generator) for label, fit in fits],
        columns.PARAMETERS: [
            tables.parameters(fit, label) for label, fit in results.sampled.items()
        ],
    }
    if study.tensile is not None:
        by_label[columns.TENSILE] = [
            tables.tensile(study, fit, label, generator) for label, fit in fits
        ]
    joined = {name: pd.concat(frames, ignore_index=True) for name, frames in by_label.items()}
    for name, frame in joined.items():
        folder.write_table(name, frame)
    elongation = tables.elongation(results.final, generator)
    if elongation is not None:
        folder.write_table(columns.ELONGATION, elongation)
    folder.write_table(columns.MEASURED, tables.measured(study))
    return tables.held_out_modes(joined[columns.TENSILE]) if columns.TENSILE in joined else ""


def _write_readings(
    study: Study, folder: RunFolder, results: Results, generator: np.random.Generator
) -> Floats:
    """Write predictions at the readings; return the residuals of the base model [1/m]."""
    published = _published_r_squared(study)
    observed, levels, residuals = [], [], []
    for label, fit in results.fits.items():
        assert fit.model.actuator is not None
        readings = predict_readings(fit.model, fit.chain, generator)
        observed.append(tables.observations(fit.model, label, readings))
        levels.append(level_table(fit.model, readings, published).assign(model=label))
        residuals.append(fit.model.actuator.curvature - readings.mean)
    folder.write_table(columns.OBSERVATIONS, pd.concat(observed, ignore_index=True))
    folder.write_table(columns.LEVELS, pd.concat(levels, ignore_index=True))
    return residuals[0]


def _write_predictions(folder: RunFolder, fit: Fit, generator: np.random.Generator) -> None:
    assert fit.model.actuator is not None
    grid = level_grid(fit.model)
    pressure = np.arange(0.0, float(np.max(fit.model.actuator.pressure)) + 1e-9, 10.0)
    bands = curvature_bands(fit.model, fit.chain, generator, degradation=grid, pressure=pressure)
    folder.write_table(columns.BANDS, bands)
    rupture = (
        rupture_table(fit.model, fit.chain, generator, degradation=grid, pressure=pressure)
        if "elongation_scatter" in fit.model.table.names
        else pd.DataFrame(columns=[c.name for c in columns.TABLES[columns.RUPTURE]])
    )
    folder.write_table(columns.RUPTURE, rupture)


def _published_r_squared(study: Study) -> dict[float, float]:
    if study.summary is None:
        return {}
    rows = study.summary[study.summary["quantity"] == "r_squared"]
    return {
        float(level): float(value)
        for level, value in zip(rows["degradation_pct"], rows["value"], strict=True)
    }
