"""A Dask cluster as the executor of a campaign; ``distributed`` is an optional extra."""

import gc
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from bayesdeg.actuator.version import MODEL_VERSION
from bayesdeg.errors import BayesdegError, ResumableError

CONNECTING = 10.0  # how long a scheduler is waited for [s]
JOINING = 30.0  # how long a first worker is waited for [s]
DESERTED = 300.0  # how long a campaign waits for workers to come back [s]
_COUNTING = 5.0  # between counts of the workers [s]


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Connect to the scheduler of a Dask cluster; give an executor over all its workers.

    Workers may join and leave while a campaign runs. A run whose worker is lost is run again by
    Dask, elsewhere. A worker should have one thread, since a process solves one run at a time:
    ``dask worker ADDRESS --nworkers auto --nthreads 1``.

    Parameters
    ----------
    address : str
        As ``dask scheduler`` prints it, for instance ``tcp://192.0.2.1:8786``.

    Raises
    ------
    BayesdegError
        If ``distributed`` is not installed, no scheduler answers, no worker joins it, or a worker
        has none or another version of the finite element model.
    """
    client = _connected(address)
    try:
        _check_workers(client, address)
        yield ClusterExecutor(client, address)
    finally:
        client.close()


class ClusterExecutor(Executor):
    """The executor that Dask's client offers, with what a campaign asks for beyond it.

    Dask's own executor tells of a lost scheduler by cancelled futures at best, and by futures
    that never end if the connection broke while a result was fetched.

    Parameters
    ----------
    client : distributed.Client
        Connected.
    address : str
        Of its scheduler.
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
        """Threads of all workers, as counted a few seconds ago."""
        return self._workers

    def check(self) -> None:
        """Raise ResumableError if the scheduler is lost, or all its workers are for long."""
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
                f"the scheduler at {self._address} has had no worker for {DESERTED:g} s; what is "
                "solved so far stays in the store: start workers and repeat the command to go on"
            )

    def submit[**P, T](
        self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        """Submit to the cluster."""
        self.check()
        future: Future[T] = self._executor.submit(function, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more, and have no more done if futures are cancelled; the cluster goes on."""
        with suppress(OSError, TimeoutError):  # of a scheduler that is lost
            if self._client.status == "running":
                self._executor.shutdown(wait and not cancel_futures)

    def _lost(self) -> ResumableError:
        return ResumableError(
            f"the scheduler at {self._address} was lost; what is solved so far stays in the "
            "store: start scheduler and workers again and repeat the command to go on"
        )


def model_version() -> str:
    """Return the version of the finite element model; asked of every worker."""
    return MODEL_VERSION


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError as fault:
        raise BayesdegError(
            "a scheduler needs the package distributed: pip install 'bayesdeg[cluster]'"
        ) from fault


def _connected(address: str) -> Any:
    distributed = _distributed()
    # a client that could not connect, collected while the next one starts, waits for its lock
    gc.collect()
    try:
        return distributed.Client(address, timeout=CONNECTING, set_as_default=False)
    except (OSError, ValueError, TypeError) as fault:
        raise BayesdegError(
            f"no scheduler answers at {address!r} ({fault}); give the address that 'dask "
            "scheduler' prints, such as tcp://127.0.0.1:8786"
        ) from fault


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=JOINING)
    except TimeoutError as fault:
        raise BayesdegError(
            f"no worker has joined the scheduler at {address} within {JOINING:g} s; start some "
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
