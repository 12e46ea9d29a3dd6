"""Bend of a line of points: the same functions for a camera's points and the model's nodes.

What laboratories call curvature depends on the operator that reads it. On the bottom line of a
chambered actuator, whose floor bulges under each chamber, operators differ by up to a fifth.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from bayesdeg.data.settings import Operator

Floats = npt.NDArray[np.float64]

MILLIMETRES_PER_METRE = 1000.0


def splines() -> Any:
    """Import ``scipy.interpolate`` late: it takes half a second, and few studies have lines."""
    return importlib.import_module("scipy.interpolate")


@dataclass(frozen=True)
class Bend:
    """Bend of a row of points.

    Parameters
    ----------
    angle : float
        Rotation of the free end relative to the clamped one, possibly beyond 180° [rad].
    arc_length : float
        Length of the row along its arc [mm].
    """

    angle: float
    arc_length: float

    @property
    def curvature(self) -> float:
        """Bend angle over arc length, the contract's mean curvature [1/m]."""
        return MILLIMETRES_PER_METRE * self.angle / self.arc_length


def measure_bend(points: npt.ArrayLike, *, end_points: int | None = None) -> Bend:
    r"""Measure bend angle and arc length of a row of points.

    The tangent at each end comes from a circular arc through the points nearest to it. On an arc
    of curvature κ the chord from s_i to s_{i+1} points along the tangent at their middle and has
    the length

    .. math:: c_i = (2/\kappa) \sin(\kappa \Delta s_i / 2)

    so the directions of chords are linear in s and the arc lengths follow from the chords; both
    are exact on a circular arc. The line through the directions is fitted by generalised least
    squares, because neighbouring chords share a point and its noise.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        (x, z) from the clamped to the free end, n at least 3; neighbours less than 90° of arc
        apart [mm].
    end_points : int, optional
        Number of points at each end that give the tangent there, at least 3; by default a third
        of the row. Few points follow the end closely, many suppress noise; all n fit one circle.

    Returns
    -------
    Bend

    Raises
    ------
    ValueError
        If there are fewer than three points, two neighbours coincide, or a value is not finite.

    Notes
    -----
    The floor of a chambered actuator bulges under each chamber, so one circle through the whole
    row can differ severalfold from the rotation of the end. Tangents at the ends are the
    contract's definition and the default.

    Examples
    --------
    A quarter of a circle of radius 100 mm, downwards:

    >>> s = np.linspace(0.0, np.pi / 2, 7)
    >>> bend = measure_bend(np.column_stack([100 * np.sin(s), 100 * np.cos(s) - 100]))
    >>> round(bend.curvature, 9), round(float(np.degrees(bend.angle)), 9)
    (10.0, 90.0)
    """
    row = _checked(points)
    steps = np.diff(row, axis=0)
    chords = np.hypot(steps[:, 0], steps[:, 1])
    directions = np.unwrap(np.arctan2(-steps[:, 1], steps[:, 0]))
    wanted = -(-len(row) // 3) if end_points is None else end_points
    count = min(len(row), max(3, wanted))
    first, last = slice(0, count - 1), slice(len(chords) - count + 1, None)
    bend = Bend(0.0, float(chords.sum()))
    # the arc lengths need the curvature, which needs the arc lengths: a rapid contraction
    for _ in range(100):
        half_angles = np.arcsin(np.clip(abs(bend.angle / bend.arc_length) * chords / 2.0, 0.0, 1.0))
        flat = half_angles < 1e-9
        arcs = np.where(
            flat, chords, chords * half_angles / np.where(flat, 1.0, np.sin(half_angles))
        )
        # the weighted sum of the directions is the bend angle
        ends = np.concatenate([[0.0], np.cumsum(arcs)])
        middles = (ends[:-1] + ends[1:]) / 2.0
        weights = np.zeros(len(arcs))
        weights[last] += _tangent_weights(middles[last] - ends[-1], chords[last])
        weights[first] -= _tangent_weights(middles[first], chords[first])
        improved = Bend(float(weights @ directions), float(arcs.sum()))
        settled = abs(improved.angle - bend.angle) <= 1e-14 * (1.0 + abs(bend.angle))
        if settled and abs(improved.arc_length - bend.arc_length) <= 1e-14 * bend.arc_length:
            return improved
        bend = improved
    return bend


def _checked(points: npt.ArrayLike) -> Floats:
    row = np.asarray(points, float)
    if row.ndim != 2 or row.shape[1] != 2 or len(row) < 3:
        raise ValueError(f"a row of points has shape (n, 2) with n at least 3, not {row.shape}")
    if not np.all(np.isfinite(row)):
        raise ValueError("every coordinate must be finite")
    if np.any(np.all(np.diff(row, axis=0) == 0.0, axis=1)):
        raise ValueError("two neighbouring points coincide")
    return row


def _tangent_weights(distances: Floats, chords: Floats) -> Floats:
    """Weigh directions at the distances so that their sum is the direction at distance 0."""
    differences = (
        np.eye(len(chords), len(chords) + 1, 1) - np.eye(len(chords), len(chords) + 1)
    ) / (chords[:, None] / chords.mean())
    design = np.column_stack([np.ones_like(distances), distances / chords.mean()])
    weighted = np.linalg.solve(differences @ differences.T, design)
    return np.asarray(np.linalg.solve(design.T @ weighted, weighted.T)[0], float)


def read_line(points: npt.ArrayLike, operator: Operator = "angle_over_arc") -> Bend:
    r"""Return curvature, angle and arc length of a line of points by an operator.

    ``angle_over_arc``
        The rotation between the ends over the arc length, as in the contract's curvature; the
        tangents at the ends replace the end faces, see `measure_bend`.
    ``circle``
        1/R of the circle fitted to all points by least squares of radial distances.
    ``spline``
        Mean curvature of an interpolating cubic spline, see `spline_bend`.
    ``base_tip``
        The circle through both ends that leaves the base along the x axis, as in
        doi:10.1089/soro.2015.0013: with the chord c at an angle φ to the axis

        .. math:: \kappa = \frac{2 \sin \varphi}{c}, \qquad \theta = 2 \varphi .

        Only this one depends on the alignment of the picture with the clamp.

    Kappa's reading, `kappa_bend`, also depends on a number of control points.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        (x, z) from the clamped to the free end; bending towards negative z is positive [mm].
    operator : str
        One of the four.

    Raises
    ------
    ValueError
        If there are fewer than three points, or four for a spline, two neighbours coincide, or a
        value is not finite.

    Examples
    --------
    On a circular arc all of them agree, the spline for close points:

    >>> s = np.linspace(0.0, np.pi / 2, 20)
    >>> row = np.column_stack([100 * np.sin(s), 100 * np.cos(s) - 100])
    >>> [round(read_line(row, name).curvature, 2) for name in OPERATORS]
    [10.0, 10.0, 10.0, 10.0]
    """
    return OPERATORS[operator](points)


def circle_bend(points: npt.ArrayLike) -> Bend:
    r"""Fit a circle by least squares of radial distances, with the Gauss–Newton method.

    The fit is in terms of curvature, so straight rows need no special case: with r from the
    first point and n across the direction there, a circle is the set of points where

    .. math:: f = a + \sqrt{1 + 2 a \kappa}\; n \cdot r + \tfrac{\kappa}{2} r^2 = 0

    and :math:`2 f / (1 + \sqrt{1 + 2 \kappa f})` is the signed distance from it (Pratt 1987,
    doi:10.1145/37402.37420).

    Examples
    --------
    >>> s = np.linspace(0.0, 1.0, 6)
    >>> row = np.column_stack([100 * np.sin(s), 100 * np.cos(s) - 100])
    >>> round(circle_bend(row).curvature, 9), round(circle_bend(row[:, ::-1]).curvature, 9)
    (10.0, -10.0)
    """
    row = _checked(points)
    start = measure_bend(row)
    r = (row - row[0]) / start.arc_length
    square = 0.5 * np.sum(r * r, axis=1)
    # an arc's end tangent deviates from its chord by half its angle
    offset, curvature = 0.0, start.angle
    direction = float(np.arctan2(r[-1, 1], r[-1, 0])) + 0.5 * curvature
    for _ in range(_STEPS):
        along = np.array([np.cos(direction), np.sin(direction)])
        ahead, across = r @ along, r @ np.array([-along[1], along[0]])
        gain = np.sqrt(max(1.0 + 2.0 * offset * curvature, _LEAST))
        f = offset + gain * across + curvature * square
        root = np.sqrt(np.maximum(1.0 + 2.0 * curvature * f, _LEAST))
        distance = 2.0 * f / (1.0 + root)
        by = (
            1.0 + curvature / gain * across,
            -gain * ahead,
            square + offset / gain * across - 0.5 * distance**2,
        )
        step = np.linalg.lstsq(np.column_stack(by) / root[:, None], -distance, rcond=None)[0]
        offset, direction, curvature = (
            float(v) for v in np.add((offset, direction, curvature), step)
        )
        if np.abs(step).max() < 1e-13 * (1.0 + abs(curvature)):
            break
    return Bend(curvature, start.arc_length)


def base_tip_bend(points: npt.ArrayLike) -> Bend:
    """Return the circle through both ends that leaves the base along the x axis.

    Examples
    --------
    >>> bend = base_tip_bend([[0.0, 0.0], [70.0, -20.0], [100.0, -100.0]])
    >>> round(float(np.degrees(bend.angle)), 9), round(bend.curvature, 9)
    (90.0, 10.0)
    """
    row = _checked(points)
    along, up = row[-1] - row[0]
    chord = float(np.hypot(along, up))
    half = float(np.arctan2(-up, along))
    return Bend(2.0 * half, chord / float(np.sinc(half / np.pi)))


def spline_bend(points: npt.ArrayLike) -> Bend:
    r"""Return turning and length of an interpolating cubic spline through at least four points.

    .. math:: \theta = \int \frac{x'' z' - x' z''}{(x'^2 + z'^2)^{3/2}} ds

    On a circular arc exact up to the third power of the spacing. The Kappa plugin for Fiji
    (doi:10.1101/852772) averages differently, see `kappa_bend`.

    Examples
    --------
    >>> s = np.linspace(0.0, np.pi / 2, 20)
    >>> row = np.column_stack([100 * np.sin(s), 100 * np.cos(s) - 100])
    >>> round(spline_bend(row).curvature, 2)
    10.0
    """
    row = _checked(points)
    if len(row) < 4:
        raise ValueError("a cubic spline needs at least 4 points")
    spline, _ = splines().make_splprep(row.T, k=3, s=0.0)
    nodes, node_weights = np.polynomial.legendre.leggauss(8)
    breaks = np.unique(spline.t)
    half = np.diff(breaks)[:, None] / 2.0
    u = (breaks[:-1, None] + half + half * nodes).ravel()
    (x1, z1), (x2, z2) = spline(u, nu=1), spline(u, nu=2)
    speed = np.hypot(x1, z1)
    weights = (half * node_weights).ravel()
    # κ ds = turning/speed³ · speed du
    turned = float(weights @ ((x2 * z1 - x1 * z2) / speed**2))
    return Bend(turned, float(weights @ speed))


def kappa_bend(points: npt.ArrayLike, controls: int) -> Bend:
    r"""Return the reading of a traced line by Fiji's plugin Kappa.

    A cubic B-spline with its first and last control point at the ends and uniform knots is fitted
    to the pixels of the line: each pixel is assigned to the nearest of 129 points on each piece,
    all control points follow by least squares, and this is repeated while the curve's points
    approach the pixels on average. The curvature is the mean of its absolute value over these
    points, which are uniform in the spline's parameter, not along the arc:

    .. math:: \bar\kappa = \frac{1}{129 m} \sum_j |\kappa(u_j)|, \qquad m = n - 3

    with n control points. The fit starts with control points spaced evenly on the line, as a person
    may set them, and ends after one to six rounds from any start: it does not read 1/R of an arc.

    Parameters
    ----------
    points : array_like, shape (n_pixels, 2)
        Pixels of the line, many per control point [mm].
    controls : int
        n, at least 4.

    Returns
    -------
    Bend
        Its angle is the mean curvature times the length of the curve.

    Raises
    ------
    ValueError
        If there are fewer than four control points, or fewer points than control points.

    Examples
    --------
    >>> s = np.linspace(0.0, np.pi / 2, 300)
    >>> row = np.column_stack([100 * np.sin(s), 100 * np.cos(s) - 100])
    >>> [round(kappa_bend(row, controls).curvature, 1) for controls in (5, 8)]
    [9.2, 9.6]
    """
    row = _checked(points)
    if not 4 <= controls <= len(row):
        raise ValueError(f"{controls} control points do not fit a spline through {len(row)} points")
    pieces = controls - 3
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, pieces + 1), [1.0] * 3])
    steps = np.linspace(0.0, 1.0, _PER_PIECE)
    places = ((np.arange(pieces)[:, None] + steps) / pieces).ravel()
    basis = splines().BSpline.design_matrix(places, knots, 3).toarray()
    first = np.round(np.linspace(0, len(row) - 1, controls)).astype(int)
    spline = splines().BSpline(knots, _fitted_as_kappa(row, row[first], basis), 3)
    rate, change = spline(places, nu=1), spline(places, nu=2)
    speed = np.hypot(*rate.T)
    turning = np.abs(change[:, 0] * rate[:, 1] - change[:, 1] * rate[:, 0]) / speed**3
    length = float(np.hypot(*np.diff(basis @ spline.c, axis=0).T).sum())
    return Bend(float(np.mean(turning)) * length, length)


