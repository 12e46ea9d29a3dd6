"""Compiled element kernels: residual and tangent of the solid, the paper and the cavity.

The solid is a nearly incompressible Yeoh material in isochoric invariants with the pressure as
an independent field, linear and discontinuous over the elements:

    Π(u, p) = ∫ Σ cᵢ (J^(-2/3) I₁ − 3)ⁱ + p (J − 1) − p²/(2 K) dV.

In current gradients g = F⁻ᵀ ∇N and h = F ∇N all second derivatives are sums of outer products
of g and h, so that an element's tangent is three matrix products.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

THIRD = 1.0 / 3.0


@njit(cache=True)
def solid(
    displacement: Floats,
    pressure: Floats,
    elements: Indices,
    gradients: Floats,
    weights: Floats,
    modes: Floats,
    inverse_mass: Floats,
    constants: Floats,
    bulk: float,
    residual: Floats,
    coupling: Floats,
    volume_residual: Floats,
    position: Indices,
    data: Floats,
) -> float:  # pragma: no cover - compiled
    """Add the solid's residual and condensed tangent; return the smallest J.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    pressure : array, shape (n_elements, 4)
        Coefficients of the pressure field [c1].
    elements, gradients, weights
        Of ``ActuatorMesh``.
    modes : array, shape (27, 4)
        Pressure modes at the quadrature points.
    inverse_mass : array, shape (n_elements, 4, 4)
        Inverse of ∫ modesᵀ modes dV.
    constants : array, shape (3,)
        Yeoh constants, in units of which everything else is.
    bulk : float
        Bulk modulus.
    residual : array, shape (3 n_nodes,)
        Added to: the internal force, with the pressure condensed.
    coupling : array, shape (n_elements, 4, 81)
        Overwritten: ∫ modes J g dV.
    volume_residual : array, shape (n_elements, 4)
        Overwritten: ∫ modes (J − 1) dV − mass · pressure / bulk.
    position : array, shape (n_elements, 81, 81)
        Where an entry goes in ``data``; −1 where it is not stored.
    data : array
        Added to: entries of the upper triangle of the tangent.
    """
    n_points = weights.shape[1]
    left, right = np.empty((2 * n_points + 4, 81)), np.empty((2 * n_points + 4, 81))
    swapped, weighted = np.empty((n_points, 81)), np.empty((n_points, 81))
    reference, scaled = np.empty((3 * n_points, 27)), np.empty((3 * n_points, 27))
    f, inverse, factor = np.empty((3, 3)), np.empty((3, 3)), np.empty(6)
    smallest = 1e300
    for e in range(weights.shape[0]):
        b, rp, internal = np.zeros((4, 81)), np.zeros(4), np.zeros(81)
        for q in range(n_points):
            gradient = gradients[e, q]
            deformation_gradient(displacement, elements[e], gradient, f)
            jacobian = invert(f, inverse)
            if not jacobian > 0.0:
                return float(jacobian)
            p, w = np.dot(pressure[e], modes[q]), weights[e, q]
            _factors(f, jacobian, w, p, constants, factor)
            _directions(gradient, f, inverse, factor, q, left, right, swapped, weighted, internal)
            reference[3 * q : 3 * q + 3] = gradient.T
            scaled[3 * q : 3 * q + 3] = factor[4] * gradient.T
            b += w * jacobian * np.outer(modes[q], swapped[q])
            rp += w * (jacobian - 1.0 - p / bulk) * modes[q]
            smallest = min(smallest, jacobian)
        coupling[e], volume_residual[e] = b, rp
        left[2 * n_points :], right[2 * n_points :] = b, (bulk * inverse_mass[e]) @ b
        internal += rp @ right[2 * n_points :]
        tangent = left.T @ right
        add_swapped(tangent, swapped.T @ weighted, reference.T @ scaled)
        scatter(elements[e], internal, tangent, residual, position[e], data)
    return smallest


@njit(cache=True)
def deformation_gradient(
    displacement: Floats, nodes: Indices, gradient: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` with F = I + Σ u ⊗ ∇N at one point."""
    for i in range(3):
        for j in range(3):
            total = 1.0 if i == j else 0.0
            for a in range(nodes.shape[0]):
                total += displacement[nodes[a], i] * gradient[a, j]
            out[i, j] = total


