"""The worker processes of a command, and what becomes of them when it is stopped."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from bayesdeg.emulator.workers import WorkerProcesses, cluster_executor


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
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    with WorkerProcesses(workers) as processes:
        yield processes
