r"""Two other methods on studies with hidden effects: least squares, and a discrepancy that is read.

Both start from the calibrated base model, linearised at its fit: readings are
:math:`y = f + X \delta + e`, with the deviation of the parameters :math:`\delta \sim N(\delta_0,
\Lambda^{-1})` known from films and priors, and the errors and scatter :math:`e \sim N(0, V)`. The
parameters are integrated out, so that what a cause does is what is left of it after a refit.

**Closed-form generalised least squares.** A cause adds :math:`S \varphi` with a normal prior of
:math:`\varphi`, so that its Bayes factor is a formula. The best cause is taken if it beats what was
taken before by 20 to 1, at most two; those within 20 to 1 of a taken one are said with it; what is
left is tested by its sum of squares.

**Kennedy and O'Hagan.** The readings are :math:`\rho f` and a discrepancy, a Gaussian process over
pressure, degradation and whatever else was varied, with hyperparameters of largest posterior
density; both together are real if they raise the likelihood more than chance does. Then its users
look at what they add: the cause whose own effect, seen through the same smoother, looks most like
it is what they say. Draws of it say how sure that is: the set said holds 80 % of them. What looks
like no cause is unexplained.

References
----------
Kennedy and O'Hagan (2001), doi:10.1111/1467-9868.00294; Brynjarsdóttir and O'Hagan (2014),
doi:10.1088/0266-5611/30/11/114007.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.linear import (
    Linear,
    log_bayes_factor,
    neutral_sizes,
    prior_size,
    sensitivities,
)
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.criticism.outcome import MISFIT_LEVEL, Outcome
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.hidden import HiddenAnswer, Sets, StatedSize
from bayesdeg.observations.kinds import Places

Floats = NDArray[np.float64]

ODDS = float(np.log(20.0))
MOST_CAUSES = 2
NINETY = float(stats.norm.ppf(0.95))

LARGEST_FIT = 400  # readings on which hyperparameters are found; the rest of the work takes all
STARTS = ((0.5, 0.02, 0.02), (1.5, 0.1, 0.1))  # the first three of these, not in logs
LENGTH_PRIOR, AMPLITUDE_PRIOR, FACTOR_PRIOR, NOISE_PRIOR = (
    1.0,
    1.5,
    1.5,
    1.0,
)  # sd of logs about their centres
# of ln length over range, amplitude over size, deviation of ρ from 1, noise over fitted noise
CENTRES = (0.0, -3.0, -3.0, 0.0)
DRAWS = 400
HELD = 0.8  # of the draws that the set said holds
LOOKS_LIKE = 0.8  # correlation below which a discrepancy is said to look like no cause
JITTER = 1e-8


@dataclass(frozen=True)
class FittedStudy:
    """A study as both methods see it.

    Parameters
    ----------
    name : str
        Of its folder.
    base : CandidateFit
        The base model, calibrated.
    causes : tuple of Cause
        Those that the columns at hand can show.
    """

    name: str
    base: CandidateFit
    causes: tuple[Cause, ...]

    @cached_property
    def linear(self) -> Linear:
        """The base model linearised at its fit."""
        return self.base.linear

    @cached_property
    def columns(self) -> Mapping[str, Floats]:
        """Whitened changes of the readings by one prior size of each parameter, by cause."""
        found = {cause.name: sensitivities(self.linear, cause) for cause in self.causes}
        return {name: columns for name, columns in found.items() if np.any(columns)}


def fit_study(folder: Path) -> FittedStudy:
    """Calibrate the base model of a study."""
    with threadpool_limits(limits=1):
        study = read_study(folder)
        assembly = assemble(study)
        seed = np.random.SeedSequence(study.settings.seed)
        base = base_without_chain(assembly.model, seed)
    return FittedStudy(folder.name, base, assembly.candidates)


# ---- generalised least squares


def least_squares(study: FittedStudy) -> HiddenAnswer:
    """Say what closed-form Bayes factors say."""
    z, columns = study.linear.observed, study.columns
    chosen = _chosen(z, columns)
    sets = tuple(_with_rivals(z, columns, chosen, name) for name in chosen)
    left = _left(z, _beside(columns, chosen))
    if left <= MISFIT_LEVEL:
        outcome, sets = Outcome.UNEXPLAINED, ()
    elif chosen:
        alone = any(len(names) == 1 for names in sets)
        outcome = Outcome.NAMED if alone else Outcome.AMBIGUOUS
    else:
        outcome = Outcome.ADEQUATE
    return HiddenAnswer(
        study=study.name,
        outcome=outcome,
        sets=sets,
        p_value=_left(z, np.zeros((len(z), 0))),
        sizes=_sizes(study, chosen) if sets else {},
        probabilities=_probabilities(z, columns),
    )


def _beside(columns: Mapping[str, Floats], names: Sequence[str]) -> Floats:
    size = len(next(iter(columns.values())))
    return np.hstack([np.zeros((size, 0)), *(columns[name] for name in names)])


def _factor(z: Floats, columns: Mapping[str, Floats], names: Sequence[str]) -> float:
    return float(log_bayes_factor(z, _beside(columns, names)))


def _chosen(z: Floats, columns: Mapping[str, Floats]) -> list[str]:
    chosen: list[str] = []
    while len(chosen) < MOST_CAUSES:
        others = [name for name in columns if name not in chosen]
        factors = {name: _factor(z, columns, [*chosen, name]) for name in others}
        best = max(factors, key=lambda name: factors[name])
        if factors[best] - _factor(z, columns, chosen) <= ODDS:
            break
        chosen.append(best)
    return chosen


def _with_rivals(
    z: Floats, columns: Mapping[str, Floats], chosen: Sequence[str], name: str
) -> tuple[str, ...]:
    """Return a chosen cause and those that could be in its place at odds of less than 20 to 1."""
    others = [one for one in chosen if one != name]
    whole = _factor(z, columns, chosen)
    rivals = [
        one
        for one in columns
        if one not in chosen and whole - _factor(z, columns, [*others, one]) < ODDS
    ]
    return (name, *rivals)


def _left(z: Floats, columns: Floats) -> float:
    """Return the p-value of the sum of squares that is left beside what was chosen."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    along = columns.T @ z
    return float(stats.chi2.sf(z @ z - along @ np.linalg.solve(inner, along), len(z)))


