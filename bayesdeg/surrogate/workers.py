"""Executors of runs: this process, worker processes, or a Dask cluster."""

import ctypes
import gc
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Any, Protocol, runtime_checkable

from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import SAMPLING, sample_task, solve_task
from bayesdeg.actuator.status import MODEL_VERSION
from bayesdeg.errors import BayesdegError, ResumableError
from bayesdeg.surrogate.solutions import Kind, Run, Solution

# thread limits apply to a whole process, and so does the solver's memory
_ONE_AT_A_TIME = threading.Lock()
# names of settings in malloc.h
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3


def solve(run: Run, key: str, timeout: float) -> tuple[Solution, float]:
    """Solve one run in this process; return its solution and time in seconds.

    Mesh and symbolic factorization are reused from the previous run of the same actuator. The path
    is given up after ``timeout`` seconds. A ``key`` that differs here from where the run was
    requested is of a different version of the package: BayesdegError.
    """
    if run.key() != key:
        raise BayesdegError(
            f"a worker has a different version of the finite element model ({MODEL_VERSION}); "
            "install the same bayesdeg on every machine"
        )
    _keep_freed_memory()
    task, effort = (run.geometry, run.resolution, run.curve), replace(SAMPLING, seconds=timeout)
    # one thread: the same sums in the same order, hence the same bits, in any process
    with _ONE_AT_A_TIME, threadpool_limits(limits=1):
        start = time.perf_counter()
        solution: Solution
        solver = solve_task if run.kind is Kind.CURVE else sample_task
        solution = solver(
            task, effort=effort, backend=run.backend, held=run.held, origin=run.origin
        )
        return solution, time.perf_counter() - start


@cache
def _keep_freed_memory() -> None:
    """Undo Dask's setting for its workers of returning freed memory immediately.

    It makes every large array start on untouched pages, and a run take a quarter longer.
    """
    if "MALLOC_TRIM_THRESHOLD_" in os.environ and sys.platform == "linux":
        library = ctypes.CDLL(None)
        if hasattr(library, "mallopt"):
            library.mallopt(_TRIM_THRESHOLD, 256 << 20)
            library.mallopt(_MMAP_THRESHOLD, 32 << 20)


@runtime_checkable
class Supervised(Protocol):
    """Interface of executors for campaigns, beyond ``Executor``."""

    # raised by a future if workers died of its own run
    fatal: tuple[type[BaseException], ...]

    @property
    def workers(self) -> int:
        """Number of runs solved at a time."""

    def check(self) -> None:
        """Raise BayesdegError if no more results can arrive."""


