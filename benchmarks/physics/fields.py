r"""Actuators with a history-dependent material field: effects by independent physics.

The rules of `bayesdeg.causes` change the inputs of an elastic, uniform actuator. Here the field
itself is solved, at every quadrature point of the finite element model and along the test, so that
data with an effect do not come from the function that later explains it:

* `Viscous`: stress relaxes by a Prony series,
  :math:`S(t) = \int (1 - \sum_k g_k (1 - e^{-(t - s)/\tau_k}))\, dS^e(s)`;
* `Softened`: the pseudo-elasticity of Ogden and Roxburgh, each point by its own largest energy;
* `Drying`: water diffuses through the walls, which stiffen and shrink where they dry;
* `reacted`: degradation by an agent that diffuses in and is consumed, stationary.

:math:`S^e` is the isochoric second Piola–Kirchhoff stress of the Yeoh law. Paper stays elastic.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse import linalg as sparse_linalg
from scipy.special import erf
from skfem import asm
from skfem.models.poisson import laplace

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body, boundary_faces
from bayesdeg.actuator.equilibrium import LoadStep, find_equilibrium
from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction, load_of, material_groups
from bayesdeg.actuator.linear import Factorization, open_factorization
from bayesdeg.actuator.material import MaterialGroups, local_constants
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.outputs import (
    OUTPUTS,
    PEAK,
    deformation_gradients,
    face_rotation,
    read_state,
)
from bayesdeg.actuator.problem import (
    NOTHING,
    Linearisation,
    MechanicalState,
    Problem,
    System,
    stored_pairs,
)
from bayesdeg.actuator.status import PathEffort, Resolution, Status
from bayesdeg.actuator.weak_form import Spaces, mass, on_faces
from physics.mounting import (
    Bond,
    Clamp,
    ClampSprings,
    Mounting,
    cuts_of,
    detached,
    end_face,
    released,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

HALVINGS = 6  # maximum halvings of a load step without equilibrium
SWEEPS = 40  # iterations of the energy-dependent softening at one load
SETTLED = 1e-5  # relative change of the constants at convergence
LESS = 0.9  # required reduction of the change per sweep; else the next ones are damped
RELAXED = 0.67  # damping factor of the softening: undamped, half of an error returns
EFFORT = PathEffort(tolerance=1e-5, iterations=25)  # creep steps are small and must be resolved


@dataclass(frozen=True)
class Field:
    """The material at every quadrature point, during a step.

    Parameters
    ----------
    constants : array, shape (n_elements, n_points, 4)
        C1, C2, C3 and r, as in `Problem` [C1].
    overstress : array, shape (n_elements, n_points, 3, 3), optional
        Second Piola–Kirchhoff stress in addition to that of the constants [C1].
    swelling : array, shape (n_elements, n_points), optional
        Stress-free volume of the material over its meshed volume [–].
    """

    constants: Floats
    overstress: Floats | None = None
    swelling: Floats | None = None


@dataclass(frozen=True, eq=False)
class FieldEquations:
    r"""The equations of `Problem` with an overstress H and a stress-free volume ratio J*.

    .. math:: \int F H : \nabla v\, dV \quad\text{is added, and}\quad
        \int q (J - J^* - p/K)\, dV = 0.

    The energy depends on isochoric invariants only, so isotropic swelling needs nothing more.

    Parameters
    ----------
    problem : Problem
        Problem with the field's constants.
    overstress, swelling : array, optional
        As in `Field`.
    support : ClampSprings, optional
        Springs that hold the end face, if it is not fixed.
    """

    problem: Problem
    overstress: Floats | None = None
    swelling: Floats | None = None
    support: ClampSprings | None = None

    @property
    def system(self) -> System:
        """Numbering and sparsity."""
        return self.problem.system

    @property
    def material(self) -> MaterialGroups:
        """In units of C1."""
        return self.problem.material

    @property
    def has_dead_load(self) -> bool:
        """Whether any load acts at zero pressure."""
        acts = self.overstress is not None or self.swelling is not None
        return acts or self.problem.has_dead_load

    def with_share(self, share: float) -> Self:
        """Return the equations with a different share of the dead loads."""
        return replace(self, problem=self.problem.with_share(share))

    def linearise(self, state: MechanicalState, *, tangent: bool = True) -> Linearisation:
        """Return residual and tangent at a state."""
        found = self.problem.linearise(state, tangent=tangent)
        force, volume, data = found.force, found.volume_residual, found.tangent
        if self.overstress is not None:
            gradient = deformation_gradients(self.system.body, state.displacement)
            force = force + self._pull(gradient @ self.overstress)
            data = data + self._stiffness if data.size else data
        if self.support is not None:
            force = force + self.support.push(state.displacement)
            data = data + self.support.data if data.size else data
        if self.swelling is not None:
            volume = volume - self._grown
        residual = self.problem.condensed(force, volume, found) if tangent else NOTHING
        return found._replace(residual=residual, force=force, volume_residual=volume, tangent=data)

    def products(
        self, state: MechanicalState, directions: Sequence[MechanicalState]
    ) -> list[tuple[Floats, Floats]]:
        """Return the mixed problem's tangent applied to directions."""
        return [
            (force + self._further(direction.displacement), volume)
            for (force, volume), direction in zip(
                self.problem.products(state, directions), directions, strict=True
            )
        ]

    def _further(self, displacement: Floats) -> Floats:
        """Return the contribution of overstress and springs along a direction, (n_nodes, 3)."""
        force = np.zeros_like(displacement)
        if self.overstress is not None:
            rate = deformation_gradients(self.system.body, displacement) - np.eye(3)
            force += self._pull(rate @ self.overstress)
        if self.support is not None:
            force += self.support.push(displacement)
        return force

    def condensed(self, force: Floats, volume_residual: Floats, factors: Linearisation) -> Floats:
        """Return a residual on the free unknowns, its volume equation eliminated."""
        return self.problem.condensed(force, volume_residual, factors)

    def pressure_increment(
        self, factors: Linearisation, displacement: Floats, volume_residual: Floats | None = None
    ) -> Floats:
        """Return the pressure increments that go with a displacement increment."""
        return self.problem.pressure_increment(factors, displacement, volume_residual)

    def cavity_gradient(self, state: MechanicalState) -> Floats:
        """Return the derivative of the cavity volume with respect to the displacement."""
        return self.problem.cavity_gradient(state)

    def cavity_volume(self, state: MechanicalState) -> float:
        """Return the volume of the half model's cavity."""
        return self.problem.cavity_volume(state)

    def _pull(self, stress: Floats) -> Floats:
        """Return ∫ P : ∇v of a first Piola–Kirchhoff stress, (n_nodes, 3)."""
        body = self.system.body
        force = np.zeros_like(body.nodes)
        weighed = np.ascontiguousarray(stress * body.weights[..., None, None])
        every = np.arange(len(body.elements), dtype=np.int64)
        kernels.add_pull(weighed, every, body.elements, body.gradients, force)
        return force

    @cached_property
    def _grown(self) -> Floats:
        assert self.swelling is not None
        body = self.system.body
        return (body.weights * (self.swelling - 1.0)) @ body.element.modes

    @cached_property
    def _stiffness(self) -> Floats:
        """∫ ∇v · H ∇u for each component, in the order of the system's upper triangle."""
        assert self.overstress is not None
        body, at = self.system.body, self.system.solid_at
        weighed = self.overstress * body.weights[..., None, None]
        turned = np.einsum("eqij,eqja->eqia", weighed, body.gradients, optimize=True)
        blocks = np.einsum("eqia,eqib->eab", body.gradients, turned, optimize=True)
        rows, columns = stored_pairs(body.elements.shape[1])
        count = body.elements.shape[1]
        alike = rows // count == columns // count
        values = blocks[:, rows[alike] % count, columns[alike] % count]
        places = at[:, alike]
        known = places >= 0
        size = self.system.upper.nnz
        found: Floats = np.bincount(places[known], values[known], minlength=size)
        return found


