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

# PARDISO: not all parameters default, nested dissection, no iterative refinement, which costs more
# than solutions and is made unnecessary by Newton's method and the corrections here
_PARAMETERS = {1: 1, 2: 2, 8: 0}


class LostDefinitenessError(ArithmeticError):
    """The tangent is no longer positive definite: the equilibrium is not stable."""


class Factorization(Protocol):
    """What Newton's method needs of a direct solver."""

    name: str

    def factorize(self, data: Floats) -> None:
        """Factorize the matrix with these entries of its upper triangle."""

    def solve(self, right: Floats) -> Floats:
        """Solve for one right-hand side, shape (n,), or several, (n, k)."""

    def close(self) -> None:
        """Release the memory."""


class Indefinite(Protocol):
    """What volume control needs of a direct solver."""

    def factorize(self, data: Floats) -> int:
        """Factorize; return the number of negative eigenvalues."""

    def solve(self, right: Floats) -> Floats:
        """Solve for one right-hand side, shape (n,), or several, (n, k)."""

    def close(self) -> None:
        """Release the memory."""


@dataclass
class PardisoCholesky:
    """Cholesky factors by MKL's PARDISO; the symbolic analysis is done once.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle, with sorted indices and every diagonal entry.
    """

    upper: sp.csr_array
    name: str = "pypardiso"
    _solver: "pypardiso.PyPardisoSolver" = field(init=False, repr=False)
    _analysed: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        """Open the solver on one thread: the same sums in the same order on every machine."""
        self._solver = pypardiso.PyPardisoSolver(mtype=2)
        self._solver.libmkl.MKL_Set_Num_Threads(ctypes.c_int(1))
        for place, value in _PARAMETERS.items():
            self._solver.set_iparm(place, value)

    def factorize(self, data: Floats) -> None:
        """Factorize; raises LostDefinitenessError if a pivot is not positive."""
        self.upper.data = data
        self._solver.set_phase(22 if self._analysed else 12)
        try:
            self._solver._call_pardiso(self.upper, np.zeros(self.upper.shape[0]))
        except pypardiso.pardiso_wrapper.PyPardisoError as error:
            if error.value in (-4, -7):
                self._analysed = True
                raise LostDefinitenessError from error
            raise
        self._analysed = True

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
    """The fallback without MKL: SuperLU in symmetric mode.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle.
    """

    upper: sp.csr_array
    name: str = "splu"
    _factors: "sparse_linalg.SuperLU | None" = field(default=None, init=False, repr=False)

    def factorize(self, data: Floats) -> None:
        """Factorize; raises LostDefinitenessError if a pivot is not positive."""
        self.upper.data = data
        full = self.upper + sp.triu(self.upper, k=1).T
        try:
            self._factors = _symmetric_lu(full)
        except RuntimeError as error:  # exactly singular
            raise LostDefinitenessError from error
        exchanged = not np.array_equal(self._factors.perm_r, self._factors.perm_c)
        if exchanged or not np.all(self._factors.U.diagonal() > 0.0):
            raise LostDefinitenessError

    def solve(self, right: Floats) -> Floats:
        """Solve with the last factors."""
        assert self._factors is not None
        return np.asarray(self._factors.solve(np.ascontiguousarray(right)), dtype=np.float64)

    def close(self) -> None:
        """Drop the factors."""
        self._factors = None


@dataclass
class PardisoIndefinite:
    """LDLᵀ factors by MKL's PARDISO, which count negative eigenvalues.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle.
    """

    upper: sp.csr_array
    _solver: "pypardiso.PyPardisoSolver" = field(init=False, repr=False)
    _analysed: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        """Open the solver on one thread."""
        self._solver = pypardiso.PyPardisoSolver(mtype=-2)
        self._solver.libmkl.MKL_Set_Num_Threads(ctypes.c_int(1))

    def factorize(self, data: Floats) -> int:
        """Factorize; return the number of negative eigenvalues."""
        self.upper.data = data
        self._solver.set_phase(22 if self._analysed else 12)
        try:
            self._solver._call_pardiso(self.upper, np.zeros(self.upper.shape[0]))
        except pypardiso.pardiso_wrapper.PyPardisoError as error:
            raise LostDefinitenessError from error
        self._analysed = True
        return int(self._solver.get_iparm(23))

    def solve(self, right: Floats) -> Floats:
        """Solve with the last factors."""
        self._solver.set_phase(33)
        solution: Floats = self._solver._call_pardiso(self.upper, np.asfortranarray(right))
        return solution

    def close(self) -> None:
        """Release MKL's memory."""
        self._solver.free_memory(everything=True)


@dataclass
class SuperLUIndefinite:
    """The fallback: SuperLU without pivoting; the signs of its pivots count eigenvalues.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle.
    """

    upper: sp.csr_array
    _factors: "sparse_linalg.SuperLU | None" = field(default=None, init=False, repr=False)

    def factorize(self, data: Floats) -> int:
        """Factorize; return the number of negative eigenvalues."""
        self.upper.data = data
        full = self.upper + sp.triu(self.upper, k=1).T
        try:
            self._factors = _symmetric_lu(full)
        except RuntimeError as error:  # exactly singular
            raise LostDefinitenessError from error
        return int(np.sum(self._factors.U.diagonal() < 0.0))

    def solve(self, right: Floats) -> Floats:
        """Solve with the last factors."""
        assert self._factors is not None
        return np.asarray(self._factors.solve(np.ascontiguousarray(right)), dtype=np.float64)

    def close(self) -> None:
        """Drop the factors."""
        self._factors = None


def _symmetric_lu(full: sp.csr_array) -> "sparse_linalg.SuperLU":
    return sparse_linalg.splu(
        sp.csc_array(full),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def open_indefinite(upper: sp.csr_array, name: str | None = None) -> Indefinite:
    """Return a direct solver for symmetric matrices that need not be definite.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle.
    name : {"pypardiso", "splu"}, optional
        The solver; by default the first one installed.
    """
    if name == "splu" or (name is None and pypardiso is None):
        return SuperLUIndefinite(_with_own_data(upper))
    return PardisoIndefinite(_with_own_data(upper))


def open_factorization(upper: sp.csr_array, name: str | None = None) -> Factorization:
    """Return the best available direct solver, with its own matrix entries.

    Parameters
    ----------
    upper : scipy.sparse.csr_array
        Pattern of the upper triangle.
    name : {"pypardiso", "splu"}, optional
        The solver; by default the first one installed.
    """
    own = _with_own_data(upper)
    if name == "splu" or (name is None and pypardiso is None):
        return SuperLU(own)
    return PardisoCholesky(own)


def _with_own_data(upper: sp.csr_array) -> sp.csr_array:
    return sp.csr_array((np.zeros(upper.nnz), upper.indices, upper.indptr), shape=upper.shape)
