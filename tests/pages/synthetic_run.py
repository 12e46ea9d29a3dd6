"""Run folders with made-up content, for the tests of the report."""

import math
from pathlib import Path

import numpy as np
import pandas as pd

from bayesdeg.pages.folder import RunFolder

LEVELS = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0)
PRESSURES = np.arange(20.0, 241.0, 20.0)
PUBLISHED = (0.984, 0.997, 0.982, 0.931, 0.920, 0.861)

CAUSES = {
    "named": ["degraded_skin"],
    "ambiguous": ["erosion", "degradation_misread"],
    "adequate": [],
    "unexplained": [],
    "not_judged": [],
}
EXPLANATIONS = {
    "named": "The base model bends too little at low and too much at high degradation. A skin that "
    "is stiffer than the core accounts for 93 % of the misfit, predicts unseen specimens better "
    "and no other cause comes close.",
    "ambiguous": "The misfit grows with degradation as lost material and a misread degradation "
    "rate both would make it; curvature alone cannot separate them.",
    "adequate": "The residuals look like those of data simulated from the model itself.",
    "unexplained": "The misfit is real, yet the best candidate accounts for a third of it.",
    "not_judged": "Too few simulated data sets had an answer. The misfit cannot be judged.",
}


def true_curvature(pressure, degradation):
    stiffness = 1.0 + 4.5 * (degradation / 25.0) ** 2
    return 0.16 * pressure / stiffness * (1.0 + 0.0012 * pressure)


def candidates(outcome):
    probability = {"named": (0.97, 0.02), "ambiguous": (0.52, 0.45)}.get(outcome, (0.12, 0.08))
    leading = {
        "named": ("degraded_skin", "erosion"),
        "ambiguous": ("erosion", "degradation_misread"),
    }.get(outcome, ("creep", "humidity_drift"))
    effects = (
        {"skin_stiffening": {"mean": 0.8, "sd": 0.1, "q05": 0.63, "q95": 0.97, "unit": "–"}},
        {"wall_loss": {"mean": 14.2, "sd": 3.0, "q05": 9.31, "q95": 19.1, "unit": "%"}},
    )
    tried = [
        {
            "cause": name,
            "probability": probability[place],
            "log_bayes_factor": 41.2 - 35 * place,
            "elpd_diff": 39.5 - 32 * place,
            "elpd_diff_se": 6.1,
            "explained_fraction": (0.93 if outcome == "named" else 0.34) - 0.1 * place,
            "naming_p_value": 0.002 + 0.02 * place,
            "effect": effects[place],
            "mechanism": "the outer layer is stiffer than the mean" if place == 0 else "",
        }
        for place, name in enumerate(leading)
    ]
    others = ("pressure_offset", "pressure_loss", "wall_thickness", "film_mismatch", "gravity")
    tried += [
        {
            "cause": name,
            "probability": 0.0004,
            "log_bayes_factor": -2.0 - place,
            "elpd_diff": -0.4 - place,
            "elpd_diff_se": 1.2,
            "explained_fraction": 0.02,
            "effect": {"size": {"mean": 0.1, "sd": 0.2, "q05": -0.2, "q95": 0.4, "unit": "kPa"}},
        }
        for place, name in enumerate(others)
    ]
    return [*tried, *unjudged()]


def unjudged():
    return [
        {
            "cause": "mullins",
            "probability": None,
            "log_bayes_factor": None,
            "elpd_diff": None,
            "elpd_diff_se": None,
            "explained_fraction": None,
            "effect": {},
            "why": "needs the column cycle of actuator.csv",
        },
        {"cause": "humidity_drift", "probability": None, "why": "needs humidity_pct"},
    ]


def verdict(outcome):
    good = outcome == "adequate"
    return {
        "outcome": outcome,
        "causes": CAUSES[outcome],
        "explanation": EXPLANATIONS[outcome],
        "candidates": candidates(outcome),
        "confusable": [["wall_thickness", "film_mismatch"], ["erosion", "degradation_misread"]],
        "false_name_rate": 0.05,
        "predicted_with": CAUSES[outcome][:1],
        "misfit": {
            "rms_per_m": 0.61 if good else 2.13,
            "noise_per_m": 0.63,
            "p_value": 0.42 if good else 0.0004,
            "where": ""
            if good
            else "The simulation overestimates curvature above 160 kPa at 15–25 % degradation, in "
            "all specimens alike; below 10 % it is within the noise.",
        },
        "next_experiments": []
        if good
        else [
            {
                "design": f"{what}, three specimens at 15 and 25 % degradation",
                "separates": ["erosion", "degradation_misread"],
                "expected_log_bayes_factor": 6.3 - place,
            }
            for place, what in enumerate(
                ("Measure wall thickness", "Record the bend angle", "Blocked force", "Unloading")
            )
        ],
    }