def excess_of(gradient: Floats) -> Floats:
    """Return Ī₁ − 3 of a deformation gradient, (…)."""
    volume = np.linalg.det(gradient)
    excess: Floats = volume ** (-2.0 / 3.0) * np.sum(gradient**2, axis=(-2, -1)) - 3.0
    return np.maximum(excess, 0.0)


def energy_of(constants: Floats, gradient: Floats) -> Floats:
    """Return Σ cᵢ (Ī₁ − 3)ⁱ (…) for constants (…, 4) [C1]."""
    x = excess_of(gradient)
    c1, c2, c3 = np.moveaxis(constants[..., :3], -1, 0)
    energy: Floats = x * (c1 + x * (c2 + c3 * x))
    return energy


def isochoric_stress(constants: Floats, gradient: Floats) -> Floats:
    """Return the second Piola–Kirchhoff stress 2 W' J^(−2/3) (I − ⅓ I₁ C⁻¹), (…, 3, 3) [C1]."""
    right = np.swapaxes(gradient, -1, -2) @ gradient
    x = excess_of(gradient)
    c1, c2, c3 = np.moveaxis(constants[..., :3], -1, 0)
    slope = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
    isochoric = np.linalg.det(right) ** (-1.0 / 3.0)
    first = np.trace(right, axis1=-2, axis2=-1)
    inner = np.eye(3) - first[..., None, None] / 3.0 * np.linalg.inv(right)
    stress: Floats = (2.0 * slope * isochoric)[..., None, None] * inner
    return stress


