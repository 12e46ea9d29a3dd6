"""The paper on the bottom or inside, compiled: a possibly slack membrane with bending stiffness.

The energy of a plate that bends without stretching is ½ D ∫ |∇∇x|² dX, quadratic in the positions
and unchanged by rotations. The plane's nodes stand in a rectangular grid, so second derivatives
are taken as differences over neighbouring nodes; kinks between elements count.
"""

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator.body import Body, levels_of
from bayesdeg.actuator.kernels import scatter

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Places = NDArray[np.int32]


@njit(cache=True)
def membrane(
    placed: Floats,
    nodes: Floats,
    faces: Indices,
    along_first: Floats,
    along_second: Floats,
    weights: Floats,
    law: Floats,
    force: Floats,
    position: Places,
    data: Floats,
) -> float:  # pragma: no cover - compiled
    """Add force and tangent of the paper on plane faces z = const; return its energy.

    W = k Ψ(q), k = Et/(1 − ν²), q² = (1 − ν) E : E + ν (tr E)², with E the Green strain in the
    plane, measured from a paper that is longer by ``mismatch``. Without slack Ψ = q²/2: St.
    Venant–Kirchhoff. With slack s, Ψ = q²/2 − s² ln cosh(q/s): hardly any load is carried at
    strains below s, and the full stiffness far beyond.

    Parameters
    ----------
    placed, nodes : array, shape (n_nodes, 3)
        Positions now and undeformed [mm].
    faces, along_first, along_second, weights
        Of ``Body.paper`` and ``kernels.face_shapes``.
    law : array, shape (4,)
        Et [C1 mm], ν, slack, mismatch.
    force, position, data
        As in ``kernels.cavity_volume``.
    """
    total, count = 0.0, faces.shape[1]
    gradient, local = np.empty((count, 2)), np.empty((count, 3))
    for face in range(faces.shape[0]):
        for a in range(count):
            for i in range(3):
                local[a, i] = placed[faces[face, a], i]
        frame, area = _frame(nodes, faces[face], 1.0 + law[3])
        tangent = np.zeros((3 * count, 3 * count))
        for q in range(weights.shape[0]):
            for a in range(count):
                for i in range(2):
                    gradient[a, i] = (
                        along_first[q, a] * frame[0, i] + along_second[q, a] * frame[1, i]
                    )
            w = weights[q] * area
            first = local.T @ gradient
            plain, share, slope, energy = membrane_law(first, law)
            total += w * energy
            push = gradient @ (first @ plain).T
            for a in range(count):
                for i in range(3):
                    force[faces[face, a], i] += w * share * push[a, i]
            if data.size > 0:
                _add_stiffness(gradient, first, w * share, law, tangent)
                _add_stress(gradient, w * share * plain, push, w * slope, tangent)
        if data.size > 0:
            scatter(tangent, position[face], data)
    return total


@njit(cache=True)
def _frame(
    nodes: Floats, face: Indices, longer: float
) -> tuple[Floats, float]:  # pragma: no cover - compiled
    """Return the gradients of a face's two axes, and the area that these span.

    Of a rectangle of paper, or a triangle, before it was bonded: (2, 2) [1/mm], [mm²].
    """
    side = int(np.sqrt(face.shape[0]) + 0.5)
    first, second = 1, 2  # corners of a triangle
    if side * side == face.shape[0]:
        first, second = side * (side - 1), side - 1
    a = (nodes[face[first]] - nodes[face[0]]) * longer
    b = (nodes[face[second]] - nodes[face[0]]) * longer
    area = a[0] * b[1] - a[1] * b[0]
    frame = np.array([[b[1], -b[0]], [-a[1], a[0]]]) / area
    return frame, abs(area)


@njit(cache=True)
def membrane_law(
    first: Floats, law: Floats
) -> tuple[Floats, float, float, float]:  # pragma: no cover - compiled
    """Return the law at one point from its deformation gradient (3, 2).

    The stress is S = share · plain, plain = k [(1 − ν) E + ν tr E I] that of a paper without
    slack; further 2/k d(share)/d(q²), and the energy.
    """
    poisson, slack = law[1], law[2]
    k = law[0] / (1.0 - poisson * poisson)
    strain = 0.5 * (first.T @ first - np.eye(2))
    direction = (1.0 - poisson) * strain + poisson * np.trace(strain) * np.eye(2)
    square = np.sum(direction * strain)
    share, slope, energy = 1.0, 0.0, 0.5 * square
    if slack > 0.0:
        x = np.sqrt(square) / slack
        if x < 1e-2:  # the same, expanded
            share = x**2 / 3.0 - 2.0 * x**4 / 15.0 + 17.0 * x**6 / 315.0
            slope = 1.0 / 3.0 - 4.0 * x**2 / 15.0 + 17.0 * x**4 / 105.0
            energy = slack**2 * (x**4 / 12.0 - x**6 / 45.0)
        else:
            t = np.tanh(x)
            share = 1.0 - t / x
            slope = 0.5 * (t / x - 1.0 + t * t) / (x * x)
            energy = 0.5 * square - slack**2 * (x + np.log1p(np.exp(-2.0 * x)) - np.log(2.0))
        slope *= 2.0 / (k * slack**2)
    return k * direction, share, slope, k * energy


