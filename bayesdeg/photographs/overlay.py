"""A photograph with its traced line, to be checked at a glance."""

import cv2
import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg.errors import BayesdegError
from bayesdeg.photographs.picture import Colours

Floats = NDArray[np.float64]

#: Wide enough to see by how much a line is off, small enough to look through many [px].
WIDTH = 1600
#: Blue, green, red: of the line where the edge was read, and where it was not; of the target.
READ, BETWEEN, TARGET = (255, 0, 255), (0, 0, 255), (255, 160, 0)


def overlay(image: Colours, found: TracedPhotograph, target: Floats | None = None) -> bytes:
    """Return a PNG: the line, its clamped end a ring, the target's points, and what was read.

    Parameters
    ----------
    image : array of uint8
        The photograph.
    found : TracedPhotograph
        What was read of it.
    target : array, shape (n, 2), optional
        Points that the scale is from [px].
    """
    factor = min(1.0, WIDTH / image.shape[1])
    drawn = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    pixels = np.round(factor * 16.0 * np.array(found.pixels)).astype(np.int32)
    for i in range(len(pixels) - 1):
        colour = READ if found.seen[i] and found.seen[i + 1] else BETWEEN
        start, end = pixels[i].tolist(), pixels[i + 1].tolist()
        cv2.line(drawn, start, end, colour, 1, cv2.LINE_AA, 4)
    cv2.circle(drawn, (pixels[0] // 16).tolist(), 8, READ, 2, cv2.LINE_AA)
    for point in np.empty((0, 2)) if target is None else target:
        cv2.circle(drawn, np.int32(factor * point).tolist(), 3, TARGET, 1, cv2.LINE_AA)
    lines = [
        found.file.encode("ascii", "replace").decode(),
        f"angle {found.bend_angle_deg:.2f} +- {found.bend_angle_error_deg:.2f} deg",
        f"curvature {found.curvature_per_m:.2f} +- {found.curvature_error_per_m:.2f} 1/m",
        f"length {found.length_mm:.2f} mm, scale from {found.scale_from}",
        *(f"not sure: {doubt}" for doubt in found.not_sure),
        *(["corrected by hand"] if found.corrected else []),
    ]
    for i, text in enumerate(lines):
        for colour, width in (((0, 0, 0), 4), ((255, 255, 255), 1)):
            place = (12, 28 + 26 * i)
            cv2.putText(drawn, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, colour, width)
    written, content = cv2.imencode(".png", drawn)
    if not written:
        raise BayesdegError(f"{found.file}: its overlay cannot be drawn; give a smaller photograph")
    return bytes(content)