def _sizes(study: FittedStudy, chosen: Sequence[str]) -> dict[str, StatedSize]:
    """Return sizes of what was chosen, normal on the scale on which priors are taken for normal."""
    columns = _beside(study.columns, chosen)
    covariance = np.linalg.inv(np.eye(columns.shape[1]) + columns.T @ columns)
    mean, sd = covariance @ columns.T @ study.linear.observed, np.sqrt(np.diag(covariance))
    by_name = {cause.name: cause for cause in study.causes}
    found, place = {}, 0
    for name in chosen:
        cause = by_name[name]
        for parameter, neutral in zip(cause.parameters, neutral_sizes(cause), strict=True):
            scale = prior_size(parameter)
            ends = neutral + scale * (mean[place] + sd[place] * np.array([-NINETY, 0.0, NINETY]))
            low, middle, high = np.sort(parameter.law.from_unconstrained(ends)).tolist()
            stated = StatedSize(mean=middle, q05=low, q95=high)
            if stated.q05 is not None and stated.q95 is not None:
                found[f"{name}.{parameter.name}"] = stated
            place += 1
    return found


def _probabilities(z: Floats, columns: Mapping[str, Floats]) -> dict[str, float]:
    """Return the probability of each cause alone; nothing has that of all causes beforehand."""
    factors = np.array([_factor(z, columns, [name]) for name in columns])
    weights = np.exp(np.append(factors - np.log(len(columns)), 0.0) - max(factors.max(), 0.0))
    return dict(zip(columns, (weights / weights.sum())[:-1].tolist(), strict=True))


# ---- a discrepancy, and what its users read in it


