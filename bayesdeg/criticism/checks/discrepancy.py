"""Smooth discrepancies of readings: the covariances that measure a misfit.

Within one family of readings a discrepancy is a smooth function of the path and of the degradation
rate, proportional to a smooth envelope of the readings. It is common to all loading histories or
different for each; it may differ between specimens; and it may be the same for every kind of
reading in the family or only for the first kind. Its covariance between readings i and j is

    a² e_i e_j exp(−(s_i − s_j)²/(2 ℓ²) − (D_i − D_j)²/(2 w²)) [same history or specimen],

with s the path in its largest extent, D the degradation rate [%] and e the envelope.

Source: Kennedy and O'Hagan (2001), doi:10.1111/1467-9868.00294, for discrepancies of this kind.

It only measures the misfit and never enters the physics. The statistic is the largest of

    ln N(z; 0, I + a² K) − ln N(z; 0, I)

over kernels K and amplitudes a, z the whitened readings.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpstrf

from bayesdeg.criticism.chance import chance_of, is_clear
from bayesdeg.criticism.fit.linear import Linear
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.observations.kinds import Places

Floats = NDArray[np.float64]

SHORT, LONG = 0.25, 0.625
"""Lengths along the path, relative to its largest extent: 60 and 150 kPa of 240."""
DRIFT, EACH = 12.0, 2.0
"""Lengths along the degradation rate [%]: a drift, and one discrepancy per level."""
EVERYWHERE = 1e3
ALIKE = (1.0, 0.0)
"""Discrepancy of the other kinds of a family relative to that of the first."""
RANK_TOLERANCE = 1e-8
"""Share of the largest variance below which directions of a kernel are dropped."""


@dataclass(frozen=True)
class Discrepancy:
    """One covariance of discrepancies on the whitened scale.

    `label` says what it is a function of; eigenvalues (r,) are for a relative size of 1,
    eigenvectors (n, r).
    """

    family: str
    label: str
    values: Floats
    vectors: Floats


def discrepancies(linear: Linear) -> tuple[Discrepancy, ...]:
    """Return every discrepancy that is tried, on the whitened scale of a linearised model."""
    found = []
    for family, label, root in discrepancy_roots(linear.subject.places, linear.mean):
        half = linear.whiten_columns(root)
        values, turned = np.linalg.eigh(half.T @ half)
        keep = values > RANK_TOLERANCE * max(float(values[-1]), 1e-300)
        vectors = half @ turned[:, keep] / np.sqrt(values[keep])
        found.append(Discrepancy(family, label, values[keep], vectors))
    return tuple(found)


def discrepancy_roots(places: Places, mean: Floats) -> Iterator[tuple[str, str, Floats]]:
    """Yield family, label and a factor (n, r) of every kernel of relative size 1.

    The discrepancy is proportional to the given readings (n,); the factor is zero for readings of
    other families.
    """
    for family in dict.fromkeys(places.family.tolist()):
        rows = places.family == family
        kinds = list(dict.fromkeys(places.kind[rows].tolist()))
        shapes = list(_shapes(places.subset(rows)))
        for of_others in ALIKE if len(kinds) > 1 else ALIKE[:1]:
            envelope = np.zeros(len(mean))  # size of the readings, with a floor for small ones
            for number, kind in enumerate(kinds):
                own = rows & (places.kind == kind)
                size = np.abs(mean[own])
                share = 1.0 if number == 0 else of_others
                envelope[own] = share * (size + 0.1 * size.max(initial=0.0))
            for label, correlation in shapes:
                kernel = correlation * np.outer(envelope[rows], envelope[rows])
                # pivoted Cholesky: a low-rank factor, cheaper than an eigendecomposition
                tolerance = RANK_TOLERANCE * float(np.diag(kernel).max())
                factor, pivots, rank, _ = dpstrf(kernel, lower=1, tol=tolerance)
                whole = np.zeros((len(rows), rank))
                whole[np.flatnonzero(rows)[pivots - 1]] = np.tril(factor)[:, :rank]
                yield family, label, whole


def _shapes(places: Places) -> Iterator[tuple[str, Floats]]:
    """Return the correlations that a discrepancy of one family may have, each (n, n)."""
    along = places.along / max(float(np.ptp(places.along)), 1e-12)
    levels = len(np.unique(places.level.round(6)))

    def smooth(short: float, across: float) -> Floats:
        square = ((along[:, None] - along) / short) ** 2
        square += ((places.level[:, None] - places.level) / across) ** 2
        return np.exp(-0.5 * square)

    yield "the path", smooth(SHORT, EVERYWHERE)
    if levels > 1:
        yield "the path, drifting with degradation", smooth(SHORT, DRIFT)
        yield "the path, slowly", smooth(LONG, EVERYWHERE)
        yield "the path, slowly, drifting with degradation", smooth(LONG, DRIFT)
        yield "the path, for each degradation rate", smooth(LONG, EACH)
    for label, group in (("history of load", places.history), ("specimen", places.specimen)):
        if 1 < len(np.unique(group)) < len(places):
            same = (group[:, None] == group).astype(np.float64)
            yield f"the path, for each {label}", smooth(LONG, EVERYWHERE) * same


AMPLITUDES = np.geomspace(0.005, 1.0, 25)
REPLICATES = 200  # noise-only data sets, for the distribution by chance
FEWEST = round(1.0 / MISFIT_LEVEL) - 1
"""Fewest simulated data sets with which a p-value can reach that level."""


@dataclass(frozen=True)
class Misfit:
    """The misfit of a model.

    Parameters
    ----------
    statistic : float
        Largest log-likelihood ratio of a discrepancy against none [nats].
    null : array, shape (n,)
        The same for data simulated from the fitted model.
    p_value : float
        Share of simulated data with at least this statistic, (1 + #)/(1 + n); nan where n is below
        `FEWEST`: then nothing is known of the misfit.
    family, label : str
        Which readings the best discrepancy is of, and what it is a function of.
    discrepancy : array, shape (n_readings,)
        Its posterior mean, in the readings' units.
    lost : float
        Share of simulated data sets that left the range of the forward map.
    drawn : int
        Data sets that were simulated, with those that left that range.
    unanswered : array, shape (n_readings,)
        Share of them in which the forward map had no answer for a reading; empty if unknown.
    """

    statistic: float
    null: Floats
    p_value: float
    family: str
    label: str
    discrepancy: Floats
    lost: float
    drawn: int = 0
    unanswered: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def is_calibrated(self) -> bool:
        """Whether enough data could be simulated for a p-value."""
        return not np.isnan(self.p_value)

    @property
    def by_chance(self) -> float:
        """Mean of the statistic by chance [nats]; 0 if no data were simulated."""
        return float(np.mean(self.null)) if len(self.null) else 0.0


def measure(linear: Linear, simulated: Floats) -> Misfit:
    """Measure the misfit of a model and calibrate it by data simulated from its posterior.

    Data sets (k, n_readings) have nan where the model had no answer.
    """
    known, drawn = complete_sets(simulated), len(simulated)
    kernels = discrepancies(linear)
    statistic, best = largest_ratio(linear.observed[None], kernels)
    null, _ = largest_ratio(linear.whiten(known), kernels)
    kernel = kernels[int(best[0]) // len(AMPLITUDES)]
    amplitude = AMPLITUDES[int(best[0]) % len(AMPLITUDES)]
    signal = amplitude**2 * kernel.values
    shrunk = kernel.vectors @ ((signal / (1.0 + signal)) * (linear.observed @ kernel.vectors))
    return Misfit(
        statistic=float(statistic[0]),
        null=null,
        p_value=_p_value(float(statistic[0]), null),
        family=kernel.family,
        label=kernel.label,
        discrepancy=linear.whitening.coloured(shrunk),
        lost=1.0 - len(known) / drawn if drawn else 0.0,
        drawn=drawn,
        unanswered=np.mean(~np.isfinite(simulated), axis=0) if drawn else np.empty(0),
    )


def complete_sets(simulated: Floats) -> Floats:
    """Return the simulated data sets (k, n_readings) in which the model had every answer."""
    return simulated[np.all(np.isfinite(simulated), axis=1)]


def _p_value(statistic: float, null: Floats) -> float:
    return float(chance_of(statistic, null, fewest=FEWEST))


def resolved(
    misfit: Misfit,
    linear: Linear,
    simulate: Callable[[int], Floats],
    *,
    most: int,
    level: float = MISFIT_LEVEL,
) -> Misfit:
    """Simulate more data until the p-value is clearly on one side of a level.

    Each round doubles the number of data sets. With few, chance would decide the outcome of a
    p-value near the level.

    `simulate` returns so many more data sets, (k, n_readings); it stops at `most` in any case.
    """
    null, drawn = misfit.null, misfit.drawn
    while FEWEST <= len(null) < most and not is_clear(misfit.statistic, null, level):
        simulated = simulate(min(len(null), most - len(null)))
        known = complete_sets(simulated)
        drawn += len(simulated)
        if not len(known):
            break
        more, _ = largest_ratio(linear.whiten(known), discrepancies(linear))
        null = np.append(null, more)
    return replace(misfit, null=null, p_value=_p_value(misfit.statistic, null), drawn=drawn)


def explained(before: Misfit, after: Misfit) -> float:
    """Return the share of the misfit statistic beyond chance that a cause removes.

    nan if the misfit does not exceed chance.

    Examples
    --------
    >>> null = np.zeros(3)
    >>> full = Misfit(50.0, null, 0.01, "actuator", "the path", null, 0.0)
    >>> explained(full, Misfit(5.0, null, 0.5, "actuator", "the path", null, 0.0))
    0.9
    """
    ceiling = before.statistic - before.by_chance
    if ceiling <= 0.0:
        return float("nan")
    left = max(after.statistic - after.by_chance, 0.0)
    return float(np.clip(1.0 - left / ceiling, 0.0, 1.0))


def explained_on_one_scale(before: Linear, after: Linear) -> float:
    """Return the removed share of the misfit, with both models at the errors of `after`.

    A model that lacks a cause widens its errors and scatter until the misfit looks small, but not
    with the errors of the model that has it. nan as in `explained`.
    """
    generator = np.random.default_rng(0)
    left = []
    for linear in (before, after):
        seen = linear.with_scatter(after.scatter)
        kernels = discrepancies(seen)
        noise = generator.standard_normal((REPLICATES, len(after.mean)))
        chance = float(np.mean(largest_ratio(noise, kernels)[0]))
        left.append(float(largest_ratio(seen.observed[None], kernels)[0][0]) - chance)
    if left[0] <= 0.0:
        return float("nan")
    return float(np.clip(1.0 - max(left[1], 0.0) / left[0], 0.0, 1.0))


def largest_ratio(
    whitened: Floats, kernels: tuple[Discrepancy, ...]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the largest log-likelihood ratio over kernels and amplitudes, and its kernel.

    Of data sets (k, n_readings); the index of the best is kernel × number of amplitudes +
    amplitude.
    """
    return largest_of([whitened @ kernel.vectors for kernel in kernels], kernels)


def largest_of(
    projected: Sequence[Floats], kernels: Sequence[Discrepancy]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the same of data projected on the eigenvectors of each kernel, (k, r) each."""
    ratios = []
    for kernel, part in zip(kernels, projected, strict=True):
        signal = AMPLITUDES[:, None] ** 2 * kernel.values
        ratios.append(log_ratios(signal, part))
    table = np.concatenate(ratios)
    return np.maximum(table.max(axis=0), 0.0), table.argmax(axis=0)


def log_ratios(signal: Floats, projected: Floats) -> Floats:
    """Return ln N(z; 0, I + Q diag(s) Qᵀ) − ln N(z; 0, I), (a, k), for s (a, r) and z Q (k, r)."""
    gain: Floats = 0.5 * (signal / (1.0 + signal)) @ (projected**2).T
    return gain - 0.5 * np.sum(np.log1p(signal), axis=1)[:, None]


def interval_with_discrepancy(trial: CandidateFit, name: str) -> tuple[float, float]:
    """Return the 90 % interval of a parameter with the best discrepancy added to the errors.

    In the linearised model, with δ ~ N(δ₀, Λ⁻¹) and readings of covariance V + K: K is the
    covariance of the most probable of the discrepancies that measure the misfit. It is not a
    remedy: the part of a misfit that looks like a change of the parameter is still taken for one.
    """
    linear, subject, jacobian = trial.linear, trial.subject, trial.linear.jacobian
    kernels = discrepancies(linear)
    best = int(largest_ratio(linear.observed[None], kernels)[1][0])
    kernel, amplitude = kernels[best // len(AMPLITUDES)], AMPLITUDES[best % len(AMPLITUDES)]
    signal = amplitude**2 * kernel.values
    shrink = kernel.vectors * (signal / (1.0 + signal))

    spread = linear.whiten_columns(jacobian @ trial.uncertain)
    weighed = spread - shrink @ (kernel.vectors.T @ spread)
    centre = trial.mode + linear.shift + weighed.T @ linear.observed
    covariance = trial.uncertain - spread.T @ weighed
    row = subject.table.names.index(name)
    half = 1.645 * np.sqrt(covariance[row, row])
    law = subject.table.parameters[row].law
    low, high = law.from_unconstrained(centre[row] + half * np.array([-1.0, 1.0]))
    return float(low), float(high)
