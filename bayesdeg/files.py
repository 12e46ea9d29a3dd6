"""Read only regular files of limited size; write files completely or not at all."""

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
"""Environment variable that raises the size limit of input files [MB]."""

#: A study's CSV file of 20 MB has some 300,000 rows and takes 0.5 GB of memory to check [MB].
STUDY_MB = 20.0
#: Tables and documents of a run have several rows per reading [MB].
RUN_MB = 200.0
#: An emulator has about 2 MB [MB].
EMULATOR_MB = 200.0

#: Nesting limit of lists and tables; formats of bayesdeg have at most six levels.
DEEPEST = 30

#: Exceptions of zipfile and numpy for a damaged or incomplete archive of arrays.
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

    A named pipe would block, and a device may never end.

    Parameters
    ----------
    path : Path
        The file; package resources are read without checks.
    most_mb : float
        Largest size [MB]; `LIMIT` in the environment may raise it.

    Raises
    ------
    OSError
        If it cannot be read, is not a regular file or too large; ``strerror`` says why.
    BayesdegError
        If `LIMIT` in the environment is not a size.
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
    """Refuse anything but a regular file.

    Raises
    ------
    OSError
        If it does not exist, or is a folder, named pipe, device or socket.
    """
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        kind = next((word for is_kind, word in _KINDS if is_kind(mode)), "special file")
        raise OSError(errno.EINVAL, f"it is a {kind}, not a regular file", str(path))


def _too_large(size: int, most: int) -> str:
    return (
        f"it has {max(size, most) / 1e6:.0f} MB, above the limit of {most / 1e6:.0f} MB; if it is "
        f"the right file, set the environment variable {LIMIT} to a larger number"
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
            f"{LIMIT}={text!r} in the environment is not a size; set it to a number of megabytes, "
            "such as 500, or unset it"
        )
    return limit


def parse_json(text: str | bytes) -> object:
    """Parse a JSON text.

    Raises
    ------
    ValueError
        If it is not JSON, or is nested too deeply.
    """
    try:
        content: object = json.loads(text)
    except RecursionError as fault:
        raise ValueError("it is nested too deeply") from fault
    if too_deep(content):
        raise ValueError("it is nested too deeply")
    return content


def too_deep(content: object) -> bool:
    """Return whether lists and tables are nested more than `DEEPEST` levels deep.

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
    """Yield a temporary name to write to; rename it once the file is complete on disk.

    Parameters
    ----------
    path : Path
        The file; its folder is created if necessary.

    Raises
    ------
    ResumableError
        If it cannot be written, as when the disk is full; an earlier file stays.
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
            f"{path} cannot be written ({reason(fault)}); free some space or allow writing, and "
            "run the same command again to resume"
        ) from fault


def write_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write bytes completely or not at all.

    HDF5 and zip archives are built in memory first, since their libraries do not fail cleanly on a
    full disk.
    """
    with written(path) as part:
        part.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text with its line ends, completely or not at all."""
    with written(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def spreadsheet_safe(cell: object) -> object:
    """Return a cell that no spreadsheet reads as a formula: quote such text.

    Parameters
    ----------
    cell : object
        The value to write; only texts change, and `as_named` restores them.

    Examples
    --------
    >>> [spreadsheet_safe(cell) for cell in ("=1+1", "@a", "'=a", "-5", "a=b", 2.0)]
    ["'=1+1", "'@a", "''=a", '-5', 'a=b', 2.0]
    """
    if isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


def as_named(cell: object) -> object:
    """Return the original text of a cell from `spreadsheet_safe`.

    Examples
    --------
    >>> [as_named(cell) for cell in ("'=1+1", "''=a", "'a'", "-5")]
    ['=1+1', "'=a", "'a'", '-5']
    """
    return cell[1:] if isinstance(cell, str) and cell[:1] == "'" and _FORMULA.match(cell) else cell


def reason(fault: OSError) -> str:
    """Return in words why a system call failed.

    Examples
    --------
    >>> reason(OSError(2, "No such file or directory")), reason(OSError("closed"))
    ('No such file or directory', 'closed')
    """
    return fault.strerror or str(fault) or type(fault).__name__


def no_room(fault: OSError) -> bool:
    """Return whether a disk is full, or a quota or file size limit is reached."""
    return fault.errno in _NO_ROOM