@njit(cache=True)
def invert(f: Floats, out: Floats) -> float:  # pragma: no cover - compiled
    """Overwrite ``out`` with F⁻¹ and return det F."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            out[i, m] = f[n, j] * f[o, k] - f[n, k] * f[o, j]
    jacobian = f[0, 0] * out[0, 0] + f[0, 1] * out[1, 0] + f[0, 2] * out[2, 0]
    if jacobian != 0.0:
        out /= jacobian
    return float(jacobian)


@njit(cache=True)
def _directions(
    gradient: Floats,
    f: Floats,
    inverse: Floats,
    factor: Floats,
    q: int,
    left: Floats,
    right: Floats,
    swapped: Floats,
    weighted: Floats,
    internal: Floats,
) -> None:  # pragma: no cover - compiled
    """Fill the rows of one quadrature point with g and h, plain and weighted; add its force."""
    for a in range(27):
        for i in range(3):
            k = 3 * a + i
            g, h = 0.0, 0.0
            for j in range(3):
                g += inverse[j, i] * gradient[a, j]
                h += f[i, j] * gradient[a, j]
            left[2 * q, k] = g
            left[2 * q + 1, k] = h
            right[2 * q, k] = factor[0] * g + factor[1] * h
            right[2 * q + 1, k] = factor[1] * g + factor[2] * h
            swapped[q, k] = g
            weighted[q, k] = factor[3] * g
            internal[k] += factor[5] * g + factor[4] * h


@njit(cache=True)
def _factors(
    f: Floats, jacobian: float, w: float, p: float, constants: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` with the factors of gg, gh, hh, swapped gg, h (and ∇N·∇N) and g."""
    first = 0.0
    for i in range(3):
        for j in range(3):
            first += f[i, j] * f[i, j]
    isochoric = jacobian ** (-2.0 * THIRD)
    x = isochoric * first - 3.0
    w1 = isochoric * (constants[0] + x * (2.0 * constants[1] + 3.0 * constants[2] * x))
    w2 = isochoric * isochoric * (2.0 * constants[1] + 6.0 * constants[2] * x)
    pj = p * jacobian
    out[0] = w * (4.0 / 9.0 * first * w1 + pj + 4.0 / 9.0 * first * first * w2)
    out[1] = w * (-4.0 * THIRD * w1 - 4.0 * THIRD * first * w2)
    out[2] = w * 4.0 * w2
    out[3] = w * (2.0 * THIRD * first * w1 - pj)
    out[4] = w * 2.0 * w1
    out[5] = w * (pj - 2.0 * THIRD * first * w1)


@njit(cache=True)
def add_swapped(
    tangent: Floats, crossed: Floats, plain: Floats
) -> None:  # pragma: no cover - compiled
    """Add Σ g_ak g_bi, given as Σ g_ai g_bk, and the part in proportion to the identity."""
    for a in range(27):
        for i in range(3):
            for c in range(27):
                for k in range(3):
                    tangent[3 * a + i, 3 * c + k] += crossed[3 * a + k, 3 * c + i]
                tangent[3 * a + i, 3 * c + i] += plain[a, c]


@njit(cache=True)
def scatter(
    nodes: Indices,
    force: Floats,
    tangent: Floats,
    residual: Floats,
    position: Indices,
    data: Floats,
) -> None:  # pragma: no cover - compiled
    """Add an element's or a face's force and tangent to the residual and the stored entries."""
    for row in range(force.shape[0]):
        residual[3 * nodes[row // 3] + row % 3] += force[row]
        for column in range(force.shape[0]):
            at = position[row, column]
            if at >= 0:
                data[at] += tangent[row, column]


@njit(cache=True)
def principal_stretch(
    displacement: Floats, elements: Indices, gradients: Floats, stretch: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``stretch`` (n_elements, 27) with the largest principal stretch at each point."""
    deformation = np.empty((3, 3))
    for e in range(stretch.shape[0]):
        nodes = elements[e]
        for q in range(stretch.shape[1]):
            deformation_gradient(displacement, nodes, gradients[e, q], deformation)
            stretch[e, q] = np.sqrt(np.linalg.eigvalsh(deformation.T @ deformation)[2])
