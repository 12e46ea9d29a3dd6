"""Building and writing the tables and posteriors of a run."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.analysis.averaged import stored_form
from bayesdeg.analysis.calibrate import Fit, Sampled
from bayesdeg.analysis.judge import Judgement
from bayesdeg.analysis.model_kind import kind_of
from bayesdeg.assembly.aside import is_set_aside
from bayesdeg.assembly.assemble import level_grid
from bayesdeg.criticism.checks import statistics as residual_statistics
from bayesdeg.criticism.checks.known_terms import KnownTerm
from bayesdeg.criticism.checks.residuals import (
    CurvatureFit,
    level_table,
    misfit_frame,
    predict_readings,
)
from bayesdeg.criticism.decide.candidates import FULL_FIT, SCREENING
from bayesdeg.criticism.decide.verdict import Uncalibrated
from bayesdeg.criticism.fit.search import Step
from bayesdeg.criticism.holdout import gain
from bayesdeg.criticism.holdout.gain import LooPit, gain_table, mode_table
from bayesdeg.data.levels import levels
from bayesdeg.data.moisture import (
    MASS_LOSS_SLOPE,
    degradation_of_films,
    mass_loss_slope,
    moisture_content,
)
from bayesdeg.data.photographs import FILE as PHOTOS_FILE
from bayesdeg.data.photographs import trace_rows
from bayesdeg.data.settings import RUPTURE_CRITERIA
from bayesdeg.data.shrinkage import film_masses, mean_as_printed
from bayesdeg.data.study import Study
from bayesdeg.extras import camera
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.inference.tree import to_datatree
from bayesdeg.material.strength import draw_scores
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import ActuatorCurves, Curvature
from bayesdeg.observations.means import statistics
from bayesdeg.observations.specimens import has_elongation, young_modulus
from bayesdeg.observations.tensile import (
    film_readings,
    median_stresses,
    stress_variance,
    tensile_curves,
)
from bayesdeg.pages import tables as columns
from bayesdeg.pages.folder import (
    ADDED,
    PICTURES,
    POSTERIOR,
    POSTERIOR_AVERAGED,
    POSTERIOR_BASE,
    POSTERIOR_COURSE,
    POSTERIORS,
    RunFolder,
)
from bayesdeg.pages.left_out import Guard, OptionalStage, posterior_stage, table_stage
from bayesdeg.pages.record import ModelEntry, VerdictRecord
from bayesdeg.pages.wording import sentences, worded
from bayesdeg.prediction.control import INTERVAL, largest_allowed, needed_by
from bayesdeg.prediction.experience import experience_of
from bayesdeg.prediction.lifetime import Duty, default_hours, life_table, lifetime_of
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.prediction.predictive import (
    Specimens,
    curvature_bands,
    draw_specimens,
    draw_values,
    fewest_checks,
    not_below,
    respond,
    rupture_table,
    specimens_tested,
)
from bayesdeg.prediction.shares import curvature_shares, pressures_of
from bayesdeg.prediction.soil import Soil
from bayesdeg.prediction.stored import model_document
from bayesdeg.progress import Silent
from bayesdeg.run.deformed import Begun, write_deformed
from bayesdeg.run.record import Results, suspects_of, verdict_of

Floats = NDArray[np.float64]

FIVE = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILES = ("q05", "q25", "q50", "q75", "q95")
FITTED_DRAWS = 2000


def observations(model: JointModel, label: str, fit: CurvatureFit) -> pd.DataFrame:
    """Return every reading of curvature with its posterior prediction."""
    data = model.data_of(Curvature).tests
    mask = data.mask
    shape = mask.shape
    return pd.DataFrame(
        {
            "model": label,
            "specimen_id": np.broadcast_to(np.array(data.specimens)[:, None], shape)[mask],
            "degradation_pct": np.broadcast_to(data.degradation, shape)[mask],
            "pressure_kPa": data.pressure[mask],
            "branch": data.branch[mask],
            "cycle": data.cycle[mask],
            "curvature_per_m": data.curvature[mask],
            "mean_per_m": fit.mean[mask],
            "q05_per_m": fit.low[mask],
            "q95_per_m": fit.high[mask],
            "residual_per_m": (data.curvature - fit.mean)[mask],
        }
    )


def fitted(fit: Fit, label: str, generator: np.random.Generator) -> pd.DataFrame | None:
    """Return readings without their own table, with posterior predictions.

    Quantiles are for a reading on a new specimen in the same test; None without such readings.
    """
    model, scales = fit.model, fit.model.scales
    rows = np.isin(model.places.kind, list(scales))
    if not rows.any():
        return None
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    vectors = flat[generator.integers(len(flat), size=FITTED_DRAWS)]
    places, drawn = model.places.subset(rows), model.simulated(vectors, generator)[:, rows]
    low, lower, upper, high = np.nanquantile(drawn, [0.05, 0.25, 0.75, 0.95], axis=0)
    each = [scales[kind] for kind in places.kind.tolist()]
    return pd.DataFrame(
        {
            "model": label,
            "kind": places.kind,
            "unit": [scale.unit for scale in each],
            "specimen_id": places.specimen,
            "level": places.level,
            "level_unit": [scale.level for scale in each],
            "history": places.history,
            "along": places.along,
            "axis": [scale.axis for scale in each],
            "measured": model.observed[rows],
            "mean": np.nanmean(model.expected(vectors)[:, rows], axis=0),
            "q05": low,
            "q25": lower,
            "q75": upper,
            "q95": high,
        }
    )


def tensile(study: Study, fit: Fit, label: str, generator: np.random.Generator) -> pd.DataFrame:
    """Return every reading of stress, fitted or held out, with its posterior prediction.

    In nominal stress, whatever stress was recorded.
    """
    frames = []
    values = draw_values(fit.model, fit.chain, generator, 400)
    for fitted in (True, False):
        curves = tensile_curves(study, fitted=fitted)
        if curves is None:
            continue
        median = median_stresses(fit.model.tests(values), curves)
        scatter = np.stack(
            np.broadcast_arrays(values["stiffness_scatter"][:, None], curves.degradation_sd),
            axis=-1,
        )
        deviation = scatter * generator.standard_normal(scatter.shape)
        drawn, _ = film_readings(median, deviation)
        noise = np.sqrt(stress_variance(values, drawn))
        readings = drawn + noise * generator.standard_normal(drawn.shape)
        low, high = np.quantile(readings, [0.05, 0.95], axis=0)
        to_nominal = np.where(curves.cauchy, 1.0 / curves.stretch, 1.0)
        mask, shape = curves.mask, curves.mask.shape
        frames.append(
            pd.DataFrame(
                {
                    "model": label,
                    "specimen_id": np.broadcast_to(np.array(curves.specimens)[:, None], shape)[
                        mask
                    ],
                    "mode": np.broadcast_to(np.array(curves.modes)[:, None], shape)[mask],
                    "degradation_pct": np.broadcast_to(curves.degradation[:, None], shape)[mask],
                    "stretch": curves.stretch[mask],
                    "stress_MPa": (curves.stress * to_nominal)[mask],
                    "fitted": int(fitted),
                    "mean_MPa": (median.at_rest.mean(axis=0) * to_nominal)[mask],
                    "q05_MPa": (low * to_nominal)[mask],
                    "q95_MPa": (high * to_nominal)[mask],
                }
            )
        )
    return pd.concat(frames, ignore_index=True)


def held_out_modes(table: pd.DataFrame) -> str:
    """Describe the errors of predicted modes of tension; empty if none was held out."""
    held = table[(table["model"] == "final") & (table["fitted"] == 0)]
    said = []
    for mode, rows in held.groupby("mode"):
        error = float(np.sqrt(np.mean((rows["stress_MPa"] - rows["mean_MPa"]) ** 2)))
        inside = np.mean(rows["stress_MPa"].between(rows["q05_MPa"], rows["q95_MPa"]))
        share = 100.0 * error / float(np.abs(rows["stress_MPa"]).max())
        facts = {"mode": mode, "error": error, "share": share, "inside": 100.0 * inside}
        said.append(sentences("run", "held_out_mode", **facts))
    return " ".join(said)


def constants(fit: Fit, label: str, generator: np.random.Generator) -> pd.DataFrame:
    """Return quantiles of the Yeoh constants and of Young's modulus against degradation."""
    grid = level_grid(fit.model)
    values = draw_values(fit.model, fit.chain, generator, 2000)
    yeoh = fit.model.world.constants(values, grid)
    c1, c2, c3 = np.moveaxis(yeoh, -1, 0)
    modulus = young_modulus(values, yeoh, fit.model.causes)
    named = {"c1": c1, "c2": c2, "c3": c3, "young_modulus": modulus}
    frames = [
        pd.DataFrame(
            {"model": label, "degradation_pct": grid, "constant": name, "unit": "MPa"}
            | dict(zip(QUANTILES, np.quantile(draws, FIVE, axis=0), strict=True))
        )
        for name, draws in named.items()
    ]
    return pd.concat(frames, ignore_index=True)


