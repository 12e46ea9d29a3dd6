"""What the emulator says of each criterion of rupture, against solved actuators.

Curves as studies ask for them, which no training saw, are solved on the mesh that the emulator
stands for. For each criterion the strain of uniaxial tension that is as demanding is worked out
from every quadrature point: the 99 % quantile of the largest principal stretch, of the largest
Cauchy stress and of the energy's equivalent stretch, and the Weibull strain (1/V ∫ ε^m dV)^(1/m)
for seven moduli, four of which lie between those that the emulator was trained on. The emulator is
asked for the same, interpolation over the modulus included.

    uv run python benchmarks/rupture_measures.py --curves 40 --json

Keys: `error_pct` by criterion (and modulus): median, 95 % quantile and largest of the error of the
strain, at all loads and `at_half_and_more` of the curve's largest; `weibull_p95_pct` the 95 %
quantile of the latter over all moduli; `within_90` the share of errors inside the 90 % interval
that the emulator states without the error of the mesh; `mesh_pct` what a mesh of 4616 elements
changes (`--fine N` of the curves are solved on it too). `--plain` leaves the causes of the curves
out. A curve takes 5 to 15 s, on the finer mesh half a minute.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from emulator_held_out import inputs_of
from numpy.typing import NDArray
from scipy.stats import norm

from bayesdeg.actuator import kernels
from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import CONVERGED, FINE, build_mesh
from bayesdeg.actuator.outputs import PEAK_SHARE, volume_quantile, weibull_strain
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.settings import Dimensions, RuptureCriterion
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    energy_equivalent_stretch,
    largest_cauchy_stress,
    uniaxial_stretch,
)
from bayesdeg.surrogate import surrogate
from bayesdeg.surrogate.design import study_like
from bayesdeg.surrogate.trained import default_surrogate

Floats = NDArray[np.float64]
Measures = dict[str, Floats]
Asked = tuple[str, RuptureCriterion, float | None]

MODULI = (5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0)
SEED = 2311
BASE = ("c2_ratio", "c3_ratio", "paper_group", "paper_thickness")  # of a material without a cause
POINTWISE: tuple[RuptureCriterion, ...] = ("principal_stretch", "cauchy_stress", "strain_energy")
ASKED: tuple[Asked, ...] = (
    *((name, name, None) for name in POINTWISE),
    *((f"weibull_{m:g}", "weakest_link", m) for m in MODULI),
)


def solved(resolution: Resolution, curves: Sequence[Curve]) -> list[Measures]:
    """Return the measures of curves on a mesh, a value for each load with an equilibrium."""
    actuator, found = Actuator(build_mesh(Geometry(Dimensions()), resolution)), []
    for k, curve in enumerate(curves):
        found.append(_measured(actuator, curve))
        print(f"{k + 1} of {len(curves)} curves", file=sys.stderr, flush=True)
    return found


def _measured(actuator: Actuator, curve: Curve) -> Measures:
    _, problem = actuator.problem(curve)
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=curve.loads)
    finally:
        factorization.close()
    body = problem.system.body
    law = Yeoh(1.0, curve.material.c2_ratio, curve.material.c3_ratio)
    rows = []
    for point in path.points:
        f = np.empty((*body.weights.shape, 3, 3))
        kernels.deformation(point.state.displacement, body.elements, body.gradients, f)
        squares = np.linalg.eigvalsh(np.einsum("eqki,eqkj->eqij", f, f))
        rows.append(_strains(np.sqrt(squares), body.weights, law))
    return {name: np.array([row[name] for row in rows]) for name, *_ in ASKED}


def _strains(stretches: Floats, weights: Floats, law: Yeoh) -> dict[str, float]:
    alone = stretches / np.cbrt(np.prod(stretches, axis=-1, keepdims=True))
    largest = stretches[..., -1]
    stress = volume_quantile(largest_cauchy_stress(law, alone), weights, PEAK_SHARE)
    energy = volume_quantile(energy_equivalent_stretch(alone), weights, PEAK_SHARE)
    pointwise = {
        "principal_stretch": volume_quantile(largest, weights, PEAK_SHARE) - 1.0,
        "cauchy_stress": float(uniaxial_stretch(law, stress)) - 1.0,
        "strain_energy": energy - 1.0,
    }
    return pointwise | {f"weibull_{m:g}": weibull_strain(largest, weights, m)[0] for m in MODULI}


def emulated(curves: Sequence[Curve]) -> tuple[list[Measures], list[Measures]]:
    """Return what the emulator answers, and its standard errors without that of the mesh."""
    surrogate.STRAIN_MESH_ERROR = 0.0
    emulator = default_surrogate().without_mesh_error()
    values, errors = [], []
    for curve in curves:
        inputs = inputs_of(curve, np.array(curve.loads))
        answers = {
            name: emulator(
                replace(
                    inputs,
                    criterion=criterion,
                    weibull_modulus=None if modulus is None else np.array([modulus]),
                )
            )
            for name, criterion, modulus in ASKED
        }
        values.append({name: one.peak_stretch - 1.0 for name, one in answers.items()})
        errors.append({name: one.peak_stretch_sd for name, one in answers.items()})
    return values, errors


def compared(
    name: str, exact: list[Measures], found: list[Measures], errors: list[Measures]
) -> dict[str, Any]:
    """Return errors of one measure over all curves."""
    off, late, scores = [], [], []
    for true, mine, sd in zip(exact, found, errors, strict=True):
        count = len(true[name])
        error = mine[name][:count] / true[name] - 1.0
        known = np.isfinite(error)
        off.append(error[known])
        late.append(error[known & (true[name] >= 0.5 * np.max(true[name], initial=0.0))])
        scores.append((error * true[name] / sd[name][:count])[known])
    within = np.abs(np.concatenate(scores)) < norm.ppf(0.95)
    return {
        **_quantiles(np.concatenate(off)),
        "at_half_and_more": _quantiles(np.concatenate(late)),
        "within_90": float(np.mean(within)),
    }


def _quantiles(errors: Floats) -> dict[str, float]:
    names, places = ("p50", "p95", "max"), [0.5, 0.95, 1.0]
    found = np.quantile(100.0 * np.abs(errors), places)
    return dict(zip(names, found.tolist(), strict=True))


def of_the_mesh(exact: list[Measures], finer: list[Measures]) -> dict[str, dict[str, float]]:
    """Return what the finer mesh changes, mean and root mean square [%]."""
    found = {}
    for name, *_ in ASKED:
        change = np.concatenate(
            [
                100.0 * (b[name][: len(a[name])] / a[name][: len(b[name])] - 1.0)
                for a, b in zip(exact, finer, strict=False)
            ]
        )
        found[name] = {"mean": float(change.mean()), "rms": float(np.sqrt(np.mean(change**2)))}
    return found


def _without_causes(curve: Curve) -> Curve:
    kept = {name: getattr(curve.material, name) for name in BASE}
    return Curve(curve.loads, MaterialGroups(**kept))


def main() -> None:
    """Solve the curves and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--curves", type=int, default=40)
    parser.add_argument("--fine", type=int, default=6)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--plain", action="store_true", help="curves without causes")
    given = parser.parse_args()
    curves = study_like(given.curves, seed=SEED)
    curves = [_without_causes(curve) for curve in curves] if given.plain else curves
    exact = solved(CONVERGED, curves)
    found, errors = emulated(curves)
    measures = {name: compared(name, exact, found, errors) for name, *_ in ASKED}
    weibull = [measures[f"weibull_{m:g}"]["at_half_and_more"] for m in MODULI]
    document = {
        "weibull_p95_pct": max(one["p95"] for one in weibull),
        "error_pct": measures,
        "mesh_pct": of_the_mesh(exact, solved(FINE, curves[: given.fine])) if given.fine else {},
        "curves": given.curves,
        "readings": sum(len(one["principal_stretch"]) for one in exact),
    }
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
