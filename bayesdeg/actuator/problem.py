"""The discrete equations of one actuator: residual and tangent at a state."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayesdeg.actuator import kernels, paper
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.material import LayerGroups, MaterialGroups, local_constants
from bayesdeg.actuator.paper import bending_matrix

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Places = NDArray[np.int32]


@dataclass(frozen=True)
class MechanicalState:
    """An equilibrium, or an approximation of one.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    pressure : array, shape (n_elements, n_modes)
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


@dataclass(frozen=True)
class Point:
    """An equilibrium with the path's tangent d(state)/d(load)."""

    state: MechanicalState
    rate: MechanicalState


class System:
    """A body with its unknowns numbered and its sparsity resolved.

    Parameters
    ----------
    body : Body
        Body with its fixed, pressurised and papered faces.

    Attributes
    ----------
    free : array
        Positions of the unknowns among all degrees of freedom ``3 node + axis``.
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle of the tangent.
    solid_at, cavity_at, paper_at : array of int
        Positions of entries of elements and faces in its data.
    bending : scipy.sparse.csr_array
        Hessian of the paper's bending for a unit stiffness, on all degrees of freedom.
    bending_at, bending_values : array
        Positions of its entries in the data, and their values.
    inverse_mass : array, shape (n_elements, n_modes, n_modes)
        Inverse of ∫ modesᵀ modes dV.
    volumes : array, shape (n_nodes,)
        ∫ N dV: the volume that belongs to each node [mm³].
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.free: Indices = np.flatnonzero(~body.fixed.ravel())
        equation = self._equation()
        bending = sp.coo_array(bending_matrix(body).tocsr())
        self.bending: sp.csr_array = bending.tocsr()
        self.upper, self.solid_at, spare = _pattern(equation, body.elements, bending)
        self.bending_at, self.bending_values = spare
        self.cavity_at = _positions(equation, body.cavity, self.upper)
        self.paper_at = _positions(equation, body.paper, self.upper)
        self._measure(body)

    def _measure(self, body: Body) -> None:
        modes = body.element.modes
        mass = np.einsum("eq,qm,qn->emn", body.weights, modes, modes, optimize=True)
        self.inverse_mass: Floats = np.ascontiguousarray(np.linalg.inv(mass))
        shares = body.weights @ body.element.shapes
        self.volumes: Floats = np.bincount(
            body.elements.ravel(), shares.ravel(), minlength=len(body.nodes)
        )

    def with_body(self, body: Body) -> Self:
        """Return this system for a body of the same bricks with moved nodes, sharing numbering."""
        other = copy(self)
        other.body = body
        other._measure(body)
        bending = sp.coo_array(bending_matrix(body).tocsr())
        other.bending = bending.tocsr()
        other.bending_values = bending.data[_kept(bending, self._equation())]
        return other

    def _equation(self) -> Indices:
        equation = np.full(self.body.fixed.size, -1, dtype=np.int64)
        equation[self.free] = np.arange(len(self.free))
        return equation

    def rest(self) -> MechanicalState:
        """Return the undeformed state."""
        body = self.body
        pressure = np.zeros((len(body.elements), body.element.modes.shape[1]))
        return MechanicalState(np.zeros_like(body.nodes), pressure, load=0.0)

    def places_of(self, faces: Indices) -> Places:
        """Return positions of the entries of faces in the pattern's data; −1 below the diagonal.

        Degrees of freedom are ordered node by node: (n_faces, 3 n, 3 n) for faces of n nodes.
        """
        return _positions(self._equation(), faces, self.upper)

    def expand(self, unknowns: Floats) -> Floats:
        """Return values of the unknowns as a field over the nodes, (n_nodes, 3)."""
        field = np.zeros(3 * len(self.body.nodes))
        field[self.free] = unknowns
        return field.reshape(-1, 3)

    def on_free(self, field: Floats) -> Floats:
        """Return the values of a field (n_nodes, 3) that belong to unknowns."""
        return field.ravel()[self.free]


def stored_pairs(n_local: int) -> tuple[Indices, Indices]:
    """Rows and columns of an element's upper triangle in the order of ``scatter_upper``."""
    rows, columns = [], []
    for i in range(3):
        for j in range(i, 3):
            a, b = np.meshgrid(np.arange(n_local), np.arange(n_local), indexing="ij")
            wanted = (b >= a) if i == j else np.ones_like(a, dtype=bool)
            rows.append(i * n_local + a[wanted])
            columns.append(j * n_local + b[wanted])
    return np.concatenate(rows), np.concatenate(columns)


