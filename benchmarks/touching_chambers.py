"""Do chambers of an inflated pneunet touch? The gap that is left between their walls.

    uv run python benchmarks/touching_chambers.py --json

Walls on both sides of a slot bulge towards each other, while bending opens the slot. Neither the
finite element model nor an emulator knows contact: where walls would meet, both are wrong. Follows
fresh actuators of some dimensions, with soft, usual and stiff paper, to the end of the range of the
emulator that ships or of their curves, and takes the distance of points that face each other across
a slot. On the coarse mesh: what is asked is whether walls come near.

Of each, ``slot_mm`` as moulded, ``smallest_mm`` the smallest distance on the way, ``at_load`` p/C1
where it is so, ``last_load`` the last that was reached.
"""

import argparse
import json

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.data.settings import Dimensions

Floats = NDArray[np.float64]

DIMENSIONS = {
    "50 x 10 x 10 mm, 5 chambers": Dimensions(),
    "60 x 12 x 12 mm, 6 chambers": Dimensions(length=60.0, width=12.0, height=12.0, chambers=6),
    "50 x 10 x 10 mm, slots of 0.5 mm": Dimensions(gap=0.5),
}
PAPERS = (30.0, 120.0, 500.0)  # E t/(C1 s) [mm]
LOADS = tuple(np.linspace(0.08, 0.96, 12))


def facing(nodes: Floats, geometry: Geometry) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return nodes on both walls of each slot, those that face each other in the same places."""
    pairs = []
    for slot in geometry.slot_spans:
        sides = [np.flatnonzero(np.isclose(nodes[:, 0], x, atol=1e-6)) for x in slot]
        places = [{tuple(np.round(nodes[n, 1:], 6)): n for n in side} for side in sides]
        above = [key for key in places[0] if key in places[1] and key[1] > geometry.slot_bottom]
        first, second = (np.array([place[key] for key in above]) for place in places)
        pairs.append((first, second))
    return pairs


def smallest_gap(nodes: Floats, pairs: list[tuple[NDArray[np.intp], NDArray[np.intp]]]) -> float:
    """Return the smallest distance across a slot, negative where walls went through each other."""
    gaps = []
    for left, right in pairs:
        apart = nodes[right] - nodes[left]
        across = apart.mean(axis=0) / np.linalg.norm(apart.mean(axis=0))
        gaps.append(float((apart @ across).min()))
    return min(gaps)


def narrowest(dimensions: Dimensions, paper: float) -> dict[str, float]:
    """Return how near walls across a slot come to each other on the way of one curve."""
    geometry = Geometry(dimensions)
    actuator = Actuator(build_mesh(geometry, geometry.mesh_like(COARSE)))
    material = MaterialGroups(c2_ratio=0.0, c3_ratio=0.005, paper_group=paper)
    mesh, problem = actuator.problem(Curve(LOADS, material))
    path = follow(problem, open_factorization(actuator.system.upper, None), loads=LOADS)
    pairs = facing(mesh.body.nodes, geometry)
    gaps = [smallest_gap(mesh.body.nodes + state.displacement, pairs) for state in path.states]
    least = int(np.argmin(gaps))
    return {
        "paper_group_mm": paper,
        "slot_mm": dimensions.gap,
        "smallest_mm": round(gaps[least], 3),
        "at_load": round(float(LOADS[least]), 2),
        "last_load": round(float(LOADS[len(gaps) - 1]), 2),
    }


def main() -> None:
    """Follow the actuators and print what is left of their slots."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--json", action="store_true", help="one document")
    given = parser.parse_args()
    found = {
        name: [narrowest(dimensions, paper) for paper in PAPERS]
        for name, dimensions in DIMENSIONS.items()
    }
    if given.json:
        print(json.dumps(found, indent=1))
        return
    for name, rows in found.items():
        for row in rows:
            print(f"{name}: {row}")


if __name__ == "__main__":
    main()