class Memory(Protocol):
    """The history of a material, and its resulting state."""

    @property
    def longest(self) -> float:
        """Longest accurate time step [s]; inf if time has no effect."""

    @property
    def follows_state(self) -> bool:
        """Whether the field depends on the unknown state."""

    def field(self, span: float, gradient: Floats) -> Field:
        """Return the field of a step that ends ``span`` after the last, at F = ``gradient``."""

    def after(self, span: float, gradient: Floats) -> "Memory":
        """Return the memory after that step."""


@dataclass(frozen=True)
class Elastic:
    """No memory: the field is constant.

    Parameters
    ----------
    kept : Field
        The field at all times.
    """

    kept: Field
    longest: float = np.inf
    follows_state: bool = False

    def field(self, span: float, gradient: Floats) -> Field:
        """Return the field."""
        return self.kept

    def after(self, span: float, gradient: Floats) -> Self:
        """Return itself."""
        return self


@dataclass(frozen=True)
class Viscous:
    r"""Stress that relaxes by a Prony series about the elastic law of a fast test.

    .. math:: S(t) = \int_0^t \Big(1 - \sum_k g_k \big(1 - e^{-(t - s)/\tau_k}\big)\Big)\, dS^e(s)

    A step is exact where :math:`S^e` grows linearly (Taylor, Pister, Goudreau).

    Parameters
    ----------
    constants : array, shape (n_elements, n_points, 4)
        Constants of the elastic law [C1].
    shares : tuple of float
        g_k, shares of the stress that finally relax; their sum is below 1 [–].
    times : tuple of float
        τ_k [s].
    stress, late : array, optional
        Sᵉ at the end of the last step, and the unrelaxed part of each share [C1].

    References
    ----------
    Taylor, Pister, Goudreau (1970), doi:10.1002/nme.1620020106; Simo (1987),
    doi:10.1016/0045-7825(87)90107-1.
    """

    constants: Floats
    shares: tuple[float, ...]
    times: tuple[float, ...]
    stress: Floats | None = None
    late: tuple[Floats, ...] = ()
    follows_state: bool = False

    @property
    def longest(self) -> float:
        """A third of the shortest time constant [s]."""
        return min(self.times) / 3.0

    def field(self, span: float, gradient: Floats) -> Field:
        """Return the instantaneous constants, and the overstress from the history."""
        factor = 1.0
        overstress = np.zeros((*self.constants.shape[:2], 3, 3))
        for share, mean, kept, late in self._terms(span):
            factor -= share * (1.0 - mean)
            overstress = overstress + kept * late - share * mean * self._last
        return Field(factor * self.constants, overstress)

    def after(self, span: float, gradient: Floats) -> Self:
        """Return the memory with this step's stress."""
        now = isochoric_stress(self.constants, gradient)
        late = tuple(
            kept * before + share * mean * (now - self._last)
            for share, mean, kept, before in self._terms(span)
        )
        return replace(self, stress=now, late=late)

    @property
    def _last(self) -> Floats:
        return np.zeros((1, 1, 3, 3)) if self.stress is None else self.stress

    def _terms(self, span: float) -> list[tuple[float, float, float, Floats]]:
        """Share, (1 − e^(−x))/x, e^(−x) with x = span/τ, and the unrelaxed stress, of each term."""
        ages = [span / time for time in self.times]
        late = self.late or tuple(np.zeros((1, 1, 3, 3)) for _ in ages)
        return [
            (share, float(-np.expm1(-x) / x) if x > 0.0 else 1.0, float(np.exp(-x)), before)
            for share, x, before in zip(self.shares, ages, late, strict=True)
        ]


