"""Lines set by hand in photographs: tables of points, and exports of ImageJ and Fiji.

Supported are CSV files with columns ``x_px`` and ``y_px``, ImageJ regions of interest (``.roi``,
and sets of them, ``.zip``), and the curve points exported by Fiji's plugin Kappa.
"""

import io
import struct
import zipfile
from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from roifile import ROI_TYPE, ImagejRoi

from bayesdeg.errors import BayesdegError
from bayesdeg.files import OF_DAMAGED_ARCHIVES

Floats = NDArray[np.float64]

#: Name of a line whose file does not name its photograph.
ANY = ""
#: An ImageJ set has some hundred regions of a few kB; a damaged or hostile one may claim more.
MOST_REGIONS, LARGEST_REGION = 5000, 2_000_000
_COLUMNS = ("x_px", "y_px")
_LINES = (ROI_TYPE.POLYLINE, ROI_TYPE.FREELINE, ROI_TYPE.LINE, ROI_TYPE.POINT, ROI_TYPE.ANGLE)
_DAMAGED = (ValueError, KeyError, IndexError, TypeError, OSError, struct.error, OverflowError)
_ROI, _ZIP = b"Iout", b"PK"


def parse_lines(name: str, content: bytes) -> dict[str, Floats]:
    r"""Return lines by photograph, each (n, 2) [px].

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    content : bytes
        A CSV file with columns ``x_px`` and ``y_px``, and ``file`` for several photographs; or an
        ImageJ region of interest, or a set of them, named like the photographs.

    Raises
    ------
    BayesdegError
        If there are no points, or fewer than two on a line.

    Examples
    --------
    >>> parse_lines("hint.csv", b"x_px,y_px\n1,2\n3,4\n")
    {'': array([[1., 2.],
           [3., 4.]])}
    """
    if content.startswith(_ROI):
        return {ANY: _region(name, content)[1]}
    if content.startswith(_ZIP):
        found = _regions(name, content)
        return {ANY: next(iter(found.values()))} if len(found) == 1 else found
    try:
        frame = pd.read_csv(io.BytesIO(content), comment="#", encoding="utf-8-sig")
    except ValueError as fault:
        raise BayesdegError(
            f"{name}: it is not a readable table; give a CSV file, or an ImageJ ROI"
        ) from fault
    missing = [column for column in _COLUMNS if column not in frame]
    if missing:
        raise BayesdegError(f"{name}: column {missing[0]} is missing; add it")
    if "file" not in frame:
        return {ANY: _line(name, frame)}
    return {
        str(file): _line(f"{name}: {file}", own) for file, own in frame.groupby("file", sort=False)
    }


def _regions(name: str, content: bytes) -> dict[str, Floats]:
    """Return the lines of a set of regions by name."""
    found: dict[str, Floats] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = [one for one in archive.infolist() if one.filename.endswith(".roi")]
            if len(entries) > MOST_REGIONS or any(e.file_size > LARGEST_REGION for e in entries):
                raise BayesdegError(
                    f"{name}: it claims too many or too large regions for a set of lines; "
                    "save the set again with only the lines"
                )
            for entry in entries:
                with archive.open(entry) as file:
                    one = file.read(LARGEST_REGION)
                label, line = _region(f"{name}: {entry.filename}", one)
                found[label or entry.filename.rpartition("/")[2].removesuffix(".roi")] = line
    except OF_DAMAGED_ARCHIVES as fault:
        raise _damaged(name) from fault
    if not found:
        raise BayesdegError(
            f"{name}: it contains no ImageJ region; save the lines with ROI Manager"
        )
    return found


def _damaged(name: str) -> BayesdegError:
    return BayesdegError(f"{name}: it is damaged; save it again with ImageJ's ROI Manager")


def _region(name: str, content: bytes) -> tuple[str, Floats]:
    """Return name and points of a region."""
    try:
        region = ImagejRoi.frombytes(content)
        kind, label = region.roitype, str(region.name or "")
        points = np.asarray(region.coordinates(), dtype=np.float64)
    except _DAMAGED as fault:
        raise _damaged(name) from fault
    if kind not in _LINES:
        raise BayesdegError(
            f"{name}: it is a {kind.name.lower()}, which has no ends; draw a segmented or freehand "
            "line, or a row of points, from the clamp to the tip"
        )
    return label, _checked(name, points)


def _line(place: str, frame: pd.DataFrame) -> Floats:
    points = frame[list(_COLUMNS)].apply(pd.to_numeric, errors="coerce").to_numpy(np.float64)
    return _checked(place, points)


def _checked(place: str, points: Floats) -> Floats:
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
        raise BayesdegError(f"{place}: it has fewer than two points; give x_px and y_px")
    kept = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0.0, axis=1)])
    if kept.sum() < 2:
        raise BayesdegError(f"{place}: all its points coincide; set them along the line")
    line: Floats = points[kept]
    return line


def line_of(lines: Mapping[str, Floats], name: str) -> Floats | None:
    """Return the line of a photograph, or the one for any photograph; None if there is neither.

    Examples
    --------
    >>> line = np.zeros((2, 2))
    >>> line_of({"a": line}, "a.jpg") is line, line_of({"b": line}, "a.jpg") is None
    (True, True)
    """
    stem = name.rpartition(".")[0]
    return next((lines[key] for key in (name, stem, ANY) if key in lines), None)
