"""What is read from an equilibrium: bend angle, arc length, cavity volume, stretch.

Every reading comes with its rate along the path, and with its gradient by the nodes' positions,
from which adjoint derivatives follow.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import make_splprep

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.demand import MEASURES, WEIBULL_MODULI
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.problem import MechanicalState

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


@dataclass(frozen=True)
class Stretches:
    """The largest principal stretch at every quadrature point.

    Parameters
    ----------
    value : array, shape (n_elements, n_points)
        λ [–].
    slope : array, shape (n_elements, n_points, 3, 3)
        ∂λ/∂F = n ⊗ N, the principal axes in space and in the undeformed body [–].
    """

    value: Floats
    slope: Floats


def principal_stretch(body: Body, state: MechanicalState) -> Stretches:
    """Return the largest principal stretch and its derivative at every quadrature point."""
    f = _deformation(body, state.displacement)
    value = np.empty(body.weights.shape)
    largest_stretch(f, value)
    return Stretches(value, f)


def _deformation(body: Body, displacement: Floats) -> Floats:
    """Return F at every quadrature point, (n_elements, n_points, 3, 3)."""
    f = np.empty((*body.weights.shape, 3, 3))
    kernels.deformation(displacement, body.elements, body.gradients, f)
    return f


_AT_REST = 1e-7
"""Equivalent strain below which it has no derivative: it goes with the root of the energy."""


def equivalent_stretches(f: Floats, largest: Stretches) -> tuple[Stretches, Stretches]:
    r"""Return the stretches of uniaxial tests that are as demanding, at every quadrature point.

    The first has the same energy in a material whose energy rises with the first invariant,

    .. math:: λ^2 + 2/λ = \bar I_1,

    the second the same difference of the largest and the smallest principal stretch squared,

    .. math:: λ^2 - 1/λ = \bar λ_1^2 - \bar λ_3^2,

    which times :math:`2 W'(\bar I_1)` is the largest Cauchy stress where the thinnest axis is free.
    Bars are of the part without change of volume, :math:`J^{-1/3} F`.

    Parameters
    ----------
    f : array, shape (n_elements, n_points, 3, 3)
        Deformation gradient [–].
    largest : Stretches
        Largest principal stretch.

    Examples
    --------
    >>> stretched = np.diag([4.0, 0.5, 0.5])[None, None]
    >>> axis = np.diag([1.0, 0.0, 0.0])[None, None]
    >>> energy, difference = equivalent_stretches(stretched, Stretches(np.array([[4.0]]), axis))
    >>> energy.value.round(9), difference.value.round(9)
    (array([[4.]]), array([[4.]]))
    """
    volume = np.linalg.det(f)
    by_volume = volume[..., None, None] * np.swapaxes(np.linalg.inv(f), -1, -2)  # ∂J/∂F
    shrunk = volume ** (-2.0 / 3.0)
    whole = np.einsum("...ij,...ij->...", f, f)
    top = largest.value**2
    by_top = 2.0 * largest.value[..., None, None] * largest.slope
    # the other two squares have the sum and the product that are left
    rest, product = whole - top, volume**2 / top
    root = np.sqrt(np.maximum(rest**2 - 4.0 * product, 0.0))
    by_rest = 2.0 * f - by_top
    by_product = (
        2.0 * (volume / top)[..., None, None] * by_volume
        - (product / top)[..., None, None] * by_top
    )
    safe = np.maximum(root, _AT_REST)[..., None, None]
    by_root = (rest[..., None, None] * by_rest - 2.0 * by_product) / safe
    difference, by_difference = top - 0.5 * (rest - root), by_top - 0.5 * (by_rest - by_root)
    found = []
    for value, slope, uniaxial in (
        (whole, 2.0 * f, _stretch_of_invariant),
        (difference, by_difference, _stretch_of_difference),
    ):
        thinned = (value / volume)[..., None, None] * by_volume * (2.0 / 3.0)
        stretch, rate = uniaxial(shrunk * value)
        known = np.where(stretch - 1.0 > _AT_REST, shrunk / rate, 0.0)
        found.append(Stretches(stretch, known[..., None, None] * (slope - thinned)))
    return found[0], found[1]


def _stretch_of_invariant(invariant: Floats) -> tuple[Floats, Floats]:
    """Return λ with λ² + 2/λ = I₁, and dI₁/dλ."""
    least = np.maximum(invariant, 3.0)
    third = np.arccos(np.maximum(-((3.0 / least) ** 1.5), -1.0)) / 3.0
    stretch = np.maximum(2.0 * np.sqrt(least / 3.0) * np.cos(third), 1.0)
    return stretch, np.maximum(2.0 * stretch - 2.0 / stretch**2, _AT_REST)


_NEWTON_STEPS = 8  # from above, where the function is convex: rounding is reached from λ = 8 on


def _stretch_of_difference(difference: Floats) -> tuple[Floats, Floats]:
    """Return λ with λ² − 1/λ = d, and dd/dλ."""
    stretch = 1.0 + np.maximum(difference, 0.0) / 3.0
    for _ in range(_NEWTON_STEPS):
        rate = 2.0 * stretch + 1.0 / stretch**2
        stretch = stretch - (stretch**2 - 1.0 / stretch - difference) / rate
    stretch = np.maximum(stretch, 1.0)
    return stretch, 2.0 * stretch + 1.0 / stretch**2


@njit(cache=True)
def demands(
    f: Floats, largest: Floats, energy: Floats, difference: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite with Ī₁ and λ̄₁² − λ̄₃², which `equivalent_stretches` rise with.

    The two squares but the largest have the sum I₁ − λ₁² and the product J²/λ₁².
    """
    inverse = np.empty((3, 3))
    for e in range(largest.shape[0]):
        for q in range(largest.shape[1]):
            volume = kernels.invert(f[e, q], inverse)
            whole = 0.0
            for i in range(3):
                for j in range(3):
                    whole += f[e, q, i, j] * f[e, q, i, j]
            top = largest[e, q] * largest[e, q]
            rest = whole - top
            root = np.sqrt(max(rest * rest - 4.0 * volume * volume / top, 0.0))
            shrunk = volume ** (-2.0 / 3.0)
            energy[e, q] = shrunk * whole
            difference[e, q] = shrunk * (top - 0.5 * (rest - root))