def parameters(fit: Sampled, label: str) -> pd.DataFrame:
    """Return posterior and prior of every parameter, with its diagnostics."""
    model, chain, diagnosis = fit.model, fit.chain, fit.diagnosis
    flat = model.table.named(chain.vectors.reshape(-1, chain.vectors.shape[-1]))
    rows = []
    for i, p in enumerate(model.table.parameters):
        draws, prior = flat[p.name], p.law.quantile(np.array([0.05, 0.5, 0.95]))
        low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
        rows.append(
            {
                "model": label,
                "parameter": p.name,
                "unit": p.unit,
                "meaning": p.meaning,
                "mean": float(np.mean(draws)),
                "sd": float(np.std(draws)),
                "q05": low,
                "q50": middle,
                "q95": high,
                "prior_q05": prior[0],
                "prior_q50": prior[1],
                "prior_q95": prior[2],
                "r_hat": diagnosis.r_hat[i],
                "ess_bulk": diagnosis.ess_bulk[i],
                "ess_tail": diagnosis.ess_tail[i],
            }
        )
    return pd.DataFrame(rows)


def elongation(fit: Fit, generator: np.random.Generator) -> pd.DataFrame | None:
    """Return the elongation limit against degradation: band of specimens, and measurements."""
    if "elongation_scatter" not in fit.model.table.names:
        return None
    grid = level_grid(fit.model)
    values = draw_values(fit.model, fit.chain, generator, 2000)
    median = fit.model.world.elongation(values, grid)
    law = fit.model.world.scatter_law
    scatter = values["elongation_scatter"][:, None] * draw_scores(median.shape, generator, law)
    low, middle, high = np.quantile(median * np.exp(scatter), [0.05, 0.5, 0.95], axis=0)
    band = pd.DataFrame(
        {"kind": "band", "degradation_pct": grid, "value": np.nan}
        | {"q05": low, "q50": middle, "q95": high}
    )
    breaks = fit.model.data_of(Breaks)
    if not breaks.labels:
        return band
    measured = pd.DataFrame(
        {
            "kind": "measured",
            "degradation_pct": breaks.table.degradation,
            "value": breaks.table.elongation,
        }
    )
    return pd.concat([band, measured.assign(q05=np.nan, q50=np.nan, q95=np.nan)])


