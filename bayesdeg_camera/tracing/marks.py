"""Marks drawn along the bottom line: their places, and the pixels they hide.

Marks are small round spots of one ink, in a row. They differ from a median-filtered photograph,
which has lost everything as small as they are; among these spots, the longest row of one ink and
size counts. Their ink is then searched along the row, pixel by pixel.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse.csgraph import minimum_spanning_tree, shortest_path
from scipy.spatial.distance import cdist

from bayesdeg_camera.tracing.picture import Colours, resized

Floats = NDArray[np.float64]
Values = NDArray[np.float32]

#: Width of the photograph on which marks are searched [px], and their diameters there [px].
WIDTH, DIAMETERS = 1000, (6.0, 9.0, 13.0)
#: Spots count for a diameter between these shares of it.
SIZES = (0.6, 1.6)
#: Window of the median filter, in diameters: a spot on an edge fills less than half of it.
WINDOW = 2.6
#: Least difference of spots from their surroundings, in CIELAB.
SPOT = 14.0
#: Lines thinner than this share of a diameter, such as paper, are not spots.
THIN = 0.45
#: Least share of its circumscribed circle that a spot fills: squares 0.64, small discs 0.8.
ROUND = 0.7
#: Largest colour difference of spots of one ink, and fewest spots of an ink.
ONE_INK, SEVERAL = 16.0, 2
#: Maximum number of inks searched.
INKS = 4
#: Fewest marks of a row, largest turn between them [deg], and largest gap as a multiple of the
#: median distance.
FEWEST, MOST_TURN, FAR = 6, 50.0, 2.5
MOST = 200  # spots of one ink: more are a pattern, such as a fabric
#: Marks are searched within this many diameters beside the row, and beyond its ends within twice as
#: many, or this many of its steps.
BESIDE, NEXT = 1.5, 1.3
#: Number of points that define the direction of a line at its end, and reach of the area beyond an
#: end, in diameters.
END_POINTS, END_REACH = 4, 5.0
END_BLUR = 1.5  # px, by which surroundings beyond an end reach in
BLUR = 0.8  # px: suppresses sensor noise
#: A pixel is ink if its difference from the ink is below this share of the marks' contrast.
IS_INK = 0.5
#: Extra margin hidden by blur and the ink's rim, as a share of a diameter and in pixels.
RIM, RIM_PX = 0.2, 2.0


@dataclass(frozen=True)
class Marks:
    """Marks on the bottom line.

    Parameters
    ----------
    centres : array, shape (k, 2)
        In row order, in either direction [px].
    diameter : float
        Diameter of a mark [px].
    hidden : array of bool, shape (rows, columns)
        Pixels hidden by marks and their rims.
    ink : array of bool, shape (rows, columns)
        Pixels along the row in the marks' colour: marks, or a clamp of that colour.
    """

    centres: Floats
    diameter: float
    hidden: NDArray[np.bool_]
    ink: NDArray[np.bool_]

    def without(self, small: Colours) -> Colours:
        """Return a photograph of any size with marks replaced by the nearest colours around."""
        share = cv2.resize(
            self.hidden.astype(np.float32), small.shape[1::-1], interpolation=cv2.INTER_AREA
        )
        nearest = distance_transform_edt(share > 0.0, return_distances=False, return_indices=True)
        return np.asarray(small[nearest[0], nearest[1]])

    def within(self, line: Floats) -> "Marks":
        """Return the marks within known ends of the line, (n, 2) [px]: pixels beyond are not ink.

        This separates a mark from a clamp of the same colour that it touches.
        """
        rows, columns = np.nonzero(self.ink)
        at, alone = np.column_stack([columns, rows]), np.ones(len(rows), dtype=bool)
        for end, inner in ((line[0], line[END_POINTS]), (line[-1], line[-1 - END_POINTS])):
            near = np.hypot(*(at - end).T) < END_REACH * self.diameter
            beyond = (at - end) @ (end - inner) / np.hypot(*(end - inner))
            alone &= ~(near & (beyond > -END_BLUR))
        ink = self.ink.copy()
        ink[rows, columns] = alone
        return _marked(ink, self.diameter) or self


def find_marks(image: Colours) -> Marks | None:
    """Find the marks of a photograph; None if there is no row of them."""
    factor = WIDTH / image.shape[1]
    small = resized(image, factor)
    colours = _lab(small)
    rows = []
    for diameter in DIAMETERS:
        for ink, stands_out in _inks(_spots(small, colours, diameter)):
            # marks on an edge may touch other small features, such as paper, and only appear round
            # by ink
            mask = np.linalg.norm(colours - ink, axis=2) < IS_INK * stands_out
            rows.append(_longest_path(_round_ones(mask.astype(np.uint8), colours, diameter)))
    for row in sorted(rows, key=len, reverse=True):
        if len(row) < FEWEST:
            return None
        centres = (row[:, :2] + 0.5) / factor - 0.5
        marks = _refined(image, centres, float(np.median(row[:, 2])) / factor)
        while marks is not None:
            # beyond the ends there may be marks that the reduced photograph does not show
            longer = _refined(image, marks.centres, marks.diameter)
            if longer is None or len(longer.centres) <= len(marks.centres):
                return marks
            marks = longer
    return None


def _lab(image: Colours) -> Values:
    return np.asarray(
        cv2.cvtColor(image.astype(np.float32) / np.float32(255.0), cv2.COLOR_BGR2LAB),
        dtype=np.float32,
    )


def _spots(small: Colours, colours: Values, diameter: float) -> Floats:
    """Return centre, diameter, colour and surrounding colour of spots of a diameter, (k, 9)."""
    around = _lab(cv2.medianBlur(small, int(WINDOW * diameter) | 1))
    differs = np.linalg.norm(colours - around, axis=2) > SPOT
    thick = max(3, int(THIN * diameter) | 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (thick, thick))
    mask = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    spots = _round_ones(mask, colours, diameter)
    at = np.round(spots[:, :2]).astype(int)
    return np.column_stack([spots, around[at[:, 1], at[:, 0]]])


def _round_ones(mask: NDArray[np.uint8], colours: Values | None, about: float) -> Floats:
    """Return centre, diameter and colour of the round parts of a mask of about a diameter, (k, 6).

    Colours are 0 if none are given.
    """
    least, most = SIZES[0] * about, SIZES[1] * about
    count, labels, parts, centres = cv2.connectedComponentsWithStats(mask)
    found = []
    for i in range(1, count):
        x, y, width, height, area = parts[i]
        diameter = float(np.sqrt(4.0 * area / np.pi))
        if not least < diameter < most:
            continue
        own = labels[y : y + height, x : x + width] == i
        _, radius = cv2.minEnclosingCircle(np.argwhere(own).astype(np.float32))
        if area > ROUND * np.pi * (radius + 0.5) ** 2:
            colour = np.zeros(3)
            if colours is not None:
                colour = np.median(colours[y : y + height, x : x + width][own], axis=0)
            found.append([*centres[i], diameter, *colour])
    return np.array(found, dtype=np.float64).reshape(-1, 6)


def _inks(spots: Floats) -> list[tuple[Values, float]]:
    """Return colours shared by several spots, the most frequent first, and their contrast."""
    left, found = spots[:MOST, 3:], list[tuple[int, Values, float]]()
    while len(left):
        near = cdist(left[:, :3], left[:, :3]) < ONE_INK
        alike = near[int(np.argmax(near.sum(axis=1)))]
        ink, around = np.split(left[alike], 2, axis=1)
        stands_out = float(np.median(np.linalg.norm(ink - around, axis=1)))
        found.append((len(ink), np.median(ink, axis=0).astype(np.float32), stands_out))
        left = left[~alike]
    often = sorted((one for one in found if one[0] >= SEVERAL), key=lambda one: -one[0])
    return [one[1:] for one in often[:INKS]]


def _longest_path(spots: Floats) -> Floats:
    """Return the spots on the longest path of their minimum spanning tree.

    It ends at sharp turns and wide gaps.
    """
    if not FEWEST <= len(spots) <= MOST:
        return spots[:0]
    apart = cdist(spots[:, :2], spots[:, :2])
    nearest = np.median(np.sort(apart, axis=1)[:, 1])
    tree = minimum_spanning_tree(np.where(apart < 2.0 * FAR * nearest, apart, 0.0))
    steps, before = shortest_path(tree, directed=False, unweighted=True, return_predecessors=True)
    steps[~np.isfinite(steps)] = -1.0
    start, end = np.unravel_index(int(np.argmax(steps)), steps.shape)
    path = [int(end)]
    while path[-1] != start:
        path.append(int(before[start, path[-1]]))
    row = spots[path]
    steps = np.diff(row[:, :2], axis=0)
    size = np.hypot(*steps.T)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turns = np.abs(np.degrees(np.diff(heading))) > MOST_TURN
    wide = size > FAR * np.median(size)
    # at a turn the row ends on the corner; at a gap it ends before it
    cuts = sorted({0, *(np.flatnonzero(turns) + 1), *(np.flatnonzero(wide) + 1), len(row)})
    return max((row[a:b] for a, b in pairwise(cuts)), key=len)


def _refined(image: Colours, centres: Floats, diameter: float) -> Marks | None:
    """Return marks from their ink pixels along a roughly located row, also beyond its ends."""
    reach = BESIDE * diameter
    ahead = np.array([centres[0] - centres[1], centres[-1] - centres[-2]])
    steps = np.hypot(*np.diff(centres, axis=0).T)
    ahead *= max(2.0 * reach, NEXT * float(np.median(steps))) / np.hypot(*ahead.T)[:, None]
    path = np.vstack([centres[0] + ahead[0], centres, centres[-1] + ahead[1]])
    low = np.maximum(np.floor(path.min(axis=0) - 4.0 * reach), 0).astype(int)
    high = np.minimum(np.ceil(path.max(axis=0) + 4.0 * reach), image.shape[1::-1]).astype(int)
    within = (slice(low[1], high[1]), slice(low[0], high[0]))
    drawn = np.zeros((high - low)[::-1], dtype=np.uint8)
    line = np.round(path - low).astype(np.int32)
    cv2.polylines(drawn, [line], isClosed=False, color=1, thickness=round(2.0 * reach))
    corridor, part = drawn == 1, image[within]
    colours = _lab(cv2.GaussianBlur(part, (0, 0), BLUR))
    at = np.round(centres - low).astype(int)
    off = np.linalg.norm(colours - np.median(colours[at[:, 1], at[:, 0]], axis=0), axis=2)
    stands_out = float(np.median(off[corridor]))
    ink = np.zeros(image.shape[:2], dtype=bool)
    ink[within] = (off < IS_INK * stands_out) & corridor
    return _marked(ink, diameter)


def _marked(ink: NDArray[np.bool_], diameter: float) -> Marks | None:
    """Return the row of marks formed by ink pixels; None if there is none."""
    rows, columns = (np.flatnonzero(ink.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    rim = int(RIM * diameter + RIM_PX)
    low = np.maximum([columns[0] - rim, rows[0] - rim], 0)
    part = ink[low[1] : rows[-1] + rim + 1, low[0] : columns[-1] + rim + 1].astype(np.uint8)
    row = _longest_path(_round_ones(part, None, diameter))
    if len(row) < FEWEST:
        return None
    hidden = np.zeros_like(ink)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1, 2 * rim + 1))
    hidden[low[1] : low[1] + len(part), low[0] : low[0] + part.shape[1]] = cv2.dilate(part, kernel)
    return Marks(row[:, :2] + low, float(np.median(row[:, 2])), hidden, ink)
