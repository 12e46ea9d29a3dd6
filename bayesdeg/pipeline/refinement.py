"""How far an emulator's own error can move a posterior, and curves that make that small.

The posterior is that of the base model and of those of its causes that readings speak for. There
curves of the emulator's own mesh are solved and correct it (`bayesdeg.emulator.refinement`). What
the correction would be without one of its curves says how far it is still off, and what that does
to means of the posterior follows from the model linearised at its mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.criticism.fit.search import LEAST_FACTOR, near
from bayesdeg.criticism.fit.trials import Trial, try_causes
from bayesdeg.data.study import Study
from bayesdeg.emulator.local import AskedInputs, layer_units
from bayesdeg.emulator.refinement import Refinement
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import Curvature, inputs_met
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.calibrate import base_without_chain
from bayesdeg.pipeline.emulation import asked_by, asked_of_model

Floats = NDArray[np.float64]

DRAWS = 60  # of each posterior
RIVALS = 3  # causes that are fitted, the first of those that screening puts near the best
TARGET_SHIFT = 0.1
"""Shift of a posterior mean that is small [sd]: an interval that should be as much wider is so by
half a percent, and 400 effective draws leave 0.05 of Monte Carlo error."""


@dataclass(frozen=True)
class Posteriors:
    """Where a study's posterior lies, by an emulator.

    Parameters
    ----------
    trials : tuple of Trial
        The likeliest model and those within odds of 20 of it: without a cause, or with one.
    asked : AskedInputs
        Draws of what they ask.
    whole : AskedInputs
        Draws of what any set of causes asks, with causes from their priors.
    """

    trials: tuple[Trial, ...]
    asked: AskedInputs
    whole: AskedInputs


def posteriors_of(study: Study, surrogate: Surrogate, seed: int) -> Posteriors:
    """Fit a study's base model, and that with each cause which its readings speak for.

    Parameters
    ----------
    study : Study
        With readings of actuators.
    surrogate : Surrogate
        Of its geometry.
    seed : int
        Of the draws.
    """
    assembly, sequence = assemble(study, surrogate), np.random.SeedSequence(seed)
    units = layer_units(geometry_of_study(study.settings))
    # sums of several threads depend on their number
    with threadpool_limits(1):
        base = base_without_chain(assembly.model, sequence)
        generator = np.random.default_rng(sequence)
        judged = [cause for cause in assembly.candidates if not cause.is_of_rupture_alone]
        screened = {cause.name: screen(base.linear, cause) for cause in judged}
        leading = near(screened, 0.0)[:RIVALS]
        trials = [base] + [
            try_causes(base, screened[name].cause, screened[name].size, generator)
            for name in leading
        ]
        best = max(trial.log_evidence for trial in trials)
        kept = tuple(t for t in trials if t.log_evidence >= best - LEAST_FACTOR)
        asked = [
            part
            for trial in kept
            for part in asked_of_model(
                trial.subject, trial.draws(generator, DRAWS), generator, units
            )
        ]
        known = base.draws(generator, DRAWS)
        return Posteriors(
            kept, AskedInputs.joined(asked), asked_by(assembly, known, generator, units)
        )


def shifts_of(trial: Trial, one: Surrogate, other: Surrogate) -> Floats:
    r"""Return by how much means of a posterior move from one map to another [sd], (n_parameters,).

    In the model linearised at its mode (`bayesdeg.criticism.fit.linear`), with Λ⁻¹ the covariance
    of the parameters given all but the readings, Σ that of readings, X their derivatives,

    .. math:: \Delta\theta = -\Lambda^{-1} X^T \Sigma^{-1} (f_2 - f_1), \qquad
        C = \Lambda^{-1} - \Lambda^{-1} X^T \Sigma^{-1} X \Lambda^{-1}.
    """
    linear, subject = trial.linear, trial.subject
    first, second = (subject.with_world(forward=m).expected(trial.mode[None])[0] for m in (one, other))
    change = np.where(np.isfinite(second - first), second - first, 0.0)
    pull = trial.uncertain @ linear.jacobian.T
    law = linear.whitening
    moved = -pull @ law.adjoint(law.whitened(change))
    covariance = trial.uncertain - pull @ law.adjoint(law.whitened(pull.T))
    sd = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    shifts: Floats = moved / sd
    return shifts
