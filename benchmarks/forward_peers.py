"""Times and agreement of a pressure curve here, in felupe and in CalculiX.

All on one mesh and one thread, from the body's arrays to the displacements of twelve loads, with
the linear solver included; runs are interleaved and the fastest of each counts. felupe solves
with pypardiso, as we do, and stops at the same largest displacement of a Newton step; its material
is written by tensors, without automatic differentiation. It starts every load from the state
before, as its jobs do, where we extrapolate; `--exact` keeps us from interpolating between the
steps of the path as well. A constant pressure is condensed in felupe's own solid; a linear one
it solves for together with the displacement. CalculiX solves full eight-node bricks without
paper by its own SPOOLES; its static steps leave the stiffness of the follower pressure out, so
its iterations converge linearly.

    export OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
    uv run --group peers python -m benchmarks.forward_peers --repeats 3
"""

import argparse
import importlib.util
import json
import tempfile
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.body import (
    LINEAR_CONSTANT,
    LINEAR_FULL,
    QUADRATIC,
    QUADRATIC_CONSTANT,
    Element,
)
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh
from bayesdeg.actuator.status import PathEffort, Resolution
from bayesdeg.data.settings import Dimensions
from tests.peers import calculix_actuator
from tests.peers.peer_path import FRESH, LOADS, PeerPath, curvatures, own_path

ELEMENTS = (LINEAR_CONSTANT, QUADRATIC_CONSTANT, QUADRATIC)


@dataclass(frozen=True)
class Comparison:
    """Fastest times [s] of both, and the largest difference of the curvatures."""

    peer: str
    element: str
    bricks: int
    unknowns: int
    ours: float
    theirs: float
    our_factorizations: int
    their_factorizations: int
    largest_difference_per_m: float
    largest_relative_difference: float

    @property
    def ratio(self) -> float:
        """Return how many times faster we are."""
        return self.theirs / self.ours


def against_felupe(
    element: Element, resolution: Resolution, *, repeats: int, effort: PathEffort
) -> Comparison:
    """Time the default actuator with paper."""
    from tests.peers import felupe_actuator  # noqa: PLC0415  needs the group `dev`

    mesh = build_mesh(Geometry(Dimensions()), resolution, element=element)

    def ours() -> PeerPath:
        found: PeerPath = own_path(mesh.body, FRESH, loads=LOADS, effort=effort)
        return found

    def theirs() -> PeerPath:
        found: PeerPath = felupe_actuator.solve(
            mesh.body, FRESH, loads=LOADS, tolerance=effort.tolerance
        )
        return found

    ours()  # compiles, or loads what was compiled
    runs = [(ours(), theirs()) for _ in range(repeats)]
    return _comparison("felupe", mesh, runs)


def against_calculix(resolution: Resolution, *, repeats: int, effort: PathEffort) -> Comparison:
    """Time the default actuator without paper, in full eight-node bricks."""
    mesh = build_mesh(Geometry(Dimensions()), resolution, element=LINEAR_FULL)
    bare = replace(FRESH, paper_group=0.0, bulk_ratio=1e3)

    def ours() -> PeerPath:
        found: PeerPath = own_path(mesh.body, bare, loads=LOADS, effort=effort)
        return found

    def theirs() -> PeerPath:
        with tempfile.TemporaryDirectory() as folder:
            found: PeerPath = calculix_actuator.solve(mesh.body, bare, loads=LOADS, folder=folder)
            return found

    ours()
    runs = [(ours(), theirs()) for _ in range(repeats)]
    return _comparison("CalculiX", mesh, runs)


def _comparison(peer: str, mesh: ActuatorMesh, runs: list[tuple[PeerPath, PeerPath]]) -> Comparison:
    ours, theirs = (min(column, key=lambda path: path.total) for column in zip(*runs, strict=True))
    a, b = (curvatures(mesh, path.displacements) for path in (ours, theirs))
    gap: NDArray[np.float64] = np.abs(a - b)
    return Comparison(
        peer=peer,
        element=mesh.body.element.name,
        bricks=len(mesh.body.elements),
        unknowns=int(np.sum(~mesh.body.fixed)),
        ours=ours.total,
        theirs=theirs.total,
        our_factorizations=ours.iterations,
        their_factorizations=theirs.iterations,
        largest_difference_per_m=float(gap.max()),
        largest_relative_difference=float((gap / np.abs(b)).max()),
    )


def main() -> None:
    """Print one JSON line a comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--resolution", type=float, default=9.0, help="largest brick [mm]")
    parser.add_argument("--exact", action="store_true", help="an equilibrium at every load")
    chosen = parser.parse_args()
    effort = PathEffort(exact=chosen.exact)
    resolution = Resolution(chosen.resolution, chosen.resolution, chosen.resolution)
    elements = ELEMENTS if importlib.util.find_spec("felupe") else ()
    for element in elements:
        _report(against_felupe(element, resolution, repeats=chosen.repeats, effort=effort))
    if calculix_actuator.program():
        _report(against_calculix(resolution, repeats=chosen.repeats, effort=effort))


def _report(result: Comparison) -> None:
    print(json.dumps({**vars(result), "ratio": round(result.ratio, 2)}), flush=True)


if __name__ == "__main__":
    main()
