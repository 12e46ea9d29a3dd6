"""Where runs are solved: here, or in worker processes that are opened again when one dies."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import cache
from typing import Protocol, runtime_checkable

from threadpoolctl import threadpool_limits

from bayesdeg.actuator.forward import SAMPLING, sample_task, solve_task
from bayesdeg.actuator.version import MODEL_VERSION
from bayesdeg.emulator.run import Kind, Run, Solution
from bayesdeg.errors import BayesdegError

# limits on threads hold for a whole process, and so does the solver's memory
_ONE_AT_A_TIME = threading.Lock()
# names of settings in malloc.h
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3


def solve(run: Run, key: str, timeout: float) -> tuple[Solution, float]:
    """Solve one run in this process; return its solution and the seconds that it took.

    Mesh and symbolic factorization are those of the run before if the actuator is the same.

    Parameters
    ----------
    run : Run
        What is wanted.
    key : str
        The run's name where it was asked for.
    timeout : float
        Wall time after which the path is given up, from its start [s].

    Raises
    ------
    BayesdegError
        If the run has another key here: another version of the package.
    """
    if run.key() != key:
        raise BayesdegError(
            f"a worker has another version of the finite element model (its own: {MODEL_VERSION}); "
            "install the same bayesdeg on every machine"
        )
    _keep_freed_memory()
    task, effort = (run.geometry, run.resolution, run.curve), replace(SAMPLING, seconds=timeout)
    # one thread: the same sums in the same order, hence the same bits, in whatever process
    with _ONE_AT_A_TIME, threadpool_limits(limits=1):
        start = time.perf_counter()
        solution: Solution
        if run.kind is Kind.CURVE:
            solution = solve_task(task, effort=effort)
        else:
            solution = sample_task(task, effort=effort)
        return solution, time.perf_counter() - start


@cache
def _keep_freed_memory() -> None:
    """Undo what Dask sets for its workers: giving freed memory back at once.

    Every large array then comes as untouched pages, and a run takes a quarter longer.
    """
    if "MALLOC_TRIM_THRESHOLD_" in os.environ and sys.platform == "linux":
        library = ctypes.CDLL(None)
        if hasattr(library, "mallopt"):
            library.mallopt(_TRIM_THRESHOLD, 256 << 20)
            library.mallopt(_MMAP_THRESHOLD, 32 << 20)


@runtime_checkable
class Supervised(Protocol):
    """What a campaign asks of the executors made for it, beyond ``Executor``."""

    # what a future raises if workers died of its own run
    fatal: tuple[type[BaseException], ...]

    @property
    def workers(self) -> int:
        """How many runs are solved at a time."""

    def check(self) -> None:
        """Raise BayesdegError if no result will come any more."""


class WorkerProcesses(Executor):
    """Processes on this machine, opened again after one of them died.

    Parameters
    ----------
    workers : int
        Number of processes.
    import_main : bool
        Whether they import the program that opens them, as what it defines itself needs. A script
        without ``if __name__ == "__main__"`` would start itself again in each of them.
    """

    fatal: tuple[type[BaseException], ...] = ()

    def __init__(self, workers: int, *, import_main: bool = True) -> None:
        self._workers, self._import_main = workers, import_main
        self._pool = self._open()

    @property
    def workers(self) -> int:
        """Number of processes."""
        return self._workers

    def check(self) -> None:
        """Do nothing: the futures tell of processes that die."""

    def submit[**P, T](
        self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Submit to the pool; to a new one if a process of the old one died."""
        with deaf_to_interrupts(), nullcontext() if self._import_main else main_hidden():
            try:
                return self._pool.submit(function, *args, **kwargs)
            except BrokenProcessPool:
                self._pool.shutdown()
                self._pool = self._open()
                return self._pool.submit(function, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Close the pool."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def _open(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._workers, mp_context=context, initializer=end_with_parent)


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Let processes that start meanwhile take no notice of Ctrl-C: this one tells them to end.

    They inherit what is blocked here; a signal that comes meanwhile is taken afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def main_hidden() -> Iterator[None]:
    """Let processes that start meanwhile not know from which file or module the program came."""
    main = vars(sys.modules["__main__"])
    known: dict[str, object] = {
        name: main[name] for name in ("__file__", "__spec__") if name in main
    }
    try:
        main.pop("__file__", None)
        main["__spec__"] = None
        yield
    finally:
        main.update(known)


def end_with_parent() -> None:
    """Let a worker die with the command that started it, even if that was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