def unjudged_verdict():
    return {
        "outcome": "not_judged",
        "causes": [],
        "explanation": "There is no actuator data, so the simulation was not judged.",
        "candidates": unjudged(),
        "confusable": [],
        "false_name_rate": None,
        "misfit": {"rms_per_m": None, "noise_per_m": None, "p_value": None, "where": ""},
        "next_experiments": [],
    }


def run(*, virtual):
    return {
        "title": "Gelatin bending actuator in soil",
        "study": "virtual_skin" if virtual else "nagai2021",
        "created": "2026-11-21 10:31",
        "virtual": virtual,
        "note": "Hidden in it: a stiff skin." if virtual else "",
        "seed": 20211124,
        "effort": "standard",
        "version": "0.1.0",
        "versions": {"python": "3.12.4", "numpy": "2.5.5", "emcee": "3.1.6"},
        "hashes": {"actuator.csv": "9f2c" * 16, "tensile.csv": "1ab7" * 16},
        "seconds": {"calibrate": 512.4, "criticise": 4013.0, "predict": 12.1},
        "counts": {"evaluations": 1204311, "outside_training": 37, "failed": 0},
        "missing": [
            {"what": "unloading branches", "cost": "creep and Mullins softening cannot be judged"},
            {"what": "bend angle", "cost": "wrong scale and wrong fibre look alike"},
        ],
        "rests_on": [
            {"statement": "Yeoh constants", "rests_on": "tensile.csv, 18 curves"},
            {"statement": "volume ratio", "rests_on": "published summary, N = 4"},
        ],
        "convergence": {
            "base": {"r_hat_max": 1.004, "ess_min": 1830.0, "sentence": "The chains agree."},
            "final": {"r_hat_max": 1.006, "ess_min": 1211.0, "sentence": "The chains agree."},
        },
        "emulator": {"error_pct": 0.8, "record": "emulator-2f9a"},
        "misfit": {"observed": 31.7, "name": "chi-squared per reading"},
        "checks": {
            "leave_one_out": "Each of 36 specimens was left out in turn: log density 329.9 ± 10.",
            "prior_sensitivity": "Paper stiffness hangs on the prior of paper_stiffness.",
            "prior_predictive": "98 % of the readings lie inside the priors' 90 % interval.",
        },
        "comparisons": [
            {
                "quantity": "r_squared",
                "degradation_pct": 25.0,
                "predicted": 0.8812,
                "published": 0.861,
                "source": "Nagai et al. 2021, Figure 8",
            },
        ],
    }


def observations(generator, *, final):
    rows = []
    for level in LEVELS:
        for specimen in range(3):
            own = max(level + 0.7 * generator.standard_normal(), 0.0)
            noise = 0.6 * generator.standard_normal(PRESSURES.size)
            measured = true_curvature(PRESSURES, own) + noise
            for model in ("base", "final") if final else ("base",):
                bias = 1.0 + (0.012 * level if model == "base" and final else 0.0)
                mean = bias * true_curvature(PRESSURES, own)
                rows.append(
                    pd.DataFrame(
                        {
                            "model": model,
                            "specimen_id": f"A{level:.0f}-{specimen}",
                            "degradation_pct": own,
                            "pressure_kPa": PRESSURES,
                            "branch": "loading",
                            "cycle": 1,
                            "curvature_per_m": measured,
                            "mean_per_m": mean,
                            "q05_per_m": mean - 1.0,
                            "q95_per_m": mean + 1.0,
                            "residual_per_m": measured - mean,
                        }
                    )
                )
    return pd.concat(rows)


def bands():
    quantiles = {"q05": -1.64, "q25": -0.67, "q50": 0.0, "q75": 0.67, "q95": 1.64}
    return pd.concat(
        pd.DataFrame(
            {"degradation_pct": level, "pressure_kPa": PRESSURES}
            | {
                name: true_curvature(PRESSURES, level) * (1 + 0.05 * z)
                for name, z in quantiles.items()
            }
        )
        for level in LEVELS
    )


def gain(outcome):
    models = {"named": ["base+degraded_skin", "base+erosion"], "ambiguous": ["base+erosion"]}
    rows = []
    for place, model in enumerate(["base", *models.get(outcome, [])]):
        for level in ("all", *LEVELS):
            better = 0.0 if place == 0 else 39.5 - 20 * (place - 1)
            grown = 0.9 + 0.06 * (25.0 if level == "all" else level)
            rows.append(
                {
                    "model": model,
                    "degradation_pct": level,
                    "elpd": -215.6 + better,
                    "elpd_se": 11.2,
                    "elpd_diff": better,
                    "elpd_diff_se": 0.0 if place == 0 else 6.1,
                    "rmse_per_m": grown if place == 0 else 0.71 + 0.35 * (place - 1),
                    "crps_per_m": 1.2 if place == 0 else 0.4,
                    "r_squared": 0.93 if place == 0 else 0.991,
                    "coverage_50": 0.31 if place == 0 else 0.52,
                    "coverage_90": 0.62 if place == 0 else 0.89,
                }
            )
    return pd.DataFrame(rows)


