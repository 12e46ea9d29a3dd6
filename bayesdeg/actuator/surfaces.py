"""Compiled kernels on surfaces: the volume of the cavity and the paper under the actuator.

Faces are biquadratic, their nodes in 3 × 3 grid order.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator.kernels import scatter

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
    values = np.kron(n, n)
    first, second = np.kron(dn, n), np.kron(n, dn)
    weights = np.kron(GAUSS_WEIGHTS, GAUSS_WEIGHTS)
    return tuple(np.asarray(a, dtype=np.float64) for a in (values, first, second, weights))  # type: ignore[return-value]


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
    force = np.empty(27)
    hessian = np.empty((27, 27))
    local = np.empty((9, 3))
    for face in range(faces.shape[0]):
        nodes = faces[face]
        for a in range(9):
            local[a] = placed[nodes[a]]
        force[:] = 0.0
        hessian[:] = 0.0
        for q in range(weights.shape[0]):
            n, ns, nt = shapes[q], along_first[q], along_second[q]
            x, s, t = n @ local, ns @ local, nt @ local
            w = factor * weights[q] * THIRD
            normal, from_s, from_t = np.cross(s, t), np.cross(t, x), np.cross(x, s)
            volume += weights[q] * THIRD * np.dot(x, normal)
            e_x, e_s, e_t = w * _axial(x), w * _axial(s), w * _axial(t)
            for a in range(9):
                force[3 * a : 3 * a + 3] += w * (n[a] * normal + ns[a] * from_s + nt[a] * from_t)
                for c in range(9):
                    on_t = n[a] * ns[c] - ns[a] * n[c]
                    on_s = nt[a] * n[c] - n[a] * nt[c]
                    on_x = ns[a] * nt[c] - nt[a] * ns[c]
                    for i in range(3):
                        for k in range(3):
                            hessian[3 * a + i, 3 * c + k] += (
                                on_t * e_t[i, k] + on_s * e_s[i, k] + on_x * e_x[i, k]
                            )
        scatter(nodes, force, hessian, residual, position[face], data)
    return volume


@njit(cache=True)
def _axial(v: Floats) -> Floats:  # pragma: no cover - compiled
    """Return the matrix with entries ε_ikm v_m."""
    return np.array([[0.0, v[2], -v[1]], [-v[2], 0.0, v[0]], [v[1], -v[0], 0.0]])


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
    for face in range(faces.shape[0]):
        nodes = faces[face]
        length = nodes_at[nodes[8], 0] - nodes_at[nodes[0], 0]
        width = nodes_at[nodes[8], 1] - nodes_at[nodes[0], 1]
        force = np.zeros(27)
        tangent = np.zeros((27, 27))
        for q in range(weights.shape[0]):
            gradient[:, 0] = along_first[q] / length
            gradient[:, 1] = along_second[q] / width
            w = weights[q] * length * width
            _membrane_point(displacement, nodes, gradient, w, shear, dilation, force, tangent)
        scatter(nodes, force, tangent, residual, position[face], data)


@njit(cache=True)
def _membrane_point(
    displacement: Floats,
    nodes: Indices,
    gradient: Floats,
    w: float,
    shear: float,
    dilation: float,
    force: Floats,
    tangent: Floats,
) -> None:  # pragma: no cover - compiled
    """Add the force and tangent of one quadrature point of weight w."""
    first = np.zeros((3, 2))
    first[0, 0] = first[1, 1] = 1.0
    for a in range(9):
        first += np.outer(displacement[nodes[a]], gradient[a])
    strain = 0.5 * (first.T @ first - np.eye(2))
    stress = shear * strain + dilation * (strain[0, 0] + strain[1, 1]) * np.eye(2)
    push = gradient @ first.T
    traction = gradient @ (first @ stress).T
    metric = first @ first.T
    geometric = (gradient @ stress) @ gradient.T
    inner = gradient @ gradient.T
    for a in range(9):
        for i in range(3):
            force[3 * a + i] += w * traction[a, i]
            for c in range(9):
                for k in range(3):
                    value = dilation * push[a, i] * push[c, k] + 0.5 * shear * (
                        inner[a, c] * metric[i, k] + push[c, i] * push[a, k]
                    )
                    if i == k:
                        value += geometric[a, c]
                    tangent[3 * a + i, 3 * c + k] += w * value
