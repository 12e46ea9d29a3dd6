r"""Where the misfit lies: residuals, R² as in the paper, and its description.

With e the errors and scatter left after the parameters are fitted again
(`criticism.fit.linear.Linear.unexplained`), every statistic is a projection of e, scaled so
that its value is the size of the effect it is named after. Since e = V C⁻¹ (y − mean) is linear in
the whitened data z, so is the projection:

.. math:: T = \omega^T z .

ω comes either from generalised least squares with further directions fitted jointly, which has
minimum variance, or from a simple functional of e such as an area.

Each group of readings gets its own scale and trend along the path, directions W on the whitened
scale. Its gain in log-likelihood at the best sizes,

.. math:: g = \tfrac12 |Q^T z|^2, \qquad Q \text{ orthonormal, of the span of } W,

is compared with the misfit statistic, which is also a log-likelihood ratio, and with the gain of
the best of all groups in data simulated from the model. Degradation rates, mounts, modes of
tension and all readings together compete: if one of these is better, no group is reported.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.findings import Concentration
from bayesdeg.criticism.fit.linear import Linear
from bayesdeg.data.levels import LEVEL_WIDTH, levels
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import ACTUATOR, Curvature
from bayesdeg.observations.kinds import Labels, Places
from bayesdeg.observations.tensile import STRESS

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CurvatureFit:
    """Posterior predictions at the readings.

    Parameters
    ----------
    mean : array, shape (n_specimens, n_points)
        Posterior mean for a specimen of mean stiffness [1/m].
    low, high : array, shape (n_specimens, n_points)
        5 and 95 % of the posterior predictive law of a reading on another specimen [1/m].
    """

    mean: Floats
    low: Floats
    high: Floats


def predict_readings(
    model: JointModel, chain: Chain, generator: np.random.Generator, *, draws: int = 400
) -> CurvatureFit:
    """Return posterior predictions at the conditions of the data; nan if no draw has any."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    values = model.table.named(flat[generator.integers(len(flat), size=draws)])
    state, curves = model.tests(values), model.data_of(Curvature)
    mean = _known(curves.predicted(state).prediction.curvature, partial(np.nanmean, axis=0))
    # bend angles follow the curvatures
    read = curves.drawn(state, generator)[..., : curves.tests.pressure.shape[1]]
    low, high = _known(read, partial(np.nanquantile, q=[0.05, 0.95], axis=0))
    return CurvatureFit(mean, low, high)


def _known(drawn: Floats, summary: Callable[[Floats], ArrayLike]) -> Floats:
    """Return a summary over draws, (n_draws, ...); nan where none is finite."""
    known = np.any(np.isfinite(drawn), axis=0)
    return np.where(known, summary(np.where(known, drawn, 0.0)), np.nan)


def r_squared(measured: Floats, predicted: Floats) -> float:
    """Return R² = 1 − SSE/SST on pooled points; nan if all measured values are equal.

    Examples
    --------
    >>> r_squared(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.0]))
    0.5
    """
    if len(measured) == 0 or np.ptp(measured) == 0.0:
        return float("nan")
    total = np.sum((measured - np.mean(measured)) ** 2)
    return float(1.0 - np.sum((measured - predicted) ** 2) / total)


def level_table(
    model: JointModel, fit: CurvatureFit, published: dict[float, float]
) -> pd.DataFrame:
    """Return R² and rms residual per level and over all, with published R².

    Columns: ``degradation_pct``, ``n``, ``r_squared``, ``rms_per_m``, ``published_r_squared``.
    """
    data = model.data_of(Curvature).tests
    centres, member = levels(data.degradation[:, 0])
    rows = []
    for k, centre in enumerate(centres):
        near = [value for level, value in published.items() if abs(level - centre) <= LEVEL_WIDTH]
        rows.append(
            _level_row(f"{centre:.4g}", model, fit, member == k, near[0] if near else np.nan)
        )
    rows.append(_level_row("all", model, fit, member >= 0, np.nan))
    return pd.DataFrame(rows)


