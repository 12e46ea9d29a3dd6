"""Trace a photograph: points on the bottom line, with their angle and curvature."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import expit, logit

from bayesdeg.data.settings import FEWEST_POINTS
from bayesdeg.errors import BayesdegError
from bayesdeg.quantities import Side
from bayesdeg_camera.tracing.edges import POINTS, STIFF, Edge, find_edge
from bayesdeg_camera.tracing.marks import find_marks
from bayesdeg_camera.tracing.outline import Silhouette, arc_of, find_body, len_of
from bayesdeg_camera.tracing.picture import Colours
from bayesdeg_camera.tracing.plane import (
    Plane,
    grid_plane,
    mapped,
    rescaled,
    ruler_plane,
    square_on,
)

Floats = NDArray[np.float64]

PHOTO_MB = 100.0
"""A JPEG file of 12 megapixels has 3 … 10 MB, a TIFF file 36 MB."""
#: Error of points along the line, and of its ends, located by the gel's corners [px].
ALONG, END = 0.3, 1.5
#: Largest difference of stated and measured length of the same line.
LENGTH_AGREES = 0.1
#: The clamp is identified if the region beyond it differs from that below the line by this much
#: more than at the free tip; otherwise which end is which is not sure.
CLAMP = 1.3
#: Bending away from the paper beyond noise: the line is on the wrong side [deg].
AWAY = 5.0
#: A body that contains more of the target's points than this share is the target, such as a ruler,
#: or part of it: the rim of a checkerboard has few of its corners, an actuator next to it none.
IS_TARGET = 0.05
#: Largest acceptable error of an angle [deg].
MOST_ANGLE_ERROR = 1.2
#: Least share of the line with a visible edge; marks hide it.
SEEN = 0.8
#: Least share of the stiff ends with a visible edge: the bend angle is read there.
ENDS_SEEN = 0.7
#: Prior probability that a line bends up to its ends, like a strip without end walls.
BENT_BEFORE = 0.2
#: Ends are stiff if their curvature is at most this share of that between them: 0.1 in the finite
#: element model, 0.5 for a line straight on `STIFF` and a circle between, 1 for a circle.
STIFF_SHARE = 0.5
#: Error of a point set by hand, along and across the line [px].
BY_HAND = 1.5
SAME_POINT = 1e-3  # px: far below manual precision, far above rounding
#: Points set by hand may lie outside the photograph by this share of it.
OUTSIDE = 0.05
#: Inflation of point errors for correlation over a few neighbours; tuned on rendered photographs
#: other than those of the published benchmark.
CORRELATED = 2.0


@dataclass(frozen=True)
class PictureScale:
    """Known sizes in a photograph, at least one.

    Parameters
    ----------
    grid : float, optional
        Side of a square of a checkerboard in the plane of the actuator's side [mm].
    ruler : float, optional
        Tick spacing of a ruler in that plane [mm].
    length : float, optional
        Length of the bottom line [mm]; a check if another size is given.
    mm_per_px : float, optional
        Scale of a perpendicular photograph [mm/px].
    """

    grid: float | None = None
    ruler: float | None = None
    length: float | None = None
    mm_per_px: float | None = None


@dataclass(frozen=True)
class Trace:
    """Result of tracing a photograph.

    Parameters
    ----------
    points : array, shape (n, 2)
        On the bottom line from the clamp to the tip [mm]: from the first, x along the clamped end,
        y away from the paper, so that an actuator bending towards its paper goes to y < 0.
    error : array, shape (n, 2)
        Standard errors of x and y from the edge, without scale and tilt [mm].
    pixels : array, shape (n, 2)
        The points in the photograph [px].
    seen : array of bool, shape (n,)
        Where an edge was read; other points are interpolated.
    angle, angle_error : float
        Rotation of the free end relative to the clamped one, towards the paper [deg].
    bent_ends : float
        Probability that the line bends up to its ends. From 0.5 on the angle is that of such a
        line, below that of straight ends; the error covers both.
    curvature, curvature_error : float
        Angle over length [1/m].
    length : float
        Of the line [mm].
    plane : Plane
        Plane with the target that gives the scale.
    to_mm : array, shape (3, 3)
        Homography from pixels to the frame of ``points``.
    doubts : tuple of str
        What a person should check.
    """

    points: Floats
    error: Floats
    pixels: Floats
    seen: NDArray[np.bool_]
    angle: float
    angle_error: float
    bent_ends: float
    curvature: float
    curvature_error: float
    length: float
    plane: Plane
    to_mm: Floats
    doubts: tuple[str, ...]


def angle_and_length(points: Floats) -> tuple[float, float]:
    """Return the bend angle [rad], turning left positive, and the length of a line of points.

    The angle is that between straight lines fitted to the stiff ends, like the angle between end
    faces; curvature is angle over length.

    Parameters
    ----------
    points : array, shape (n, 2)
        In order.

    Examples
    --------
    >>> at = np.linspace(0.0, 1.0, 200)
    >>> angle, length = angle_and_length(20.0 * np.column_stack([np.sin(at), 1.0 - np.cos(at)]))
    >>> round(angle, 2), round(length, 2)  # the ends of an arc are not straight
    (0.95, 20.0)
    """
    steps = np.diff(points, axis=0)
    arc = arc_of(points)
    reach = max(STIFF * arc[-1], float(arc[2]), float(arc[-1] - arc[-3]))
    first, last = _direction(points[arc <= reach]), _direction(points[arc >= arc[-1] - reach])
    # the total turning along the line selects the branch
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turned = heading[-1] - heading[0]
    angle = last - first
    return float(angle + 2.0 * np.pi * np.round((turned - angle) / (2.0 * np.pi))), float(arc[-1])


def with_bent_ends(angle: float, bent: float) -> float:
    """Correct the bend angle of a line that probably bends up to its ends.

    Straight lines through bent ends have the directions of their middles, so they miss the turning
    of half an end at either side.

    Parameters
    ----------
    angle : float
        Angle between straight lines through the ends.
    bent : float
        Probability that the line bends up to its ends.

    Examples
    --------
    >>> with_bent_ends(0.945, 0.9), with_bent_ends(0.945, 0.1)
    (1.0, 0.945)
    """
    return angle / (1.0 - STIFF) if bent >= 0.5 else angle


def ends_curvature(points: Floats) -> float:
    """Return the mean curvature of both ends of a line, over twice the length of stiff ends."""
    arc = arc_of(points)
    reach = max(2.0 * STIFF * arc[-1], float(arc[3]), float(arc[-1] - arc[-4]))
    found = []
    for end in (points[arc <= reach], points[arc >= arc[-1] - reach]):
        turn = _direction(end)
        centred = end - end.mean(axis=0)
        ahead = centred @ np.array([np.cos(turn), np.sin(turn)])
        left = centred @ np.array([-np.sin(turn), np.cos(turn)])
        found.append(2.0 * np.polyfit(ahead, left, 2)[0])
    return float(np.mean(found))


def bent_to_ends(at_ends: float, between: float, sd: float) -> float:
    """Return the probability that a line bends up to its ends, from curvatures.

    Parameters
    ----------
    at_ends, between : float
        Curvatures of the ends, and of the line between.
    sd : float
        Standard error of the ends' curvature.

    Examples
    --------
    >>> [round(bent_to_ends(ends, 1.0, 0.1), 2) for ends in (0.1, 0.5, 0.75, 1.0)]
    [0.0, 0.0, 0.2, 1.0]
    >>> round(bent_to_ends(0.3, 1.0, 10.0), 1)  # as before: nothing is seen
    0.2
    """
    stiff = np.clip(at_ends / between, 0.0, STIFF_SHARE) * between if between else 0.0
    odds = ((at_ends - stiff) ** 2 - (at_ends - between) ** 2) / (2.0 * sd**2)
    return float(expit(odds + logit(BENT_BEFORE)))


def _direction(points: Floats) -> float:
    centred = points - points.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    if axis @ (points[-1] - points[0]) < 0.0:
        axis = -axis
    return float(np.arctan2(axis[1], axis[0]))


def trace(
    image: Colours,
    scale: PictureScale,
    *,
    rng: np.random.Generator,
    hint: Floats | None = None,
    line: Floats | None = None,
    base: Side | None = None,
) -> Trace:
    """Trace the bottom line of the actuator in a photograph.

    Parameters
    ----------
    image : array of uint8
        Blue, green, red.
    scale : PictureScale
        Known sizes.
    rng : Generator
        Draws errors of the target and of points, to propagate them to the readings.
    hint : array, shape (k, 2), optional
        Points near the line, from end to end, or corrected ones [px].
    line : array, shape (k, 2), optional
        The line itself, see `trace_line`: no edge is searched then [px].
    base : {"left", "right", "top", "bottom"}, optional
        Side of the photograph with the clamp; by default it is detected.

    Raises
    ------
    BayesdegError
        If the actuator, its edge or the target is not found, or the result contradicts given
        sizes.
    """
    if line is not None:
        return trace_line(image, scale, line, rng=rng)
    marks = find_marks(image)
    body = find_body(image, hint, marks)
    found = measured(image, find_edge(image, body, marks), scale, rng=rng, base=base)
    _refuse_target(body, found.plane.target)
    return found


def _refuse_target(body: Silhouette, target: Floats) -> None:
    """Refuse a ruler or card mistaken for the actuator: it contains the target's points."""
    if body.outline is None:
        return
    hull = cv2.convexHull(body.outline.astype(np.float32))  # ticks cut into the outline
    within = [cv2.pointPolygonTest(hull, point, False) >= 0.0 for point in target.tolist()]
    if within and np.mean(within) > IS_TARGET:
        raise BayesdegError(
            "the ruler or checkerboard was mistaken for the actuator; show the bottom line with "
            "--hint, or with a points file"
        )