@dataclass(frozen=True)
class Softened:
    r"""The Mullins effect by pseudo-elasticity, with a separate history at each point.

    .. math:: P = \eta\, \partial W/\partial F + p\, J F^{-T}, \qquad
        \eta = 1 - \frac1r\, \mathrm{erf}\frac{W_m - W}{m + \beta W_m}

    with :math:`W_m` the largest energy so far at the point.

    Parameters
    ----------
    constants : array, shape (n_elements, n_points, 4)
        Constants of the first loading [C1].
    r, beta : float
        r ≥ 1 and β ≥ 0 [–].
    m : float
        Energy at which softening sets in [C1].
    largest : array, shape (n_elements, n_points), optional
        W_m so far [C1].

    References
    ----------
    Ogden and Roxburgh (1999), doi:10.1098/rspa.1999.0431; β of Mars and Fatemi (2004),
    doi:10.1115/1.1631026.
    """

    constants: Floats
    r: float
    m: float
    beta: float = 0.0
    largest: Floats | None = None
    longest: float = np.inf
    follows_state: bool = True

    def field(self, span: float, gradient: Floats) -> Field:
        """Return the constants times η."""
        energy = energy_of(self.constants, gradient)
        most = self._most(energy)
        eta = 1.0 - erf((most - energy) / (self.m + self.beta * most)) / self.r
        return Field(self.constants * eta[..., None])

    def after(self, span: float, gradient: Floats) -> Self:
        """Return the memory with this step's energy."""
        return replace(self, largest=self._most(energy_of(self.constants, gradient)))

    def _most(self, energy: Floats) -> Floats:
        return energy if self.largest is None else np.maximum(energy, self.largest)


class Water(NamedTuple):
    """Drying of a material, and its effects.

    Parameters
    ----------
    diffusivity : float
        D [mm²/s]; 1e-5 are 1e-11 m²/s.
    transfer : float
        k, water transfer coefficient from surface to air [mm/s].
    fall : float
        Fall of the equilibrium content in the air, over that in storage [–].
    stiffening : float
        Gain of ln stiffness after the full fall [–].
    shrinkage : float
        Share of the volume lost after the full fall [–].
    """

    diffusivity: float
    transfer: float
    fall: float = 1.0
    stiffening: float = 0.15
    shrinkage: float = 0.0


@dataclass(frozen=True, eq=False)
class Drying:
    r"""Water that leaves through the faces exposed to air.

    .. math:: \dot c = D \nabla^2 c, \qquad -D\, \partial c/\partial n = k\, (c + f)
        \text{ on faces in the air}, \qquad c_0 = 0

    by finite elements on the bricks of the body, backward Euler; paper, chambers and the clamp are
    impermeable. Stiffness is multiplied by exp(−a c), volume by 1 + b c.

    Parameters
    ----------
    diffusion : Diffusion
        Diffusion elements of the body.
    constants : array, shape (n_elements, n_points, 4)
        Constants in storage [C1].
    water : Water
        Drying laws.
    content : array, shape (n_nodes,), optional
        Current c; 0 by default.
    step : float
        Longest time step [s].

    References
    ----------
    Crank (1975), The mathematics of diffusion, chapter 4.
    """

    diffusion: "Diffusion"
    constants: Floats
    water: Water
    content: Floats | None = None
    step: float = 30.0
    follows_state: bool = False

    @property
    def longest(self) -> float:
        """Longest time step [s]."""
        return self.step

    def field(self, span: float, gradient: Floats) -> Field:
        """Return stiffness and volume at the end of the step."""
        content = self.diffusion.at_points(self._later(span))
        stiffer = np.exp(-self.water.stiffening * content)
        swelling = 1.0 + self.water.shrinkage * content if self.water.shrinkage else None
        return Field(self.constants * stiffer[..., None], swelling=swelling)

    def after(self, span: float, gradient: Floats) -> Self:
        """Return the memory with the remaining water."""
        return replace(self, content=self._later(span))

    def _later(self, span: float) -> Floats:
        start = np.zeros(self.diffusion.count) if self.content is None else self.content
        if span == 0.0:
            return start
        return self.diffusion.later(start, self.water, span)


