"""Progress on standard error: bars on a terminal or in a notebook, plain lines in a file."""

import importlib.util
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from bayesdeg.console import errors
from bayesdeg.progress import Silent

LINE_EVERY = 30.0  # interval of progress lines [s]: at most a hundred lines per hour


class Bars:
    """Shows stages as progress bars on standard error."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._task: TaskID | None = None

    def stage(self, name: str, total: float | None = None) -> None:
        """Finish the current stage and begin a new one."""
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


class Lines:
    """Shows stages as lines of text, if standard error is not a terminal.

    Each stage prints a line when it begins and ends, and occasionally in between.

    Parameters
    ----------
    write : callable
        Takes a line.
    clock : callable
        Returns the time [s].

    Examples
    --------
    >>> lines = Lines(print, clock=iter((0.0, 5.0, 40.0, 70.0)).__next__)
    >>> lines.stage("sampling")
    sampling ...
    >>> lines.advance(note="10 draws")
    >>> lines.advance(note="90 draws")
    sampling: 0:40, 90 draws
    >>> lines.finish()
    sampling: done in 1:10, 90 draws
    """

    def __init__(
        self, write: Callable[[str], object], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._write, self._clock = write, clock
        self._name, self._note = "", ""
        self._began = self._shown = 0.0

    def stage(self, name: str, total: float | None = None) -> None:
        """Finish the current stage and begin a new one."""
        self.finish()
        self._name, self._note = name, ""
        self._began = self._shown = self._clock()
        self._write(f"{name} ...")

    def advance(self, steps: float = 1.0, note: str = "") -> None:
        """Advance, and print a line if none was printed for a while."""
        self._note = note or self._note
        now = self._clock()
        if self._name and now - self._shown >= LINE_EVERY:
            self._shown = now
            self._write(f"{self._name}: {self._state(now)}")

    def finish(self) -> None:
        """Say that the stage is done."""
        if self._name:
            self._write(f"{self._name}: done in {self._state(self._clock())}")
        self._name = ""

    def _state(self, now: float) -> str:
        minutes, seconds = divmod(round(now - self._began), 60)
        return f"{minutes}:{seconds:02d}" + (f", {self._note}" if self._note else "")


def can_show_bars() -> bool:
    """Return whether standard error can show moving bars: a terminal or notebook.

    In a notebook they need ``ipywidgets``.
    """
    has_widgets = errors.is_jupyter and importlib.util.find_spec("ipywidgets") is not None
    return errors.is_terminal or has_widgets


@contextmanager
def shown(quiet: bool) -> Iterator[Bars | Lines | Silent]:
    """Show the progress of a command, or nothing if quiet."""
    if quiet:
        yield Silent()
    elif can_show_bars():
        with Progress(*_columns(), console=errors) as bars:
            display = Bars(bars)
            yield display
            display.finish()
    else:
        lines = Lines(lambda line: errors.print(line, soft_wrap=True))
        yield lines
        lines.finish()


def _columns() -> tuple[SpinnerColumn, TextColumn, BarColumn, TimeElapsedColumn, TextColumn]:
    return (
        SpinnerColumn(finished_text="✓"),
        TextColumn("{task.description:<32}", markup=False),
        BarColumn(bar_width=8),
        TimeElapsedColumn(table_column=Column(min_width=7, no_wrap=True)),
        TextColumn("{task.fields[note]}", markup=False),
    )
