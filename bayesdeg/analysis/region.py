"""Where a study asks its emulator, and how much the emulator's error matters there.

Before there is a forward map the inputs of a study are known from films, priors and conditions;
afterwards from its posterior: that of the base model, and with each cause that the readings
support. Fine curves are solved there and correct the emulator
(`bayesdeg.surrogate.refinement`). The change of the correction when one curve is left out estimates
the remaining error; the resulting shift of posterior means follows from the change of the log
density.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import PathSamples
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.status import Resolution
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.assembly.reach import assemble_within_reach
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.criticism.fit.search import LEAST_FACTOR, near
from bayesdeg.criticism.fit.trials import CandidateFit, try_causes
from bayesdeg.data.study import Study
from bayesdeg.inference.density import log_ratio
from bayesdeg.inference.model import JointModel, share_outside
from bayesdeg.observations.curvature import AtPressures, Curvature, mechanics_inputs, parts_of
from bayesdeg.observations.force import HeldTip
from bayesdeg.observations.specimens import no_map
from bayesdeg.surrogate.campaign import Campaign
from bayesdeg.surrogate.coordinates import Batch
from bayesdeg.surrogate.kept import AT_THE_POSTERIOR
from bayesdeg.surrogate.local import (
    InputDraws,
    LocalDesign,
    counted_in,
    curves_along,
    layer_units,
)
from bayesdeg.surrogate.refinement import Refinement, refine
from bayesdeg.surrogate.scaling import GROUPS, LOAD, TrainingRange, Units, groups_of
from bayesdeg.surrogate.solutions import Run, Solution
from bayesdeg.surrogate.surrogate import Surrogate

Floats = NDArray[np.float64]

DRAWS = 60  # draws of each posterior, and of the inputs for each set of causes
OFF = 2.5  # standard deviations of specimen stiffness covered by draws
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


def asked_of(study: Study, seed: int) -> InputDraws:
    """Return draws of the inputs that a study's models need from its forward map.

    The material is drawn from its posterior given all data but the actuator readings, causes from
    their priors: none, each one, and pairs of neighbours in the catalogue.
    """
    assembly = assemble(study, no_map)
    model = assembly.model
    sequence = np.random.SeedSequence(seed)
    generator = np.random.default_rng(sequence)
    rest = model.without_kinds(*(one.name for one in model.observations if one.uses_forward))
    known = base_without_chain(rest, sequence).posterior.resample(generator, DRAWS)
    units = layer_units(geometry_of_study(study.settings))
    return asked_by(assembly, known, generator, units)


@dataclass(frozen=True)
class AskedAfterwards:
    """Inputs of a study after calibration with an emulator, and the emulator's accuracy there.

    Parameters
    ----------
    asked : InputDraws
        Draws of the posterior, with causes drawn from their priors.
    outside : float
        Share of the posterior outside the range of this emulator but not beyond that of all, which
        further curves mend [–].
    unanswered : float
        Share at which there is no answer to some reading for another reason: curves end, where
        actuators are about to balloon, or no emulator goes so far [–].
    error_pct : float
        95th percentile over the posterior's curves of the standard error of their curvature, less
        that of the mesh, over the largest of each; of the cavity's volume or of
        the tip force where that is larger, if it is asked for [%].
    base : CandidateFit
        The base model as it was calibrated.
    """

    asked: InputDraws
    outside: float
    unanswered: float
    error_pct: float
    base: CandidateFit


def asked_after(study: Study, surrogate: Surrogate, seed: int) -> AskedAfterwards:
    """Calibrate a study's base model with an emulator and return its inputs then."""
    assembly = assemble_within_reach(study, surrogate)
    model = assembly.model
    sequence = np.random.SeedSequence(seed)
    generator = np.random.default_rng(sequence)
    # sums depend on the number of threads
    with threadpool_limits(1):
        base = base_without_chain(model, sequence)
        known = base.posterior.resample(generator, DRAWS)
        units = layer_units(geometry_of_study(study.settings))
        asked = asked_by(assembly, known, generator, units)
        exact, whole = surrogate.without_mesh_error(), TrainingRange()
        state = model.tests(model.table.named(known))
        missed, shares = np.zeros(len(known), dtype=bool), []
        for one in model.of_kind(Curvature):
            inputs = mechanics_inputs(state, one.tests, np.zeros_like(one.deviation_sd(state)))
            counted = surrogate.units.inputs(inputs)
            own, all_ = (Batch.of(counted, span).in_range(span) for span in (surrogate.span, whole))
            # only pressures of readings count, not those between
            missed |= np.any(all_ & ~own & one.tests.mask, axis=(-2, -1))
            for output in dict.fromkeys((one.asks, *(other.asks for other in model.observations))):
                found = exact.continued(replace(inputs, asked=output))
                pair = (found.sd, found.curvature)
                if found.further is not None:
                    pair = (found.further.sd, found.further.value)
                with np.errstate(invalid="ignore"):
                    share = pair[0].max(axis=-1) / pair[1].max(axis=-1)
                    shares.append(float(np.nanquantile(share, 0.95)))
        outside = float(np.mean(missed))
        unanswered = max(share_outside(model, known) - outside, 0.0)
        return AskedAfterwards(asked, outside, unanswered, 100.0 * max(shares), base)


def asked_by(
    assembly: Assembly, known: Floats, generator: np.random.Generator, units: Units
) -> InputDraws:
    """Return the inputs for all sets of causes, at draws of the base model and of priors."""
    causes = assembly.candidates
    sets: list[tuple[Cause, ...]] = [(), *((cause,) for cause in causes), *pairwise(causes)]
    return InputDraws.joined(
        [
            part
            for chosen in sets
            for part in asked_of_model(assembly.model.extended(*chosen), known, generator, units)
        ]
    )


