"""Data of solved runs, and least squares over many terms.

The prior standard deviation of a coefficient falls by a factor with every order in load, material
or cause, so there may be more terms than the runs alone would determine. Whole runs are held out by
the block form of the leave-one-out identity.

With q = p/M, a curve's logarithm y = ln(Δκ s L/q) is known at every equilibrium of its
path, with its derivatives by load and groups; likewise for the bend angle and, with
y = ln(ε/(q + q₀)), for the peak strain and all other measures of strain ε, q₀ the offset due to
strain at rest; and, with y = ln(ΔV/(L³ q)), for the volume of the half model's cavity.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import norm

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.demand import MEASURES, WEIBULL_MODULI
from bayesdeg.actuator.outputs import COLUMNS, OUTPUTS, PEAK, measured_strains
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.surrogate import coordinates as at
from bayesdeg.surrogate.coordinates import Coordinates, coordinates
from bayesdeg.surrogate.scaling import CAUSES, GROUPS, MATERIAL, NAMES, Place, TrainingRange
from bayesdeg.surrogate.surrogate import OUTPUTS as SHAPE_OUTPUTS
from bayesdeg.surrogate.surrogate import stretch_offset
from bayesdeg.surrogate.terms import N_CHEBYSHEV, feature_gradients, features

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LIMIT_MARGIN = 0.97  # share of a limit load up to which a curve is emulated
STEEPEST = 2.75  # where d ln κ / d ln p is larger a pneunet is about to balloon
FLOOR = 0.15  # smallest weight of a reading, relative to the curve's largest
COUNTED = [0, 1, -1]  # outputs relative to rest: curvature, bend angle, volume
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
VOLUME = (len(SHAPE_OUTPUTS) + len(MEASURES),)
INSIDE = 0.9  # share of held-out errors within the 90 % interval of a normal law
INSIDE_SD = float(norm.ppf(0.5 * (1.0 + INSIDE)))  # half of that interval, in standard deviations


@dataclass(frozen=True)
class Observed:
    """Data of one run: readings of one curve.

    Parameters
    ----------
    coordinates : Coordinates
        Coordinates of each reading.
    load : array, shape (n,)
        p/M [–].
    values : array, shape (n, 10)
        y of curvature, bend angle, peak strain, the strains of ``MEASURES`` and the volume.
    gradients : array, shape (n, 10, 13)
        Their derivatives by load and groups; nan between the equilibria.
    weights : array, shape (n,)
        Curvature over the curve's largest, at least ``FLOOR``.
    first : array, shape (10,)
        y at zero load, from the first slope; nan if unknown, as for quantiles.
    tight : bool
        Whether the paper is without slack: derivatives by slack are then not used.
    """

    coordinates: Coordinates
    load: Floats
    values: Floats
    gradients: Floats
    weights: Floats
    first: Floats
    tight: bool

    @property
    def known(self) -> Flags:
        """Mask of derivatives that can be fitted, (13,)."""
        use = np.ones(len(NAMES), dtype=bool)
        use[at.SLACK] = not self.tight
        return use

    @property
    def solved(self) -> Flags:
        """Mask of readings at equilibria, with derivatives, (n,)."""
        there: Flags = np.isfinite(self.gradients).any(axis=(1, 2))
        return there


@dataclass(frozen=True)
class Reach:
    """Reach of a run: the load up to which its curve is emulated.

    Parameters
    ----------
    groups : array, shape (12,)
        Groups of the run.
    load : float
        p/M; a lower bound if ``open`` [–].
    open : bool
        Whether the curve was smooth to its end.
    """

    groups: Floats
    load: float
    open: bool


def reach(curve: Curve, samples: PathSamples, steepest: float = STEEPEST) -> Reach:
    """Return the load up to which a curve is smooth enough to emulate.

    The reach ends where d ln κ / d ln q exceeds ``steepest`` from below, or shortly before a limit
    point; for a curve without a known end, the last solved load is a bound. A large or undefined
    value at first only means that a curve begins with hardly any bending, or with bending in the
    opposite direction.
    """
    place = Place.of(curve.material)
    q = samples.loads / place.modulus
    groups = np.array(place.values)
    if len(q) < 3:
        return Reach(groups, 0.0, open=False)
    steep = _growth(samples)
    over = ~(steep < steepest)
    if over.all() and (np.isnan(steep[0]) or steep[-1] < steep[0]):
        over[:] = False  # still in its initial part
    begun = int(np.argmin(over))
    if over[begun:].any():
        k = begun + int(np.argmax(over[begun:]))
        crossing = q[max(k, 1)]
        if k > 0 and np.isfinite(steep[k]):
            pair = slice(k, k + 2)
            crossing = np.exp(np.interp(steepest, steep[k - 1 : k + 1], np.log(q[pair])))
        return Reach(groups, float(crossing), open=False)
    if np.isfinite(samples.limit_load):
        return Reach(groups, LIMIT_MARGIN * samples.limit_load / place.modulus, open=False)
    return Reach(groups, float(q[-1]), open=True)


def _growth(samples: PathSamples) -> Floats:
    """Return d ln Δκ / d ln q at every load but the first; nan where the curvature falls."""
    angle, length = samples.readings[:, 0], samples.readings[:, 1]
    kappa = angle / length
    slope = (samples.gradients[:, 0, 0] - kappa * samples.gradients[:, 1, 0]) / length
    change = kappa[1:] - kappa[0]
    growth: Floats = np.where(change > 0.0, samples.loads[1:] * slope[1:], np.nan)
    with np.errstate(invalid="ignore"):
        growth = growth / change
    return np.where(growth > 0.0, growth, np.nan)


def observe(
    curve: Curve,
    samples: PathSamples,
    *,
    span: TrainingRange,
    length: float,
    steepest: float = STEEPEST,
    between: bool = False,
) -> Observed | None:
    """Return the data of a run within its reach; None if it has fewer than two equilibria.

    With ``between`` readings between the equilibria are included, without derivatives.
    """
    if len(samples.loads) < 3:
        return None
    limit, place = reach(curve, samples, steepest).load, Place.of(curve.material)
    solved, bends = samples.loads, np.concatenate([[True], np.isfinite(_growth(samples))])
    if between:
        samples = _with_readings_between(curve, samples)
    q = samples.loads[1:] / place.modulus
    groups = np.column_stack([q, np.tile(place.values, (len(q), 1))])
    points = coordinates(groups)
    keep = (q <= limit * (1.0 + 1e-9)) & (points.points[:, 0] <= 1.0 + 1e-9)
    keep &= np.interp(samples.loads[1:], solved, bends) == 1.0  # it bends at both ends of a step
    if np.count_nonzero(keep) < 2:
        return None
    sizes, slopes = quantities(samples, length)
    rest = stretch_offset(groups.T)
    denominators = np.column_stack([q, q, *(q + rest for _ in (PEAK, *MEASURES)), q])
    changes, by_inputs = sizes[1:].copy(), slopes[1:].copy()
    changes[:, COUNTED] -= sizes[0, COUNTED]
    by_inputs[:, COUNTED, 1:] -= slopes[0, COUNTED, 1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        by_groups = _by_groups(by_inputs / changes[..., None], q, place, denominators)
        logs = np.log(changes / denominators)
        first = np.log(slopes[0, :, 0] * place.modulus)
    first[QUANTILES] = np.nan
    if rest[0] != 0.0:
        first[STRAINED] = np.nan
    # the derivative of the offset due to strain at rest
    offset, at_rest = np.zeros(len(NAMES)), np.array([0.0, *place.values])
    offset[at.MISMATCH] = np.sign(at_rest[at.MISMATCH])
    gravity = [at.ALONG, at.UP]
    if (weight := np.hypot(*at_rest[gravity])) > 0.0:
        offset[gravity] = at.GRAVITY_STRAIN * at_rest[gravity] / weight
    by_groups[:, STRAINED] -= (offset / denominators[:, 2, None])[:, None]
    weights = np.maximum(changes[keep, 0] / changes[keep, 0].max(), FLOOR)
    return Observed(
        Coordinates(*(part[keep] for part in vars(points).values())),
        q[keep],
        logs[keep],
        by_groups[keep],
        weights,
        first,
        tight=curve.material.paper_slack == 0.0,
    )


def _with_readings_between(curve: Curve, samples: PathSamples) -> PathSamples:
    """Return equilibria and readings between them in order of load."""
    loads = np.array(curve.loads[: len(samples.between)])
    new = ~np.isin(loads, samples.loads) & (loads < samples.loads[-1])
    missing = np.full((int(new.sum()), *samples.gradients.shape[1:]), np.nan)
    order = np.argsort(whole := np.concatenate([samples.loads, loads[new]]), kind="stable")
    return replace(
        samples,
        loads=whole[order],
        readings=np.concatenate([samples.readings, samples.between[new]])[order],
        gradients=np.concatenate([samples.gradients, missing])[order],
    )


def observe_force(
    curve: Curve, samples: PathSamples, *, span: TrainingRange, length: float
) -> Observed | None:
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
    keep = (points.points[:, 0] <= 1.0 + 1e-9) & (changes[:, 0] > 0.0)
    if np.isfinite(samples.limit_load):
        keep &= samples.loads[1:] <= LIMIT_MARGIN * samples.limit_load
    if not np.any(keep):
        return None
    parts = (part[keep] for part in vars(points).values())
    q, changes, by_inputs = q[keep], changes[keep], by_inputs[keep]
    by_groups = _by_groups(by_inputs / changes[..., None], q, place, q[:, None])
    by_groups[..., at.SECOND_INVARIANT] -= place.modulus  # of M itself: d ln M/dg = M
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.log(samples.gradients[0, :, 0] * place.modulus / unit)
    tight = curve.material.paper_slack == 0.0
    weights = np.maximum(changes[:, 0] / changes.max(), FLOOR)
    values = np.log(changes / q[:, None])
    return Observed(Coordinates(*parts), q, values, by_groups, weights, first, tight=tight)


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


def _by_groups(logarithmic: Floats, q: Floats, place: Place, denominators: Floats) -> Floats:
    """Convert derivatives by the model's inputs to those of y by p/M and the groups."""
    modulus = place.modulus
    out = np.empty((*logarithmic.shape[:2], len(NAMES)))
    out[..., 0] = logarithmic[..., 0] * modulus - 1.0 / denominators
    out[..., 1:] = logarithmic[..., 1:] @ input_jacobian(place)
    # at a fixed p/M a larger second invariant is a larger p/C1: dM/dg = M²
    out[..., at.SECOND_INVARIANT] += logarithmic[..., 0] * (q * modulus**2)[:, None]
    return out


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
    load, material, cause : float
        Factor per order [–].
    noise : float
        Standard deviation of the residual over that of the first coefficient [–].
    """

    load: float = 0.6
    material: float = 0.45
    cause: float = 0.35
    noise: float = 1e-2

    def scales(self, orders: Indices) -> Floats:
        """Return the prior standard deviation of every coefficient over that of the first."""
        scales: Floats = (
            self.load ** orders[:, 0]
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


def half_ranges(span: TrainingRange) -> Floats:
    """Return the ranges of load and groups over which derivatives count, (13,)."""
    causes = [max(c.high - c.neutral, c.neutral - c.low) for c in CAUSES]
    material = [0.5 * (g.high - g.low) for g in MATERIAL]
    return np.array([0.5 * span.load, *material, *causes])


def rows_of(
    run: Observed,
    orders: Indices,
    *,
    outputs: Sequence[int],
    span: TrainingRange,
    derivatives: bool = True,
    weight: float = DERIVATIVE_WEIGHT,
) -> Equations:
    """Return the equations of a run for some outputs, of their values and derivatives.

    ``weight`` is that of a derivative over half of its group's range, relative to a value.
    """
    place, w = run.coordinates, run.weights[:, None]
    values = features(orders, place.points)
    matrix = [w * values]
    targets = [w * (run.values[:, outputs] - place.warp[:, None])]
    if derivatives:
        here = run.solved
        slopes = feature_gradients(orders, place.points[here])
        sizes, by_groups = weight * half_ranges(span), run.gradients[here][:, outputs]
        finite = np.all(np.isfinite(by_groups), axis=(0, 1))
        for k in np.flatnonzero(run.known & finite):
            along = np.einsum("npt,np->nt", slopes, place.jacobian[here, :, k])
            wanted = by_groups[..., k] - place.warp_gradient[here, k, None]
            matrix.append(sizes[k] * w[here] * along)
            targets.append(sizes[k] * w[here] * wanted)
        if np.all(np.isfinite(run.first[outputs])):
            start = place.points[:1].copy()
            start[0, 0] = -1.0
            # at zero load slack paper has no effect
            start[0, N_CHEBYSHEV + [c.name for c in CAUSES].index("paper_slack")] = not run.tight
            matrix.append(FLOOR * features(orders, start))
            targets.append(FLOOR * (run.first[None, outputs] - place.warp[:1, None]))
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
