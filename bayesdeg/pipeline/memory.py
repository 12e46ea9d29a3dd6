"""How much memory a run took at most, in its own process and in the largest of its workers."""

import multiprocessing
import re
from pathlib import Path

#: The highest resident size since the program began, in kB; of this program alone, where
#: `resource.getrusage` gives that of the process which started it, if that was larger.
_HIGHEST = re.compile(r"^VmHWM:\s+(\d+) kB$", re.MULTILINE)


def peaks_of_memory(name: str = "main process") -> dict[str, float]:
    """Return the largest resident memory of this process and of its largest worker now [MB].

    Empty where the system does not say (it is Linux that does).

    Parameters
    ----------
    name : str
        Of this process in what is returned.

    Examples
    --------
    >>> all(size > 0.0 for size in peaks_of_memory().values())
    True
    """
    own = _peak("self")
    if own is None:
        return {}
    known = [_peak(str(worker.pid)) for worker in multiprocessing.active_children()]
    sizes = [size for size in known if size is not None]
    return {name: own} | ({"largest worker": max(sizes)} if sizes else {})


def _peak(process: str) -> float | None:
    """Return the peak of a process [MB]; None if it is gone, or the system does not say."""
    try:
        found = _HIGHEST.search(Path("/proc", process, "status").read_text(encoding="ascii"))
    except (OSError, UnicodeDecodeError):
        return None
    return None if found is None else round(int(found[1]) * 1024 / 1e6, 1)
