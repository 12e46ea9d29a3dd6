"""Compiled element kernels: residual and tangent of the solid.

The solid is nearly incompressible, a Yeoh material with a second-invariant term, in isochoric
invariants and with the pressure as an independent field, discontinuous over the elements:

    Π(u, p) = ∫ Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) + p (J − 1) − p²/(2 K) dV,

Ī₁ = J^(-2/3) I₁, Ī₂ = J^(-4/3) I₂. At each quadrature point the law gives the stress P = ∂W/∂F and
the elasticity A = ∂²W/∂F∂F; an element's tangent is then one product of matrices.

Rows are copied entry by entry: an assignment of slices brings with it the text of its error, which
takes longer to compile than a kernel.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator.law import elasticity, invert, stress

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Places = NDArray[np.int32]


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
    force: Floats,
    coupling: Floats,
    volume_residual: Floats,
    position: Places,
    data: Floats,
) -> float:  # pragma: no cover - compiled
    """Add the solid's internal force and, if ``data`` is not empty, its condensed tangent.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    pressure : array, shape (n_elements, n_modes)
        Coefficients of the pressure field [C1].
    elements, gradients, weights
        Of ``Body``.
    modes : array, shape (n_points, n_modes)
        Pressure modes at the quadrature points.
    inverse_mass : array, shape (n_elements, n_modes, n_modes)
        Inverse of ∫ modesᵀ modes dV.
    constants : array, shape (n_elements, n_points, 4)
        C1, C2, C3 and r at every quadrature point [C1].
    bulk : float
        Bulk modulus K [C1].
    force : array, shape (n_nodes, 3)
        Added to: the internal force, the pressure as it stands.
    coupling : array, shape (n_elements, n_modes, 3 n_local)
        Overwritten: ∫ modes J F⁻ᵀ∇N dV.
    volume_residual : array, shape (n_elements, n_modes)
        Overwritten: ∫ modes (J − 1 − p/K) dV.
    position : array, shape (n_elements, n_stored)
        Where entries of an element's upper triangle go in ``data``, in the order of
        ``scatter_upper``; −1 where one is not stored.
    data : array
        Added to: entries of the upper triangle of the tangent; empty for the force alone.

    Returns
    -------
    float
        The smallest J; if that is not above 0, nothing else means anything.
    """
    n_local, n_points, n_modes = elements.shape[1], weights.shape[1], modes.shape[1]
    rows, local = np.empty((3 + 3 * n_modes, 3 * n_points)), np.empty((n_local, 3))
    right = np.empty((3 * n_points, 6 * n_local if data.size > 0 else 0))
    smallest = 1e300
    for e in range(weights.shape[0]):
        gather(displacement, elements[e], local)
        gradient = gradients[e].reshape((3 * n_points, n_local))
        jacobian = _evaluate_element(
            gradient @ local,
            pressure[e],
            weights[e],
            modes,
            constants[e],
            bulk,
            gradient,
            rows,
            right,
            volume_residual[e],
        )
        if not jacobian > 0.0:
            return float(jacobian)
        smallest = min(smallest, jacobian)
        products = rows @ gradient
        add_force(products[:3], elements[e], force)
        _couple(products, coupling[e])
        if data.size > 0:
            volumetric = coupling[e].T @ ((bulk * inverse_mass[e]) @ coupling[e])
            scatter_upper(gradient.T @ right, volumetric, position[e], data)
    return smallest


@njit(cache=True)
def _couple(products: Floats, coupling: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``coupling`` (n_modes, 3 n_local) with the rows after the first three."""
    n_local = products.shape[1]
    for m in range(coupling.shape[0]):
        for i in range(3):
            for n in range(n_local):
                coupling[m, i * n_local + n] = products[3 + 3 * m + i, n]


