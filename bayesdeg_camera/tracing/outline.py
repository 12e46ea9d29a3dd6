"""Locate the bottom line of an actuator in a photograph roughly, by its outline.

The side view of a chambered actuator is a comb. Its bottom is the only long stretch of the outline
without a corner; this finds it in any colour, and distinguishes it from the toothed side.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing.marks import Marks
from bayesdeg_camera.tracing.picture import Colours, resized

Floats = NDArray[np.float64]

#: Width of the photograph on which the outline is searched [px].
WIDTH = 1000
#: Numbers of colours into which a photograph is divided: gel, shaded gel, background, clamp,
#: target, objects.
COLOURS = 9
#: Number of points of an outline on which corners are searched.
OUTLINE_POINTS = 500
#: Half the window of a corner, as a share of the outline: 1.3 mm of 140 mm.
CORNER_WINDOW = 5
#: Turn within the window that counts as a corner [deg].
CORNER = 38.0
#: The bottom is longer than any other stretch by this factor; without teeth two are equal.
DISTINCT = 1.8
#: Length² over area: 5.5 of the default actuator; a disc has 12 but is not a comb, a rod has 20.
SLENDER = (2.5, 16.0)
#: Share of a photograph that an actuator fills.
FILLED = (0.003, 0.4)
#: An actuator fills 0.83 … 0.90 of its convex room, bent or not; the rest are slots. With its clamp
#: 0.68. Tuned on rendered photographs other than those of the published benchmark.
SLOTTED = (0.8, 0.93)
#: Largest difference of one body's outlines in several divisions, as shares of thickness and
#: length.
ALIKE = 0.1
#: A second actuator has at least this share of the first one's size and of its colour divisions:
#: smaller things are clutter, and a ruler shows teeth in few divisions.
SECOND = 0.5
#: Largest distance of a hint from the line, as a share of its length.
HINT_REACH = 0.06


@dataclass(frozen=True)
class Silhouette:
    """A located actuator.

    Parameters
    ----------
    line : array, shape (n, 2)
        The bottom, the gel on its left in the photograph's own axes (x right, y down) [px].
    thickness : float
        Area over length [px].
    filled : float
        Area over that of the convex hull, minus the area between the line and its chord.
    outline : array, shape (m, 2), optional
        Its whole outline [px].
    """

    line: Floats
    thickness: float
    filled: float = 1.0
    outline: Floats | None = None


def find_body(image: Colours, hint: Floats | None = None, marks: Marks | None = None) -> Silhouette:
    """Find the actuator in a photograph.

    Parameters
    ----------
    image : array of uint8
        The photograph.
    hint : array, shape (k, 2), optional
        Points near the bottom line, from end to end [px].
    marks : Marks, optional
        Marks, which would break the outline.

    Raises
    ------
    BayesdegError
        If there is none, or more than one.
    """
    factor = WIDTH / image.shape[1]
    small = resized(image, factor)
    if marks is not None:  # they locate the line like a hint
        small, hint = marks.without(small), marks.centres if hint is None else hint
    outlines = list(_outlines(_clustered(small)))
    found = _with_slots(
        [body for outline in outlines if (body := _comb_body(outline, factor)) is not None]
    )
    if hint is not None:
        along = [body for body in found if _follows(body, hint)]
        # only a comb shows on which side of its line the gel is
        return _one_sided(_agreed(along), along) if along else _nearest_to(outlines, hint, factor)
    if not found:
        raise BayesdegError(
            "no actuator is found: nothing has one long smooth side and one toothed side; show its "
            "bottom line with --hint, or with a points file"
        )
    best = _agreed(found)
    enough = SECOND * _votes(best, found)
    # neither part of the first nor a small object
    others = [
        other
        for other in found
        if _apart(other, best) > 1.5 * best.thickness
        and other.thickness > SECOND * best.thickness
        and len_of(other.line) > SECOND * len_of(best.line)
    ]
    if any(_votes(other, found) >= enough for other in others):
        raise BayesdegError(
            "two actuators are found; crop the photograph to one, or show the line with --hint"
        )
    return _one_sided(best, found)


def _one_sided(best: Silhouette, found: list[Silhouette]) -> Silhouette:
    """Return the body; refuse if an equally good one lies across its line, as in a grid."""
    ahead = best.line[-1] - best.line[0]
    across = [
        other
        for other in found
        if (other.line[-1] - other.line[0]) @ ahead < 0.0
        and _apart(other, best) < ALIKE * best.thickness
    ]
    if across and max(_votes(one, found) for one in across) >= SECOND * _votes(best, found):
        raise BayesdegError(
            "something on both sides of the line looks like an actuator, such as lines of a mat; "
            "use a plain background, or give the line itself with --line"
        )
    return best


def _with_slots(found: list[Silhouette]) -> list[Silhouette]:
    """Return bodies filled like an actuator, whose slots are open to one side.

    Cards and rulers are filled more; parts of something, or several things, are filled less. If
    there are none, return those with any slots: marks break an outline.
    """
    alone = [one for one in found if SLOTTED[0] < one.filled < SLOTTED[1]]
    return alone or [one for one in found if one.filled < SLOTTED[1]]


def _agreed(found: list[Silhouette]) -> Silhouette:
    """Return the body on which most colour divisions agree; if tied, the larger."""
    return max(found, key=lambda one: (_votes(one, found), len_of(one.line) * one.thickness))


def _votes(one: Silhouette, found: list[Silhouette]) -> int:
    """Return the number of bodies that are the same."""
    return sum(
        _apart(one, other) < ALIKE * other.thickness
        and abs(one.thickness / other.thickness - 1.0) < ALIKE
        and abs(len_of(one.line) / len_of(other.line) - 1.0) < ALIKE
        for other in found
    )


def _follows(body: Silhouette, hint: Floats) -> bool:
    """Whether a body's line follows a hint and is not much longer."""
    reach = HINT_REACH * len_of(hint)
    apart = np.hypot(*(_dense(hint)[:, None] - body.line[None]).transpose(2, 0, 1))
    # a hint's ends may lie beyond those of the line
    ways = (float(np.quantile(apart.min(axis=axis), 0.9)) for axis in (0, 1))
    return max(ways) < reach


