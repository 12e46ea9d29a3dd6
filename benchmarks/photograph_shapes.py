"""Side views of bent actuators by the finite element model, for the test photographs.

    uv run python benchmarks/photograph_shapes.py

solves curves of two materials, fresh and degraded, and keeps the deformed side faces and the edge
where gel and paper meet in ``photograph_shapes.npz``. Lengths are in mm as conditioned.
"""

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs, load_of, material_groups
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.settings import Dimensions

Floats = NDArray[np.float64]

STORE = Path(__file__).with_name("photograph_shapes.npz")
MESH = Resolution(along=1.8, across=2.5, up=2.5)
SCALE = 0.62 ** (1 / 3)
# C1, C2, C3 [MPa]: fresh, and at a degradation rate of 25 %
MATERIALS = ((0.288, -0.003, 0.002), (1.59, -0.05, 0.05))
PRESSURES = np.arange(20.0, 241.0, 20.0)  # kPa
# the edges of a quadratic face, as parameters along its grid of 3 × 3 nodes
ALONG = np.linspace(0.0, 1.0, 7)


@dataclass(frozen=True)
class Shape:
    """A side view in the bending plane, the clamp at x = 0, the paper at the bottom.

    Parameters
    ----------
    faces : array, shape (n_faces, n, 2)
        Outlines of the faces of the elements, deformed [mm].
    line : array, shape (m, 2)
        The edge where gel and paper meet, from the clamp to the tip [mm].
    """

    faces: Floats
    line: Floats

    def mixed(self, other: "Shape", share: float) -> "Shape":
        """Return a shape between two of the same mesh; close ones of one curve differ little."""
        return Shape(
            (1.0 - share) * self.faces + share * other.faces,
            (1.0 - share) * self.line + share * other.line,
        )


def _quadratic(nodes: Floats, at: Floats) -> Floats:
    """Points on a curve through three nodes, (…, 3, 2)."""
    shapes = np.stack([(1 - at) * (1 - 2 * at), 4 * at * (1 - at), at * (2 * at - 1)])
    return np.asarray(np.einsum("ap,...ai->...pi", shapes, nodes), dtype=np.float64)


def side_view(mesh: ActuatorMesh, placed: Floats) -> Shape:
    """Return what is seen from the side: element faces on the outer side, their lower edge."""
    nodes = np.round(mesh.body.nodes, 9)  # equal coordinates compare as equal
    outer = np.isclose(nodes[:, 1], mesh.body.nodes[:, 1].max())
    faces, edges = [], []
    for element in mesh.body.elements:
        on_side = element[outer[element]]
        if len(on_side) != 9:
            continue
        grid = on_side[np.lexsort((nodes[on_side, 2], nodes[on_side, 0]))].reshape(3, 3)
        at = placed[grid][:, :, (0, 2)]  # first axis along x, second up
        around = [at[:, 0], at[2], at[::-1, 2], at[0, ::-1]]
        faces.append(np.concatenate([_quadratic(side, ALONG)[:-1] for side in around]))
        if np.isclose(nodes[grid[0, 0], 2], 0.0):
            edges.append((nodes[grid[0, 0], 0], _quadratic(at[:, 0], ALONG)))
    edges.sort(key=lambda one: float(one[0]))
    line = np.concatenate([edges[0][1][:1], *(edge[1:] for _, edge in edges)])
    return Shape(np.array(faces), line)


def solved(constants: tuple[float, float, float]) -> list[Shape]:
    """Solve one curve and return the shapes at rest and at all pressures that were reached."""
    one = np.ones(len(PRESSURES))
    c1, c2, c3 = constants
    inputs = Inputs(
        pressure=PRESSURES,
        c1=c1 * one,
        c2=c2 * one,
        c3=c3 * one,
        linear_scale=SCALE * one,
        paper_stiffness=200.0 * one,
    )
    groups = {name: float(np.ravel(group)[0]) for name, group in material_groups(inputs).items()}
    loads = tuple(load_of(inputs).tolist())
    actuator = Actuator(build_mesh(Geometry(Dimensions()), MESH))
    mesh, problem = actuator.problem(Curve(loads, MaterialGroups(**groups)))
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=loads)
    finally:
        factorization.close()
    nodes = mesh.body.nodes
    moved = [nodes, *(nodes + point.state.displacement for point in path.points)]
    views = [side_view(mesh, placed) for placed in moved]
    return [Shape(SCALE * view.faces, SCALE * view.line) for view in views]


@cache
def shapes() -> tuple[tuple[Shape, ...], ...]:
    """Return the stored shapes, a tuple of rising pressure for every material."""
    with np.load(STORE, allow_pickle=False) as kept:
        found = {name: kept[name].astype(np.float64) for name in kept.files}
    return tuple(
        tuple(
            Shape(faces, line)
            for faces, line in zip(found[f"faces_{i}"], found[f"line_{i}"], strict=True)
        )
        for i in range(len(MATERIALS))
    )


def main() -> None:
    """Solve all curves and keep their shapes."""
    arrays: dict[str, Any] = {}
    for i, constants in enumerate(MATERIALS):
        found = solved(constants)
        arrays[f"faces_{i}"] = np.array([shape.faces for shape in found], dtype=np.float32)
        arrays[f"line_{i}"] = np.array([shape.line for shape in found], dtype=np.float32)
    with STORE.open("wb") as file:
        np.savez_compressed(file, **arrays)


if __name__ == "__main__":
    main()