@dataclass(frozen=True)
class Discrepancy:
    r"""A Gaussian process beside a refitted model: :math:`r \sim N(0, s^2 E + t^2 D + U U^T + K)`.

    Parameters
    ----------
    residual : array, shape (n,)
        Readings less what all other data say of them.
    errors, specimens : array, shape (n, n)
        E of reading and D of specimens, whose sum is V; their sizes were fitted without a
        discrepancy, to which they have made room, so that s and t are found with it.
    shared : array, shape (n, k)
        U, of the parameters.
    inputs : array, shape (n, d)
        Of the process, each over its range.
    block : array of int, shape (n,)
        Kind of reading; each has a process of its own, −1 none.
    size : array, shape (n,)
        Of the readings of a kind, in which amplitudes are counted.
    predicted : array, shape (n,)
        f where there is a process, else 0.
    """

    residual: Floats
    errors: Floats
    specimens: Floats
    shared: Floats
    inputs: Floats
    block: NDArray[np.int64]
    size: Floats
    predicted: Floats

    @classmethod
    def of(cls, base: CandidateFit) -> "Discrepancy":
        """Return that of a calibrated base model."""
        linear, places = base.linear, base.subject.places
        values, vectors = np.linalg.eigh(base.uncertain)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        block, size = _blocks(places, linear.subject.observed)
        own = linear.subject.deviations(linear.mode)
        specimens = (own.slope * own.spread) @ own.slope.T
        return cls(
            linear.subject.observed - linear.mean,
            linear.scatter - specimens,
            specimens,
            linear.jacobian @ root,
            _inputs(places, block >= 0),
            block,
            size,
            np.where(block >= 0, linear.mean, 0.0),
        )

    def part(self, rows: NDArray[np.intp]) -> "Discrepancy":
        """Return that of some of the readings."""
        return Discrepancy(
            self.residual[rows],
            self.errors[np.ix_(rows, rows)],
            self.specimens[np.ix_(rows, rows)],
            self.shared[rows],
            self.inputs[rows],
            self.block[rows],
            self.size[rows],
            self.predicted[rows],
        )

    @property
    def kinds(self) -> int:
        """How many kinds of readings have a process."""
        return int(self.block.max()) + 1

    def without(self, logs: Floats) -> Floats:
        """Return the covariance without a process; the last logs are those of s and t."""
        error, scatter = np.exp(2.0 * logs[-2:])
        return np.asarray(
            error * self.errors + scatter * self.specimens + self.shared @ self.shared.T,
            dtype=np.float64,
        )

    def process(self, logs: Floats) -> Floats:
        """Return K: squared exponentials with ln lengths, ln amplitudes by kind; then ln of ρ's."""
        dimensions = self.inputs.shape[1]
        scaled = self.inputs / np.exp(logs[:dimensions])
        square = np.sum(scaled**2, axis=1)
        apart = np.maximum(square[:, None] + square - 2.0 * scaled @ scaled.T, 0.0)
        amplitude = np.exp(np.append(logs[dimensions : dimensions + self.kinds], -np.inf))
        height = amplitude[self.block] * self.size
        alike = self.block[:, None] == self.block
        factor = np.exp(logs[dimensions + self.kinds]) * self.predicted
        return np.asarray(
            np.exp(-0.5 * apart) * height[:, None] * height * alike + np.outer(factor, factor),
            dtype=np.float64,
        )

    def log_likelihood(self, covariance: Floats) -> float:
        """Return ln N(r; 0, C); −inf where C is not positive definite."""
        try:
            factor = cho_factor(covariance, lower=True, check_finite=False)
        except LinAlgError:
            return -np.inf
        quadratic = self.residual @ cho_solve(factor, self.residual, check_finite=False)
        return float(-0.5 * quadratic - np.sum(np.log(np.diag(factor[0]))))


def _blocks(places: Places, observed: Floats) -> tuple[NDArray[np.int64], Floats]:
    kinds = [kind for kind in dict.fromkeys(places.kind) if _is_actuator(places, kind)]
    block = np.full(len(places), -1)
    size = np.ones(len(places))
    for number, kind in enumerate(kinds):
        rows = places.kind == kind
        block[rows], size[rows] = number, np.sqrt(np.mean(observed[rows] ** 2))
    return block, size


def _is_actuator(places: Places, kind: str) -> bool:
    return bool(np.all(places.family[places.kind == kind] == "actuator"))


def _inputs(places: Places, rows: NDArray[np.bool_]) -> Floats:
    """Return pressure, degradation, the course of time and each history, over their ranges."""
    columns = [places.along, places.level, np.log1p(np.nan_to_num(places.time))]
    columns += [1.0 * (places.history == name) for name in dict.fromkeys(places.history)]
    varied = [column for column in columns if np.ptp(column[rows]) > 0.0]
    return np.stack([column / np.ptp(column[rows]) for column in varied], axis=1)


