"""Training data for the load as a function of the bending, and its coordinates.

Near ballooning the curvature k = κ s L is a steep function of the load q = p/M, while the load is
a smooth function of the curvature. So h = ln(q/k) is fitted over k and the groups; from
y = ln(k/q) over q follow ∂h/∂k = −y_q/(k_q) and ∂h/∂g = −y_g/(1 + q y_q).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.surrogate import coordinates as at
from bayesdeg.surrogate.regression import Observed, observe, offset_gradient
from bayesdeg.surrogate.scaling import Place
from bayesdeg.surrogate.surrogate import stretch_offset

Floats = NDArray[np.float64]

LENGTH = 50.0  # mm
POINTS = 4  # of a curve
SMALL_STRAIN = 0.05
STEEP = 4.0  # d ln κ/d ln q up to which runs are used
AT_REST = [at.MISMATCH, at.ALONG, at.UP]  # what strains the paper without pressure
# a, the strain over k of a line that no paper holds [–], and P₀, the body's own stiffness [mm]
STRAIN, GIVE = 0.07, 30.0
# one unit of each coordinate: k, the material, the causes in the order of ``GROUPS``
UNITS = np.array(
    [1.0, 0.3, 1.5, 1.0, 0.1, 0.6, 0.02, 0.02, 0.01, 3e-5, 3e-5, 0.1, 0.2], dtype=np.float64
)


@dataclass(frozen=True)
class Points:
    """Solved equilibria.

    Parameters
    ----------
    places : array, shape (n, 13)
        Coordinates, see ``coordinates``.
    values : array, shape (n, 3)
        h, ln(bend angle/k) and ln(peak strain + ``SMALL_STRAIN``).
    slopes : array, shape (n, 3, 13)
        Their derivatives by the coordinates; nan where they are not known.
    curve : array of int, shape (n,)
        To which curve each belongs.
    """

    places: Floats
    values: Floats
    slopes: Floats
    curve: NDArray[np.int64]

    @property
    def loose(self) -> NDArray[np.bool_]:
        """Where the paper is slack."""
        return self.places[:, at.SLACK] > 0.0

    def only(self, keep: NDArray[np.bool_]) -> "Points":
        """Return some of the points."""
        return Points(*(part[keep] for part in vars(self).values()))


def coordinates(bending: Floats, groups: Floats) -> Floats:
    """Return k (n,) and groups (n, 12) in units, the paper's thickness squared, (n, 13)."""
    out = np.column_stack([bending, groups])
    out[:, at.THICKNESS] = out[:, at.THICKNESS] ** 2
    return out / UNITS


def missing_force(places: Floats) -> tuple[Floats, Floats]:
    """Return φ, the share of a tight paper's force that slack takes away, and its slopes.

    A paper on a beam: its strain is ε = a k less what its own force takes back, and the force
    goes with ε − s tanh(ε/s). With u = ε/s, x = a k/s and β = P/P₀, u + β (u − tanh u) = x and
    φ = 1 − (1 + β) (u − tanh u)/x, about s/(a k) where that is small.
    """
    raw = places * UNITS
    slack, beta = raw[:, at.SLACK], np.exp(raw[:, at.PAPER]) / GIVE
    loose = slack > 0.0
    s = np.where(loose, slack, 1.0)
    x = STRAIN * np.maximum(raw[:, 0], 1e-6) / s
    u = x.copy()
    for _ in range(60):
        tanh = np.tanh(u)
        u -= (u + beta * (u - tanh) - x) / (1.0 + beta * tanh**2)
    rest, square = u - np.tanh(u), np.tanh(u) ** 2
    by_x = 1.0 / (1.0 + beta * square)
    phi = np.where(loose, 1.0 - (1.0 + beta) * rest / x, 0.0)
    slope = (1.0 + beta) * (rest / x - square * by_x) / x
    out = np.zeros_like(places)
    out[:, 0] = slope * STRAIN / s
    out[:, at.SLACK] = -slope * x / s
    out[:, at.PAPER] = beta * rest / x * ((1.0 + beta) * square * by_x - 1.0)
    return phi, np.where(loose[:, None], out * UNITS, 0.0)


