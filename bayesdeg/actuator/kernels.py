"""Compiled element kernels: material law, residual and tangent of the solid, pressurised faces.

W(F, p) = Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) + p (J − 1), with G = F⁻ᵀ, M = I₁ F − F C = ½ ∂I₂/∂F.

The solid is nearly incompressible, a Yeoh material with a second-invariant term, in isochoric
invariants and with the pressure as an independent field, discontinuous over the elements:

    Π(u, p) = ∫ Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) + p (J − 1) − p²/(2 K) dV,

Ī₁ = J^(-2/3) I₁, Ī₂ = J^(-4/3) I₂. At each quadrature point the law gives the stress P = ∂W/∂F and
the elasticity A = ∂²W/∂F∂F; an element's tangent is then one product of matrices.

Rows are copied entry by entry: slice assignment compiles its error message along, which takes
longer than the kernel.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True)
def invert(f: Floats, g: Floats) -> float:  # pragma: no cover - compiled
    """Overwrite ``g`` with F⁻ᵀ and return det F."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            g[m, i] = f[n, j] * f[o, k] - f[n, k] * f[o, j]
    jacobian = f[0, 0] * g[0, 0] + f[0, 1] * g[0, 1] + f[0, 2] * g[0, 2]
    if jacobian != 0.0:
        g /= jacobian
    return float(jacobian)


@njit(cache=True)
def energy(f: Floats, constants: Floats) -> float:  # pragma: no cover - compiled
    """Return the isochoric energy Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) [C1]."""
    jacobian = np.linalg.det(f)
    c = f.T @ f
    first = np.trace(c)
    second = 0.5 * (first * first - np.sum(c * c))
    x = first * jacobian ** (-2.0 / 3.0) - 3.0
    y = second * jacobian ** (-4.0 / 3.0)
    total = x * (constants[0] + x * (constants[1] + x * constants[2]))
    return float(total + constants[3] * (np.sqrt(y) - np.sqrt(3.0)))