def _level_row(
    label: str, model: JointModel, fit: CurvatureFit, rows: NDArray[np.bool_], published: float
) -> dict[str, object]:
    data = model.data_of(Curvature).tests
    mask = data.mask & rows[:, None]
    measured, predicted = data.curvature[mask], fit.mean[mask]
    return {
        "degradation_pct": label,
        "n": int(mask.sum()),
        "r_squared": r_squared(measured, predicted),
        "rms_per_m": float(np.sqrt(np.mean((measured - predicted) ** 2))),
        "published_r_squared": published,
    }


@dataclass(frozen=True)
class CurvatureDeparture:
    """Where measured curvature departs most: the third of the pressures with the largest mean.

    Parameters
    ----------
    excess : float
        Mean of measured less simulated, over the simulated [–].
    pressures : (float, float)
        Ends of that third [kPa].
    levels : tuple of float
        Degradation rates at which it is at least half as far off, the same way [%].
    everywhere : bool
        Whether those are all degradation rates.
    agreeing, specimens : int
        Specimens that are off the same way there, of all.
    """

    excess: float
    pressures: tuple[float, float]
    levels: tuple[float, ...]
    everywhere: bool
    agreeing: int
    specimens: int


@dataclass(frozen=True)
class StressDeparture:
    """Departure of measured stress in each mode of tension, the worst first.

    Each mode with the root mean square of measured less calibrated stress [MPa]; `above` says
    whether measured stress is higher on average in the worst of them.
    """

    modes: tuple[tuple[str, float], ...]
    above: bool


@dataclass(frozen=True)
class ReadingsDeparture:
    """Where readings of other kinds depart most: the worst third of their path.

    Parameters
    ----------
    kind, unit : str
        What was read, and in which unit.
    ends : (float, float)
        Of that third of the path, in the unit of the path.
    error : float
        Root mean square of read less calibrated, in their unit.
    above : bool
        Whether they are higher there on average.
    """

    kind: str
    unit: str
    ends: tuple[float, float]
    error: float
    above: bool


def where(model: JointModel, residual: Floats, noise: float) -> CurvatureDeparture | None:
    """Return where the misfit is largest: pressures, degradation rates, specimens.

    From measured less predicted, (n_specimens, n_points) [1/m], and the root mean square of what no
    smooth discrepancy explains [1/m]. None if no reading can be predicted.
    """
    data = model.data_of(Curvature).tests
    known = data.mask & np.isfinite(residual)
    if not known.any():
        return None
    relative = residual / np.maximum(np.abs(data.curvature - residual), noise)
    bands = np.quantile(data.pressure[known], [0.0, 1 / 3, 2 / 3, 1.0])
    centres, member = levels(data.degradation[:, 0])
    third = np.clip(np.searchsorted(bands[1:-1], data.pressure), 0, 2)
    means = np.array([_mean(relative, known & (third == k)) for k in range(3)])
    k = int(np.argmax(np.abs(means)))
    cell = known & (third == k)
    by_level = np.array(
        [_mean(relative, cell & (member == m)[:, None]) for m in range(len(centres))]
    )
    same = centres[(by_level * means[k] > 0) & (np.abs(by_level) > 0.5 * abs(means[k]))]
    specimens = np.array([_mean(*row) for row in zip(relative, cell, strict=True)])
    low, high = data.pressure[cell].min(), data.pressure[cell].max()
    return CurvatureDeparture(
        excess=float(means[k]),
        pressures=(float(low), float(high)),
        levels=tuple(same.tolist()),
        everywhere=len(same) == len(centres),
        agreeing=int(np.sum(specimens * means[k] > 0)),
        specimens=len(specimens),
    )


