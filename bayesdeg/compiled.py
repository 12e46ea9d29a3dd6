"""The decorator of the kernels that a density runs through: numba's, with types."""

from collections.abc import Callable
from typing import cast

from numba import njit

# products may be taken into one rounding, nothing else: no sum is taken in another order
_NJIT = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})


def compiled[F: Callable[..., object]](function: F) -> F:
    """Compile a function at its first call, and keep what was compiled.

    Sums are taken in the order in which they are written, so that a density has the same bits on
    every machine of a kind; division by zero gives infinity, as numpy's does.

    Parameters
    ----------
    function : callable
        Of arrays and numbers alone.
    """
    return cast(F, _NJIT(function))
