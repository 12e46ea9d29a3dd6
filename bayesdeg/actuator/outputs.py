"""Readings from an equilibrium: bend angle, arc length, cavity volume, stretch.

Every reading comes with its rate along the path, and with its gradient with respect to nodal
positions, used for adjoint derivatives.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit
from numpy.typing import NDArray

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.demand import MEASURES, WEIBULL_MODULI
from bayesdeg.actuator.mesh import ActuatorMesh
from bayesdeg.actuator.problem import MechanicalState

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Stretches:
    """The largest principal stretch at quadrature points, for all elements or selected points.

    Parameters
    ----------
    value : array, shape (n_elements, n_points) or (n,)
        λ [–].
    slope : array, shape (n_elements, n_points, 3, 3) or (n, 3, 3)
        ∂λ/∂F = n ⊗ N, the principal axes in space and in the undeformed body [–].
    """

    value: Floats
    slope: Floats


def deformation_gradients(body: Body, displacement: Floats) -> Floats:
    """Return F at every quadrature point, (n_elements, n_points, 3, 3)."""
    f = np.empty((*body.weights.shape, 3, 3))
    kernels.deformation(displacement, body.elements, body.gradients, f)
    return f


_AT_REST = 1e-7
"""Equivalent strain below which it has no derivative: it is proportional to the root of energy."""


def equivalent_stretches(f: Floats, largest: Stretches) -> tuple[Stretches, Stretches]:
    r"""Return the equally demanding uniaxial stretches at every quadrature point.

    The first has the same energy in a material whose energy rises with the first invariant,

    .. math:: λ^2 + 2/λ = \bar I_1,

    the second the same difference of the largest and the smallest principal stretch squared,

    .. math:: λ^2 - 1/λ = \bar λ_1^2 - \bar λ_3^2,

    which times :math:`2 W'(\bar I_1)` is the largest Cauchy stress where the thinnest axis is free.
    Bars denote the isochoric part, :math:`J^{-1/3} F`.

    Parameters
    ----------
    f : array, shape (n_elements, n_points, 3, 3) or (n, 3, 3)
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
    # the other two squares follow from the remaining sum and product
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


_NEWTON_STEPS = 8  # from above, where the function is convex: converges to rounding from λ = 8


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
    f: Floats, value: Floats, energy: Floats, difference: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``value`` with the largest principal stretch and ``f`` with ∂λ/∂F = n ⊗ N.

    Also overwritten are the invariants of `equivalent_stretches`, Ī₁ and λ̄₁² − λ̄₃²; the two
    squares but the largest have the sum I₁ − λ₁² and the product J²/λ₁². Eigenvalues of C = FᵀF are
    found by the trigonometric formula, the axis as the longest product of two rows of C − λ² I, and
    λ² once more as the axis's Rayleigh quotient.
    """
    spare = np.empty((3, 3, 3))
    for e in range(value.shape[0]):
        for q in range(value.shape[1]):
            volume = kernels.invert(f[e, q], spare[0])
            whole = 0.0
            for i in range(3):
                for j in range(3):
                    whole += f[e, q, i, j] * f[e, q, i, j]
            value[e, q] = _stretched(f[e, q], spare)
            top = value[e, q] * value[e, q]
            rest = whole - top
            root = np.sqrt(max(rest * rest - 4.0 * volume * volume / top, 0.0))
            shrunk = volume ** (-2.0 / 3.0)
            energy[e, q] = shrunk * whole
            difference[e, q] = shrunk * (top - 0.5 * (rest - root))


@njit(cache=True)
def _stretched(f: Floats, spare: Floats) -> float:  # pragma: no cover - compiled
    """Return the largest stretch of F and overwrite F with its slope."""
    c, axis, moved = spare[0], spare[2, 0], spare[2, 1]
    for i in range(3):
        for j in range(i, 3):
            c[i, j] = c[j, i] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
    _longest_axis(c, spare[1], axis)
    length = 0.0
    for i in range(3):
        moved[i] = f[i, 0] * axis[0] + f[i, 1] * axis[1] + f[i, 2] * axis[2]
        length += moved[i] * moved[i]
    length = np.sqrt(length)
    for i in range(3):
        for j in range(3):
            f[i, j] = moved[i] / length * axis[j]
    return float(length)


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
    """Return the stretch below which a share of the volume stays [–].

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
    places, part = quantile_points(stretch, weights, share)
    left, right = stretch.ravel()[places]
    return float((1.0 - part) * left + part * right)


