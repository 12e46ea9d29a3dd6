"""Map pixels to the plane of the actuator's side, by a checkerboard, a ruler or a length."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing.picture import Colours, resized

Floats = NDArray[np.float64]

#: Longer side of the photograph on which a checkerboard is searched [px], before refinement, and
#: the methods: each alone finds only some boards.
SEARCHES = (
    (1000, 0),
    (1000, cv2.CALIB_CB_NORMALIZE_IMAGE),
    (700, 0),
    (1400, 0),
    (700, cv2.CALIB_CB_NORMALIZE_IMAGE),
    (1400, cv2.CALIB_CB_NORMALIZE_IMAGE),
)
#: Largest distance of a board's corners from a plane lattice, as a share of a square: lens
#: distortion is smaller, and a mistaken corner is off by much more.
OFF_LATTICE = 0.06
#: Inner corners along both sides of the initial board.
LEAST_CORNERS = (3, 3)
#: Tilt of a camera aligned by eye, about each axis [deg].
TILT_BY_EYE = 1.5
#: Camera distance over the width of its view: phones and cameras have 0.7 … 4 here.
DISTANCE = 3.0
#: Error floor of corners, whatever their scatter [px].
LEAST_CORNER_ERROR = 0.05
SAMPLES = 60
"""Number of planes drawn from the error of a target, to propagate it to readings."""


@dataclass(frozen=True)
class Plane:
    """A map from pixels to the plane [mm], y upwards, with samples of its error.

    Parameters
    ----------
    homography : array, shape (3, 3)
        Pixels to mm.
    samples : array, shape (n, 3, 3)
        Draws of the homography from the error of the target.
    source : str
        Source of the scale.
    target : array, shape (k, 2)
        Points of the target in the photograph, for the overlay [px].
    """

    homography: Floats
    samples: Floats
    source: str
    target: Floats

    def placed(self, points: Floats) -> Floats:
        """Map points of the photograph to the plane, (n, 2) [mm]."""
        return mapped(self.homography, points)


def mapped(homography: Floats, points: Floats) -> Floats:
    """Map points by a homography.

    Examples
    --------
    >>> mapped(np.diag([2.0, 2.0, 1.0]), np.array([[1.0, 3.0]])).tolist()
    [[2.0, 6.0]]
    """
    flat = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(flat[:, :2] / flat[:, 2:])


def grid_plane(image: Colours, square: float, rng: np.random.Generator) -> Plane:
    """Return the plane of a checkerboard.

    Parameters
    ----------
    image : array of uint8
        The photograph.
    square : float
        Side of a square [mm].
    rng : Generator
        Draws planes from the scatter of the corners.

    Raises
    ------
    BayesdegError
        If no checkerboard is found.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    best: tuple[Floats, Floats] | None = None
    for width, flags in SEARCHES:
        found = _board(grey, width, flags)
        if found is None:
            continue
        if best is not None and len(found[0]) == len(best[0]):
            break  # same size twice: this is the whole board
        if best is None or len(found[0]) > len(best[0]):
            best = found
    if best is None:
        raise BayesdegError(
            "no checkerboard is found; show one whole and unobstructed, next to the actuator, or "
            "give --length"
        )
    at, lattice = best
    lattice = _upright(at, square * lattice)
    homography, _ = cv2.findHomography(lattice, at, 0)
    residual = at - mapped(homography, lattice)
    # eight fitted parameters
    scatter = np.sqrt(np.sum(residual**2) / max(residual.size - 8, 1))
    error = max(float(scatter), LEAST_CORNER_ERROR)
    draws = [
        np.linalg.inv(cv2.findHomography(lattice, at + rng.normal(0.0, error, at.shape), 0)[0])
        for _ in range(SAMPLES)
    ]
    return Plane(np.linalg.inv(homography), np.array(draws), "grid", at)