def measured(study: Study) -> pd.DataFrame:
    """Return quantities derived from readings or publications, and their basis."""
    units = {"young_modulus": "MPa", "elongation_at_break": "%", "volume_ratio": "–"}
    units["modulus_100"] = "MPa"
    rows: list[dict[str, object]] = [
        {
            "quantity": s.quantity,
            "degradation_pct": np.nan if s.quantity == "volume_ratio" else s.degradation,
            "value": s.value,
            "sd": s.se,
            "unit": units[s.quantity],
            "n": np.nan,
            "rests_on": s.source,
        }
        for s in statistics(study)
    ]
    if study.moisture is not None:
        rows += _moisture(study)
    if study.shrinkage is not None:
        rows += _volume_ratios(study)
    if study.mass_loss is not None:
        rows += _mass_loss(study.mass_loss)
    names = ["quantity", "degradation_pct", "value", "sd", "unit", "n", "rests_on"]
    return pd.DataFrame(rows, columns=names)


def _moisture(study: Study) -> list[dict[str, object]]:
    assert study.moisture is not None
    table = study.moisture
    content = moisture_content(table["mass_equilibrated_g"], table["mass_dry_g"])
    try:
        films = degradation_of_films(table["time_h"].to_numpy(np.float64), content)
    except ValueError:  # without films at time 0 or replicates there is no rate
        return []
    return [
        {
            "quantity": f"degradation rate after {time:g} h",
            "degradation_pct": np.nan,
            "value": float(rate),
            "sd": float(error),
            "unit": "%",
            "n": float(np.sum(table["time_h"] == time)),
            "rests_on": "moisture.csv",
        }
        for time, rate, error in zip(
            films.time_h, films.degradation_pct, films.standard_error, strict=True
        )
    ]


def _volume_ratios(study: Study) -> list[dict[str, object]]:
    """Return α by Eqs 15 and 16, for comparison with that from the components' volumes."""
    assert study.shrinkage is not None
    printed = mean_as_printed(film_masses(study.shrinkage), study.settings.shrinkage)
    return [
        {
            "quantity": "volume ratio by Eqs 15 and 16",
            "degradation_pct": np.nan,
            "value": printed.value,
            "sd": printed.standard_error,
            "unit": "–",
            "n": float(printed.count),
            "rests_on": "shrinkage.csv, densities averaged by mass: for comparison only",
        }
    ]


def _mass_loss(control: pd.DataFrame) -> list[dict[str, object]]:
    """Return the slope of Eq. 6 with moisture on either basis."""
    try:
        found = mass_loss_slope(control)
    except ValueError:  # the moisture did not change
        return []
    return [
        {
            "quantity": f"mass loss over degradation rate, {basis} basis",
            "degradation_pct": np.nan,
            "value": slope,
            "sd": se,
            "unit": "–",
            "n": float(found.samples),
            "rests_on": f"mass_loss.csv{published}",
        }
        for basis, slope, se, published in (
            ("dry", found.dry, found.dry_se, f"; published {MASS_LOSS_SLOPE} (Eq. 6)"),
            ("wet", found.wet, found.wet_se, ""),
        )
    ]


@dataclass(frozen=True)
class Files:
    """Writes the files of a run one by one; any that fails is left out.

    Files of an earlier run that are not written again are removed, so that the folder is
    consistent.
    """

    folder: RunFolder
    guard: Guard
    written: set[str] = field(default_factory=set)

    def table(self, name: str, compute: Callable[[], pd.DataFrame | None]) -> pd.DataFrame | None:
        """Compute and write a table; None if that fails or there is nothing to write."""
        return self.guard.attempt(table_stage(name), self._table, name, compute)

    def _table(self, name: str, compute: Callable[[], pd.DataFrame | None]) -> pd.DataFrame | None:
        frame = compute()
        if frame is not None:
            self.folder.write_table(name, frame)
            self.written.add(name)
        return frame

    def posterior(
        self, name: str, fit: Sampled, generator: np.random.Generator, *, kept: int
    ) -> None:
        """Write draws of a posterior."""
        self.tree(name, lambda: to_datatree(fit.model, fit.chain.thinned(kept), generator))

    def tree(self, name: str, compute: Callable[[], xr.DataTree]) -> None:
        """Compute and write a posterior."""
        self.guard.attempt(posterior_stage(name), self._tree, name, compute)

    def _tree(self, name: str, compute: Callable[[], xr.DataTree]) -> None:
        self.folder.write_posterior(name, compute())
        self.written.add(name)

    def remove_others(self) -> None:
        """Remove tables and posteriors of an earlier run that were not written again."""
        for name in set(columns.TABLES) - self.written:
            self.folder.remove(table_stage(name))
        for name in set(POSTERIORS) - self.written:
            self.folder.remove(posterior_stage(name))
        self.folder.remove(ADDED)


