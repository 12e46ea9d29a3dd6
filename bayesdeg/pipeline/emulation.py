"""Training an emulator: the inputs of a study, the time of a campaign, and its progress.

The inputs of a study are known before there is a forward map, from films, priors and conditions.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import Backend, Resolution, Status
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.data.study import Study
from bayesdeg.emulator.campaign import Finished, Solution, build, complete, missing, runs
from bayesdeg.emulator.coordinates import Batch
from bayesdeg.emulator.kept import Recipe, duration
from bayesdeg.emulator.local import InputDraws, LocalDesign, layer_units
from bayesdeg.emulator.scaling import GROUPS, LOAD, TrainingRange, Units, groups_of
from bayesdeg.emulator.solutions import ANSWERS, Run, SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.workers import Supervised
from bayesdeg.inference.model import JointModel, share_outside
from bayesdeg.observations.curvature import AtPressures, Curvature, mechanics_inputs, parts_of
from bayesdeg.observations.force import HeldTip
from bayesdeg.observations.specimens import no_map
from bayesdeg.pipeline.assemble import Assembly, assemble
from bayesdeg.pipeline.calibrate import base_without_chain
from bayesdeg.pipeline.reach import assemble_within_reach
from bayesdeg.progress import Progress

Floats = NDArray[np.float64]

DRAWS = 60  # draws of the inputs for each set of causes
OFF = 2.5  # standard deviations of specimen stiffness covered by draws
# time of a curve with derivatives over that of one assembly and factorization: medians of 26 to 36
# for either mesh of two pneunets
FACTORIZATIONS = 40
PLAIN = MaterialGroups(c2_ratio=0.0, c3_ratio=0.01, paper_group=100.0)


@dataclass(frozen=True)
class Campaign:
    """The finite element runs that an emulator of a geometry is trained on.

    Parameters
    ----------
    geometry : Moulded
        The actuator as moulded.
    recipe : Recipe
        Meshes and numbers of runs.
    store : SolutionStore
        Where solutions are kept, and looked for first.
    executor : Executor, optional
        Where to solve.
    timeout : float
        Time after which a run is given up, from its start [s].
    design : LocalDesign, optional
        Where one study may ask; by default the whole range.
    later : int
        Runs of the fine mesh that follow, where the posterior will lie.
    alike : sequence of Run
        Of the same actuator, solved before: how long they took says how long these take.
    """

    geometry: Moulded
    recipe: Recipe
    store: SolutionStore
    executor: Executor | None = None
    timeout: float = np.inf
    design: LocalDesign | None = None
    later: int = 0
    alike: Sequence[Run] = ()

    @property
    def runs(self) -> list[Run]:
        """All runs, whether they are solved or not."""
        return runs(self.geometry, self.recipe, self.design)

    @property
    def workers(self) -> int:
        """Number of runs solved at a time."""
        return self.executor.workers if isinstance(self.executor, Supervised) else 1

    def key(self) -> str:
        """Return a name for these runs together."""
        return sha256("".join(run.key() for run in self.runs).encode()).hexdigest()

    def left(self) -> list[Run]:
        """Return the runs that the store lacks."""
        return missing(self.runs, self.store, timeout=self.timeout)


@dataclass(frozen=True)
class Expectation:
    """The remaining part of a campaign.

    Parameters
    ----------
    left : mapping of Resolution to int
        Runs to be solved, by mesh.
    each : mapping of Resolution to float
        Measured time of one of them on one core [s].
    workers : int
        How many are solved at a time.
    later : float
        Time of the runs that follow, on one core [s].
    """

    left: dict[Resolution, int]
    each: dict[Resolution, float]
    workers: int = 1
    later: float = 0.0

    @property
    def core_seconds(self) -> float:
        """Time of all remaining runs on one core [s]."""
        return sum(self.each[mesh] * number for mesh, number in self.left.items())

    @property
    def seconds(self) -> float:
        """Remaining time [s].

        Examples
        --------
        >>> coarse, fine = Resolution(3.0, 3.0, 3.0), Resolution(1.0, 1.0, 1.0)
        >>> Expectation({coarse: 100, fine: 10}, {coarse: 2.0, fine: 40.0}, workers=2).seconds
        300.0
        """
        return self.core_seconds / max(1, min(self.workers, sum(self.left.values())))

    @property
    def whole_seconds(self) -> float:
        """Remaining time, including later runs [s]."""
        return self.seconds + self.later / self.workers

    def __str__(self) -> str:
        """Return the time estimate and its basis in words."""
        runs = [
            f"{number} of {self.each[mesh]:.1f} s on a mesh of {mesh.along:g} mm"
            for mesh, number in self.left.items()
        ]
        at_once = "one at a time" if self.workers == 1 else f"{self.workers} at a time"
        then = "" if self.later == 0.0 else f", and then {duration(self.later / self.workers)}"
        where = " in the posterior region" if then else ""
        whole = f"{duration(self.seconds)}{then}{where}"
        return f"{whole}: finite element curves, {' and '.join(runs)}, {at_once}"


def expect(campaign: Campaign, progress: Progress) -> Expectation:
    """Estimate the time of a campaign, within seconds.

    If runs of a mesh were timed, here or before, their median is used; otherwise the time of one
    factorization of its tangent, of which a curve takes about `FACTORIZATIONS`.

    Parameters
    ----------
    campaign : Campaign
        Its solved runs are not repeated.
    progress : Progress
        Shows that meshes are tried.
    """
    counts = Counter(run.resolution for run in campaign.left())
    timed = _timed(campaign)
    untimed = [mesh for mesh in counts if mesh not in timed]
    if untimed:
        progress.stage("timing the meshes", total=len(untimed))
    for mesh in untimed:
        once = seconds_of_factorization(campaign.geometry, mesh, campaign.recipe.backend)
        timed[mesh] = [FACTORIZATIONS * once]
        progress.advance()
    each = {mesh: median(timed[mesh]) for mesh in counts}
    later = campaign.later * each.get(campaign.recipe.fine_mesh, 0.0)
    return Expectation(dict(counts), each, campaign.workers, later)


def seconds_of_factorization(
    geometry: Moulded, mesh: Resolution, backend: Backend = Backend.KERNELS
) -> float:
    """Return the time to assemble and factorize the tangent of an actuator at rest [s]."""
    actuator = Actuator(build_mesh(geometry, mesh), backend=backend)
    system, (_, problem) = actuator.system, actuator.equations(Curve((), PLAIN))
    solver = open_factorization(system.upper)
    try:
        solver.factorize(problem.linearise(system.rest()).tangent)  # analysed, and compiled
        begun = time.perf_counter()
        solver.factorize(problem.linearise(system.rest()).tangent)
        return time.perf_counter() - begun
    finally:
        solver.close()


def _timed(campaign: Campaign) -> dict[Resolution, list[float]]:
    seconds, by_mesh = campaign.store.seconds(), dict[Resolution, list[float]]()
    for run in dict.fromkeys((*campaign.runs, *campaign.alike)):
        if run.key() in seconds:
            by_mesh.setdefault(run.resolution, []).append(seconds[run.key()])
    return by_mesh


@dataclass
class Meter:
    """Shows progress and remaining time of a campaign.

    Parameters
    ----------
    expectation : Expectation
        Of the whole campaign.
    progress : Progress
        Shows it; steps are seconds of one core, so that a fine run counts for many coarse ones.
    clock : callable
        Returns the time [s].
    """

    expectation: Expectation
    progress: Progress
    clock: Callable[[], float] = time.monotonic
    failed: int = 0
    _solved: Counter[Resolution] = field(default_factory=Counter)
    _spent: dict[Resolution, float] = field(default_factory=dict)
    _start: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin the stage."""
        self._start = self.clock()
        self.progress.stage("finite element curves", total=self.expectation.core_seconds)

    def __call__(self, finished: Finished) -> None:
        """Count a run."""
        mesh = finished.run.resolution
        self._solved[mesh] += 1
        self._spent[mesh] = self._spent.get(mesh, 0.0) + finished.seconds
        self.failed += finished.solution.status not in ANSWERS
        total, solved = sum(self.expectation.left.values()), self._solved.total()
        note = f"{solved} of {max(total, solved)}, {duration(self.remaining())} left"
        note += f", {self.failed} failed" if self.failed else ""
        self.progress.advance(self.expectation.each.get(mesh, 0.0), note)
        if solved == total:
            self.progress.stage("training on the curves")

    def remaining(self) -> float:
        """Return the time that is left, from measured times and the measured pace [s].

        The pace is core seconds done per second. The expected pace counts like some measurements,
        since runs in progress are not counted before they end.
        """
        left = sum(
            max(0, number - self._solved[mesh]) * self._seconds_of(mesh)
            for mesh, number in self.expectation.left.items()
        )
        while_ = max(self.expectation.each.values(), default=1.0)
        elapsed = self.clock() - self._start
        done = sum(self._spent.values())
        pace = (done + self.expectation.workers * while_) / (elapsed + while_)
        return left / pace

    def _seconds_of(self, mesh: Resolution) -> float:
        """Mean time of a run, that of the expectation counting as one run."""
        spent = self.expectation.each[mesh] + self._spent.get(mesh, 0.0)
        return spent / (1 + self._solved[mesh])