def trace_line(
    image: Colours, scale: PictureScale, line: Floats, *, rng: np.random.Generator
) -> Trace:
    """Use a line set by hand as the bottom line, without searching for an edge.

    Its points have an error of `BY_HAND` across the line. The side of the paper follows from the
    bend, which is towards it.

    Parameters
    ----------
    image : array of uint8
        Blue, green, red.
    scale : PictureScale
        Known sizes.
    line : array, shape (k, 2)
        From the clamp to the tip, k at least 4 [px]; repeated points count once.
    rng : Generator
        As in `trace`.

    Raises
    ------
    BayesdegError
        If it has fewer points, leaves the photograph, or contradicts given sizes.
    """
    moves = np.hypot(*np.diff(line, axis=0).T) > SAME_POINT
    line = line[np.append(np.ones(min(len(line), 1), dtype=bool), moves)]
    if len(line) < FEWEST_POINTS:
        raise BayesdegError(
            f"its line has {len(line)} points; set at least {FEWEST_POINTS}, from the clamp to the "
            "tip"
        )
    size = np.array(image.shape[1::-1])
    if np.any(line < -OUTSIDE * size) or np.any(line > (1.0 + OUTSIDE) * size):
        raise BayesdegError("its line leaves the photograph; give points in pixels of this one")
    arc = arc_of(line)
    points = CubicSpline(arc, line)(np.linspace(0.0, arc[-1], POINTS))
    every = np.ones(POINTS, dtype=bool)
    edge = Edge(points, np.full(POINTS, BY_HAND), every, np.zeros(2))
    plane = _plane(image, edge, scale, rng)
    reverse = angle_and_length(plane.placed(points))[0] < 0.0
    if reverse:
        edge = replace(edge, points=points[::-1])
    return measured(image, edge, scale, rng=rng, reverse=reverse)