def levels(*, final):
    rows = []
    for model in ("base", "final") if final else ("base",):
        for level, published in zip(("all", *LEVELS), (math.nan, *PUBLISHED), strict=True):
            rows.append(
                {
                    "model": model,
                    "degradation_pct": level,
                    "n": 216 if level == "all" else 36,
                    "r_squared": 0.947 if model == "base" else 0.9931,
                    "rms_per_m": 2.13 if model == "base" else 0.655,
                    "published_r_squared": published,
                }
            )
    return pd.DataFrame(rows)


def rupture():
    return pd.concat(
        pd.DataFrame(
            {
                "degradation_pct": level,
                "pressure_kPa": PRESSURES,
                "probability": (middle := 1 / (1 + np.exp(-(PRESSURES - 420 + 9 * level) / 22))),
                "probability_q05": middle**1.5,
                "probability_q95": middle**0.6,
            }
        )
        for level in LEVELS
    )


def elongation():
    rates = np.linspace(0, 25, 26)
    middle = 210 * np.exp(-rates / 18)
    limit = {"kind": "band", "degradation_pct": rates, "value": math.nan}
    limit |= {"q05": 0.85 * middle, "q50": middle, "q95": 1.17 * middle}
    measured = {"kind": "measured", "degradation_pct": [0.0, 0.0, 12.0, 25.0]}
    measured |= {"value": [209.8, 216.0, 101.0, 52.0], "q05": math.nan}
    measured |= {"q50": math.nan, "q95": math.nan}
    return pd.concat([pd.DataFrame(limit), pd.DataFrame(measured)])


def constants(*, final):
    rates = np.linspace(0, 25, 11)
    at_zero = {"c1": 0.288, "c2": -0.004, "c3": 0.0006, "young_modulus": 1.73}
    rows = []
    for model in ("base", "final") if final else ("base",):
        for name, start in at_zero.items():
            middle = start * (1 + 4.5 * (rates / 25) ** 2) * (1.0 if model == "base" else 1.08)
            spread = 0.06 * np.abs(middle)
            rows.append(
                pd.DataFrame(
                    {
                        "model": model,
                        "degradation_pct": rates,
                        "constant": name,
                        "unit": "MPa",
                        "q05": middle - 1.64 * spread,
                        "q25": middle - 0.67 * spread,
                        "q50": middle,
                        "q75": middle + 0.67 * spread,
                        "q95": middle + 1.64 * spread,
                    }
                )
            )
    return pd.concat(rows)


def parameters():
    rows = [
        ("volume_ratio", "–", "volume after over before drying", 0.655, 0.021, 0.62, 0.07),
        ("c1_at_zero", "MPa", "first constant at no degradation", 0.291, 0.012, 0.29, 0.1),
        ("degraded_skin.skin_stiffening", "–", "surface over mean, less 1", 0.8, 0.1, 0.3, 0.4),
    ]
    return pd.DataFrame(
        [
            {
                "model": "final",
                "parameter": name,
                "unit": unit,
                "meaning": meaning,
                "mean": mean,
                "sd": sd,
                "q05": mean - 1.64 * sd,
                "q50": mean,
                "q95": mean + 1.64 * sd,
                "prior_q05": prior - 1.64 * prior_sd,
                "prior_q50": prior,
                "prior_q95": prior + 1.64 * prior_sd,
                "r_hat": 1.0031,
                "ess_bulk": 2104.0,
                "ess_tail": 1893.0,
            }
            for name, unit, meaning, mean, sd, prior, prior_sd in rows
        ]
    )


def tensile(generator):
    rows = []
    kinds = [("uniaxial", level, 1) for level in LEVELS] + [("equibiaxial", 0.0, 0)]
    for mode, level, fitted in kinds:
        stretch = np.linspace(1.05, 3.1 - 0.06 * level, 14)
        c1 = 0.288 * (1 + 4.5 * (level / 25) ** 2)
        mean = 2 * c1 * (stretch - stretch**-2.0) * (1.0 if fitted else 1.55)
        stress = mean * (1 + 0.03 * generator.standard_normal(14)) * (1.0 if fitted else 0.72)
        for model in ("base", "final"):
            rows.append(
                pd.DataFrame(
                    {
                        "model": model,
                        "specimen_id": f"F-{mode[0]}{level:.0f}",
                        "mode": mode,
                        "degradation_pct": level,
                        "stretch": stretch,
                        "stress_MPa": stress,
                        "fitted": fitted,
                        "mean_MPa": mean * (1.0 if model == "base" else 0.97),
                        "q05_MPa": 0.93 * mean,
                        "q95_MPa": 1.07 * mean,
                    }
                )
            )
    return pd.concat(rows)


