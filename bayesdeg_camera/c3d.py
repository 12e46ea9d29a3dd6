"""Motion capture recordings (C3D files), read in an expendable process.

The optional reader is ezc3d (doi:10.21105/joss.02911). A separate process reads the file
(`bayesdeg.limited`) and returns plain arrays.
"""

import io
import struct
import sys
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from bayesdeg.limited import asked, ended

Floats = NDArray[np.float64]

LIBRARY = "ezc3d"
SECONDS = 60  # processor seconds: a recording of 100 MB takes 5
MEMORY_MB, PER_MB = 1500.0, 40.0  # address space of Python and numpy, and per MB of the file
BLOCK = 512  # bytes
IS_C3D = 0x50  # second byte of every C3D file
ORDERS = {84: "<", 85: "<", 86: ">"}  # byte orders of processors: Intel, DEC, MIPS


@dataclass(frozen=True)
class Recording:
    """Content of a C3D file.

    Parameters
    ----------
    labels : tuple of str
        Names of the markers.
    unit : str
        Of lengths, as the file states it; empty if it does not.
    first_frame : int
        Number of the first frame; recordings that were cut keep their numbers.
    points : array, shape (n_frames, n_markers, 3)
        In that unit; nan where a marker was not seen.
    channels, channel_units : tuple of str
        Names and units of the analog channels.
    analogs : array, shape (n_frames, n_samples, n_channels)
        Samples of each frame.
    """

    labels: tuple[str, ...]
    unit: str
    first_frame: int
    points: Floats
    channels: tuple[str, ...]
    channel_units: tuple[str, ...]
    analogs: Floats


def read_c3d(path: str, content: bytes) -> Recording:
    """Read a C3D file.

    Parameters
    ----------
    path : str
        The file.
    content : bytes
        What is in it.

    Raises
    ------
    ValueError
        If it is no C3D file, is damaged or cut off; the message says which, in lower case.

    Examples
    --------
    >>> read_c3d("notes.txt", b"a recording")
    Traceback (most recent call last):
        ...
    ValueError: is not a C3D file
    """
    refuse_cut_off(content)
    most_mb = MEMORY_MB + PER_MB * len(content) / 1e6
    try:
        arrays = asked(__file__, path, most_mb, library="the reader")
        with np.load(io.BytesIO(arrays), allow_pickle=False) as found:
            words = {name: tuple(map(str, found[name])) for name in ("labels", "channels", "units")}
            return Recording(
                words["labels"],
                str(found["unit"]),
                int(found["first_frame"]),
                found["points"],
                words["channels"],
                words["units"],
                found["analogs"],
            )
    except ValueError as fault:
        raise ValueError(f"is damaged: {fault}") from fault


def refuse_cut_off(content: bytes) -> None:
    """Raise if a file is not C3D, or shorter than its header says.

    Examples
    --------
    >>> refuse_cut_off(bytes([2, 0x50]) + 100 * b"x")
    Traceback (most recent call last):
        ...
    ValueError: is cut off in its header
    """
    if len(content) < 2 or content[1] != IS_C3D:
        raise ValueError("is not a C3D file")
    at = BLOCK * (content[0] - 1)
    if len(content) < BLOCK or not 0 < at <= len(content) - 4:
        raise ValueError("is cut off in its header")
    order = ORDERS.get(content[at + 3])
    if order is None:
        raise ValueError("is damaged: its number format is unknown")
    markers, samples, first, last = struct.unpack_from(f"{order}4H", content, 2)
    scale = content[12:16]
    # DEC has the sign bits where Intel has them
    negative = scale[0 if order == ">" else 3] & 0x80
    size = 4 if negative else 2
    start = struct.unpack_from(f"{order}H", content, 16)[0]
    promised = BLOCK * (start - 1) + (last - first + 1) * size * (4 * markers + samples)
    if last < first or promised > len(content):
        raise ValueError(
            f"is cut off: it promises {last - first + 1} frames of {markers} markers, "
            f"{promised / 1e6:.3g} MB, and has {len(content) / 1e6:.3g} MB"
        )


def _arrays(path: str) -> bytes:
    """Return the arrays of `Recording` by name, as a file of NumPy."""
    file = import_module(LIBRARY).c3d(path)
    about, channels = file["parameters"]["POINT"], file["parameters"].get("ANALOG", {})
    points = file["data"]["points"][:3].transpose(2, 1, 0)
    unseen = (file["data"]["meta_points"]["residuals"][0].T < 0.0) | np.all(points == 0.0, axis=2)
    labels = _words(about, "LABELS")
    analogs = file["data"]["analogs"][0].T
    frames, samples = len(points), len(analogs) // max(len(points), 1)
    names, units = _words(channels, "LABELS"), _words(channels, "UNITS")
    if len(labels) < points.shape[1] or len(names) < analogs.shape[1]:
        raise ValueError("it has markers or channels without names")
    units = [*units, *[""] * analogs.shape[1]]
    unit = _words(about, "UNITS")
    arrays = {
        "labels": np.array(labels[: points.shape[1]], dtype=np.str_),
        "unit": np.array(unit[0] if unit else "", dtype=np.str_),
        "first_frame": np.array(int(file["header"]["points"]["first_frame"]) + 1),
        "points": np.where(unseen[..., None], np.nan, points),
        "channels": np.array(names[: analogs.shape[1]], dtype=np.str_),
        "units": np.array(units[: analogs.shape[1]], dtype=np.str_),
        "analogs": analogs[: samples * frames].reshape(frames, samples, analogs.shape[1]),
    }
    made = io.BytesIO()
    np.savez(made, allow_pickle=False, **arrays)
    return made.getvalue()


def _words(group: dict[str, dict[str, list[str]]], name: str) -> list[str]:
    """Return a list of texts, which C3D continues in further lists after 255."""
    found: list[str] = []
    for key in (name, *(f"{name}{k}" for k in range(2, 100))):
        if key not in group:
            break
        found += [str(word).strip() for word in group[key]["value"]]
    return found


if __name__ == "__main__":
    ended(lambda: _arrays(sys.argv[1]), seconds=SECONDS, megabytes=float(sys.argv[2]))