_SPARE = 2.0  # factor of points sorted over those beyond a quantile for equal volumes


def quantile_points(
    stretch: Floats, weights: Floats, share: float
) -> tuple[NDArray[np.int64], float]:
    """Return the indices of the two points next to a quantile, and the second's weight.

    Only the most stretched points are sorted, as many as may contain the quantile.
    """
    values, volumes = stretch.ravel(), weights.ravel()
    wanted, count = share * float(volumes.sum()), len(values)
    ordered = min(count, 2 + int(_SPARE * (1.0 - share) * count))
    while True:
        least = np.partition(values, count - ordered)[count - ordered]
        top = np.flatnonzero(~(values < least))
        top = top[np.argsort(values[top], kind="stable")]
        below = float(volumes[values < least].sum())
        middle = below + np.cumsum(volumes[top]) - 0.5 * volumes[top]
        if middle[0] <= wanted or ordered == count:
            break
        ordered = min(count, 2 * ordered)
    right = int(np.clip(np.searchsorted(middle, wanted), 1, len(middle) - 1))
    part = (wanted - middle[right - 1]) / (middle[right] - middle[right - 1])
    return top[[right - 1, right]], float(np.clip(part, 0.0, 1.0))


WINDOW = 2.0  # largest ratio of volumes beyond the quantile and a point of its derivative
_FEWEST = 20  # points: a parabola through fewer follows each of them
_ALIKE = 1e-9  # stretches that differ less are of a body at rest


def window_points(
    stretch: Floats, weights: Floats, share: float
) -> tuple[NDArray[np.int64], Floats] | None:
    r"""Return the points that give a smooth derivative of a quantile, and their weights.

    The derivative of the quantile q of a smooth field λ is the mean derivative of the field where
    it has that value, :math:`\partial q = E[\partial \lambda \mid \lambda = q]`. From two
    quadrature points it jumps when others become next to the quantile. So a parabola is fitted by
    least squares to the derivatives of nearby points; its value at the quantile is a sum over them,

    .. math:: \partial q \approx \sum_i c_i \, \partial \lambda_i, \quad
        c = e_1^T (X^T W X)^{-1} X^T W, \quad x_i = (1, u_i, u_i^2), \quad
        u_i = \ln \frac{v_i}{1 - s} / \ln 2, \quad w_i = V_i (1 - u_i^2), \ |u_i| < 1,

    with :math:`v_i` the share of the volume beyond a point, :math:`V_i` its own volume and s the
    quantile's share: those beyond which there is between half and twice as much as beyond q.

    Parameters
    ----------
    stretch, weights : array
        Stretch and volume of every quadrature point.
    share : float
        Of the volume that stays below.

    Returns
    -------
    places, parts : arrays, shape (n,)
        Empty for fewer than twenty points, and at rest, where all are equal.

    Examples
    --------
    >>> stretch = np.linspace(1.0, 2.0, 1000)
    >>> places, parts = window_points(stretch, np.ones(1000), 0.9)
    >>> len(places), round(float(parts.sum()), 12), round(float(parts @ stretch[places]), 3)
    (150, 1.0, 1.901)
    """
    values, volumes = stretch.ravel(), weights.ravel()
    widest = 1.0 - min(1.0, WINDOW * (1.0 - share))
    least = values[quantile_points(values, volumes, widest)[0][0]]
    top = np.flatnonzero(values >= least)
    top = top[np.argsort(-values[top], kind="stable")]
    beyond = (np.cumsum(volumes[top]) - 0.5 * volumes[top]) / float(volumes.sum())
    far = np.log(beyond / (1.0 - share)) / np.log(WINDOW)
    inside = np.abs(far) < 1.0
    top, far = top[inside], far[inside]
    if len(top) < _FEWEST or not values[top[0]] - values[top[-1]] > _ALIKE:
        return None
    weighted = volumes[top] * (1.0 - far**2)
    powers = np.stack([np.ones_like(far), far, far**2])
    parts: Floats = np.linalg.solve((powers * weighted) @ powers.T, powers * weighted)[0]
    return top, parts


