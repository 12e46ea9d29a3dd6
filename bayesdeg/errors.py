"""Errors that the user can fix: each carries the value, what is wrong, and the remedy."""

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

LONGEST = 120  # shown characters of a value


@dataclass(frozen=True)
class Fault:
    """A fault of the input, worded for the user.

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
        The offending value, as written in the file.
    specimen : str, optional
        The specimen, if the fault concerns several rows.

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
    """Base of every error that the user can fix."""


class ResumableError(BayesdegError):
    """An outside interruption: nothing is lost, and the same command resumes."""


class Stopped(Exception):  # noqa: N818 - it is not an error
    """The user stopped a command, which can be resumed; the message says what is kept and how."""


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
    """Dimensions that no actuator can have; the message says why."""


def nearest(word: str, known: Iterable[str], *, cutoff: float = 0.6) -> str | None:
    """Find the known word most similar to the given one, ignoring case.

    Parameters
    ----------
    word : str
        The word as written.
    known : iterable of str
        Candidates for the intended word.
    cutoff : float
        Least similarity in the sense of `difflib.SequenceMatcher.ratio`.

    Returns
    -------
    str or None
        ``None`` if nothing is similar enough.

    Examples
    --------
    >>> nearest("uniaxal", ["uniaxial", "planar"])
    'uniaxial'
    >>> nearest("shear", ["uniaxial", "planar"]) is None
    True
    """
    by_folded = {entry.casefold(): entry for entry in known}
    matches = get_close_matches(word.casefold(), list(by_folded), n=1, cutoff=cutoff)
    return by_folded[matches[0]] if matches else None


def use_one_of(word: str, known: Iterable[str]) -> str:
    """Word the remedy for an unknown word.

    Parameters
    ----------
    word : str
        The word as written.
    known : iterable of str
        The allowed words.

    Returns
    -------
    str
        A suggestion, if there is one, and the whole list.

    Examples
    --------
    >>> use_one_of("uniaxal", ["uniaxial", "planar"])
    "did you mean 'uniaxial'? Use one of uniaxial, planar"
    >>> use_one_of("biaxial", ["uniaxial", "equibiaxial"])
    "did you mean 'equibiaxial'? Use one of uniaxial, equibiaxial"
    """
    known = tuple(known)
    longer = [entry for entry in known if len(word) > 2 and word.casefold() in entry.casefold()]
    best = longer[0] if longer else nearest(word, known)
    suggestion = f"did you mean {best!r}? Use one of" if best else "use one of"
    return f"{suggestion} {', '.join(known)}"
