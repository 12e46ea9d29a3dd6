"""Experiments that tell apart terms that would remove a misfit.

A term in known quantities becomes a cause that acts on the reading: the model is fitted again with
it, and experiments are ranked between such models as between any others.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.criticism.checks.known_terms import (
    BATCH,
    BRANCH,
    CYCLE,
    DEGRADATION,
    HUMIDITY,
    LAG,
    LOAD,
    MOUNT,
    PATHS,
    RATE,
    SIZE,
    TIME,
    KnownColumns,
    KnownTerm,
    moduli_at,
)
from bayesdeg.criticism.checks.missing_terms import MissingTerms
from bayesdeg.criticism.fit.linear import Linear
from bayesdeg.criticism.fit.trials import CandidateFit, try_causes
from bayesdeg.data.levels import LEVEL_WIDTH, levels
from bayesdeg.observations.curvature import ACTUATOR, ANGLE, CURVATURE
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.priors import Normal, Parameter

Floats = NDArray[np.float64]

WIDE = 2.0
"""Standard deviation of the prior of a term's size, over the size found: hardly informative."""
IN_QUESTION = 3  # terms between which experiments are ranked


@dataclass(frozen=True)
class TermOnReading:
    """A forward map of actuators modified by a term.

    `moduli` are 6 C1 [MPa] at the degradation rates of the study's specimens [%], (m,).
    """

    term: KnownTerm
    rates: Floats
    moduli: Floats

    def __call__(
        self, prediction: Prediction, conditions: Conditions, effect: Effect
    ) -> Prediction:
        """Return the prediction with the term at a size."""
        size = effect["size"] / self.term.per_unit
        steep = np.divide(prediction.slope, np.maximum(conditions.pressure, 1e-9))
        curvature = size * self._change(CURVATURE, conditions, prediction.curvature, steep)
        if ANGLE not in self.term.kinds:
            return replace(prediction, curvature=prediction.curvature + curvature)
        bent = prediction.curvature
        ratio = np.divide(prediction.bend_angle, bent, out=np.zeros_like(bent), where=bent != 0.0)
        angle = size * self._change(ANGLE, conditions, prediction.bend_angle, ratio * steep)
        return replace(
            prediction,
            curvature=prediction.curvature + curvature,
            bend_angle=prediction.bend_angle + angle,
        )

    def _change(self, kind: str, conditions: Conditions, reading: Floats, slope: Floats) -> Floats:
        known = self._known(
            conditions,
            np.abs(reading) / (self.term.scales[kind][0] if kind in self.term.scales else 1.0),
        )
        return self.term.change(kind, known, reading, slope)

    def _known(self, conditions: Conditions, size: Floats) -> KnownColumns:
        """Return the known quantities of readings under conditions; new specimens have no batch."""
        pressure, level = conditions.pressure, conditions.degradation
        lag = np.maximum.accumulate(pressure, axis=-1) - pressure
        modulus = np.interp(level, self.rates, self.moduli)
        numbers = {
            PATHS[ACTUATOR].column: pressure,
            LOAD.column: 1e-3 * pressure / modulus,
            LAG.column: lag,
            SIZE: size,
            DEGRADATION.column: np.asarray(level, dtype=np.float64),
            TIME.column: conditions.time,
            HUMIDITY.column: conditions.humidity,
            CYCLE.column: conditions.cycle - 1.0,
        }
        centres = levels(self.rates)[0]
        gap = np.abs(np.asarray(level)[..., None] - centres)
        names = np.array([f"{centre:.3g} %" for centre in centres])[np.argmin(gap, axis=-1)]
        labels = {
            BRANCH.column: np.where(conditions.unloading, "unloading", "loading"),
            MOUNT.column: conditions.mount,
            RATE.column: np.where(np.min(gap, axis=-1) <= LEVEL_WIDTH, names, ""),
            BATCH.column: np.array(""),
        }
        return KnownColumns({n: np.nan_to_num(v) for n, v in numbers.items()}, labels)


def term_trials(
    trial: CandidateFit, found: MissingTerms, generator: np.random.Generator
) -> tuple[CandidateFit, ...]:
    """Return the model fitted again with each of the best, about equally good terms.

    Of the first term found, those that fit as well are in question. Empty where fewer than two
    terms of actuators are in question.
    """
    if not found.terms or not isinstance(trial.subject.world, FilmsAndActuators):
        return ()
    first = found.terms[0]  # the term that was taken, and those that fit as well
    both = [(first.term, first.size), *((one.term, one.size) for one in first.alike)]
    in_question = [(term, size) for term, size in both if term.family == ACTUATOR][:IN_QUESTION]
    if len(in_question) < 2:
        return ()
    causes = [term_cause(trial.linear, term, size) for term, size in in_question]
    sizes = [np.array([size]) for _, size in in_question]
    return tuple(try_causes(trial, c, s, generator) for c, s in zip(causes, sizes, strict=True))


def term_cause(linear: Linear, term: KnownTerm, size: float) -> Cause:
    """Return a term as a cause that acts on actuator readings.

    The prior of its size is N(0, (2 size)²), in the unit of the term.
    """
    model = linear.subject
    places = model.places
    rates = np.unique(places.level[places.family == ACTUATOR])
    law = Normal(0.0, WIDE * max(abs(size), 1e-12))
    return Cause(
        name=term.formula,
        stage=Stage.READING,
        parameters=(Parameter("size", law, term.unit, "size of the term", 0.0),),
        mechanism="a term in known quantities",
        typical={"size": size},
        revealed_by="what the model without it leaves",
        on_reading=TermOnReading(term, rates, moduli_at(model, linear.mode, rates)),
    )
