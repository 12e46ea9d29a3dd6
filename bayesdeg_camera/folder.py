"""The folder that ``bayesdeg trace`` writes: tables, and a record for later corrections."""

import os
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field

from bayesdeg.data.photographs import TracedPhotograph, trace_rows
from bayesdeg.errors import BayesdegError
from bayesdeg.files import (
    RUN_MB,
    parse_json,
    read_bytes,
    reason,
    spreadsheet_safe,
    write_bytes,
    write_text,
    written,
)
from bayesdeg.records import FileRecord
from bayesdeg_camera.tracing.picture import Colours, read_picture, resized
from bayesdeg_camera.tracing.record import hash_of, marker_rows, pixel_rows
from bayesdeg_camera.tracing.trace import PHOTO_MB

Floats = NDArray[np.float64]

FILE = "trace.json"
#: Wide enough to see errors of a line, small enough to look through many [px].
WIDTH = 1600
#: Blue, green, red: the line where the edge was found and where not, and the target.
READ, BETWEEN, TARGET = (255, 0, 255), (0, 0, 255), (255, 160, 0)


class TraceFile(FileRecord):
    """All results of `bayesdeg trace`, with what is needed to correct them."""

    photographs: tuple[TracedPhotograph, ...] = Field(
        default=(), description="traced photographs, in the order of the tables"
    )


def way_to(folder: Path, photograph: Path) -> str:
    """Return the relative path from a folder to a photograph, valid if both are moved."""
    try:
        return os.path.relpath(photograph.resolve(), folder.resolve())
    except ValueError:  # on another drive
        return str(photograph.resolve())


def write_traces(folder: Path, photographs: Sequence[TracedPhotograph]) -> None:
    """Write record and tables of the traces, if any."""
    traced = tuple(one for one in photographs if not one.refused)
    if not traced:
        return
    write_text(folder / FILE, TraceFile(photographs=traced).text())
    tables = {
        "markers.csv": pd.concat([marker_rows(one, one.about) for one in traced]),
        "traces.csv": trace_rows(traced),
        "points.csv": pd.concat([pixel_rows(one) for one in traced]),
    }
    for file, table in tables.items():
        with written(folder / file) as part:
            table.map(spreadsheet_safe).to_csv(part, index=False, encoding="utf-8")


def write_overlay(
    folder: Path, photograph: TracedPhotograph, image: Colours, target: Floats | None = None
) -> None:
    """Write the picture for checking a line at a glance.

    A PNG shows the line, a ring at the clamped end, the results, and the points of the target from
    which the scale is, (n, 2) [px].
    """
    factor = min(1.0, WIDTH / image.shape[1])
    drawn = resized(image, factor)
    pixels = np.round(factor * 16.0 * np.array(photograph.pixels)).astype(np.int32)
    for i in range(len(pixels) - 1):
        colour = READ if photograph.seen[i] and photograph.seen[i + 1] else BETWEEN
        start, end = pixels[i].tolist(), pixels[i + 1].tolist()
        cv2.line(drawn, start, end, colour, 1, cv2.LINE_AA, 4)
    cv2.circle(drawn, (pixels[0] // 16).tolist(), 8, READ, 2, cv2.LINE_AA)
    for point in np.empty((0, 2)) if target is None else target:
        cv2.circle(drawn, np.int32(factor * point).tolist(), 3, TARGET, 1, cv2.LINE_AA)
    lines = [
        photograph.file.encode("ascii", "replace").decode(),
        f"angle {photograph.bend_angle_deg:.2f} +- {photograph.bend_angle_error_deg:.2f} deg",
        f"curvature {photograph.curvature_per_m:.2f} +- {photograph.curvature_error_per_m:.2f} 1/m",
        f"length {photograph.length_mm:.2f} mm, scale from {photograph.scale_from}",
        *(f"not sure: {doubt}" for doubt in photograph.not_sure),
        *(["corrected by hand"] if photograph.corrected else []),
    ]
    for i, text in enumerate(lines):
        for colour, width in (((0, 0, 0), 4), ((255, 255, 255), 1)):
            place = (12, 28 + 26 * i)
            cv2.putText(drawn, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, colour, width)
    done, content = cv2.imencode(".png", drawn)
    if not done:
        raise BayesdegError(
            f"{photograph.file}: its overlay cannot be drawn; give a smaller photograph"
        )
    write_bytes(folder / f"{Path(photograph.file).stem}_traced.png", bytes(content))


def read_traces(folder: Path) -> tuple[TracedPhotograph, ...]:
    """Return the traces of a folder.

    Raises
    ------
    BayesdegError
        If there are none, or they are damaged.
    """
    try:
        found = TraceFile.read(parse_json(read_bytes(folder / FILE, most_mb=RUN_MB)))
    except OSError as fault:
        raise BayesdegError(
            f"{folder}: {FILE} cannot be read ({reason(fault)}); give the --out folder of a "
            "'bayesdeg trace'"
        ) from fault
    except ValueError as fault:
        raise BayesdegError(
            f"{folder / FILE}: {fault}; the file is damaged: trace the photographs again"
        ) from fault
    for one in found.photographs:
        counts = {len(one.pixels), len(one.points), len(one.errors), len(one.seen)}
        if len(counts) > 1 or len(one.pixels) < 4 or len(one.to_mm) != 3:
            raise BayesdegError(
                f"{folder / FILE}: {one.file} has points and errors of different numbers; the file "
                "is damaged: trace the photographs again"
            )
    return found.photographs


def refuse_lost_corrections(folder: Path) -> None:
    """Refuse to trace into a folder with points that were corrected by hand."""
    if not (folder / FILE).exists():
        return
    corrected = [one.file for one in read_traces(folder) if one.corrected]
    if corrected:
        raise BayesdegError(
            f"{folder} holds points that were corrected by hand ({corrected[0]}), which would be "
            "lost; name a different folder with --out"
        )


def picture_of(folder: Path, photograph: TracedPhotograph) -> Colours:
    """Return a traced photograph, upright.

    Raises
    ------
    BayesdegError
        If it is missing or has changed.
    """
    path = folder / photograph.place
    try:
        content = read_bytes(path, most_mb=PHOTO_MB)
    except OSError as fault:
        raise BayesdegError(
            f"{path}: cannot be read ({reason(fault)}); put the photograph back, or trace again"
        ) from fault
    if hash_of(content) != photograph.sha256:
        raise BayesdegError(f"{path}: this is not the photograph that was traced; trace again")
    return read_picture(photograph.file, content)