@njit(cache=True)
def gather(field: Floats, nodes: Indices, local: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``local`` with the rows of an element's nodes."""
    for n in range(nodes.shape[0]):
        for i in range(field.shape[1]):
            local[n, i] = field[nodes[n], i]


@njit(cache=True)
def add_force(
    products: Floats, nodes: Indices, force: Floats
) -> None:  # pragma: no cover - compiled
    """Add an element's forces, component by component, to those of its nodes."""
    for n in range(nodes.shape[0]):
        for i in range(products.shape[0]):
            force[nodes[n], i] += products[i, n]


@njit(cache=True)
def _evaluate_element(
    slope: Floats,
    pressure: Floats,
    weights: Floats,
    modes: Floats,
    constants: Floats,
    bulk: float,
    gradient: Floats,
    rows: Floats,
    right: Floats,
    volume_residual: Floats,
) -> float:  # pragma: no cover - compiled
    """Evaluate the law at an element's points; return the smallest J, or the first not above 0.

    ``rows`` gets the weighted stress and, for each mode, J F⁻ᵀ; ``right`` the weighted elasticity
    times the gradients, unless it has no columns; ``volume_residual`` is overwritten.
    """
    f, g, p_stress = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    a = np.empty((6, 3, 3))
    volume_residual[:] = 0.0
    smallest = 1e300
    for q in range(weights.shape[0]):
        for i in range(3):
            for j in range(3):
                f[i, j] = slope[3 * q + j, i]
            f[i, i] += 1.0
        jacobian = invert(f, g)
        if not jacobian > 0.0:
            return float(jacobian)
        smallest = min(smallest, jacobian)
        w, p = weights[q], np.dot(pressure, modes[q])
        stress(f, g, jacobian, p, constants[q], p_stress)
        for i in range(3):
            for j in range(3):
                rows[i, 3 * q + j] = w * p_stress[i, j]
                for m in range(modes.shape[1]):
                    rows[3 + 3 * m + i, 3 * q + j] = w * modes[q, m] * jacobian * g[i, j]
        volume_residual += w * (jacobian - 1.0 - p / bulk) * modes[q]
        if right.shape[1] > 0:
            elasticity(f, g, jacobian, p, constants[q], a)
            _weigh(a, w, gradient[3 * q : 3 * q + 3], right[3 * q : 3 * q + 3])
    return smallest


@njit(cache=True)
def _weigh(
    a: Floats, w: float, gradient: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (3, 6 n_local) with w A_iJkL ∇N_L, the pairs (i, k) side by side."""
    n_local = gradient.shape[1]
    for pair in range(6):
        for j in range(3):
            x, y, z = w * a[pair, j, 0], w * a[pair, j, 1], w * a[pair, j, 2]
            at = pair * n_local
            for n in range(n_local):
                out[j, at + n] = x * gradient[0, n] + y * gradient[1, n] + z * gradient[2, n]


@njit(cache=True)
def scatter_upper(
    blocks: Floats, full: Floats, position: Places, data: Floats
) -> None:  # pragma: no cover - compiled
    """Add an element's tangent to the stored entries.

    ``blocks`` (n_local, 6 n_local) holds the blocks of components 00, 01, 02, 11, 12, 22 and
    ``full`` (3 n_local, 3 n_local) the rest, component by component; each unordered pair of
    unknowns is visited once.
    """
    n_local = blocks.shape[0]
    k, pair = 0, 0
    for i in range(3):
        for j in range(i, 3):
            for a in range(n_local):
                for b in range(a if i == j else 0, n_local):
                    at = position[k]
                    if at >= 0:
                        data[at] += (
                            blocks[a, pair * n_local + b] + full[i * n_local + a, j * n_local + b]
                        )
                    k += 1
            pair += 1


@njit(cache=True)
def condense(
    elements: Indices,
    coupling: Floats,
    inverse_mass: Floats,
    bulk: float,
    volume_residual: Floats,
    force: Floats,
) -> None:  # pragma: no cover - compiled
    """Add K Bᵀ M⁻¹ r to ``force``: the volume equation, eliminated element by element."""
    n_local = elements.shape[1]
    for e in range(elements.shape[0]):
        push = coupling[e].T @ ((bulk * inverse_mass[e]) @ volume_residual[e])
        for n in range(n_local):
            for i in range(3):
                force[elements[e, n], i] += push[i * n_local + n]


@njit(cache=True)
def pressure_increment(
    displacement: Floats,
    elements: Indices,
    coupling: Floats,
    inverse_mass: Floats,
    bulk: float,
    volume_residual: Floats,
    out: Floats,
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (n_elements, n_modes) with K M⁻¹ (B δu + r)."""
    n_local = elements.shape[1]
    local = np.empty(3 * n_local)
    for e in range(elements.shape[0]):
        for n in range(n_local):
            for i in range(3):
                local[i * n_local + n] = displacement[elements[e, n], i]
        change = (bulk * inverse_mass[e]) @ (coupling[e] @ local + volume_residual[e])
        for m in range(change.shape[0]):
            out[e, m] = change[m]


@njit(cache=True)
def deformation(
    displacement: Floats, elements: Indices, gradients: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (n_elements, n_points, 3, 3) with F = I + ∂u/∂X."""
    n_local, n_points = elements.shape[1], gradients.shape[1]
    local = np.empty((n_local, 3))
    for e in range(elements.shape[0]):
        gather(displacement, elements[e], local)
        slope = gradients[e].reshape((3 * n_points, n_local)) @ local
        for q in range(n_points):
            for i in range(3):
                for j in range(3):
                    out[e, q, i, j] = slope[3 * q + j, i]
                out[e, q, i, i] += 1.0