def observed(
    curves: Sequence[Curve], samples: Sequence[PathSamples], *, points: int = POINTS
) -> Points:
    """Return what runs say within their reach; the number of a curve is its place.

    Slack paper that is strained at rest, by a mismatch or by weight, is left out: that takes up
    the slack or adds to it, with a corner.
    """
    parts = []
    for number, (curve, found) in enumerate(zip(curves, samples, strict=True)):
        seen = observe(curve, found, length=LENGTH, compliance=1.0)
        place = np.array(Place.of(curve.material).values)
        corner = place[at.SLACK - 1] > 0.0 and np.any(place[[axis - 1 for axis in AT_REST]])
        if seen is not None and not corner:
            parts.append(_points(number, curve, by_load(seen, Place.of(curve.material)), points))
    return Points(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def by_load(run: Observed, place: Place) -> Observed:
    """Return a run with y over the load and its derivatives at a given load, while it is not steep.

    With the logarithms of an output O and of the load q at a given swelling t, the derivative of O
    by g at a given load is ∂O/∂g − (∂O/∂t)/(∂q/∂t) ∂q/∂g.
    """
    kept = np.cumsum(~(np.nan_to_num(run.growth, nan=np.inf) < STEEP)) == 0
    load, t = run.load[kept], run.along[kept]
    groups = np.array([0.0, *place.values])
    rest, offset = stretch_offset(groups), offset_gradient(place)
    over, new = (np.column_stack([z, z, *(z + rest for _ in range(7)), z]) for z in (t, load))
    of_rest = np.zeros((10, 13))
    of_rest[2:9] = offset
    by = run.gradients[kept] + of_rest / over[..., None]  # of the logarithms, not over t
    by[..., 0] += 1.0 / over
    by, share = by - by[..., :1] / by[:, -1:, :1] * by[:, -1:], by[..., 0] / by[:, -1:, 0]
    by[..., 0] = share / load[:, None] - 1.0 / new
    by -= of_rest / new[..., None]
    parts = {name: part[kept] for name, part in vars(run.coordinates).items()}
    return replace(
        run,
        coordinates=replace(run.coordinates, **parts),
        along=load,
        load=load,
        values=run.values[kept] + np.log(over / new),
        first=run.first - run.first[-1],
        gradients=by,
        weights=run.weights[kept],
    )


def _points(
    number: int, curve: Curve, seen: Observed, points: int
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    take = _spread(seen.load * np.exp(seen.values[:, 0]), points)
    q, y, by = seen.load[take], seen.values[take], seen.gradients[take]
    groups = np.tile(Place.of(curve.material).values, (len(q), 1))
    k = q * np.exp(y[:, 0])
    strain, strain_rates = _strain(q, groups, y[:, 2], by[:, 2])
    values = np.column_stack([-y[:, 0], y[:, 1] - y[:, 0], np.log(SMALL_STRAIN + strain)])
    growth = 1.0 + q * by[:, 0, 0]  # d ln k/d ln q
    slopes = np.empty((len(q), 3, 13))
    # at a fixed k, d ln q = −(∂ ln k/∂g)/growth
    moves = -by[:, 0, 1:] / growth[:, None]
    rates = [by[:, 1] - by[:, 0], strain_rates / (SMALL_STRAIN + strain)[:, None]]
    slopes[:, 0, 0], slopes[:, 0, 1:] = (1.0 / growth - 1.0) / k, moves
    for output, rate in enumerate(rates, start=1):
        slopes[:, output, 0] = rate[:, 0] * q / (growth * k)
        slopes[:, output, 1:] = rate[:, 1:] + (rate[:, 0] * q)[:, None] * moves
    slopes[..., at.THICKNESS] /= 2.0 * groups[0, at.THICKNESS - 1]
    slopes[..., AT_REST if groups[0, at.SLACK - 1] > 0.0 else at.SLACK] = np.nan
    return coordinates(k, groups), values, slopes * UNITS, np.full(len(q), number)


def _strain(q: Floats, groups: Floats, y: Floats, by: Floats) -> tuple[Floats, Floats]:
    """Return the peak strain and its derivatives by load and groups from those of y."""
    weight = np.hypot(groups[:, at.ALONG - 1], groups[:, at.UP - 1])
    rest = stretch_offset(np.column_stack([q, groups]).T)
    offset = np.zeros((len(q), 13))
    offset[:, 0] = 1.0
    offset[:, at.MISMATCH] = np.sign(groups[:, at.MISMATCH - 1])
    for axis in (at.ALONG, at.UP):
        offset[:, axis] = (
            at.GRAVITY_STRAIN * groups[:, axis - 1] / np.where(weight > 0.0, weight, 1.0)
        )
    factor = np.exp(y)[:, None]
    strain: Floats = (q + rest) * factor[:, 0]
    return strain, strain[:, None] * by + factor * offset


def _spread(bending: Floats, points: int) -> NDArray[np.int64]:
    """Return places of a few bendings, evenly spread, the last among them."""
    wanted = np.linspace(bending[0], bending[-1], points)
    return np.unique([int(np.argmin(np.abs(bending - k))) for k in wanted])