@dataclass(frozen=True, eq=False)
class Diffusion:
    """Scalar finite elements on the bricks of a body, for diffusion through its faces.

    Parameters
    ----------
    body : Body
        A body of bricks with straight edges.
    surface : array of int
        Nodes on faces exposed to air or soil.
    stiffness, masses, exchange : scipy.sparse.csr_array
        ∫ ∇v · ∇c and ∫ v c over the body, and ∫ v c over those faces.
    """

    body: Body
    surface: Indices
    stiffness: sp.csr_array
    masses: sp.csr_array
    exchange: sp.csr_array

    @classmethod
    def on(cls, body: Body) -> Self:
        """Return the elements on a body, open on all outer faces without paper or clamp."""
        basis, faces = Spaces.on(body).displacement, open_faces(body)
        forms = (laplace, basis), (mass, basis), (mass, on_faces(basis, faces))
        return cls(body, np.unique(faces), *(sp.csr_array(asm(*form)) for form in forms))

    @property
    def count(self) -> int:
        """Number of nodes."""
        return len(self.body.nodes)

    def later(self, content: Floats, water: Water, span: float) -> Floats:
        """Return the content after a span of time [s], by one step of backward Euler."""
        open_air = span * water.transfer * self.exchange
        matrix = self.masses + span * water.diffusivity * self.stiffness + open_air
        right = self.masses @ content - water.fall * open_air.sum(axis=1)
        return np.asarray(sparse_linalg.spsolve(sp.csc_array(matrix), right), dtype=np.float64)

    def stationary(self, depth: float) -> Floats:
        """Return u of ∇²u = u/ℓ², 1 on the open faces, (n_nodes,); ℓ = ``depth`` [mm]."""
        inner = np.setdiff1d(np.arange(self.count), self.surface)
        rows = sp.csr_array(self.stiffness + self.masses / depth**2)[inner]
        found = np.ones(self.count)
        push = -rows[:, self.surface] @ found[self.surface]
        found[inner] = sparse_linalg.spsolve(sp.csc_array(rows[:, inner]), push)
        return found

    def at_points(self, field: Floats) -> Floats:
        """Return a field over the nodes at every quadrature point, (n_elements, n_points)."""
        at: Floats = field[self.body.elements] @ self.body.element.shapes.T
        return at


def open_faces(body: Body) -> Indices:
    """Return outer faces except those of the cavity, under paper, clamped or in the symmetry plane.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> len(open_faces(box((3.0, 2.0, 1.0), divisions=(1, 1, 1))))  # top, bottom, end, one side
    4
    """
    faces = boundary_faces(body)
    middle = faces.shape[1] // 2
    covered = np.concatenate([body.cavity[:, middle], body.paper[:, middle]])
    at = body.nodes[faces].mean(axis=1)
    inside = np.isclose(at[:, 0], 0.0) | np.isclose(at[:, 1], 0.0)
    return faces[~inside & ~np.isin(faces[:, middle], covered)]


def reacted(diffusion: Diffusion, depth: float, degradation: float) -> Floats:
    r"""Return the degradation rate at every quadrature point, (n_elements, n_points) [%].

    The degrading agent diffuses in through the open faces and is consumed,
    :math:`D \nabla^2 u = k u`; the rate is proportional to u, and its volume mean is what a
    moisture measurement gives.

    Parameters
    ----------
    diffusion : Diffusion
        Diffusion elements of the body.
    depth : float
        :math:`\ell = \sqrt{D/k}` at moulded size [mm].
    degradation : float
        Mean over the volume [%].

    References
    ----------
    Thiele (1939), doi:10.1021/ie50355a027.
    """
    profile = diffusion.at_points(diffusion.stationary(depth))
    weights = diffusion.body.weights
    rate: Floats = degradation * profile * np.sum(weights) / np.sum(profile * weights)
    return rate


class Schedule(NamedTuple):
    """A test of one actuator.

    Parameters
    ----------
    load : array, shape (n,)
        p/C1 at each reading [–]; set right after the previous reading.
    held : array, shape (n,)
        Hold time before each reading [s].
    """

    load: Floats
    held: Floats