def measured(
    image: Colours,
    edge: Edge,
    scale: PictureScale,
    *,
    rng: np.random.Generator,
    base: Side | None = None,
    reverse: bool | None = None,
) -> Trace:
    """Convert points on the line, with the paper on their left, to mm and readings; see `trace`.

    If ``reverse`` is not given, whether they run from tip to clamp is detected.
    """
    stiff = max(2, int(STIFF * len(edge.points)))
    if min(np.mean(edge.seen[:stiff]), np.mean(edge.seen[-stiff:])) < ENDS_SEEN:
        raise BayesdegError(
            "the edge is hidden at an end of the line, where the bend angle is read; clear the "
            "ends of marks, glare and shadow"
        )
    if np.mean(edge.seen) < SEEN:
        raise BayesdegError(
            f"the edge is visible on only {100.0 * float(np.mean(edge.seen)):.0f} % of the line; "
            "light it evenly, without marks and glare on it"
        )
    plane = _plane(image, edge, scale, rng)
    draws = np.array([_reading(plane_draw, edge, rng) for plane_draw in plane.samples])
    angle, length = angle_and_length(plane.placed(edge.points))
    if scale.length is not None and abs(length / scale.length - 1.0) > LENGTH_AGREES:
        raise BayesdegError(
            f"the line measures {length:.4g} mm but is stated as {scale.length:.4g} mm, a factor "
            f"of {length / scale.length:.3g}; check the squares of the grid, the ticks of the "
            "ruler, the scale, and whether the whole line is visible"
        )
    spread = np.std(draws, axis=0)
    between = angle / ((1.0 - STIFF) * length)
    bent = bent_to_ends(ends_curvature(plane.placed(edge.points)), between, spread[2])
    other = np.sqrt(min(bent, 1.0 - bent)) * (angle / (1.0 - STIFF) - angle)
    angle, read = with_bent_ends(angle, bent), with_bent_ends(1.0, bent)
    angle_error = float(np.degrees(np.hypot(read * spread[0], other)))
    curvature_error = float(np.hypot(read * np.std(draws[:, 0] / draws[:, 1]), other / length))
    if reverse is None and angle_error > MOST_ANGLE_ERROR:
        raise BayesdegError(
            f"the bend angle is uncertain by {angle_error:.1f} degrees; take a closer, "
            "sharper photograph, or show a checkerboard"
        )
    if np.degrees(angle) < -AWAY:
        raise BayesdegError(
            f"the line bends away from the paper by {-np.degrees(angle):.0f} degrees; show the "
            "bottom line with --hint, on the side of the paper"
        )
    doubts: tuple[str, ...] = ()
    if reverse is None:
        reverse, doubts = _order(edge, base)
    points, error, to_mm = _in_frame(plane, edge, reverse=reverse)
    order = slice(None, None, -1 if reverse else 1)
    return Trace(
        points,
        error,
        edge.points[order],
        edge.seen[order],
        float(np.degrees(angle)),
        angle_error,
        bent,
        1e3 * angle / length,
        1e3 * curvature_error,
        length,
        plane,
        to_mm,
        doubts,
    )


