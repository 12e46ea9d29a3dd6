"""Fields of an equilibrium at the nodes: strain, stretch, stress."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from skfem import ElementHex1, ElementHex2
from skfem.quadrature import get_quadrature

from bayesdeg.actuator.body import Body, Element, isoparametric
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.system import State

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SMALLEST = 1e-12  # squared stretch that still has a logarithm


@dataclass(frozen=True)
class NodalFields:
    """What a nearly incompressible solid shows at its nodes, at moulded size, in units of C1.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    strain : array, shape (n_nodes, 3, 3)
        Logarithmic (Hencky's) strain ½ ln F Fᵀ in the deformed axes [–].
    mean_stress : array, shape (n_nodes,)
        A third of the trace of Cauchy's stress, positive in tension [C1].
    constants : array, shape (n_nodes, 4)
        C1, C2, C3 and r of the energy [C1].
    """

    displacement: Floats
    strain: Floats
    mean_stress: Floats
    constants: Floats

    @property
    def stretch(self) -> Floats:
        """Largest principal stretch, (n_nodes,), of the part that keeps the volume [–]."""
        stretch: Floats = np.exp(np.linalg.eigvalsh(_deviator(self.strain))[:, -1])
        return stretch

    @property
    def stress(self) -> Floats:
        """Cauchy's stress, (n_nodes, 3, 3) [C1]."""
        return cauchy_stress(self.strain, self.mean_stress, constants=self.constants)


def nodal_fields(problem: Problem, state: State) -> NodalFields:
    """Return fields of an equilibrium at the nodes.

    The strain is taken where it is most accurate, at the Gauss points of the rule one order below
    that of the element (Barlow 1976, doi:10.1002/nme.1620100202), extended to the corners of each
    brick by the polynomial through those points, averaged over the bricks that meet in a corner
    (Hinton and Campbell 1974, doi:10.1002/nme.1620080303), and linear in between. It is the
    logarithmic strain, since any average of it is that of a possible deformation. A homogeneous
    deformation is met exactly. At re-entrant corners the exact field is singular: values there
    grow with refinement.

    Parameters
    ----------
    problem : Problem
        Body and material.
    state : State
        One of its equilibria.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> from bayesdeg.actuator.material import Material
    >>> from bayesdeg.actuator.system import System
    >>> system = System(box((2.0, 1.0, 1.0), divisions=(1, 1, 1)))
    >>> sheared = system.body.nodes[:, [2, 2, 2]] * [1.5, 0.0, 0.0]  # γ = λ − 1/λ
    >>> problem = Problem(system, Material(c2_ratio=0.0, c3_ratio=0.0, paper_group=0.0))
    >>> nodal_fields(problem, State(sheared, np.zeros((1, 4)), 0.0)).stretch[:3].round(12)
    array([2., 2., 2.])
    """
    body, local = problem.system.body, state.displacement[problem.system.body.elements]
    rule = _reduced(body.element)
    gradients, _ = isoparametric(rule, body.nodes[body.elements])
    gradient = np.einsum("eai,eqja->eqij", local, gradients, optimize=True)
    inner = _to_corners(rule, rule.order - 1)
    outer = _to_corners(body.element, 1)
    return NodalFields(
        state.displacement,
        _joined(body, np.einsum("cq,eqij->ecij", inner, logarithmic_strain(np.eye(3) + gradient))),
        _joined(body, state.pressure @ (outer @ body.element.modes).T),
        _joined(body, np.einsum("cq,eqk->eck", outer, problem.constants)),
    )


def logarithmic_strain(deformation_gradient: Floats) -> Floats:
    """Return Hencky's strain ½ ln F Fᵀ of deformation gradients, (..., 3, 3) [–].

    Examples
    --------
    >>> logarithmic_strain(np.diag([np.e, 1.0, 1.0])).diagonal().round(12)
    array([1., 0., 0.])
    """
    f = deformation_gradient
    squares, axes = np.linalg.eigh(f @ np.swapaxes(f, -1, -2))
    return _assembled(0.5 * np.log(np.maximum(squares, SMALLEST)), axes)


def cauchy_stress(strain: Floats, mean_stress: Floats, *, constants: Floats) -> Floats:
    """Return Cauchy's stress, (..., 3, 3), in the unit of the constants.

    σ = σₘ 1 + 2/J dev[w₁ b̄ + w₂ (Ī₁ b̄ − b̄²)] with b̄ = exp(2 dev h), ln J = tr h,
    w₁ = C1 + 2 C2 (Ī₁ − 3) + 3 C3 (Ī₁ − 3)² and w₂ = r/(2 √Ī₂).

    Parameters
    ----------
    strain : array, shape (..., 3, 3)
        Logarithmic strain h [–].
    mean_stress : array, shape (...)
        σₘ.
    constants : array, shape (..., 4)
        C1, C2, C3 and r.

    Examples
    --------
    >>> strain, neo_hookean = np.log(2.0) * np.diag([1.0, -0.5, -0.5]), np.array([1.0, 0, 0, 0])
    >>> stress = cauchy_stress(strain, np.array(7.0 / 3.0), constants=neo_hookean)
    >>> stress.diagonal().round(12) + 0.0  # 2 C1 (λ² − 1/λ) along the load
    array([7., 0., 0.])
    """
    principal, axes = np.linalg.eigh(_deviator(strain))
    b = np.exp(2.0 * principal)
    c1, c2, c3, r = (constants[..., k, None] for k in range(4))
    first = b.sum(axis=-1, keepdims=True)
    x = first - 3.0
    w1 = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
    w2 = 0.5 * r / np.sqrt(0.5 * (first**2 - np.sum(b * b, axis=-1, keepdims=True)))
    inner = w1 * b + w2 * (first * b - b * b)
    volume = np.exp(np.trace(strain, axis1=-2, axis2=-1))[..., None]
    deviator = 2.0 / volume * (inner - inner.mean(axis=-1, keepdims=True))
    return _assembled(mean_stress[..., None] + deviator, axes)


def _assembled(values: Floats, axes: Floats) -> Floats:
    """Return tensors from principal values and axes."""
    tensor: Floats = (axes * values[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return tensor


def _deviator(tensor: Floats) -> Floats:
    trace = np.trace(tensor, axis1=-2, axis2=-1)[..., None, None]
    deviator: Floats = tensor - trace / 3.0 * np.eye(3)
    return deviator


def _places(element: Element) -> Floats:
    """Nodes of the unit cube, (n_local, 3)."""
    return np.asarray((ElementHex1() if element.order == 1 else ElementHex2()).doflocs)


def _reduced(element: Element) -> Element:
    """Return the element with the Gauss rule one order lower."""
    kind = ElementHex1() if element.order == 1 else ElementHex2()
    points, weights = get_quadrature(kind.refdom, 2 * element.order - 1)
    basis = [kind.lbasis(points, a) for a in range(len(kind.doflocs))]
    shapes = np.stack([values for values, _ in basis], axis=1)
    slopes = np.stack([gradients.T for _, gradients in basis], axis=1)
    return replace(element, points=points.T, weights=weights, shapes=shapes, slopes=slopes)


def _to_corners(element: Element, degree: int) -> Floats:
    """Return what takes values at the quadrature points to the corners, (8, n_points)."""
    known = _monomials(element.points, degree)
    places = _places(element)
    corners = places[np.all(places % 1.0 == 0.0, axis=1)]
    extension: Floats = _monomials(corners, degree) @ np.linalg.pinv(known)
    return extension


def _monomials(points: Floats, degree: int) -> Floats:
    """Values of 1, z, y, yz, x, … with each coordinate up to the degree, (n_points, n)."""
    powers = np.array(list(product(range(degree + 1), repeat=3)))
    values: Floats = np.prod(points[:, None, :] ** powers, axis=2)
    return values


def _joined(body: Body, values: Floats) -> Floats:
    """Join values at the corners of bricks, (n_elements, 8, ...), to one field at all nodes."""
    places = _places(body.element)
    corners = np.flatnonzero(np.all(places % 1.0 == 0.0, axis=1))
    average = _average(body.elements[:, corners], values, len(body.nodes))
    linear = _monomials(places, 1) @ np.linalg.inv(_monomials(places[corners], 1))
    between = np.einsum("ac,ec...->ea...", linear, average[body.elements[:, corners]])
    return _average(body.elements, between, len(body.nodes))


def _average(nodes: Indices, values: Floats, count: int) -> Floats:
    """Average over all that meet in each node; nan where nothing does."""
    total = np.zeros((count, *values.shape[2:]))
    np.add.at(total, nodes, values)
    times = np.bincount(nodes.ravel(), minlength=count).astype(np.float64)
    average: Floats = (total.T / np.where(times > 0.0, times, np.nan)).T
    return average
