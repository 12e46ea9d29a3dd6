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
    n_elements, n_points = weights.shape
    n_rows = 2 * n_points + 4
    left = np.empty((n_rows, 81))
    right = np.empty((n_rows, 81))
    swapped = np.empty((n_points, 81))
    weighted = np.empty((n_points, 81))
    reference = np.empty((3 * n_points, 27))
    scaled = np.empty((3 * n_points, 27))
    deformation = np.empty((3, 3))
    inverse = np.empty((3, 3))
    smallest = 1e300
    for e in range(n_elements):
        nodes = elements[e]
        b = np.zeros((4, 81))
        rp = np.zeros(4)
        internal = np.zeros(81)
        for q in range(n_points):
            w = weights[e, q]
            gradient = gradients[e, q]
            for i in range(3):
                for j in range(3):
                    total = 1.0 if i == j else 0.0
                    for a in range(27):
                        total += displacement[nodes[a], i] * gradient[a, j]
                    deformation[i, j] = total
            f = deformation
            jacobian = (
                f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
                - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
                + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
            )
            smallest = min(smallest, jacobian)
            if not jacobian > 0.0:
                return float(jacobian)
            inverse[0, 0] = (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]) / jacobian
            inverse[0, 1] = (f[0, 2] * f[2, 1] - f[0, 1] * f[2, 2]) / jacobian
            inverse[0, 2] = (f[0, 1] * f[1, 2] - f[0, 2] * f[1, 1]) / jacobian
            inverse[1, 0] = (f[1, 2] * f[2, 0] - f[1, 0] * f[2, 2]) / jacobian
            inverse[1, 1] = (f[0, 0] * f[2, 2] - f[0, 2] * f[2, 0]) / jacobian
            inverse[1, 2] = (f[0, 2] * f[1, 0] - f[0, 0] * f[1, 2]) / jacobian
            inverse[2, 0] = (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0]) / jacobian
            inverse[2, 1] = (f[0, 1] * f[2, 0] - f[0, 0] * f[2, 1]) / jacobian
            inverse[2, 2] = (f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]) / jacobian
            first = 0.0
            for i in range(3):
                for j in range(3):
                    first += f[i, j] * f[i, j]
            isochoric = jacobian ** (-2.0 * THIRD)
            x = isochoric * first - 3.0
            w1 = constants[0] + x * (2.0 * constants[1] + 3.0 * constants[2] * x)
            w2 = 2.0 * constants[1] + 6.0 * constants[2] * x
            p = 0.0
            for m in range(4):
                p += pressure[e, m] * modes[q, m]
            pj = p * jacobian
            wi = w1 * isochoric
            dd = w2 * isochoric * isochoric
            gg = w * (4.0 / 9.0 * first * wi + pj + 4.0 / 9.0 * first * first * dd)
            gh = w * (-4.0 * THIRD * wi - 4.0 * THIRD * first * dd)
            hh = w * 4.0 * dd
            cross = w * (2.0 * THIRD * first * wi - pj)
            dot = w * 2.0 * wi
            force_h = w * 2.0 * wi
            force_g = w * (pj - 2.0 * THIRD * first * wi)
            for a in range(27):
                for i in range(3):
                    g = (
                        inverse[0, i] * gradient[a, 0]
                        + inverse[1, i] * gradient[a, 1]
                        + inverse[2, i] * gradient[a, 2]
                    )
                    h = (
                        f[i, 0] * gradient[a, 0]
                        + f[i, 1] * gradient[a, 1]
                        + f[i, 2] * gradient[a, 2]
                    )
                    k = 3 * a + i
                    left[2 * q, k] = g
                    left[2 * q + 1, k] = h
                    right[2 * q, k] = gg * g + gh * h
                    right[2 * q + 1, k] = gh * g + hh * h
                    swapped[q, k] = g
                    weighted[q, k] = cross * g
                    internal[k] += force_g * g + force_h * h
                    reference[3 * q + i, a] = gradient[a, i]
                    scaled[3 * q + i, a] = dot * gradient[a, i]
                    for m in range(4):
                        b[m, k] += w * jacobian * modes[q, m] * g
            for m in range(4):
                rp[m] += w * modes[q, m] * (jacobian - 1.0 - p / bulk)
        coupling[e] = b
        volume_residual[e] = rp
        condensed = bulk * inverse_mass[e]
        lifted = condensed @ b
        left[2 * n_points :] = b
        right[2 * n_points :] = lifted
        internal += rp @ lifted
        tangent = left.T @ right
        crossed = swapped.T @ weighted
        plain = reference.T @ scaled
        for a in range(27):
            for i in range(3):
                residual[3 * nodes[a] + i] += internal[3 * a + i]
                for c in range(27):
                    for k in range(3):
                        at = position[e, 3 * a + i, 3 * c + k]
                        if at >= 0:
                            value = tangent[3 * a + i, 3 * c + k] + crossed[3 * a + k, 3 * c + i]
                            if i == k:
                                value += plain[a, c]
                            data[at] += value
    return smallest


@njit(cache=True)
def principal_stretch(
    displacement: Floats, elements: Indices, gradients: Floats, stretch: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``stretch`` (n_elements, 27) with the largest principal stretch at each point."""
    deformation = np.empty((3, 3))
    for e in range(stretch.shape[0]):
        nodes = elements[e]
        for q in range(stretch.shape[1]):
            for i in range(3):
                for j in range(3):
                    total = 1.0 if i == j else 0.0
                    for a in range(27):
                        total += displacement[nodes[a], i] * gradients[e, q, a, j]
                    deformation[i, j] = total
            stretch[e, q] = np.sqrt(np.linalg.eigvalsh(deformation.T @ deformation)[2])