class WorkerProcesses(Executor):
    """Processes on this machine, reopened after one of them dies.

    Parameters
    ----------
    workers : int
        Number of processes; at most the number of cores, since more are not faster and take some
        90 MB each.
    import_main : bool
        Whether they import the main program, as functions defined in it require. A script without
        ``if __name__ == "__main__"`` would start itself again in each of them.
    """

    fatal: tuple[type[BaseException], ...] = ()

    def __init__(self, workers: int, *, import_main: bool = True) -> None:
        self._workers, self._import_main = min(workers, _cores()), import_main
        self._pool = self._open()

    @property
    def workers(self) -> int:
        """Number of processes."""
        return self._workers

    def check(self) -> None:
        """Do nothing: futures report dead processes."""

    def submit[**P, T](
        self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Submit to the pool, or to a new one if a process of the old one died."""
        with block_sigint(), nullcontext() if self._import_main else main_hidden():
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


def _cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def block_sigint() -> Iterator[None]:
    """Make processes started in this context ignore Ctrl-C: this process ends them.

    They inherit blocked signals; a signal received meanwhile is handled afterwards.
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
    """Hide the main program's file and module from processes started in this context."""
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
    """Make a worker end with the command that started it, even if that was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


CONNECTING = 10.0  # timeout for a scheduler [s]
JOINING = 30.0  # timeout for the first worker [s]
DESERTED = 300.0  # timeout for workers to come back [s]
_COUNTING = 5.0  # between counts of the workers [s]


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Connect to the scheduler of a Dask cluster; yield an executor over all its workers.

    Workers may join and leave during a campaign. Dask reruns a lost worker's run elsewhere. A
    worker should have one thread, since a process solves one run at a time:
    ``dask worker ADDRESS --nworkers auto --nthreads 1``.

    Parameters
    ----------
    address : str
        As printed by ``dask scheduler``, for instance ``tcp://192.0.2.1:8786``.

    Raises
    ------
    BayesdegError
        If ``distributed`` is not installed, no scheduler answers, no worker joins it, or a worker
        lacks the finite element model or has a different version.
    """
    distributed = _distributed()
    # a failed client, collected while the next one starts, would wait for its lock
    gc.collect()
    try:
        client = distributed.Client(address, timeout=CONNECTING, set_as_default=False)
    except (OSError, ValueError, TypeError) as fault:
        raise BayesdegError(
            f"no scheduler answers at {address!r} ({fault}); give the address printed by 'dask "
            "scheduler', such as tcp://127.0.0.1:8786"
        ) from fault
    try:
        _check_workers(client, address)
        yield ClusterExecutor(client, address)
    finally:
        client.close()


class ClusterExecutor(Executor):
    """Dask's client executor, extended for campaigns.

    Dask's own executor reports a lost scheduler by cancelled futures at best, or by futures that
    never end if the connection broke while fetching a result.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._executor = client.get_executor(pure=False)
        self._connection = client.scheduler_comm
        self.fatal: tuple[type[BaseException], ...] = (_distributed().scheduler.KilledWorker,)
        self._counted = self._attended = -float("inf")
        self._workers = 0
        self.check()

    @property
    def workers(self) -> int:
        """Number of threads of all workers, counted a few seconds ago."""
        return self._workers

    def check(self) -> None:
        """Raise ResumableError if the scheduler, or all workers for long, are lost."""
        if self._client.status != "running" or self._client.scheduler_comm is not self._connection:
            raise self._lost()
        now = time.monotonic()
        if now - self._counted < _COUNTING:
            return
        try:
            self._workers = sum(self._client.nthreads().values())
        except (OSError, TimeoutError) as fault:
            raise self._lost() from fault
        self._counted = now
        if self._workers:
            self._attended = now
        elif now - self._attended > DESERTED:
            raise ResumableError(
                f"the scheduler at {self._address} has had no worker for {DESERTED:g} s; solutions "
                "so far are stored: start workers and run the same command again to resume"
            )

    def submit[**P, T](
        self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Submit to the cluster."""
        self.check()
        future: Future[T] = self._executor.submit(function, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more runs, and stop pending ones if cancelled; the cluster keeps running."""
        with suppress(OSError, TimeoutError):  # if the scheduler is lost
            if self._client.status == "running":
                self._executor.shutdown(wait and not cancel_futures)

    def _lost(self) -> ResumableError:
        return ResumableError(
            f"the scheduler at {self._address} was lost; solutions so far are stored: restart "
            "scheduler and workers and run the same command again to resume"
        )


def model_version() -> str:
    """Return the version of the finite element model; checked on every worker."""
    return MODEL_VERSION


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError as fault:
        raise BayesdegError(
            "a scheduler needs the package distributed: pip install 'bayesdeg[cluster]'"
        ) from fault


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=JOINING)
    except TimeoutError as fault:
        raise BayesdegError(
            f"no worker joined the scheduler at {address} within {JOINING:g} s; start some "
            f"with 'dask worker {address} --nworkers auto --nthreads 1'"
        ) from fault
    answers = client.run(model_version, on_error="return")
    other = {worker: answer for worker, answer in answers.items() if answer != MODEL_VERSION}
    if other:
        told = "; ".join(f"{worker}: {answer}" for worker, answer in other.items())
        raise BayesdegError(
            f"workers without version {MODEL_VERSION} of the finite element model ({told}); "
            "install the same bayesdeg on every machine"
        )
    idle = {worker: n for worker, n in client.nthreads().items() if n > 1}
    if idle:
        warnings.warn(
            f"a worker solves one run at a time, but {', '.join(idle)} have several threads: start "
            f"workers with 'dask worker {address} --nworkers auto --nthreads 1'",
            stacklevel=4,
        )


_KEPT: dict[int, WorkerProcesses] = {}


@contextmanager
def workplace(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Open worker processes or a cluster; when stopped, do not wait for runs in progress."""
    with pool(workers, scheduler) as executor:
        try:
            yield executor
        except BaseException:
            if executor is not None:
                executor.shutdown(wait=False, cancel_futures=True)
                # They would end with this process, but not before they have started: a starting
                # process would find its parent's locks gone and print a traceback.
                for process in multiprocessing.active_children():
                    process.kill()
            raise


@contextmanager
def pool(workers: int, scheduler: str | None = None) -> Iterator[Executor | None]:
    """Open processes on this machine, none for 1, or the workers of a Dask scheduler."""
    if scheduler is not None:
        with cluster_executor(scheduler) as executor:
            yield executor
        return
    if workers == 1:
        yield None
        return
    with _one_thread_each(), WorkerProcesses(workers) as processes:
        yield processes


@contextmanager
def kept_processes(workers: int) -> Iterator[Executor | None]:
    """Open worker processes that stay open for the next verb, until this process ends.

    Opening them costs as much as a quick calibration. They do not import the main program, so that
    a script without ``if __name__ == "__main__"`` is not started again. None are opened for 1.
    """
    if workers == 1:
        yield None
        return
    if workers not in _KEPT:
        _KEPT[workers] = WorkerProcesses(workers, import_main=False)
    try:
        with _one_thread_each():
            yield _KEPT[workers]
    except BaseException:
        _KEPT.pop(workers).shutdown(wait=False, cancel_futures=True)
        raise


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Give processes started in this context one thread of linear algebra, unless set otherwise.

    They inherit the environment, which is restored afterwards.
    """
    names = {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"} - set(os.environ)
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name in names:
            os.environ.pop(name, None)