def where_films(linear: Linear) -> StressDeparture:
    """Return the departures of stresses by mode of tension."""
    rows = linear.subject.places.kind == STRESS
    places = linear.subject.places.subset(rows)
    residual = (linear.subject.observed - linear.prediction)[rows]
    modes = dict.fromkeys(places.history.tolist())
    off = {mode: float(np.sqrt(np.mean(residual[places.history == mode] ** 2))) for mode in modes}
    worst = max(off, key=lambda mode: off[mode])
    ordered = {worst: off.pop(worst)} | off
    above = bool(np.mean(residual[places.history == worst]) >= 0.0)
    return StressDeparture(tuple(ordered.items()), above)


def where_readings(linear: Linear, kind: str, unit: str) -> ReadingsDeparture:
    """Return the departure of readings of one kind, and where on their path it is largest."""
    rows = linear.subject.places.kind == kind
    along = linear.subject.places.along[rows]
    residual = (linear.subject.observed - linear.prediction)[rows]
    thirds = np.clip(np.searchsorted(np.quantile(along, [1 / 3, 2 / 3]), along), 0, 2)
    off = [float(np.sqrt(np.mean(residual[thirds == k] ** 2))) for k in np.unique(thirds)]
    cell = thirds == np.unique(thirds)[int(np.argmax(off))]
    ends = float(along[cell].min()), float(along[cell].max())
    return ReadingsDeparture(kind, unit, ends, max(off), above=bool(residual[cell].mean() >= 0.0))


def _mean(values: Floats, mask: NDArray[np.bool_]) -> float:
    return float(np.mean(values[mask])) if mask.any() else 0.0


INSEPARABLE = 1e-6
"""Least share of a direction's square, after removing others, for it to count separately."""


@dataclass(frozen=True)
class ResidualStatistic:
    """A statistic of whitened data and its meaning.

    Parameters
    ----------
    name, unit : str
        As in the report.
    more, less : str
        What a value above, or below, that of a right model means physically.
    projections : array, shape (n, r), optional
        Directions in whitened data: one for a size, several for the mean of their squares. None
        where the readings do not have it.
    why : str
        What is missing where there are none.
    neutral : float
        Size where the model is right.
    squares : bool
        Whether it is the mean square of the projections or the size along the only one.
    """

    name: str
    unit: str
    more: str
    less: str
    projections: Floats | None
    why: str = ""
    neutral: float = 0.0
    squares: bool = False

    def of(self, whitened: Floats) -> Floats:
        """Return the statistic of whitened data sets (..., n), shape (...)."""
        assert self.projections is not None
        projected = whitened @ self.projections
        if self.squares:
            return np.asarray(np.mean(projected**2, axis=-1))
        return np.asarray(self.neutral + projected[..., 0])


def regression(linear: Linear, direction: Floats, *beside: Floats) -> Floats | None:
    r"""Return the projection that gives the size of an effect by generalised least squares.

    .. math:: \omega = w_\perp / |w_\perp|^2, \qquad w_\perp = (I - P_B)\, L^{-1} d

    with d the direction, L the Cholesky factor of the readings' covariance with the parameters
    integrated out, and P_B the projection on the directions fitted jointly.

    `direction` (n,) is the change of the readings by one unit of the effect; the sizes of those
    `beside` it are free, so that the statistic does not answer to them. None if the direction is
    made of these, else (n, 1).
    """
    columns = linear.whiten_columns(np.column_stack([direction, *beside]))
    own, others = columns[:, 0], columns[:, 1:]
    others = others[:, np.any(others != 0.0, axis=0)]
    if others.shape[1]:
        basis = np.linalg.qr(others / np.linalg.norm(others, axis=0))[0]
        left = own - basis @ (basis.T @ own)
    else:
        left = own
    square = float(left @ left)
    if square <= INSEPARABLE * float(own @ own):
        return None
    return np.asarray(left / square)[:, None]


def functional(linear: Linear, weights: Floats, reference: Floats) -> Floats:
    """Return the projection that gives a weighted sum of the residuals, (n, 1).

    `reference` (n,) is a change of the readings whose weighted sum is 1: what the refit takes of it
    is given back.
    """
    projection = linear.whiten_columns((linear.scatter @ weights)[:, None])
    seen = float(linear.whiten_columns(reference[:, None])[:, 0] @ projection[:, 0])
    return np.asarray(projection / seen)


