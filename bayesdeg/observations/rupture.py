"""Pressures at which actuators burst, or which they survived."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, override

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.causes.cause import StrengthConditions
from bayesdeg.causes.fold import applied
from bayesdeg.material.strength import Strength, draw_scores
from bayesdeg.observations.curvature import (
    ActuatorCurves,
    AtPressures,
    Curvature,
    draw_readings,
    estimated_degradation,
    linearise_actuators,
    log_density,
    no_actuators,
)
from bayesdeg.observations.kinds import Grouped, Observations, Parts, Rows, State
from bayesdeg.observations.noise import event_signal
from bayesdeg.observations.specimens import (
    FilmsAndActuators,
    elongation_spread,
    has_elongation,
    shared,
)
from bayesdeg.observations.volume import CavityVolume
from bayesdeg.priors import Parameter

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def strength_of(state: State[FilmsAndActuators], data: AtPressures) -> Strength:
    """Return the elongation limit of the actuators, (n, n_specimens)."""
    values, believed = state.values, state.once(estimated_degradation, data)
    level, world = believed.value, state.world
    slope = world.elongation_slope(values, shared(level))
    spread = elongation_spread(values, slope, believed.sd)
    median = world.elongation(values, shared(level)) / 100.0
    strength = Strength(median, np.sqrt(spread), world.scatter_law)
    conditions = StrengthConditions(level, data.conditions.room_humidity, slope)
    return applied("on_strength", strength, conditions, state.acting(axes=1))


def log_rupture(data: ActuatorCurves, prediction: Prediction, strength: Strength) -> Floats:
    r"""Return log probabilities that each specimen burst where it did, or survived, (n, S).

    A specimen bursts when the stretch demanded by its pressure exceeds its own limit, of which
    ln ε_b, ε = λ − 1, has the median ln ε̃, the sd s and a law F of scores: survived up to p, burst
    at p' it has :math:`F(z(p')) - F(z(p))`, one that did not burst :math:`1 - F(z(p))`. A pressure
    without a solution demands an infinite stretch of a specimen that burst there, and is
    uninformative for one that survived it; without strain nothing bursts. Of earlier cycles only
    pressures survived below that of the rupture count: fatigue is not modelled.

    Parameters
    ----------
    data : ActuatorCurves
        Curves with the survived pressures.
    prediction : Prediction
        At the specimens' most probable stiffness.
    strength : Strength
        ε̃ [–], s and the law of the specimens, (n, n_specimens).
    """
    ruptures = data.ruptures
    rows = np.arange(len(data.specimens))

    def demand(at: NDArray[np.int64], *, refused: float) -> tuple[Floats, Floats]:
        strain = prediction.peak_stretch[:, rows, at] - 1.0
        if np.isinf(refused) and refused > 0.0 and prediction.excess is not None:
            strain = np.where(prediction.excess[:, rows, at] > 0.0, np.nan, strain)
        share = prediction.peak_stretch_sd[:, rows, at] / np.maximum(strain, 1e-12)
        stretched = strain > 0.0
        known = np.log(np.where(stretched, strain, 1.0))
        log_strain = np.where(stretched, known, np.where(np.isfinite(strain), -np.inf, refused))
        reached = at >= 0
        return np.where(reached, log_strain, refused), np.where(reached & stretched, share, 0.0)

    return strength.log_broken_between(
        demand(ruptures.survived, refused=-np.inf), demand(ruptures.burst, refused=np.inf)
    )


@dataclass(frozen=True)
class Rupture(Grouped):
    """Whether each actuator burst, on the specimens whose curvature was read.

    It needs the parameters of the elongation at break.

    Parameters
    ----------
    tests : ActuatorCurves
        The same as those of `bayesdeg.observations.curvature.Curvature`: predictions at the
        specimens' most probable stiffness are computed once for both.
    """

    name: ClassVar[str] = "rupture"
    order: ClassVar[int] = 30
    is_criticised: ClassVar[bool] = True
    follows: ClassVar[str] = "actuator"
    uses_forward: ClassVar[bool] = True

    tests: ActuatorCurves = field(default_factory=no_actuators)

    @override
    def linked(self, others: tuple[Observations, ...]) -> "Rupture":
        """Return it with the curvatures' own arrays, so that predictions serve both."""
        read = (one.tests for one in others if isinstance(one, Curvature))
        alike = (tests for tests in read if tests.specimens == self.labels)
        return replace(self, tests=next(alike, self.tests))

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return self.tests.specimens

    @property
    def events(self) -> int:
        """Number of specimens that burst."""
        return int(self.tests.ruptured.any(axis=1).sum())

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        prediction = state.once(log_density, self.tests)[1]
        return log_rupture(self.tests, prediction, strength_of(state, self.tests))

    @override
    def factors(self, state: State[FilmsAndActuators]) -> Parts:
        predicted = state.once(linearise_actuators, self.tests)[1]
        strength = strength_of(state, self.tests)
        log_probability = log_rupture(self.tests, predicted.prediction, strength)
        return Parts(events=((log_probability, event_signal(log_probability)),))

    @override
    def subset(self, rows: Rows) -> "Rupture":
        return Rupture(self.tests.subset(rows))

    @override
    def replicated(
        self,
        state: State[FilmsAndActuators],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        """Simulate ruptures at the first pressure that demands more than the specimen's limit.

        Later rows are removed, also from readings drawn before.
        """
        data = self.tests
        readings, predicted, _ = state.once(draw_readings, data, generator)
        burst = self._bursts(state, predicted.prediction, generator)
        before = np.cumsum(burst, axis=1) == 0
        cut = replace(
            data,
            mask=data.mask & before,
            angle_mask=data.angle_mask & before,
            recorded=data.recorded & (before | burst),
            ruptured=burst,
        ).with_readings(readings[0])
        kept: list[Observations] = []
        for one in drawn:
            if isinstance(one, Curvature):
                kept.append(Curvature(cut))
            elif isinstance(one, CavityVolume):
                tests = replace(one.tests, mask=one.tests.mask & before)
                kept.append(replace(one, tests=tests))
            else:
                kept.append(one)
        return (*kept, Rupture(cut))

    def _bursts(
        self,
        state: State[FilmsAndActuators],
        prediction: Prediction,
        generator: np.random.Generator,
    ) -> Flags:
        """Return the recorded rows at which actuators burst, (n_specimens, n_points).

        The emulator's error of ln strain is drawn once per specimen, so the demanded stretch grows
        with pressure; at each pressure it has the law of the likelihood (approximately with flaws,
        as the error is small relative to the scatter).
        """
        data, strength = self.tests, strength_of(state, self.tests)
        z = draw_scores(strength.median.shape, generator, strength.law)
        limit = np.log(strength.limit(z))
        strain = prediction.peak_stretch - 1.0
        share = prediction.peak_stretch_sd / np.maximum(strain, 1e-12)
        error = share * generator.standard_normal((*z.shape, 1))
        known = np.isfinite(strain) & (strain > 0.0)
        demanded = np.where(known, np.log(np.where(known, strain, 1.0)) + error, np.inf)
        over = data.recorded & (data.pressure > 0.0) & (demanded > limit[..., None])[0]
        first: Flags = over & (np.cumsum(over, axis=1) == 1)
        return first


def from_observations(found: tuple[Observations, ...]) -> tuple[Rupture, ...]:
    """Return the ruptures of actuators, if there is information on elongation at break."""
    limited = any(len(one.elongation_levels) for one in found)
    return tuple(Rupture(one.tests) for one in found if limited and isinstance(one, Curvature))


def data_of_actuators(
    curves: ActuatorCurves, base: tuple[Parameter, ...]
) -> tuple[Observations, ...]:
    """Return the data of tests of actuators, with ruptures if a model has an elongation limit.

    Parameters
    ----------
    curves : ActuatorCurves
        The tests.
    base : tuple of Parameter
        Of the model.
    """
    return (Curvature(curves), *((Rupture(curves),) if has_elongation(base) else ()))
