"""The tables of a study as padded arrays: specimens by observations."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.shrinkage import mean_of_replicates, volume_ratio
from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.inference.curves import ActuatorCurves, Breaks, TensileCurves
from bayesdeg.material.hyperelastic import yeoh_basis

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Statistic:
    """A published or replicate mean that is used as one observation.

    The mean of n replicates less the truth, over its standard error, follows Student's law with
    n − 1 degrees of freedom, since the scatter was estimated from the same few replicates.

    Parameters
    ----------
    quantity : {"young_modulus", "elongation_at_break", "volume_ratio"}
        What it is of.
    degradation : float
        D_R at which it holds [%].
    value, se : float
        Mean and its standard error, in the quantity's unit.
    source : str
        Where it stands.
    dof : float
        Degrees of freedom, n − 1; inf if n is not known.
    """

    quantity: str
    degradation: float
    value: float
    se: float
    source: str
    dof: float = float("inf")


def tensile_curves(study: Study, *, fitted: bool) -> TensileCurves | None:
    """Return the tensile curves of the modes that are fitted, or of those that are held out."""
    table = study.tensile
    if table is None:
        return None
    table = table[table["mode"].isin(study.settings.fit_modes) == fitted]
    if table.empty:
        return None
    # by stretch, so that the order of rows does not matter
    table = table.sort_values("stretch", kind="stable")
    order = table.groupby(["specimen_id", "mode"], sort=False)
    groups = sorted(order, key=lambda item: int(item[1].index.min()))
    size = max(len(g) for _, g in groups)
    modes = tuple(str(key[1]) for key, _ in groups)
    stretch = _pad([g["stretch"] for _, g in groups], size, fill=1.0)
    is_cauchy = [(g["stress_measure"] == "cauchy").astype(np.float64) for _, g in groups]
    cauchy = _pad(is_cauchy, size, fill=0.0) > 0.5
    measure = np.where(cauchy, "cauchy", "nominal")
    basis = yeoh_basis(stretch, np.array(modes)[:, None], measure)
    return TensileCurves(
        specimens=tuple(str(key[0]) for key, _ in groups),
        modes=modes,
        degradation=np.array([float(g["degradation_pct"].iloc[0]) for _, g in groups]),
        degradation_sd=np.array([float(g["degradation_sd_pct"].iloc[0]) for _, g in groups]),
        basis=basis,
        stretch=stretch,
        stress=_pad([g["stress_MPa"] for _, g in groups], size, fill=0.0),
        cauchy=cauchy,
        mask=np.arange(size) < np.array([len(g) for _, g in groups])[:, None],
    )


def actuator_curves(study: Study) -> ActuatorCurves | None:
    """Return the actuator's curves, in the order in which they were taken."""
    table = study.actuator
    if table is None:
        return None
    groups = [g for _, g in table.groupby("specimen_id", sort=False)]
    size = max(len(g) for g in groups)
    pressure = _pad([g["pressure_kPa"] for g in groups], size, fill=0.0)
    curvature = _pad([g["curvature_per_m"] for g in groups], size, fill=np.nan)
    mask = np.isfinite(curvature) & (pressure > 0.0)
    angle = _pad([g["bend_angle_deg"] for g in groups], size, fill=np.nan)
    angle_mask = np.isfinite(angle) & mask
    if not mask.any():
        return None
    return ActuatorCurves(
        specimens=tuple(str(g["specimen_id"].iloc[0]) for g in groups),
        degradation=np.array([[float(g["degradation_pct"].iloc[0])] for g in groups]),
        degradation_sd=np.array([[float(g["degradation_sd_pct"].iloc[0])] for g in groups]),
        pressure=pressure,
        curvature=np.where(mask, curvature, 0.0),
        curvature_sd=np.nan_to_num(_pad([g["curvature_sd_per_m"] for g in groups], size, fill=0.0)),
        mask=mask,
        bend_angle=np.where(angle_mask, angle, 0.0),
        angle_mask=angle_mask,
        recorded=np.arange(size) < np.array([len(g) for g in groups])[:, None],
        ruptured=_pad([g["ruptured"] for g in groups], size, fill=0.0) > 0.5,
        cycle=_pad([g["cycle"] for g in groups], size, fill=1.0).astype(np.int64),
        time=_pad([g["time_s"] for g in groups], size, fill=np.nan),
        humidity=_pad([g["humidity_pct"] for g in groups], size, fill=np.nan),
        # rows that are not there are held as those that are
        mount=np.array([[*g["mount"], *[g["mount"].iloc[-1]] * (size - len(g))] for g in groups]),
        branch=np.array([[*g["branch"], *["loading"] * (size - len(g))] for g in groups]),
    )


def breaks(study: Study) -> Breaks | None:
    """Return the elongations at break."""
    table = study.breaks
    if table is None:
        return None
    return Breaks(
        tuple(str(s) for s in table["specimen_id"]),
        table["degradation_pct"].to_numpy(np.float64),
        table["degradation_sd_pct"].to_numpy(np.float64),
        table["elongation_pct"].to_numpy(np.float64),
    )


def statistics(study: Study) -> tuple[Statistic, ...]:
    """Return published means with their standard errors, and α from the films' masses.

    The standard error is sd/√n; without n it is the sd itself.
    """
    found = []
    if study.summary is not None:
        known = ("young_modulus", "elongation_at_break", "volume_ratio")
        rows = study.summary[study.summary["quantity"].isin(known)]
        for row in rows.to_dict("records"):
            count = float(row["n"]) if pd.notna(row["n"]) else 1.0
            dof = count - 1.0 if count > 1.0 else float("inf")
            if pd.notna(row["sd"]):
                level = float(row["degradation_pct"]) if pd.notna(row["degradation_pct"]) else 0.0
                se = float(row["sd"]) / np.sqrt(max(count, 1.0))
                found.append(
                    Statistic(
                        str(row["quantity"]),
                        level,
                        float(row["value"]),
                        se,
                        str(row["source"]),
                        dof,
                    )
                )
    if study.shrinkage is not None and len(study.shrinkage) > 1:
        poured, cured, conditioned = (
            study.shrinkage[f"mass_{name}_g"].to_numpy(np.float64)
            for name in ("poured", "cured", "conditioned")
        )
        mean = mean_of_replicates(volume_ratio(poured, cured, conditioned))
        source = f"shrinkage.csv, {mean.count} films"
        dof = mean.count - 1.0
        found.append(Statistic("volume_ratio", 0.0, mean.value, mean.standard_error, source, dof))
    _refuse_zero_errors(found)
    return tuple(found)


def _refuse_zero_errors(found: list[Statistic]) -> None:
    faults = [
        Fault(
            s.source if s.source.startswith("shrinkage.csv") else "summary.csv",
            f"{s.quantity} at {s.degradation:g} % has a standard error of 0",
            "give the scatter that was observed, or leave sd empty to show the value only",
        )
        for s in found
        if not s.se > 0.0
    ]
    if faults:
        raise StudyError(faults)


def _pad(columns: list["pd.Series[float]"], size: int, *, fill: float) -> Floats:
    out = np.full((len(columns), size), fill)
    for row, column in enumerate(columns):
        out[row, : len(column)] = column.to_numpy(np.float64)
    return out