def _plane(image: Colours, edge: Edge, scale: PictureScale, rng: np.random.Generator) -> Plane:
    if scale.grid is not None:
        return grid_plane(image, scale.grid, rng)
    if scale.ruler is not None:
        return ruler_plane(image, scale.ruler, rng)
    if scale.mm_per_px is not None:
        return square_on(image, scale.mm_per_px, 0.0, source="stated scale", rng=rng)
    if scale.length is None:
        raise BayesdegError("no scale is given; give --grid, --ruler, --length or --scale")
    wanted = scale.length
    plane = square_on(image, 1.0, 0.0, source="stated length", rng=rng)
    return rescaled(plane, lambda h: wanted / len_of(mapped(h, edge.points)))


def _reading(
    homography: Floats, edge: Edge, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Return angle, length and curvature of the ends for a draw of points and plane."""
    ahead, normals = _axes_along(edge.points)
    white = rng.normal(size=len(edge.points) + 1)
    noise = CORRELATED * (white[1:] + white[:-1]) / np.sqrt(2.0)
    moved = edge.points + (noise * edge.error)[:, None] * normals
    moved[[0, -1]] += END * rng.normal(size=2)[:, None] * ahead[[0, -1]]
    points = mapped(homography, moved)
    return *angle_and_length(points), ends_curvature(points)


def _axes_along(points: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors along a line and across it, to its right, (n, 2) each."""
    ahead = np.gradient(points, axis=0)
    ahead /= np.hypot(*ahead.T)[:, None]
    return ahead, np.column_stack([ahead[:, 1], -ahead[:, 0]])


_TOWARDS = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "top": (0.0, -1.0), "bottom": (0.0, 1.0)}


def _order(edge: Edge, base: Side | None) -> tuple[bool, tuple[str, ...]]:
    """Return whether the line runs from tip to clamp, and doubts about it."""
    first, last = edge.ends
    sure = max(first, last) > CLAMP * min(first, last) + 1.0
    found = bool(last > first)
    if base is None:
        doubt = "which end is clamped is not sure; say so with --base"
        return found, () if sure else (doubt,)
    along = float((edge.points[-1] - edge.points[0]) @ np.array(_TOWARDS[base]))
    stated = along > 0.0
    if sure and stated != found:
        raise BayesdegError(
            f"the clamp is stated on the {base} but appears at the other end: the photograph is "
            "mirrored, or --base is wrong"
        )
    return stated, ()


def _in_frame(plane: Plane, edge: Edge, *, reverse: bool) -> tuple[Floats, Floats, Floats]:
    """Return points and errors from the clamp, x along the clamped end, y away from the paper.

    The third is the homography from pixels to that frame.
    """
    ahead, normals = _axes_along(edge.points)
    along = np.full(len(edge.points), ALONG)
    along[[0, -1]] = END
    order = slice(None, None, -1 if reverse else 1)
    # the paper is on the left; from the other side it is on the right
    upright = np.diag([1.0, 1.0 if reverse else -1.0, 1.0]) @ plane.homography
    to_mm = into_frame(mapped(upright, edge.points[order])) @ upright
    points = mapped(to_mm, edge.points)
    across = mapped(to_mm, edge.points + edge.error[:, None] * normals) - points
    forth = mapped(to_mm, edge.points + along[:, None] * ahead) - points
    return (points - points[order][0])[order], np.sqrt(across**2 + forth**2)[order], to_mm


def into_frame(points: Floats) -> Floats:
    """Return the rigid motion that moves a line to its clamped end: from 0, along x, (3, 3).

    Parameters
    ----------
    points : array, shape (n, 2)
        From the clamp [mm].

    Examples
    --------
    >>> line = np.array([[2.0, 1.0], [2.0, 2.0], [2.0, 3.0], [2.0, 4.0]])
    >>> mapped(into_frame(line), line).round(9).tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]
    """
    arc = arc_of(points)
    turn = _direction(points[arc <= max(STIFF * arc[-1], float(arc[2]))])
    c, s = np.cos(turn), np.sin(turn)
    motion = np.eye(3)
    motion[:2, :2] = [[c, s], [-s, c]]
    motion[:2, 2] = -motion[:2, :2] @ points[0]
    return motion