def _board(grey: NDArray[np.uint8], width: int, flags: int) -> tuple[Floats, Floats] | None:
    """Return corners [px] and their places in the board [squares]; None if none are valid.

    The detection may cover only part of the board, or misplace a corner: then the corners do not
    form a plane lattice.
    """
    factor = min(1.0, width / max(grey.shape))
    small = resized(grey, factor)
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(
        small, LEAST_CORNERS, flags | cv2.CALIB_CB_LARGER
    )
    if not found:
        return None
    rows, columns = meta.shape[:2]
    at = (corners.reshape(-1, 2).astype(np.float64) + 0.5) / factor - 0.5
    pitch = float(np.min(np.hypot(*(at[1:columns] - at[: columns - 1]).T)))
    reach = max(3, int(0.2 * pitch))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    fine = np.float32(at).reshape(-1, 1, 2)
    at = np.asarray(
        cv2.cornerSubPix(grey, fine, (reach, reach), (-1, -1), criteria).reshape(-1, 2),
        dtype=np.float64,
    )
    lattice = np.array(
        [(i % columns, i // columns) for i in range(rows * columns)], dtype=np.float64
    )
    homography, _ = cv2.findHomography(lattice, at, 0)
    if homography is None:
        return None
    off = np.hypot(*(at - mapped(homography, lattice)).T)
    return (at, lattice) if off.max() < OFF_LATTICE * pitch else None


def _upright(at: Floats, lattice: Floats) -> Floats:
    """Turn a lattice so that x points right and y up in the photograph, never mirrored."""
    design = np.column_stack([lattice, np.ones(len(lattice))])
    (ax, ay), (bx, by) = np.linalg.lstsq(design, at, rcond=None)[0][:2]
    if ax * by - ay * bx > 0.0:  # rows of a photograph count downwards
        lattice, (bx, by) = lattice * [1.0, -1.0], (-bx, -by)
    turn = np.arctan2(-ay, ax)
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray(lattice @ np.array([[c, s], [-s, c]]))


def square_on(
    image: Colours,
    scale: float,
    relative_error: float,
    *,
    source: str,
    rng: np.random.Generator,
    target: Floats | None = None,
) -> Plane:
    """Return the plane of a photograph without a plane target, assuming a perpendicular view.

    Its error includes tilts of ``TILT_BY_EYE`` degrees about both axes.

    Parameters
    ----------
    image : array of uint8
        The photograph.
    scale : float
        Scale of the plane [mm/px].
    relative_error : float
        Standard error of the scale over the scale.
    source : str
        Source of the scale.
    rng : Generator
        Draws tilts and scales.
    target : array, optional
        Points of a ruler [px].
    """
    rows, columns = image.shape[:2]
    centre = np.array([[1.0, 0.0, -columns / 2], [0.0, -1.0, rows / 2], [0.0, 0.0, 1.0]])
    tilts = np.radians(rng.normal(0.0, TILT_BY_EYE, (SAMPLES, 2)))
    scales = scale * (1.0 + relative_error * rng.normal(size=SAMPLES))
    far = DISTANCE * max(rows, columns)
    draws = [
        np.diag([s, s, 1.0]) @ _tilted(tilt, far) @ centre
        for s, tilt in zip(scales, tilts, strict=True)
    ]
    points = np.empty((0, 2)) if target is None else target
    return Plane(np.diag([scale, scale, 1.0]) @ centre, np.array(draws), source, points)


def _tilted(tilt: Floats, far: float) -> Floats:
    """Undo a small tilt about both axes, for points about the centre [px]."""
    (sx, sy), (cx, cy) = np.sin(tilt), np.cos(tilt)
    turn = np.array([[cy, sx * sy], [0.0, cx], [-sy, cy * sx]])
    seen = np.column_stack([turn, [0.0, 0.0, 1.0]])
    seen[2, :2] /= far
    return np.linalg.inv(seen)


def rescaled(plane: Plane, make: Callable[[Floats], float]) -> Plane:
    """Scale every draw of a plane so that a length read in it has its known value.

    Parameters
    ----------
    plane : Plane
        Plane of any scale.
    make : callable
        Takes a homography, returns the factor for it.
    """

    def scaled(homography: Floats) -> Floats:
        factor = make(homography)
        return np.asarray(np.diag([factor, factor, 1.0]) @ homography)

    samples = np.array([scaled(one) for one in plane.samples])
    return Plane(scaled(plane.homography), samples, plane.source, plane.target)


#: Fewest ticks of a ruler: fewer are found on any pattern.
LEAST_TICKS = 15


def ruler_plane(image: Colours, tick: float, rng: np.random.Generator) -> Plane:
    """Return the plane of a perpendicular photograph with a ruler.

    Its ticks are dark thin strokes, parallel, similar and equally spaced; their spacing gives the
    scale along the ruler.

    Parameters
    ----------
    image : array of uint8
        The photograph.
    tick : float
        Tick spacing [mm].
    rng : Generator
        Draws planes from the error.

    Raises
    ------
    BayesdegError
        If no ruler is found.
    """
    strokes = _strokes(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    best: tuple[Floats, float, float] | None = None
    for angle in np.arange(0.0, np.pi, np.radians(3.0)):
        off = np.abs((strokes[:, 2] - angle + np.pi / 2) % np.pi - np.pi / 2)
        group = strokes[off < np.radians(4.0)]
        found = None if len(group) < LEAST_TICKS else _comb(group)
        if found is not None and (best is None or len(found[0]) > len(best[0])):
            best = found
    if best is None:
        raise BayesdegError(
            "no ruler is found; show one in focus next to the actuator, or give --length"
        )
    at, step, error = best
    return square_on(image, tick / step, error / step, source="ruler", rng=rng, target=at)


def _strokes(grey: NDArray[np.uint8]) -> Floats:
    """Return centre, direction and length of thin dark strokes: columns x, y, angle, length."""
    size = 2 * (max(grey.shape) // 160) + 1
    dark = cv2.adaptiveThreshold(
        grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, size, 25
    )
    contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        if not max(grey.shape) / 150 < len(contour) < max(grey.shape) / 6:
            continue
        (x, y), (width, height), turn = cv2.minAreaRect(contour)
        if min(width, height) * 4.0 < max(width, height):
            angle = np.radians(turn + (90.0 if height > width else 0.0)) % np.pi
            found.append((x, y, angle, max(width, height)))
    return np.array(found, dtype=np.float64).reshape(-1, 4)


def _comb(group: Floats) -> tuple[Floats, float, float] | None:
    """Fit equal steps to parallel strokes side by side; return the strokes, the step, its error."""
    doubled = np.exp(2j * group[:, 2])
    turn = float(np.angle(np.sum(doubled))) / 2.0
    across = np.array([-np.sin(turn), np.cos(turn)])
    along = np.array([np.cos(turn), np.sin(turn)])
    position, level = group[:, :2] @ across, group[:, :2] @ along
    near = np.abs(level - np.median(level)) < 1.5 * np.median(group[:, 3])
    order = np.argsort(position[near])
    at, points = position[near][order], group[near][order, :2]
    if len(at) < LEAST_TICKS:
        return None
    step = float(np.median(np.diff(at)))
    for _ in range(4):
        index = np.concatenate([[0.0], np.cumsum(np.round(np.diff(at) / step))])
        fit = np.polyfit(index, at, min(2, len(at) - 1))
        residual = at - np.polyval(fit, index)
        good = np.abs(residual) < 0.15 * step
        if np.sum(good) < LEAST_TICKS:
            return None
        at, points = at[good], points[good]
        step = float(abs(np.polyval(np.polyder(fit), np.mean(index))))
    if float(np.std(residual)) > 0.08 * step or len(at) < 0.6 * (index[-1] + 1):
        return None
    slope_error = float(np.std(residual)) / (np.std(index) * np.sqrt(len(at)))
    return points, step, slope_error