@dataclass(frozen=True)
class RelativeStrains:
    """Strains ε = λ − 1 over the largest, for Weibull's strain of any modulus.

    Parameters
    ----------
    logarithm : array, shape (n_elements, n_points)
        ln of the strain over the largest, −∞ where nothing is strained [–].
    largest : float
        [–].
    shares : array, shape (n_elements, n_points)
        Of the volume [–].
    """

    logarithm: Floats
    largest: float
    shares: Floats

    @classmethod
    def of(cls, stretch: Floats, weights: Floats) -> "RelativeStrains":
        """Return relative strains from stretches and volumes of quadrature points."""
        strain = np.maximum(stretch - 1.0, 0.0)
        largest = float(strain.max())
        if largest < _SMALLEST_STRAIN:
            largest, strain = 0.0, np.zeros_like(strain)
        with np.errstate(divide="ignore"):
            logarithm = np.log(strain / (largest or 1.0))
        return cls(logarithm, largest, weights / weights.sum())

    def weibull(self, modulus: float) -> float:
        """Return (1/V ∫ ε^m dV)^(1/m) [–]."""
        # relative to the largest, so that high powers of small strains do not vanish
        mean = float(np.sum(self.shares * np.exp(modulus * self.logarithm)))
        return float(self.largest * mean ** (1.0 / modulus))

    def slope(self, modulus: float, value: float) -> Floats:
        """Return the derivative of Weibull's strain by the stretch of every point."""
        if value == 0.0:
            return np.zeros_like(self.shares)
        over_value = self.logarithm + np.log(self.largest / value)
        slope: Floats = self.shares * np.exp((modulus - 1.0) * over_value)
        return slope


_SMALLEST_STRAIN = 1e-12  # rounding of a stretch at rest


def weibull_strain(stretch: Floats, weights: Floats, modulus: float) -> tuple[float, Floats]:
    """Return (1/V ∫ ε^m dV)^(1/m), ε = λ − 1, and its derivative by the stretch of every point.

    With strengths that follow Weibull's law, the probability that a volume survives is
    exp(−∫ (ε/ε₀)^m dV/V₀); doi:10.1115/1.4010337. It converges with the mesh as long as m times
    the order of the strain's singularity at sharp corners stays below 2.
    """
    strains = RelativeStrains.of(stretch, weights)
    value = strains.weibull(modulus)
    return value, strains.slope(modulus, value)


@dataclass(frozen=True)
class StrainReading:
    """One reading of the stretch field, with its derivative by the deformation.

    Parameters
    ----------
    value : float
        [–].
    elements : array, shape (n,)
        Elements on which it depends.
    push : array, shape (n, n_points, 3, 3)
        Its derivative by the deformation gradient at their quadrature points [–].
    """

    value: float
    elements: NDArray[np.int64]
    push: Floats

    def rate(self, change: Floats) -> float:
        """Return its rate for a rate of the deformation gradient, (n_elements, n_points, 3, 3)."""
        return float(np.vdot(self.push, change[self.elements]))

    def gradient(self, body: Body) -> Floats:
        """Return its derivative with respect to nodal positions, (n_nodes, 3) [1/mm]."""
        gradient = np.zeros_like(body.nodes)
        kernels.add_pull(self.push, self.elements, body.elements, body.gradients, gradient)
        return gradient


PEAK_SHARE = 0.99  # share of the volume stretched less than the peak stretch
OUTPUTS = ("bend_angle", "arc_length", "cavity_volume", "peak_stretch", *MEASURES)
PEAK = OUTPUTS.index("peak_stretch")
COLUMNS = [OUTPUTS.index(name) for name in MEASURES]
_UNDEFORMED = np.array([float("stretch" in name) for name in MEASURES])
"""Offset from reading to strain: some readings are stretches, others strains."""


def measured_strains(readings: Floats) -> Floats:
    """Return strains by ``MEASURES`` from readings (…, n_outputs) of equilibria, (…, 6) [–]."""
    strains: Floats = readings[..., COLUMNS] - _UNDEFORMED
    return strains


