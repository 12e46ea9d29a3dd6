"""The solid's tangent and residual in scikit-fem's forms, to hold our kernel against.

A mixed Yeoh solid with triquadratic displacements and a discontinuous linear pressure, written as
scikit-fem's example of hyperelasticity (docs/examples/ex36.py) is: every form evaluates its tensor
where it is called, for each pair of basis functions. ``hoisted=True`` evaluates it once and hands
it to the form, which the example does not do.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from forward_case import Floats
from numpy.typing import NDArray
from skfem import Basis, BilinearForm, ElementHex2, ElementVector, LinearForm, MeshHex, asm
from skfem.element import ElementH1
from skfem.helpers import det, grad, identity, inv, transpose
from skfem.refdom import RefHex

from bayesdeg.actuator.body import Body
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.problem import MechanicalState, Problem, System


class ElementHexLinearDiscontinuous(ElementH1):
    """The pressure of Q2/P1disc, 1, x − ½, y − ½, z − ½ on the unit cube; scikit-fem has none."""

    interior_dofs = 4
    maxdeg = 1
    dofnames = ("p", "p_x", "p_y", "p_z")
    doflocs = np.full((4, 3), 0.5)
    refdom = RefHex

    def lbasis(self, X: Floats, i: int) -> tuple[Floats, Floats]:
        if i == 0:
            return np.ones_like(X[0]), np.zeros_like(X)
        slope = np.zeros_like(X)
        slope[i - 1] = 1.0
        return X[i - 1] - 0.5, slope


@dataclass(frozen=True)
class Yeoh:
    """ψ = Σ cᵢ (J^(−2/3) F : F − 3)ⁱ + p (J − 1) − p²/(2 K)."""

    c1: float
    c2: float
    c3: float
    bulk: float

    def parts(self, w):  # type: ignore[no-untyped-def]
        F = grad(w["disp"]) + identity(grad(w["disp"]))
        J = det(F)
        G = transpose(inv(F))
        first = np.einsum("ij...,ij...", F, F)
        scale = J ** (-2.0 / 3.0)
        x = scale * first - 3.0
        slope = self.c1 + 2.0 * self.c2 * x + 3.0 * self.c3 * x**2
        D = 2.0 * scale * (F - first / 3.0 * G)
        return F, J, G, first, scale, slope, 2.0 * self.c2 + 6.0 * self.c3 * x, D

    def stress(self, w):  # type: ignore[no-untyped-def]
        _, J, G, _, _, slope, _, D = self.parts(w)
        return slope * D + w["press"] * J * G

    def volume(self, w):  # type: ignore[no-untyped-def]
        F = grad(w["disp"]) + identity(grad(w["disp"]))
        return det(F) - 1.0 - w["press"] / self.bulk

    def elasticity(self, w):  # type: ignore[no-untyped-def]
        F, J, G, first, scale, slope, bend, D = self.parts(w)
        eye, pj, stiff = identity(F), w["press"] * J, slope * scale
        by_deviator = bend * D - 2.0 / 3.0 * slope * G
        by_volume = (pj - 4.0 / 9.0 * stiff * first) * G - 2.0 / 3.0 * slope * D
        return (
            np.einsum("ij...,kl...->ijkl...", D, by_deviator)
            + np.einsum("ij...,kl...->ijkl...", G, by_volume)
            + (2.0 / 3.0 * stiff * first - pj) * np.einsum("il...,kj...->ijkl...", G, G)
            + 2.0 * stiff * np.einsum("ik...,jl...->ijkl...", eye, eye)
        )

    def coupling(self, w):  # type: ignore[no-untyped-def]
        F = grad(w["disp"]) + identity(grad(w["disp"]))
        return det(F) * transpose(inv(F))


@dataclass(frozen=True)
class Blocks:
    """Tangent and residual of displacement and pressure, not condensed."""

    uu: sp.csr_matrix
    pu: sp.csr_matrix
    pp: sp.csr_matrix
    force: Floats
    volume: Floats


class Forms:
    """The same solid on the same bricks in scikit-fem.

    Parameters
    ----------
    body : Body
        Of Q2/P1disc.
    material : MaterialGroups
        Of the solid.
    """

    def __init__(self, body: Body, material: MaterialGroups) -> None:
        self.law = Yeoh(1.0, material.c2_ratio, material.c3_ratio, material.bulk_ratio)
        vertices = int(body.elements[:, :8].max()) + 1
        mesh = MeshHex(np.ascontiguousarray(body.nodes[:vertices].T), body.elements[:, :8].T.copy())
        kind = ElementHex2()
        order = 2 * body.element.order + 1
        self.displacement = Basis(mesh, ElementVector(kind), intorder=order)
        self.pressure = Basis(mesh, ElementHexLinearDiscontinuous(), intorder=order)
        self.places = self._places(body)

    def _places(self, body: Body) -> NDArray[np.int64]:
        """Where our degree of freedom 3 node + axis stands in scikit-fem's vector."""
        local = self.displacement.element_dofs.reshape(27, 3, -1)
        places = np.empty(3 * len(body.nodes), dtype=np.int64)
        for axis in range(3):
            places[3 * body.elements.T + axis] = local[:, axis]
        apart = self.displacement.doflocs[:, places[::3]] - body.nodes.T
        if np.abs(apart).max() > 1e-9:
            raise AssertionError("scikit-fem numbers the nodes of a brick in another order")
        return places

    def assemble(self, state: MechanicalState, *, hoisted: bool = False) -> Blocks:
        """Assemble all blocks at a state."""
        vector = np.empty(len(self.places))
        vector[self.places] = state.displacement.ravel()
        pressure = np.empty(state.pressure.size)
        pressure[self.pressure.element_dofs.T] = state.pressure
        fields = {
            "disp": self.displacement.interpolate(vector),
            "press": self.pressure.interpolate(pressure),
        }
        law = _Hoisted(self.law, fields) if hoisted else self.law
        return _assembled(law, self.displacement, self.pressure, fields)

    def condensed(self, blocks: Blocks) -> tuple[sp.csr_array, Floats]:
        """Return tangent and residual with the pressure eliminated, in our numbering."""
        at = self.pressure.element_dofs
        rows = np.repeat(at.T[:, :, None], 4, axis=2)
        columns = np.swapaxes(rows, 1, 2)
        modes = np.asarray(blocks.pp[rows.ravel(), columns.ravel()]).reshape(rows.shape)
        inverse = np.linalg.inv(modes).ravel()
        inverted = sp.csr_array((inverse, (rows.ravel(), columns.ravel())), shape=blocks.pp.shape)
        back = sp.csr_array(blocks.pu.T) @ inverted
        tangent = sp.csr_array(blocks.uu) - back @ sp.csr_array(blocks.pu)
        force = blocks.force - back @ blocks.volume
        return tangent[self.places][:, self.places], force[self.places]