@njit(cache=True)
def largest_stretch(f: Floats, value: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``value`` with the largest principal stretch and ``f`` with ∂λ/∂F = n ⊗ N.

    Eigenvalues of C = FᵀF by the trigonometric formula, the axis as the longest product of two
    rows of C − λ² I, and λ² once more as the axis's Rayleigh quotient.
    """
    axis, moved = np.empty(3), np.empty(3)
    c, d = np.empty((3, 3)), np.empty((3, 3))
    for e in range(value.shape[0]):
        for q in range(value.shape[1]):
            here = f[e, q]
            for i in range(3):
                for j in range(i, 3):
                    c[i, j] = c[j, i] = (
                        here[0, i] * here[0, j] + here[1, i] * here[1, j] + here[2, i] * here[2, j]
                    )
            _longest_axis(c, d, axis)
            length = 0.0
            for i in range(3):
                moved[i] = here[i, 0] * axis[0] + here[i, 1] * axis[1] + here[i, 2] * axis[2]
                length += moved[i] * moved[i]
            length = np.sqrt(length)
            value[e, q] = length
            for i in range(3):
                for j in range(3):
                    here[i, j] = moved[i] / length * axis[j]


@njit(cache=True)
def _longest_axis(c: Floats, d: Floats, axis: Floats) -> None:  # pragma: no cover - compiled
    """Overwrite ``axis`` with the unit eigenvector of the largest eigenvalue; ``d`` is spare."""
    mean = (c[0, 0] + c[1, 1] + c[2, 2]) / 3.0
    square = 0.0
    for i in range(3):
        for j in range(3):
            d[i, j] = c[i, j] - (mean if i == j else 0.0)
            square += d[i, j] * d[i, j]
    size = np.sqrt(square / 6.0)
    axis[0], axis[1], axis[2] = 1.0, 0.0, 0.0
    if not size > 1e-14 * mean:
        return
    determinant = (
        d[0, 0] * (d[1, 1] * d[2, 2] - d[1, 2] * d[2, 1])
        - d[0, 1] * (d[1, 0] * d[2, 2] - d[1, 2] * d[2, 0])
        + d[0, 2] * (d[1, 0] * d[2, 1] - d[1, 1] * d[2, 0])
    )
    half = min(1.0, max(-1.0, 0.5 * determinant / (size * size * size)))
    top = mean + 2.0 * size * np.cos(np.arccos(half) / 3.0)
    for i in range(3):
        d[i, i] = c[i, i] - top
    longest = 0.0
    for i in range(3):
        k = (i + 1) % 3
        x = d[i, 1] * d[k, 2] - d[i, 2] * d[k, 1]
        y = d[i, 2] * d[k, 0] - d[i, 0] * d[k, 2]
        z = d[i, 0] * d[k, 1] - d[i, 1] * d[k, 0]
        length = np.sqrt(x * x + y * y + z * z)
        if length > longest:
            longest = length
            axis[0], axis[1], axis[2] = x / length, y / length, z / length


def volume_quantile(stretch: Floats, weights: Floats, share: float) -> float:
    """Return the stretch that a share of the volume stays below [–].

    Between the quadrature points, ordered by stretch, the share grows linearly. Unlike the
    largest value, which is singular at re-entrant corners, a quantile converges with the mesh.

    Parameters
    ----------
    stretch, weights : array
        Stretch and volume of every quadrature point.
    share : float
        Between 0 and 1.

    Examples
    --------
    >>> volume_quantile(np.array([1.0, 1.2, 1.1]), np.ones(3), 0.5)
    1.1
    """
    order, left, right, part = quantile_points(stretch, weights, share)
    values = stretch.ravel()[order]
    return float((1.0 - part) * values[left] + part * values[right])


def quantile_points(
    stretch: Floats, weights: Floats, share: float
) -> tuple[NDArray[np.int64], int, int, float]:
    """Return the order by stretch, the two places next to a quantile, and the second's part."""
    order = np.argsort(stretch, axis=None, kind="stable")
    weight = weights.ravel()[order]
    middle = np.cumsum(weight) - 0.5 * weight
    wanted = share * weight.sum()
    right = int(np.clip(np.searchsorted(middle, wanted), 1, len(middle) - 1))
    left = right - 1
    part = float(np.clip((wanted - middle[left]) / (middle[right] - middle[left]), 0.0, 1.0))
    return order, left, right, part


def quantile_weights(stretch: Floats, weights: Floats, share: float) -> tuple[float, Floats]:
    """Return ``volume_quantile`` and its derivative by the stretch of every point.

    The derivative is exact as long as the order of the points by stretch stays.
    """
    order, left, right, part = quantile_points(stretch, weights, share)
    factors = np.zeros(stretch.size)
    factors[order[left]], factors[order[right]] = 1.0 - part, part
    return float(factors @ stretch.ravel()), factors.reshape(stretch.shape)


def weibull_strain(stretch: Floats, weights: Floats, modulus: float) -> tuple[float, Floats]:
    """Return (1/V ∫ ε^m dV)^(1/m), ε = λ − 1, and its derivative by the stretch of every point.

    V times its m-th power is ``weibull_integral``; as a strain it does not vanish for large m.
    """
    strain = np.maximum(stretch - 1.0, 0.0)
    largest = float(strain.max())
    if largest < 1e-12:
        return 0.0, np.zeros_like(stretch)
    shares = weights / weights.sum()
    # relative to the largest, lest high powers of small strains vanish
    mean = float(np.sum(shares * (strain / largest) ** modulus))
    value = largest * mean ** (1.0 / modulus)
    return value, shares * (strain / value) ** (modulus - 1.0)


def weibull_integral(stretch: Floats, weights: Floats, modulus: float) -> float:
    """Return ∫ ε^m dV, ε = λ − 1 the largest principal strain [mm³].

    With strengths that follow Weibull's law, the probability that a volume survives is
    exp(−∫ (ε/ε₀)^m dV/V₀); doi:10.1115/1.4010337. It converges with the mesh as long as m times
    the order of the strain's singularity at sharp corners stays below 2.

    Parameters
    ----------
    stretch, weights : array
        Largest principal stretch and volume of every quadrature point [–, mm³].
    modulus : float
        m [–].

    Examples
    --------
    >>> round(weibull_integral(np.array([1.5, 1.0]), np.array([2.0, 3.0]), 2.0), 12)
    0.5
    """
    return float(np.sum(weights * np.maximum(stretch - 1.0, 0.0) ** modulus))


@dataclass(frozen=True)
class StrainReading:
    """One number that is read of the field of stretch, and how it changes with the deformation.

    Parameters
    ----------
    value : float
        [–].
    elements : array, shape (n,)
        Those that it depends on.
    push : array, shape (n, n_points, 3, 3)
        Its derivative by the deformation gradient at their quadrature points [–].
    """

    value: float
    elements: NDArray[np.int64]
    push: Floats

    def rate(self, change: Floats) -> float:
        """Return its change with that of the deformation gradient, (n_elements, n_points, 3, 3)."""
        return float(np.vdot(self.push, change[self.elements]))

    def gradient(self, body: Body) -> Floats:
        """Return its derivative by the nodes' positions, (n_nodes, 3) [1/mm]."""
        gradient = np.zeros_like(body.nodes)
        kernels.add_pull(self.push, self.elements, body.elements, body.gradients, gradient)
        return gradient


PEAK_SHARE = 0.99  # share of the volume that is stretched less than the peak stretch
OUTPUTS = ("bend_angle", "arc_length", "cavity_volume", "peak_stretch", *MEASURES)
PEAK = OUTPUTS.index("peak_stretch")
COLUMNS = [OUTPUTS.index(name) for name in MEASURES]
_UNDEFORMED = np.array([float("stretch" in name) for name in MEASURES])
"""What is taken off a reading for a strain: stretches are read, and strains."""


def measured_strains(readings: Floats) -> Floats:
    """Return strains by ``MEASURES`` from readings (…, n_outputs) of equilibria, (…, 6) [–]."""
    strains: Floats = readings[..., COLUMNS] - _UNDEFORMED
    return strains


@dataclass(frozen=True)
class Reading:
    """What is read of one equilibrium at moulded size.

    Parameters
    ----------
    values : array, shape (n_outputs,)
        In the order of ``OUTPUTS``: rotation of the free end face towards the paper [rad];
        deformed length of the bottom line [mm]; volume of the cavity of the half model [mm³];
        largest principal stretch that 99 % of the volume stays below [–]; for each modulus m the
        strain (1/V ∫ ε^m dV)^(1/m), ε the largest principal strain λ − 1 [–]; and what 99 % of the
        volume stays below of the stretches of `equivalent_stretches` [–].
    rates : array, shape (n_outputs,)
        Their derivatives by the load, along the path.
    """

    values: Floats
    rates: Floats

    @property
    def bend_angle(self) -> float:
        """Rotation of the free end face towards the paper [rad]."""
        return float(self.values[0])

    @property
    def arc_length(self) -> float:
        """Deformed length of the bottom line [mm]."""
        return float(self.values[1])

    @property
    def curvature(self) -> float:
        """Bend angle over arc length [1/mm]."""
        return self.bend_angle / self.arc_length

    @property
    def peak_stretch(self) -> float:
        """Largest principal stretch that 99 % of the volume stays below [–]."""
        return float(self.values[3])


def read_state(
    mesh: ActuatorMesh,
    state: MechanicalState,
    *,
    rate: MechanicalState | None = None,
    previous_angle: float = 0.0,
) -> Reading:
    """Return what is read of an equilibrium.

    The bend angle is that of the rotation which fits the free end face best in the bending plane:
    θ = atan2(∫ Z' x dA, ∫ Z' z dA), with Z' the height over the face's centroid as moulded and
    (x, z) the deformed position. It is exact for a rigid rotation.

    Parameters
    ----------
    mesh : ActuatorMesh
        The half model.
    state : MechanicalState
        An equilibrium.
    rate : MechanicalState, optional
        The path's tangent there; without it the rates are zero.
    previous_angle : float
        Angle at the load before [rad]; the angle is unwrapped to the branch next to it.
    """
    lines = _line_readings(mesh, mesh.body.nodes + state.displacement, previous_angle)
    strains = _strain_readings(mesh.body, state)
    values = np.array([*(value for value, _ in lines), *(strain.value for strain in strains)])
    if rate is None:
        return Reading(values, np.zeros_like(values))
    change = _deformation(mesh.body, rate.displacement) - np.eye(3)
    rates = [float(np.vdot(gradient, rate.displacement)) for _, gradient in lines]
    rates += [strain.rate(change) for strain in strains]
    return Reading(values, np.array(rates))


def read_with_gradients(
    mesh: ActuatorMesh, state: MechanicalState, *, previous_angle: float = 0.0
) -> tuple[Floats, Floats]:
    """Return all readings, (n_outputs,), and their derivatives by the nodes' positions.

    The derivatives have the shape (n_outputs, n_nodes, 3).
    """
    lines = _line_readings(mesh, mesh.body.nodes + state.displacement, previous_angle)
    strains = _strain_readings(mesh.body, state)
    values = np.array([*(value for value, _ in lines), *(strain.value for strain in strains)])
    gradients = [gradient for _, gradient in lines]
    return values, np.stack([*gradients, *(strain.gradient(mesh.body) for strain in strains)])


def _line_readings(
    mesh: ActuatorMesh, placed: Floats, previous_angle: float
) -> list[tuple[float, Floats]]:
    """Angle, arc length and volume, with their gradients by the nodes' positions."""
    return [
        _end_rotation(mesh, placed, previous_angle),
        _arc_length(mesh, placed),
        _cavity_volume(mesh, placed),
    ]


def _strain_readings(body: Body, state: MechanicalState) -> list[StrainReading]:
    """Measures of stretch, in the order of ``OUTPUTS``, with their derivatives."""
    f = _deformation(body, state.displacement)
    largest = principal_stretch(body, state)
    energy, difference = np.empty(largest.value.shape), np.empty(largest.value.shape)
    demands(f, largest.value, energy, difference)
    every = np.arange(len(body.elements))
    whole = [weibull_strain(largest.value, body.weights, m) for m in WEIBULL_MODULI]
    return [
        _quantile(body, f, largest, field=largest.value, stretches=lambda _, here: here),
        *(
            StrainReading(value, every, factors[..., None, None] * largest.slope)
            for value, factors in whole
        ),
        _quantile(
            body, f, largest, field=energy, stretches=lambda f, s: equivalent_stretches(f, s)[0]
        ),
        _quantile(
            body, f, largest, field=difference, stretches=lambda f, s: equivalent_stretches(f, s)[1]
        ),
    ]


def _equivalent(which: int, f: Floats, largest: Stretches) -> Stretches:
    return equivalent_stretches(f, largest)[which]


def _quantile(
    body: Body,
    f: Floats,
    largest: Stretches,
    *,
    field: Floats,
    stretches: Callable[[Floats, Stretches], Stretches],
) -> StrainReading:
    """Return what 99 % of the volume stays below, of stretches that rise with ``field``.

    Two points tell all, so only theirs are evaluated.
    """
    order, left, right, part = quantile_points(field, body.weights, PEAK_SHARE)
    elements, points = np.unravel_index(order[[left, right]], field.shape)
    shares = np.array([1.0 - part, part])
    here = Stretches(largest.value[elements, points], largest.slope[elements, points])
    found = stretches(f[elements, points], here)
    push = np.zeros((2, *largest.slope.shape[1:]))
    push[(0, 1), points] = shares[:, None, None] * found.slope
    return StrainReading(float(shares @ found.value), elements, push)


def traced_curvature(mesh: ActuatorMesh, state: MechanicalState) -> float:
    """Return the mean curvature of a spline through the bottom line's nodes [1/mm].

    This is how an image tool reads a traced line, see ``measure.curvature.spline_curvature``; the
    contract's curvature is the bend angle over the arc length.
    """
    line = (mesh.body.nodes + state.displacement)[mesh.bottom_line]
    return spline_curvature(line[:, (0, 2)]) * 1e-3


def _end_rotation(mesh: ActuatorMesh, placed: Floats, previous: float) -> tuple[float, Floats]:
    shapes, _, _, weights = kernels.face_shapes(mesh.body.element.order)
    grid = mesh.body.nodes[mesh.free_end]
    area = np.ptp(grid[:, :, 1], axis=1) * np.ptp(grid[:, :, 2], axis=1)
    at = area[:, None] * weights
    height = grid[:, :, 2] @ shapes.T
    arm = (at * (height - np.sum(at * height) / np.sum(at))) @ shapes
    moments = np.zeros(len(placed))
    np.add.at(moments, mesh.free_end, arm)
    sine, cosine = moments @ placed[:, 0], moments @ placed[:, 2]
    gradient = np.zeros_like(placed)
    square = sine * sine + cosine * cosine
    gradient[:, 0], gradient[:, 2] = cosine / square * moments, -sine / square * moments
    angle = float(np.arctan2(sine, cosine))
    return angle + 2.0 * np.pi * round((previous - angle) / (2.0 * np.pi)), gradient


def _arc_length(mesh: ActuatorMesh, placed: Floats) -> tuple[float, Floats]:
    order, line = mesh.body.element.order, mesh.bottom_line
    points, weights = kernels.gauss(order)
    _, derivatives = kernels.line_shapes(order, points)
    nodes = np.stack([line[i : len(line) - order + i : order] for i in range(order + 1)], axis=1)
    tangent = np.einsum("qa,eai->eqi", derivatives, placed[nodes])
    speed = np.linalg.norm(tangent, axis=2)
    gradient = np.zeros_like(placed)
    pull = np.einsum("q,qa,eqi->eai", weights, derivatives, tangent / speed[..., None])
    np.add.at(gradient, nodes, pull)
    return float(np.sum(speed @ weights)), gradient


def _cavity_volume(mesh: ActuatorMesh, placed: Floats) -> tuple[float, Floats]:
    body, gradient = mesh.body, np.zeros_like(placed)
    volume = kernels.cavity_volume(
        placed,
        body.cavity,
        kernels.volume_form(body.element.order),
        1.0,
        gradient,
        np.empty((0, 0, 0), dtype=np.int32),
        np.empty(0),
    )
    return volume, gradient