RISK = 0.05
SHARE = 0.5  # wanted curvature, as a share of the largest measured at a level
DRAWS = 300


def decisions(
    fits: Mapping[str, Fit], generator: np.random.Generator, study: Study | None = None
) -> pd.DataFrame:
    """Return the pressure for half of the largest curvature measured at each level, by model.

    Parameters
    ----------
    fits : mapping
        Calibrations by the models' names, with actuators.
    generator : Generator
        Draws the specimens.
    study : Study, optional
        For the ruptures that it cites.

    Returns
    -------
    DataFrame
        The columns of ``decisions.csv``: wanted curvature, the pressure that a new specimen needs
        with its 90 % interval, and the probability of rupture there.
    """
    model = next(iter(fits.values())).model
    data, experience = model.data_of(Curvature).tests, experience_of(model_document(model, study))
    rows = []
    for name, fit in fits.items():
        specimens = draw_specimens(fit.model, fit.chain, generator, draws=DRAWS)
        first = fit.model.world.largest_pressure
        checks = fewest_checks(specimens_tested(fit.model), DRAWS)
        for level, wanted in _wanted(data):
            ceiling = experience.ceiling(level)
            allowed = largest_allowed(specimens, level, RISK, first=first, ceiling=ceiling)
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
                    "probability": _probability(specimens, level, float(needed[1]), checks),
                    "rupture_checks": checks,
                }
            )
    return pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan)


def _probability(specimens: Specimens, degradation: float, pressure: float, checks: int) -> float:
    """Return the probability of rupture; nan without a pressure or a known limit."""
    if not (np.isfinite(pressure) and has_elongation(specimens.model.base)):
        return float("nan")
    burst = respond(specimens, degradation, np.array([pressure])).burst.mean(axis=0)
    return float(not_below(burst, checks)[0])


def _wanted(data: ActuatorCurves) -> list[tuple[float, float]]:
    """Return each level of degradation [%] and half of its largest curvature [1/m].

    Levels without bending are left out.
    """
    centres, member = levels(data.degradation[:, 0])
    largest = np.where(data.mask, data.curvature, 0.0).max(axis=1)
    found = [
        (float(round(centre, 2)), float(f"{SHARE * largest[member == k].max():.3g}"))
        for k, centre in enumerate(centres)
    ]
    return [(level, wanted) for level, wanted in found if wanted > 0.0]


LIFE_DRAWS = 80
DUTY_SHARE = (
    0.5  # duty of the default life: share of the largest pressure, and of the fresh curvature there
)


def life(found: "TableSources") -> pd.DataFrame | None:
    """Return the life in the soil for half of the fresh curvature at half the pressure.

    None without actuators, or without the course of degradation.
    """
    fit = found.results.final
    if not found.has_actuators or found.soil is None:
        return None
    base = found.results.base.model
    tested = kind_of(base).tested(base, fit.model, found.study) or ModelEntry()
    posterior = Posterior(fit.model, fit.chain, tested)
    pressure = DUTY_SHARE * fit.model.world.largest_pressure
    specimens = draw_specimens(fit.model, fit.chain, found.generator, draws=LIFE_DRAWS)
    fresh = respond(specimens, 0.0, np.array([pressure])).curvature
    answered = fresh[np.isfinite(fresh)]
    wanted = DUTY_SHARE * float(np.median(answered)) if answered.size else 0.0
    if not wanted > 0.0:
        return None
    duty = Duty(pressure, float(f"{wanted:.3g}"), RISK)
    followed = lifetime_of(
        *(posterior, found.soil, duty, default_hours(posterior.measured)),
        seed=np.random.SeedSequence(int(found.generator.integers(2**63))),
        progress=Silent(),
        experience=posterior.experience,
        draws=LIFE_DRAWS,
    )
    return life_table(posterior, followed, duty)