def measured():
    columns = ("quantity", "degradation_pct", "value", "sd", "unit", "n", "rests_on")
    rows = [
        ("young_modulus", 0.0, 1.73, 0.15, "MPa", 3, "tensile.csv"),
        ("young_modulus", 25.0, 9.5, 0.9, "MPa", 3, "tensile.csv"),
        ("volume_ratio", math.nan, 0.62, 0.07, "–", 4, "summary.csv"),
    ]
    return pd.DataFrame(rows, columns=list(columns))


def leave_one_out():
    names = [f"F{level:02.0f}-{k}" for level in LEVELS for k in (1, 2, 3)]
    names += [f"A{level:02.0f}-{k}" for level in LEVELS for k in (1, 2, 3)]
    shape = np.linspace(-0.05, 0.84, len(names))
    return pd.DataFrame(
        {
            "specimen_id": names,
            "kind": ["tensile, breaks"] * 18 + ["actuator, rupture"] * 18,
            "elpd": np.linspace(32.4, -22.0, len(names)),
            "elpd_error": 0.03,
            "influence": np.linspace(0.05, 1.9, len(names)),
            "pareto_k": shape,
            "refitted": (shape > 0.7).astype(int),
        }
    )


def prior_sensitivity():
    rows = [
        ("C1 at 0 %", "conclusion", 0.013, 0.133, 0.0, "data", "", "actuator"),
        ("volume ratio", "conclusion", 0.064, 0.148, 0.16, "prior and data", "paper_stiffness", ""),
        ("paper stiffness", "conclusion", 0.346, 0.041, -0.69, "prior", "paper_stiffness", ""),
        ("paper_stiffness", "parameter", 0.346, 0.041, -0.69, "prior", "paper_stiffness", ""),
    ]
    names = ["quantity", "kind", "prior", "likelihood", "shift_sd", "diagnosis", "hangs_on"]
    return pd.DataFrame(rows, columns=[*names, "rests_on"]).assign(
        prior_noise=0.01, likelihood_noise=0.01
    )


def prior_predictive():
    width = {"q05": 0.4, "q25": 0.7, "q50": 1.0, "q75": 1.4, "q95": 2.6}
    frames = []
    for level in LEVELS:
        middle = true_curvature(PRESSURES, level)
        curves = {"quantity": "curvature", "mode": "", "degradation_pct": level, "unit": "1/m"}
        curves |= {"pressure_kPa": PRESSURES, "stretch": math.nan, "answered": 0.93}
        frames.append(pd.DataFrame(curves | {q: f * middle for q, f in width.items()}))
        stretch = np.linspace(1.0, 3.0 - 0.06 * level, 12)
        stress = 0.6 * (1 + 4.5 * (level / 25) ** 2) * (stretch - stretch**-2)
        curves = {"quantity": "nominal_stress", "mode": "uniaxial", "degradation_pct": level}
        curves |= {"unit": "MPa", "pressure_kPa": math.nan, "stretch": stretch, "answered": 1.0}
        frames.append(pd.DataFrame(curves | {q: f * stress for q, f in width.items()}))
    return pd.concat(frames)


def write_full(path: Path, outcome: str, *, virtual: bool = False) -> RunFolder:
    """Write a run folder with everything in it."""
    folder, generator = RunFolder(path), np.random.default_rng(7)
    final = outcome == "named"
    null = generator.gamma(9.0, 1.0, 200)
    tables = {
        "gain": gain(outcome),
        "bands": bands(),
        "rupture": rupture(),
        "observations": observations(generator, final=final),
        "tensile": tensile(generator),
        "constants": constants(final=final),
        "parameters": parameters(),
        "levels": levels(final=final),
        "elongation": elongation(),
        "measured": measured(),
        "misfit_null": pd.DataFrame({"replicate": np.arange(200), "statistic": null}),
        "leave_one_out": leave_one_out(),
        "prior_sensitivity": prior_sensitivity(),
        "prior_predictive": prior_predictive(),
    }
    for name, frame in tables.items():
        folder.write_table(name, frame)
    folder.write_json("verdict", verdict(outcome))
    folder.write_json("run", run(virtual=virtual))
    return folder


def write_bare(path: Path, *, virtual: bool = False) -> RunFolder:
    """Write a run folder of a study without actuator data, with an empty table among the rest."""
    folder = RunFolder(path)
    folder.write_table("bands", bands().iloc[:0])
    folder.write_json("verdict", unjudged_verdict())
    folder.write_json("run", {"title": "Films only", "virtual": virtual})
    return folder
