"""Speed and accuracy of one pressure curve, compared with other programs.

One core; every ratio is a median over runs in turn, of processor time except against peers;
`seconds_per_curve` and the profile are by the clock on the wall. The keys of the document:

seconds_per_curve   twelve pressures on the converged mesh, the mesh at hand
error_pct           that mesh's largest deviation of the curvature from Richardson's estimate
felupe_ratio        felupe's time over ours, same mesh, element, tolerance and linear solver
calculix_ratio      CalculiX's time over ours, same mesh and order of the element
assembly_ratio      time of the backend scikit-fem over that of the kernels, one linearisation
gradient_cost       time of all derivatives over that of the solution
scaling             time against degrees of freedom, and the exponent
peak_memory_mb      of a process that meshes and solves one such curve
details             circumstances of each, a profile, other ways along the path, other solvers

    uv run --group peers python benchmarks/forward.py --json

It takes about an hour; `--quick` some minutes on small meshes. `--reference` first
solves the families of meshes behind the estimate, as far as benchmarks/converged_curvature.json
lacks them, which takes about as long (see converged_curvature.py; delete the file to begin anew).
"""

import os
from typing import Any

# before the libraries read them
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"
os.environ["NUMBA_NUM_THREADS"] = "1"

import argparse
import json
import platform
import statistics
import time
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import forward_memory
import forward_ratios
import numpy as np
from converged_curvature import GRADING, SINGULAR_ORDER, STORE, estimates, extend, read_members
from forward_case import (
    PRESSURES,
    curvature_of,
    curve_of,
    interleaved,
    largest_deviation_pct,
    say,
)
from forward_meshes import LADDER, RESOLUTIONS, SHORT_LADDER, named_mesh
from forward_profile import WAYS, deviations_pct, profile

from bayesdeg.actuator.curve import Actuator

PACKAGES = ("numpy", "scipy", "numba", "scikit-fem", "pypardiso", "felupe", "mkl")


@dataclass(frozen=True)
class Plan:
    """What is timed on which mesh, and how often."""

    mesh: str
    ladder: tuple[str, ...]
    peer_mesh: str
    assembly_mesh: str
    solver_mesh: str
    felupe_elements: tuple[str, ...]
    repeats: int


FULL = Plan("converged", LADDER, "coarse", "coarse", "middle", ("Q2P1disc", "Q1P0"), 5)
QUICK = Plan("plain", SHORT_LADDER, "coarsest", "coarsest", "coarsest", ("Q2P1disc",), 2)


def machine() -> dict[str, Any]:
    """Return what ran where."""
    packages: dict[str, str | None] = {}
    for name in PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = None
    model = platform.processor()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((x.split(":")[1].strip() for x in lines if x.startswith("model name")), model)
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "threads_used": 1,
        "load_average_at_start": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "platform": platform.platform(),
        "python": platform.python_version(),
        "packages": packages,
        "date": time.strftime("%Y-%m-%d"),
    }


def seconds_per_curve(plan: Plan) -> tuple[float, dict[str, Any]]:
    mesh = named_mesh(plan.mesh)
    actuator = Actuator(mesh)
    actuator.solve(curve_of("degraded"))  # numbering and symbolic analysis, once a geometry
    processor: list[float] = []
    solutions = []

    def task() -> None:
        start = time.process_time()
        solutions.append(actuator.solve(curve_of("fresh")))
        processor.append(time.process_time() - start)

    times = interleaved({"curve": task}, repeats=plan.repeats, clock=time.perf_counter)["curve"]
    body = mesh.body
    return statistics.median(times), {
        "mesh": plan.mesh,
        "resolution": asdict(RESOLUTIONS[plan.mesh]),
        "element": body.element.name,
        "elements": len(body.elements),
        "unknowns": int(np.sum(~body.fixed)),
        "pressures_kPa": PRESSURES.tolist(),
        "solver": solutions[-1].solver,
        "factorizations": solutions[-1].iterations,
        "runs": times,
        "processor_seconds": statistics.median(processor),
        "curvature_per_m": curvature_of(solutions[-1]).tolist(),
    }


def error_pct(plan: Plan) -> tuple[float | None, dict[str, Any]]:
    """Compare both curves with the limit of a family of meshes."""
    members = read_members()
    found, even = estimates(members), estimates(members, grading=0.0)
    if not found:
        return None, {
            "missing": f"three meshes in {STORE.name}: run benchmarks/forward.py --reference"
        }
    actuator = Actuator(named_mesh(plan.mesh))
    details: dict[str, Any] = {"singular_order": SINGULAR_ORDER}
    largest = []
    for name, estimate in found.items():
        values = curvature_of(actuator.solve(curve_of(name)))
        largest.append(largest_deviation_pct(values, estimate.limit))
        details[name] = {
            "curvature_per_m": values.tolist(),
            "estimate_per_m": estimate.limit.tolist(),
            "observed_order": estimate.order.tolist(),
            "error_pct": (100.0 * (values / estimate.limit - 1.0)).tolist(),
            "largest_error_pct": largest[-1],
            "largest_error_against_singular_limit_pct": largest_deviation_pct(
                values, estimate.singular_limit
            ),
            "pieces": list(estimate.pieces),
        }
        if even:
            apart = largest_deviation_pct(even[name].limit, estimate.limit)
            details[f"{name}_limit_of_even_meshes_apart_pct"] = apart
    return max(largest), details


