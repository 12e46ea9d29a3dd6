"""The files of a run, each written on its own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.criticism.checks import statistics
from bayesdeg.criticism.checks.discrepancy import too_few
from bayesdeg.criticism.checks.residuals import (
    CurvatureFit,
    level_table,
    levels,
    misfit_frame,
    predict_readings,
)
from bayesdeg.criticism.fit.search import Step
from bayesdeg.criticism.holdout import gain
from bayesdeg.criticism.holdout.gain import LooPit, gain_table, mode_table
from bayesdeg.data.study import Study
from bayesdeg.inference.sampling import EFFORTS, to_datatree
from bayesdeg.observations.curvature import ActuatorCurves
from bayesdeg.pipeline import tables
from bayesdeg.pipeline.assemble import level_grid
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.deformed import Begun, write_deformed
from bayesdeg.pipeline.document import verdict_of
from bayesdeg.pipeline.films import CourseFit
from bayesdeg.pipeline.judge import Judgement
from bayesdeg.pipeline.results import Results
from bayesdeg.prediction.control import INTERVAL, largest_allowed, needed_by
from bayesdeg.prediction.predictive import (
    Specimens,
    curvature_bands,
    draw_specimens,
    respond,
    rupture_table,
)
from bayesdeg.report import columns
from bayesdeg.report.folder import (
    POSTERIOR,
    POSTERIOR_BASE,
    POSTERIOR_COURSE,
    POSTERIORS,
    RunFolder,
)
from bayesdeg.report.left_out import Guard, Stage, posterior_stage, table_stage


@dataclass(frozen=True)
class Files:
    """Writes the files of a run, each on its own: one that fails is left out.

    Those of an earlier run in the same folder that are not written again are removed, so that all
    that is there belongs together.
    """

    folder: RunFolder
    guard: Guard
    written: set[str] = field(default_factory=set)

    def table(self, name: str, compute: Callable[[], pd.DataFrame | None]) -> pd.DataFrame | None:
        """Write what is computed as a table; None where it fails, or is nothing."""
        return self.guard.attempt(table_stage(name), self._table, name, compute)

    def _table(self, name: str, compute: Callable[[], pd.DataFrame | None]) -> pd.DataFrame | None:
        frame = compute()
        if frame is not None:
            self.folder.write_table(name, frame)
            self.written.add(name)
        return frame

    def posterior(
        self, name: str, fit: Fit | CourseFit, generator: np.random.Generator, *, kept: int
    ) -> None:
        """Write draws of a posterior."""
        self.guard.attempt(posterior_stage(name), self._posterior, name, fit, generator, kept)

    def _posterior(
        self, name: str, fit: Fit | CourseFit, generator: np.random.Generator, kept: int
    ) -> None:
        tree = to_datatree(fit.model, fit.chain.thinned(kept), generator)
        self.folder.write_posterior(name, tree)
        self.written.add(name)

    def remove_others(self) -> None:
        """Remove tables and posteriors of an earlier run that were not written again."""
        for name in set(columns.TABLES) - self.written:
            self.folder.remove(table_stage(name))
        for name in set(POSTERIORS) - self.written:
            self.folder.remove(posterior_stage(name))


Floats = NDArray[np.float64]

RISK = 0.05
SHARE = 0.5  # of the largest curvature measured at a level: what is wanted there
DRAWS = 300


def decisions(fits: Mapping[str, Fit], generator: np.random.Generator) -> pd.DataFrame:
    """Return the pressure for half of the largest curvature measured at each level, by model.

    Parameters
    ----------
    fits : mapping
        Calibrations by the models' names, with actuators.
    generator : Generator
        Draws the specimens.

    Returns
    -------
    DataFrame
        The columns of ``decisions.csv``: wanted curvature, the pressure that a new specimen needs
        with its 90 % interval, and the probability of rupture there.
    """
    data = next(iter(fits.values())).model.actuator
    assert data is not None
    rows = []
    for name, fit in fits.items():
        specimens = draw_specimens(fit.model, fit.chain, generator, draws=DRAWS)
        first = fit.model.largest_pressure
        for level, wanted in _wanted(data):
            allowed = largest_allowed(specimens, level, RISK, first=first)
            each = needed_by(specimens, level, wanted, first=first)
            needed = np.quantile(each, INTERVAL, method="inverted_cdf")
            rows.append(
                {
                    "model": name,
                    "degradation_pct": level,
                    "wanted_per_m": wanted,
                    "needed_q05_kPa": needed[0],
                    "needed_q50_kPa": needed[1],
                    "needed_q95_kPa": needed[2],
                    "allowed_kPa": allowed.pressure,
                    "probability": _probability(specimens, level, float(needed[1])),
                }
            )
    return pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan)


def _probability(specimens: Specimens, degradation: float, pressure: float) -> float:
    """Return the probability of rupture; nan where there is no pressure, or no limit is known."""
    if not (np.isfinite(pressure) and specimens.model.has_elongation):
        return float("nan")
    return float(respond(specimens, degradation, np.array([pressure])).burst.mean())


def _wanted(data: ActuatorCurves) -> list[tuple[float, float]]:
    """Return each level of degradation [%] and half of its largest curvature [1/m].

    Levels at which nothing bent are left out.
    """
    centres, member = levels(data.degradation[:, 0])
    largest = np.where(data.mask, data.curvature, 0.0).max(axis=1)
    found = [
        (float(round(centre, 2)), float(f"{SHARE * largest[member == k].max():.3g}"))
        for k, centre in enumerate(centres)
    ]
    return [(level, wanted) for level, wanted in found if wanted > 0.0]


Json = dict[str, object]


def write_results(
    study: Study,
    folder: RunFolder,
    results: Results,
    generator: np.random.Generator,
    guard: Guard | None = None,
    *,
    pictures: Begun | None = None,
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
        if subject.holds_out_modes:
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
        found = gain.loo_pit(one.draws[:, rows], observed[rows])
        if found.is_available:
            known[name] = found
        else:
            guard.note(table_stage(columns.LOO_PIT), found.sentence)
    return gain.frame(known) if known else None


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