def between_specimens(linear: Linear, size: Floats, *, alike: Labels) -> Floats | None:
    """Return directions in which specimens of the same level differ, (n, r), orthonormal.

    `size` (n,) is the change of the readings by one unit, 0 where a reading is of another family;
    `alike` (n,) is what else must be the same for specimens to be compared: mount, mode of tension.
    r is the number of specimens less that of groups in which they are alike; None if it is zero.
    """
    places, rows = linear.subject.places, size != 0.0
    names, first = np.unique(places.specimen[rows], return_index=True)
    if len(names) < 2:
        return None
    member = levels(places.level[rows][first])[1]
    label = alike[rows][first]
    same = ((member[:, None] == member) & (label[:, None] == label)).astype(np.float64)
    same /= np.sum(same, axis=1, keepdims=True)
    values, turned = np.linalg.eigh(np.eye(len(names)) - same)
    contrasts = turned[:, values > 0.5]
    if contrasts.shape[1] == 0:
        return None
    each = linear.whiten_columns(size[:, None] * (places.specimen[:, None] == names))
    return np.linalg.qr(np.linalg.pinv(each).T @ contrasts)[0]


def misfit_frame(linear: Linear, misfit: Misfit, model: str) -> pd.DataFrame:
    """Return the measured discrepancy at each reading, and the residual about it.

    The residual is from a joint fit of discrepancy and parameters, so that points scatter about the
    curve only by errors and specimens.

    Columns ``model``, ``kind``, ``history``, ``specimen_id``, ``degradation_pct``, ``along``
    (pressure [kPa] or stretch), ``discrepancy`` and ``residual`` in the readings' units.
    """
    places = linear.subject.places
    smooth = misfit.discrepancy
    left = linear.observed - linear.whiten_columns(smooth[:, None])[:, 0]
    return pd.DataFrame(
        {
            "model": model,
            "kind": places.kind,
            "history": places.history,
            "specimen_id": places.specimen,
            "degradation_pct": places.level,
            "along": places.along,
            "discrepancy": smooth,
            "residual": smooth + linear.unexplained(left),
        }
    )


Flags = NDArray[np.bool_]

BRANCH, CYCLE, HOLD, SPECIMEN, OTHER = "branch", "cycle", "hold", "specimen", ""
RARE = 0.02  # p-value up to which a group has more of the misfit than by chance
MOST = 0.5  # share of the misfit statistic above which a group dominates
MORE = 1.25  # factor by which it must exceed its share of the readings
FEW, FEW_OF_ALL = 3, 0.25  # most specimens that count as a few
FAINT = 1e-6  # relative to the largest: a direction spanned by the others


@dataclass(frozen=True)
class _Group:
    kind: str
    name: str
    rows: Flags


def concentration(linear: Linear, simulated: Floats, statistic: float) -> Concentration | None:
    """Return the branch, cycle, hold or few specimens with most of a misfit, if any.

    Compared with data sets (k, n) simulated from the model; without any nothing is told.
    `statistic` is its misfit statistic [nats].
    """
    groups = list(_groups(linear.subject.places))
    if not groups or not len(simulated):
        return None
    data = np.vstack([linear.observed, linear.whiten(simulated)])
    gains = np.stack([_gain(linear, (group,), data) for group in groups])
    chance = gains[:, 1:].max(axis=0)
    p_values = chance_of(gains[:, 0], chance)
    best = int(np.argmax(gains[:, 0]))
    chosen: tuple[_Group, ...] = (groups[best],) if groups[best].kind else ()
    if groups[best].kind == SPECIMEN:  # with others as conspicuous, unless there are many
        specimens = [i for i, group in enumerate(groups) if group.kind == SPECIMEN]
        out = sorted((i for i in specimens if p_values[i] <= RARE), key=lambda i: -gains[i, 0])
        few = min(FEW, int(FEW_OF_ALL * len(specimens)))
        chosen = tuple(groups[i] for i in out) if len(out) <= few else ()
    if not chosen or p_values[best] > RARE:
        return None
    gain = float(_gain(linear, chosen, data[:1])[0])
    share = gain / max(statistic, gain)
    family = np.any([group.rows for group in groups], axis=0)
    readings = float(np.sum(np.any([group.rows for group in chosen], axis=0)) / np.sum(family))
    if share < max(MOST, MORE * readings):
        return None
    size = np.where(family, linear.prediction, 0.0)
    projections = [regression(linear, 0.01 * size * group.rows, size) for group in chosen]
    return Concentration(
        kind=chosen[0].kind,
        members=tuple(group.name for group in chosen),
        excess_pct=tuple(
            0.0 if one is None else float(linear.observed @ one[:, 0]) for one in projections
        ),
        share_of_misfit=share,
        share_of_readings=readings,
        p_value=float(p_values[best]),
    )


