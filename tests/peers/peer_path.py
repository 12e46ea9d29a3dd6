"""What every program hands back, our own path in the same form, and how curvature is read."""

import time
from dataclasses import dataclass

import numpy as np

from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import MechanicalState, Problem, System
from bayesdeg.actuator.status import PathEffort, Status

C1, C2, C3 = 0.288, -0.004, 0.0012  # MPa
LINEAR_SCALE, PAPER_STIFFNESS = 0.843, 30.0  # –, N/mm
PRESSURES = np.arange(20.0, 250.0, 20.0)  # kPa
LOADS = PRESSURES * 1e-3 / C1
FRESH = MaterialGroups(
    c2_ratio=C2 / C1,
    c3_ratio=C3 / C1,
    paper_group=PAPER_STIFFNESS / (C1 * LINEAR_SCALE),
    paper_thickness=0.0,  # a membrane: the peers have no bending of it
)


@dataclass(frozen=True)
class PeerPath:
    """A pressure path of one program.

    ``displacements`` (n_loads, n_nodes, 3) in mm; ``setup`` and ``seconds`` are the times before
    the first load and for all loads, linear solver included; ``iterations`` are factorizations.
    """

    displacements: np.ndarray
    iterations: int
    setup: float
    seconds: float

    @property
    def total(self):
        return self.setup + self.seconds


def refuse_special(material):
    """Raise ValueError if a material has what the peers leave out: skin, gravity and the like."""
    common = ("c2_ratio", "c3_ratio", "paper_group", "paper_poisson", "bulk_ratio")
    plain = MaterialGroups(**{name: getattr(material, name) for name in common})
    if material != plain:
        raise ValueError(f"the peers know only {', '.join(common)}: {material}")


EXACT = PathEffort(tolerance=1e-8, iterations=30, exact=True)


def own_path(body, material, *, loads, effort=EXACT, layer=None):
    """Follow the same loads with bayesdeg; by default to an equilibrium at every load."""
    start = time.perf_counter()
    system = System(body)
    solver = open_factorization(system.upper)
    problem = Problem(system, material, layer=layer)
    begun = time.perf_counter()
    path = follow(problem, solver, loads=[float(q) for q in loads], effort=effort)
    end = time.perf_counter()
    solver.close()
    if path.status != Status.CONVERGED:
        raise RuntimeError(f"{path.status.name} after {len(path.states)} loads")
    states = np.array([state.displacement for state in path.states])
    return PeerPath(states, path.iterations, begun - start, end - begun)


def curvatures(mesh, displacements):
    """Read the curvatures [1/m] of an actuator at the linear scale, as bayesdeg reads them."""
    none = np.zeros((len(mesh.body.elements), mesh.body.element.modes.shape[1]))
    readings = (read_state(mesh, MechanicalState(u, none, 0.0)) for u in displacements)
    return np.array([reading.curvature * 1e3 / LINEAR_SCALE for reading in readings])