def scaling(plan: Plan) -> tuple[dict[str, Any], dict[str, Any]]:
    meshes = {name: named_mesh(name) for name in plan.ladder}
    curve = curve_of("fresh")
    solutions = {}

    def task(name: str) -> None:
        solutions[name] = Actuator(meshes[name]).solve(curve)

    tasks = {name: (lambda name=name: task(name)) for name in meshes}
    times = interleaved(tasks, repeats=min(plan.repeats, 3))
    unknowns = [int(np.sum(~mesh.body.fixed)) for mesh in meshes.values()]
    seconds = [statistics.median(times[name]) for name in meshes]
    exponent, _ = np.polyfit(np.log(unknowns), np.log(seconds), 1)
    points = [{"unknowns": n, "seconds": s} for n, s in zip(unknowns, seconds, strict=True)]
    return {"exponent": float(exponent), "points": points}, {
        "meshes": list(meshes),
        "runs": times,
        "factorizations": {name: solution.iterations for name, solution in solutions.items()},
        "seconds_per_factorization_exponent": float(
            np.polyfit(
                np.log(unknowns),
                np.log([t / solutions[n].iterations for t, n in zip(seconds, meshes, strict=True)]),
                1,
            )[0]
        ),
    }


def ways(plan: Plan) -> dict[str, Any]:
    """Time plain Newton, predictor with every load, and the adaptive path."""
    mesh = named_mesh(plan.mesh)
    tasks = {name: (lambda way=way: way(mesh)) for name, way in WAYS.items()}
    times = interleaved(tasks, repeats=min(plan.repeats, 3))
    apart = deviations_pct(mesh)
    return {name: {"seconds": statistics.median(times[name]), **apart[name]} for name in WAYS} | {
        "mesh": plan.mesh
    }


def solvers(plan: Plan) -> dict[str, Any]:
    """Time SuperLU against PARDISO on one curve."""
    mesh, curve, names = named_mesh(plan.solver_mesh), curve_of("fresh"), ("pypardiso", "splu")
    if Actuator(mesh).solve(curve).solver != "pypardiso":
        return {"missing": "pypardiso"}
    tasks = {name: (lambda name=name: Actuator(mesh, solver=name).solve(curve)) for name in names}
    times = interleaved(tasks, repeats=min(plan.repeats, 3))
    seconds = {name: statistics.median(times[name]) for name in names}
    ratio = seconds["splu"] / seconds["pypardiso"]
    return {"mesh": plan.solver_mesh, "seconds": seconds, "ratio": ratio}


def measured(plan: Plan, *, peers: bool) -> dict[str, Any]:
    """Measure everything."""
    document: dict[str, Any] = {}
    details: dict[str, Any] = {"machine": machine(), "plan": asdict(plan)}

    def note(key: str, result: tuple[object, dict[str, Any]]) -> None:
        document[key], details[key] = result
        say(f"{key}: {document[key]}")

    say("memory of one curve")  # first: a child's peak begins with its parent's
    forward_memory.measured("coarsest")  # compiles in a process that is not counted
    stages = forward_memory.measured(plan.mesh)
    note("peak_memory_mb", (stages["solved"], {"mesh": plan.mesh, "peak_after_mb": stages}))
    Actuator(named_mesh("coarsest")).solve_with_gradients(curve_of("fresh"))  # compiles
    say("one curve")
    note("seconds_per_curve", seconds_per_curve(plan))
    note("error_pct", error_pct(plan))
    details["profile"] = profile(named_mesh(plan.mesh), curve_of("fresh"))
    say("ways along the path")
    details["ways"] = ways(plan)
    say("direct solvers")
    details["solvers"] = solvers(plan)
    say("gradients")
    gradients = forward_ratios.gradient_cost(plan.mesh, repeats=min(plan.repeats, 3))
    note("gradient_cost", gradients)
    say("scaling")
    note("scaling", scaling(plan))
    say("assembly")
    assembly = forward_ratios.assembly_ratio(plan.assembly_mesh, repeats=max(1, plan.repeats - 2))
    note("assembly_ratio", assembly)
    if peers:
        _measure_peers(plan, document, details)
    return document | {"details": details}


def _measure_peers(plan: Plan, document: dict[str, Any], details: dict[str, Any]) -> None:
    say("felupe")
    repeats = min(plan.repeats, 3)
    by_element = {
        name: forward_ratios.felupe_ratio(plan.peer_mesh, name, repeats=repeats)
        for name in plan.felupe_elements
    }
    document["felupe_ratio"] = by_element[plan.felupe_elements[0]][0]
    details["felupe_ratio"] = {
        name: {"ratio": ratio, **facts} for name, (ratio, facts) in by_element.items()
    }
    say("CalculiX")
    ratio, facts = forward_ratios.calculix_ratio(plan.peer_mesh, repeats=plan.repeats)
    document["calculix_ratio"], details["calculix_ratio"] = ratio, facts


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--quick", action="store_true", help="small meshes, two repeats")
    parser.add_argument("--skip-peers", action="store_true", help="neither felupe nor CalculiX")
    parser.add_argument(
        "--reference", action="store_true", help="solve the families of meshes first"
    )
    parser.add_argument(
        "--pieces", type=int, nargs="+", default=[2, 3, 4], help="its meshes, with --reference"
    )
    options = parser.parse_args()
    if options.reference:
        extend(options.pieces, gradings=(GRADING, 0.0))
    document = measured(QUICK if options.quick else FULL, peers=not options.skip_peers)
    if options.json:
        print(json.dumps(document, indent=1))
        return
    for key, value in document.items():
        if key != "details":
            print(f"{key:18} {value}")


if __name__ == "__main__":
    main()