@njit(cache=True)
def _add_stiffness(
    gradient: Floats, first: Floats, w: float, law: Floats, tangent: Floats
) -> None:  # pragma: no cover - compiled
    """Add one point's material tangent with ∂plain/∂E, unknowns node by node."""
    shear = w * law[0] / (1.0 + law[1])
    dilation = shear * law[1] / (1.0 - law[1])
    push = gradient @ first.T
    metric = 0.5 * shear * (first @ first.T)
    inner = gradient @ gradient.T
    count = gradient.shape[0]
    for a in range(count):
        for i in range(3):
            here = dilation * push[a, i]
            for c in range(count):
                other = 0.5 * shear * push[c, i]
                for k in range(3):
                    tangent[3 * a + i, 3 * c + k] += (
                        here * push[c, k] + other * push[a, k] + inner[a, c] * metric[i, k]
                    )


@njit(cache=True)
def _add_stress(
    gradient: Floats, stress: Floats, push: Floats, w: float, tangent: Floats
) -> None:  # pragma: no cover - compiled
    """Add one point's geometric tangent, and what a changing share of the stress adds."""
    geometric = gradient @ stress @ gradient.T
    for a in range(gradient.shape[0]):
        for c in range(gradient.shape[0]):
            for i in range(3):
                tangent[3 * a + i, 3 * c + i] += geometric[a, c]
    if w != 0.0:
        flat = push.reshape(push.size)
        tangent += w * np.outer(flat, flat)


@njit(cache=True)
def membrane_rate(
    placed: Floats,
    nodes: Floats,
    faces: Indices,
    along_first: Floats,
    along_second: Floats,
    weights: Floats,
    law: Floats,
    rates: Floats,
) -> None:  # pragma: no cover - compiled
    """Add the derivatives of the membrane's force by Et, slack and mismatch to ``rates``.

    ``rates`` has the shape (3, n_nodes, 3); other arguments as for ``membrane``. At zero slack
    the second is the one-sided derivative.
    """
    count, longer = faces.shape[1], 1.0 + law[3]
    gradient, local = np.empty((count, 2)), np.empty((count, 3))
    for face in range(faces.shape[0]):
        for a in range(count):
            local[a] = placed[faces[face, a]]
        frame, area = _frame(nodes, faces[face], longer)
        for q in range(weights.shape[0]):
            for i in range(2):
                gradient[:, i] = along_first[q] * frame[0, i] + along_second[q] * frame[1, i]
            w = weights[q] * area
            first = local.T @ gradient
            plain, share, slope, _ = membrane_law(first, law)
            changes = _stress_rates(first, law, plain, share, slope)
            for j in range(3):
                push = gradient @ (first @ changes[j]).T
                for a in range(count):
                    rates[j, faces[face, a]] += w * push[a]


@njit(cache=True)
def _stress_rates(
    first: Floats, law: Floats, plain: Floats, share: float, slope: float
) -> Floats:  # pragma: no cover - compiled
    """Return ∂S/∂(Et, slack, mismatch), (3, 2, 2)."""
    out = np.zeros((3, 2, 2))
    k, poisson = law[0] / (1.0 - law[1] * law[1]), law[1]
    metric = first.T @ first
    square = np.sum(plain * 0.5 * (metric - np.eye(2))) / k
    if law[0] > 0.0:
        out[0] = share * plain / law[0]
    if law[2] > 0.0:
        out[1] = -square * slope * k / law[2] * plain
    elif square > 0.0:
        out[1] = -plain / np.sqrt(square)
    # the paper's own size cancels in the force but for the strain: dE = −C dm/(1 + m)
    change = -metric / (1.0 + law[3])
    stiff = k * ((1.0 - poisson) * change + poisson * np.trace(change) * np.eye(2))
    out[2] = share * stiff + slope * np.sum(plain * change) * plain
    return out


