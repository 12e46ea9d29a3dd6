"""What else than the peak stretch would say when a wall breaks, of solved actuators.

The emulator carries one measure of the walls' strain, the largest principal stretch that 99 % of
the volume stays below. Here curves as studies ask for them are solved by the finite element model,
and for each criterion the equivalent uniaxial stretch of every quadrature point is worked out; its
own 99 % quantile is held against what the peak stretch says of it with one exponent b for each
criterion, the second stretch of the wall being λ^b. The Weibull strain (1/V ∫ ε^m dV)^(1/m) is held
against the peak strain times a polynomial of what the emulator is asked and answers, fitted on half
of the curves.

    uv run python benchmarks/rupture_measures.py --curves 40 --json

Keys: `biaxiality` the exponent with the smallest mean error, by criterion; `error_pct` and
`of_the_peak_itself_pct` median, 95 % quantile and largest of the error of the equivalent strain,
with that exponent and if the peak stretch is taken for it; `weibull_p95_pct` by degree of the
polynomial and modulus. `--plain` leaves the causes of the curves out. One curve of the coarse mesh
takes 2 to 4 s.
"""

import argparse
import json
import os
import sys
from itertools import combinations_with_replacement
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator import kernels
from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.actuator.outputs import PEAK_SHARE, volume_quantile, weibull_strain
from bayesdeg.data.settings import Dimensions
from bayesdeg.emulator.design import study_like
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    equivalent_uniaxial_stretch,
    largest_cauchy_stress,
    wall_state,
)

Floats = NDArray[np.float64]

MODULI = (5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0)
SEED = 2311
EXPONENTS = np.linspace(-0.5, 1.0, 76)
BASE = ("c2_ratio", "c3_ratio", "paper_group", "paper_thickness")  # of a material without a cause


def measures(actuator: Actuator, curve: Curve) -> list[dict[str, float | list[float]]]:
    """Solve a curve and return its measures of strain, a row for each load with an equilibrium."""
    _, problem = actuator.problem(curve)
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=curve.loads)
    finally:
        factorization.close()
    body, group = problem.system.body, curve.material
    law = Yeoh(1.0, group.c2_ratio, group.c3_ratio)
    rows = []
    for load, point in zip(curve.loads, path.points, strict=False):
        f = np.empty((*body.weights.shape, 3, 3))
        kernels.deformation(point.state.displacement, body.elements, body.gradients, f)
        squares = np.linalg.eigvalsh(np.einsum("eqki,eqkj->eqij", f, f))
        stretches = np.sqrt(squares / np.cbrt(np.prod(squares, axis=-1, keepdims=True)))
        rows.append(_row(stretches, body.weights, law) | {"load": load} | _asked(curve))
    return rows


def _row(stretches: Floats, weights: Floats, law: Yeoh) -> dict[str, float | list[float]]:
    largest = stretches[..., -1]
    stress = largest_cauchy_stress(law, stretches)
    energy = equivalent_uniaxial_stretch(stretches, "strain_energy")
    top = volume_quantile(stress, weights, PEAK_SHARE)
    # a state of that stress: uniaxial, so that its equivalent is found as for any other
    return {
        "peak": volume_quantile(largest, weights, PEAK_SHARE),
        "stress": top,
        "energy": volume_quantile(energy, weights, PEAK_SHARE),
        "weibull": [weibull_strain(largest, weights, m)[0] for m in MODULI],
    }


def _asked(curve: Curve) -> dict[str, float]:
    material = curve.material
    return {"c2": material.c2_ratio, "c3": material.c3_ratio, "paper": material.paper_group}


def _without_causes(curve: Curve) -> Curve:
    kept = {name: getattr(curve.material, name) for name in BASE}
    return Curve(curve.loads, MaterialGroups(**kept))


