"""Whether an HDF5 file can be read at all: found out by a process that may be lost.

On a damaged file the HDF5 library can go in circles for ever, ask for any amount of memory or
crash, and nothing in Python stops it there. So another process reads all that the file holds first,
with limits that the system enforces; where that one ends well, the library may have the file.
"""

import os
import subprocess
import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

import h5py

SECONDS = 3  # of the processor: a posterior of 100 MB takes 0.4
PATIENCE_S = 120.0  # by the clock, on a machine that does much else, or has no limit of its own
MEMORY_MB = 4000.0  # of addresses: Python with its libraries has about 600
IS_DAMAGED = 3  # exit code, with what is wrong on the standard error
NOT_BEGUN = 1  # of Python, for instance without h5py, with a traceback there


def refuse_unsound(path: Path, digest: str, *, most_mb: float) -> None:
    """Raise if an HDF5 file cannot be read to its end.

    Parameters
    ----------
    path : Path
        The file.
    digest : str
        Hash of its content: the same content is looked at once.
    most_mb : float
        Size up to which arrays are accepted [MB]; a file of a few kB may promise any.

    Raises
    ------
    ValueError
        If it is no HDF5 file, is damaged, or has arrays of more than that.

    Examples
    --------
    >>> import tempfile
    >>> made = Path(tempfile.mkdtemp()) / "one.h5"
    >>> with h5py.File(made, "w") as file:
    ...     file["numbers"] = [1.0, 2.0]
    >>> refuse_unsound(made, "of this content", most_mb=1.0)
    >>> _ = made.write_bytes(made.read_bytes()[:-200])
    >>> refuse_unsound(made, "of that content", most_mb=1.0)
    Traceback (most recent call last):
        ...
    ValueError: ...
    """
    if fault := _fault(path.absolute(), digest, most_mb):
        raise ValueError(fault)


@cache
def _fault(path: Path, _digest: str, most_mb: float) -> str:
    """Return what is wrong with a file; nothing if another process read it to its end."""
    command = [sys.executable, "-P", __file__, str(path), str(most_mb)]
    alone = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        ended = subprocess.run(
            command, capture_output=True, timeout=PATIENCE_S, check=False, env=alone
        )
    except subprocess.TimeoutExpired:
        return "reading it does not come to an end"
    if ended.returncode == 0:
        return ""
    said = ended.stderr.decode("utf-8", "replace").strip().splitlines()
    if ended.returncode in (IS_DAMAGED, NOT_BEGUN) and said:
        return said[-1]
    return "reading it does not come to an end, or the HDF5 library fails on it"


def _look_through(path: str, most_mb: float) -> None:
    """Read every attribute and every array of a file, after the sizes of all."""
    with h5py.File(path, "r") as file:
        nodes: list[h5py.Group | h5py.Dataset] = [file]
        file.visititems(lambda _name, node: nodes.append(node))
        arrays = [node for node in nodes if isinstance(node, h5py.Dataset)]
        size = sum(array.nbytes for array in arrays) / 1e6
        if size > most_mb:
            raise ValueError(
                f"it has arrays of {size:.0f} MB, more than the {most_mb:.0f} MB of any posterior"
            )
        for node in nodes:
            for name in node.attrs:
                node.attrs[name]
        for array in arrays:
            array[()]


def _limit_this_process() -> None:
    """Have the system end this process where it goes in circles or asks for all memory."""
    with suppress(ImportError):  # on a system without, the clock alone ends it
        resource, most = import_module("resource"), int(MEMORY_MB * 1e6)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _main(path: str, most_mb: str) -> int:
    _limit_this_process()
    try:
        _look_through(path, float(most_mb))
    except Exception as fault:  # of a damaged file the library raises what it likes
        print(*str(fault).split(), file=sys.stderr, flush=True)
        return IS_DAMAGED
    return 0


if __name__ == "__main__":
    os._exit(_main(*sys.argv[1:]))  # half an object of a damaged file complains when it is let go