@dataclass
class TableSources:
    """The data for the tables of a run.

    Parameters
    ----------
    study : Study
        What was run.
    results : Results
        What was found.
    generator : Generator
        Draws what is predicted: tables are made in the order of `BUILDS`.
    guard : Guard
        Leaves out what fails.
    known_soil : Soil, optional
        The course of degradation that a run found before, where these results have none.
    """

    study: Study
    results: Results
    generator: np.random.Generator
    guard: Guard
    known_soil: Soil | None = None

    @cached_property
    def readings(self) -> dict[str, CurvatureFit]:
        """Predictions at the curvature readings by model; empty if they failed."""
        fits = self.results.fits

        def predicted() -> dict[str, CurvatureFit]:
            draw = self.generator
            return {n: predict_readings(fit.model, fit.chain, draw) for n, fit in fits.items()}

        return self.guard.attempt(OptionalStage.READINGS, predicted) or {}

    @property
    def soil(self) -> Soil | None:
        """The course of degradation in the soil; None without film moisture."""
        course = self.results.course
        kept = EFFORTS[self.study.settings.sampling.effort].kept
        return self.known_soil if course is None else course.soil(kept)

    @property
    def judgement(self) -> Judgement | None:
        """The judgement; None if nothing was judged."""
        return self.results.judgement

    @property
    def has_actuators(self) -> bool:
        """Whether there are curvature readings."""
        return bool(self.results.base.model.of_kind(Curvature))

    @property
    def steps(self) -> dict[str, Step]:
        """The base model and the one with all that is supported, by their names in the tables."""
        if self.judgement is None:
            return {}
        base, final = self.judgement.steps
        return {"base": base} if base is final else {"base": base, "final": final}

    def residual(self) -> Floats | None:
        """Return the residuals of the base model [1/m]; None if unknown."""
        model = self.results.base.model
        if not model.of_kind(Curvature) or not self.readings:
            return None
        return model.data_of(Curvature).tests.curvature - self.readings["base"].mean


type Build = Callable[[TableSources], pd.DataFrame | None]


def write_results(
    study: Study,
    files: Files,
    results: Results,
    generator: np.random.Generator,
    *,
    pictures: Begun | None = None,
    deformed: bool = True,
) -> VerdictRecord:
    """Write tables; return the content of ``verdict.json``.

    Parameters
    ----------
    study : Study
        What was run.
    files : Files
        Those of the run; `write_posteriors` has written the first.
    results : Results
        What was found.
    generator : Generator
        Draws what is predicted.
    pictures : callable, optional
        What waits for the deformed actuators, where they are being solved already.
    deformed : bool
        Whether to solve them at all.
    """
    guard, found = files.guard, TableSources(study, results, generator, files.guard)
    of_checks = {} if results.checks is None else results.checks.tables()
    of_films = {} if results.films is None else results.films.tables(generator)
    for name, compute in (of_checks | of_films).items():
        files.table(name, compute)
    if results.course is not None:
        kept = EFFORTS[study.settings.sampling.effort].kept
        files.posterior(POSTERIOR_COURSE, results.course, generator, kept=kept)
    if results.averaged is not None:
        files.tree(POSTERIOR_AVERAGED, partial(stored_form, results.averaged))
    without = kind_of(results.base.model).without
    frames = {
        name: files.table(name, partial(build, found))
        for name, build in BUILDS.items()
        if name not in without
    }
    if found.has_actuators and deformed:
        geometry = geometry_of_study(study.settings)
        draw = partial(write_deformed, begun=pictures)
        guard.attempt(OptionalStage.DEFORMED, draw, files.folder, results.final, geometry)
    guard.attempt(OptionalStage.PHOTOGRAPHS, write_pictures, files.folder, study)
    files.remove_others()
    films = frames[columns.TENSILE]
    note = (
        "" if films is None else guard.attempt(OptionalStage.HELD_OUT_MODES, held_out_modes, films)
    )
    return verdict_of(results, found.residual(), note or "", guard)


def write_posteriors(
    study: Study, files: Files, results: Results, generator: np.random.Generator
) -> None:
    """Write the draws of both calibrations.

    Parameters
    ----------
    study, files, results, generator
        As of `write_results`, to which the generator goes next.
    """
    kept = EFFORTS[study.settings.sampling.effort].kept
    for name, fit in ((POSTERIOR_BASE, results.base), (POSTERIOR, results.final)):
        files.posterior(name, fit, generator, kept=kept)


def _statistics(found: TableSources) -> pd.DataFrame | None:
    if found.judgement is None:
        return None
    base = found.steps["base"]
    drawn, known = base.misfit.drawn, len(base.simulated)
    if known < residual_statistics.FEWEST:
        why = sentences("findings", "no_statistics", one=Uncalibrated(known, drawn))
        found.guard.note(table_stage(columns.STATISTICS), why)
    table = residual_statistics.statistics_table(base.trial.linear, base.simulated, drawn)
    return residual_statistics.frame(table)


def _loo_pit(found: TableSources) -> pd.DataFrame | None:
    """Return the fit to held-out readings; None if too few could be predicted."""
    judgement = found.judgement
    if judgement is None or not judgement.held_out:
        return None
    held_out = list(judgement.held_out.values())
    observed = judgement.search.base.subject.observed
    known: dict[str, LooPit] = {}
    for name, one in zip(found.steps, (held_out[0], held_out[-1]), strict=False):
        rows = np.all(np.isfinite(one.draws), axis=0)
        fit = gain.loo_pit(one.draws[:, rows], observed[rows])
        if fit.is_available:
            known[name] = fit
    return loo_pit_table(known) if known else None


