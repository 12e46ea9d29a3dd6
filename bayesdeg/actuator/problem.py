"""The discrete equations of one actuator: residual and tangent at a state."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator import kernels, paper
from bayesdeg.actuator.material import Material, skin_profile
from bayesdeg.actuator.system import State, System

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Places = NDArray[np.int32]

NOTHING = np.empty(0)


class Linearisation(NamedTuple):
    """Residual and tangent of one state.

    ``residual`` is that of the free unknowns with the pressure condensed, ``tangent`` the data
    of the upper triangle (empty if not asked for), ``force`` the uncondensed residual on all
    degrees of freedom.
    """

    residual: Floats
    tangent: Floats
    force: Floats
    coupling: Floats
    volume_residual: Floats
    smallest_jacobian: float
    cavity_volume: float


@dataclass(frozen=True, eq=False)
class Problem:
    """A body of one material under dead loads and the pressure in its cavity.

    Parameters
    ----------
    system : System
        The discrete body.
    material : Material
        In units of C1.
    nodal_force : array, shape (n_nodes, 3), optional
        Dead forces beside gravity [C1 mm²].
    share : float
        Share of the dead loads and of the paper's mismatch that acts [–].
    """

    system: System
    material: Material
    nodal_force: Floats | None = None
    share: float = 1.0
    face: tuple[Floats, Floats, Floats] = field(init=False, repr=False)
    _form: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Look up the shapes of faces."""
        order = self.system.body.element.order
        object.__setattr__(self, "face", kernels.face_shapes(order)[1:])
        object.__setattr__(self, "_form", kernels.volume_form(order))

    def with_share(self, share: float) -> Self:
        """Return the problem with another share of its dead loads."""
        return replace(self, share=share)

    @property
    def has_dead_load(self) -> bool:
        """Whether anything acts at zero pressure."""
        return bool(np.any(self.dead_force)) or self.material.paper_mismatch != 0.0

    @cached_property
    def constants(self) -> Floats:
        """C1, C2, C3 and r at every quadrature point, (n_elements, n_points, 4) [C1]."""
        m, body = self.material, self.system.body
        uniform = np.array([1.0, m.c2_ratio, m.c3_ratio, m.second_invariant_ratio])
        if m.skin == 0.0:
            return np.ascontiguousarray(np.broadcast_to(uniform, (*body.weights.shape, 4)))
        local: Floats = np.exp(m.skin * skin_profile(body))[..., None] * uniform
        return local

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

    def linearise(self, state: State, *, tangent: bool = True) -> Linearisation:
        """Return residual and tangent at a state.

        The residual is the internal force less the loads', with the volume equation condensed
        element by element; the tangent is symmetric since the cavity is closed.
        """
        system, body = self.system, self.system.body
        data = np.zeros(system.upper.nnz) if tangent else NOTHING
        force = -self.share * self.dead_force
        modes = body.element.modes.shape[1]
        coupling = np.empty((len(body.elements), modes, 3 * body.elements.shape[1]))
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
        return lin._replace(residual=self.condensed(force, volume_residual, lin))

    def _add_surfaces(self, state: State, force: Floats, data: Floats) -> float:
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

    def products(self, state: State, directions: Sequence[State]) -> list[tuple[Floats, Floats]]:
        """Return the mixed problem's tangent times directions, nothing assembled.

        Returns
        -------
        list of pairs
            Rate of the uncondensed residual, a rate of the load included, (n_nodes, 3); and rate
            of the volume residual, (n_elements, n_modes).
        """
        body = self.system.body
        along = np.concatenate([d.displacement for d in directions], axis=1)
        pressures = np.stack([d.pressure for d in directions], axis=1)
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
        split = np.ascontiguousarray(forces.reshape(-1, len(directions), 3).transpose(1, 0, 2))
        self._add_surface_products(state, directions, split)
        return list(zip(split, np.ascontiguousarray(volume_rates.transpose(1, 0, 2)), strict=True))

    def _add_surface_products(
        self, state: State, directions: Sequence[State], forces: Floats
    ) -> None:
        along = np.stack([d.displacement for d in directions], axis=-1)
        for faces, tangents in self._surface_tangents(state):
            local = along[faces].reshape(*tangents.shape[:2], len(directions))
            pushes = (tangents @ local).reshape(*faces.shape, 3, len(directions))
            for force, push in zip(forces, np.moveaxis(pushes, -1, 0), strict=True):
                np.add.at(force, faces, push)
        if self.material.paper_group > 0.0:
            bend = self.system.bending @ along.reshape(-1, len(directions))
            forces += self.bending_stiffness * bend.T.reshape(forces.shape)
        pressed = np.array([d.load for d in directions])
        if np.any(pressed != 0.0):
            forces -= pressed[:, None, None] * self.cavity_gradient(state)

    def _surface_tangents(self, state: State) -> list[tuple[Indices, Floats]]:
        """Return the faces' nodes and their own tangents, (n_faces, 3 n, 3 n), cavity first."""
        body, spare = self.system.body, np.zeros_like(self.system.body.nodes)
        placed = body.nodes + state.displacement
        at, tangents = _own_entries(body.cavity)
        kernels.cavity_volume(placed, body.cavity, self._form, -state.load, spare, at, tangents)
        found = [(body.cavity, tangents.reshape(at.shape))]
        if self.material.paper_group > 0.0:
            at, tangents = _own_entries(body.paper)
            paper.membrane(
                placed, body.nodes, body.paper, *self.face, self.paper_law, spare, at, tangents
            )
            found.append((body.paper, tangents.reshape(at.shape)))
        return found

    def condensed(self, force: Floats, volume_residual: Floats, factors: Linearisation) -> Floats:
        """Return a residual on the free unknowns, its volume equation eliminated.

        ``factors`` gives the couplings; it is the linearisation whose tangent is factorized.
        """
        total = force.copy()
        kernels.condense(
            self.system.body.elements,
            factors.coupling,
            self.system.inverse_mass,
            self.material.bulk_ratio,
            volume_residual,
            total,
        )
        return self.on_free(total)

    def on_free(self, field: Floats) -> Floats:
        """Return the values of a field (n_nodes, 3) that belong to unknowns."""
        return field.ravel()[self.system.free]

    def pressure_increment(
        self, factors: Linearisation, displacement: Floats, volume_residual: Floats | None = None
    ) -> Floats:
        """Return the pressure increments that go with a displacement increment.

        δp = K M⁻¹ (B δu + r); without ``volume_residual`` r = 0, as for derivatives along a path.
        """
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

    def cavity_gradient(self, state: State) -> Floats:
        """Return dV/du, the force of a unit pressure, (n_nodes, 3) [mm²]."""
        return self._cavity(state)[1]

    def cavity_volume(self, state: State) -> float:
        """Return the volume of the half model's cavity [mm³]."""
        return self._cavity(state)[0]

    def _cavity(self, state: State) -> tuple[float, Floats]:
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
    """Return places and room for a tangent of each face's own."""
    size = 3 * faces.shape[1]
    places = np.arange(len(faces) * size * size, dtype=np.int32).reshape(len(faces), size, size)
    return places, np.zeros(places.size)