class _Hoisted:
    """The law's tensors, evaluated once."""

    def __init__(self, law: Yeoh, fields: dict[str, object]) -> None:
        self._stress, self._volume = law.stress(fields), law.volume(fields)
        self._elasticity, self._coupling = law.elasticity(fields), law.coupling(fields)
        self.bulk = law.bulk

    def stress(self, w):  # type: ignore[no-untyped-def]
        return self._stress

    def volume(self, w):  # type: ignore[no-untyped-def]
        return self._volume

    def elasticity(self, w):  # type: ignore[no-untyped-def]
        return self._elasticity

    def coupling(self, w):  # type: ignore[no-untyped-def]
        return self._coupling


def _assembled(
    law: Yeoh | _Hoisted, displacement: Basis, pressure: Basis, fields: dict[str, object]
) -> Blocks:
    @BilinearForm
    def uu(u, v, w):  # type: ignore[no-untyped-def]
        return np.einsum("ijkl...,ij...,kl...", law.elasticity(w), grad(u), grad(v))

    @BilinearForm
    def pu(u, q, w):  # type: ignore[no-untyped-def]
        return np.einsum("ij...,ij...", law.coupling(w), grad(u)) * q

    @BilinearForm
    def pp(p, q, w):  # type: ignore[no-untyped-def]
        return -p * q / law.bulk

    @LinearForm
    def force(v, w):  # type: ignore[no-untyped-def]
        return np.einsum("ij...,ij...", law.stress(w), grad(v))

    @LinearForm
    def volume(q, w):  # type: ignore[no-untyped-def]
        return law.volume(w) * q

    return Blocks(
        asm(uu, displacement, **fields),
        asm(pu, displacement, pressure, **fields),
        asm(pp, pressure, **fields),
        asm(force, displacement, **fields),
        asm(volume, pressure, **fields),
    )


def agreement(problem: Problem, forms: Forms, state: MechanicalState) -> dict[str, float]:
    """Return the largest differences of tangent and residual over their largest entries."""
    ours = problem.linearise(state)
    free = problem.system.free
    tangent, force = forms.condensed(forms.assemble(state, hoisted=True))
    theirs = sp.csr_array(tangent[free][:, free])
    upper = problem.system.upper
    own = sp.csr_array((ours.tangent, upper.indices, upper.indptr), shape=upper.shape)
    gap = sp.csr_array(sp.triu(theirs) - own)
    # ours with pressure condensed: force + K Bᵀ M⁻¹ r
    return {
        "tangent": float(np.abs(gap.data).max() / np.abs(own.data).max()),
        "residual": float(np.abs(force[free] - ours.residual).max() / np.abs(ours.residual).max()),
    }


def sample(body: Body, *, bulk_ratio: float) -> tuple[Problem, MechanicalState]:
    """Return the bare solid and a state far from rest to assemble at."""
    material = MaterialGroups(
        c2_ratio=-0.014, c3_ratio=0.004, paper_group=0.0, bulk_ratio=bulk_ratio
    )
    generator = np.random.default_rng(1)
    x, _, z = body.nodes.T
    bent = np.column_stack([0.004 * x * z, 0.1 * np.sin(0.2 * x), -0.002 * x * x])
    moved = bent + 0.01 * generator.standard_normal(body.nodes.shape)
    pressure = generator.standard_normal((len(body.elements), body.element.modes.shape[1]))
    return Problem(System(body), material), MechanicalState(moved, pressure, load=0.0)
