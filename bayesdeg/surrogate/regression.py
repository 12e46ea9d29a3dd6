"""Data of solved runs, and least squares over many terms.

The prior standard deviation of a coefficient falls by a factor with every order in swelling,
material or cause, so there may be more terms than the runs alone would determine. Whole runs are
held out by the block form of the leave-one-out identity.

With q = p/M and t = ΔV/(c L³) the swelling, a curve's logarithms ln(q/t) and y = ln(Δκ s L/t) are
known at every equilibrium of its path, with their derivatives by swelling and groups; likewise for
the bend angle and, with y = ln(ε/(t + b)), for the peak strain and all other measures of strain ε,
b the offset due to strain at rest.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import norm

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.demand import MEASURES, WEIBULL_MODULI
from bayesdeg.actuator.outputs import COLUMNS, OUTPUTS, PEAK, measured_strains
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.surrogate import coordinates as at
from bayesdeg.surrogate.coordinates import LARGEST_SWELLING, Coordinates, coordinates
from bayesdeg.surrogate.scaling import CAUSES, GROUPS, MATERIAL, NAMES, Place
from bayesdeg.surrogate.surrogate import OUTPUTS as SHAPE_OUTPUTS
from bayesdeg.surrogate.surrogate import stretch_offset
from bayesdeg.surrogate.terms import N_CHEBYSHEV, feature_gradients, features

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LIMIT_MARGIN = 0.97  # share of a limit load up to which a held tip is emulated
TO = 0.99  # share of the limit pressure up to which errors at a given load are measured
FLOOR = 0.5  # smallest weight of a reading, relative to the largest in its curve
COUNTED = [0, 1, -1]  # quantities relative to rest: curvature, bend angle, volume
QUANTILES = [2, -3, -2]  # at rest all stretches are equal, so their initial growth is unknown
STRAINED = slice(2, -1)  # those strained at rest too, where mismatch or weight act
_VOLUME = OUTPUTS.index("cavity_volume")
# columns of `Observed.values`, by how smooth they are
ANGLES = (0, 1)  # curvature and bend angle
STRETCH = (2,)  # a quantile over points, wavy
WEIBULL = tuple(len(SHAPE_OUTPUTS) + k for k in range(len(WEIBULL_MODULI)))
EQUIVALENT = tuple(
    len(SHAPE_OUTPUTS) + k for k in range(len(WEIBULL_MODULI), len(MEASURES))
)  # wavy, too
LOADS = (len(SHAPE_OUTPUTS) + len(MEASURES),)  # ln(q/t)
INSIDE = 0.9  # share of held-out errors within the 90 % interval of a normal law
INSIDE_SD = float(norm.ppf(0.5 * (1.0 + INSIDE)))  # half of that interval, in standard deviations


@dataclass(frozen=True)
class Observed:
    """Data of one run: readings of one curve.

    Parameters
    ----------
    coordinates : Coordinates
        Coordinates of each reading.
    along : array, shape (n,)
        Swelling t, or p/M of a held tip [–].
    load : array, shape (n,)
        p/M [–].
    values : array, shape (n, 10)
        y of curvature, bend angle, peak strain and the strains of ``MEASURES``, and ln(q/t).
    gradients : array, shape (n, 10, 13)
        Their derivatives by swelling and groups.
    weights : array, shape (n,)
        Curvature over the curve's largest, at least ``FLOOR``.
    first : array, shape (10,)
        Values at rest, from first slopes; nan if unknown, as for quantiles.
    tight : bool
        Whether the paper is without slack: derivatives by slack are then not used.
    importance : float
        Factor of all weights of the run.
    """

    coordinates: Coordinates
    along: Floats
    load: Floats
    values: Floats
    gradients: Floats
    weights: Floats
    first: Floats
    tight: bool
    importance: float = 1.0

    @property
    def known(self) -> Flags:
        """Mask of derivatives that can be fitted, (13,)."""
        use = np.ones(len(NAMES), dtype=bool)
        use[at.SLACK] = not self.tight
        return use

    def weights_of(self, outputs: Sequence[int]) -> Floats:
        """Return weights of readings of some outputs, (n,): loads count alike."""
        alike = tuple(outputs) == LOADS
        return self.importance * (np.ones_like(self.weights) if alike else self.weights)

    @property
    def growth(self) -> Floats:
        """Growth d ln κ/d ln q, (n,); not finite at a limit point."""
        with np.errstate(divide="ignore"):
            growth: Floats = self._rate(0) / self._rate(LOADS[0])
        return growth

    def _rate(self, output: int) -> Floats:
        """Return the derivative of the logarithm of an output, not over t, by ln t."""
        return 1.0 + self.along * self.gradients[:, output, 0]

    @property
    def before_limit(self) -> Flags:
        """Mask of readings up to `TO` of the largest load, on the rising part."""
        rising = np.arange(len(self.load)) <= np.argmax(self.load)
        return rising & (self._rate(LOADS[0]) > 0.0) & (self.load <= TO * self.load.max())


def compliance_of(samples: Iterable[tuple[Curve, PathSamples]], length: float) -> float:
    """Return c [–]: the median of ΔV/(L³ q) at rest."""
    found = [
        quantities(one, length)[1][0, -1, 0] * Place.of(curve.material).modulus
        for curve, one in samples
        if len(one.loads) > 0
    ]
    return float(np.median(found)) if found else 1.0


def observe(
    curve: Curve, samples: PathSamples, *, length: float, compliance: float
) -> Observed | None:
    """Return the data of a run; None if it has fewer than two equilibria that bend it."""
    if len(samples.loads) < 3:
        return None
    place = Place.of(curve.material)
    q, modulus = samples.loads[1:] / place.modulus, place.modulus
    sizes, slopes = quantities(samples, length)
    changes, rates = sizes[1:].copy(), slopes[1:].copy()
    changes[:, COUNTED] -= sizes[0, COUNTED]
    rates[:, COUNTED, 1:] -= slopes[0, COUNTED, 1:]
    by_groups = np.concatenate(
        [rates[..., :1] * modulus, rates[..., 1:] @ input_jacobian(place)], axis=-1
    )
    # at a fixed p/M a larger second invariant is a larger p/C1: dM/dg = M²
    by_groups[..., at.SECOND_INVARIANT] += rates[..., 0] * (q * modulus**2)[:, None]
    t, by_volume = changes[:, -1] / compliance, by_groups[:, -1] / compliance
    # the last column becomes the load itself
    changes[:, -1], by_groups[:, -1] = q, 0.0
    by_groups[:, -1, 0] = 1.0
    with np.errstate(invalid="ignore", divide="ignore"):
        of_load = by_groups[..., :1] / by_volume[:, None, :1]  # now at a fixed t
        by_groups -= of_load * by_volume[:, None]
        by_groups[..., :1] = of_load
        rest = stretch_offset(np.array([0.0, *place.values]))
        denominators = np.column_stack([t, t, *(t + rest for _ in (PEAK, *MEASURES)), t])
        logs = np.log(changes / denominators)
        by_groups /= changes[..., None]
        by_groups[..., 0] -= 1.0 / denominators
        first = np.log(slopes[0, :, 0] / slopes[0, -1, 0] * compliance)
        first[-1] = np.log(compliance / (slopes[0, -1, 0] * modulus))
    first[QUANTILES] = np.nan
    if rest != 0.0:
        first[STRAINED] = np.nan
    by_groups[:, STRAINED] -= (offset_gradient(place) / denominators[:, 2, None])[:, None]
    keep = (t > 0.0) & (t <= LARGEST_SWELLING) & (changes[:, 0] > 0.0)
    keep &= np.isfinite(logs[:, [0, -1]]).all(axis=1)
    # a large or negative growth at first means that a curve begins with hardly any bending
    with np.errstate(invalid="ignore"):
        keep &= 1.0 + t * by_groups[:, 0, 0] > 0.0
    if np.count_nonzero(keep) < 2:
        return None
    t, changes = t[keep], changes[keep]
    points = coordinates(np.column_stack([t, np.tile(place.values, (len(t), 1))]))
    return Observed(
        points,
        t,
        q[keep],
        logs[keep],
        by_groups[keep],
        np.maximum(changes[:, 0] / changes[:, 0].max(), FLOOR),
        first,
        tight=curve.material.paper_slack == 0.0,
    )


def offset_gradient(place: Place) -> Floats:
    """Return the derivative of the offset due to strain at rest, (13,)."""
    offset, at_rest = np.zeros(len(NAMES)), np.array([0.0, *place.values])
    offset[at.MISMATCH] = np.sign(at_rest[at.MISMATCH])
    gravity = [at.ALONG, at.UP]
    if (weight := np.hypot(*at_rest[gravity])) > 0.0:
        offset[gravity] = at.GRAVITY_STRAIN * at_rest[gravity] / weight
    return offset


def observe_force(curve: Curve, samples: PathSamples, *, length: float) -> Observed | None:
    """Return the data of a run with held tip; None if its only equilibrium is at rest.

    y = ln(ΔF/(M L² q)) for the half model, with ΔF relative to rest, at a load of q = p/M. One
    equilibrium is enough: a stiff part gets there in one step, and the initial and final growth of
    the force are known too.
    """
    if len(samples.loads) < 2:
        return None
    place = Place.of(curve.material)
    q = samples.loads[1:] / place.modulus
    points = coordinates(np.column_stack([q, np.tile(place.values, (len(q), 1))]))
    unit = place.modulus * length**2
    changes = (samples.readings[1:] - samples.readings[0]) / unit
    by_inputs = samples.gradients[1:] / unit
    by_inputs[..., 1:] -= samples.gradients[0, :, 1:] / unit
    keep = changes[:, 0] > 0.0
    if np.isfinite(samples.limit_load):
        keep &= samples.loads[1:] <= LIMIT_MARGIN * samples.limit_load
    if not np.any(keep):
        return None
    parts = (part[keep] for part in vars(points).values())
    q, changes, by_inputs = q[keep], changes[keep], by_inputs[keep]
    logarithmic, modulus = by_inputs / changes[..., None], place.modulus
    by_groups = np.empty((len(q), 1, len(NAMES)))
    by_groups[..., 0] = logarithmic[..., 0] * modulus - 1.0 / q[:, None]
    by_groups[..., 1:] = logarithmic[..., 1:] @ input_jacobian(place)
    # at a fixed p/M a larger second invariant is a larger p/C1, dM/dg = M²; and M is the unit
    by_groups[..., at.SECOND_INVARIANT] += logarithmic[..., 0] * (q * modulus**2)[:, None] - modulus
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.log(samples.gradients[0, :, 0] * place.modulus / unit)
    tight = curve.material.paper_slack == 0.0
    weights = np.maximum(changes[:, 0] / changes.max(), FLOOR)
    values = np.log(changes / q[:, None])
    return Observed(Coordinates(*parts), q, q, values, by_groups, weights, first, tight=tight)


def quantities(samples: PathSamples, length: float) -> tuple[Floats, Floats]:
    """Return κ s L, bend angle, strains and V/L³, (n, 10), with derivatives by ``INPUTS``."""
    angle, arc = samples.readings[:, 0], samples.readings[:, 1]
    by_angle, by_arc = samples.gradients[:, 0], samples.gradients[:, 1]
    kappa = angle / arc * length
    by_kappa = (by_angle * length - kappa[:, None] * by_arc) / arc[:, None]
    peak, strains = samples.readings[:, PEAK] - 1.0, measured_strains(samples.readings)
    by_strains = samples.gradients[:, [PEAK, *COLUMNS]]
    volume = samples.readings[:, _VOLUME] / length**3
    by_volume = samples.gradients[:, [_VOLUME]] / length**3
    slopes = np.concatenate([by_kappa[:, None], by_angle[:, None], by_strains, by_volume], axis=1)
    return np.column_stack([kappa, angle, peak, strains, volume]), slopes


def input_jacobian(place: Place) -> Floats:
    """Return derivatives of the model's inputs, except the load, by the groups.

    By central differences. All inputs are products of powers and exponentials of the groups.
    """
    values = np.array(place.values)
    out = np.empty((len(INPUTS) - 1, len(values)))
    for k, group in enumerate(GROUPS):
        step = 1e-5 * (group.high - group.low)
        less, more = values.copy(), values.copy()
        less[k] -= step
        more[k] += step
        materials = [Place(tuple(float(x) for x in v)).material() for v in (less, more)]
        low, high = (np.array([getattr(m, name) for name in INPUTS[1:]]) for m in materials)
        out[:, k] = (high - low) / (2.0 * step)
    return out


Indices = NDArray[np.int64]

DERIVATIVE_WEIGHT = 0.2  # of a derivative over half of its group's range, relative to a value


@dataclass(frozen=True)
class Prior:
    """Expected decay of coefficients with their order.

    Parameters
    ----------
    swelling, material, cause : float
        Factor per order [–].
    noise : float
        Standard deviation of the residual over that of the first coefficient [–].
    """

    swelling: float = 0.6
    material: float = 0.45
    cause: float = 0.35
    noise: float = 1e-2

    def scales(self, orders: Indices) -> Floats:
        """Return the prior standard deviation of every coefficient over that of the first."""
        scales: Floats = (
            self.swelling ** orders[:, 0]
            * self.material ** orders[:, 1:N_CHEBYSHEV].sum(axis=1)
            * self.cause ** orders[:, N_CHEBYSHEV:].sum(axis=1)
        )
        return scales


@dataclass(frozen=True)
class Equations:
    """Weighted equations of one run: ``matrix @ coefficients = targets``.

    The first ``n_values`` are for values, the others for derivatives.
    """

    matrix: Floats
    targets: Floats
    n_values: int


def half_ranges() -> Floats:
    """Return the ranges of groups over which derivatives count, (12,)."""
    causes = [max(c.high - c.neutral, c.neutral - c.low) for c in CAUSES]
    return np.array([*(0.5 * (g.high - g.low) for g in MATERIAL), *causes])


def rows_of(
    run: Observed,
    orders: Indices,
    *,
    outputs: Sequence[int],
    derivatives: bool = True,
    weight: float = DERIVATIVE_WEIGHT,
) -> Equations:
    """Return the equations of a run for some outputs, of their values and derivatives.

    ``weight`` is that of a derivative by ln t, or over half of its group's range, relative to a
    value.
    """
    place, w = run.coordinates, run.weights_of(outputs)[:, None]
    values = features(orders, place.points)
    matrix, targets = [w * values], [w * run.values[:, outputs]]
    if derivatives:
        slopes, by_groups = feature_gradients(orders, place.points), run.gradients[:, outputs]
        finite = np.all(np.isfinite(by_groups), axis=(0, 1))
        for k in np.flatnonzero(run.known & finite):
            size = weight * w * (run.along[:, None] if k == 0 else half_ranges()[k - 1])
            along = np.einsum("npt,np->nt", slopes, place.jacobian[:, :, k])
            matrix.append(size * along)
            targets.append(size * by_groups[..., k])
        if np.all(np.isfinite(run.first[outputs])):
            start = place.points[:1].copy()
            start[0, 0] = -1.0
            # at rest slack paper has no effect
            start[0, N_CHEBYSHEV + [c.name for c in CAUSES].index("paper_slack")] = not run.tight
            at_rest = FLOOR * run.importance
            matrix.append(at_rest * features(orders, start))
            targets.append(at_rest * run.first[None, outputs])
    return Equations(np.vstack(matrix), np.vstack(targets), len(values))


@dataclass(frozen=True)
class Regression:
    """A regression, with all data for holding out runs.

    Parameters
    ----------
    orders : array, shape (n_terms, 13)
    coefficients : array, shape (n_outputs, n_terms)
    scales : array, shape (n_terms,)
    factor : array
        Cholesky factor of the scaled normal matrix.
    """

    orders: Indices
    coefficients: Floats
    scales: Floats
    factor: Floats

    def without(self, rows: Equations) -> Floats:
        """Return the coefficients of the fit without one run's rows.

        a₋ᵢ = a − N⁻¹ Aᵢᵀ (I − Hᵢ)⁻¹ eᵢ, Hᵢ = Aᵢ N⁻¹ Aᵢᵀ.
        """
        scaled = rows.matrix * self.scales
        lifted = cho_solve((self.factor, True), scaled.T)
        residual = rows.targets - rows.matrix @ self.coefficients.T
        inner = np.eye(len(scaled)) - scaled @ lifted
        change = lifted @ np.linalg.solve(inner, residual)
        without: Floats = self.coefficients - (self.scales[:, None] * change).T
        return without


def fit(rows: Iterable[Equations], orders: Indices, prior: Prior, *, outputs: int) -> Regression:
    """Return the most probable coefficients for the equations of all runs."""
    return fit_scaled(rows, orders, prior.scales(orders), noise=prior.noise, outputs=outputs)


def fit_scaled(
    rows: Iterable[Equations], orders: Indices, scales: Floats, *, noise: float, outputs: int
) -> Regression:
    """Return the most probable coefficients for given prior standard deviations.

    ``scales``, shape (n_terms,), are prior standard deviations, and ``noise`` is that of the
    residual, over that of the first coefficient.
    """
    normal = noise**2 * np.eye(len(orders))
    right = np.zeros((len(orders), outputs))
    for part in rows:
        scaled = part.matrix * scales
        normal += scaled.T @ scaled
        right += scaled.T @ part.targets
    factor, _ = cho_factor(normal, lower=True)
    coefficients = scales[:, None] * cho_solve((factor, True), right)
    return Regression(orders, coefficients.T, scales, factor)
