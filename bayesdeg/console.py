"""Results on standard output; messages on standard error."""

from collections.abc import Iterable

from rich.console import Console

WIDTH = 120  # of output that does not go to a terminal


def console(*, stderr: bool = False, width: int | None = None) -> Console:
    """Return a console that prints text verbatim.

    Users' names and paths may contain rich markup or emoji codes.

    Parameters
    ----------
    stderr : bool
        Standard error instead of standard output.
    width : int, optional
        By default that of the terminal.
    """
    return Console(stderr=stderr, width=width, markup=False, emoji=False, highlight=False)


errors = console(stderr=True)


def output() -> Console:
    """Return standard output, wide enough for a table if it is not a terminal."""
    printed = console()
    return printed if printed.is_terminal else console(width=WIDTH)


def say(messages: Iterable[str], printed: Console = errors) -> None:
    """Print messages, by default to standard error."""
    for message in messages:
        printed.print(message, style="yellow", soft_wrap=True)