def loo_pit_table(found: Mapping[str, LooPit]) -> pd.DataFrame:
    """Return the PIT of held-out readings under each model: ``loo_pit.csv``."""
    table = gain.frame(found)
    return table.assign(sentence=table["model"].map({n: worded(one) for n, one in found.items()}))


def _joined(frames: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(frames, ignore_index=True)


def _by_fit(
    make: Callable[[TableSources, Fit, str], pd.DataFrame | None], found: TableSources
) -> pd.DataFrame | None:
    """Return a table of both calibrations; None if there is nothing of either."""
    made = [make(found, fit, label) for label, fit in found.results.fits.items()]
    known = [frame for frame in made if frame is not None]
    return _joined(known) if known else None


def _rupture_table(found: TableSources) -> pd.DataFrame | None:
    """Return the probability of rupture, without pressures beyond tests and forward map."""
    if not found.has_actuators:
        return None
    if "elongation_scatter" not in found.results.final.model.table.names:
        return columns.TABLES[columns.RUPTURE].empty()
    specimens = specimens_tested(found.results.final.model)
    table = _on_grid(found, partial(rupture_table, specimens=specimens), times=HIGHER)
    if table is None:
        return None
    tested = table["pressure_kPa"] <= _largest_pressure(found) + 1e-9
    return table[tested | table["probability"].notna()].reset_index(drop=True)


CRITERIA_DRAWS = 200
CRITERIA_PRESSURES = 4  # number of equal steps up to the largest tested pressure


def _criteria_table(found: TableSources) -> pd.DataFrame | None:
    """Return the probability of rupture by each criterion, with the posterior of the chosen one."""
    fit = found.results.final
    if not fit.model.of_kind(Curvature) or not has_elongation(fit.model.base):
        return None
    pressure = np.linspace(0.0, _largest_pressure(found), CRITERIA_PRESSURES + 1)[1:]
    seed = int(found.generator.integers(2**32))  # the same draws for each
    frames = [
        rupture_table(
            fit.model.with_world(criterion=criterion),
            fit.chain,
            np.random.default_rng(seed),
            degradation=level_grid(fit.model),
            pressure=pressure,
            draws=CRITERIA_DRAWS,
            specimens=specimens_tested(fit.model),
        ).assign(criterion=criterion)
        for criterion in RUPTURE_CRITERIA
    ]
    return _joined(frames)


HIGHER = 4.0
"""Largest pressure for rupture predictions, over the largest that was tested: walls of stiff
material are far from their limit below that."""
STEP = 10.0  # kPa, largest step between pressures of tables
STEPS = 10  # least number of steps to the largest tested pressure


def _largest_pressure(found: TableSources) -> float:
    pressure = found.results.final.model.data_of(Curvature).tests.pressure
    return float(np.max(pressure, initial=0.0))


def pressure_grid(tested: float, *, times: float = 1.0) -> Floats:
    """Return equidistant pressures up to a multiple of the largest tested, which is included [kPa].

    Examples
    --------
    >>> pressure_grid(14.3).tolist()[-4:], pressure_grid(0.0).tolist()
    ([12.0, 13.0, 14.0, 14.3], [0.0])
    """
    if tested <= 0.0:
        return np.zeros(1)
    widest = min(STEP, tested / STEPS)
    round_steps = np.array([1.0, 2.0, 5.0, 10.0]) * 10.0 ** np.floor(np.log10(widest))
    step = round_steps[round_steps <= widest].max()
    even = step * np.arange(np.floor(times * tested / step + 1e-9) + 1.0)
    return np.union1d(np.round(even, 9), [tested])


def _on_grid(
    found: TableSources, predict: Callable[..., pd.DataFrame], *, times: float = 1.0
) -> pd.DataFrame | None:
    """Return predictions for new specimens on a grid of degradation rates and pressures."""
    fit = found.results.final
    if not fit.model.of_kind(Curvature):
        return None
    pressure = pressure_grid(_largest_pressure(found), times=times)
    grid = level_grid(fit.model)
    return predict(fit.model, fit.chain, found.generator, degradation=grid, pressure=pressure)


def _shares_table(found: TableSources) -> pd.DataFrame | None:
    """Return the shares of the variance of predictions."""
    fit = found.results.final
    if not fit.model.of_kind(Curvature):
        return None
    pressure = pressures_of(float(np.max(fit.model.data_of(Curvature).tests.pressure)))
    draw, grid = found.generator, level_grid(fit.model)
    return curvature_shares(fit.model, fit.chain, draw, degradation=grid, pressure=pressure)


def _observations_table(found: TableSources) -> pd.DataFrame | None:
    if not found.has_actuators or not found.readings:
        return None
    fits = found.results.fits
    return _joined([observations(fits[n].model, n, r) for n, r in found.readings.items()])


def _levels_table(found: TableSources) -> pd.DataFrame | None:
    if not found.has_actuators or not found.readings:
        return None
    summary, published = found.study.summary, dict[float, float]()
    if summary is not None:
        rows = summary[summary["quantity"] == "r_squared"]
        known = zip(rows["degradation_pct"], rows["value"], strict=True)
        published = {float(level): float(value) for level, value in known}
    fits = found.results.fits
    return _joined(
        [
            level_table(fits[n].model, r, published).assign(model=n)
            for n, r in found.readings.items()
        ]
    )


def _judged(
    make: Callable[[Judgement], pd.DataFrame | None], found: TableSources
) -> pd.DataFrame | None:
    """Return a table of the judgement; None if nothing was judged."""
    return None if found.judgement is None else make(found.judgement)


def _gain(judgement: Judgement) -> pd.DataFrame | None:
    """Return the scores of held-out specimens."""
    held_out = judgement.held_out
    return gain_table(judgement.search.base.subject, held_out) if held_out else None


def _gain_modes(judgement: Judgement) -> pd.DataFrame | None:
    """Return the scores of held-out modes of tension."""
    subject, held_out = judgement.search.base.subject, judgement.held_out
    return mode_table(subject, held_out) if held_out and subject.holds_out_modes else None


def _gain_levels(judgement: Judgement) -> pd.DataFrame | None:
    """Return the scores of held-out degradation rates."""
    held_out = judgement.levels_out
    return gain_table(judgement.search.base.subject, held_out) if held_out else None


def _null(judgement: Judgement) -> pd.DataFrame:
    null = judgement.misfit.null
    return pd.DataFrame({"statistic": null, "replicate": np.arange(len(null))})


def _absorption(judgement: Judgement) -> pd.DataFrame | None:
    """Return every parameter of the base model and its value from all other information."""
    found = judgement.absorbed
    return None if found is None else columns.TABLES[columns.ABSORPTION].rows(found.displacements)


def _pushes(judgement: Judgement) -> pd.DataFrame | None:
    """Return how each cause would push each judged parameter."""
    absorbed = judgement.absorbed
    if absorbed is None:
        return None
    rows = [
        {
            "parameter": one.parameter,
            "causes": "+".join(push.causes),
            "log_bayes_factor": push.log_bayes_factor,
            "shift_sd": push.shifts[one.parameter],
            "share": push.share(one),
        }
        for one in absorbed.judged
        for push in absorbed.pushes
    ]
    return pd.DataFrame(rows) if rows else None


def _suspects_table(found: TableSources) -> pd.DataFrame | None:
    """Return outlying data of the study, and data that are unlikely by their columns."""
    rows = [
        {
            "file": one.file,
            "specimens": " ".join(one.specimens or ((one.specimen,) if one.specimen else ())),
            "column": one.column or "",
            "value": one.value,
            "oddity": one.oddity,
            "size": one.size,
            "score": one.score,
            "p_value": one.p_value,
            "readings": one.readings,
            "set_aside": int(one.set_aside),
            "why": one.why,
        }
        for one in suspects_of(found.results)
    ]
    return pd.DataFrame(rows) if rows else None


FARTHEST = 600.0  # difference of evidences [nats] beyond which odds overflow


def _sets(judgement: Judgement) -> pd.DataFrame | None:
    """Return the sets of causes that may be right, and the combinations that the data exclude."""
    stated = judgement.stated
    if stated is None or not stated.members:
        return None
    rows = [
        {
            "causes": "+".join(one.causes),
            "stated": word,
            "log_bayes_factor": max(one.log_bayes_factor, -FARTHEST),
            "behind": min(one.behind, FARTHEST),
            "odds": float(np.exp(min(one.behind, FARTHEST))),
            "judged_by": FULL_FIT if one.fitted else SCREENING,
        }
        for word, sets in (("may be right", stated.members), ("excluded", stated.excluded))
        for one in sets
    ]
    return pd.DataFrame(rows)


def _missing_terms(judgement: Judgement) -> pd.DataFrame | None:
    """Return the terms that would remove a misfit, and those that fit as well; None without any."""
    described, rows = judgement.missing, list[dict[str, object]]()
    for step, one in enumerate(() if described is None else described.found.terms, 1):
        taken: dict[str, object] = {
            "status": "taken",
            "size": one.size,
            "q05": one.low,
            "q95": one.high,
            "behind": 0.0,
            "share": one.share,
            "p_value": one.p_value,
            "elpd_diff": np.nan if one.held_out is None else one.held_out,
            "elpd_diff_se": np.nan if one.held_out_se is None else one.held_out_se,
        }
        alike: list[tuple[KnownTerm, dict[str, object]]] = [
            (other.term, {"status": "fits as well", "size": other.size, "behind": other.behind})
            for other in one.alike
        ]
        rows += [
            {
                "step": step,
                "formula": term.formula,
                "columns": ", ".join(term.columns),
                "unit": term.unit,
            }
            | facts
            for term, facts in ((one.term, taken), *alike)
        ]
    return pd.DataFrame(rows) if rows else None


def _misfit_columns(judgement: Judgement) -> pd.DataFrame | None:
    """Return the share of the misfit of every level of every column; None without any."""
    rows = [
        {
            "column": one.column,
            "column_share": one.share_of_misfit,
            "level": level.level,
            "readings": level.readings,
            "share": level.share_of_misfit,
            "kind": one.kind,
            "unit": one.unit,
            "excess": level.excess,
            "excess_pct": level.excess_pct,
        }
        for one in (() if judgement.missing is None else judgement.missing.columns)
        for level in one.levels
    ]
    return pd.DataFrame(rows) if rows else None


def _term_readings(judgement: Judgement) -> pd.DataFrame | None:
    """Return the effect of the terms on each reading, and the residual; None without any.

    As for a smooth discrepancy (`criticism.checks.residuals.misfit_frame`), the residual is from a
    joint fit of terms and parameters.
    """
    described = judgement.missing
    if described is None or not described.found.terms:
        return None
    linear = described.step.trial.linear
    places = linear.subject.places
    change = np.sum([one.change for one in described.found.terms], axis=0)
    left = linear.observed - linear.whiten_columns(change[:, None])[:, 0]
    return pd.DataFrame(
        {
            "kind": places.kind,
            "history": places.history,
            "specimen_id": places.specimen,
            "degradation_pct": places.level,
            "along": places.along,
            "term": change,
            "residual": change + linear.unexplained(left),
        }
    )


def _set_aside_table(found: TableSources) -> pd.DataFrame | None:
    """Return curvatures at the degradation rates of suspects, marking those set aside."""
    assembly = found.results.assembly
    whole = assembly.whole
    aside = [one for one in (*assembly.aside, *assembly.beyond) if one.is_out]
    if whole.actuator is None or not any(one.table == "actuator" for one in aside):
        return None
    table = whole.actuator[whole.actuator["curvature_per_m"].notna()].reset_index(drop=True)
    out = is_set_aside(table, [one for one in aside if one.table == "actuator"])
    member = levels(table["degradation_pct"].to_numpy(np.float64))[1]
    shown = table[["specimen_id", "degradation_pct", "pressure_kPa", "curvature_per_m"]].assign(
        set_aside=out.astype(int)
    )
    return shown[np.isin(member, member[out])]


def _photo_lines_table(found: TableSources) -> pd.DataFrame | None:
    """Return measured and predicted lines on the photographs that the report shows."""
    if not found.study.photographs:
        return None
    fits, readings = found.results.fits, _observations_table(found)
    lines: pd.DataFrame = camera("pictures", PHOTOS_FILE).lines_of(found.study, readings, fits)
    return lines


def write_pictures(folder: RunFolder, study: Study) -> None:
    """Write the crops of photographs that the report shows; remove those of an earlier run."""
    for name in PICTURES:
        folder.remove(name)
    if study.photographs:
        camera("pictures", PHOTOS_FILE).write_pictures(folder, study)


#: Functions that build each table, in the order in which they draw random numbers; None if there is
#: nothing to tell. Those of checks and films are theirs.
BUILDS: Mapping[str, Build] = {
    columns.CONSTANTS: partial(_by_fit, lambda of, fit, label: constants(fit, label, of.generator)),
    columns.PARAMETERS: lambda found: _joined(
        [parameters(fit, label) for label, fit in found.results.sampled.items()]
    ),
    columns.TENSILE: lambda found: (
        None
        if found.study.tensile is None
        else _by_fit(lambda of, fit, label: tensile(of.study, fit, label, of.generator), found)
    ),
    columns.ELONGATION: lambda found: elongation(found.results.final, found.generator),
    columns.MEASURED: lambda found: measured(found.study),
    columns.BANDS: lambda found: _on_grid(found, curvature_bands),
    columns.RUPTURE: _rupture_table,
    columns.OBSERVATIONS: _observations_table,
    columns.LEVELS: _levels_table,
    columns.DECISIONS: lambda found: (
        decisions(found.results.fits, found.generator, found.study) if found.has_actuators else None
    ),
    columns.GAIN: partial(_judged, _gain),
    columns.GAIN_MODES: partial(_judged, _gain_modes),
    columns.GAIN_LEVELS: partial(_judged, _gain_levels),
    columns.STATISTICS: _statistics,
    columns.DISCREPANCY: lambda found: (
        _joined([misfit_frame(s.trial.linear, s.misfit, n) for n, s in found.steps.items()])
        if found.steps
        else None
    ),
    columns.LOO_PIT: _loo_pit,
    columns.MISFIT_NULL: partial(_judged, _null),
    columns.ABSORPTION: partial(_judged, _absorption),
    columns.PUSHES: partial(_judged, _pushes),
    columns.SETS: partial(_judged, _sets),
    columns.FITTED: partial(_by_fit, lambda of, fit, label: fitted(fit, label, of.generator)),
    columns.LIFETIME: lambda found: life(found),  # looked up when it is built
    columns.SHARES: _shares_table,
    columns.CRITERIA: _criteria_table,
    columns.SUSPECTS: _suspects_table,
    columns.SET_ASIDE: _set_aside_table,
    columns.TRACES: lambda found: (
        trace_rows(found.study.photographs) if found.study.photographs else None
    ),
    columns.PHOTO_LINES: _photo_lines_table,
    columns.MISSING_TERMS: partial(_judged, _missing_terms),
    columns.MISFIT_COLUMNS: partial(_judged, _misfit_columns),
    columns.TERM_READINGS: partial(_judged, _term_readings),
}
