"""Locate the bottom line to a fraction of a pixel: the gel's edge on profiles across the line.

Profiles are sampled along the normals of a rough line. The edge is where the colour, coming from
the gel, has changed half way to the brightest difference of what follows, paper or background.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.spatial.distance import cdist

from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing.marks import Marks
from bayesdeg_camera.tracing.outline import Silhouette, len_of, points_at
from bayesdeg_camera.tracing.picture import Colours

Floats = NDArray[np.float64]
Values = NDArray[np.float32]

#: Half lengths of profiles in successive passes, as shares of the thickness.
REACHES = (0.14, 0.09, 0.07)
#: The gel's own colour is sampled between these depths, as shares of the thickness; with marks,
#: from this many of their diameters inwards.
INNER, MARKED = (0.08, 0.3), 1.1
#: Search distance for colour beyond the rough ends, as a share of the thickness.
BEYOND = 0.35
#: Beyond an end, the difference from the gel must exceed this share of that below the line;
#: otherwise the gel continues. Among 134 rendered photographs the smallest value was 0.77; the one
#: line that ended inside the body had 0.10.
GOES_ON = 0.4
#: Number of points along the line.
POINTS = 86
#: Stiff ends of an actuator, where its line is straight: end walls take 3 of 50 mm.
STIFF = 0.055
#: Edges farther from their neighbours than this many deviations are not used.
OUTLYING = 3.5
#: Smallest assumed deviation of neighbouring edges: a rough line is off by more at kinks [px].
SPREAD = 0.4
#: Share of a rough line omitted at both ends, where its corners are.
ROUNDED = 0.03
#: Number of points used to extrapolate ends without an edge, straight.
STRAIGHT = 6
#: Least contrast of an edge relative to the noise along the line.
LEAST_CONTRAST = 4.0
#: Least share of the line with a visible edge.
LEAST_SEEN = 0.6
#: Least line length, about a pixel per point, and least profile length for a whole edge [px].
LEAST_LENGTH, LEAST_REACH = 90.0, 1.5
#: Width of the derivative across the line [px].
BLUR = 1.0
#: Weights of lightness and both colour axes in an edge: JPEG files and sensor filters store colour
#: at half the resolution or less, and blocks of 16 pixels shift colour edges.
WEIGHTS = np.array([1.0, 0.4, 0.4], dtype=np.float32)
#: Share of the strongest colour change on a profile from which a change is an edge.
FIRST = 0.4
#: Error floor of an edge from pixels, colour filters and compression, for any number read [px].
LEAST_ERROR = 0.04
#: At a mark, the edge is known if it is visible on both sides on more than this share of this many
#: diameters; this many marks determine how marks lie on the edge.
FEW, BESIDE, FEWEST_KNOWN = 0.3, 2.0, 4
#: Share of a mark's scatter used as the error of a point on it: errors of points are inflated for
#: correlation, which the scatter of marks already includes.
SHARED = 0.5
#: Number of points over which a line with marks is smoothed before rereading: two or three marks.
SMOOTH = 15
#: Distance from the ends without edge readings, as blur rounds the corner [px].
CORNER = 3.0


@dataclass(frozen=True)
class Edge:
    """Points on the bottom line, in order.

    Parameters
    ----------
    points : array, shape (n, 2)
        From one end to the other [px].
    error : array, shape (n,)
        Standard error of each across the line [px].
    seen : array of bool, shape (n,)
        Where an edge was read; other points are interpolated.
    ends : array, shape (2,)
        How much more the surroundings beyond the first and last end differ from those below the
        line: large at a clamp, small at a free tip [colour units].
    """

    points: Floats
    error: Floats
    seen: NDArray[np.bool_]
    ends: Floats


def find_edge(image: Colours, body: Silhouette, marks: Marks | None = None) -> Edge:
    """Refine the line of a roughly located body.

    Where marks hide the edge, points are taken from the marks, see `_through_marks`.

    Raises
    ------
    BayesdegError
        If the edge is too faint, or hidden over too much of the line.
    """
    # outlines are rounded at corners
    rough = len_of(body.line)
    line = _at(body.line, np.linspace(ROUNDED * rough, (1.0 - ROUNDED) * rough, 2 * POINTS))[0]
    edge, goes_on, skin = None, False, INNER[0] * body.thickness
    if marks is not None:
        skin = max(skin, MARKED * marks.diameter)
    for reach in REACHES:
        line, ends, goes_on = _to_ends(image, line, body.thickness, skin)
        _refuse_small(len_of(line), body.thickness)
        shown = None if marks is None else marks.within(line)
        edge = _read(image, line, reach * body.thickness, shown)
        line = _straight_ends(edge)
        edge = Edge(line, edge.error, edge.seen, ends)
        if marks is not None:
            line = _smooth(line)
    assert edge is not None
    if goes_on:
        raise BayesdegError(
            "the gel continues beyond an end of the line found; show the whole line with --hint"
        )
    return edge


def _smooth(line: Floats) -> Floats:
    """Return a smooth reference line for marks, without their own effect, with straight stiff ends.

    The last point is extrapolated, so it is not used.
    """
    smooth: Floats = savgol_filter(line, SMOOTH, 2, axis=0)
    at = np.arange(int(STIFF * len(line)) + 1)
    for part, raw in ((smooth, line), (smooth[::-1], line[::-1])):
        ends = [np.polyval(np.polyfit(at[1:], axis[at[1:]], 1), at) for axis in raw.T]
        part[at] = np.column_stack(ends)
    return smooth


def _straight_ends(edge: Edge) -> Floats:
    """Extrapolate a line straight over its stiff ends where no edge was read."""
    points, known = edge.points.copy(), np.flatnonzero(edge.seen)
    last = len(points) - 1
    for end, inner in ((0, known[:STRAIGHT]), (last, known[-STRAIGHT:])):
        missing = np.arange(0, inner[0]) if end == 0 else np.arange(inner[-1] + 1, last + 1)
        if len(missing):
            points[missing] = np.column_stack(
                [np.polyval(np.polyfit(inner, axis[inner], 1), missing) for axis in edge.points.T]
            )
    return points


def _at(line: Floats, arc: Floats) -> tuple[Floats, Floats]:
    """Return points at arc lengths along a line, or beyond its ends, and normals off the gel."""
    length, points = len_of(line), points_at(line, arc)
    window = max(length / 40.0, 2.0)
    inside = np.clip(arc, 0.0, length)
    before, after = np.maximum(inside - window, 0.0), np.minimum(inside + window, length)
    ahead = points_at(line, after) - points_at(line, before)
    ahead /= np.hypot(*ahead.T)[:, None]
    points += ahead * (np.minimum(arc, 0.0) + np.maximum(arc - length, 0.0))[:, None]
    return points, np.column_stack([ahead[:, 1], -ahead[:, 0]])


def _sampled(image: Colours, points: Floats, normals: Floats, off: Floats) -> Values:
    """Return colours at distances from points along normals, (n_points, n_off, 3), in CIELAB."""
    at = (points[:, None] + off[None, :, None] * normals[:, None]).astype(np.float32)
    low = np.maximum(np.floor(at.min(axis=(0, 1))).astype(int) - 2, 0)
    high = np.ceil(at.max(axis=(0, 1))).astype(int) + 3
    part = image[low[1] : high[1], low[0] : high[0]]
    values = cv2.remap(
        part.astype(np.float32) / np.float32(255.0),
        at[..., 0] - np.float32(low[0]),
        at[..., 1] - np.float32(low[1]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(cv2.cvtColor(values, cv2.COLOR_BGR2LAB), dtype=np.float32)


def _to_ends(
    image: Colours, line: Floats, thickness: float, skin: float
) -> tuple[Floats, Floats, bool]:
    """Move both ends of a line to where the gel ends; compare the colours beyond and below.

    The gel's colour is sampled from ``skin`` [px] inwards. The third value says whether there is
    gel beyond an end.
    """
    length = len_of(line)
    room = BEYOND * thickness
    arc = np.arange(-room, length + room, 1.0)
    points, normals = _at(line, arc)
    inner = _sampled(image, points, normals, -np.linspace(skin, INNER[1] * thickness, 9))
    outer = np.median(
        _sampled(image, points, normals, thickness * np.linspace(0.15, 0.35, 7)), axis=1
    )
    colour = np.median(inner, axis=1)
    middle = (arc > 0.1 * length) & (arc < 0.9 * length)
    gel = np.median(colour[middle], axis=0)
    different = np.linalg.norm(colour - gel, axis=1)
    below = np.median(outer[middle], axis=0)
    least = GOES_ON * float(np.linalg.norm(below - gel))
    found, ends, goes_on = [], [], False
    for beyond, order in ((arc < 0.0, slice(None, None, -1)), (arc > length, slice(None))):
        far = np.sort(different[beyond])[len(different[beyond]) // 2 :].mean()
        goes_on |= bool(far < least)
        near = np.abs(arc - (0.0 if order.step == -1 else length)) < room
        at, value = arc[near][order], different[near][order]
        level = 0.5 * (far + np.median(different[middle]))
        # from inside, the first that stays above the level
        above = np.flatnonzero(np.convolve(value > level, np.ones(3), mode="valid") == 3)
        if len(above) == 0 or above[0] == 0:
            found.append(0.0 if order.step == -1 else length)
        else:
            k = int(above[0])
            share = (level - value[k - 1]) / max(value[k] - value[k - 1], 1e-6)
            found.append(float(at[k - 1] + share * (at[k] - at[k - 1])))
        there = np.median(colour[beyond], axis=0)
        ends.append(float(np.linalg.norm(there - below)))
    moved = np.linspace(found[0], found[1], 4 * POINTS)
    return _at(line, moved)[0], np.array(ends), goes_on


def _refuse_small(length: float, thickness: float) -> None:
    """Refuse a body that is too short, or too thin for the shortest profiles across its edge."""
    larger = max(LEAST_LENGTH / length, LEAST_REACH / (REACHES[-1] * thickness))
    if larger > 1.0:
        raise BayesdegError(
            f"the body found is too small to read an edge: {length:.0f} pixels long and "
            f"{thickness:.0f} thick; move the camera {larger:.2g} times closer, so that the "
            f"line has {np.ceil(larger * length):.0f} pixels, or show the line with --hint"
        )


def _read(image: Colours, line: Floats, reach: float, marks: Marks | None) -> Edge:
    length = len_of(line)
    arc = np.arange(CORNER, length - CORNER, 1.0)
    points, normals = _at(line, arc)
    off = np.arange(-2.0 * reach, reach + 0.25, 0.5)
    profiles = WEIGHTS * _sampled(image, points, normals, off)
    width = 2 * int(length / POINTS / 4.0) + 1
    profiles = cv2.blur(profiles, (1, width), borderType=cv2.BORDER_REPLICATE)
    place, contrast = _crossings(profiles, off, reach)
    if marks is None:
        return _averaged(line, arc, place, contrast, np.zeros(len(arc)))
    across = off[off > -reach]
    at = np.round(points[:, None] + across[None, :, None] * normals[:, None]).astype(int)
    columns, rows = (np.clip(at[..., k], 0, marks.hidden.shape[1 - k] - 1) for k in (0, 1))
    hidden = marks.hidden[rows, columns].any(axis=1)
    place = np.where(hidden, np.nan, place)
    through, error = _through_marks(points, normals, place, marks)
    marked = hidden & np.isfinite(through)
    place, contrast = np.where(marked, through, place), np.where(marked, np.inf, contrast)
    return _averaged(line, arc, place, contrast, np.where(marked, error, 0.0))


def _through_marks(
    points: Floats, normals: Floats, place: Floats, marks: Marks
) -> tuple[Floats, float]:
    """Return the offset of a line through marks, at each of them, and its error [px].

    Marks need not be on the edge. Where the edge is visible on both sides of them, their mean
    offset and scatter are measured: the offset is subtracted, the scatter is the error.

    Parameters
    ----------
    points, normals : array, shape (n, 2)
        On a rough line, one pixel apart.
    place : array, shape (n,)
        Distance of the edge from them; NaN where not visible.
    """
    at = np.argmin(cdist(marks.centres, points), axis=1)
    offset = np.sum((marks.centres - points[at]) * normals[at], axis=1)
    reach, index = int(BESIDE * marks.diameter), np.arange(len(points))
    beside = np.array(
        [[_middle(place[max(k - reach, 0) : k]), _middle(place[k : k + reach])] for k in at]
    ).mean(axis=1)
    known = np.isfinite(beside)
    through = np.full(len(points), np.nan)
    if np.sum(known) < FEWEST_KNOWN:
        return through, 0.0
    off = (offset - beside)[known]
    common = np.median(off)
    for k, one in zip(at, offset - common, strict=True):
        through[np.abs(index - k) <= 0.5 * marks.diameter] = one
    scatter = 1.48 * float(np.median(np.abs(off - common)))
    return through, max(SHARED * scatter, LEAST_ERROR)


def _middle(place: Floats) -> float:
    """Return the median of visible edges; NaN if there are few."""
    there = place[np.isfinite(place)]
    return float(np.median(there)) if len(there) > FEW * len(place) else np.nan


def _crossings(profiles: Values, off: Floats, reach: float) -> tuple[Floats, Floats]:
    """Return where each profile leaves the gel, and the strength of that edge relative to noise.

    Paper is a few pixels wide and may be followed by a stronger edge of the background; the gel's
    is the first from inside that is not faint.
    """
    step = off[1] - off[0]
    at = np.arange(-4, 5) * step / BLUR
    slope = (at * np.exp(-0.5 * at * at)).astype(np.float32)
    change = -cv2.filter2D(profiles, cv2.CV_32F, -slope[None] / np.abs(slope).sum())
    strength = np.linalg.norm(change, axis=2)
    inside = off < -reach
    noise = np.median(strength[:, inside], axis=1)
    s, at = strength[:, ~inside], off[~inside]
    top = s[:, 1:-1].max(axis=1)
    peak = (s[:, 1:-1] >= s[:, :-2]) & (s[:, 1:-1] > s[:, 2:])
    peak &= s[:, 1:-1] > FIRST * top[:, None]
    first = np.argmax(peak, axis=1) + 1
    rows = np.arange(len(s))
    before, here, after = (
        s[rows, first - 1],
        s[rows, first],
        s[rows, np.minimum(first + 1, len(at) - 1)],
    )
    bend = before - 2.0 * here + after
    share = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, -1.0), 0.0)
    place = (at[first] + step * share).astype(np.float64)
    place[~peak.any(axis=1)] = np.nan
    return place, (here / np.maximum(noise, 0.05)).astype(np.float64)


def _averaged(line: Floats, arc: Floats, place: Floats, contrast: Floats, common: Floats) -> Edge:
    """Average the offsets of edges about points along the line.

    ``common`` is an error common to neighbours that averaging does not reduce, (n,).
    """
    length = len_of(line)
    good = np.isfinite(place) & (contrast > LEAST_CONTRAST)
    for _ in range(3):
        if np.sum(good) < LEAST_SEEN * len(arc):
            raise BayesdegError(
                "the bottom edge is too faint or hidden; light the paper evenly, or use a plain "
                "background of a different colour"
            )
        expected = _running(arc, place, good, length / 12.0)
        residual = place - expected
        spread = 1.48 * np.median(np.abs(residual[good])) + SPREAD
        good = (
            np.isfinite(place)
            & (contrast > LEAST_CONTRAST)
            & (np.abs(residual) < OUTLYING * spread)
        )
    at = np.linspace(0.0, length, POINTS)
    step = length / (POINTS - 1)
    offsets, error, seen = np.empty(POINTS), np.empty(POINTS), np.zeros(POINTS, dtype=bool)
    for i, here in enumerate(at):
        half = max(1.0 * step, 4.0)
        near = good & (np.abs(arc - here) <= half)
        seen[i] = np.sum(near) > 0.35 * np.sum(np.abs(arc - here) <= half)
        if not seen[i]:
            near = good & (np.abs(arc - here) <= 4.0 * half)
        if np.sum(near) < 4:
            near = good & (np.abs(arc - here) <= length / 8.0)
        slope = np.polyfit(arc[near] - here, place[near], 1) if np.sum(near) > 3 else [0.0, 0.0]
        offsets[i] = slope[1]
        # neighbouring profiles share pixels and blur: about one in four is independent
        scatter = (
            np.std(place[near] - np.polyval(slope, arc[near] - here)) if np.sum(near) > 3 else 1.0
        )
        lever = 2.0 if i in (0, POINTS - 1) else 1.0
        alone = np.hypot(scatter / np.sqrt(max(np.sum(near) / 4.0, 1.0)), LEAST_ERROR)
        error[i] = lever * np.hypot(alone, np.mean(common[near]) if np.any(near) else 0.0)
    points, normals = _at(line, at)
    return Edge(points + offsets[:, None] * normals, error, seen, np.zeros(2))


def _running(arc: Floats, place: Floats, good: NDArray[np.bool_], window: float) -> Floats:
    """Return an interpolated running median of the good edges."""
    at = np.linspace(arc[0], arc[-1], 40)
    middle = np.array(
        [
            np.median(place[near])
            if np.any(near := good & (np.abs(arc - one) < window / 2))
            else np.nan
            for one in at
        ]
    )
    known = np.isfinite(middle)
    smooth: Floats = np.interp(arc, at[known], middle[known])
    return smooth