@dataclass(frozen=True)
class Reading:
    """Readings of one equilibrium at moulded size.

    Parameters
    ----------
    values : array, shape (n_outputs,)
        In the order of ``OUTPUTS``: rotation of the free end face towards the paper [rad]; deformed
        length of the bottom line [mm]; volume of the cavity of the half model [mm³]; 99 % quantile
        over the volume of the largest principal stretch [–]; for each modulus m the strain (1/V ∫
        ε^m dV)^(1/m), ε the largest principal strain λ − 1 [–]; and the 99 % quantiles of the
        stretches of `equivalent_stretches` [–].
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
        """99 % quantile over the volume of the largest principal stretch [–]."""
        return float(self.values[3])


def read_state(
    mesh: ActuatorMesh,
    state: MechanicalState,
    *,
    rate: MechanicalState | None = None,
    previous_angle: float = 0.0,
) -> Reading:
    """Return the readings of an equilibrium.

    The bend angle is that of the best-fit rotation of the free end face in the bending plane:
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
    angle_to_volume = [value for value, _ in lines]
    if rate is None:
        fields = StrainFields.of(mesh.body, state)
        peak, energy, difference = (reading.value for reading in fields.quantiles())
        weakest = [fields.relative.weibull(m) for m in WEIBULL_MODULI]
        values = np.array([*angle_to_volume, peak, *weakest, energy, difference])
        return Reading(values, np.zeros_like(values))
    strains = _strain_readings(mesh.body, state)
    values = np.array([*angle_to_volume, *(strain.value for strain in strains)])
    change = deformation_gradients(mesh.body, rate.displacement) - np.eye(3)
    rates = [float(np.vdot(gradient, rate.displacement)) for _, gradient in lines]
    rates += [strain.rate(change) for strain in strains]
    return Reading(values, np.array(rates))


def read_with_gradients(
    mesh: ActuatorMesh,
    state: MechanicalState,
    *,
    previous_angle: float = 0.0,
    is_smooth: bool = False,
) -> tuple[Floats, Floats]:
    """Return all readings, (n_outputs,), and their derivatives by nodal positions.

    The derivatives have the shape (n_outputs, n_nodes, 3). Those of 99 % quantiles are either
    exact, with jumps along a path, or smooth, by `window_points`.
    """
    lines = _line_readings(mesh, mesh.body.nodes + state.displacement, previous_angle)
    strains = _strain_readings(mesh.body, state, is_smooth=is_smooth)
    values = np.array([*(value for value, _ in lines), *(strain.value for strain in strains)])
    gradients = [gradient for _, gradient in lines]
    return values, np.stack([*gradients, *(strain.gradient(mesh.body) for strain in strains)])


def _line_readings(
    mesh: ActuatorMesh, placed: Floats, previous_angle: float
) -> list[tuple[float, Floats]]:
    """Return angle, arc length and volume, with their gradients by nodal positions."""
    body, line = mesh.body, mesh.bottom_line
    order = body.element.order
    points, weights = kernels.gauss(order)
    _, derivatives = kernels.line_shapes(order, points)
    nodes = np.stack([line[i : len(line) - order + i : order] for i in range(order + 1)], axis=1)
    tangent = np.einsum("qa,eai->eqi", derivatives, placed[nodes])
    speed = np.linalg.norm(tangent, axis=2)
    along, swelling = np.zeros_like(placed), np.zeros_like(placed)
    pull = np.einsum("q,qa,eqi->eai", weights, derivatives, tangent / speed[..., None])
    np.add.at(along, nodes, pull)
    volume = kernels.cavity_volume(
        placed,
        body.cavity,
        kernels.volume_form(order, triangle=body.element.triangular),
        1.0,
        swelling,
        np.empty((0, 0, 0), dtype=np.int32),
        np.empty(0),
    )
    return [
        face_rotation(body, mesh.free_end, placed, previous_angle),
        (float(np.sum(speed @ weights)), along),
        (mesh.share * volume, mesh.share * swelling),
    ]


def _strain_readings(
    body: Body, state: MechanicalState, *, is_smooth: bool = False
) -> list[StrainReading]:
    """Return measures of stretch, in the order of ``OUTPUTS``, with derivatives."""
    fields = StrainFields.of(body, state)
    every = np.arange(len(body.elements))
    peak, energy, difference = fields.quantiles(is_smooth=is_smooth)
    weakest = []
    for modulus in WEIBULL_MODULI:
        value = fields.relative.weibull(modulus)
        slope = fields.relative.slope(modulus, value)[..., None, None] * fields.largest.slope
        weakest.append(StrainReading(value, every, slope))
    return [peak, *weakest, energy, difference]


