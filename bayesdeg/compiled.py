"""Decorator for compiled kernels of a density: numba's, with types."""

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
"""Bytes of free memory that a process keeps, and largest array allocated from it."""


@functools.cache
def _keep_memory() -> None:
    """Ask glibc to keep freed memory.

    The arrays of a density are as large as the blocks that glibc returns to the system by default;
    faulting their pages in again took a fifth of the time of a fit.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries lack it
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, KEPT)
        mallopt(_M_MMAP_THRESHOLD, LARGEST)


class _Kernel:
    """A function compiled at its first call, with those that it calls.

    Numba is slow to import; code that only reads data never needs it.
    """

    def __init__(self, function: FunctionType) -> None:
        self._function = function
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.dispatcher(*arguments)

    @cached_property
    def dispatcher(self) -> Callable[..., Any]:
        """Numba's dispatcher, which other compiled functions can call."""
        _keep_memory()
        numba = importlib.import_module("numba")
        around = self._function.__globals__
        for name in self._function.__code__.co_names:
            if isinstance(called := around.get(name), _Kernel):
                around[name] = called.dispatcher
        # only fused multiply-add is allowed: sums are never reordered
        compile_it = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
        found: Callable[..., Any] = compile_it(self._function)
        return found


def compiled[F: Callable[..., object]](function: F) -> F:
    """Compile a function at its first call, and cache the result.

    Sums are evaluated in the order written, so that a density has the same bits on every machine of
    a kind; division by zero gives infinity, as in numpy.

    Parameters
    ----------
    function : callable
        Takes only arrays and numbers. Compiled functions that it calls must be in its module.
    """
    return cast(F, _Kernel(cast(FunctionType, function)))
