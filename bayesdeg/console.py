"""Progress bars on standard error, and the worker processes of a command."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from bayesdeg.emulator.cluster import cluster_executor
from bayesdeg.emulator.workers import WorkerProcesses
from bayesdeg.pipeline.progress import Silent

errors = Console(stderr=True)


class Bars:
    """Shows stages as progress bars on standard error."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._task: TaskID | None = None

    def stage(self, name: str, total: float | None = None) -> None:
        """Finish the stage before and begin another."""
        self.finish()
        self._task = self._bars.add_task(name, total=total, note="")

    def advance(self, steps: float = 1.0, note: str = "") -> None:
        """Move the bar of the stage."""
        if self._task is not None:
            self._bars.update(self._task, advance=steps, note=note)

    def finish(self) -> None:
        """Fill the bar of the stage."""
        if self._task is not None:
            self._bars.update(self._task, total=1, completed=1)
            self._bars.stop_task(self._task)


@contextmanager
def shown(quiet: bool) -> Iterator[Bars | Silent]:
    """Show the progress of a command, or nothing if it is to be quiet."""
    if quiet:
        yield Silent()
        return
    columns = (
        SpinnerColumn(finished_text="✓"),
        TextColumn("{task.description:<32}"),
        BarColumn(bar_width=8),
        TimeElapsedColumn(table_column=Column(min_width=7, no_wrap=True)),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=errors) as bars:
        display = Bars(bars)
        yield display
        display.finish()


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