@njit(cache=True)
def _yeoh(
    f: Floats, jacobian: float, constants: Floats
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return I₁ and J^(-2/3) W', J^(-4/3) W''."""
    first = 0.0
    for i in range(3):
        for j in range(3):
            first += f[i, j] * f[i, j]
    isochoric = jacobian ** (-2.0 / 3.0)
    x = isochoric * first - 3.0
    w1 = isochoric * (constants[0] + x * (2.0 * constants[1] + 3.0 * constants[2] * x))
    w2 = isochoric * isochoric * (2.0 * constants[1] + 6.0 * constants[2] * x)
    return first, w1, w2


@njit(cache=True)
def stress(
    f: Floats, g: Floats, jacobian: float, p: float, constants: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (3, 3) with P = ∂W/∂F."""
    first, w1, _ = _yeoh(f, jacobian, constants)
    on_g, on_f = p * jacobian - 2.0 / 3.0 * first * w1, 2.0 * w1
    for i in range(3):
        for j in range(3):
            out[i, j] = on_g * g[i, j] + on_f * f[i, j]
    if constants[3] != 0.0:
        m = np.empty((3, 3))
        second = _second(f, first, m)
        v1, isochoric, _ = _root(second, jacobian, constants[3])
        on_m = 2.0 * v1 * isochoric
        for i in range(3):
            for j in range(3):
                out[i, j] += on_m * (m[i, j] - 2.0 / 3.0 * second * g[i, j])


@njit(cache=True)
def _second(f: Floats, first: float, m: Floats) -> float:  # pragma: no cover - compiled
    """Overwrite ``m`` with M = I₁ F − F C and return I₂ = ½ M : F."""
    twice = 0.0
    for i in range(3):
        for j in range(3):
            total = first * f[i, j]
            for k in range(3):
                inner = f[0, k] * f[0, j] + f[1, k] * f[1, j] + f[2, k] * f[2, j]
                total -= f[i, k] * inner
            m[i, j] = total
            twice += total * f[i, j]
    return 0.5 * twice


@njit(cache=True)
def _root(
    second: float, jacobian: float, r: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return V', J^(-4/3) and V'' of V = r √Ī₂."""
    isochoric = jacobian ** (-4.0 / 3.0)
    y = isochoric * second
    return 0.5 * r / np.sqrt(y), isochoric, -0.25 * r / (y * np.sqrt(y))


@njit(cache=True)
def elasticity(
    f: Floats, g: Floats, jacobian: float, p: float, constants: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (6, 3, 3) with A_iJkL = ∂²W/∂F_iJ∂F_kL for ik = 00, 01, 02, 11, 12, 22."""
    first, w1, w2 = _yeoh(f, jacobian, constants)
    pj = p * jacobian
    gg = 4.0 / 9.0 * first * (w1 + first * w2) + pj
    gf = -4.0 / 3.0 * (w1 + first * w2)
    ff = 4.0 * w2
    crossed = 2.0 / 3.0 * first * w1 - pj
    pair = 0
    for i in range(3):
        for k in range(i, 3):
            for j in range(3):
                on_g, on_f = gg * g[i, j] + gf * f[i, j], gf * g[i, j] + ff * f[i, j]
                for m in range(3):
                    out[pair, j, m] = on_g * g[k, m] + on_f * f[k, m] + crossed * g[i, m] * g[k, j]
                if i == k:
                    out[pair, j, j] += 2.0 * w1
            pair += 1
    if constants[3] != 0.0:
        _add_second(f, g, jacobian, constants[3], first, out)


@njit(cache=True)
def _add_second(
    f: Floats, g: Floats, jacobian: float, r: float, first: float, out: Floats
) -> None:  # pragma: no cover - compiled
    """Add the part of r √Ī₂ to the elasticity."""
    m = np.empty((3, 3))
    second = _second(f, first, m)
    v1, isochoric, v2 = _root(second, jacobian, r)
    on, on_g = v1 * isochoric, 4.0 / 3.0 * second
    pair = 0
    for i in range(3):
        for k in range(i, 3):
            left = f[i, 0] * f[k, 0] + f[i, 1] * f[k, 1] + f[i, 2] * f[k, 2]
            for j in range(3):
                # V'' d_iJ d_kL with d = ∂Ī₂/∂F = J^(-4/3) (2 M − 4/3 I₂ G)
                curved = v2 * isochoric * isochoric * (2.0 * m[i, j] - on_g * g[i, j])
                by_f, by_m = 4.0 * on * f[i, j], 2.0 * curved - 8.0 / 3.0 * on * g[i, j]
                by_g = on * (4.0 / 3.0 * on_g * g[i, j] - 8.0 / 3.0 * m[i, j]) - on_g * curved
                for n in range(3):
                    crossed = on_g * g[i, n] * g[k, j] - 2.0 * f[i, n] * f[k, j]
                    same = by_f * f[k, n] + by_m * m[k, n] + by_g * g[k, n]
                    out[pair, j, n] += same + on * crossed
                    if i == k:
                        right = f[0, n] * f[0, j] + f[1, n] * f[1, j] + f[2, n] * f[2, j]
                        out[pair, j, n] -= 2.0 * on * right
                out[pair, j, j] -= 2.0 * on * left
                if i == k:
                    out[pair, j, j] += 2.0 * on * first
            pair += 1


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
        Added to: the internal force at the current pressure.
    coupling : array, shape (n_elements, n_modes, 3 n_local)
        Overwritten, unless it is empty: ∫ modes J F⁻ᵀ∇N dV.
    volume_residual : array, shape (n_elements, n_modes)
        Overwritten: ∫ modes (J − 1 − p/K) dV.
    position : array, shape (n_elements, n_stored)
        Positions of an element's upper triangle in ``data``, in the order of ``scatter_upper``; −1
        where one is not stored.
    data : array
        Added to: entries of the upper triangle of the tangent; empty for the force alone.

    Returns
    -------
    float
        Smallest J; the other results are valid only if it is positive.
    """
    n_local, n_points = elements.shape[1], weights.shape[1]
    coupled = modes.shape[1] if coupling.size > 0 else 0
    rows, local = np.empty((3 + 3 * coupled, 3 * n_points)), np.empty((n_local, 3))
    right, smallest = np.empty((3 * n_points, 6 * n_local if data.size > 0 else 0)), 1e300
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
        _couple(products, e, coupling)
        if data.size > 0:
            volumetric = coupling[e].T @ ((bulk * inverse_mass[e]) @ coupling[e])
            scatter_upper(gradient.T @ right, volumetric, position[e], data)
    return smallest


@njit(cache=True)
def _couple(products: Floats, e: int, coupling: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite an element's couplings, if there are any, with the rows after the first three."""
    n_local = products.shape[1]
    for m in range(coupling.shape[1] if coupling.size > 0 else 0):
        for i in range(3):
            for n in range(n_local):
                coupling[e, m, i * n_local + n] = products[3 + 3 * m + i, n]


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

    ``rows`` gets the weighted stress and, if it has room, J F⁻ᵀ for each mode; ``right`` the
    weighted elasticity times the gradients, unless it has no columns; ``volume_residual`` is
    overwritten.
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
                for m in range(rows.shape[0] // 3 - 1):
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


@njit(cache=True)
def add_pull(
    push: Floats, chosen: Indices, elements: Indices, gradients: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Add Σ push_iJ ∂N/∂X_J: a derivative by F of chosen elements, by the nodes' positions.

    ``push`` has the shape (n, n_points, 3, 3), ``chosen`` (n,), ``out`` (n_nodes, 3).
    """
    n_local, n_points = elements.shape[1], gradients.shape[1]
    rows = np.empty((3, 3 * n_points))
    for k in range(chosen.shape[0]):
        e = chosen[k]
        for q in range(n_points):
            for i in range(3):
                for j in range(3):
                    rows[i, 3 * q + j] = push[k, q, i, j]
        add_force(rows @ gradients[e].reshape((3 * n_points, n_local)), elements[e], out)


@njit(cache=True)
def add_rows(places: Indices, values: Floats, out: Floats) -> None:  # pragma: no cover - compiled
    """Add values (n, n_places, 3, n_fields) at places (n, n_places) to fields (n_fields, …, 3)."""
    for k in range(places.shape[0]):
        for a in range(places.shape[1]):
            for i in range(3):
                for f in range(out.shape[0]):
                    out[f, places[k, a], i] += values[k, a, i, f]


@njit(cache=True)
def solid_products(
    displacement: Floats,
    pressure: Floats,
    elements: Indices,
    gradients: Floats,
    weights: Floats,
    modes: Floats,
    constants: Floats,
    bulk: float,
    directions: Floats,
    pressure_directions: Floats,
    forces: Floats,
    volume_rates: Floats,
) -> None:  # pragma: no cover - compiled
    """Add the mixed problem's tangent times several directions, without assembling it.

    ``directions`` and ``forces`` are (n_nodes, 3, k), the latter added to; ``pressure_directions``
    and ``volume_rates`` are (n_elements, n_modes, k), the latter overwritten. The other arguments
    are those of ``solid``. Directions lie side by side, so that each sum runs over all at once.
    """
    n_local, n_points, count = elements.shape[1], weights.shape[1], directions.shape[2]
    rows = np.empty((3 * n_points, 3 * count))
    local = np.empty((n_local, 3 + 3 * count))
    for e in range(weights.shape[0]):
        for n in range(n_local):
            for i in range(3):
                local[n, i] = displacement[elements[e, n], i]
                for k in range(count):
                    local[n, 3 + i * count + k] = directions[elements[e, n], i, k]
        gradient = gradients[e].reshape((3 * n_points, n_local))
        volume_rates[e] = 0.0
        _evaluate_products(
            gradient @ local,
            pressure[e],
            pressure_directions[e],
            weights[e],
            modes,
            constants[e],
            bulk,
            rows,
            volume_rates[e],
        )
        products = gradient.T @ rows
        for n in range(n_local):
            for i in range(3):
                for k in range(count):
                    forces[elements[e, n], i, k] += products[n, i * count + k]


@njit(cache=True)
def _evaluate_products(
    slope: Floats,
    pressure: Floats,
    pressure_directions: Floats,
    weights: Floats,
    modes: Floats,
    constants: Floats,
    bulk: float,
    rows: Floats,
    volume_rates: Floats,
) -> None:  # pragma: no cover - compiled
    """Overwrite ``rows`` (3 n_points, 3 k) with weighted changes of stress at an element's points.

    ``volume_rates`` (n_modes, k) is added to.
    """
    f, g, a = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 3, 3))
    dp, grown = np.empty(rows.shape[1] // 3), np.empty(rows.shape[1] // 3)
    for q in range(weights.shape[0]):
        for i in range(3):
            for j in range(3):
                f[i, j] = slope[3 * q + j, i]
            f[i, i] += 1.0
        jacobian = invert(f, g)
        w, p = weights[q], np.dot(pressure, modes[q])
        elasticity(f, g, jacobian, p, constants[q], a)
        a *= w
        g *= w * jacobian
        change, stress_change = slope[3 * q : 3 * q + 3, 3:], rows[3 * q : 3 * q + 3]
        _combine(modes[q], pressure_directions, dp)
        _by_volume(g, change, dp, stress_change, grown)
        _add_elasticity(a, change, stress_change)
        for m in range(modes.shape[1]):
            for k in range(dp.shape[0]):
                volume_rates[m, k] += modes[q, m] * (grown[k] - w / bulk * dp[k])


@njit(cache=True)
def _combine(shares: Floats, fields: Floats, out: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (k,) with the sum of shares (n,) of fields (n, k)."""
    out[:] = 0.0
    for m in range(shares.shape[0]):
        for k in range(out.shape[0]):
            out[k] += shares[m] * fields[m, k]


@njit(cache=True)
def _by_volume(
    g: Floats, change: Floats, dp: Floats, out: Floats, grown: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` with dp g and ``grown`` with g : dF of several directions, g = w J F⁻ᵀ.

    ``change`` and ``out`` are (3, 3 k): dF_iJ and dP_iJ of all directions in row J.
    """
    count = dp.shape[0]
    grown[:] = 0.0
    for j in range(3):
        for i in range(3):
            on, at = g[i, j], i * count
            for k in range(count):
                out[j, at + k] = on * dp[k]
                grown[k] += on * change[j, at + k]


@njit(cache=True)
def _add_elasticity(a: Floats, change: Floats, out: Floats) -> None:  # pragma: no cover - compiled
    """Add A : dF of several directions, laid out as in ``_by_volume``."""
    count = change.shape[1] // 3
    c0, c1, c2 = change[0], change[1], change[2]
    pair = 0
    for i in range(3):
        for k in range(i, 3):
            at, to = i * count, k * count
            for j in range(3):
                x, y, z = a[pair, j, 0], a[pair, j, 1], a[pair, j, 2]
                for n in range(count):
                    out[j, at + n] += x * c0[to + n] + y * c1[to + n] + z * c2[to + n]
                if i != k:
                    x, y, z = a[pair, 0, j], a[pair, 1, j], a[pair, 2, j]
                    for n in range(count):
                        out[j, to + n] += x * c0[at + n] + y * c1[at + n] + z * c2[at + n]
            pair += 1


@njit(cache=True)
def constant_rates(
    displacement: Floats,
    elements: Indices,
    gradients: Floats,
    weights: Floats,
    constants: Floats,
    profile: Floats,
    forces: Floats,
) -> None:  # pragma: no cover - compiled
    """Add the internal force's derivatives by C2, C3, r and the skin's contrast.

    The first three are by the logarithm-free ratios: the local constants are the ratios times
    the local C1. ``profile`` (n_elements, n_points) is that of the skin, ``forces`` (n_nodes, 12)
    holds the four derivatives side by side.
    """
    n_local, n_points = elements.shape[1], weights.shape[1]
    rows, local = np.empty((12, 3 * n_points)), np.empty((n_local, 3))
    for e in range(weights.shape[0]):
        gather(displacement, elements[e], local)
        gradient = gradients[e].reshape((3 * n_points, n_local))
        _evaluate_rates(gradient @ local, weights[e], constants[e], profile[e], rows)
        add_force(rows @ gradient, elements[e], forces)


@njit(cache=True)
def _evaluate_rates(
    slope: Floats, weights: Floats, constants: Floats, profile: Floats, rows: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``rows`` with weighted rates of stress at an element's points, 3 a constant.

    Every one is a share of ∂Ī₁/∂F = 2 J^(-2/3) (F − ⅓ I₁ G) and of
    ∂√Ī₂/∂F = J^(-4/3) (M − ⅔ I₂ G)/√Ī₂.
    """
    f, g, m = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for q in range(weights.shape[0]):
        for i in range(3):
            for j in range(3):
                f[i, j] = slope[3 * q + j, i]
            f[i, i] += 1.0
        jacobian, c = invert(f, g), constants[q]
        first = 0.0
        for i in range(3):
            first += f[i, 0] ** 2 + f[i, 1] ** 2 + f[i, 2] ** 2
        second = _second(f, first, m)
        isochoric = jacobian ** (-2.0 / 3.0)
        x, root = isochoric * first - 3.0, isochoric * np.sqrt(second)
        on_first, on_second = 2.0 * isochoric, isochoric * isochoric / root
        unit, skin = weights[q] * c[0], weights[q] * profile[q]
        yeoh = skin * (c[0] + x * (2.0 * c[1] + 3.0 * c[2] * x))
        for i in range(3):
            for j in range(3):
                by_first = on_first * (f[i, j] - first / 3.0 * g[i, j])
                by_root = on_second * (m[i, j] - 2.0 / 3.0 * second * g[i, j])
                rows[i, 3 * q + j] = unit * 2.0 * x * by_first
                rows[3 + i, 3 * q + j] = unit * 3.0 * x * x * by_first
                rows[6 + i, 3 * q + j] = unit * by_root
                rows[9 + i, 3 * q + j] = yeoh * by_first + skin * c[3] * by_root


THIRD = 1.0 / 3.0


def line_shapes(order: int, points: Floats) -> tuple[Floats, Floats]:
    """Return Lagrange polynomials on [0, 1] and their derivatives, shape (n, order + 1).

    Parameters
    ----------
    order : int
        1 or 2; the nodes are evenly spaced.
    points : array, shape (n,)
        Coordinates on [0, 1].

    Examples
    --------
    >>> line_shapes(2, np.array([0.5]))[0]
    array([[0., 1., 0.]])
    """
    t = points
    if order == 1:
        one = np.ones_like(t)
        return np.stack([1 - t, t], axis=1), np.stack([-one, one], axis=1)
    values = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=1)
    derivatives = np.stack([4 * t - 3, 4 - 8 * t, 4 * t - 1], axis=1)
    return values, derivatives


def gauss(order: int) -> tuple[Floats, Floats]:
    """Return points and weights of the Gauss rule of ``order + 1`` points on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(order + 1)
    return 0.5 + 0.5 * points, 0.5 * weights


def triangle_shapes(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the shapes of a side of a tetrahedron and their derivatives, each (n, 7).

    Quadratics and the cubic that vanishes on the edges, of three corners, the middles of the edges
    01, 12 and 20, and the middle.

    Parameters
    ----------
    points : array, shape (n, 2)
        Coordinates of the second and the third corner.

    Examples
    --------
    >>> triangle_shapes(np.full((1, 2), 1.0 / 3.0))[0].round(12) + 0.0
    array([[0., 0., 0., 0., 0., 0., 1.]])
    """
    first, second = points.T
    sides = np.stack([1.0 - first - second, first, second], axis=1)
    slopes = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    bubble = 27.0 * np.prod(sides, axis=1)[:, None]
    others = sides[:, [1, 2, 0]] * sides[:, [2, 0, 1]]
    after = sides[:, [1, 2, 0]]
    values = np.hstack(
        [sides * (2.0 * sides - 1.0) + bubble / 9.0, 4.0 * (sides * after - bubble / 9.0), bubble]
    )
    found = [values]
    for slope in slopes.T:
        rise = 27.0 * others @ slope[:, None]
        edges = slope * after + sides * slope[[1, 2, 0]]
        found.append(
            np.hstack([(4.0 * sides - 1.0) * slope + rise / 9.0, 4.0 * (edges - rise / 9.0), rise])
        )
    return found[0], found[1], found[2]


def triangle_rule(order: int = 4) -> tuple[Floats, Floats]:
    """Return points (n, 2) and weights of a rule on the unit triangle, of positive weights.

    Gauss points of a square that is drawn together to the triangle: exact for polynomials of
    degree ``2 order``. A side's volume is one of degree 7.

    Examples
    --------
    >>> points, weights = triangle_rule()
    >>> round(float(weights @ (points[:, 0] ** 5 * points[:, 1] ** 2) * 181440), 9)  # 5! 2!/9!
    120.0
    """
    points, weights = gauss(order)
    first, second = (one.ravel() for one in np.meshgrid(points, points, indexing="ij"))
    places = np.stack([first, second * (1.0 - first)], axis=1)
    return places, np.kron(weights, weights) * (1.0 - first)


def face_shapes(order: int = 2, *, triangle: bool = False) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the shapes of a face at the Gauss points of the unit square, or triangle.

    Parameters
    ----------
    order : int
        1 or 2, of the brick behind.
    triangle : bool
        Whether it is a side of a tetrahedron, of ``triangle_shapes``.

    Returns
    -------
    values, along_first, along_second : array, shape (n_points, n_nodes)
        Shapes and their derivatives, nodes in grid order.
    weights : array, shape (n_points,)
        Weights of the points.

    Examples
    --------
    >>> bool(np.allclose(face_shapes()[0].sum(axis=1), 1.0))
    True
    """
    if triangle:
        places, of_places = triangle_rule()
        return (*triangle_shapes(places), of_places)
    points, weights = gauss(order)
    n, dn = line_shapes(order, points)
    shapes = (np.kron(n, n), np.kron(dn, n), np.kron(n, dn), np.kron(weights, weights))
    return tuple(np.asarray(a, dtype=np.float64) for a in shapes)  # type: ignore[return-value]


def volume_form(order: int = 2, *, triangle: bool = False) -> Floats:
    """Return the cubic form of the volume under a face, shape (n, n, n) for its n nodes.

    V = 1/3 ∫ x · (x,₁ × x,₂) = 1/6 Σ S_acb x_a · (x_b × x_c), S without sign changes but those of
    its indices: the Hessian is ∂²V/∂x_ai∂x_ck = ε_ijk Σ_b S_acb x_bj.

    Examples
    --------
    >>> form = volume_form(1)
    >>> corners = np.array([[0, 0, 3], [0, 1, 3], [1, 0, 3], [1, 1, 3]], dtype=float)
    >>> cross = np.cross(corners[:, None], corners[None])
    >>> float(np.round(np.einsum("acb,ai,bci->", form, corners, cross) / 6, 12))
    1.0
    """
    shapes, first, second, weights = face_shapes(order, triangle=triangle)
    t = np.einsum("q,qa,qb,qc->abc", weights, shapes, first, second, optimize=True)
    even = t + np.transpose(t, (1, 2, 0)) + np.transpose(t, (2, 0, 1))
    antisymmetric = (even - np.transpose(even, (0, 2, 1))) / 6.0
    return np.ascontiguousarray(2.0 * np.transpose(antisymmetric, (0, 2, 1)))


@njit(cache=True)
def cavity_volume(
    placed: Floats,
    faces: Indices,
    form: Floats,
    factor: float,
    force: Floats,
    position: Places,
    data: Floats,
) -> float:  # pragma: no cover - compiled
    """Add ``factor`` times the gradient and Hessian of the enclosed volume; return the volume.

    The dead volume at the plane of symmetry contributes nothing, since there x · n = 0. ``placed``
    holds current positions (n_nodes, 3) [mm], ``force`` is (n_nodes, 3), ``data`` is empty if no
    Hessian is needed; ``form`` comes from ``volume_form``.
    """
    volume, count = 0.0, faces.shape[1]
    local = np.empty((count, 3))
    flat = form.reshape((count * count, count))
    for face in range(faces.shape[0]):
        nodes = faces[face]
        for a in range(count):
            for i in range(3):
                local[a, i] = placed[nodes[a], i]
        axial = (flat @ local).reshape((count, count, 3))
        for a in range(count):
            x, y, z = 0.0, 0.0, 0.0
            for c in range(count):
                e = axial[a, c]
                x += 0.5 * (e[1] * local[c, 2] - e[2] * local[c, 1])
                y += 0.5 * (e[2] * local[c, 0] - e[0] * local[c, 2])
                z += 0.5 * (e[0] * local[c, 1] - e[1] * local[c, 0])
            force[nodes[a], 0] += factor * x
            force[nodes[a], 1] += factor * y
            force[nodes[a], 2] += factor * z
            volume += THIRD * (x * local[a, 0] + y * local[a, 1] + z * local[a, 2])
        if data.size > 0:
            _scatter_axial(axial, factor, position[face], data)
    return volume


@njit(cache=True)
def _scatter_axial(
    axial: Floats, factor: float, position: Places, data: Floats
) -> None:  # pragma: no cover - compiled
    """Add blocks with entries ε_ijk e_j to the stored entries of the upper triangle."""
    for a in range(axial.shape[0]):
        for c in range(axial.shape[1]):
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                at = position[3 * a + i, 3 * c + k]
                if at >= 0:
                    data[at] += factor * axial[a, c, j]
                at = position[3 * a + k, 3 * c + i]
                if at >= 0:
                    data[at] -= factor * axial[a, c, j]


@njit(cache=True)
def scatter(tangent: Floats, position: Places, data: Floats) -> None:  # pragma: no cover - compiled
    """Add a face's tangent to the stored entries of the upper triangle."""
    for row in range(tangent.shape[0]):
        for column in range(tangent.shape[1]):
            at = position[row, column]
            if at >= 0:
                data[at] += tangent[row, column]