def train_emulator(campaign: Campaign, expectation: Expectation, progress: Progress) -> Surrogate:
    """Complete a campaign and train the emulator, showing progress."""
    return build(
        campaign.geometry,
        campaign.store,
        recipe=campaign.recipe,
        design=campaign.design,
        executor=campaign.executor,
        timeout=campaign.timeout,
        on_run=_meter(expectation, progress),
    )


def solve_campaign(
    campaign: Campaign, expectation: Expectation, progress: Progress
) -> list[tuple[Run, Solution]]:
    """Complete a campaign, showing progress; return all solutions."""
    solved = complete(
        campaign.runs,
        campaign.store,
        executor=campaign.executor,
        timeout=campaign.timeout,
        on_run=_meter(expectation, progress),
    )
    return list(zip(campaign.runs, solved, strict=True))


def _meter(expectation: Expectation, progress: Progress) -> Meter | None:
    """Return the progress display of a campaign; None if nothing is left."""
    if expectation.left:
        return Meter(expectation, progress)
    progress.stage("training on the curves")
    return None


def endings(campaign: Campaign) -> list[tuple[Run, Status]]:
    """Return the outcome of every solved run of a campaign."""
    solved = [(run, campaign.store.get(run)) for run in campaign.runs]
    return [(run, solution.status) for run, solution in solved if solution is not None]