def asked_of_model(
    model: JointModel, known: Floats, generator: np.random.Generator, units: Units
) -> Iterator[InputDraws]:
    """Yield the inputs of each of a model's kinds of actuator readings.

    ``known``, shape (n, n_known), are draws of its first parameters; the others, and the specimens'
    deviations of stiffness, are drawn from their priors.
    """
    vectors = model.table.sample(generator, len(known))
    vectors[:, : known.shape[1]] = known  # those of the causes come last
    with np.errstate(all="ignore"):
        state = model.tests(model.table.named(vectors))
        tests: list[AtPressures] = [one.tests for one in model.of_kind(Curvature)]
        tests += [one.tests for one in model.of_kind(HeldTip)]
        for one in tests:
            sd = np.sqrt(state.once(parts_of, one).spread)[..., None]
            off = np.clip(generator.standard_normal(sd.shape), -OFF, OFF) * sd
            given = groups_of(units.inputs(mechanics_inputs(state, one, off)))
            shape = np.broadcast_shapes(*(value.shape for value in given.values()))
            flat = {
                name: np.broadcast_to(value, shape).reshape(-1, *shape[-1:])
                for name, value in given.items()
            }
            largest = flat[LOAD].max(axis=1)
            neutral = np.ones((len(largest), 1))
            groups = np.column_stack([flat.get(g.name, g.neutral * neutral)[:, 0] for g in GROUPS])
            # a material outside all laws is never evaluated
            answered = np.isfinite(largest) & np.all(np.isfinite(groups), axis=1)
            yield InputDraws(groups[answered], largest[answered])


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

    ``base`` is the base model, if it was calibrated with this emulator and seed already.
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
    then, before = (
        trial.subject.with_world(forward=forward).log_prob(vectors) for forward in (other, one)
    )
    change = log_ratio(then, before)
    known = np.isfinite(change)
    centred = vectors[known] - vectors[known].mean(axis=0)
    sd = np.maximum(centred.std(axis=0), np.finfo(float).tiny)
    shifts: Floats = centred.T @ (change[known] - change[known].mean()) / known.sum() / sd
    return shifts


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
    :math:`s^2 = \frac{n - 1}{n} \sum_k \Delta_k^2`, with Δ the shift without one of them. The
    worst of the posteriors counts; ``ground`` is what was refined.
    """
    found, count = refinement.surrogate, len(refinement.without)
    exact, of_readings = found.without_mesh_error(), list[float]()
    worst, moved = (0.0, ""), (0.0, "")
    for trial in posteriors.trials:
        at = trial.draws(np.random.default_rng(0), WEIGHED)
        without = np.array([shifts_of(trial, at, found, other) for other in refinement.without])
        error = np.sqrt((count - 1) / count * np.sum(without**2, axis=0))
        worst = max(worst, _largest(trial, error))
        moved = max(moved, _largest(trial, np.abs(shifts_of(trial, at, ground, found))))
        model = trial.subject
        state = model.tests(model.table.named(trial.mode[None]))
        shares = []
        for one in model.of_kind(Curvature):
            inputs = mechanics_inputs(state, one.tests, np.zeros_like(one.deviation_sd(state)))
            sd = exact.continued(inputs).sd
            variance = one.predicted(state).variance[..., : sd.shape[-1]]
            shares.append((sd**2 / variance)[0][one.tests.mask])
        of_readings.append(float(np.sqrt(np.nanmean(np.concatenate(shares)))))
    return ErrorLeft(count, *worst, *moved, max(of_readings))


def _largest(trial: CandidateFit, sizes: Floats) -> tuple[float, str]:
    """Return the largest shift, except of the emulator's error parameters, and its parameter."""
    names = trial.subject.table.names
    kept = [k for k, name in enumerate(names) if not name.startswith(COMMON_ERROR)]
    return max((float(sizes[k]), names[k]) for k in kept)


def refining_campaign(
    base: Campaign, posteriors: Posteriors, ground: Surrogate, number: int
) -> Campaign:
    """Return a campaign with fine curves added in a posterior region.

    Parameters
    ----------
    base : Campaign
        Campaign of the previous round; without a design in the first.
    posteriors : Posteriors
        Posteriors of the study.
    ground : Surrogate
        The emulator to refine; the curves are solved on its mesh, if its record names it.
    number : int
        Number of the round, which chooses among the draws.
    """
    known = () if base.design is None else base.design.fine
    counted = posteriors.asked.in_units(ground.units)
    back = Units(1.0 / ground.units.load, 1.0 / ground.units.paper)
    chosen = curves_along(counted, ground.span, MORE if known else FIRST, seed=number)
    # a later round may choose a draw again
    curves = tuple(dict.fromkeys((*known, *(counted_in(curve, back) for curve in chosen))))
    design = LocalDesign(ground.span, (), curves, curves, ground.units)
    mesh = json.loads(ground.record).get("fine_mesh_mm") or vars(base.recipe.fine_mesh)
    return replace(base, recipe=replace(base.recipe, fine_mesh=Resolution(**mesh)), design=design)


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
    refinement = refine(ground, curves, samples, posteriors.whole)
    with threadpool_limits(1):
        left = error_left(posteriors, ground, refinement)
    found = refinement.surrogate
    record = json.loads(found.record) | {"refinement": asdict(left)}
    return replace(found, record=json.dumps(record, indent=1)), left