def _kept(bending: sp.coo_array, equation: Indices) -> NDArray[np.bool_]:
    rows, columns = equation[bending.coords[0]], equation[bending.coords[1]]
    return (rows >= 0) & (columns >= rows)


def _pattern(
    equation: Indices, elements: Indices, bending: sp.coo_array
) -> tuple[sp.csr_array, Places, tuple[Places, Floats]]:
    """Return the upper triangle's pattern, and positions of element and bending entries in it."""
    count = int(equation.max()) + 1
    # degrees of freedom of elements, component by component
    degrees = 3 * elements[:, None, :] + np.arange(3)[:, None]
    local = equation[degrees.reshape(len(elements), -1)]
    first, second = stored_pairs(elements.shape[1])
    one, other = local[:, first], local[:, second]
    stored = (one >= 0) & (other >= 0)
    keys = (np.minimum(one, other) * count + np.maximum(one, other))[stored]
    kept = _kept(bending, equation)
    extra = equation[bending.coords[0][kept]] * count + equation[bending.coords[1][kept]]
    every, inverse = np.unique(np.concatenate([keys, extra]), return_inverse=True)
    pointers = np.searchsorted(every // count, np.arange(count + 1))
    places = (every % count).astype(np.int32), pointers.astype(np.int32)
    upper = sp.csr_array((np.zeros(len(every)), *places), shape=(count, count))
    at = np.full(stored.shape, -1, dtype=np.int32)
    at[stored] = inverse[: len(keys)]
    return upper, at, (inverse[len(keys) :].astype(np.int32), bending.data[kept])


def _positions(equation: Indices, faces: Indices, upper: sp.csr_array) -> Places:
    """Return positions of entries of faces; they exist, as a face's nodes belong to one element."""
    degrees = (3 * faces[:, :, None] + np.arange(3)).reshape(len(faces), 3 * faces.shape[1])
    local, count = equation[degrees], upper.shape[0]
    keys = np.repeat(np.arange(count), np.diff(upper.indptr)) * count + upper.indices
    rows = np.repeat(local[:, :, None], local.shape[1], axis=2)
    columns = np.swapaxes(rows, 1, 2)
    stored = (rows >= 0) & (columns >= rows)
    at = np.full(stored.shape, -1, dtype=np.int32)
    at[stored] = np.searchsorted(keys, rows[stored] * count + columns[stored])
    return at


NOTHING = np.empty(0)


class Linearisation(NamedTuple):
    """Residual and tangent of one state.

    ``residual`` is that of the free unknowns with the pressure condensed, ``tangent`` the data
    of the upper triangle, ``force`` the uncondensed residual on all degrees of freedom.
    ``coupling`` is B, ∫ q cof F : ∇u, in the format of the problem that made it. If no tangent was
    requested, the first two and the couplings are empty.
    """

    residual: Floats
    tangent: Floats
    force: Floats
    coupling: Any
    volume_residual: Floats
    smallest_jacobian: float
    cavity_volume: float


class DiscreteEquations(Protocol):
    """Interface for the load path: kernels and scikit-fem assemble the same equations."""

    @property
    def system(self) -> System:
        """Numbering and sparsity."""

    @property
    def material(self) -> MaterialGroups:
        """In units of C1."""

    @property
    def has_dead_load(self) -> bool:
        """Whether any load acts at zero pressure."""

    def with_share(self, share: float) -> Self:
        """Return the equations with a different share of the dead loads."""

    def linearise(self, state: MechanicalState, *, tangent: bool = True) -> Linearisation:
        """Return residual and tangent at a state.

        The residual is the internal force minus the loads', with the volume equation condensed
        element by element; the tangent is symmetric since the cavity is closed. Without it the
        equations are only evaluated: neither couplings nor a condensed residual.
        """

    def products(
        self, state: MechanicalState, directions: Sequence[MechanicalState]
    ) -> list[tuple[Floats, Floats]]:
        """Return the mixed problem's tangent applied to directions.

        Returns
        -------
        list of pairs
            Rate of the uncondensed residual, a rate of the load included, (n_nodes, 3); and rate
            of the volume residual, (n_elements, n_modes).
        """

    def condensed(self, force: Floats, volume_residual: Floats, factors: Linearisation) -> Floats:
        """Return a residual on the free unknowns, its volume equation eliminated.

        ``factors`` gives the couplings; it is the linearisation whose tangent is factorized.
        """

    def pressure_increment(
        self, factors: Linearisation, displacement: Floats, volume_residual: Floats | None = None
    ) -> Floats:
        """Return the pressure increments that go with a displacement increment.

        δp = K M⁻¹ (B δu + r); without ``volume_residual`` r = 0, as for derivatives along a path.
        """

    def cavity_gradient(self, state: MechanicalState) -> Floats:
        """Return the derivative of the cavity's volume by the displacement."""

    def cavity_volume(self, state: MechanicalState) -> float:
        """Return the volume of the half model's cavity."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A body of one material under dead loads and the pressure in its cavity, by the kernels.

    ``weak_form.WeakForm`` assembles the same equations with scikit-fem.

    Parameters
    ----------
    system : System
        The discrete body.
    material : MaterialGroups
        In units of C1.
    nodal_force : array, shape (n_nodes, 3), optional
        Dead forces besides gravity [C1 mm²].
    share : float
        Share of the dead loads and of the paper's mismatch that acts [–].
    layer : LayerGroups, optional
        Material of the bricks of the body's layer.
    local : array, shape (n_elements, n_points, 4), optional
        C1, C2, C3 and r at every quadrature point, if they differ from those of the groups [C1].
    """

    system: System
    material: MaterialGroups
    nodal_force: Floats | None = None
    share: float = 1.0
    layer: LayerGroups | None = None
    local: Floats | None = None
    face: tuple[Floats, Floats, Floats] = field(init=False, repr=False)
    _form: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Look up the shapes of faces."""
        element = self.system.body.element
        order, triangle = element.order, element.triangular
        shapes = kernels.face_shapes(order, triangle=triangle)
        object.__setattr__(self, "face", shapes[1:])
        object.__setattr__(self, "_form", kernels.volume_form(order, triangle=triangle))

    def with_share(self, share: float) -> Self:
        """Return the problem with a different share of its dead loads."""
        return replace(self, share=share)

    @property
    def has_dead_load(self) -> bool:
        """Whether any load acts at zero pressure."""
        return bool(np.any(self.dead_force)) or self.material.paper_mismatch != 0.0

    @cached_property
    def constants(self) -> Floats:
        """C1, C2, C3 and r at every quadrature point, (n_elements, n_points, 4) [C1]."""
        if self.local is not None:
            return self.local
        return local_constants(self.material, self.system.body, self.layer)

    @cached_property
    def dead_force(self) -> Floats:
        """Gravity and nodal forces in full, (n_nodes, 3) [C1 mm²]."""
        m = self.material
        gravity = np.array([m.gravity_along, 0.0, m.gravity_up])
        force: Floats = self.system.volumes[:, None] * gravity
        return force if self.nodal_force is None else force + self.nodal_force

    @cached_property
    def paper_law(self) -> Floats:
        """Et, ν, slack and mismatch of the membrane."""
        m = self.material
        mismatch = self.share * m.paper_mismatch
        return np.array([m.paper_group, m.paper_poisson, m.paper_slack, mismatch])

    @property
    def bending_stiffness(self) -> float:
        """D = Et t²/(12 (1 − ν²)) of the paper [C1 mm³]."""
        m = self.material
        return m.paper_group * m.paper_thickness**2 / (12.0 * (1.0 - m.paper_poisson**2))

    def linearise(self, state: MechanicalState, *, tangent: bool = True) -> Linearisation:
        """Return residual and tangent at a state, see `DiscreteEquations`."""
        system, body = self.system, self.system.body
        data = np.zeros(system.upper.nnz) if tangent else NOTHING
        force = -self.share * self.dead_force
        modes = body.element.modes.shape[1]
        coupled = len(body.elements) if tangent else 0
        coupling = np.empty((coupled, modes, 3 * body.elements.shape[1]))
        volume_residual = np.empty((len(body.elements), modes))
        smallest = kernels.solid(
            state.displacement,
            state.pressure,
            body.elements,
            body.gradients,
            body.weights,
            body.element.modes,
            system.inverse_mass,
            self.constants,
            self.material.bulk_ratio,
            force,
            coupling,
            volume_residual,
            system.solid_at,
            data,
        )
        volume = self._add_surfaces(state, force, data)
        lin = Linearisation(NOTHING, data, force, coupling, volume_residual, smallest, volume)
        if not tangent:
            return lin
        return lin._replace(residual=self.condensed(force, volume_residual, lin))

    def _add_surfaces(self, state: MechanicalState, force: Floats, data: Floats) -> float:
        system, body = self.system, self.system.body
        placed = body.nodes + state.displacement
        volume: float = kernels.cavity_volume(
            placed, body.cavity, self._form, -state.load, force, system.cavity_at, data
        )
        if self.material.paper_group > 0.0:
            paper.membrane(
                placed,
                body.nodes,
                body.paper,
                *self.face,
                self.paper_law,
                force,
                system.paper_at,
                data,
            )
            if self.bending_stiffness > 0.0:
                bend = system.bending @ state.displacement.ravel()
                force += self.bending_stiffness * bend.reshape(-1, 3)
                if data.size:
                    data[system.bending_at] += self.bending_stiffness * system.bending_values
        return volume

    def products(
        self, state: MechanicalState, directions: Sequence[MechanicalState]
    ) -> list[tuple[Floats, Floats]]:
        """Return the mixed problem's tangent applied to directions, without assembly."""
        body = self.system.body
        along = np.stack([d.displacement for d in directions], axis=-1)
        pressures = np.stack([d.pressure for d in directions], axis=-1)
        forces, volume_rates = np.zeros_like(along), np.empty_like(pressures)
        kernels.solid_products(
            state.displacement,
            state.pressure,
            body.elements,
            body.gradients,
            body.weights,
            body.element.modes,
            self.constants,
            self.material.bulk_ratio,
            along,
            pressures,
            forces,
            volume_rates,
        )
        split = np.ascontiguousarray(np.moveaxis(forces, -1, 0))
        spare, placed = np.zeros_like(body.nodes), body.nodes + state.displacement
        at, data = _own_entries(body.cavity)
        kernels.cavity_volume(placed, body.cavity, self._form, -state.load, spare, at, data)
        surfaces = [(body.cavity, data.reshape(at.shape))]
        if self.material.paper_group > 0.0:
            at, data = _own_entries(body.paper)
            paper.membrane(
                placed, body.nodes, body.paper, *self.face, self.paper_law, spare, at, data
            )
            surfaces.append((body.paper, data.reshape(at.shape)))
        for faces, tangents in surfaces:
            local = along[faces].reshape(*tangents.shape[:2], len(directions))
            pushes = (tangents @ local).reshape(*faces.shape, 3, len(directions))
            kernels.add_rows(faces, pushes, split)
        if self.material.paper_group > 0.0:
            bend = self.system.bending @ along.reshape(-1, len(directions))
            split += self.bending_stiffness * bend.T.reshape(split.shape)
        pressed = np.array([d.load for d in directions])
        if np.any(pressed != 0.0):
            split -= pressed[:, None, None] * self.cavity_gradient(state)
        return list(zip(split, np.ascontiguousarray(np.moveaxis(volume_rates, -1, 0)), strict=True))

    def condensed(self, force: Floats, volume_residual: Floats, factors: Linearisation) -> Floats:
        """Return a residual on the free unknowns, its volume equation eliminated."""
        total = force.copy()
        kernels.condense(
            self.system.body.elements,
            factors.coupling,
            self.system.inverse_mass,
            self.material.bulk_ratio,
            volume_residual,
            total,
        )
        return self.system.on_free(total)

    def pressure_increment(
        self, factors: Linearisation, displacement: Floats, volume_residual: Floats | None = None
    ) -> Floats:
        """Return δp = K M⁻¹ (B δu + r)."""
        out = np.empty_like(factors.volume_residual)
        rest = np.zeros_like(out) if volume_residual is None else volume_residual
        kernels.pressure_increment(
            displacement,
            self.system.body.elements,
            factors.coupling,
            self.system.inverse_mass,
            self.material.bulk_ratio,
            rest,
            out,
        )
        return out

    def cavity_gradient(self, state: MechanicalState) -> Floats:
        """Return dV/du, the force of a unit pressure, (n_nodes, 3) [mm²]."""
        return self._cavity(state)[1]

    def cavity_volume(self, state: MechanicalState) -> float:
        """Return the volume of the half model's cavity [mm³]."""
        return self._cavity(state)[0]

    def _cavity(self, state: MechanicalState) -> tuple[float, Floats]:
        gradient = np.zeros_like(self.system.body.nodes)
        placed = self.system.body.nodes + state.displacement
        volume: float = kernels.cavity_volume(
            placed,
            self.system.body.cavity,
            self._form,
            1.0,
            gradient,
            self.system.cavity_at,
            NOTHING,
        )
        return volume, gradient


def _own_entries(faces: Indices) -> tuple[Places, Floats]:
    """Return positions and storage for a separate tangent of each face."""
    size = 3 * faces.shape[1]
    places = np.arange(len(faces) * size * size, dtype=np.int32).reshape(len(faces), size, size)
    return places, np.zeros(places.size)
