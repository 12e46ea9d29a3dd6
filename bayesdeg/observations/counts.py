"""Counts of actuators that burst below a pressure: published, or from a study's own tests.

Actuators of a level differ only in stiffness and strength. One of them bursts with probability

    p = Σ_q w_q F( ln[(λ_q − 1)/(λ_b − 1)] / s ),

F the law of strengths, over a Gauss–Hermite rule for its stiffness, and the count is binomial.
Every cause of the model acts on these tests as on those of the study: a fast first loading in a
horizontal mount, in the room of the study's own tests if its humidity is known.

Counts are not part of a base model: one without flaws may find them almost impossible, and would
distort its stiffness to explain them (two of three at 25 % and none below, of
doi:10.3389/frobt.2021.760485, give a material three times as soft as its films). They are compared
with the model (`bayesdeg.criticism.checks.count_misfit`) and join it with a cause of ruptures.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple, override

import numpy as np
import scipy
from numpy.typing import NDArray

from bayesdeg.causes.cause import Conditions
from bayesdeg.data.levels import levels
from bayesdeg.material.strength import Strength
from bayesdeg.observations.arrays import chosen
from bayesdeg.observations.curvature import ActuatorCurves, mechanics_inputs, parts_of
from bayesdeg.observations.kinds import Observations, Parts, Rows, State
from bayesdeg.observations.noise import event_signal
from bayesdeg.observations.rupture import strength_of
from bayesdeg.observations.specimens import FilmsAndActuators

Floats = NDArray[np.float64]

SMALLEST_ELONGATION = 1e-6
"""Strain of a wall that pressure does not stretch; its logarithm must be finite."""
STIFFNESS_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
"""Gauss–Hermite rule for the specimen's own stiffness, in standard deviations."""
_LOG_WEIGHTS = np.log(_WEIGHTS / np.sum(_WEIGHTS))


class Chances(NamedTuple):
    """Log probabilities that a specimen bursts, and that it does not, (n, n_levels).

    nan where the mean specimen has no solution.
    """

    burst: Floats
    whole: Floats


