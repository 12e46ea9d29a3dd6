"""Files are read only if they are regular and not too large, and written whole or not at all."""

import errno
import json
import os
import re
import stat
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.resources.abc import Traversable
from pathlib import Path
from zipfile import BadZipFile

from bayesdeg.errors import BayesdegError, ResumableError

LIMIT = "BAYESDEG_LARGEST_FILE_MB"
"""Environment variable that raises the size up to which files are read [MB]."""

#: A study's CSV file of 20 MB has some 300,000 rows and takes 0.5 GB of memory to check [MB].
STUDY_MB = 20.0
#: Tables and documents of a run hold several rows for a reading [MB].
RUN_MB = 200.0
#: An emulator has about 2 MB [MB].
EMULATOR_MB = 200.0

#: Levels of lists and tables within one another; what bayesdeg reads has at most six.
DEEPEST = 30

#: What zipfile and numpy say of an archive of arrays that is damaged, or promises what it lacks.
OF_DAMAGED_ARCHIVES = (
    *(OSError, ValueError, LookupError, EOFError, RuntimeError, TypeError),
    *(MemoryError, OverflowError, struct.error, BadZipFile, zlib.error),
)

_KINDS = (
    (stat.S_ISDIR, "folder"),
    (stat.S_ISFIFO, "named pipe"),
    (stat.S_ISCHR, "device"),
    (stat.S_ISBLK, "device"),
    (stat.S_ISSOCK, "socket"),
)
_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def read_bytes(path: Path | Traversable, *, most_mb: float) -> bytes:
    """Return the content of a regular file that is not too large.

    A named pipe would keep the reader waiting, and a device may have no end.

    Parameters
    ----------
    path : Path
        The file; resources of a package are read as they are.
    most_mb : float
        Largest size [MB]; `LIMIT` in the environment may raise it.

    Raises
    ------
    OSError
        If it cannot be read, is no regular file or too large; ``strerror`` says so in words.
    BayesdegError
        If `LIMIT` in the environment holds no size.
    """
    if not isinstance(path, Path):
        return path.read_bytes()
    refuse_special(path)
    most = int(max(most_mb, _raised_limit()) * 1e6)
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EINVAL, _too_large(path.stat().st_size, most), str(path))
    return content


def refuse_special(path: Path) -> None:
    """Refuse what is there but no regular file.

    Raises
    ------
    OSError
        If it is not there, or is a folder, named pipe, device or socket.
    """
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        kind = next((word for is_kind, word in _KINDS if is_kind(mode)), "special file")
        raise OSError(errno.EINVAL, f"it is a {kind}, not a regular file", str(path))


def _too_large(size: int, most: int) -> str:
    return (
        f"it has {max(size, most) / 1e6:.0f} MB, more than the {most / 1e6:.0f} MB that are read; "
        f"if it is the right file, set the environment variable {LIMIT} to a larger number"
    )


def _raised_limit() -> float:
    text = os.environ.get(LIMIT, "")
    if not text:
        return 0.0
    try:
        limit = float(text)
    except ValueError:
        limit = -1.0
    if not 0.0 < limit <= 1e6:
        raise BayesdegError(
            f"{LIMIT}={text!r} in the environment is no size; set it to a number of megabytes, "
            "such as 500, or leave it out"
        )
    return limit


def parse_json(text: str | bytes) -> object:
    """Return what a JSON text holds.

    Raises
    ------
    ValueError
        If it is no JSON, or is nested too deeply.
    """
    try:
        content: object = json.loads(text)
    except RecursionError as fault:
        raise ValueError("it is nested too deeply") from fault
    if too_deep(content):
        raise ValueError("it is nested too deeply")
    return content


def too_deep(content: object) -> bool:
    """Return whether lists and tables stand within one another at more than `DEEPEST` levels.

    Examples
    --------
    >>> too_deep({"a": [[1.0], 2.0]}), too_deep(__import__("json").loads(40 * "[" + 40 * "]"))
    (False, True)
    """
    level = [content]
    for _ in range(DEEPEST + 1):
        level = [inner for one in level for inner in _within(one)]
        if not level:
            return False
    return True


def _within(content: object) -> Sequence[object]:
    if isinstance(content, dict):
        return list(content.values())
    return content if isinstance(content, list) else ()


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Give a temporary name to write to; the file is at its own once it is whole, on disk.

    Parameters
    ----------
    path : Path
        The file; its folder is made if it is not there.

    Raises
    ------
    ResumableError
        If it cannot be written, as when the disk is full; what was there before stays.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield part
            with part.open("rb+") as file:
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as fault:
        raise ResumableError(
            f"{path} cannot be written ({reason(fault)}); make room or allow writing, and repeat "
            "the command, which goes on where it stopped"
        ) from fault


def write_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write a content: whole or not at all.

    HDF5 and zip archives are made in memory first, since their libraries do not end in good order
    on a full disk.
    """
    with written(path) as part:
        part.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8, with the line ends that it has: whole or not at all."""
    with written(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def spreadsheet_safe(cell: object) -> object:
    """Return a cell that no spreadsheet takes for a formula: a text of that kind gets a quote.

    Parameters
    ----------
    cell : object
        What is to be written; only texts change, and `as_named` gives them back.

    Examples
    --------
    >>> [spreadsheet_safe(cell) for cell in ("=1+1", "@a", "'=a", "-5", "a=b", 2.0)]
    ["'=1+1", "'@a", "''=a", '-5', 'a=b', 2.0]
    """
    if isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


def as_named(cell: object) -> object:
    """Return the text of which `spreadsheet_safe` made a cell.

    Examples
    --------
    >>> [as_named(cell) for cell in ("'=1+1", "''=a", "'a'", "-5")]
    ['=1+1', "'=a", "'a'", '-5']
    """
    return cell[1:] if isinstance(cell, str) and cell[:1] == "'" and _FORMULA.match(cell) else cell


def reason(fault: OSError) -> str:
    """Return in words why the system refused.

    Examples
    --------
    >>> reason(OSError(2, "No such file or directory")), reason(OSError("closed"))
    ('No such file or directory', 'closed')
    """
    return fault.strerror or str(fault) or type(fault).__name__


def no_room(fault: OSError) -> bool:
    """Return whether a disk is full, or a quota or limit on the size of files is reached."""
    return fault.errno in _NO_ROOM
