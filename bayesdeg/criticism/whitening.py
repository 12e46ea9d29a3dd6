r"""A covariance of specimens' own blocks and of what they share, and the scale on which it is one.

.. math:: \Sigma = B (I + Q D^2 Q^T) B^T, \qquad B B^T = V,\quad Q D = B^{-1} X \Lambda^{-1/2}

with V the scatter, in which readings of different specimens are independent, and X Λ⁻¹ Xᵀ of as low
a rank as there are parameters. So cost grows with the number of readings, and not with its cube.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

Floats = NDArray[np.float64]

FAINT = 1e-12  # of the largest: a direction in which nothing is shared


@dataclass(frozen=True)
class Whitening:
    """A covariance Σ as maps to the scale on which it is the unit matrix, and back.

    Parameters
    ----------
    lower, inverse : sparse array, shape (n, n)
        B, lower triangular in the order of each block's readings, and its inverse.
    basis : array, shape (n, r)
        Q, orthonormal.
    size : array, shape (r,)
        Diagonal of D.

    Examples
    --------
    >>> shared = np.array([[1.0], [1.0]])
    >>> law = Whitening.of(np.diag([1.0, 4.0]), shared)
    >>> (law.factor @ law.factor.T).round(6)
    array([[2., 1.],
           [1., 5.]])
    """

    lower: csr_array
    inverse: csr_array
    basis: Floats
    size: Floats

    @classmethod
    def of(cls, scatter: Floats, shared: Floats) -> "Whitening":
        """Return the whitening of scatter + shared sharedᵀ.

        Parameters
        ----------
        scatter : array, shape (n, n)
            V; zero between readings of different specimens.
        shared : array, shape (n, r)
            X Λ^(−1/2), or another root of what is shared.

        Raises
        ------
        LinAlgError
            If V is not positive definite. Numbers that are not finite are kept.
        """
        lower, inverse = _blocks(scatter)
        vectors, size, _ = np.linalg.svd(_finite(inverse @ shared), full_matrices=False)
        kept = size > FAINT * size.max(initial=1.0)
        if not np.all(np.isfinite(shared)):
            vectors = np.full_like(vectors, np.nan)
        return cls(lower, inverse, vectors[:, kept], size[kept])

    @cached_property
    def is_finite(self) -> bool:
        """Whether there is a number everywhere."""
        return bool(np.all(np.isfinite(self.lower.data)) and np.all(np.isfinite(self.basis)))

    @property
    def factor(self) -> Floats:
        """A root F of Σ = F Fᵀ with F z what `coloured` returns, (n, n)."""
        return self.coloured(np.eye(self.lower.shape[0]))

    def whitened(self, columns: Floats) -> Floats:
        """Return F⁻¹ y of y (n,) or of columns (n, k)."""
        return self._turned(self.inverse @ columns, 1.0 / np.sqrt(1.0 + self.size**2))

    def coloured(self, columns: Floats) -> Floats:
        """Return F z of z (n,) or of columns (n, k)."""
        coloured: Floats = self.lower @ self._turned(columns, np.sqrt(1.0 + self.size**2))
        return coloured

    def adjoint(self, columns: Floats) -> Floats:
        """Return F⁻ᵀ z of z (n,) or of columns (n, k): Σ⁻¹ y is that of whitened y."""
        turned = self._turned(columns, 1.0 / np.sqrt(1.0 + self.size**2))
        found: Floats = self.inverse.T @ turned
        return found

    def _turned(self, columns: Floats, stretch: Floats) -> Floats:
        along = (stretch - 1.0) * (self.basis.T @ columns).T
        turned: Floats = columns + self.basis @ along.T
        return turned


def _blocks(scatter: Floats) -> tuple[csr_array, csr_array]:
    """Return the Cholesky factor of a covariance, block by block, and its inverse."""
    count, member = connected_components(csr_array(scatter != 0.0), directed=False)
    lower, inverse = [], []
    order = np.argsort(member, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(member[order])) + 1) if count else ():
        block = scatter[np.ix_(rows, rows)]
        if np.all(np.isfinite(block)):
            factor = np.linalg.cholesky(block)
            back = solve_triangular(factor, np.eye(len(rows)), lower=True)
        else:
            factor = back = np.tril(np.full(block.shape, np.nan))
        lower.append((rows, factor))
        inverse.append((rows, back))
    return _sparse(lower, len(scatter)), _sparse(inverse, len(scatter))


def _sparse(blocks: list[tuple[NDArray[np.intp], Floats]], size: int) -> csr_array:
    row = np.concatenate([np.repeat(rows, len(rows)) for rows, _ in blocks])
    column = np.concatenate([np.tile(rows, len(rows)) for rows, _ in blocks])
    values = np.concatenate([block.ravel() for _, block in blocks])
    kept = values != 0.0
    return csr_array(coo_array((values[kept], (row[kept], column[kept])), shape=(size, size)))


def _finite(columns: Floats) -> Floats:
    return np.where(np.isfinite(columns), columns, 0.0)
