"""The weak form of the actuator in scikit-fem: the reference for the fast kernels.

Find the displacement u, zero where the body is fixed, and the pressure p, such that for all v and q

    ∫ (P(F, p) : ∇v − b · v) dV + ∫ T(F) : ∇v dA + g ∫ cof F N · v dA + D a(u, v) = 0,
    ∫ q (J − 1 − p/K) dV = 0,

with F = I + ∇u, J = det F, cof F = J F⁻ᵀ. The first integral is the body's, under its weight b; the
second that of the paper's membrane; in the third N points from the body into the cavity, so that
cof F N dA = n da is the deformed wall that the gas pressure g pushes. u is triquadratic and p
linear in each brick, without continuity, so that p is eliminated there (Q2/P1disc). P is the
stress of

    W = Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) + p (J − 1),    Ī₁ = J^(−2/3) I₁,  Ī₂ = J^(−4/3) I₂.

The space of u is three times the same scalar one: a matrix of u is made of blocks, one for each
pair of components, and unknowns stand component by component. scikit-fem's ``ElementVector`` gives
the same numbers in three times the time, with nine times the memory for its functions.

One term has no form: a(u, u) = ∫ |∇∇u|² dA, the paper's bending, needs second derivatives of
functions whose slopes jump. Its matrix is that of `paper.bending_matrix`, differences between
neighbouring nodes; it does not depend on u, and both backends share it.

The library is doi:10.21105/joss.02369.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import (
    Basis,
    BilinearForm,
    ElementHex2,
    FacetBasis,
    Functional,
    LinearForm,
    MeshHex,
    MeshHex2,
    asm,
)
from skfem.element import ElementH1
from skfem.helpers import ddot, det, eye, grad, identity, inv, mul, trace, transpose
from skfem.refdom import RefHex

from bayesdeg.actuator.body import QUADRATIC, Body
from bayesdeg.actuator.material import (
    LayerGroups,
    MaterialGroups,
    local_constants,
    skin_profile,
)
from bayesdeg.actuator.problem import NOTHING, Linearisation, MechanicalState, System

Floats = NDArray[np.float64]
Rate = Callable[[Floats], Floats]
"""Derivative of a tensor along a change H of ∇u."""

DEGREE = 2 * QUADRATIC.order + 1  # of polynomials that the quadrature is exact for
MISPLACED = 1e-9  # mm: more than rounding
SMALL = 1e-2  # of q/s: below it use a series, as differences lose digits


@LinearForm
def work(v: Any, w: Any) -> Any:
    """∫ P · ∇v: the work of one component's stress."""
    return np.einsum("j...,j...", w["stress"], grad(v))


@BilinearForm
def stiffness(u: Any, v: Any, w: Any) -> Any:
    """∫ ∇v · A ∇u: its derivative by one component of the displacement."""
    return np.einsum("jl...,j...,l...", w["elasticity"], grad(v), grad(u))


@LinearForm
def load(v: Any, w: Any) -> Any:
    """∫ b v: the work of one component of a load, or the moments of a density."""
    return w["density"] * v


@BilinearForm
def flow(u: Any, v: Any, w: Any) -> Any:
    """∫ (c · ∇u) v: the derivative of a load, or of a volume, by one component."""
    return np.einsum("l...,l...", w["density"], grad(u)) * v


@BilinearForm
def mass(p: Any, q: Any, _: Any) -> Any:
    """∫ p q: the scalar product of pressures."""
    return p * q


@Functional
def enclosed(w: Any) -> Any:
    """−⅓ ∫ x · n: the volume enclosed by walls whose normals point into it."""
    return -np.einsum("i...,i...", w["position"], w["normal"]) / 3.0