# degrees of freedom, (n, k), and the factors (n, k) whose products with them are squared
Stencils = tuple[Indices, Floats]

ALL, UP_ONLY, BUT_ACROSS = (0, 1, 2), (2,), (0, 2)


def bending_matrix(body: Body) -> sp.coo_array:
    """Return the Hessian of ½ ∫ |∇∇x|² dX over the papered faces, (3 n_nodes, 3 n_nodes).

    Where the body is clamped, so is the paper; where it is cut at a plane of symmetry y = 0, the
    other half follows. Triangles form no grid: on sides of tetrahedra the paper has no bending
    stiffness, and the matrix is zero.

    Parameters
    ----------
    body : Body
        Its papered faces fill a rectangle.

    Raises
    ------
    ValueError
        If they do not.
    """
    size = 3 * len(body.nodes)
    if len(body.paper) == 0 or body.element.triangular:
        return sp.coo_array((size, size))
    nodes = np.unique(body.paper)
    x, first = levels_of(body.nodes[nodes, 0])
    y, second = levels_of(body.nodes[nodes, 1])
    if len(nodes) != len(x) * len(y):
        raise ValueError("the papered faces do not fill a rectangle")
    grid = np.empty((len(x), len(y)), dtype=np.int64)
    grid[first, second] = nodes
    parts = [
        *_along(grid, x, _lengths(y)[None, :]),
        *_along(grid.T, y, _lengths(x)[None, :]),
        *_twist(grid, x, y),
    ]
    # the slope is zero at the clamp and at the plane of symmetry
    if np.all(body.fixed[grid[0]]):
        parts += _mirrored(grid, x, _lengths(y), UP_ONLY)
    if np.all(body.fixed[grid[:, 0], 1]):
        parts += _mirrored(grid.T, y, _lengths(x), BUT_ACROSS)
    rows, columns, values = list[Indices](), list[Indices](), list[Floats]()
    for degrees, factors in parts:
        shape = (*degrees.shape, degrees.shape[1])
        rows.append(np.broadcast_to(degrees[:, :, None], shape).ravel())
        columns.append(np.broadcast_to(degrees[:, None, :], shape).ravel())
        values.append((factors[:, :, None] * factors[:, None, :]).ravel())
    places = np.concatenate(rows), np.concatenate(columns)
    return sp.coo_array((np.concatenate(values), places), shape=(size, size))


def _lengths(at: Floats) -> Floats:
    """Length that belongs to each point of a line."""
    lengths = np.zeros(len(at))
    lengths[:-1] += 0.5 * np.diff(at)
    lengths[1:] += 0.5 * np.diff(at)
    return lengths


def _along(grid: Indices, at: Floats, width: Floats) -> list[Stencils]:
    """Second derivative along the first axis at inner points, weighted by the area's root."""
    before, after = np.diff(at)[:-1, None], np.diff(at)[1:, None]
    total = before + after
    factors = np.stack(
        np.broadcast_arrays(2 / (before * total), -2 / (before * after), 2 / (after * total)), -1
    )
    area = 0.5 * total * width
    nodes = np.stack([grid[:-2], grid[1:-1], grid[2:]], axis=-1)
    weighted = np.sqrt(area)[..., None] * factors
    return _for_components(nodes.reshape(-1, 3), weighted.reshape(-1, 3), ALL)


def _twist(grid: Indices, x: Floats, y: Floats) -> list[Stencils]:
    """Mixed second derivative, twice, in every cell of the grid."""
    area = np.diff(x)[:, None] * np.diff(y)[None, :]
    nodes = np.stack([grid[1:, 1:], grid[:-1, 1:], grid[1:, :-1], grid[:-1, :-1]], axis=-1)
    factors = np.sqrt(2.0 / area)[..., None] * np.array([1.0, -1.0, -1.0, 1.0])
    return _for_components(nodes.reshape(-1, 4), factors.reshape(-1, 4), ALL)


def _mirrored(
    grid: Indices, at: Floats, width: Floats, components: tuple[int, ...]
) -> list[Stencils]:
    step = at[1] - at[0]
    factors = np.sqrt(0.5 * step * width)[:, None] * 2.0 / step**2 * np.array([1.0, -1.0])
    nodes = np.stack([grid[1], grid[0]], axis=-1)
    return _for_components(nodes, factors, components)


def _for_components(nodes: Indices, factors: Floats, components: tuple[int, ...]) -> list[Stencils]:
    return [(3 * nodes + component, factors) for component in components]
