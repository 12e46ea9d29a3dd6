"""Direct solution of the sparse symmetric systems of Newton's method.

By itself pypardiso searches every folder of the environment for the library, on import and again
for each solver, which takes longer than a solution.
"""

import ctypes
import os
import sys
from collections.abc import MutableMapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse import linalg as sparse_linalg

# library of the wheel ``mkl``, under sys.prefix: Linux, macOS, Windows
PLACES = ("lib/libmkl_rt.so*", "lib/libmkl_rt*.dylib", "Library/bin/mkl_rt*.dll")
VARIABLE = "PYPARDISO_MKL_RT"
LAYER = "MKL_THREADING_LAYER"  # one thread per process: no threading runtime is needed


def name_library(
    prefix: Path = Path(sys.prefix), environment: MutableMapping[str, str] = os.environ
) -> None:
    """Tell pypardiso where the library is, unless the user did; if missing, let it search.

    Parameters
    ----------
    prefix : Path
        Prefix of the environment.
    environment : mapping
        Receives ``PYPARDISO_MKL_RT``, also for worker processes.
    """
    found = [path for place in PLACES for path in prefix.glob(place)]
    if found:
        environment.setdefault(VARIABLE, str(min(found, key=lambda path: len(path.name))))


name_library()
os.environ.setdefault(LAYER, "SEQUENTIAL")
try:  # MKL exists for x86-64 only
    import pypardiso as pypardiso
except ImportError:  # pragma: no cover - depends on the machine
    pypardiso = None


Floats = NDArray[np.float64]

# PARDISO's parameters for definite matrices: not all default, nested dissection, no iterative
# refinement, which costs more than solutions and is made unnecessary by Newton's method and the
# corrections here
_PARAMETERS = {1: 1, 2: 2, 8: 0}
_NOT_POSITIVE = (-4, -7)  # PARDISO's errors for a pivot that is not positive


class LostDefinitenessError(ArithmeticError):
    """The tangent is no longer positive definite: the equilibrium is not stable."""


class Factorization(Protocol):
    """A direct solver for symmetric systems of one pattern."""

    name: str

    def factorize(self, data: Floats) -> int:
        """Factorize the matrix with these entries of its upper triangle.

        Returns the number of negative eigenvalues. Raises LostDefinitenessError if it is singular,
        or if it must be positive definite and is not.
        """

    def solve(self, right: Floats) -> Floats:
        """Solve with the last factors for one right-hand side, shape (n,), or several, (n, k)."""

    def close(self) -> None:
        """Release the memory."""


@dataclass
class Pardiso:
    """Cholesky or LDLᵀ factors by MKL's PARDISO; the symbolic analysis is done once.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle, with sorted indices and every diagonal entry.
    is_definite : bool
        Whether the matrices must be positive definite.
    """

    upper: sp.csr_array
    is_definite: bool
    name: str = "pypardiso"
    _solver: "pypardiso.PyPardisoSolver" = field(init=False, repr=False)
    _analysed: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        """Open the solver on one thread: the same sums in the same order on every machine."""
        self._solver = pypardiso.PyPardisoSolver(mtype=2 if self.is_definite else -2)
        self._solver.libmkl.MKL_Set_Num_Threads(ctypes.c_int(1))
        for place, value in _PARAMETERS.items() if self.is_definite else ():
            self._solver.set_iparm(place, value)

    def factorize(self, data: Floats) -> int:
        """Factorize, see `Factorization`."""
        self.upper.data = data
        self._solver.set_phase(22 if self._analysed else 12)
        try:
            self._solver._call_pardiso(self.upper, np.zeros(self.upper.shape[0]))
        except pypardiso.pardiso_wrapper.PyPardisoError as error:
            if self.is_definite:
                if error.value not in _NOT_POSITIVE:
                    raise
                self._analysed = True
            raise LostDefinitenessError from error
        self._analysed = True
        return 0 if self.is_definite else int(self._solver.get_iparm(23))

    def solve(self, right: Floats) -> Floats:
        """Solve with the last factors."""
        self._solver.set_phase(33)
        solution: Floats = self._solver._call_pardiso(self.upper, np.asfortranarray(right))
        return solution

    def close(self) -> None:
        """Release MKL's memory, which outlives the Python object."""
        self._solver.free_memory(everything=True)


@dataclass
class SuperLU:
    """The fallback without MKL: SuperLU in symmetric mode, without pivoting.

    Parameters
    ----------
    upper, is_definite
        As in `Pardiso`.
    """

    upper: sp.csr_array
    is_definite: bool
    name: str = "splu"
    _factors: "sparse_linalg.SuperLU | None" = field(default=None, init=False, repr=False)

    def factorize(self, data: Floats) -> int:
        """Factorize, see `Factorization`; the signs of pivots are those of eigenvalues."""
        self.upper.data = data
        full = self.upper + sp.triu(self.upper, k=1).T
        try:
            self._factors = sparse_linalg.splu(
                sp.csc_array(full),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:  # exactly singular
            raise LostDefinitenessError from error
        pivots = self._factors.U.diagonal()
        if self.is_definite:
            exchanged = not np.array_equal(self._factors.perm_r, self._factors.perm_c)
            if exchanged or not np.all(pivots > 0.0):
                raise LostDefinitenessError
        return int(np.sum(pivots < 0.0))

    def solve(self, right: Floats) -> Floats:
        """Solve with the last factors."""
        assert self._factors is not None
        return np.asarray(self._factors.solve(np.ascontiguousarray(right)), dtype=np.float64)

    def close(self) -> None:
        """Drop the factors."""
        self._factors = None


def open_factorization(
    upper: sp.csr_array, name: str | None = None, *, is_definite: bool = True
) -> Factorization:
    """Return a direct solver with its own matrix entries.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle.
    name : {"pypardiso", "splu"}, optional
        The solver; by default the first one installed.
    is_definite : bool
        Whether the matrices must be positive definite.
    """
    own = sp.csr_array((np.zeros(upper.nnz), upper.indices, upper.indptr), shape=upper.shape)
    if name == "splu" or (name is None and pypardiso is None):
        return SuperLU(own, is_definite)
    return Pardiso(own, is_definite)