def rupture_chances(peak_stretch: Floats, strength: Strength) -> Chances:
    r"""Return the log probabilities that a specimen of a level bursts or survives.

    .. math:: p = \sum_q w_q (1 - S(\lambda_q - 1))

    with S of `Strength.log_whole`. In logarithms throughout, so that nearly impossible outcomes get
    a very small probability and not zero.

    Parameters
    ----------
    peak_stretch : array, shape (n, n_levels, 7)
        Stretch demanded at the largest pressure at the nodes of the rule [–]. Nodes with nan are
        left out and the rest reweighted; everything is nan if the middle one, the mean specimen,
        is.
    strength : Strength
        Strength of the walls of each level, (n, n_levels).
    """
    answered = np.isfinite(peak_stretch[..., len(STIFFNESS_NODES) // 2])
    known = np.isfinite(peak_stretch) | ~answered[..., None]
    elongation = np.maximum(
        np.where(np.isfinite(peak_stretch), peak_stretch, 2.0) - 1.0, SMALLEST_ELONGATION
    )
    log_strain, walls = np.log(elongation), strength.mapped(lambda array: array[..., None])
    weight = np.where(known, _LOG_WEIGHTS, -np.inf)
    weight = weight - scipy.special.logsumexp(weight, axis=-1, keepdims=True)
    burst = scipy.special.logsumexp(weight + walls.log_broken(log_strain), axis=-1)
    whole = scipy.special.logsumexp(weight + walls.log_whole(log_strain), axis=-1)
    return Chances(np.where(answered, burst, np.nan), np.where(answered, whole, np.nan))


def log_count(ruptured: Floats, tested: Floats, chances: Chances) -> Floats:
    """Return the binomial log probability of counts, broadcast to a common shape.

    Examples
    --------
    >>> even = Chances(np.log([0.5]), np.log([0.5]))
    >>> np.exp(log_count(np.array([2.0]), np.array([3.0]), even)).round(6)
    array([0.375])
    """
    gammaln = scipy.special.gammaln
    ways = gammaln(tested + 1.0) - gammaln(ruptured + 1.0) - gammaln(tested - ruptured + 1.0)
    with np.errstate(invalid="ignore"):  # 0 times the logarithm of 0
        some = np.where(ruptured > 0.0, ruptured * chances.burst, 0.0 * np.isnan(chances.burst))
        rest = tested - ruptured
        others = np.where(rest > 0.0, rest * chances.whole, 0.0)
    found: Floats = ways + np.where(np.isnan(chances.burst), np.nan, some + others)
    return found


@dataclass(frozen=True)
class CountedTests:
    """Actuators with known numbers of ruptures, level by level.

    Parameters
    ----------
    specimens : tuple of str
        Names of the levels.
    degradation, degradation_sd : array, shape (n_levels, 1)
        D_R and its standard error from specimen to specimen [%].
    pressure : array, shape (n_levels,)
        Largest test pressure [kPa].
    tested, ruptured : array, shape (n_levels,)
        Number of actuators, and of those that burst.
    humidity : array, shape (n_levels,)
        Relative humidity of the room [%]; nan if unknown, as for published counts.
    """

    specimens: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    tested: Floats
    ruptured: Floats
    humidity: Floats = field(default_factory=lambda: np.array(np.nan))

    def __post_init__(self) -> None:
        """Broadcast a common humidity to all levels."""
        shape = self.pressure.shape
        object.__setattr__(self, "humidity", np.broadcast_to(self.humidity, shape))

    @cached_property
    def conditions(self) -> Conditions:
        """Test conditions: one reading at the largest pressure for each node of stiffness."""
        pressure = self.pressure[:, None] * np.ones(len(STIFFNESS_NODES))
        return Conditions(pressure, self.degradation, humidity=self.humidity[:, None])


def counted_by_level(curves: ActuatorCurves) -> CountedTests:
    """Return how many of a study's own actuators burst, by nominal level.

    Each level counts as tested up to the largest pressure that any of its actuators reached, at the
    median humidity of its tests.
    """
    centres, member = levels(curves.degradation[:, 0])
    burst = curves.ruptured.any(axis=1)
    largest = np.max(np.where(curves.recorded, curves.pressure, 0.0), axis=1)
    rows = [np.flatnonzero(member == k) for k in range(len(centres))]
    room = np.ma.masked_invalid(curves.conditions.room_humidity)
    return CountedTests(
        specimens=tuple(f"ruptures at {centre:.3g} %" for centre in centres),
        degradation=centres[:, None],
        degradation_sd=np.array([[curves.degradation_sd[row].mean()] for row in rows]),
        pressure=np.array([largest[row].max() for row in rows]),
        tested=np.array([float(len(row)) for row in rows]),
        ruptured=np.array([float(burst[row].sum()) for row in rows]),
        humidity=np.array([np.ma.filled(np.ma.median(room[row]), np.nan) for row in rows]),
    )


class Demand(NamedTuple):
    """Stretch demanded of the actuators of each level at the largest pressure.

    Parameters
    ----------
    stretch : array, shape (n, n_levels, 7)
        Peak stretch over the nodes of stiffness [–]; nan where the forward map has no solution.
    excess : array, shape (n, n_levels)
        Distance outside the forward map's range for the mean specimen, if the map continues
        there: the likelihood falls with its square; else 0.
    """

    stretch: Floats
    excess: Floats


def demand_of(state: State[FilmsAndActuators], tests: CountedTests) -> Demand:
    """Return the stretch demanded of the actuators of each level at the largest pressure."""
    spread = state.once(parts_of, tests).spread
    deviation = np.sqrt(spread)[..., None] * STIFFNESS_NODES
    prediction = state.world.answer(mechanics_inputs(state, tests, deviation), state.values)
    answered = prediction.status == 0
    stretch = np.where(answered, prediction.peak_stretch, np.nan)
    mean = answered[..., len(STIFFNESS_NODES) // 2]
    if prediction.excess is None:
        return Demand(stretch, np.zeros(mean.shape))
    excess = np.broadcast_to(prediction.excess, stretch.shape)[..., len(STIFFNESS_NODES) // 2]
    whole = np.where(mean[..., None], stretch, prediction.peak_stretch)
    return Demand(whole, np.where(mean, 0.0, excess))


def chances_of(state: State[FilmsAndActuators], tests: CountedTests) -> Chances:
    """Return the log probabilities that an actuator of each level bursts or survives."""
    return rupture_chances(state.once(demand_of, tests).stretch, strength_of(state, tests))


@dataclass(frozen=True)
class RuptureCounts(Observations):
    """Counts of ruptures.

    Parameters
    ----------
    tests : CountedTests
        At least one level.
    """

    name: ClassVar[str] = "ruptures"
    order: ClassVar[int] = 70
    uses_forward: ClassVar[bool] = True

    tests: CountedTests

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return self.tests.specimens

    @property
    @override
    def specimens(self) -> tuple[str, ...]:
        return ()

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        excess = state.once(demand_of, self.tests).excess
        found: Floats = self._log_count(state) - 0.5 * excess**2
        return found

    @override
    def factors(self, state: State[FilmsAndActuators]) -> Parts:
        log_probability = self._log_count(state)
        excess = state.once(demand_of, self.tests).excess
        events = (log_probability, event_signal(log_probability)), (-0.5 * excess**2, excess)
        return Parts(events=events)

    def _log_count(self, state: State[FilmsAndActuators]) -> Floats:
        return log_count(self.tests.ruptured, self.tests.tested, chances_of(state, self.tests))

    @override
    def subset(self, rows: Rows) -> "RuptureCounts":
        return RuptureCounts(chosen(self.tests, rows))
