"""Effect of an emulator's error on a posterior, and curves that reduce it.

The posterior is that of the base model, and with each cause that the readings support. Fine curves
are solved in its region and correct the emulator (`bayesdeg.emulator.refinement`). The change of
the correction when one curve is left out estimates the remaining error; the resulting shift of
posterior means follows from the change of the log density.
"""

import json
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import PathSamples
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.status import Resolution
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.criticism.fit.search import LEAST_FACTOR, near
from bayesdeg.criticism.fit.trials import CandidateFit, try_causes
from bayesdeg.data.study import Study
from bayesdeg.emulator.campaign import local_terms
from bayesdeg.emulator.kept import AT_THE_POSTERIOR, Recipe
from bayesdeg.emulator.local import (
    InputDraws,
    LocalDesign,
    counted_in,
    curves_along,
    layer_units,
)
from bayesdeg.emulator.refinement import Refinement, refine
from bayesdeg.emulator.scaling import Units
from bayesdeg.emulator.solutions import Run, Solution
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.density import log_ratio
from bayesdeg.observations.curvature import Curvature, mechanics_inputs
from bayesdeg.pipeline.calibrate import base_without_chain
from bayesdeg.pipeline.emulation import Campaign, asked_by, asked_of_model
from bayesdeg.pipeline.reach import assemble_within_reach

Floats = NDArray[np.float64]

DRAWS = 60  # draws of each posterior
WEIGHED = 1000  # draws: shifts are then known to 3 % of the spread of the change
FIRST, MORE, REFINING_ROUNDS = AT_THE_POSTERIOR, 8, 3
"""Fine curves in the posterior region, further ones per round while too few, and rounds."""
LAST_ROUNDS = REFINING_ROUNDS
"""Fine curves at the end of training an emulator for one study; 0 for none."""
RIVALS = 3  # number of causes fitted, of those that screening puts near the best
COMMON_ERROR = "emulator_error_"  # prefix of the parameters of the emulator's error
TARGET_SHIFT = 0.1
"""A negligible shift of a posterior mean [sd]: it would widen an interval by half a percent, and
400 effective draws leave a Monte Carlo error of 0.05."""


@dataclass(frozen=True)
class Posteriors:
    """A study's posterior region, from an emulator.

    Parameters
    ----------
    trials : tuple of CandidateFit
        The likeliest model and those within odds of 20 of it: without a cause, or with one.
    asked : InputDraws
        Draws of what they ask.
    whole : InputDraws
        Draws of what any set of causes asks, with causes from their priors.
    """

    trials: tuple[CandidateFit, ...]
    asked: InputDraws
    whole: InputDraws


def posteriors_of(
    study: Study, surrogate: Surrogate, seed: int, *, base: CandidateFit | None = None
) -> Posteriors:
    """Fit a study's base model, and that with each cause that its readings support.

    Parameters
    ----------
    study : Study
        With readings of actuators.
    surrogate : Surrogate
        Of its geometry.
    seed : int
        Of the draws.
    base : CandidateFit, optional
        The base model, if it was calibrated with this emulator and seed already.
    """
    assembly, sequence = assemble_within_reach(study, surrogate), np.random.SeedSequence(seed)
    units = layer_units(geometry_of_study(study.settings))
    # sums of several threads depend on their number
    with threadpool_limits(1):
        base = base or base_without_chain(assembly.model, sequence)
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
        whole = asked_by(assembly, known, generator, units)
        return Posteriors(kept, InputDraws.joined(asked), whole)


def shifts_of(trial: CandidateFit, vectors: Floats, one: Surrogate, other: Surrogate) -> Floats:
    r"""Return the shift of posterior means from one map to another [sd], (n_parameters,).

    If the change of the log density is small against 1, reweighting by its exponential shifts a
    mean by the covariance with it,

    .. math:: \Delta\theta = \operatorname{cov}(\theta, \ln p_2 - \ln p_1)

    This also holds for parameters that the readings hardly constrain. These move most, and depend
    on how the difference of the maps changes with them, not on the difference itself.

    Parameters
    ----------
    trial : CandidateFit
        The posterior.
    vectors : array, shape (n, n_parameters)
        Draws from it, on the unconstrained scale; those that a map does not answer are left out.
    one, other : Surrogate
        The maps.
    """
    change = log_ratio(_log_density(trial, vectors, other), _log_density(trial, vectors, one))
    known = np.isfinite(change)
    centred = vectors[known] - vectors[known].mean(axis=0)
    sd = np.maximum(centred.std(axis=0), np.finfo(float).tiny)
    shifts: Floats = centred.T @ (change[known] - change[known].mean()) / known.sum() / sd
    return shifts


def _log_density(trial: CandidateFit, vectors: Floats, forward: Surrogate) -> Floats:
    return trial.subject.with_world(forward=forward).log_prob(vectors)


