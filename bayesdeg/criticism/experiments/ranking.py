r"""Ranking of experiments by the expected log Bayes factor between causes.

Under each cause the data so far determine the predictive distribution of a new experiment: draws θ
of the posterior give expected readings f(θ) and a covariance V(θ) of errors and specimens, so that
approximately

.. math:: y \mid c \sim N(\bar f, \mathrm{cov} f(\theta) + \bar V)

If a is the truth, the experiment is expected to add E[ln p_a(y) − ln p_b(y)] to the log Bayes
factor of a against b. It is averaged over readings simulated through the full equations.

References
----------
Kullback and Leibler (1951), Ann. Math. Stat. 22:79, doi:10.1214/aoms/1177729694; Box and Hill
(1967), Technometrics 9:57, doi:10.1080/00401706.1967.10490441, for designs that tell models apart.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cholesky, helmert, solve_triangular

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.findings import ExperimentEntry, PairEntry
from bayesdeg.criticism.fit.side_by_side import apply
from bayesdeg.criticism.fit.trials import CandidateFit, with_sizes
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import BEND_ANGLE, ActuatorCurves, Curvature, draw_readings
from bayesdeg.observations.noise import Linearised, covariance
from bayesdeg.observations.tensile import (
    TENSILE,
    Tensile,
    TensileCurves,
    film_readings,
    median_stresses,
    stress_variance,
)
from bayesdeg.observations.volume import CavityVolume
from bayesdeg.priors import Named, Parameter

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Measurement(Protocol):
    """Readings on new specimens of S kinds, several of each kind."""

    @property
    def copies(self) -> int:
        """Number of specimens of each kind."""
        ...

    @property
    def read(self) -> Flags:
        """Where there is a reading, (S, R)."""
        ...

    @property
    def errors(self) -> tuple[Parameter, ...]:
        """Parameters of its errors that the study's tests may lack."""
        ...

    def expected(self, model: JointModel, values: Named) -> Floats:
        """Return readings expected for named values (n,), shape (n, S, R); nan if refused."""
        ...

    def covariance(self, model: JointModel, values: Named) -> Floats:
        """Return the covariance of each kind's readings about them, (n, S, R, R)."""
        ...

    def simulated(self, model: JointModel, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of one specimen of each kind through the full equations, (n, S, R)."""
        ...


@dataclass(frozen=True)
class ActuatorTests:
    """Actuators under pressure.

    One row of curves a kind of specimen; what it holds of readings is not used.
    """

    curves: ActuatorCurves
    copies: int

    @property
    def read(self) -> Flags:
        """Where there is a reading: curvatures, then bend angles if there are any."""
        return self.curves.paths.mask

    errors = ()  # `with_noise` knows those of bend angles

    def expected(self, model: JointModel, values: Named) -> Floats:
        """Return curvatures [1/m], then bend angles [°] expected."""
        return Curvature(self.curves).predicted(model.tests(values)).mean

    def covariance(self, model: JointModel, values: Named) -> Floats:
        """Return their covariance, of specimens (linear in the stiffness) and errors."""
        return covariance(self.linearised(model, values))

    def linearised(self, model: JointModel, values: Named) -> Linearised:
        """Linearise them at no deviation of the specimens' ln stiffness."""
        tests, kind = model.tests(values), Curvature(self.curves)
        predicted = kind.predicted(tests)
        length = values["curvature_noise_length"]
        with_angle = self.curves.with_angle
        return Linearised(
            np.zeros_like(predicted.mean),
            predicted.slope[..., None],
            predicted.variance,
            kind.deviation_sd(tests) ** 2,
            length,
            values["reading_correlation"] if with_angle else np.zeros(len(length)),
            self.curves.paths,
        )

    def simulated(self, model: JointModel, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens."""
        return Curvature(self.curves).drawn(model.tests(values), generator)


@dataclass(frozen=True)
class VolumeTests:
    """Actuators under pressure with readings of cavity volume as well as curvature.

    Volumes are of the same specimens, read at every pressure; what was read is not used, but its
    largest scales the constant error of reading.
    """

    bent: ActuatorTests
    volumes: CavityVolume

    @property
    def copies(self) -> int:
        """Number of specimens of each kind."""
        return self.bent.copies

    @property
    def read(self) -> Flags:
        """Where there is a reading: those of the shape, then volumes."""
        return np.concatenate([self.bent.read, self.volumes.tests.mask], axis=1)

    @property
    def errors(self) -> tuple[Parameter, ...]:
        """Those of reading volumes, and that of the emulator."""
        return (*self.volumes.parameters, *self.volumes.error_parameters)

    def expected(self, model: JointModel, values: Named) -> Floats:
        """Return readings of the shape, then volumes [ml] expected."""
        swept = self._placed(self.volumes.expected(model.tests(values)))
        return np.concatenate([self.bent.expected(model, values), swept], axis=-1)

    def covariance(self, model: JointModel, values: Named) -> Floats:
        """Return their covariance: a specimen's stiffness is in both, errors are independent."""
        shape = self.bent.linearised(model, values)
        volume = self.volumes.linearised(model.tests(values))
        bent, count = shape.slope.shape[-2], shape.slope.shape[-2] + volume.slope.shape[-2]
        total = np.empty((*shape.slope.shape[:2], count, count))
        total[..., :bent, :bent] = covariance(shape)
        total[..., bent:, bent:] = covariance(volume)
        both = shape.slope * shape.spread[..., None] @ volume.slope.swapaxes(-1, -2)
        total[..., :bent, bent:], total[..., bent:, :bent] = both, both.swapaxes(-1, -2)
        return total

    def simulated(self, model: JointModel, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens."""
        state = model.tests(values)
        shape = state.recomputed(draw_readings, self.bent.curves, generator).readings
        swept = self._placed(self.volumes.simulate(state, generator))
        return np.concatenate([shape, swept], axis=-1)

    def _placed(self, volumes: Floats) -> Floats:
        """Return volumes (n, k) as (n, S, R); there is one at every pressure."""
        return volumes.reshape(len(volumes), *self.volumes.tests.mask.shape)


@dataclass(frozen=True)
class FilmTests:
    """Films in tension.

    One row of curves a kind of specimen; what it holds of stresses is not used.
    """

    curves: TensileCurves
    copies: int

    @property
    def read(self) -> Flags:
        """Where there is a reading."""
        return self.curves.mask

    errors = ()  # `with_noise` knows those of stresses

    def expected(self, model: JointModel, values: Named) -> Floats:
        """Return stresses expected [MPa]."""
        return median_stresses(model.state(values), self.curves).at_rest

    def covariance(self, model: JointModel, values: Named) -> Floats:
        """Return their covariance, linear in stiffness and degradation rate, and of errors."""
        data = self.curves
        shape = (len(values["stiffness_scatter"]), len(data.specimens), 2)
        stress, slope = film_readings(median_stresses(model.state(values), data), np.zeros(shape))
        spread = np.empty(shape)
        spread[..., 0] = values["stiffness_scatter"][:, None] ** 2
        spread[..., 1] = data.degradation_sd**2
        linearised = Linearised(
            np.zeros_like(stress),
            slope,
            stress_variance(values, stress),
            spread,
            values["tensile_noise_length"],
            np.zeros(len(stress)),
            data.paths,
        )
        return covariance(linearised)

    def simulated(self, model: JointModel, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new films."""
        return Tensile(self.curves).drawn(model.state(values), generator)


def with_noise(
    values: Named, generator: np.random.Generator, errors: tuple[Parameter, ...] = ()
) -> dict[str, Floats]:
    """Return named values with the prior noise of quantities never read so far.

    Also of further errors of reading, of a measurement of its own kind.
    """
    count = len(values["stiffness_scatter"])
    unknown = [p for p in (*BEND_ANGLE, *TENSILE, *errors) if p.name not in values]
    return {**values, **{p.name: p.law.sample(generator, count) for p in unknown}}


DRAWS = 600
NO_CAUSE = "no cause"


@dataclass(frozen=True)
class Hypothesis:
    """A possible model, and draws of its parameters.

    The name is of the cause or causes by which it differs from the others; draws (n, n_parameters)
    are on the sampler's scale.
    """

    name: str
    model: JointModel
    draws: Floats


def hypotheses_of(
    trials: Sequence[CandidateFit],
    generator: np.random.Generator,
    *,
    untested: Sequence[Cause] = (),
    draws: int = DRAWS,
) -> tuple[Hypothesis, ...]:
    """Return fitted models as hypotheses, and with each untested cause added to the smallest.

    Causes that all models have in common are not in question. Of untested causes, which the data so
    far cannot reveal, the prior of their sizes is known.
    """
    common = frozenset.intersection(*(trial.names for trial in trials))
    found = [
        Hypothesis(
            " and ".join(sorted(trial.names - common)) or NO_CAUSE,
            trial.subject,
            trial.draws(generator, draws),
        )
        for trial in trials
    ]
    smallest = min(trials, key=lambda trial: len(trial.names))
    for cause in untested:
        vectors = with_sizes(smallest.subject, cause, smallest.draws(generator, draws), generator)
        found.append(Hypothesis(cause.name, smallest.subject.extended(cause), vectors))
    return tuple(found)


ANSWERED = 0.9  # share of draws that must be computable at a reading
COMPLETE = 0.5  # and share of draws that must be computable at all readings
SCATTERS = 50  # draws over which the scatter of readings is averaged
SIMULATED = 300  # data sets


@dataclass(frozen=True)
class ReadingsLaw:
    """Normal law of the readings of k specimens tested in the same way.

    Parameters
    ----------
    mean : array, shape (d,)
        Of each specimen.
    common : array, shape (d, d)
        Covariance of what all specimens share: the parameters.
    own : array, shape (d, d)
        Covariance of what is each specimen's own: reading error and scatter.
    copies : int
        k.
    """

    mean: Floats
    common: Floats
    own: Floats
    copies: int

    def log_density(self, readings: Floats) -> Floats:
        """Return the log density of readings (k, n, d), shape (n,).

        An orthogonal turn of the specimens leaves their mean, times √k, with covariance
        V + k C, and k − 1 contrasts with covariance V.
        """
        k = self.copies
        total = _log_normal(
            np.sqrt(k) * (readings.mean(axis=0) - self.mean), self.own + k * self.common
        )
        if k > 1:
            contrasts = np.tensordot(helmert(k), readings, axes=1)
            flat = _log_normal(contrasts.reshape(-1, contrasts.shape[-1]), self.own)
            total = total + flat.reshape(contrasts.shape[:2]).sum(axis=0)
        return total

    def divergence(self, other: "ReadingsLaw") -> float:
        """Return the Kullback–Leibler divergence to another law of as many specimens [nats].

        It is the expected log Bayes factor if the readings have this law.

        Examples
        --------
        >>> one = np.eye(1)
        >>> near, far = (ReadingsLaw(np.array([m]), 0.0 * one, one, 3) for m in (0.0, 2.0))
        >>> round(near.divergence(far), 6)  # ½ (2/1)² for each of 3 specimens
        6.0
        """
        k = self.copies
        shift = np.sqrt(k) * (self.mean - other.mean)
        along = _divergence(shift, self.own + k * self.common, other.own + k * other.common)
        across = _divergence(np.zeros_like(shift), self.own, other.own) if k > 1 else 0.0
        return along + (k - 1) * across


class PredictiveReadings(NamedTuple):
    """The law of readings under one hypothesis, and readings drawn under it (k, n, d)."""

    law: ReadingsLaw
    drawn: Floats


class Separation(NamedTuple):
    """Expected log Bayes factor of the truth, and its Monte Carlo standard error [nats]."""

    expected: float
    error: float


def predictive_readings(
    hypotheses: Sequence[tuple[JointModel, Named]],
    measurement: Measurement,
    generator: np.random.Generator,
) -> list[PredictiveReadings]:
    """Return the law of the readings under each hypothesis, and readings drawn under it.

    From models with named draws of their parameters (n,); empty where too little of the readings
    can be predicted.
    """
    expected = [measurement.expected(model, values) for model, values in hypotheses]
    answered = [np.mean(np.isfinite(one), axis=0) >= ANSWERED for one in expected]
    usable = measurement.read & np.logical_and.reduce(answered)
    found = []
    for (model, values), means in zip(hypotheses, expected, strict=True):
        complete = np.all(np.isfinite(means[:, usable]), axis=1)
        if not usable.any() or complete.mean() < COMPLETE:
            return []
        known = {name: value[complete] for name, value in values.items()}
        own = measurement.covariance(model, _first(known, SCATTERS)).mean(axis=0)
        blocks = [one[np.ix_(row, row)] for one, row in zip(own, usable, strict=True)]
        answers = means[complete][:, usable]
        law = ReadingsLaw(
            answers.mean(axis=0),
            np.atleast_2d(np.cov(answers.T)),
            np.asarray(block_diag(*blocks)),
            measurement.copies,
        )
        some = _first(known, SIMULATED)
        copies = [measurement.simulated(model, some, generator) for _ in range(measurement.copies)]
        drawn = np.stack(copies)[:, :, usable]
        drawn = drawn[:, np.all(np.isfinite(drawn), axis=(0, 2))]
        if not drawn.shape[1]:
            return []
        found.append(PredictiveReadings(law, drawn))
    return found


def separation(
    first: PredictiveReadings, second: PredictiveReadings
) -> tuple[Separation, Separation]:
    """Return the expectations if the first is true, and if the second is."""
    return _expected(first, second.law), _expected(second, first.law)


def _first(values: Named, count: int) -> dict[str, Floats]:
    return {name: value[:count] for name, value in values.items()}


def _expected(truth: PredictiveReadings, other: ReadingsLaw) -> Separation:
    ratio = truth.law.log_density(truth.drawn) - other.log_density(truth.drawn)
    return Separation(float(ratio.mean()), float(ratio.std() / np.sqrt(len(ratio))))


def _log_normal(residual: Floats, covariance: Floats) -> Floats:
    """Return ln N(r; 0, C) of residuals (n, d), less the constant."""
    factor = cholesky(covariance, lower=True)
    z = solve_triangular(factor, residual.T, lower=True)
    density: Floats = -0.5 * np.sum(z**2, axis=0) - np.sum(np.log(np.diag(factor)))
    return density


def _divergence(shift: Floats, first: Floats, second: Floats) -> float:
    factor, other = cholesky(second, lower=True), cholesky(first, lower=True)
    z = solve_triangular(factor, shift, lower=True)
    ratio = solve_triangular(factor, other, lower=True)
    logs = np.sum(np.log(np.diag(factor))) - np.sum(np.log(np.diag(other)))
    return float(0.5 * (np.sum(ratio**2) + z @ z - len(shift)) + logs)


LEAST = 1.0
"""Least expected log Bayes factor of an experiment that tells two causes apart."""
MOST = 8


@dataclass(frozen=True)
class ExperimentPlan:
    """Instructions of an experiment.

    Parameters
    ----------
    kind : str
        Experiments of one kind differ in degradation rate or mount alone; the best is kept.
    specimens : int
        What it costs.
    levels : tuple of float
        Degradation rates of the specimens [%].
    low, top : float
        Ends of the pressure steps [kPa].
    timed : bool
        Whether the study recorded times, which the experiment needs.
    mount : str
        How the actuator is held, where that is new.
    temperature_c : float
        Of the room, where that is new [°C].
    batch : str
        What the study calls that of the specimens, where it matters; empty for those of which none
        is recorded.
    hold_s : float
        How long a pressure is held [s].
    steps : int
        Readings along the path of a specimen.
    """

    kind: str
    specimens: int
    levels: tuple[float, ...]
    low: float = float("nan")
    top: float = float("nan")
    timed: bool = True
    mount: str = ""
    temperature_c: float = float("nan")
    batch: str = ""
    hold_s: float = 0.0
    steps: int = 1


@dataclass(frozen=True)
class Experiment:
    """A further experiment: what to do, and what would be read."""

    plan: ExperimentPlan
    measurement: Measurement

    @property
    def kind(self) -> str:
        """Kind of experiment."""
        return self.plan.kind

    @property
    def specimens(self) -> int:
        """Cost."""
        return self.plan.specimens

    @property
    def readings(self) -> int:
        """Number of readings."""
        return self.measurement.copies * int(self.measurement.read.sum())


@dataclass(frozen=True)
class Pair:
    """Expected contribution of an experiment to the log Bayes factor between two causes.

    `expected` is the smaller of the expectations with either as the truth [nats]: at least that
    much is to be expected; `error` is its Monte Carlo standard error.
    """

    causes: tuple[str, str]
    expected: float
    error: float


@dataclass(frozen=True)
class Ranked:
    """An experiment and its expected evidence.

    Pairs are all pairs of hypotheses, the best told apart first.
    """

    experiment: Experiment
    pairs: tuple[Pair, ...]

    @property
    def told_apart(self) -> int:
        """Number of pairs with an expected log Bayes factor of at least `LEAST`."""
        return sum(pair.expected >= LEAST for pair in self.pairs)

    @property
    def decisive(self) -> Pair:
        """The worst of the pairs that it tells apart; the best pair if it tells none apart."""
        return self.pairs[max(self.told_apart, 1) - 1]


def rank(
    trials: Sequence[CandidateFit],
    experiments: Sequence[Experiment],
    generator: np.random.Generator,
    *,
    untested: Sequence[Cause] = (),
    executor: Executor | None = None,
) -> tuple[Ranked, ...]:
    """Rank experiments by their expected evidence between the models in question.

    With more than two models, experiments that tell more pairs apart come first, then those with
    the larger expected log Bayes factor for the worst of these pairs; ties (0.1) go by cost.

    Between fitted models that the data so far do not tell apart, as a cause and its rivals, and
    untested causes that they cannot reveal. The best of each kind is returned; nothing with fewer
    than two models, and no experiment for which the forward map has no answer.
    """
    if len(trials) + len(untested) < 2 or not trials:
        return ()
    return rank_hypotheses(
        hypotheses_of(trials, generator, untested=untested),
        experiments,
        generator,
        executor=executor,
    )


def rank_hypotheses(
    hypotheses: Sequence[Hypothesis],
    experiments: Sequence[Experiment],
    generator: np.random.Generator,
    *,
    executor: Executor | None = None,
) -> tuple[Ranked, ...]:
    """Rank experiments by their expected evidence between hypotheses, as `rank` does."""
    best: dict[str, Ranked] = {}
    children = generator.spawn(len(experiments))
    jobs = [(e.measurement, child) for e, child in zip(experiments, children, strict=True)]
    found = apply(partial(_compared, hypotheses), jobs, executor)
    for experiment, pairs in zip(experiments, found, strict=True):
        if not pairs:
            continue
        one = Ranked(experiment, pairs)
        known = best.get(experiment.kind)
        if known is None or _order(one) < _order(known):
            best[experiment.kind] = one
    return tuple(sorted(best.values(), key=_order))


def _compared(
    hypotheses: Sequence[Hypothesis], job: tuple[Measurement, np.random.Generator]
) -> tuple[Pair, ...]:
    return compare(hypotheses, *job)


def compare(
    hypotheses: Sequence[Hypothesis], measurement: Measurement, generator: np.random.Generator
) -> tuple[Pair, ...]:
    """Return the expected evidence of a measurement for every pair, the best first.

    Readings are left out if any hypothesis refuses more than a tenth of its draws there; the
    result is empty if that leaves none, or less than half of the draws of a hypothesis.
    """
    named = [
        (one.model, with_noise(one.model.table.named(one.draws), generator, measurement.errors))
        for one in hypotheses
    ]
    foretold = predictive_readings(named, measurement, generator)
    pairs = []
    for (a, first), (b, second) in combinations(zip(hypotheses, foretold, strict=False), 2):
        smaller = min(separation(first, second), key=lambda one: one.expected)
        pairs.append(Pair((a.name, b.name), smaller.expected, smaller.error))
    return tuple(sorted(pairs, key=lambda pair: -pair.expected))


def next_experiments_document(
    ranked: Sequence[Ranked], word: Callable[[ExperimentPlan], str], *, most: int = MOST
) -> tuple[ExperimentEntry, ...]:
    """Return ``next_experiments`` of ``verdict.json``: the best ones that tell causes apart.

    At most so many, each plan worded by a function.

    Examples
    --------
    >>> next_experiments_document((), str)
    ()
    """
    useful = [entry for entry in ranked if entry.told_apart]
    return tuple(
        ExperimentEntry(
            design=word(one.plan),
            separates=pair.causes,
            expected_log_bayes_factor=round(pair.expected, 2),
            monte_carlo_error=round(pair.error, 2),
            specimens=one.specimens,
            readings=one.readings,
            per_specimen=round(pair.expected / one.specimens, 2),
            pairs=tuple(
                PairEntry(causes=p.causes, expected_log_bayes_factor=round(p.expected, 2))
                for p in pairs
            ),
        )
        for one, pair, pairs in ((e.experiment, e.decisive, e.pairs) for e in useful[:most])
    )


def _order(entry: Ranked) -> tuple[float, ...]:
    size = round(entry.decisive.expected, 1)
    return -entry.told_apart, -size, entry.experiment.specimens, entry.experiment.readings
