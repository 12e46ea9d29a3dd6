"""Unknowns numbered and sparsity resolved: everything that is done once for a body."""

from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayesdeg.actuator.body import Body
from bayesdeg.actuator.paper import bending_matrix

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Places = NDArray[np.int32]


@dataclass(frozen=True)
class State:
    """An equilibrium, or a guess of one.

    Parameters
    ----------
    displacement : array, shape (n_nodes, 3)
        [mm].
    pressure : array, shape (n_elements, n_modes)
        Pressure field in the solid [C1].
    load : float
        Gauge pressure in the cavity over C1 [–].
    """

    displacement: Floats
    pressure: Floats
    load: float

    def moved(self, displacement: Floats, pressure: Floats, load: float = 0.0) -> Self:
        """Return this state with increments added."""
        return replace(
            self,
            displacement=self.displacement + displacement,
            pressure=self.pressure + pressure,
            load=self.load + load,
        )


@dataclass(frozen=True)
class Point:
    """An equilibrium with the path's tangent d(state)/d(load)."""

    state: State
    rate: State


class System:
    """A body with its unknowns numbered and its sparsity resolved.

    Parameters
    ----------
    body : Body
        What is held, pressed and papered.

    Attributes
    ----------
    free : array
        Positions of the unknowns among all degrees of freedom ``3 node + axis``.
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle of the tangent.
    solid_at, cavity_at, paper_at : array of int
        Where entries of elements and faces stand in its data.
    bending : scipy.sparse.csr_array
        Hessian of the paper's bending for a unit stiffness, on all degrees of freedom.
    bending_at, bending_values : array
        Where its entries stand in the data, and what they are.
    inverse_mass : array, shape (n_elements, n_modes, n_modes)
        Inverse of ∫ modesᵀ modes dV.
    volumes : array, shape (n_nodes,)
        ∫ N dV: the volume that belongs to each node [mm³].
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.free: Indices = np.flatnonzero(~body.fixed.ravel())
        equation = self._equation()
        bending = sp.coo_array(bending_matrix(body).tocsr())
        self.bending: sp.csr_array = bending.tocsr()
        self.upper, self.solid_at, spare = _pattern(equation, body.elements, bending)
        self.bending_at, self.bending_values = spare
        self.cavity_at = _positions(equation, body.cavity, self.upper)
        self.paper_at = _positions(equation, body.paper, self.upper)
        self._measure(body)

    def _measure(self, body: Body) -> None:
        modes = body.element.modes
        mass = np.einsum("eq,qm,qn->emn", body.weights, modes, modes, optimize=True)
        self.inverse_mass: Floats = np.ascontiguousarray(np.linalg.inv(mass))
        shares = body.weights @ body.element.shapes
        self.volumes: Floats = np.bincount(
            body.elements.ravel(), shares.ravel(), minlength=len(body.nodes)
        )

    def with_body(self, body: Body) -> Self:
        """Return this system for a body of the same bricks in other places: numbering is shared."""
        other = copy(self)
        other.body = body
        other._measure(body)
        bending = sp.coo_array(bending_matrix(body).tocsr())
        other.bending = bending.tocsr()
        other.bending_values = bending.data[_kept(bending, self._equation())]
        return other

    def _equation(self) -> Indices:
        equation = np.full(self.body.fixed.size, -1, dtype=np.int64)
        equation[self.free] = np.arange(len(self.free))
        return equation

    def rest(self) -> State:
        """Return the undeformed state."""
        body = self.body
        pressure = np.zeros((len(body.elements), body.element.modes.shape[1]))
        return State(np.zeros_like(body.nodes), pressure, load=0.0)

    def expand(self, unknowns: Floats) -> Floats:
        """Return values of the unknowns as a field over the nodes, (n_nodes, 3)."""
        field = np.zeros(3 * len(self.body.nodes))
        field[self.free] = unknowns
        return field.reshape(-1, 3)


def _degrees(nodes: Indices) -> Indices:
    """Degrees of freedom of elements, component by component."""
    return (3 * nodes[:, None, :] + np.arange(3)[:, None]).reshape(len(nodes), -1)


def _stored_pairs(n_local: int) -> tuple[Indices, Indices]:
    """Rows and columns of an element's upper triangle in the order of ``scatter_upper``."""
    rows, columns = [], []
    for i in range(3):
        for j in range(i, 3):
            a, b = np.meshgrid(np.arange(n_local), np.arange(n_local), indexing="ij")
            wanted = (b >= a) if i == j else np.ones_like(a, dtype=bool)
            rows.append(i * n_local + a[wanted])
            columns.append(j * n_local + b[wanted])
    return np.concatenate(rows), np.concatenate(columns)


def _kept(bending: sp.coo_array, equation: Indices) -> NDArray[np.bool_]:
    rows, columns = equation[bending.coords[0]], equation[bending.coords[1]]
    return (rows >= 0) & (columns >= rows)


def _pattern(
    equation: Indices, elements: Indices, bending: sp.coo_array
) -> tuple[sp.csr_array, Places, tuple[Places, Floats]]:
    """Pattern of the upper triangle; where entries of elements and of the bending stand in it."""
    count = int(equation.max()) + 1
    local = equation[_degrees(elements)]
    first, second = _stored_pairs(elements.shape[1])
    one, other = local[:, first], local[:, second]
    stored = (one >= 0) & (other >= 0)
    keys = (np.minimum(one, other) * count + np.maximum(one, other))[stored]
    kept = _kept(bending, equation)
    extra = equation[bending.coords[0][kept]] * count + equation[bending.coords[1][kept]]
    every, inverse = np.unique(np.concatenate([keys, extra]), return_inverse=True)
    upper = _from_keys(every, count)
    at = np.full(stored.shape, -1, dtype=np.int32)
    at[stored] = inverse[: len(keys)]
    return upper, at, (inverse[len(keys) :].astype(np.int32), bending.data[kept])


def _from_keys(keys: Indices, count: int) -> sp.csr_array:
    pointers = np.searchsorted(keys // count, np.arange(count + 1))
    return sp.csr_array(
        (np.zeros(len(keys)), (keys % count).astype(np.int32), pointers.astype(np.int32)),
        shape=(count, count),
    )


def _positions(equation: Indices, faces: Indices, upper: sp.csr_array) -> Places:
    """Where entries of faces stand: their nodes all belong to one element, so they exist."""
    degrees = (3 * faces[:, :, None] + np.arange(3)).reshape(len(faces), 3 * faces.shape[1])
    local, count = equation[degrees], upper.shape[0]
    keys = np.repeat(np.arange(count), np.diff(upper.indptr)) * count + upper.indices
    rows = np.repeat(local[:, :, None], local.shape[1], axis=2)
    columns = np.swapaxes(rows, 1, 2)
    stored = (rows >= 0) & (columns >= rows)
    at = np.full(stored.shape, -1, dtype=np.int32)
    at[stored] = np.searchsorted(keys, rows[stored] * count + columns[stored])
    return at
