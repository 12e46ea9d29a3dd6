"""The decorator of the kernels that a density runs through: numba's, with types."""

import ctypes
import functools
import importlib
import sys
from collections.abc import Callable
from functools import cached_property
from types import FunctionType
from typing import Any, cast

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of <malloc.h>
KEPT, LARGEST = 64 * 2**20, 32 * 2**20
"""Bytes of free memory that a process keeps, and up to which an array may lie in what it keeps."""


@functools.cache
def _keep_memory() -> None:
    """Ask glibc to keep memory that is freed.

    The arrays of a density are as large as what it gives back at once by default: to get them again
    page by page took a fifth of the time of a fit.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries have none
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, KEPT)
        mallopt(_M_MMAP_THRESHOLD, LARGEST)


class _Kernel:
    """A function that is compiled, with those that it calls, when it is called first.

    Numba takes long to import: what only reads data does without.
    """

    def __init__(self, function: FunctionType) -> None:
        self._function = function
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Return what the compiled function does."""
        return self.dispatcher(*arguments)

    @cached_property
    def dispatcher(self) -> Callable[..., Any]:
        """Numba's, which other compiled functions can call."""
        _keep_memory()
        numba = importlib.import_module("numba")
        around = self._function.__globals__
        for name in self._function.__code__.co_names:
            if isinstance(called := around.get(name), _Kernel):
                around[name] = called.dispatcher
        # products may be taken into one rounding, nothing else: no sum is taken in another order
        compile_it = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
        found: Callable[..., Any] = compile_it(self._function)
        return found


def compiled[F: Callable[..., object]](function: F) -> F:
    """Compile a function at its first call, and keep what was compiled.

    Sums are taken in the order in which they are written, so that a density has the same bits on
    every machine of a kind; division by zero gives infinity, as numpy's does.

    Parameters
    ----------
    function : callable
        Of arrays and numbers alone. Compiled functions that it calls stand in its module.
    """
    return cast(F, _Kernel(cast(FunctionType, function)))
