"""What is unlikely in a study, or in a posterior, on the terminal."""

from collections.abc import Iterable

from bayesdeg.console import errors


def say_doubts(doubts: Iterable[object]) -> None:
    """Print what is unlikely, one line each.

    Parameters
    ----------
    doubts : iterable
        Whatever prints as a sentence.
    """
    for doubt in doubts:
        said = f"in doubt: {doubt}"
        errors.print(said, style="yellow", markup=False, highlight=False, soft_wrap=True)
