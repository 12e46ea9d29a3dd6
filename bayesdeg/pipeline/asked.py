"""What a study may ask of a forward map, known before there is one: films, priors, conditions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.causes.cause import Cause
from bayesdeg.data.study import Study
from bayesdeg.emulator.coordinates import Batch
from bayesdeg.emulator.local import AskedInputs, layer_units
from bayesdeg.emulator.scaling import GROUPS, LOAD, TrainingRange, Units, groups_of
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.inference.model import JointModel, share_outside
from bayesdeg.observations.curvature import AtPressures, Curvature, inputs_met, parts_of
from bayesdeg.observations.force import HeldTip
from bayesdeg.observations.specimens import no_map
from bayesdeg.pipeline.assemble import Assembly, assemble
from bayesdeg.pipeline.calibrate import base_without_chain

Floats = NDArray[np.float64]

DRAWS = 60  # of each set of causes
OFF = 2.5  # standard deviations of the specimens' stiffness that draws reach


def asked_of(study: Study, seed: int) -> AskedInputs:
    """Return draws of what the models of a study ask of its forward map.

    The material is drawn from its posterior given all but the readings of the actuators, causes
    from their priors: none, each one, and pairs of those that follow one another in the catalogue.

    Parameters
    ----------
    study : Study
        One with readings of actuators.
    seed : int
        Of the draws.
    """
    assembly = assemble(study, no_map)
    model = assembly.model
    sequence = np.random.SeedSequence(seed)
    generator = np.random.default_rng(sequence)
    rest = model.without_kinds(*(one.name for one in model.observations if one.uses_forward))
    known = base_without_chain(rest, sequence).posterior.resample(generator, DRAWS)
    units = layer_units(geometry_of_study(study.settings))
    return _asked(assembly, known, generator, units)


@dataclass(frozen=True)
class AskedAfterwards:
    """What a study asks once it was calibrated with an emulator, and how that emulator does there.

    Parameters
    ----------
    asked : AskedInputs
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
    """

    asked: AskedInputs
    outside: float
    unanswered: float
    error_pct: float


def asked_after(study: Study, surrogate: Surrogate, seed: int) -> AskedAfterwards:
    """Calibrate a study's base model with an emulator and return what it asks then.

    Parameters
    ----------
    study : Study
        One with readings of actuators.
    surrogate : Surrogate
        Of its geometry.
    seed : int
        Of the draws.
    """
    assembly = assemble(study, surrogate)
    model = assembly.model
    sequence = np.random.SeedSequence(seed)
    generator = np.random.default_rng(sequence)
    # sums of several threads depend on their number
    with threadpool_limits(1):
        posterior = base_without_chain(model, sequence).posterior
        known = posterior.resample(generator, DRAWS)
        units = layer_units(geometry_of_study(study.settings))
        asked = _asked(assembly, known, generator, units)
        outside = _outside(model, surrogate, known)
        refused = share_outside(model, known)
        return AskedAfterwards(
            asked, outside, max(refused - outside, 0.0), _error_pct(model, surrogate, known)
        )


def _outside(model: JointModel, surrogate: Surrogate, known: Floats) -> float:
    """Return the share of draws that ask beyond the emulator's range, but not beyond that of all.

    Readings count alone, not the pressures between them.
    """
    state = model.tests(model.table.named(known))
    missed, whole = np.zeros(len(known), dtype=bool), TrainingRange()
    for one in model.of_kind(Curvature):
        off = np.zeros_like(one.deviation_sd(state))
        inputs = surrogate.units.inputs(inputs_met(state, one.curves, off))
        own, all_ = (Batch.of(inputs, span).in_range(span) for span in (surrogate.span, whole))
        missed |= np.any(all_ & ~own & one.curves.mask, axis=(-2, -1))
    return float(np.mean(missed))


def _error_pct(model: JointModel, surrogate: Surrogate, known: Floats) -> float:
    """Return the 95th percentile of the standard error over each curve's largest curvature [%].

    Of what is asked beside the shape too; the largest counts.
    """
    exact = surrogate.without_mesh_error()
    state = model.tests(model.table.named(known))
    shares = []
    for one in model.of_kind(Curvature):
        inputs = inputs_met(state, one.curves, np.zeros_like(one.deviation_sd(state)))
        for asked in dict.fromkeys((one.asks, *(other.asks for other in model.observations))):
            found = exact.continued(replace(inputs, asked=asked))
            pair = (found.sd, found.curvature)
            if found.further is not None:
                pair = (found.further.sd, found.further.value)
            with np.errstate(invalid="ignore"):
                share = pair[0].max(axis=-1) / pair[1].max(axis=-1)
                shares.append(float(np.nanquantile(share, 0.95)))
    return 100.0 * max(shares)


def _sets(causes: Sequence[Cause]) -> Iterator[tuple[Cause, ...]]:
    yield ()
    yield from ((cause,) for cause in causes)
    yield from pairwise(causes)


def _asked(
    assembly: Assembly, known: Floats, generator: np.random.Generator, units: Units
) -> AskedInputs:
    """Return what all sets of causes ask, at draws of the base model and causes from priors."""
    return AskedInputs.joined(
        [
            part
            for causes in _sets(assembly.candidates)
            for part in _of_model(assembly.model.extended(*causes), known, generator, units)
        ]
    )


def _of_model(
    model: JointModel, known: Floats, generator: np.random.Generator, units: Units
) -> Iterator[AskedInputs]:
    vectors = model.table.sample(generator, len(known))
    vectors[:, : known.shape[1]] = known  # those of the causes come last
    with np.errstate(all="ignore"):
        state = model.tests(model.table.named(vectors))
        tests: list[AtPressures] = [one.curves for one in model.of_kind(Curvature)]
        tests += [one.tests for one in model.of_kind(HeldTip)]
        for one in tests:
            sd = np.sqrt(state.once(parts_of, one).spread)[..., None]
            off = np.clip(generator.standard_normal(sd.shape), -OFF, OFF) * sd
            yield _flat(groups_of(units.inputs(inputs_met(state, one, off))))


def _flat(given: dict[str, Floats]) -> AskedInputs:
    load = given.pop(LOAD)
    shape = np.broadcast_shapes(load.shape, *(value.shape for value in given.values()))
    count = int(np.prod(shape[:-1]))

    def flat(value: Floats) -> Floats:
        return np.broadcast_to(value, shape).reshape(count, -1)

    largest = flat(load).max(axis=1)
    groups = np.column_stack(
        [
            flat(given[g.name])[:, 0] if g.name in given else np.full(count, g.neutral)
            for g in GROUPS
        ]
    )
    # a material that no law describes is asked of no forward map
    known = np.isfinite(largest) & np.all(np.isfinite(groups), axis=1)
    return AskedInputs(groups[known], largest[known])
