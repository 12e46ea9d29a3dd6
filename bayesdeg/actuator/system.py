"""The discrete equations of one mesh: everything that is resolved once, before any iteration."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayesdeg.actuator import kernels, surfaces
from bayesdeg.actuator.mesh import ActuatorMesh

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Material:
    """What the discrete equations need to know of the actuator, in units of C1.

    Parameters
    ----------
    c2_ratio, c3_ratio : float
        C2/C1 and C3/C1 of the Yeoh law [–].
    paper_group : float
        Et/(C1 s): stiffness of the paper over C1 and the linear scale [mm].
    paper_poisson : float
        Poisson's ratio of the paper [–].
    bulk_ratio : float
        K/C1 [–]; at 1e4 the curvature is within 0.05 % of the incompressible one.
    """

    c2_ratio: float
    c3_ratio: float
    paper_group: float
    paper_poisson: float = 0.3
    bulk_ratio: float = 1e4


@dataclass(frozen=True)
class State:
    """An equilibrium, or a guess of one.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    pressure : array, shape (n_elements, 4)
        Pressure field in the solid [C1].
    load : float
        Gauge pressure in the cavity over C1 [–].
    """

    displacement: Floats
    pressure: Floats
    load: float

    def moved(self, displacement: Floats, pressure: Floats, load: float = 0.0) -> Self:
        """Return this state with increments added."""
        return replace(
            self,
            displacement=self.displacement + displacement,
            pressure=self.pressure + pressure,
            load=self.load + load,
        )


class Linearisation(NamedTuple):
    """Residual and tangent of one state: on free unknowns, upper triangle."""

    residual: Floats
    tangent: Floats
    coupling: Floats
    volume_residual: Floats
    smallest_jacobian: float
    cavity_volume: float


class System:
    """A mesh with its unknowns numbered and its sparsity resolved.

    Parameters
    ----------
    mesh : ActuatorMesh
        The half model.

    Attributes
    ----------
    free : array
        Positions of the unknowns among all degrees of freedom ``3 node + axis``.
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle of the tangent.
    """

    def __init__(self, mesh: ActuatorMesh) -> None:
        self.mesh = mesh
        fixed = np.zeros((len(mesh.nodes), 3), dtype=bool)
        fixed[mesh.clamped] = True
        fixed[mesh.symmetry, 1] = True
        self.free: Indices = np.flatnonzero(~fixed.ravel())
        equation = np.full(fixed.size, -1, dtype=np.int64)
        equation[self.free] = np.arange(len(self.free))
        self.upper, self._solid_at = _pattern(equation, mesh.elements)
        self._cavity_at = _positions(equation, mesh.cavity, self.upper)
        self._bottom_at = _positions(equation, mesh.bottom, self.upper)
        t = mesh.points
        self.modes: Floats = np.column_stack([np.ones(len(t)), t - 0.5])
        mass = np.einsum("eq,qm,qn->emn", mesh.weights, self.modes, self.modes)
        self.mass: Floats = mass
        self.inverse_mass: Floats = np.linalg.inv(mass)
        self._face = surfaces.face_shapes()

    def rest(self) -> State:
        """Return the undeformed state."""
        return State(
            np.zeros_like(self.mesh.nodes), np.zeros((len(self.mesh.elements), 4)), load=0.0
        )

    def linearise(self, state: State, material: Material) -> Linearisation:
        """Return residual and tangent at a state.

        The residual is the internal force less the load's, with the volume equation condensed
        element by element; the tangent is symmetric since the cavity is closed.
        """
        residual = np.zeros(3 * len(self.mesh.nodes))
        data = np.zeros(self.upper.nnz)
        smallest, coupling, volume_residual = self._add_solid(state, material, residual, data)
        volume = self._add_cavity(state, -state.load, residual, data)
        surfaces.membrane(
            state.displacement,
            self.mesh.nodes,
            self.mesh.bottom,
            *self._face[1:],
            material.paper_group,
            material.paper_poisson,
            residual,
            self._bottom_at,
            data,
        )
        return Linearisation(residual[self.free], data, coupling, volume_residual, smallest, volume)

    def _add_solid(
        self, state: State, material: Material, residual: Floats, data: Floats
    ) -> tuple[float, Floats, Floats]:
        mesh = self.mesh
        coupling = np.empty((len(mesh.elements), 4, 81))
        volume_residual = np.empty((len(mesh.elements), 4))
        smallest = kernels.solid(
            state.displacement,
            state.pressure,
            mesh.elements,
            mesh.gradients,
            mesh.weights,
            self.modes,
            self.inverse_mass,
            np.array([1.0, material.c2_ratio, material.c3_ratio]),
            material.bulk_ratio,
            residual,
            coupling,
            volume_residual,
            self._solid_at,
            data,
        )
        return smallest, coupling, volume_residual

    def _add_cavity(self, state: State, factor: float, residual: Floats, data: Floats) -> float:
        volume: float = surfaces.cavity_volume(
            self.mesh.nodes + state.displacement,
            self.mesh.cavity,
            *self._face,
            factor,
            residual,
            self._cavity_at,
            data,
        )
        return volume

    def expand(self, unknowns: Floats) -> Floats:
        """Return values of the unknowns as a field over the nodes, (n_nodes, 3)."""
        field = np.zeros(3 * len(self.mesh.nodes))
        field[self.free] = unknowns
        return field.reshape(-1, 3)

    def condensed_pressure(
        self, lin: Linearisation, displacement: Floats, material: Material, *, rate: bool = False
    ) -> Floats:
        """Return the pressure increments that go with a displacement increment.

        δp = K M⁻¹ (B δu + r_p); with ``rate`` the residual r_p is left out, as it must be for
        derivatives along the path.
        """
        local = displacement[self.mesh.elements].reshape(len(self.mesh.elements), 81)
        strain = np.einsum("emk,ek->em", lin.coupling, local)
        if not rate:
            strain = strain + lin.volume_residual
        pressure: Floats = np.einsum("emn,en->em", self.inverse_mass, strain)
        return material.bulk_ratio * pressure

    def cavity_force(self, state: State) -> Floats:
        """Return dV/du on the free unknowns: the force of a unit pressure [mm²]."""
        gradient = np.zeros(3 * len(self.mesh.nodes))
        self._add_cavity(state, 1.0, gradient, np.zeros(self.upper.nnz))
        return gradient[self.free]


def _degrees(nodes: Indices) -> Indices:
    return (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 3 * nodes.shape[1])


def _pattern(equation: Indices, elements: Indices) -> tuple[sp.csr_array, NDArray[np.int32]]:
    """Pattern of the upper triangle, and where every element entry stands in its data."""
    local = equation[_degrees(elements)]
    count = int(equation.max()) + 1
    rows = np.repeat(local[:, :, None], local.shape[1], axis=2)
    columns = np.swapaxes(rows, 1, 2)
    stored = (rows >= 0) & (columns >= rows)
    keys, inverse = np.unique(rows[stored] * count + columns[stored], return_inverse=True)
    pointers = np.searchsorted(keys // count, np.arange(count + 1))
    upper = sp.csr_array(
        (np.zeros(len(keys)), (keys % count).astype(np.int32), pointers.astype(np.int32)),
        shape=(count, count),
    )
    at = np.full(stored.shape, -1, dtype=np.int32)
    at[stored] = inverse
    return upper, at


def _positions(equation: Indices, faces: Indices, upper: sp.csr_array) -> NDArray[np.int32]:
    """Where entries of faces stand: their nodes all belong to one element, so they exist."""
    local = equation[_degrees(faces)]
    count = upper.shape[0]
    keys = np.repeat(np.arange(count), np.diff(upper.indptr)) * count + upper.indices
    rows = np.repeat(local[:, :, None], local.shape[1], axis=2)
    columns = np.swapaxes(rows, 1, 2)
    stored = (rows >= 0) & (columns >= rows)
    at = np.full(stored.shape, -1, dtype=np.int32)
    at[stored] = np.searchsorted(keys, rows[stored] * count + columns[stored])
    return at
