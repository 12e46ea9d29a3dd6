"""A row of marker points → bend angle and mean curvature.

Points lie in the bending plane: x along the undeformed beam from the clamped end, z up, away from
the paper. Bending downwards, towards the paper, is positive. The same operator serves the camera
and the mesh.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_splprep

Floats = npt.NDArray[np.float64]

MILLIMETRES_PER_METRE = 1000.0


@dataclass(frozen=True)
class Bend:
    """How far a row of points is bent.

    Parameters
    ----------
    angle : float
        Rotation of the free end relative to the clamped one, beyond 180° too [rad].
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
        of the row. Few follow the very end, many suppress noise; all n fit one circle.

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
    bend = Bend(0.0, float(chords.sum()))
    # the arc lengths need the curvature, which needs the arc lengths: a rapid contraction
    for _ in range(100):
        arcs = _arcs(chords, bend.angle / bend.arc_length)
        weights = _angle_weights(arcs, chords, _end_count(len(row), end_points))
        improved = Bend(float(weights @ directions), float(arcs.sum()))
        settled = abs(improved.angle - bend.angle) <= 1e-14 * (1.0 + abs(bend.angle))
        if settled and abs(improved.arc_length - bend.arc_length) <= 1e-14 * bend.arc_length:
            return improved
        bend = improved
    return bend


def curvature_standard_error(
    points_count: int, arc_length: float, noise_sd: float, *, end_points: int | None = None
) -> float:
    r"""Compute the standard error of `measure_bend`'s curvature from the noise of the points.

    The bend angle is a weighted sum of the directions of chords, :math:`\sum_i a_i \phi_i`, and to
    first order :math:`\phi_i = (e_{i+1} - e_i)/c` with e the noise across the row, so

    .. math::
        \sigma_\kappa = \frac{\sigma}{c L}
        \sqrt{\sum_{j} (a_{j-1} - a_j)^2}, \quad a_{-1} = a_{n-1} = 0

    for n evenly spaced points. Noise along the row changes L by a share of σ/L only and is left
    out.

    Parameters
    ----------
    points_count : int
        n, at least 3.
    arc_length : float
        L [mm].
    noise_sd : float
        Standard deviation σ of each coordinate of a point [mm].
    end_points : int, optional
        As in `measure_bend`.

    Returns
    -------
    float
        [1/m]

    Raises
    ------
    ValueError
        If there are fewer than three points.

    Examples
    --------
    Three points fix κ = (z_0 − 2 z_1 + z_2)/c² up to sign, whose error is σ √6/c²:

    >>> round(curvature_standard_error(3, 50.0, 0.1), 9)
    0.391918359
    >>> round(0.1 * 6**0.5 / 25.0**2 * 1000, 9)
    0.391918359
    """
    if points_count < 3:
        raise ValueError("a row needs at least 3 points to be bent")
    chords = np.full(points_count - 1, arc_length / (points_count - 1))
    weights = _angle_weights(chords, chords, _end_count(points_count, end_points))
    across = np.diff(weights / chords, prepend=0.0, append=0.0)
    return MILLIMETRES_PER_METRE * noise_sd / arc_length * float(np.linalg.norm(across))


def spline_curvature(points: npt.ArrayLike, *, noise_sd: float = 0.0) -> float:
    r"""Compute the mean curvature along a smoothing spline through the points.

    .. math:: \bar\kappa = \frac{1}{L} \int \frac{x'' z' - x' z''}{(x'^2 + z'^2)^{3/2}} ds

    This is what the Kappa plugin for Fiji reports of a traced curve (doi:10.1101/852772): a cubic
    B-spline is fitted and its curvature averaged; here the average is by arc length and keeps
    its sign.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        (x, z) from the clamped to the free end, n at least 4 [mm].
    noise_sd : float
        Standard deviation of each coordinate, which sets the smoothing: the spline is as smooth
        as a sum of squared residuals of n σ² allows; 0 interpolates [mm].

    Returns
    -------
    float
        [1/m]; on a circular arc exact up to the third power of the spacing.

    Raises
    ------
    ValueError
        If there are fewer than four points, two neighbours coincide, or a value is not finite.

    Examples
    --------
    >>> s = np.linspace(0.0, np.pi / 2, 20)
    >>> row = np.column_stack([100 * np.sin(s), 100 * np.cos(s) - 100])
    >>> round(spline_curvature(row), 2)
    10.0
    """
    row = _checked(points)
    if len(row) < 4:
        raise ValueError("a cubic spline needs at least 4 points")
    spline, _ = make_splprep(row.T, k=3, s=len(row) * noise_sd**2)
    nodes, node_weights = np.polynomial.legendre.leggauss(8)
    breaks = np.unique(spline.t)
    half = np.diff(breaks)[:, None] / 2.0
    u = (breaks[:-1, None] + half + half * nodes).ravel()
    (x1, z1), (x2, z2) = spline(u, nu=1), spline(u, nu=2)
    speed = np.hypot(x1, z1)
    weights = (half * node_weights).ravel()
    # κ ds = turning/speed³ · speed du
    turned = float(weights @ ((x2 * z1 - x1 * z2) / speed**2))
    return MILLIMETRES_PER_METRE * turned / float(weights @ speed)


def _checked(points: npt.ArrayLike) -> Floats:
    row = np.asarray(points, float)
    if row.ndim != 2 or row.shape[1] != 2 or len(row) < 3:
        raise ValueError(f"a row of points has shape (n, 2) with n at least 3, not {row.shape}")
    if not np.all(np.isfinite(row)):
        raise ValueError("every coordinate must be finite")
    if np.any(np.all(np.diff(row, axis=0) == 0.0, axis=1)):
        raise ValueError("two neighbouring points coincide")
    return row


def _end_count(points_count: int, end_points: int | None) -> int:
    wanted = -(-points_count // 3) if end_points is None else end_points
    return min(points_count, max(3, wanted))


def _arcs(chords: Floats, curvature: float) -> Floats:
    half_angles = np.arcsin(np.clip(abs(curvature) * chords / 2.0, 0.0, 1.0))
    flat = half_angles < 1e-9
    return np.where(flat, chords, chords * half_angles / np.where(flat, 1.0, np.sin(half_angles)))


def _angle_weights(arcs: Floats, chords: Floats, count: int) -> Floats:
    """Weigh the directions of chords so that their sum is the bend angle."""
    ends = np.concatenate([[0.0], np.cumsum(arcs)])
    middles = (ends[:-1] + ends[1:]) / 2.0
    first, last = slice(0, count - 1), slice(len(arcs) - count + 1, None)
    weights = np.zeros(len(arcs))
    weights[last] += _tangent_weights(middles[last] - ends[-1], chords[last])
    weights[first] -= _tangent_weights(middles[first], chords[first])
    return weights


def _tangent_weights(distances: Floats, chords: Floats) -> Floats:
    """Weigh directions at the distances so that their sum is the direction at distance 0."""
    differences = (
        np.eye(len(chords), len(chords) + 1, 1) - np.eye(len(chords), len(chords) + 1)
    ) / (chords[:, None] / chords.mean())
    design = np.column_stack([np.ones_like(distances), distances / chords.mean()])
    weighted = np.linalg.solve(differences @ differences.T, design)
    return np.asarray(np.linalg.solve(design.T @ weighted, weighted.T)[0], float)
