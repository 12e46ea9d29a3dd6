"""The worker processes of a command or verb, and what becomes of them when it is stopped."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from bayesdeg.emulator.workers import WorkerProcesses, cluster_executor

_KEPT: dict[int, WorkerProcesses] = {}


@contextmanager
def workplace(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Open worker processes or a cluster; when stopped, do not wait for what is under way."""
    with pool(workers, scheduler) as executor:
        try:
            yield executor
        except BaseException:
            if executor is not None:
                executor.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def pool(workers: int, scheduler: str | None = None) -> Iterator[Executor | None]:
    """Open where finite element runs are solved.

    Parameters
    ----------
    workers : int
        Processes on this machine, each with one thread of linear algebra; none for 1.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers are taken instead.
    """
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

    Opening them costs as much as a quick calibration. They do not import the program that opens
    them, so that a script without ``if __name__ == "__main__"`` is not started again.

    Parameters
    ----------
    workers : int
        Number of processes; none for 1.
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
    """Let processes that start meanwhile use one thread of linear algebra, if nothing else is said.

    They inherit the environment; that of this process is afterwards as it was.
    """
    names = {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"} - set(os.environ)
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name in names:
            os.environ.pop(name, None)