class ElementHexLinear(ElementH1):  # type: ignore[misc]
    """Discontinuous linear functions on a brick, 1, x − ½, y − ½, z − ½; scikit-fem has none."""

    interior_dofs = 4
    maxdeg = 1
    dofnames = ("p", "p_x", "p_y", "p_z")
    doflocs = np.full((4, 3), 0.5)
    refdom = RefHex

    def lbasis(self, X: Floats, i: int) -> tuple[Floats, Floats]:
        """Return one function and its slope on the unit cube."""
        if i == 0:
            return np.ones_like(X[0]), np.zeros_like(X)
        slope = np.zeros_like(X)
        slope[i - 1] = 1.0
        return X[i - 1] - 0.5, slope


class Deformation(NamedTuple):
    """Quantities of the deformation gradient for the laws, at every quadrature point.

    F; J, nan where a brick is inverted; G = F⁻ᵀ; C = FᵀF; its invariants I₁ and I₂; and
    M = I₁ F − F C = ½ ∂I₂/∂F. Tensors come first, elements and points last.
    """

    F: Floats
    J: Floats
    G: Floats
    C: Floats
    first: Floats
    second: Floats
    M: Floats

    @property
    def cofactor(self) -> Floats:
        """∂J/∂F = J F⁻ᵀ."""
        area: Floats = self.J * self.G
        return area

    def cofactor_rate(self, H: Floats) -> Floats:
        """J ((G : H) G − G Hᵀ G)."""
        rate: Floats = self.J * (ddot(self.G, H) * self.G - _turned(self.G, H))
        return rate


def deformation(F: Floats) -> Deformation:
    """Return quantities of a deformation gradient for the laws, (3, 3, n_elements, n_points)."""
    volume = det(F)
    J = np.where(volume > 0.0, volume, np.nan)
    C = mul(transpose(F), F)
    first = trace(C)
    M = first * F - mul(F, C)
    return Deformation(F, J, transpose(inv(F)), C, first, 0.5 * ddot(M, F), M)


def _turned(G: Floats, H: Floats) -> Floats:
    """G Hᵀ G = −∂(F⁻ᵀ) : H."""
    turned: Floats = mul(G, mul(transpose(H), G))
    return turned


@dataclass(frozen=True)
class SolidLaw:
    """The solid's energy Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) + p (J − 1).

    Parameters
    ----------
    material : MaterialGroups
        Ratios of the constants to C1.
    c1 : array, shape (n_elements, n_points)
        C1 over its value in the groups: a skin differs from the core [–].
    ratios : array, shape (3, n_elements, n_points), optional
        C2, C3 and r over the local C1, if they differ from those of the groups [–].
    """

    material: MaterialGroups
    c1: Floats
    ratios: Floats | None = None

    def stress(self, at: Deformation, p: Floats) -> Floats:
        """Return P = w'(Ī₁) D₁ + v'(Ī₂) D₂ + p cof F, with Dᵢ = ∂Īᵢ/∂F [C1]."""
        slopes, shapes = self._slopes(at), self._shapes(at)
        total: Floats = p * at.cofactor
        for (slope, _), shape in zip(slopes, shapes, strict=True):
            total = total + slope * shape
        return total

    def stress_rate(self, at: Deformation, p: Floats, H: Floats) -> Floats:
        """Return ∂P/∂F : H = w'' (D₁ : H) D₁ + w' ∂D₁ : H + … + p ∂(cof F) : H [C1]."""
        slopes, shapes, rates = self._slopes(at), self._shapes(at), self._shape_rates(at, H)
        total: Floats = p * at.cofactor_rate(H)
        for (slope, bend), shape, rate in zip(slopes, shapes, rates, strict=True):
            total = total + bend * ddot(shape, H) * shape + slope * rate
        return total

    def _slopes(self, at: Deformation) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """First and second derivatives w', w'' and v', v'' of the energy."""
        m = self.material
        usual = (m.c2_ratio, m.c3_ratio, m.second_invariant_ratio)
        c2, c3, r_ratio = usual if self.ratios is None else self.ratios
        x = at.J ** (-2.0 / 3.0) * at.first - 3.0
        y = at.J ** (-4.0 / 3.0) * at.second
        r = self.c1 * r_ratio
        return (
            (self.c1 * (1.0 + 2.0 * c2 * x + 3.0 * c3 * x**2), self.c1 * (2.0 * c2 + 6.0 * c3 * x)),
            (0.5 * r / np.sqrt(y), -0.25 * r / (y * np.sqrt(y))),
        )

    def _shapes(self, at: Deformation) -> tuple[Floats, Floats]:
        """D₁ = J^(−2/3) (2F − ⅔ I₁ G) and D₂ = J^(−4/3) (2M − 4⁄3 I₂ G)."""
        return (
            at.J ** (-2.0 / 3.0) * (2.0 * at.F - 2.0 / 3.0 * at.first * at.G),
            at.J ** (-4.0 / 3.0) * (2.0 * at.M - 4.0 / 3.0 * at.second * at.G),
        )

    def _shape_rates(self, at: Deformation, H: Floats) -> tuple[Floats, Floats]:
        """∂D₁ : H and ∂D₂ : H, with İ₁ = 2 F : H, İ₂ = 2 M : H, Ġ = −G Hᵀ G."""
        first, second, growth = 2.0 * ddot(at.F, H), 2.0 * ddot(at.M, H), ddot(at.G, H)
        G = -_turned(at.G, H)
        C = mul(transpose(H), at.F) + mul(transpose(at.F), H)
        M = first * at.F + at.first * H - mul(H, at.C) - mul(at.F, C)
        of_first = 2.0 * H - 2.0 / 3.0 * (first * at.G + at.first * G)
        of_second = 2.0 * M - 4.0 / 3.0 * (second * at.G + at.second * G)
        one, other = self._shapes(at)
        return (
            at.J ** (-2.0 / 3.0) * of_first - 2.0 / 3.0 * growth * one,
            at.J ** (-4.0 / 3.0) * of_second - 4.0 / 3.0 * growth * other,
        )