@dataclass
class FieldBody:
    """A body whose material has a memory, from one equilibrium to the next.

    Parameters
    ----------
    body : Body
        Body with its fixed, pressurised and papered faces.
    material : MaterialGroups
        Paper, bulk modulus, and the body unless a memory overrides it.
    effort : PathEffort
        Effort of each equilibrium.
    clamp : Clamp, optional
        Springs that hold the end face of a released body.
    """

    body: Body
    material: MaterialGroups
    effort: PathEffort = EFFORT
    clamp: Clamp | None = None

    @cached_property
    def system(self) -> System:
        """Numbering and sparsity."""
        return System(self.body)

    @cached_property
    def support(self) -> ClampSprings | None:
        """The springs of the clamp; None if it is rigid."""
        return None if self.clamp is None else ClampSprings.on(self.system, self.clamp)

    @cached_property
    def solver(self) -> Factorization:
        """The direct solver, analysed once."""
        return open_factorization(self.system.upper)

    @property
    def constants(self) -> Floats:
        """Constants at every quadrature point, (n_elements, n_points, 4) [C1]."""
        return local_constants(self.material, self.body)

    @property
    def rest(self) -> LoadStep:
        """The undeformed state."""
        return LoadStep(self.system.rest(), None, None, 0)

    def later(
        self, last: LoadStep, load: float, memory: Memory, span: float
    ) -> tuple[LoadStep, Memory]:
        """Return the equilibrium after a time span, and the updated memory.

        Parameters
        ----------
        last : LoadStep
            The last equilibrium.
        load : float
            p/C1, set at the beginning of the span and held [–].
        memory : Memory
            Memory of the material.
        span : float
            Time span; 0 for an instantaneous step [s].

        Returns
        -------
        LoadStep
            Without a rate if there is no equilibrium.
        Memory
        """
        gradient = deformation_gradients(self.body, last.state.displacement)
        if memory.follows_state:
            last = self._swept(memory, last, load, span)
        else:
            last = self._found(memory.field(span, gradient), last, load)
        if last.rate is None:
            return last, memory
        return last, memory.after(span, deformation_gradients(self.body, last.state.displacement))

    def _swept(self, memory: Memory, last: LoadStep, load: float, span: float) -> LoadStep:
        """Return the equilibrium and its field by alternating iterations."""
        gradient = deformation_gradients(self.body, last.state.displacement)
        field, share, change = memory.field(span, gradient), RELAXED, np.inf
        for _ in range(SWEEPS):
            last = self._found(field, last, load)
            if last.rate is None:
                return last
            gradient = deformation_gradients(self.body, last.state.displacement)
            wanted = memory.field(span, gradient)
            before, change = change, _change(field.constants, wanted.constants)
            if change < SETTLED:
                return last
            share = share if change < LESS * before else 0.5 * share
            mixed = field.constants + share * (wanted.constants - field.constants)
            field = replace(wanted, constants=mixed)
        return replace(last, rate=None)

    def _found(self, field: Field, start: LoadStep, load: float) -> LoadStep:
        problem = Problem(self.system, self.material, local=field.constants)
        equations = FieldEquations(problem, field.overstress, field.swelling, self.support)
        return self._reached(equations, start, load, HALVINGS)

    def _reached(
        self, equations: FieldEquations, start: LoadStep, load: float, halvings: int
    ) -> LoadStep:
        """Return the equilibrium at a load, by shorter steps if necessary."""
        change, guess = load - start.state.load, start.state
        if start.rate is not None:
            u, p = start.rate.displacement, start.rate.pressure
            guess = guess.moved(change * u, change * p)
        guess = replace(guess, load=load)
        found = find_equilibrium(equations, self.solver, guess=guess, effort=self.effort)
        if found.rate is not None or halvings == 0 or change == 0.0:
            return found
        middle = self._reached(equations, start, start.state.load + 0.5 * change, halvings - 1)
        if middle.rate is None:
            return middle
        return self._reached(equations, middle, load, halvings - 1)


