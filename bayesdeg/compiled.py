"""The decorator of the kernels that a density runs through: numba's, with types."""

import functools
import importlib
from collections.abc import Callable
from functools import cached_property
from types import FunctionType
from typing import Any, cast


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