def histories_of(places: Places, rows: Flags) -> NDArray[np.str_]:
    """Return branch, cycle and mount of actuators' readings, (n, 3); empty for other readings."""
    split = np.full((len(rows), 3), "", dtype=np.array(places.history).dtype)
    split[rows] = [history.split() for history in places.history[rows]]
    return split


def _groups(places: Places) -> Iterator[_Group]:
    of_actuators = bool(np.any(places.family == ACTUATOR))
    family = places.family == ACTUATOR if of_actuators else np.ones(len(places), bool)
    yield _Group(OTHER, "all", family)
    specimens, first = np.unique(places.specimen[family], return_index=True)
    rates, member = levels(places.level[family][first])
    for k in np.flatnonzero(np.bincount(member) > 1) if len(rates) > 1 else ():
        yield _Group(OTHER, "level", family & np.isin(places.specimen, specimens[member == k]))
    for name in specimens if len(specimens) >= 1 / FEW_OF_ALL else ():
        yield _Group(SPECIMEN, str(name), family & (places.specimen == name))
    if of_actuators:
        branch, cycle, mount = histories_of(places, family).T
        found = [_Group(BRANCH, "unloading", branch == "unloading")]
        later = [str(c) for c in np.unique(cycle[family]) if c != "1"]
        found += [_Group(CYCLE, f"cycle {name}", cycle == name) for name in later]
        if len(later) > 1:
            found.append(_Group(CYCLE, "cycles after the first", family & (cycle != "1")))
        keys = np.stack([places.specimen, places.kind, places.history])
        same = np.all(keys[:, 1:] == keys[:, :-1], axis=0) & (np.diff(places.along) == 0.0)
        found.append(_Group(HOLD, "readings after a hold", family & np.append(False, same)))
        found += [_Group(OTHER, "mount", mount == name) for name in np.unique(mount[family])]
        yield from (one for one in found if 0 < np.sum(one.rows) < np.sum(family))
    else:
        for mode in np.unique(places.history[family]):
            yield _Group(OTHER, "mode", family & (places.history == mode))


def _gain(linear: Linear, groups: tuple[_Group, ...], data: Floats) -> Floats:
    """Return the gain of whitened data sets (k, n) by scale and trend of each group, (k,)."""
    places, columns = linear.subject.places, []
    for group in groups:
        size = np.where(group.rows, linear.prediction, 0.0)
        middle = float(np.mean(places.along[group.rows]))
        columns += [size, size * (places.along - middle) / max(float(np.ptp(places.along)), 1e-12)]
    return gain_of(linear, np.column_stack(columns), data)


def gain_of(linear: Linear, directions: Floats, data: Floats) -> Floats:
    """Return the gain in log-likelihood of whitened data sets (k, n) by directions (n, r), (k,)."""
    whitened = linear.whiten_columns(directions)
    vectors, values, _ = np.linalg.svd(whitened, full_matrices=False)
    basis = vectors[:, values > FAINT * values[0]]
    gain: Floats = 0.5 * np.sum((data @ basis) ** 2, axis=1)
    return gain
