"""Traced photographs as records and as rows of tables."""

from collections.abc import Mapping
from hashlib import sha256

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.photographs import Places, TracedPhotograph
from bayesdeg_camera.tracing.picture import Colours
from bayesdeg_camera.tracing.plane import mapped
from bayesdeg_camera.tracing.trace import (
    BY_HAND,
    Trace,
    angle_and_length,
    into_frame,
    with_bent_ends,
)

Floats = NDArray[np.float64]

#: Displacement of a point for derivatives, over the length of the line.
STEP = 1e-5


def hash_of(content: bytes) -> str:
    """Return the SHA-256 of a photograph.

    Examples
    --------
    >>> hash_of(b"")[:8]
    'e3b0c442'
    """
    return sha256(content).hexdigest()


def recorded(name: str, content: bytes, image: Colours, found: Trace) -> TracedPhotograph:
    """Return the record of the trace of a photograph: its file name and content, upright."""
    return TracedPhotograph(
        file=name,
        sha256=hash_of(content),
        width=image.shape[1],
        height=image.shape[0],
        pixels=_places(found.pixels, 3),
        points=_places(found.points, 5),
        errors=_places(found.error, 6),
        seen=tuple(found.seen.tolist()),
        to_mm=found.to_mm.tolist(),
        bend_angle_deg=round(found.angle, 4),
        bend_angle_error_deg=round(found.angle_error, 4),
        bent_ends=round(found.bent_ends, 4),
        curvature_per_m=round(found.curvature, 5),
        curvature_error_per_m=round(found.curvature_error, 5),
        length_mm=round(found.length, 4),
        scale_from=found.plane.source,
        not_sure=found.doubts,
    )


def corrected(photograph: TracedPhotograph, pixels: Floats) -> TracedPhotograph:
    """Return a photograph with points moved by a person.

    Moved points are converted to mm by the homography of the tracing, rotated so that x is along
    the clamped end of the new line. They have the error of manual points.

    Parameters
    ----------
    photograph : TracedPhotograph
        The traced photograph.
    pixels : array, shape (n, 2)
        The same number of points, from the clamp [px].

    Examples
    --------
    >>> known = TracedPhotograph(
    ...     pixels=((0, 0), (10, 0), (20, 0), (30, 0)),
    ...     errors=((0.01, 0.01),) * 4,
    ...     to_mm=((0.1, 0, 0), (0, -0.1, 0), (0, 0, 1)),
    ... )
    >>> moved = corrected(known, np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 10.0]]))
    >>> moved.points[-1], moved.corrected, moved.errors[0], moved.errors[-1]
    ((3.0, -1.0), True, (0.01, 0.01), (0.15, 0.15))
    """
    to_mm, before = np.array(photograph.to_mm), np.array(photograph.pixels)
    moved = np.hypot(*(pixels - before).T) > 0.0
    here = mapped(to_mm, pixels)
    motion = into_frame(here)
    points = mapped(motion, here)
    angle, length = angle_and_length(points)
    angle = with_bent_ends(angle, photograph.bent_ends)
    beside, above = (mapped(to_mm, pixels + step) - here for step in ([1.0, 0.0], [0.0, 1.0]))
    per_pixel = np.sqrt(0.5 * (np.sum(beside**2, axis=1) + np.sum(above**2, axis=1)))[:, None]
    errors = np.where(moved[:, None], BY_HAND * per_pixel, np.array(photograph.errors))
    added = _angle_error(points, np.where(moved[:, None], errors, 0.0))
    added = with_bent_ends(added, photograph.bent_ends)
    return photograph.model_copy(
        update={
            "pixels": _places(pixels, 3),
            "points": _places(points, 5),
            "errors": _places(errors, 6),
            "to_mm": tuple(map(tuple, (motion @ to_mm).tolist())),
            "bend_angle_deg": round(float(-np.degrees(angle)), 4),
            "bend_angle_error_deg": round(
                float(np.hypot(photograph.bend_angle_error_deg, np.degrees(added))), 4
            ),
            "curvature_per_m": round(-1e3 * angle / length, 5),
            "curvature_error_per_m": round(
                float(np.hypot(photograph.curvature_error_per_m, 1e3 * added / length)), 5
            ),
            "length_mm": round(length, 4),
            "corrected": photograph.corrected or bool(moved.any()),
        }
    )


def _angle_error(points: Floats, errors: Floats) -> float:
    """Return the standard error of the bend angle due to errors of points [rad]."""
    angle, length = angle_and_length(points)
    step = STEP * length
    found = 0.0
    for place in np.argwhere(errors > 0.0):
        moved = points.copy()
        moved[tuple(place)] += step
        slope = (angle_and_length(moved)[0] - angle) / step
        found += float(slope * errors[tuple(place)]) ** 2
    return float(np.sqrt(found))


def _places(points: Floats, digits: int) -> Places:
    return tuple((round(x, digits), round(y, digits)) for x, y in points.tolist())


def marker_rows(photograph: TracedPhotograph, about: Mapping[str, object]) -> pd.DataFrame:
    """Return points as rows of ``markers.csv``, with other columns common to all of them."""
    points, errors = np.array(photograph.points), np.array(photograph.errors)
    return pd.DataFrame(
        {
            **about,
            "point": np.arange(1, len(points) + 1),
            "x_mm": points[:, 0].round(4),
            "y_mm": points[:, 1].round(4),
            "sd_mm": np.sqrt(np.mean(errors**2, axis=1)).round(5),
            "file": photograph.file,
        }
    )


def pixel_rows(photograph: TracedPhotograph) -> pd.DataFrame:
    """Return the points of a photograph in pixels, for correction."""
    pixels = np.array(photograph.pixels)
    return pd.DataFrame(
        {
            "file": photograph.file,
            "point": np.arange(1, len(pixels) + 1),
            "x_px": pixels[:, 0].round(2),
            "y_px": pixels[:, 1].round(2),
        }
    )