def _fitted_as_kappa(pixels: Floats, controls: Floats, basis: Floats) -> Floats:
    """Return control points after repeated fits, while the curve approaches the pixels."""
    tree = importlib.import_module("scipy.spatial").KDTree
    near = tree(pixels)
    distance = np.mean(near.query(basis @ controls)[0])
    for _ in range(_ROUNDS):
        given = tree(basis @ controls).query(pixels)[1]
        moved = np.linalg.lstsq(basis[given], pixels, rcond=None)[0]
        closer = np.mean(near.query(basis @ moved)[0])
        if closer >= distance:
            break
        controls, distance = moved, closer
    return controls


_PER_PIECE = 129  # points that Kappa sets on each piece of a spline
_ROUNDS = 60  # maximum rounds of its fit; at most six occurred on lines of the model
_STEPS = 60
"""Maximum Gauss–Newton steps; fewer than ten suffice on rows that look like arcs."""
_LEAST = 1e-12
"""Lower bound of the argument of roots while the method is far off, as at the circle's centre."""

OPERATORS: Mapping[Operator, Callable[[npt.ArrayLike], Bend]] = MappingProxyType(
    {
        "angle_over_arc": measure_bend,
        "circle": circle_bend,
        "spline": spline_bend,
        "base_tip": base_tip_bend,
    }
)