def _dense(hint: Floats) -> Floats:
    """Return 60 points in equal steps along a hint."""
    return points_at(hint, np.linspace(0.0, len_of(hint), 60))


def _apart(one: Silhouette, other: Silhouette) -> float:
    """Return the distance of the middle of a line from another [px]."""
    middle = one.line[len(one.line) // 2]
    return float(np.min(np.hypot(*(middle - other.line).T)))


def arc_of(line: Floats) -> Floats:
    """Length along a line through points up to each of them, (n,).

    Examples
    --------
    >>> arc_of(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])).tolist()
    [0.0, 5.0, 6.0]
    """
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])


def len_of(line: Floats) -> float:
    """Length of a line through points.

    Examples
    --------
    >>> len_of(np.array([[0.0, 0.0], [3.0, 4.0]]))
    5.0
    """
    return float(arc_of(line)[-1])


def points_at(line: Floats, arc: Floats) -> Floats:
    """Return points of a line at lengths along it, or its ends beyond them, (n, 2).

    Examples
    --------
    >>> points_at(np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([2.5, 9.0])).tolist()
    [[1.5, 2.0], [3.0, 4.0]]
    """
    known = arc_of(line)
    return np.column_stack([np.interp(arc, known, axis) for axis in line.T])


def _clustered(small: Colours) -> NDArray[np.int32]:
    """Divide a photograph into a few colours, starting from those farthest apart."""
    lab = cv2.cvtColor(cv2.medianBlur(small, 5), cv2.COLOR_BGR2LAB).astype(np.float32)
    lab[..., 0] *= 0.5  # illumination varies over one object
    coarse = lab[::6, ::6].reshape(-1, 3)
    centres = [np.median(coarse, axis=0)]
    distance = np.linalg.norm(coarse - centres[0], axis=1)
    for _ in range(COLOURS - 1):
        # the median of the farthest 1 %: a single pixel is not a colour
        order = np.argsort(distance)[-max(3, len(distance) // 200) :]
        centres.append(coarse[order[len(order) // 2]])
        distance = np.minimum(distance, np.linalg.norm(coarse - centres[-1], axis=1))
    sums = np.array(centres, dtype=np.float32)
    for _ in range(8):
        label = _closest(coarse, sums)
        sums = np.array(
            [
                coarse[label == k].mean(axis=0) if np.any(label == k) else sums[k]
                for k in range(len(sums))
            ],
            dtype=np.float32,
        )
    return _closest(lab.reshape(-1, 3), sums).reshape(lab.shape[:2])


def _closest(points: NDArray[np.float32], centres: NDArray[np.float32]) -> NDArray[np.int32]:
    offset = np.sum(centres**2, axis=1)
    return np.argmin(offset - 2.0 * points @ centres.T, axis=1).astype(np.int32)


def _outlines(labels: NDArray[np.int32]) -> Iterator[Floats]:
    """Yield outlines of regions of one or two colours and plausible size [reduced px]."""
    kernel = np.ones((3, 3), dtype=np.uint8)
    count = int(labels.max()) + 1
    for first in range(count):
        for second in range(first, count):
            mask = ((labels == first) | (labels == second)).astype(np.uint8)
            mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
            contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            for contour in contours:
                area = cv2.contourArea(contour)
                low, high = contour.min(axis=(0, 1)), contour.max(axis=(0, 1))
                inside = np.all(low > 1) and np.all(high < np.array(labels.shape[::-1]) - 2)
                if inside and FILLED[0] < area / labels.size < FILLED[1]:
                    outline = contour[:, 0].astype(np.float64)
                    # gel on the left along the line
                    yield outline if cv2.contourArea(contour, oriented=True) > 0 else outline[::-1]


def _evenly(outline: Floats, count: int) -> Floats:
    closed = np.vstack([outline, outline[:1]])
    return points_at(closed, np.linspace(0.0, len_of(closed), count, endpoint=False))


def _comb_body(outline: Floats, factor: float) -> Silhouette | None:
    """Return the body of an outline that is a comb."""
    points = _evenly(outline, OUTLINE_POINTS)
    behind = points - np.roll(points, CORNER_WINDOW, axis=0)
    ahead = np.roll(points, -CORNER_WINDOW, axis=0) - points
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    turning = np.abs(np.degrees(np.arctan2(cross, np.sum(behind * ahead, axis=1))))
    corners = [
        i
        for i in np.flatnonzero(turning > CORNER)
        if turning[i]
        == turning[np.arange(i - CORNER_WINDOW, i + CORNER_WINDOW + 1) % len(points)].max()
    ]
    if len(corners) < 6:
        return None
    gaps = np.diff([*corners, corners[0] + len(points)])
    order = np.argsort(gaps)
    start, size = corners[order[-1]], int(gaps[order[-1]])
    line = points[np.arange(start, start + size + 1) % len(points)]
    area = cv2.contourArea(np.float32(outline))
    hull = cv2.contourArea(cv2.convexHull(np.float32(outline)))
    room = hull - cv2.contourArea(np.float32(line))
    slender = len_of(line) ** 2 / area
    if size < DISTINCT * gaps[order[-2]] or not SLENDER[0] < slender < SLENDER[1]:
        return None
    if np.hypot(*(line[-1] - line[0])) < 0.3 * len_of(line):
        return None  # round objects with a notch
    thickness = area / len_of(line) / factor
    around, placed = (points + 0.5) / factor - 0.5, (_smoothed(line) + 0.5) / factor - 0.5
    return Silhouette(placed, thickness, area / max(room, 1.0), around)


def _nearest_to(outlines: list[Floats], hint: Floats, factor: float) -> Silhouette:
    """Return the body whose outline the hint follows."""
    hint = (hint + 0.5) * factor - 0.5
    dense = _dense(hint)
    best, least = None, HINT_REACH * len_of(hint)
    for outline in outlines:
        points = _evenly(outline, OUTLINE_POINTS)
        apart = np.hypot(*(dense[:, None] - points[None]).transpose(2, 0, 1))
        # a hint's ends may lie beyond those of the line
        off = float(np.quantile(apart.min(axis=1), 0.9))
        if off < least:
            first, last = (int(np.argmin(apart[i])) for i in (0, -1))
            ways = (
                np.arange(first, first + (last - first) % len(points) + 1) % len(points),
                np.arange(last, last + (first - last) % len(points) + 1) % len(points),
            )
            line = points[min(ways, key=lambda way: float(apart[:, way].min(axis=0).max()))]
            if len(line) > 10:
                area = cv2.contourArea(np.float32(outline))
                body = Silhouette(
                    (_smoothed(line) + 0.5) / factor - 0.5, area / len_of(line) / factor
                )
                best, least = body, off
    if best is None:
        raise BayesdegError(
            "the hint does not follow any edge; give points of the bottom line, in "
            "pixels, from end to end"
        )
    return best


def _smoothed(line: Floats) -> Floats:
    """Smooth pixel steps; ends are extrapolated straight."""
    reach = 6
    before = 2.0 * line[0] - line[reach:0:-1]
    after = 2.0 * line[-1] - line[-2 : -reach - 2 : -1]
    padded = np.vstack([before, line, after])
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / 2.5) ** 2)
    weights /= weights.sum()
    return np.column_stack([np.convolve(axis, weights, mode="valid") for axis in padded.T])
