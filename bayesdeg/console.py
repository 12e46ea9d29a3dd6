"""Messages and progress bars on standard error."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

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
