"""Mesh errors of local training for straight channels and layers, against finer meshes.

    uv run python benchmarks/channel_meshes.py --json

``error_pct`` is the rms over pressures and actuators of the relative deviation of curvature on the
fine mesh of ``local_recipe`` from an extrapolation to vanishing elements by ever finer meshes, as
h^p with the observed p. ``MESH_ERROR`` of `bayesdeg.surrogate.kept` rests on it.
"""

import argparse
import json
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bayesdeg.actuator.curve import Actuator, Curve, with_layer
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint, CylindricalDimensions
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.kept import local_recipe

Floats = NDArray[np.float64]
SILICONE = MaterialGroups(-0.014, 0.004, 300.0, paper_thickness=0.1)
FILM, NONE = Constraint("film"), Constraint("none")
SLAB = Constraint("elastomer", thickness=1.5, c1=300.0)
BLOCK = CylindricalDimensions(
    length=60.0,
    width=14.0,
    height=12.0,
    channels=2,
    channel_length=50.0,
    channel_width=3.0,
    channel_height=3.0,
    pitch=6.0,
    offset=8.0,
    passive="none",
)
CASES: dict[str, tuple[Moulded, float, tuple[float, ...], tuple[float, ...]]] = {
    # actuator, group of its layer, loads p/C1, refinements of the mesh that is judged
    "block": (geometry_of(BLOCK, NONE), 300.0, (0.3, 0.6, 0.9, 1.2), (1.5, 1.0, 0.75)),
    "default": (geometry_of(CylindricalDimensions(), FILM), 300.0, (0.6, 1.2, 1.8, 2.4),
                (1.5, 1.0, 0.75)),
    "layer": (geometry_of(Dimensions(), SLAB), 10.0, (0.2, 0.4, 0.6), (1.5, 1.0, 0.75)),
}  # fmt: skip


def curvatures(
    geometry: Moulded, group: float, loads: tuple[float, ...], mesh: Resolution
) -> tuple[Floats, int, float]:
    """Return curvatures times the length, elements and seconds."""
    of = Actuator(build_mesh(geometry, mesh))
    material = MaterialGroups(**vars(SILICONE) | {"paper_group": group})
    begun = time.perf_counter()
    solution = of.solve(with_layer(geometry, Curve(loads, material)))
    of.close()
    found = geometry.dimensions.length * solution.bend_angle / solution.arc_length
    return found, len(of.mesh.body.elements), time.perf_counter() - begun


def extrapolated(sizes: Floats, values: Floats) -> Floats:
    """Return k of k (1 − c h^p), one p of all loads, (n_loads,); from (n_sizes, n_loads)."""

    def misfit(at: Floats) -> Floats:
        ends = values[-1] * (1.0 + at[1:])
        left = values[-1] / ends - 1.0
        ratio = (sizes[:-1, None] / sizes[-1]) ** at[0]
        return np.asarray(values[:-1] / ends - 1.0 - left * ratio).ravel()

    start = np.concatenate([[1.2], np.full(values.shape[1], 0.01)])
    best = least_squares(misfit, start, bounds=(np.r_[0.8, -0.3 + 0 * start[1:]], 3.0))
    return np.asarray(values[-1] * (1.0 + best.x[1:]), dtype=np.float64)


def of_case(name: str) -> dict[str, Any]:
    """Return the deviation of one actuator's mesh."""
    geometry, group, loads, shares = CASES[name]
    recipe = local_recipe(geometry.dimensions)
    rows, told = [], []
    meshes = [recipe.coarse_mesh, *(scaled(recipe.fine_mesh, share) for share in shares)]
    for mesh in meshes:
        values, elements, seconds = curvatures(geometry, group, loads, mesh)
        rows.append(values)
        told.append({"elements": elements, "seconds": round(seconds, 1)})
        print(name, mesh, told[-1], values.round(5), flush=True)
    limit = extrapolated(np.array(shares), np.array(rows[1:]))
    deviation = 100.0 * (rows[1 + shares.index(1.0)] / limit - 1.0)
    coarse = 100.0 * (rows[0] / limit - 1.0)
    return {"meshes": told, "fine_pct": deviation.tolist(), "coarse_pct": coarse.tolist()}


def scaled(mesh: Resolution, share: float) -> Resolution:
    """Return a mesh whose section is divided into more elements."""
    return Resolution(
        mesh.along * max(share, 0.75), mesh.across * share, mesh.up * share, mesh.grading
    )


def main() -> None:
    """Print the deviations."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(CASES))
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    details = {name: of_case(name) for name in asked.only}
    every = np.concatenate([case["fine_pct"] for case in details.values()])
    print(json.dumps({"error_pct": float(np.sqrt(np.mean(every**2))), "details": details}))


if __name__ == "__main__":
    main()
