"""Fits become the tidy tables of a run folder."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.checks.residuals import CurvatureFit
from bayesdeg.data.moisture import degradation_of_films, moisture_content
from bayesdeg.data.study import Study
from bayesdeg.inference.model import Model
from bayesdeg.observations.means import statistics
from bayesdeg.observations.tensile import (
    TensileCurves,
    film_readings,
    stress_variance,
    tensile_curves,
)
from bayesdeg.pipeline.assemble import level_grid
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.films import CourseFit
from bayesdeg.prediction.predictive import draw_values

Floats = NDArray[np.float64]

FIVE = (0.05, 0.25, 0.5, 0.75, 0.95)


def observations(model: Model, label: str, fit: CurvatureFit) -> pd.DataFrame:
    """Return every reading of curvature beside its posterior prediction."""
    assert model.actuator is not None
    data, mask = model.actuator, model.actuator.mask
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


def tensile(study: Study, fit: Fit, label: str, generator: np.random.Generator) -> pd.DataFrame:
    """Return every reading of stress, fitted or held out, beside its posterior prediction."""
    frames = []
    values = draw_values(fit.model, fit.chain, generator, 400)
    for fitted in (True, False):
        curves = tensile_curves(study, fitted=fitted)
        if curves is not None:
            frames.append(
                _tensile(curves, fit.model, values, generator, label=label, fitted=fitted)
            )
    return pd.concat(frames, ignore_index=True)


def held_out_modes(table: pd.DataFrame) -> str:
    """Say how wrong modes of tension are that were predicted, not fitted; empty if none was."""
    held = table[(table["model"] == "final") & (table["fitted"] == 0)]
    sentences = []
    for mode, rows in held.groupby("mode"):
        error = float(np.sqrt(np.mean((rows["stress_MPa"] - rows["mean_MPa"]) ** 2)))
        inside = np.mean(rows["stress_MPa"].between(rows["q05_MPa"], rows["q95_MPa"]))
        share = 100.0 * error / float(np.abs(rows["stress_MPa"]).max())
        sentences.append(
            f"Predicted without having been fitted, {mode} tension is off by {error:.3g} MPa rms "
            f"({share:.0f} % of its largest stress), with {100 * inside:.0f} % of the readings "
            "inside the 90 % interval."
        )
    return " ".join(sentences)


def _tensile(
    curves: TensileCurves,
    model: Model,
    values: dict[str, Floats],
    generator: np.random.Generator,
    *,
    label: str,
    fitted: bool,
) -> pd.DataFrame:
    median = model.stresses(values, curves)
    stress = median.at_rest
    scatter = np.stack(
        np.broadcast_arrays(values["stiffness_scatter"][:, None], curves.degradation_sd), axis=-1
    )
    deviation = scatter * generator.standard_normal(scatter.shape)
    drawn, _ = film_readings(median, deviation)
    noise = np.sqrt(stress_variance(values, drawn))
    readings = drawn + noise * generator.standard_normal(drawn.shape)
    low, high = np.quantile(readings, [0.05, 0.95], axis=0)
    # the table is in nominal stress, whatever was recorded
    to_nominal = np.where(curves.cauchy, 1.0 / curves.stretch, 1.0)
    mask, shape = curves.mask, curves.mask.shape
    return pd.DataFrame(
        {
            "model": label,
            "specimen_id": np.broadcast_to(np.array(curves.specimens)[:, None], shape)[mask],
            "mode": np.broadcast_to(np.array(curves.modes)[:, None], shape)[mask],
            "degradation_pct": np.broadcast_to(curves.degradation[:, None], shape)[mask],
            "stretch": curves.stretch[mask],
            "stress_MPa": (curves.stress * to_nominal)[mask],
            "fitted": int(fitted),
            "mean_MPa": (stress.mean(axis=0) * to_nominal)[mask],
            "q05_MPa": (low * to_nominal)[mask],
            "q95_MPa": (high * to_nominal)[mask],
        }
    )


def constants(fit: Fit, label: str, generator: np.random.Generator) -> pd.DataFrame:
    """Return quantiles of the Yeoh constants and of Young's modulus against degradation."""
    grid = level_grid(fit.model)
    values = draw_values(fit.model, fit.chain, generator, 2000)
    c1, c2, c3 = np.moveaxis(fit.model.constants(values, grid), -1, 0)
    modulus = fit.model.young_modulus(values, grid)
    named = {"c1": c1, "c2": c2, "c3": c3, "young_modulus": modulus}
    frames = [
        pd.DataFrame(
            {"model": label, "degradation_pct": grid, "constant": name, "unit": "MPa"}
            | _quantiles(draws)
        )
        for name, draws in named.items()
    ]
    return pd.concat(frames, ignore_index=True)


def parameters(fit: Fit | CourseFit, label: str) -> pd.DataFrame:
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
    median = fit.model.elongation(values, grid)
    scatter = values["elongation_scatter"][:, None] * generator.standard_normal(median.shape)
    low, middle, high = np.quantile(median * np.exp(scatter), [0.05, 0.5, 0.95], axis=0)
    band = pd.DataFrame(
        {"kind": "band", "degradation_pct": grid, "value": np.nan}
        | {"q05": low, "q50": middle, "q95": high}
    )
    if fit.model.breaks is None:
        return band
    measured = pd.DataFrame(
        {
            "kind": "measured",
            "degradation_pct": fit.model.breaks.degradation,
            "value": fit.model.breaks.elongation,
        }
    )
    return pd.concat([band, measured.assign(q05=np.nan, q50=np.nan, q95=np.nan)])


def measured(study: Study) -> pd.DataFrame:
    """Return what was reduced from readings or taken from publications, and what it rests on."""
    units = {"young_modulus": "MPa", "elongation_at_break": "%", "volume_ratio": "–"}
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
    names = ["quantity", "degradation_pct", "value", "sd", "unit", "n", "rests_on"]
    return pd.DataFrame(rows, columns=names)


def _moisture(study: Study) -> list[dict[str, object]]:
    assert study.moisture is not None
    table = study.moisture
    content = moisture_content(table["mass_equilibrated_g"], table["mass_dry_g"])
    try:
        films = degradation_of_films(table["time_h"].to_numpy(np.float64), content)
    except ValueError:  # no films at time 0, or no replicates: there is no rate to speak of
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


def _quantiles(draws: Floats) -> dict[str, Floats]:
    values = np.quantile(draws, FIVE, axis=0)
    return {f"q{round(100 * q):02d}": values[i] for i, q in enumerate(FIVE)}