@dataclass(frozen=True)
class PaperLaw:
    """The membrane's energy k Ψ(q), k = Et/(1 − ν²), q² = E : Q, Q = (1 − ν) E + ν (tr E) I.

    E = ½ (LᵀL − I) is the Green strain in the plane z = 0 of a paper that was longer by the
    mismatch m before it was bonded: L has the first two columns of F over 1 + m. Without slack
    Ψ = ½ q², St. Venant–Kirchhoff; with slack s, Ψ = ½ q² − s² ln cosh(q/s).

    Parameters
    ----------
    stiffness : float
        Et [C1 mm].
    poisson, slack, mismatch : float
        ν, s and m [–].
    """

    stiffness: float
    poisson: float
    slack: float
    mismatch: float

    def stress(self, F: Floats) -> Floats:
        """Return T = ∂W/∂F for the energy W an area of the body, its third column 0 [C1 mm]."""
        L, direction, share, _ = self._strained(F)
        return self._on_body(mul(L, self._k * share * direction))

    def stress_rate(self, F: Floats, H: Floats) -> Floats:
        """Return ∂T/∂F : H, with Ṡ = k (φ Q(Ė) + φ'/q (Q : Ė) Q) of S = k φ Q."""
        L, direction, share, steepness = self._strained(F)
        change = self._on_paper(H)
        strain = 0.5 * (mul(transpose(L), change) + mul(transpose(change), L))
        rate = share * self._direction(strain) + steepness * ddot(direction, strain) * direction
        return self._on_body(self._k * (mul(change, share * direction) + mul(L, rate)))

    @property
    def _k(self) -> float:
        return self.stiffness / (1.0 - self.poisson**2)

    def _on_paper(self, F: Floats) -> Floats:
        return F[:, :2] / (1.0 + self.mismatch)

    def _on_body(self, stress: Floats) -> Floats:
        """Convert the stress per area of the paper, by L, to that per area of the body, by F."""
        normal = np.zeros_like(stress[:, :1])
        return (1.0 + self.mismatch) * np.concatenate([stress, normal], axis=1)

    def _direction(self, E: Floats) -> Floats:
        direction: Floats = (1.0 - self.poisson) * E + self.poisson * eye(trace(E), 2)
        return direction

    def _strained(self, F: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return L, Q, and the share of stress left by slack: φ = Ψ'/q, and φ'(q)/q."""
        L = self._on_paper(F)
        C = mul(transpose(L), L)
        E = 0.5 * (C - identity(C))
        Q = self._direction(E)
        square = np.maximum(ddot(Q, E), 0.0)
        if self.slack == 0.0:
            return L, Q, np.ones_like(square), np.zeros_like(square)
        # of x = q/s: f = 1 − tanh(x)/x, and f'(x)/x
        x = np.sqrt(square) / self.slack
        y, z = np.minimum(x, SMALL) ** 2, np.maximum(x, SMALL)
        t = np.tanh(z)
        series = y / 3.0 - 2.0 * y**2 / 15.0 + 17.0 * y**3 / 315.0
        slope = 2.0 / 3.0 - 8.0 * y / 15.0 + 34.0 * y**2 / 105.0
        share = np.where(x < SMALL, series, 1.0 - t / z)
        steepness = np.where(x < SMALL, slope, (t / z - 1.0 + t**2) / z**2)
        return L, Q, share, steepness / self.slack**2


@dataclass(frozen=True, eq=False)
class Spaces:
    """The finite element spaces on a body, and its surfaces.

    Parameters
    ----------
    displacement : Basis
        Triquadratic functions of the body, for each component.
    pressure : Basis
        Linear functions of each brick.
    cavity, paper : FacetBasis
        ``displacement`` on the walls of the cavity and under the paper.
    inverse_mass : scipy.sparse.csr_array
        Inverse of ∫ p q dV.
    """

    displacement: Basis
    pressure: Basis
    cavity: FacetBasis
    paper: FacetBasis
    inverse_mass: sp.csr_array

    @classmethod
    def on(cls, body: Body) -> Self:
        """Return the spaces on the bricks of a body, which number its nodes as it does.

        Raises
        ------
        ValueError
            If its element is not Q2/P1disc, or its nodes are ordered differently.
        """
        if body.element is not QUADRATIC:
            raise ValueError(f"the weak form knows {QUADRATIC.name} only, not {body.element.name}")
        corners = body.elements[:, :8]
        points = body.nodes[: int(corners.max()) + 1]
        mesh = MeshHex(np.ascontiguousarray(points.T), np.ascontiguousarray(corners.T))
        displacement = Basis(mesh, ElementHex2(), intorder=DEGREE)
        if np.abs(displacement.doflocs.T - body.nodes).max() > MISPLACED:  # bent bricks
            curved = replace(MeshHex2.from_mesh(mesh), doflocs=np.ascontiguousarray(body.nodes.T))
            displacement = Basis(curved, ElementHex2(), intorder=DEGREE)
        same = np.array_equal(displacement.element_dofs.T, body.elements)
        if not same or np.abs(displacement.doflocs.T - body.nodes).max() > MISPLACED:
            raise ValueError("the weak form needs nodes in scikit-fem's order")
        pressure = displacement.with_element(ElementHexLinear())
        return cls(
            displacement,
            pressure,
            on_faces(displacement, body.cavity),
            on_faces(displacement, body.paper),
            sp.csr_array(mass.elemental(pressure).inverse().tocsr()),
        )


def on_faces(basis: Basis, faces: NDArray[np.int64]) -> FacetBasis:
    """Return a basis on faces, each found by its middle node: a facet has one."""
    middles = faces[:, faces.shape[1] // 2]
    facets = np.searchsorted(basis.facet_dofs[0], middles)
    return FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=DEGREE)


def gradient(basis: Basis, field: Floats) -> Floats:
    """Return ∂u_i/∂X_J of a field over the nodes, (3, 3, n_elements, n_points)."""
    return np.stack([basis.interpolate(component).grad for component in field.T])


def deformation_gradient(basis: Basis, displacement: Floats) -> Floats:
    """Return F = I + ∇u, (3, 3, n_elements, n_points)."""
    slope = gradient(basis, displacement)
    F: Floats = identity(slope) + slope
    return F


def on_normal(tensor: Floats, basis: FacetBasis) -> Floats:
    """Return a tensor applied to the normals of faces, (3, n_faces, n_points)."""
    turned: Floats = mul(tensor, np.asarray(basis.normals))
    return turned


def assembled_force(basis: Basis, stress: Floats) -> Floats:
    """Return ∫ P : ∇v of all test functions, (n_nodes, 3)."""
    return np.stack([asm(work, basis, stress=row) for row in stress], axis=1)


def assembled_load(basis: Basis, density: Sequence[float] | Floats) -> Floats:
    """Return ∫ b · v of all test functions, (n_nodes, 3)."""
    return np.stack([asm(load, basis, density=b) for b in density], axis=1)


def assembled_stiffness(basis: Basis, elasticity: Floats) -> sp.csr_array:
    """Return ∫ ∇v : A : ∇u, (3 n_nodes, 3 n_nodes), from A_iJkL."""
    blocks = [
        [asm(stiffness, basis, elasticity=elasticity[i, :, k]) for k in range(3)] for i in range(3)
    ]
    return sp.csr_array(sp.block_array(blocks))


def assembled_load_rate(basis: Basis, rate: Floats) -> sp.csr_array:
    """Return ∫ v · (∂b/∂F : ∇u), (3 n_nodes, 3 n_nodes), from ∂b_i/∂F_kL."""
    blocks = [[asm(flow, basis, density=rate[i, k]) for k in range(3)] for i in range(3)]
    return sp.csr_array(sp.block_array(blocks))


def by_gradient(rate: Rate) -> Floats:
    """Return the derivative by F_kL from those along changes of one entry of F.

    The axes of k and L come before those of elements and points.
    """
    entries = np.eye(9).reshape(3, 3, 3, 3, 1, 1)
    columns = [[rate(entries[k, j]) for j in range(3)] for k in range(3)]
    return np.moveaxis(np.array(columns), (0, 1), (-4, -3))


@dataclass(frozen=True, eq=False)
class WeakForm:
    """The equations of an actuator, assembled by scikit-fem: drop-in for ``Problem``.

    Some forty times slower than the kernels, and equal to rounding. Only the uncondensed force on
    nodes fixed in the plane of symmetry, a reaction, differs: there the kernels differentiate the
    volume, which has an edge in that plane.

    Parameters
    ----------
    system : System
        Numbering of the unknowns, and the matrix of the paper's bending.
    material : MaterialGroups
        In units of C1.
    spaces : Spaces
        On the system's body.
    share : float
        Share of the dead loads and of the paper's mismatch that acts [–].

    Examples
    --------
    >>> from bayesdeg.actuator.mesh import COARSE, build_mesh
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> system = System(build_mesh(Geometry(Dimensions(length=14.0, chambers=1)), COARSE).body)
    >>> material = MaterialGroups(c2_ratio=0.0, c3_ratio=0.0, paper_group=100.0)
    >>> form = WeakForm(system, material, Spaces.on(system.body))
    >>> round(form.cavity_volume(system.rest()), 6)  # of the half model [mm³]
    144.0
    """

    system: System
    material: MaterialGroups
    spaces: Spaces
    share: float = 1.0
    layer: LayerGroups | None = None

    def with_share(self, share: float) -> Self:
        """Return the problem with a different share of its dead loads."""
        return replace(self, share=share)

    @property
    def has_dead_load(self) -> bool:
        """Whether any load acts at zero pressure."""
        return any(self._gravity) or self.material.paper_mismatch != 0.0

    @property
    def _gravity(self) -> tuple[float, float, float]:
        return self.material.gravity_along, 0.0, self.material.gravity_up

    @cached_property
    def _solid(self) -> SolidLaw:
        if self.layer is not None:
            constants = local_constants(self.material, self.system.body, self.layer)
            c1 = constants[..., 0]
            return SolidLaw(self.material, c1, np.moveaxis(constants[..., 1:], -1, 0) / c1)
        contrast = self.material.skin
        local = np.exp(contrast * skin_profile(self.system.body)) if contrast else np.ones(1)
        return SolidLaw(self.material, local)

    @cached_property
    def _paper(self) -> PaperLaw:
        m = self.material
        mismatch = self.share * m.paper_mismatch
        return PaperLaw(m.paper_group, m.paper_poisson, m.paper_slack, mismatch)

    @cached_property
    def _bending(self) -> sp.csr_array:
        """The paper's bending stiffness times ∫ ∇∇v : ∇∇u, component by component."""
        m = self.material
        rigidity = m.paper_group * m.paper_thickness**2 / (12.0 * (1.0 - m.paper_poisson**2))
        order = np.arange(self.system.bending.shape[0]).reshape(-1, 3).T.ravel()
        return sp.csr_array(rigidity * self.system.bending[order][:, order])

    def linearise(self, state: MechanicalState, *, tangent: bool = True) -> Linearisation:
        """Return residual and tangent at a state, see `DiscreteEquations`."""
        at, p = self._in_body(state)
        spaces, coupling = self.spaces, None
        if tangent:  # B: ∫ q cof F : ∇u, unknowns component by component
            rows = [
                asm(flow, spaces.displacement, spaces.pressure, density=row) for row in at.cofactor
            ]
            coupling = sp.csr_array(sp.hstack(rows))
        excess = asm(load, spaces.pressure, density=at.J - 1.0 - p / self.material.bulk_ratio)
        lin = Linearisation(
            residual=NOTHING,
            tangent=NOTHING if coupling is None else self._tangent(state, coupling),
            force=self._force(state),
            coupling=coupling,
            volume_residual=excess.reshape(state.pressure.shape),
            smallest_jacobian=float(np.min(np.nan_to_num(at.J, nan=-np.inf))),
            cavity_volume=self.cavity_volume(state),
        )
        if coupling is None:
            return lin
        return lin._replace(residual=self.condensed(lin.force, lin.volume_residual, lin))

    def _in_body(self, state: MechanicalState) -> tuple[Deformation, Floats]:
        p = np.asarray(self.spaces.pressure.interpolate(state.pressure.ravel()))
        return deformation(deformation_gradient(self.spaces.displacement, state.displacement)), p

    def _on_wall(self, state: MechanicalState) -> Deformation:
        return deformation(deformation_gradient(self.spaces.cavity, state.displacement))

    def _on_paper(self, state: MechanicalState) -> Floats:
        return deformation_gradient(self.spaces.paper, state.displacement)

    @property
    def _has_paper(self) -> bool:
        return self.material.paper_group > 0.0

    def _force(self, state: MechanicalState) -> Floats:
        """Return the forces of body stress, weight, gas pressure, membrane and paper bending."""
        spaces = self.spaces
        force = assembled_force(spaces.displacement, self._solid.stress(*self._in_body(state)))
        force -= self.share * assembled_load(spaces.displacement, self._gravity)
        force -= state.load * self.cavity_gradient(state)
        if self._has_paper:
            force += assembled_force(spaces.paper, self._paper.stress(self._on_paper(state)))
            force += _by_nodes(self._bending @ _by_components(state.displacement))
        return force

    def _tangent(self, state: MechanicalState, coupling: sp.csr_array) -> Floats:
        """Return the condensed residual's derivative, in the order of the system's pattern."""
        spaces, (at, p), wall = self.spaces, self._in_body(state), self._on_wall(state)
        elasticity = by_gradient(lambda H: self._solid.stress_rate(at, p, H))
        push = by_gradient(lambda H: on_normal(wall.cofactor_rate(H), spaces.cavity))
        parts = [
            assembled_stiffness(spaces.displacement, elasticity),
            coupling.T @ (self._compliance @ coupling),
            state.load * assembled_load_rate(spaces.cavity, push),
        ]
        if self._has_paper:
            F = self._on_paper(state)
            stiff = by_gradient(lambda H: self._paper.stress_rate(F, H))
            parts += [assembled_stiffness(spaces.paper, stiff), self._bending]
        matrix = sp.csr_array(sum(parts))
        matrix.sum_duplicates()
        upper, free = self.system.upper, self.system.free
        places = free % 3 * len(self.system.body.nodes) + free // 3
        rows = np.repeat(places, np.diff(upper.indptr))
        return np.asarray(matrix[rows, places[upper.indices]], dtype=np.float64)

    @property
    def _compliance(self) -> sp.csr_array:
        """K M⁻¹: pressures from volumes."""
        return self.material.bulk_ratio * self.spaces.inverse_mass

    def products(
        self, state: MechanicalState, directions: Sequence[MechanicalState]
    ) -> list[tuple[Floats, Floats]]:
        """Return the mixed problem's tangent applied to directions, as forms linear in v and q."""
        spaces, (at, p), wall = self.spaces, self._in_body(state), self._on_wall(state)
        found = []
        for along in directions:
            u = along.displacement
            slope = gradient(spaces.displacement, u)
            p_rate = np.asarray(spaces.pressure.interpolate(along.pressure.ravel()))
            stress = self._solid.stress_rate(at, p, slope)
            force = assembled_force(spaces.displacement, stress + p_rate * at.cofactor)
            turned = wall.cofactor_rate(gradient(spaces.cavity, u))
            force += state.load * assembled_load(spaces.cavity, on_normal(turned, spaces.cavity))
            force -= along.load * self.cavity_gradient(state)
            if self._has_paper:
                change = self._paper.stress_rate(self._on_paper(state), gradient(spaces.paper, u))
                force += assembled_force(spaces.paper, change)
                force += _by_nodes(self._bending @ _by_components(u))
            density = ddot(at.cofactor, slope) - p_rate / self.material.bulk_ratio
            rate = np.asarray(asm(load, spaces.pressure, density=density), dtype=np.float64)
            found.append((force, rate.reshape(along.pressure.shape)))
        return found

    def condensed(self, force: Floats, volume_residual: Floats, factors: Linearisation) -> Floats:
        """Return f + K Bᵀ M⁻¹ r on the free unknowns."""
        push = factors.coupling.T @ (self._compliance @ volume_residual.ravel())
        return self.system.on_free(force + _by_nodes(push))

    def pressure_increment(
        self, factors: Linearisation, displacement: Floats, volume_residual: Floats | None = None
    ) -> Floats:
        """Return δp = K M⁻¹ (B δu + r)."""
        shape = factors.volume_residual.shape
        volume = factors.coupling @ _by_components(displacement)
        if volume_residual is not None:
            volume = volume + volume_residual.ravel()
        change: Floats = self._compliance @ volume
        return change.reshape(shape)

    def cavity_gradient(self, state: MechanicalState) -> Floats:
        """Return dV/du = −∫ cof F N · v, the force of a unit pressure, (n_nodes, 3) [mm²]."""
        cavity = self.spaces.cavity
        return -assembled_load(cavity, on_normal(self._on_wall(state).cofactor, cavity))

    def cavity_volume(self, state: MechanicalState) -> float:
        """Return V = −⅓ ∫ x · cof F N, the volume of the half model's cavity [mm³].

        The plane of symmetry, which closes it, contributes nothing: x · n = 0 there.
        """
        cavity = self.spaces.cavity
        moved = np.stack([np.asarray(cavity.interpolate(u)) for u in state.displacement.T])
        placed = np.asarray(cavity.global_coordinates()) + moved
        normal = on_normal(self._on_wall(state).cofactor, cavity)
        return float(asm(enclosed, cavity, position=placed, normal=normal))


def _by_components(field: Floats) -> Floats:
    return field.T.ravel()


def _by_nodes(vector: Floats) -> Floats:
    return vector.reshape(3, -1).T
