"""Faces of bricks: their shape functions, and the compiled volume of a closed cavity."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Places = NDArray[np.int32]

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


def face_shapes(order: int = 2) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the shapes of a face at the Gauss points of the unit square.

    Parameters
    ----------
    order : int
        1 or 2, of the brick behind.

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
    points, weights = gauss(order)
    n, dn = line_shapes(order, points)
    shapes = (np.kron(n, n), np.kron(dn, n), np.kron(n, dn), np.kron(weights, weights))
    return tuple(np.asarray(a, dtype=np.float64) for a in shapes)  # type: ignore[return-value]


def volume_form(order: int = 2) -> Floats:
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
    shapes, first, second, weights = face_shapes(order)
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
    holds current positions (n_nodes, 3) [mm], ``force`` is (n_nodes, 3), ``data`` is empty if the
    Hessian is not wanted; ``form`` comes from ``volume_form``.
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