@dataclass(frozen=True)
class StrainFields:
    """Fields behind the measures of stretch, at every quadrature point.

    Parameters
    ----------
    body : Body
        Undeformed.
    displacement : array, shape (n_nodes, 3)
        [mm].
    largest : Stretches
        Largest principal stretch.
    energy, difference : arrays, shape (n_elements, n_points)
        Ī₁ and λ̄₁² − λ̄₃² [–].
    relative : RelativeStrains
        Of the largest principal stretch.
    """

    body: Body
    displacement: Floats
    largest: Stretches
    energy: Floats
    difference: Floats
    relative: RelativeStrains

    @classmethod
    def of(cls, body: Body, state: MechanicalState) -> "StrainFields":
        """Return the fields of a state."""
        f = deformation_gradients(body, state.displacement)
        value, energy, difference = (np.empty(body.weights.shape) for _ in range(3))
        demands(f, value, energy, difference)
        relative = RelativeStrains.of(value, body.weights)
        return cls(body, state.displacement, Stretches(value, f), energy, difference, relative)

    def quantiles(self, *, is_smooth: bool = False) -> list[StrainReading]:
        """Return the 99 % quantiles of λ and of both equivalent stretches."""
        found = []
        for field, stretches in (
            (self.largest.value, lambda _, here: here),
            (self.energy, lambda f, here: equivalent_stretches(f, here)[0]),
            (self.difference, lambda f, here: equivalent_stretches(f, here)[1]),
        ):
            places, part = quantile_points(field, self.body.weights, PEAK_SHARE)
            exact = self._sum(places, np.array([1.0 - part, part]), stretches)
            near = window_points(field, self.body.weights, PEAK_SHARE) if is_smooth else None
            smooth = exact if near is None else self._sum(*near, stretches)
            found.append(replace(smooth, value=exact.value))
        return found

    def _sum(
        self,
        places: NDArray[np.int64],
        parts: Floats,
        stretches: Callable[[Floats, Stretches], Stretches],
    ) -> StrainReading:
        """Return a weighted sum over selected quadrature points."""
        body, largest = self.body, self.largest
        elements, points = np.unravel_index(places, largest.value.shape)
        each = np.arange(len(places))
        f = np.empty((len(places), *largest.slope.shape[1:]))
        kernels.deformation(self.displacement, body.elements[elements], body.gradients[elements], f)
        here = Stretches(largest.value[elements, points], largest.slope[elements, points])
        found = stretches(f[each, points], here)
        push = np.zeros_like(f)
        push[each, points] = parts[:, None, None] * found.slope
        return StrainReading(float(parts @ found.value), elements, push)


def face_rotation(
    body: Body, faces: NDArray[np.int64], placed: Floats, previous: float
) -> tuple[float, Floats]:
    """Return the rotation angle of an end face [rad] and its gradient, (n_nodes, 3) [rad/mm].

    The equation is that of `read_state`.

    Parameters
    ----------
    body : Body
        Undeformed.
    faces : array, shape (n_faces, (order + 1)²)
        Nodes of the face as grids over y and z.
    placed : array, shape (n_nodes, 3)
        Positions of all nodes [mm].
    previous : float
        Angle that selects the branch [rad].
    """
    element = body.element
    shapes, first, second, weights = kernels.face_shapes(element.order, triangle=element.triangular)
    grid = body.nodes[faces]
    normal = np.cross(*(np.einsum("qa,fai->fqi", along, grid) for along in (first, second)))
    at = np.abs(normal[..., 0]) * weights
    height = grid[:, :, 2] @ shapes.T
    arm = (at * (height - np.sum(at * height) / np.sum(at))) @ shapes
    moments = np.zeros(len(placed))
    np.add.at(moments, faces, arm)
    sine, cosine = moments @ placed[:, 0], moments @ placed[:, 2]
    gradient = np.zeros_like(placed)
    square = sine * sine + cosine * cosine
    gradient[:, 0], gradient[:, 2] = cosine / square * moments, -sine / square * moments
    angle = float(np.arctan2(sine, cosine))
    return angle + 2.0 * np.pi * round((previous - angle) / (2.0 * np.pi)), gradient