def criteria_errors(rows: list[dict[str, float]]) -> dict[str, object]:
    """Return the exponent, and the errors of the equivalent strain with it [%]."""
    peak = np.array([r["peak"] for r in rows])
    law = Yeoh(1.0, *(np.array([r[name] for r in rows]) for name in ("c2", "c3")))
    exact = {
        "cauchy_stress": _uniaxial(law, np.array([r["stress"] for r in rows])),
        "strain_energy": np.array([r["energy"] for r in rows]),
    }
    found: dict[str, object] = {"biaxiality": {}, "error_pct": {}, "of_the_peak_itself_pct": {}}
    for name, e in exact.items():
        errors = {
            b: _off(equivalent_uniaxial_stretch(wall_state(peak, b), name, law), e)
            for b in EXPONENTS
        }
        best = min(errors, key=lambda b: np.nanmean(errors[b]))
        found["biaxiality"][name] = float(best)
        found["error_pct"][name] = _quantiles(errors[best])
        found["of_the_peak_itself_pct"][name] = _quantiles(_off(peak, e))
    return found


def _off(stretch: Floats, exact: Floats) -> Floats:
    """Return the error of a strain [%]."""
    return np.abs(100.0 * ((stretch - 1.0) / (exact - 1.0) - 1.0))


def _uniaxial(law: Yeoh, stress: Floats) -> Floats:
    """Return the uniaxial stretch with a Cauchy stress, by bisection."""
    low, high = np.ones_like(stress), np.full_like(stress, 6.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        here = largest_cauchy_stress(law, wall_state(middle, -0.5))
        low, high = np.where(here < stress, middle, low), np.where(here < stress, high, middle)
    return 0.5 * (low + high)


def weibull_errors(rows: list[dict[str, float]], curve: Floats) -> dict[str, dict[str, float]]:
    """Return errors of ln ε_W = ln ε_peak + polynomial, on curves that were not fitted [%]."""
    peak = np.log([r["peak"] - 1.0 for r in rows])
    load, c3, paper = (np.log([r[n] for r in rows]) for n in ("load", "c3", "paper"))
    soft = np.array([r["c2"] / np.sqrt(3.0 * r["c3"]) for r in rows])
    inputs = np.stack([peak, load, c3, paper, soft], axis=1)
    inputs = (inputs - inputs.mean(axis=0)) / inputs.std(axis=0)
    fitted = curve % 2 == 0
    found = {}
    for degree in (0, 1, 2, 3):
        x = _powers(inputs, degree)
        errors = {}
        for k, modulus in enumerate(MODULI):
            y = np.log([r["weibull"][k] for r in rows]) - peak
            w = np.linalg.lstsq(x[fitted], y[fitted], rcond=None)[0]
            errors[f"{modulus:g}"] = float(
                np.quantile(100.0 * np.abs(np.expm1(x[~fitted] @ w - y[~fitted])), 0.95)
            )
        found[f"degree_{degree}"] = errors
    return found


def _powers(inputs: Floats, degree: int) -> Floats:
    count = inputs.shape[1]
    terms = [
        np.prod(inputs[:, list(some)], axis=1)
        for d in range(degree + 1)
        for some in combinations_with_replacement(range(count), d)
    ]
    return np.stack(terms, axis=1)


def _quantiles(errors: Floats) -> dict[str, float]:
    known = errors[np.isfinite(errors)]
    return dict(
        zip(("p50", "p95", "max"), np.quantile(known, [0.5, 0.95, 1.0]).tolist(), strict=True)
    )


def main() -> None:
    """Solve the curves and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--curves", type=int, default=40)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--plain", action="store_true", help="curves without causes")
    parser.add_argument("--keep", help="file for the rows")
    given = parser.parse_args()
    actuator = Actuator(build_mesh(Geometry(Dimensions()), COARSE))
    rows, member = [], []
    for k, curve in enumerate(study_like(given.curves, seed=SEED)):
        found = measures(actuator, _without_causes(curve) if given.plain else curve)
        rows += found
        member += [k] * len(found)
        print(f"{k + 1} of {given.curves} curves", file=sys.stderr, flush=True)
    if given.keep:
        Path(given.keep).write_text(json.dumps({"rows": rows, "curve": member}), encoding="utf-8")
    document = criteria_errors(rows) | {
        "weibull_p95_pct": weibull_errors(rows, np.array(member)),
        "curves": given.curves,
        "readings": len(rows),
    }
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
