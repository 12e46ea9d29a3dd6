"""What was published beside what the posterior says, and which statement rests on which data."""

import numpy as np

from bayesdeg.data.study import Study
from bayesdeg.pipeline.calibrate import Fit

Json = dict[str, object]


def comparisons(study: Study, fit: Fit) -> list[Json]:
    """Return published statistics beside the posterior's own, 90 % intervals."""
    if study.summary is None:
        return []
    flat = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    values = fit.model.table.named(flat[:: max(1, len(flat) // 2000)])
    rows: list[Json] = []
    for row in study.summary.to_dict("records"):
        level = np.array([float(row["degradation_pct"])])
        if row["quantity"] == "young_modulus":
            draws = 6.0 * fit.model.constants(values, level)[:, 0, 0]
        elif row["quantity"] == "elongation_at_break" and "elongation_scatter" in values:
            draws = fit.model.elongation(values, level)[:, 0]
        elif row["quantity"] == "volume_ratio" and "volume_ratio" in values:
            draws = values["volume_ratio"]
        else:
            continue
        low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
        unit = str(row["unit"]).replace("–", "")
        rows.append(
            {
                "quantity": row["quantity"],
                "degradation_pct": None if np.isnan(level[0]) else float(level[0]),
                "predicted": f"{middle:.3g} ({low:.3g} to {high:.3g}) {unit}".strip(),
                "published": f"{row['value']:g} ± {row['sd']:g} {unit}".strip(),
                "source": row["source"],
            }
        )
    return rows


def rests_on(study: Study) -> list[Json]:
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
        used = {"young_modulus", "elongation_at_break", "volume_ratio"}
        used |= {"r_squared"} if study.actuator is None else set()
        names = sorted({str(q) for q in study.summary["quantity"] if q in used})
        shown = sorted({str(q) for q in study.summary["quantity"] if q not in used})
        if names:
            statements.append((f"also used as data: {', '.join(names)}", "summary.csv (published)"))
        if shown:
            statements.append((f"shown, not fitted: {', '.join(shown)}", "summary.csv (published)"))
    return [{"statement": statement, "rests_on": basis} for statement, basis in statements]
