"""Lines that a person set in photographs: tables of points in pixels."""

import io
from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.errors import BayesdegError

Floats = NDArray[np.float64]

#: What a line is of where the file does not say of which photograph.
ANY = ""
_COLUMNS = ("x_px", "y_px")


def parse_lines(name: str, content: bytes) -> dict[str, Floats]:
    r"""Return lines by the photographs that they are of, each (n, 2) [px].

    Parameters
    ----------
    name : str
        Of the file, for messages.
    content : bytes
        A CSV file with columns ``x_px`` and ``y_px``, and ``file`` where there are several
        photographs.

    Raises
    ------
    BayesdegError
        If there is no such table, or a line is not at least two points.

    Examples
    --------
    >>> parse_lines("hint.csv", b"x_px,y_px\n1,2\n3,4\n")
    {'': array([[1., 2.],
           [3., 4.]])}
    """
    try:
        frame = pd.read_csv(io.BytesIO(content), comment="#", encoding="utf-8-sig")
    except ValueError as fault:
        raise BayesdegError(f"{name}: it is no table that can be read; write a CSV file") from fault
    missing = [column for column in _COLUMNS if column not in frame]
    if missing:
        raise BayesdegError(f"{name}: column {missing[0]} is missing; add it")
    if "file" not in frame:
        return {ANY: _line(name, frame)}
    return {
        str(file): _line(f"{name}: {file}", own) for file, own in frame.groupby("file", sort=False)
    }


def _line(place: str, frame: pd.DataFrame) -> Floats:
    points = frame[list(_COLUMNS)].apply(pd.to_numeric, errors="coerce").to_numpy(np.float64)
    if len(points) < 2 or not np.all(np.isfinite(points)):
        raise BayesdegError(f"{place}: it is not two points or more; give x_px and y_px")
    line: Floats = points
    return line


def line_of(lines: Mapping[str, Floats], name: str) -> Floats | None:
    """Return the line of a photograph, or that of any; None if there is neither."""
    return lines.get(name, lines.get(ANY))
