"""Which of five material laws predicts held-out films, and how long does it take to say?

    uv run python benchmarks/material_laws.py [--json]

One core. The keys of the document:

studies      of each study with films: table of scores, seconds
seconds_400  of 18 films at six degradation rates with 400 readings each, resampled from those of
             the gelatin study
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.material_laws import NOISE, LawComparison, compare_laws
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reading import read_study
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.tensile import TensileCurves, tensile_curves
from bayesdeg.priors import Distribution

STUDIES = Path(__file__).resolve().parents[1] / "studies"
NAMES = ("treloar", "gelatin_actuator", "marchese_ribbed")
SHOWN = ("law", "parameters", "films", "held_out", "elpd", "elpd_diff", "elpd_diff_se")
ERRORS = ("rmse_MPa", "held_out_rmse_MPa")
MANY = 400


def films_and_priors(name: str) -> tuple[TensileCurves, dict[str, Distribution]]:
    study = read_study(STUDIES / name)
    priors = {p.name: p.law for p in outline(study).base if p.name in NOISE}
    curves = tensile_curves(study, fitted=True)
    assert curves is not None
    return curves, priors


def resampled(curves: TensileCurves) -> TensileCurves:
    """Return the same curves with many readings each."""
    ends = [
        stretch[mask][[0, -1]] for stretch, mask in zip(curves.stretch, curves.mask, strict=True)
    ]
    stretch = np.stack([np.linspace(first, last, MANY) for first, last in ends])
    stress = np.stack([
        np.interp(s, x[m], y[m])
        for s, x, y, m in zip(stretch, curves.stretch, curves.stress, curves.mask, strict=True)
    ])  # fmt: skip
    return replace(
        curves,
        stretch=stretch,
        stress=stress,
        basis=yeoh_basis(stretch, np.array(curves.modes)[:, None]),
        cauchy=np.zeros(stretch.shape, bool),
        mask=np.ones(stretch.shape, bool),
    )


def timed(curves: TensileCurves, priors: dict[str, Distribution]) -> tuple[LawComparison, float]:
    start = time.perf_counter()
    found = compare_laws(curves, priors)
    return found, time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    document: dict[str, Any] = {"studies": {}}
    with threadpool_limits(1):
        timed(*films_and_priors("marchese_ribbed"))  # compiles
        for name in NAMES:
            found, seconds = timed(*films_and_priors(name))
            table = found.table()
            pooled = table.loc[table["degradation_pct"] == "all", [*SHOWN, *ERRORS]]
            document["studies"][name] = {
                "seconds": round(seconds, 2),
                "laws": pooled.replace({np.nan: None}).to_dict("records"),
            }
            if not asked.json:
                print(f"{name}: {seconds:.2f} s\n{pooled.to_string(index=False)}\n")
        curves, priors = films_and_priors("gelatin_actuator")
        document["seconds_400"] = round(timed(resampled(curves), priors)[1], 2)
    print(json.dumps(document, indent=1) if asked.json else f"{MANY} readings a film: "
          f"{document['seconds_400']} s")  # fmt: skip


if __name__ == "__main__":
    main()
