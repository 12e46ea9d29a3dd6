"""The worker processes of a command or verb, and what becomes of them when it is stopped."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from bayesdeg.emulator.cluster import cluster_executor
from bayesdeg.emulator.workers import WorkerProcesses


@contextmanager
def workplace(
    workers: int, scheduler: str | None = None, *, import_main: bool = True
) -> Iterator[Executor | None]:
    """Open worker processes or a cluster; when stopped, do not wait for what is under way.

    The parameters are those of `pool`.
    """
    with pool(workers, scheduler, import_main=import_main) as executor:
        try:
            yield executor
        except BaseException:
            if executor is not None:
                executor.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def pool(
    workers: int, scheduler: str | None = None, *, import_main: bool = True
) -> Iterator[Executor | None]:
    """Open where finite element runs are solved.

    Parameters
    ----------
    workers : int
        Processes on this machine, each with one thread of linear algebra; none for 1.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers are taken instead.
    import_main : bool
        As of `bayesdeg.emulator.workers.WorkerProcesses`.
    """
    if scheduler is not None:
        with cluster_executor(scheduler) as executor:
            yield executor
        return
    if workers == 1:
        yield None
        return
    with _one_thread_each(), WorkerProcesses(workers, import_main=import_main) as processes:
        yield processes


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