@dataclass
class FieldActuator:
    """A meshed actuator tested with materials that have a memory.

    Parameters
    ----------
    mesh : ActuatorMesh
        Mesh of the geometry.
    material : MaterialGroups
        As in `FieldBody`.
    effort : PathEffort
        Effort of each equilibrium.
    clamp : Clamp, optional
        A compliant clamp; by default the end face is fixed.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.actuator.mesh import COARSE, build_mesh
    >>> from bayesdeg.data.settings import Dimensions
    >>> mesh = build_mesh(Geometry(Dimensions(length=14.0, chambers=1)), COARSE)
    >>> actuator = FieldActuator(mesh, MaterialGroups(0.0, 0.0, paper_group=100.0))
    >>> viscous = Viscous(actuator.body.constants, shares=(0.2,), times=(30.0,))
    >>> quick, slow = (
    ...     actuator.tested(viscous, Schedule(np.array([0.1]), np.array([held])))[0, 0]
    ...     for held in (0.0, 60.0)
    ... )
    >>> round(float(slow / quick), 2)  # bend angles: paper does not creep
    1.24
    """

    mesh: ActuatorMesh
    material: MaterialGroups
    effort: PathEffort = EFFORT
    clamp: Clamp | None = None

    @cached_property
    def body(self) -> FieldBody:
        """The body."""
        body = self.mesh.body if self.clamp is None else released(self.mesh.body)
        return FieldBody(body, self.material, self.effort, self.clamp)

    def clamp_angle(self, state: MechanicalState) -> float:
        """Return the rotation of the clamped end face towards the paper [rad]."""
        if self.clamp is None:
            return 0.0
        body = self.mesh.body
        angle, _ = face_rotation(body, end_face(body), body.nodes + state.displacement, 0.0)
        return angle

    def tested(
        self,
        memory: Memory,
        schedule: Schedule,
        *,
        on_reading: Callable[[], None] | None = None,
        to_horizontal: bool = False,
    ) -> Floats:
        """Return readings, (n, n_outputs) in the order of `OUTPUTS`; nan past a failure.

        The bend angle is that of the free end face relative to the clamped one.

        Parameters
        ----------
        memory : Memory
            Memory of the material before the test.
        schedule : Schedule
            Loads and holds.
        on_reading : callable, optional
            Called after each reading.
        to_horizontal : bool
            Whether the bend angle is relative to the undeformed clamped face, as read by a camera
            that assumes a rigid clamp.
        """
        found = np.full((len(schedule.load), len(OUTPUTS)), np.nan)
        last, angle = self.body.rest, 0.0
        for row, (load, held) in enumerate(zip(*schedule, strict=True)):
            for span in (0.0, *_parts(float(held), memory.longest)):
                last, memory = self.body.later(last, float(load), memory, span)
                if last.rate is None:
                    return found
            assert last.rate is not None
            reading = read_state(self.mesh, last.state, rate=last.rate, previous_angle=angle)
            found[row], angle = reading.values, reading.bend_angle
            if not to_horizontal:
                found[row, 0] -= self.clamp_angle(last.state)
            if on_reading is not None:
                on_reading()
        return found


def _elastic(actuator: FieldActuator, load: Floats) -> Floats:
    """Return readings at loads without memory, (n, 3); independent of the path."""
    loads, places = np.unique(load, return_inverse=True)
    schedule = Schedule(loads, np.zeros(len(loads)))
    read = actuator.tested(Elastic(Field(actuator.body.constants)), schedule)
    return read[places][:, [0, 1, PEAK]]


def _parts(held: float, longest: float) -> list[float]:
    """Split a hold into spans of at most ``longest``; none without a hold."""
    if held <= 0.0 or np.isinf(longest):
        return [held] if held > 0.0 else []
    count = int(np.ceil(held / longest))
    return [held / count] * count


def _change(before: Floats, now: Floats) -> float:
    """Return the largest relative change of C1."""
    return float(np.max(np.abs(now[..., 0] / before[..., 0] - 1.0)))


