"""Read possibly damaged files in a separate process with limits.

On a damaged file a C library can loop forever, allocate any amount of memory or crash, and Python
cannot stop it. So a separate process, limited by the operating system, does the work and returns
bytes; the caller survives whatever happens to it.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Never

PATIENCE_S = 300.0  # wall time, for a busy machine or one without CPU limits
IS_DAMAGED = 3  # exit code; the fault is on standard error
NOT_BEGUN = 1  # Python's exit code, as without the library; a traceback is on standard error
ENDLESS = "reading it timed out"


def asked(program: str, *words: object, library: str) -> bytes:
    """Return the output of a program that reads a file and ends with `ended`.

    Parameters
    ----------
    program : str
        A module's ``__file__``.
    words : object
        Its arguments, as text.
    library : str
        Name of the reading library, for the message.

    Raises
    ------
    ValueError
        If the program found the file damaged, or did not return; says what is wrong.

    Examples
    --------
    >>> import tempfile
    >>> program = f"{tempfile.mkdtemp()}/reader.py"
    >>> with open(program, "w") as made:
    ...     _ = made.write("import sys; sys.exit('no numbers in it')")
    >>> asked(program, "file.h5", library="the reader")
    Traceback (most recent call last):
        ...
    ValueError: no numbers in it
    """
    command = [sys.executable, "-P", program, *map(str, words)]
    alone = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        found = subprocess.run(
            command, capture_output=True, timeout=PATIENCE_S, check=False, env=alone
        )
    except subprocess.TimeoutExpired as fault:
        raise ValueError(ENDLESS) from fault
    if found.returncode == 0:
        return found.stdout
    said = found.stderr.decode("utf-8", "replace").strip().splitlines()
    if found.returncode in (IS_DAMAGED, NOT_BEGUN) and said:
        raise ValueError(said[-1])
    raise ValueError(f"{ENDLESS}, or {library} crashed")


def ended(work: Callable[[], bytes], *, seconds: int, megabytes: float) -> Never:
    """Do the program's work within limits, write its result, and end the process.

    Parameters
    ----------
    work : callable
        Any exception means that the file is damaged.
    seconds : int
        CPU time [s].
    megabytes : float
        Address space [MB].
    """
    limit_this_process(seconds, megabytes)
    code = IS_DAMAGED
    try:
        found = work()
    except Exception as fault:  # a library may raise anything on a damaged file
        words = str(fault).split()
        print(*(words or [type(fault).__name__]), file=sys.stderr, flush=True)
    else:
        sys.stdout.buffer.write(found)
        sys.stdout.flush()
        code = 0
    os._exit(code)  # partial objects of a damaged file may fail in their destructor


def limit_this_process(seconds: int, megabytes: float) -> None:
    """Limit CPU time and memory of this process."""
    with suppress(ImportError):  # on systems without this module only the clock ends it
        resource, most = import_module("resource"), int(megabytes * 1e6)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
