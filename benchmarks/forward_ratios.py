"""The same curve in other programs, interleaved with ours, and the cost of gradients."""

import importlib.util
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from forward_case import curve_of, interleaved, largest_deviation_pct, median_ratio, say
from forward_forms import agreement, sample
from forward_meshes import ELEMENTS, named_mesh

from bayesdeg.actuator.body import LINEAR_FULL
from bayesdeg.actuator.curve import Actuator
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import PathEffort

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the peers are among the tests

from tests.peers import calculix_actuator
from tests.peers.peer_path import FRESH, LOADS, PeerPath, curvatures, own_path

EXACT = PathEffort(exact=True)
# what `Actuator.solve_with_gradients` takes by default
TIGHT = PathEffort(tolerance=1e-6, rate_tolerance=1e-7, exact=True)

Ratio = tuple[float | None, dict[str, Any]]


def felupe_ratio(mesh_name: str, element_name: str, *, repeats: int) -> Ratio:
    """Time felupe with pypardiso, from the arrays of a body to twelve equilibria with paper."""
    if importlib.util.find_spec("felupe") is None:
        return None, {"missing": "felupe: uv sync"}
    from tests.peers import felupe_actuator  # noqa: PLC0415  needs the group `dev`

    mesh = named_mesh(mesh_name, ELEMENTS[element_name])

    def ours() -> PeerPath:
        found: PeerPath = own_path(mesh.body, FRESH, loads=LOADS, effort=EXACT)
        return found

    def theirs() -> PeerPath:
        found: PeerPath = felupe_actuator.solve(
            mesh.body, FRESH, loads=LOADS, tolerance=EXACT.tolerance
        )
        return found

    ratio, details = _against("felupe", mesh, ours, theirs, repeats=repeats)
    return ratio, {
        **details,
        "linear_solver": "pypardiso in both",
        "note": "equilibria at all loads in both, one tolerance of the last Newton step; felupe "
        "starts each load from the state before, we extrapolate; its material is by hand-written "
        "tensors, without automatic differentiation; paper as a membrane",
    }


def calculix_ratio(mesh_name: str, *, repeats: int) -> Ratio:
    """Time CalculiX with SPOOLES, full eight-node bricks without paper, K/C1 = 1000."""
    if calculix_actuator.program() is None:
        return None, {"missing": "ccx: apt install calculix-ccx"}
    mesh = named_mesh(mesh_name, LINEAR_FULL)
    bare = replace(FRESH, paper_group=0.0, bulk_ratio=1e3)

    def ours() -> PeerPath:
        found: PeerPath = own_path(mesh.body, bare, loads=LOADS, effort=EXACT)
        return found

    def theirs() -> PeerPath:
        with tempfile.TemporaryDirectory() as folder:
            found: PeerPath = calculix_actuator.solve(mesh.body, bare, loads=LOADS, folder=folder)
            return found

    ratio, details = _against("CalculiX", mesh, ours, theirs, repeats=repeats)
    return ratio, {
        **details,
        "linear_solver": "SPOOLES there, pypardiso here",
        "bulk_ratio": 1e3,
        "note": "C3D8 against LINEAR_FULL, no paper; CalculiX leaves the stiffness of the follower "
        "pressure out of its static tangent and reads and writes files, so its tolerance of 1e-5 "
        "is reached in more iterations",
    }


def _against(
    name: str,
    mesh: ActuatorMesh,
    ours: Callable[[], PeerPath],
    theirs: Callable[[], PeerPath],
    *,
    repeats: int,
) -> Ratio:
    ours()  # compiles, or loads what was compiled
    last: dict[str, list[PeerPath]] = {"bayesdeg": [], name: []}

    def kept(key: str, solve: Callable[[], PeerPath]) -> Callable[[], None]:
        return lambda: last[key].append(solve())

    tasks = {"bayesdeg": kept("bayesdeg", ours), name: kept(name, theirs)}
    interleaved(tasks, repeats=repeats, clock=time.perf_counter)
    totals = {key: [path.total for path in paths] for key, paths in last.items()}
    a, b = (curvatures(mesh, last[key][-1].displacements) for key in ("bayesdeg", name))
    ratio = median_ratio(totals[name], totals["bayesdeg"])
    return ratio, {
        "element": mesh.body.element.name,
        "elements": len(mesh.body.elements),
        "unknowns": int(np.sum(~mesh.body.fixed)),
        "seconds": {key: statistics.median(times) for key, times in totals.items()},
        "ratios": [t / o for o, t in zip(totals["bayesdeg"], totals[name], strict=True)],
        "factorizations": {key: paths[-1].iterations for key, paths in last.items()},
        "seconds_per_factorization": {
            key: statistics.median(path.total / path.iterations for path in paths)
            for key, paths in last.items()
        },
        "largest_difference_pct": largest_deviation_pct(a, b),
        "repeats": repeats,
    }


def assembly_ratio(mesh_name: str, *, repeats: int) -> Ratio:
    """Time the backend of scikit-fem against the kernels for tangent and residual."""
    body = named_mesh(mesh_name).body
    problem, forms, state = sample(body)
    apart = agreement(problem, forms, state)
    ours_at_once = 10  # one takes milliseconds
    tasks = {
        "bayesdeg": lambda: [problem.linearise(state) for _ in range(ours_at_once)],
        "scikit_fem": lambda: forms.linearise(state),
    }
    times = interleaved(tasks, repeats=repeats)
    ours = [t / ours_at_once for t in times["bayesdeg"]]
    return median_ratio(times["scikit_fem"], ours), {
        "element": body.element.name,
        "elements": len(body.elements),
        "degrees_of_freedom": 3 * len(body.nodes),
        "seconds": {
            "bayesdeg": statistics.median(ours),
            "scikit_fem": statistics.median(times["scikit_fem"]),
        },
        "largest_relative_difference": apart,
        "repeats": repeats,
        "note": "backend scikit-fem of actuator/weak_form.py: body, paper and cavity, tensors "
        "evaluated once and blocks by components; both eliminate the pressure",
    }


def gradient_cost(mesh_name: str, *, repeats: int) -> Ratio:
    """Time the derivatives of all outputs by all inputs at twelve loads over the solution."""
    actuator, curve = Actuator(named_mesh(mesh_name)), curve_of("fresh")
    tasks = {
        "fast": lambda: actuator.solve(curve),
        "without": lambda: actuator.solve(curve, effort=TIGHT),
        "with": lambda: actuator.solve_with_gradients(curve, effort=TIGHT),
    }
    times = interleaved(tasks, repeats=repeats)
    pairs = list(zip(times["with"], times["without"], strict=True))
    over_fast = [(a - b) / f for (a, b), f in zip(pairs, times["fast"], strict=True)]
    say(f"  gradients: {len(OUTPUTS)} outputs by {len(INPUTS)} inputs")
    return statistics.median((a - b) / b for a, b in pairs), {
        "mesh": mesh_name,
        "unknowns": len(actuator.system.free),
        "outputs": len(OUTPUTS),
        "inputs": len(INPUTS),
        "loads": len(curve.loads),
        "seconds": {key: statistics.median(values) for key, values in times.items()},
        "over_the_default_solution": statistics.median(over_fast),
        "with_over_default_solution": median_ratio(times["with"], times["fast"]),
        "effort": vars(TIGHT),
        "repeats": repeats,
    }