class FieldMap:
    """A forward map of time-dependent tests of actuators, each with its own material.

    Parameters
    ----------
    geometry : Moulded
        The actuator as moulded.
    resolution : Resolution
        Resolution of the mesh on which fields are solved.
    held : array, shape (n_specimens, n_readings)
        Hold time of each pressure before its reading [s].
    remembering : callable
        Returns the memory of a specimen, given its actuator and index.
    mounting : callable, optional
        Returns how a specimen is made and held, given its index; by default the paper is fully
        bonded and the end face fixed.
    finer : ForwardMap, optional
        Elastic map on a finer mesh: its readings are multiplied by the field's relative effect on
        the coarser mesh, which depends on the mesh far less than readings do.

    Notes
    -----
    The slope of a prediction is not needed and nan. With a finer map, bending without pressure, as
    by shrinkage, is lost.
    """

    def __init__(
        self,
        geometry: Moulded,
        resolution: Resolution,
        held: Floats,
        remembering: Callable[[FieldActuator, int], Memory],
        *,
        mounting: Callable[[int], Mounting] | None = None,
        finer: ForwardMap | None = None,
    ) -> None:
        self.geometry, self.resolution = geometry, resolution
        self.held, self.remembering, self.finer = held, remembering, finer
        self.mounting = mounting or (lambda specimen: Mounting())
        self._meshes: dict[Bond, ActuatorMesh] = {}

    def __call__(self, inputs: Inputs) -> Prediction:
        """Test every specimen; inputs are (1, n_specimens, n_readings).

        Raises
        ------
        ValueError
            If they have a reference pressure.
        """
        if inputs.reference_pressure is not None:
            raise ValueError("a time-dependent test cannot have a reference pressure")
        load = np.broadcast_to(load_of(inputs), (1, *self.held.shape))[0]
        groups = {name: np.ravel(group) for name, group in material_groups(inputs).items()}
        scale = np.broadcast_to(inputs.linear_scale, (1, len(load), 1))[0, :, 0]
        rows = [
            self._tested(load[k], {n: float(g[k % len(g)]) for n, g in groups.items()}, k)
            for k in range(len(load))
        ]
        angle, length, peak = np.moveaxis(np.array(rows), -1, 0)
        return self._predicted(inputs, angle, length * scale[:, None], peak)

    def _tested(self, load: Floats, groups: dict[str, float], specimen: int) -> Floats:
        """Return bend angle, arc length and peak stretch, (n_readings, 3), at moulded size."""
        mounting, material = self.mounting(specimen), MaterialGroups(**groups)
        mesh = self._mesh(mounting.bond)
        actuator = FieldActuator(detached(mesh, mounting.bond), material, clamp=mounting.clamp)
        schedule = Schedule(load, self.held[specimen])
        read = actuator.tested(self.remembering(actuator, specimen), schedule)
        found = read[:, [0, 1, PEAK]]
        if self.finer is not None:
            plain = mounting == Mounting()
            whole = actuator if plain else FieldActuator(mesh, material)
            elastic = _elastic(whole, load)
            if not plain:
                whole.body.solver.close()
            # no bending without pressure
            found = np.divide(found, elastic, out=np.ones_like(found), where=elastic != 0.0)
        actuator.body.solver.close()
        return found

    def _mesh(self, bond: Bond) -> ActuatorMesh:
        """Return the fully bonded mesh with planes where bonding ends; shared by specimens."""
        if bond not in self._meshes:
            cuts = cuts_of(self.geometry, bond)
            self._meshes[bond] = build_mesh(self.geometry, self.resolution, cuts=cuts)
        return self._meshes[bond]

    def _predicted(self, inputs: Inputs, angle: Floats, length: Floats, peak: Floats) -> Prediction:
        none, solved = np.zeros((1, *angle.shape)), np.isfinite(angle)[None]
        status = np.where(solved, int(Status.CONVERGED), int(Status.EFFORT_EXHAUSTED))
        curvature, degrees = 1e3 * angle / length, np.degrees(angle)
        if self.finer is not None:
            fine = self.finer(inputs)
            scale = np.broadcast_to(inputs.linear_scale, fine.curvature.shape)
            curvature = fine.curvature * angle / (length / scale)
            degrees, peak = fine.bend_angle * angle, fine.peak_stretch * peak
            status = np.maximum(status, fine.status)
        shape = none.shape
        return Prediction(
            curvature=np.broadcast_to(curvature, shape),
            bend_angle=np.broadcast_to(degrees, shape),
            peak_stretch=np.broadcast_to(peak, shape),
            slope=np.full(shape, np.nan),
            sd=none,
            bend_angle_sd=none,
            peak_stretch_sd=none,
            status=status,
        )
