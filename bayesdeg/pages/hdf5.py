"""Whether an HDF5 file can be read at all: found out by a process that may be lost.

Another process reads all that the file holds first (`bayesdeg.limited`); where that one ends well,
the library may have the file.
"""

import sys
from pathlib import Path

import h5py

from bayesdeg.limited import asked, ended

SECONDS = 3  # of the processor: a posterior of 100 MB takes 0.4
MEMORY_MB = 4000.0  # of addresses: Python with its libraries has about 600
_SOUND: set[tuple[str, float]] = set()  # contents that another process has read to their end


def refuse_unsound(path: Path, digest: str, *, most_mb: float) -> None:
    """Raise if an HDF5 file cannot be read to its end.

    Parameters
    ----------
    path : Path
        The file.
    digest : str
        Hash of its content: sound content is checked only once, wherever it lies.
    most_mb : float
        Size up to which arrays are accepted [MB]; a file of a few kB may promise any.

    Raises
    ------
    ValueError
        If it is not an HDF5 file, is damaged, or has larger arrays.

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
    if (digest, most_mb) not in _SOUND:
        asked(__file__, path.absolute(), most_mb, library="the HDF5 library")
        _SOUND.add((digest, most_mb))


def _look_through(path: str, most_mb: float) -> bytes:
    """Check the sizes of all arrays of a file, then read every attribute and array."""
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
    return b""


if __name__ == "__main__":
    ended(
        lambda: _look_through(sys.argv[1], float(sys.argv[2])),
        seconds=SECONDS,
        megabytes=MEMORY_MB,
    )
