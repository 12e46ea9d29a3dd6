"""Work on a file that may be damaged, done by a process that may be lost.

On a damaged file a library in C can go in circles for ever, ask for any amount of memory or crash,
and nothing in Python stops it there. So another process does the work, with limits that the system
enforces, and hands over bytes; the one that asked goes on whatever becomes of it.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Never

PATIENCE_S = 300.0  # by the clock, on a machine that does much else, or has no limit of its own
IS_DAMAGED = 3  # exit code, with what is wrong on the standard error
NOT_BEGUN = 1  # of Python, for instance without the library, with a traceback there
ENDLESS = "reading it does not come to an end"


def asked(program: str, *words: object, library: str) -> bytes:
    """Return what a program writes that reads a file and ends with `ended`.

    Parameters
    ----------
    program : str
        A module's ``__file__``.
    words : object
        Its arguments, as text.
    library : str
        Which library reads, for the message.

    Raises
    ------
    ValueError
        If the program found that the file is damaged, or did not come back; what is wrong.

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
    raise ValueError(f"{ENDLESS}, or {library} fails on it")


def ended(work: Callable[[], bytes], *, seconds: int, megabytes: float) -> Never:
    """Do the work of such a program within limits, write what it returns, and end the process.

    Parameters
    ----------
    work : callable
        Any exception of it says that the file is damaged.
    seconds : int
        Of the processor [s].
    megabytes : float
        Of addresses [MB].
    """
    limit_this_process(seconds, megabytes)
    code = IS_DAMAGED
    try:
        found = work()
    except Exception as fault:  # of a damaged file a library raises what it likes
        words = str(fault).split()
        print(*(words or [type(fault).__name__]), file=sys.stderr, flush=True)
    else:
        sys.stdout.buffer.write(found)
        sys.stdout.flush()
        code = 0
    os._exit(code)  # half an object of a damaged file complains when it is let go


def limit_this_process(seconds: int, megabytes: float) -> None:
    """Have the system end this process where it goes in circles or asks for all memory."""
    with suppress(ImportError):  # on a system without, the clock alone ends it
        resource, most = import_module("resource"), int(megabytes * 1e6)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