def kennedy_ohagan(study: FittedStudy) -> HiddenAnswer:
    """Say what the discrepancy of a study looks like."""
    whole = Discrepancy.of(study.base)
    step = -(-len(whole.residual) // LARGEST_FIT)
    logs, alone = _fitted(whole.part(np.arange(0, len(whole.residual), step)))
    gain = whole.log_likelihood(whole.without(logs) + whole.process(logs))
    gain -= whole.log_likelihood(whole.without(alone))
    p_value = float(stats.chi2.sf(2.0 * max(gain, 0.0), whole.kinds + 1))
    if p_value > MISFIT_LEVEL:
        return HiddenAnswer(study=study.name, outcome=Outcome.ADEQUATE, p_value=p_value)
    names, likeness, chances = _looked_at(study, whole, logs)
    sets = _said(names, chances) if likeness.max() >= LOOKS_LIKE else ()
    outcome = Outcome.UNEXPLAINED
    if sets:
        outcome = Outcome.NAMED if len(sets[0]) == 1 else Outcome.AMBIGUOUS
    return HiddenAnswer(
        study=study.name,
        outcome=outcome,
        sets=sets,
        p_value=p_value,
        probabilities=dict(zip(names, chances.tolist(), strict=True)) if sets else {},
    )


def _fitted(part: Discrepancy) -> tuple[Floats, Floats]:
    """Return ln of lengths, amplitudes, s and t with a process, and of s and t without one."""
    numbers = [part.inputs.shape[1], part.kinds, 1, 2]
    centre = np.repeat(CENTRES, numbers)
    width = np.repeat([LENGTH_PRIOR, AMPLITUDE_PRIOR, FACTOR_PRIOR, NOISE_PRIOR], numbers)

    def against(logs: Floats) -> float:
        count = len(logs)
        penalty = 0.5 * np.sum(((logs - centre[-count:]) / width[-count:]) ** 2)
        process = part.process(logs) if count > 2 else 0.0
        return min(float(penalty) - part.log_likelihood(part.without(logs) + process), 1e12)

    def least(start: Floats) -> Floats:
        reach = 4.0 * width[-len(start) :]
        bounds = np.stack([centre[-len(start) :] - reach, centre[-len(start) :] + reach], axis=1)
        how: dict[str, Any] = {"bounds": bounds, "options": {"maxiter": 40}}
        return np.asarray(minimize(against, start, method="L-BFGS-B", **how).x)

    alone = least(np.zeros(2))
    starts = (np.concatenate([np.repeat(np.log(start), numbers[:3]), alone]) for start in STARTS)
    return min(map(least, starts), key=against), alone


def _looked_at(
    study: FittedStudy, whole: Discrepancy, logs: Floats
) -> tuple[list[str], Floats, Floats]:
    """Return causes, how much the discrepancy looks like each, and how often most of all.

    Likeness is the correlation over the readings, weighed by what they know after a refit. What a
    cause would do is passed through the same smoother first.
    """
    without, process = whole.without(logs), whole.process(logs)
    known = cho_factor(without + process, lower=True)
    smoother = cho_solve(known, process).T
    rows = whole.block >= 0
    middle = smoother @ whole.residual
    spread = process - smoother @ process
    root = cholesky(
        spread + JITTER * np.diag(np.diag(process) + whole.size**2 * JITTER), lower=True
    )
    normal = np.random.default_rng(0).standard_normal((len(root), DRAWS))
    seen = np.column_stack([middle, middle[:, None] + root @ normal])
    seen[~rows] = 0.0
    weigh = cholesky(without, lower=True)
    seen = np.linalg.solve(weigh, seen)
    names = list(study.columns)
    by_name = {cause.name: cause for cause in study.causes}
    likeness = []
    for name in names:
        effect = smoother @ study.linear.whitening.coloured(study.columns[name])
        effect[~rows] = 0.0
        likeness.append(_correlation(seen, np.linalg.solve(weigh, effect), by_name[name]))
    alike = np.array(likeness)
    best = np.argmax(alike[:, 1:], axis=0)
    return names, alike[:, 0], np.bincount(best, minlength=len(names)) / DRAWS


def _correlation(seen: Floats, effect: Floats, cause: Cause) -> Floats:
    """Return the multiple correlation of columns with an effect, below 0 where its sign is none."""
    kept = effect[:, np.linalg.norm(effect, axis=0) > 0.0]
    if not kept.size:
        return np.full(seen.shape[1], -1.0)
    basis, _ = np.linalg.qr(kept)
    found = np.linalg.norm(basis.T @ seen, axis=0) / np.linalg.norm(seen, axis=0)
    first = cause.parameters[0]
    size = prior_size(first)
    one_sided = not np.isfinite(float(first.law.log_density(-size)))
    if one_sided and kept.shape[1] == 1:
        found *= np.sign(kept[:, 0] @ seen)
    return found


def _said(names: Sequence[str], chances: Floats) -> Sets:
    """Return the smallest set of causes that holds 80 % of the draws."""
    order = np.argsort(-chances)
    count = int(np.searchsorted(np.cumsum(chances[order]), HELD)) + 1
    return (tuple(names[place] for place in order[:count]),)


METHODS = {"closed_form": least_squares, "kennedy_ohagan": kennedy_ohagan}
"""By name."""
