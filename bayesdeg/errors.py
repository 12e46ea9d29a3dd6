"""What can go wrong at the user's side: each fault carries the value, what is wrong, the remedy."""

from collections.abc import Iterable
from dataclasses import dataclass

LONGEST = 120  # characters of a value that are shown


@dataclass(frozen=True)
class Fault:
    """One fault of the input, in the words the user reads.

    Parameters
    ----------
    file : str
        Name of the file, as the user knows it.
    problem : str
        What is wrong.
    remedy : str
        What would be right.
    row : int, optional
        Line of the file, counted from 1 with the header and comments included.
    column : str, optional
        Column or key.
    value : str, optional
        The offending value, as it stands in the file.
    specimen : str, optional
        The specimen, where the fault is not of one row.

    Examples
    --------
    >>> print(Fault("break.csv", "is negative", "give a percentage", 3, "elongation_pct", "-4"))
    break.csv, row 3, column elongation_pct, value '-4': is negative; give a percentage
    """

    file: str
    problem: str
    remedy: str
    row: int | None = None
    column: str | None = None
    value: str | None = None
    specimen: str | None = None

    def __str__(self) -> str:
        """Return the fault as one line."""
        place = [self.file]
        if self.row is not None:
            place.append(f"row {self.row}")
        if self.specimen is not None:
            place.append(f"specimen {self.specimen!r}")
        if self.column is not None:
            place.append(f"column {self.column}")
        if self.value is not None:
            shown = f"{self.value[:LONGEST]}…" if len(self.value) > LONGEST else self.value
            place.append(f"value {shown!r}")
        return f"{', '.join(place)}: {self.problem}; {self.remedy}"


class BayesdegError(Exception):
    """Base of every error that the user can do something about."""


class ResumableError(BayesdegError):
    """What stopped the work from outside: nothing is lost, and the same command goes on."""


class StudyError(BayesdegError):
    """All faults of a study, reported together.

    Parameters
    ----------
    faults : iterable of Fault
        Every fault that was found.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults: tuple[Fault, ...] = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class GeometryError(BayesdegError):
    """Dimensions of which no actuator can be made; the message says why."""