@dataclass(frozen=True)
class ErrorLeft:
    """Remaining effect of an emulator's error on a posterior, without the mesh error.

    Parameters
    ----------
    curves : int
        Fine curves where the posterior lies, by which it was refined.
    shift_sd : float
        Standard error of the posterior mean of the parameter that is moved most, over its
        standard deviation [–].
    parameter : str
        Which that is.
    moved_sd : float
        By how much the refinement itself moved that posterior mean most, of any parameter [sd].
    moved_parameter : str
        Of which.
    share_of_reading_errors : float
        rms of the emulator's standard error over that of a reading [–].
    """

    curves: int
    shift_sd: float
    parameter: str
    moved_sd: float
    moved_parameter: str
    share_of_reading_errors: float

    @property
    def is_small(self) -> bool:
        """Whether further curves would make no relevant difference."""
        return self.shift_sd <= TARGET_SHIFT


def error_left(posteriors: Posteriors, ground: Surrogate, refinement: Refinement) -> ErrorLeft:
    r"""Return the remaining effect of a refined emulator's error on a posterior.

    The standard error of a shift is that of the jackknife over the n curves,
    :math:`s^2 = \frac{n - 1}{n} \sum_k \Delta_k^2`, with Δ the shift without one of them.

    Parameters
    ----------
    posteriors : Posteriors
        The worst of them counts.
    ground : Surrogate
        What was refined.
    refinement : Refinement
        Of it.
    """
    found, count = refinement.surrogate, len(refinement.without)
    worst, moved = (0.0, ""), (0.0, "")
    for trial in posteriors.trials:
        at = trial.draws(np.random.default_rng(0), WEIGHED)
        without = np.array([shifts_of(trial, at, found, other) for other in refinement.without])
        error = np.sqrt((count - 1) / count * np.sum(without**2, axis=0))
        worst = max(worst, _largest(trial, error))
        moved = max(moved, _largest(trial, np.abs(shifts_of(trial, at, ground, found))))
    share = max(_share_of_reading_errors(trial, found) for trial in posteriors.trials)
    return ErrorLeft(count, *worst, *moved, share)


def _largest(trial: CandidateFit, sizes: Floats) -> tuple[float, str]:
    """Return the largest shift, except of the emulator's error parameters, and its parameter."""
    names = trial.subject.table.names
    kept = [k for k, name in enumerate(names) if not name.startswith(COMMON_ERROR)]
    return max((float(sizes[k]), names[k]) for k in kept)


def _share_of_reading_errors(trial: CandidateFit, surrogate: Surrogate) -> float:
    """Return the rms interpolation error relative to the reading errors, at a mode."""
    model = trial.subject
    state = model.tests(model.table.named(trial.mode[None]))
    exact = surrogate.without_mesh_error()
    shares = []
    for one in model.of_kind(Curvature):
        inputs = mechanics_inputs(state, one.tests, np.zeros_like(one.deviation_sd(state)))
        sd = exact.continued(inputs).sd
        variance = one.predicted(state).variance[..., : sd.shape[-1]]
        shares.append((sd**2 / variance)[0][one.tests.mask])
    return float(np.sqrt(np.nanmean(np.concatenate(shares))))


def refining_campaign(
    base: Campaign, posteriors: Posteriors, ground: Surrogate, number: int
) -> Campaign:
    """Return a campaign with fine curves added in a posterior region.

    Parameters
    ----------
    base : Campaign
        That of the round before; its design is none in the first.
    posteriors : Posteriors
        Of the study.
    ground : Surrogate
        What is refined: its mesh is that of the curves, if its record says which that is.
    number : int
        Of the round, which chooses among the draws.
    """
    known = () if base.design is None else base.design.fine
    counted = posteriors.asked.in_units(ground.units)
    back = Units(1.0 / ground.units.load, 1.0 / ground.units.paper)
    chosen = curves_along(counted, ground.span, MORE if known else FIRST, seed=number)
    # a later round may choose a draw again
    curves = tuple(dict.fromkeys((*known, *(counted_in(curve, back) for curve in chosen))))
    design = LocalDesign(ground.span, (), curves, curves, ground.units)
    return replace(base, recipe=_on_mesh_of(ground, base.recipe), design=design)


def _on_mesh_of(ground: Surrogate, recipe: Recipe) -> Recipe:
    mesh = json.loads(ground.record).get("fine_mesh_mm")
    return recipe if mesh is None else replace(recipe, fine_mesh=Resolution(**mesh))


def refined_by(
    campaign: Campaign,
    solved: list[tuple[Run, Solution]],
    posteriors: Posteriors,
    ground: Surrogate,
) -> tuple[Surrogate, ErrorLeft]:
    """Return an emulator refined by the solved curves, and the remaining effect of its error.

    Raises
    ------
    BayesdegError
        If too few curves say anything.
    """
    paths = [(run.curve, found) for run, found in solved if isinstance(found, PathSamples)]
    curves, samples = [curve for curve, _ in paths], [found for _, found in paths]
    steepest = local_terms(campaign.geometry).steepest
    refinement = refine(ground, curves, samples, posteriors.whole, steepest)
    with threadpool_limits(1):
        left = error_left(posteriors, ground, refinement)
    found = refinement.surrogate
    record = json.loads(found.record) | {"refinement": asdict(left)}
    return replace(found, record=json.dumps(record, indent=1)), left