def asked_of(study: Study, seed: int) -> InputDraws:
    """Return draws of the inputs that a study's models need from its forward map.

    The material is drawn from its posterior given all data but the actuator readings, causes from
    their priors: none, each one, and pairs of neighbours in the catalogue.

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
    """Calibrate a study's base model with an emulator and return its inputs then.

    Parameters
    ----------
    study : Study
        One with readings of actuators.
    surrogate : Surrogate
        Of its geometry.
    seed : int
        Of the draws.
    """
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
        outside = _outside(model, surrogate, known)
        refused = share_outside(model, known)
        error_pct = _error_pct(model, surrogate, known)
        return AskedAfterwards(asked, outside, max(refused - outside, 0.0), error_pct, base)


def _outside(model: JointModel, surrogate: Surrogate, known: Floats) -> float:
    """Return the share of draws outside this emulator's range but inside the widest one.

    Only pressures of readings count, not those between.
    """
    state = model.tests(model.table.named(known))
    missed, whole = np.zeros(len(known), dtype=bool), TrainingRange()
    for one in model.of_kind(Curvature):
        off = np.zeros_like(one.deviation_sd(state))
        inputs = surrogate.units.inputs(mechanics_inputs(state, one.curves, off))
        own, all_ = (Batch.of(inputs, span).in_range(span) for span in (surrogate.span, whole))
        missed |= np.any(all_ & ~own & one.curves.mask, axis=(-2, -1))
    return float(np.mean(missed))


def _error_pct(model: JointModel, surrogate: Surrogate, known: Floats) -> float:
    """Return the 95th percentile of the standard error over each curve's largest curvature [%].

    Includes the outputs besides the shape; the largest counts.
    """
    exact = surrogate.without_mesh_error()
    state = model.tests(model.table.named(known))
    shares = []
    for one in model.of_kind(Curvature):
        inputs = mechanics_inputs(state, one.curves, np.zeros_like(one.deviation_sd(state)))
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


def asked_by(
    assembly: Assembly, known: Floats, generator: np.random.Generator, units: Units
) -> InputDraws:
    """Return the inputs for all sets of causes, at draws of the base model and of priors."""
    return InputDraws.joined(
        [
            part
            for causes in _sets(assembly.candidates)
            for part in asked_of_model(assembly.model.extended(*causes), known, generator, units)
        ]
    )


def asked_of_model(
    model: JointModel, known: Floats, generator: np.random.Generator, units: Units
) -> Iterator[InputDraws]:
    """Yield the inputs of each of a model's kinds of actuator readings at draws.

    Parameters
    ----------
    model : JointModel
        With its causes.
    known : array, shape (n, n_known)
        Draws of its first parameters; the others are drawn from their priors.
    generator : Generator
        Draws them, and the specimens' deviations of stiffness.
    units : Units
        Those of the actuator's layer.
    """
    vectors = model.table.sample(generator, len(known))
    vectors[:, : known.shape[1]] = known  # those of the causes come last
    with np.errstate(all="ignore"):
        state = model.tests(model.table.named(vectors))
        tests: list[AtPressures] = [one.curves for one in model.of_kind(Curvature)]
        tests += [one.tests for one in model.of_kind(HeldTip)]
        for one in tests:
            sd = np.sqrt(state.once(parts_of, one).spread)[..., None]
            off = np.clip(generator.standard_normal(sd.shape), -OFF, OFF) * sd
            yield _flat(groups_of(units.inputs(mechanics_inputs(state, one, off))))


def _flat(given: dict[str, Floats]) -> InputDraws:
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
    # a material outside all laws is never evaluated
    known = np.isfinite(largest) & np.all(np.isfinite(groups), axis=1)
    return InputDraws(groups[known], largest[known])
