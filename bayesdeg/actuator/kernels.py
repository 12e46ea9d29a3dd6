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
# three-point Gauss rule on [0, 1]
GAUSS_POINTS = 0.5 + 0.5 * np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0


def quadratic_shapes(points: Floats) -> tuple[Floats, Floats]:
    """Return quadratic Lagrange polynomials on [0, 1] and their derivatives.

    Parameters
    ----------
    points : array, shape (n,)
        Coordinates on [0, 1].

    Returns
    -------
    values, derivatives : array, shape (n, 3)
        For the nodes 0, 1/2, 1.

    Examples
    --------
    >>> quadratic_shapes(np.array([0.5]))[0]
    array([[0., 1., 0.]])
    """
    t = points
    values = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=1)
    derivatives = np.stack([4 * t - 3, 4 - 8 * t, 4 * t - 1], axis=1)
    return values, derivatives


def face_shapes() -> tuple[Floats, Floats, Floats, Floats]:
    """Return biquadratic shapes at 3 × 3 Gauss points of the unit square.

    Returns
    -------
    values, along_first, along_second : array, shape (9 points, 9 nodes)
        Shapes and their derivatives, nodes in 3 × 3 grid order.
    weights : array, shape (9,)
        Weights of the points.

    Examples
    --------
    >>> bool(np.allclose(face_shapes()[0].sum(axis=1), 1.0))
    True
    """
    n, dn = quadratic_shapes(GAUSS_POINTS)
    return np.kron(n, n), np.kron(dn, n), np.kron(n, dn), np.kron(GAUSS_WEIGHTS, GAUSS_WEIGHTS)


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
                return jacobian
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


@njit(cache=True)
def cavity_volume(
    placed: Floats,
    faces: Indices,
    shapes: Floats,
    along_first: Floats,
    along_second: Floats,
    weights: Floats,
    factor: float,
    residual: Floats,
    position: Indices,
    data: Floats,
) -> float:  # pragma: no cover - compiled
    """Add ``factor`` times the gradient and Hessian of the enclosed volume; return the volume.

    V = 1/3 ∫ x · (x,₁ × x,₂): the dead volume at the plane of symmetry contributes nothing, since
    there x · n = 0. Its Hessian is symmetric face by face. ``placed`` holds current positions
    (n_nodes, 3) [mm]; the other arguments are those of ``face_shapes`` and ``solid``.
    """
    volume = 0.0
    epsilon = np.zeros((3, 3, 3))
    epsilon[0, 1, 2] = epsilon[1, 2, 0] = epsilon[2, 0, 1] = 1.0
    epsilon[0, 2, 1] = epsilon[2, 1, 0] = epsilon[1, 0, 2] = -1.0
    e_x = np.empty((3, 3))
    e_s = np.empty((3, 3))
    e_t = np.empty((3, 3))
    for face in range(faces.shape[0]):
        nodes = faces[face]
        local = np.empty((9, 3))
        for a in range(9):
            local[a] = placed[nodes[a]]
        hessian = np.zeros((27, 27))
        for q in range(weights.shape[0]):
            n, ns, nt = shapes[q], along_first[q], along_second[q]
            x, s, t = n @ local, ns @ local, nt @ local
            normal = np.cross(s, t)
            w = factor * weights[q] * THIRD
            volume += weights[q] * THIRD * np.dot(x, normal)
            from_s, from_t = np.cross(t, x), np.cross(x, s)
            for i in range(3):
                for k in range(3):
                    e_x[i, k] = w * np.dot(epsilon[i, k], x)
                    e_s[i, k] = w * np.dot(epsilon[i, k], s)
                    e_t[i, k] = w * np.dot(epsilon[i, k], t)
            for a in range(9):
                for i in range(3):
                    residual[3 * nodes[a] + i] += w * (
                        n[a] * normal[i] + ns[a] * from_s[i] + nt[a] * from_t[i]
                    )
                for c in range(9):
                    on_t = n[a] * ns[c] - ns[a] * n[c]
                    on_s = nt[a] * n[c] - n[a] * nt[c]
                    on_x = ns[a] * nt[c] - nt[a] * ns[c]
                    for i in range(3):
                        for k in range(3):
                            hessian[3 * a + i, 3 * c + k] += (
                                on_t * e_t[i, k] + on_s * e_s[i, k] + on_x * e_x[i, k]
                            )
        for row in range(27):
            for column in range(27):
                at = position[face, row, column]
                if at >= 0:
                    data[at] += hessian[row, column]
    return volume


@njit(cache=True)
def membrane(
    displacement: Floats,
    nodes_at: Floats,
    faces: Indices,
    along_first: Floats,
    along_second: Floats,
    weights: Floats,
    stiffness: float,
    poisson: float,
    residual: Floats,
    position: Indices,
    data: Floats,
) -> None:  # pragma: no cover - compiled
    """Add residual and tangent of the paper: a St. Venant–Kirchhoff membrane on plane faces z = 0.

    W = Et / (2 (1 − ν²)) [(1 − ν) E : E + ν (tr E)²], E the Green strain in the plane;
    ``stiffness`` is Et [c1 · mm]. The other arguments are those of ``face_shapes`` and ``solid``.
    """
    shear = stiffness / (1.0 + poisson)
    dilation = stiffness * poisson / (1.0 - poisson * poisson)
    gradient = np.empty((9, 2))
    first = np.empty((3, 2))
    strain = np.empty((2, 2))
    stress = np.empty((2, 2))
    for face in range(faces.shape[0]):
        nodes = faces[face]
        length = nodes_at[nodes[8], 0] - nodes_at[nodes[0], 0]
        width = nodes_at[nodes[8], 1] - nodes_at[nodes[0], 1]
        tangent = np.zeros((27, 27))
        for q in range(weights.shape[0]):
            w = weights[q] * length * width
            first[:] = 0.0
            first[0, 0] = first[1, 1] = 1.0
            for a in range(9):
                gradient[a, 0] = along_first[q, a] / length
                gradient[a, 1] = along_second[q, a] / width
                for i in range(3):
                    for j in range(2):
                        first[i, j] += displacement[nodes[a], i] * gradient[a, j]
            for i in range(2):
                for j in range(2):
                    total = -1.0 if i == j else 0.0
                    for m in range(3):
                        total += first[m, i] * first[m, j]
                    strain[i, j] = 0.5 * total
            trace = strain[0, 0] + strain[1, 1]
            for i in range(2):
                for j in range(2):
                    stress[i, j] = shear * strain[i, j] + (dilation * trace if i == j else 0.0)
            traction = first @ stress
            metric = first @ first.T
            for a in range(9):
                push_a = first @ gradient[a]
                stress_a = stress @ gradient[a]
                for i in range(3):
                    residual[3 * nodes[a] + i] += w * np.dot(traction[i], gradient[a])
                for c in range(9):
                    push_c = first @ gradient[c]
                    geometric = np.dot(stress_a, gradient[c])
                    inner = np.dot(gradient[a], gradient[c])
                    for i in range(3):
                        for k in range(3):
                            value = dilation * push_a[i] * push_c[k] + 0.5 * shear * (
                                inner * metric[i, k] + push_c[i] * push_a[k]
                            )
                            if i == k:
                                value += geometric
                            tangent[3 * a + i, 3 * c + k] += w * value
        for row in range(27):
            for column in range(27):
                at = position[face, row, column]
                if at >= 0:
                    data[at] += tangent[row, column]
