"""Which finite element runs train an emulator: choose, time and solve them, and train on them.

Runs are solved on any executor; stored solutions are never solved again.
"""

import json
import os
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from math import inf
from statistics import median

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Actuator, Curve, PathSamples, with_layer
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import Backend, Resolution, Status
from bayesdeg.errors import BayesdegError
from bayesdeg.progress import Progress
from bayesdeg.surrogate.departure_training import MovedCurve, departed, fit_departure
from bayesdeg.surrogate.design import is_answered, training_curves
from bayesdeg.surrogate.fit import (
    BY_ITSELF,
    NEAR,
    FitTerms,
    Solved,
    counted,
    train,
    with_forces,
)
from bayesdeg.surrogate.kept import (
    FIT_VERSION,
    Recipe,
    duration,
    has_ground,
    mesh_error_of,
    refuse_whole_range,
)
from bayesdeg.surrogate.local import LocalDesign
from bayesdeg.surrogate.regression import Observed, observe, observe_force
from bayesdeg.surrogate.scaling import TrainingRange
from bayesdeg.surrogate.solutions import ANSWERS, Kind, Run, Solution, SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import default_surrogate
from bayesdeg.surrogate.workers import Supervised, solve

# ---- which runs

WHOLE_RANGE = "scrambled Sobol' over the material, none to four causes at work in each"
LOCAL = "where one study may ask, as a departure from the emulator of the default geometry"
ALONE = "where one study may ask"


def runs(
    geometry: Moulded, recipe: Recipe | None = None, design: LocalDesign | None = None
) -> list[Run]:
    """Return the training runs of an emulator of a geometry, the coarse mesh first.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> len(runs(Geometry(Dimensions()), Recipe(coarse_runs=4, fine_runs=2)))
    6
    """
    recipe = recipe or Recipe()
    held: tuple[bool, ...] = (False,)
    if design is not None:
        coarse, fine = map(list, design.nominal)
        held = (False, True) if design.with_forces else held
    else:
        coarse, fine = training_curves(
            TrainingRange(), recipe.coarse_runs, recipe.fine_runs, seed=recipe.seed
        )
    found = [
        Run(
            *(geometry, mesh, with_layer(geometry, curve), Kind.SAMPLES, tip),
            backend=recipe.backend,
        )
        for tip in held
        for mesh, curves in ((recipe.coarse_mesh, coarse), (recipe.fine_mesh, fine))
        for curve in curves
    ]
    if design is not None:
        return found + [run for tip in held for run in _moved(geometry, recipe, design, tip)]
    return found


def _moved(geometry: Moulded, recipe: Recipe, design: LocalDesign, held: bool) -> Iterator[Run]:
    """Yield the runs with dimensions moved, in the order of ``LocalDesign.moved``."""
    for one in design.moved:
        shape = one.geometry(geometry, design.dimensions)
        mesh = recipe.fine_mesh if one.is_fine else recipe.coarse_mesh
        curve = with_layer(shape, one.curve)
        yield Run(
            *(shape, mesh, curve, Kind.SAMPLES, held), origin=geometry, backend=recipe.backend
        )


# ---- solving them

# interval of checks whether workers are reachable [s]
_PATIENCE = 2.0
# deaths of a worker alone with one run, after which the run is given up
_DEATHS = 3


@dataclass(frozen=True)
class Finished:
    """A run that was missing from the store, its solution of any status, and its time [s].

    The time is 0 if another campaign solved it in the meantime.
    """

    run: Run
    solution: Solution
    seconds: float


def missing(runs: Sequence[Run], store: SolutionStore, *, timeout: float = inf) -> list[Run]:
    """Return the runs that ``complete`` would solve, without duplicates."""
    return [run for run in dict.fromkeys(runs) if store.get(run, timeout=timeout) is None]


def complete(
    runs: Sequence[Run],
    store: SolutionStore,
    *,
    executor: Executor | None = None,
    timeout: float = inf,
    on_run: Callable[[Finished], None] | None = None,
) -> list[Solution]:
    """Return the solutions of all runs, in order, solving only those missing from the store.

    Every solution is written immediately and atomically; so a killed campaign resumes where it
    stopped, and several may share one store. A run that fails or times out is a solution too, with
    that status. All are solved with one thread of linear algebra, so that the numbers are the same
    wherever they were solved.

    A damaged solution in the store is named in a warning and solved again; one that timed out is
    retried if more time is allowed now. Without an executor, runs are solved here one by one.
    ``timeout`` is the wall time of a run from its start [s]; ``on_run`` is called after each run
    that was missing.

    Raises
    ------
    BayesdegError
        If the store cannot be written, or if workers or scheduler are lost permanently. Existing
        solutions stay in the store.
    RuntimeError
        If a worker raised; names the run. Runs in progress are stored before.
    """
    store.clean()
    known = {run: store.get(run, timeout=timeout) for run in dict.fromkeys(runs)}
    queue = deque(run for run, solution in known.items() if solution is None)
    work = _Work(store, timeout, on_run or (lambda _: None), queue)
    if executor is None:
        while (missed := work.next_run()) is not None:
            try:
                solution, seconds = solve(missed, missed.key(), timeout)
            except Exception as fault:
                raise _unexpected(missed, fault) from fault
            work.finish(missed, solution, seconds)
    else:
        active = _ActiveRuns(work, executor)
        try:
            while active.launch():
                active.land()
        finally:
            for future in active.runs:
                future.cancel()
        if active.failure is not None:
            raise active.failure
    found = known | work.solutions
    return [solved for run in runs if (solved := found[run]) is not None]


@dataclass
class _Work:
    """State of a campaign: remaining runs and solutions."""

    store: SolutionStore
    timeout: float
    on_run: Callable[[Finished], None]
    queue: deque[Run]
    solutions: dict[Run, Solution] = field(default_factory=dict)

    def next_run(self) -> Run | None:
        """Return the next run that is still unsolved."""
        while self.queue:
            run = self.queue.popleft()
            solution = self.store.get(run, timeout=self.timeout)
            if solution is None:
                return run
            self._found(Finished(run, solution, 0.0))
        return None

    def finish(self, run: Run, solution: Solution, seconds: float) -> None:
        """Store a solution."""
        if not self.store.put(run, solution, seconds=seconds, timeout=self.timeout):
            # another campaign works on the same runs: continue elsewhere
            self.queue.rotate(-round(0.62 * len(self.queue)))
            solution = self.store.get(run) or solution
        self._found(Finished(run, solution, seconds))

    def _found(self, finished: Finished) -> None:
        self.solutions[finished.run] = finished.solution
        self.on_run(finished)


@dataclass
class _ActiveRuns:
    """The runs submitted to an executor: never many more than it has workers.

    If a worker dies, all runs of its pool are suspect; they are retried one at a time to find the
    one that kills workers.
    """

    work: _Work
    executor: Executor
    runs: dict[Future[tuple[Solution, float]], Run] = field(default_factory=dict)
    suspects: deque[Run] = field(default_factory=deque)
    alone: bool = False
    deaths: Counter[Run] = field(default_factory=Counter)
    failure: Exception | None = None

    def launch(self) -> bool:
        """Submit runs up to capacity; return whether any run is in progress."""
        # a second run per worker, so that none waits while results are stored
        workers = self.executor.workers if isinstance(self.executor, Supervised) else None
        most = 2 * (workers or os.cpu_count() or 1)
        while self.failure is None:
            is_alone = self.suspects or (self.alone and self.runs)
            if len(self.runs) >= (1 if is_alone else most):
                break
            self.alone = bool(self.suspects)
            run = self.suspects.popleft() if self.suspects else self.work.next_run()
            if run is None:
                break
            try:
                future = self.executor.submit(solve, run, run.key(), self.work.timeout)
            except BrokenExecutor as fault:
                raise BayesdegError(
                    "a worker process died, and the executor opens no new one; solutions so far "
                    "are stored: run the same command again to resume"
                ) from fault
            self.runs[future] = run
        return bool(self.runs)

    def land(self) -> None:
        """Wait for results, store them, and handle lost ones."""
        done, _ = wait(self.runs, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
        if any(_broken(future) for future in done):
            done, _ = wait(self.runs)  # a broken pool ends them all
        fatal = self.executor.fatal if isinstance(self.executor, Supervised) else ()
        broken = []
        for future in done:
            run = self.runs.pop(future)
            if _broken(future):
                broken.append(run)
            elif future.cancelled():
                self.failure = self.failure or BayesdegError(f"{run} was cancelled externally")
            elif (fault := future.exception()) is None:
                self.work.finish(run, *future.result())
            elif isinstance(fault, fatal):
                self.failure = self.failure or _deadly(run)
            else:
                self.failure = self.failure or _unexpected(run, fault)
        if broken:
            retried = f"{len(broken)} runs are retried, one at a time"
            warnings.warn(f"a worker process died; {retried}", stacklevel=3)
            self.suspects.extend(broken)
        if len(broken) == 1:
            self.deaths[broken[0]] += 1
            if self.deaths[broken[0]] >= _DEATHS:
                self.failure = self.failure or _deadly(broken[0])
        if isinstance(self.executor, Supervised):
            self.executor.check()


def _broken(future: Future[tuple[Solution, float]]) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def _unexpected(run: Run, fault: BaseException) -> Exception:
    if isinstance(fault, BayesdegError):  # already says what to do
        return fault
    error = RuntimeError(f"{run} raised {fault!r}")
    error.__cause__ = fault
    return error


def _deadly(run: Run) -> BayesdegError:
    return BayesdegError(
        f"worker processes die whenever they solve the {run}: if memory is short, use fewer "
        "workers or a coarser mesh; all other solutions stay in the store"
    )


# ---- training on them


def build(
    geometry: Moulded,
    store: SolutionStore,
    *,
    recipe: Recipe | None = None,
    design: LocalDesign | None = None,
    executor: Executor | None = None,
    timeout: float = inf,
    on_run: Callable[[Finished], None] | None = None,
) -> Surrogate:
    """Solve missing runs and train an emulator of a geometry.

    With a design the curves are those of one study, instead of the recipe's over the whole range.
    The other arguments are those of `complete`.
    """
    if design is None:
        refuse_whole_range(geometry)
    recipe = recipe or Recipe()
    wanted = runs(geometry, recipe, design)
    found = complete(wanted, store, executor=executor, timeout=timeout, on_run=on_run)
    pairs = [
        (run, solution)
        for run, solution in zip(wanted, found, strict=True)
        if isinstance(solution, PathSamples)
    ]
    # sums over threads depend on their number
    with threadpool_limits(1):
        if design is None:
            return _trained_over_range(geometry, recipe, pairs)
        if design.only_departure:
            surrogate = replace(default_surrogate(), span=design.span)
        else:
            surrogate = _trained_for_study(geometry, recipe, design, pairs)
        if not design.dimensions:
            return surrogate
        return _with_departure(surrogate, geometry, recipe, design, dict(pairs))


Pairs = Sequence[tuple[Run, PathSamples]]


def _trained_over_range(geometry: Moulded, recipe: Recipe, pairs: Pairs) -> Surrogate:
    return train(
        *(_on(recipe.coarse_mesh, pairs), _on(recipe.fine_mesh, pairs)),
        span=TrainingRange(),
        length=geometry.dimensions.length,
        mesh_error=mesh_error_of(geometry),
        record=_record_of(geometry, recipe, WHOLE_RANGE),
    )


def _trained_for_study(
    geometry: Moulded, recipe: Recipe, design: LocalDesign, pairs: Pairs
) -> Surrogate:
    """Train on all solutions of the nominal actuator."""
    is_alike, terms = has_ground(geometry), local_terms(geometry)
    surrogate = train(
        *(_on(recipe.coarse_mesh, pairs), _on(recipe.fine_mesh, pairs)),
        span=design.span,
        length=geometry.dimensions.length,
        mesh_error=mesh_error_of(geometry),
        record=_record_of(geometry, recipe, LOCAL if is_alike else ALONE),
        terms=terms,
        usual=design.usual,
        ground=default_surrogate() if is_alike else None,
        units=design.units,
    )
    if not design.with_forces:
        return surrogate
    held = (_on(mesh, pairs, held=True) for mesh in (recipe.coarse_mesh, recipe.fine_mesh))
    return with_forces(surrogate, *held, usual=design.usual, terms=terms)


def _on(mesh: Resolution, pairs: Pairs, *, held: bool = False) -> Solved:
    """Return curves and solutions of the nominal actuator on a mesh."""
    found = [
        (run.curve, solution)
        for run, solution in pairs
        if run.origin is None and run.resolution == mesh and run.held is held
    ]
    return [curve for curve, _ in found], [solution for _, solution in found]


def local_terms(geometry: Moulded) -> FitTerms:
    """Return the terms of an emulator for one study."""
    return NEAR if has_ground(geometry) else BY_ITSELF


def _record_of(geometry: Moulded, recipe: Recipe, design: str) -> dict[str, object]:
    """Return the training data of an emulator, as recorded in its file."""
    record: dict[str, object] = {
        "design": design,
        "fit_version": FIT_VERSION,
        "seed": recipe.seed,
        "coarse_mesh_mm": vars(recipe.coarse_mesh),
        "fine_mesh_mm": vars(recipe.fine_mesh),
        "dimensions_mm": {n: v for n, v in vars(geometry.dimensions).items() if n != "path"},
    }
    if recipe.backend is not Backend.KERNELS:
        record["backend"] = recipe.backend
    return record if has_ground(geometry) else record | {"geometry": geometry.record()}


def _with_departure(
    surrogate: Surrogate,
    geometry: Moulded,
    recipe: Recipe,
    design: LocalDesign,
    solved: Mapping[Run, PathSamples],
) -> Surrogate:
    """Return an emulator that also covers the uncertain dimensions."""
    free, held = (
        _departures(surrogate, geometry, recipe, design, solved, held=held)
        for held in (False, True)
    )
    moved = {k for one, _ in free for k in np.flatnonzero(one.away)}
    if len(moved) < len(design.dimensions) or design.with_forces != bool(held):
        raise BayesdegError(
            "curves with a changed uncertain dimension end too early to be usable; give it a "
            "narrower law"
        )
    found = fit_departure(design.dimensions, free, held)
    record = json.loads(surrogate.record)
    record["dimensions_moved"] = found.facts
    return replace(surrogate, departure=found.departure, record=json.dumps(record, indent=1))


def _departures(
    surrogate: Surrogate,
    geometry: Moulded,
    recipe: Recipe,
    design: LocalDesign,
    solved: Mapping[Run, PathSamples],
    *,
    held: bool,
) -> list[tuple[MovedCurve, Observed]]:
    """Return departures of usable moved curves from their unmoved twins."""
    found = []
    observed = partial(observe_force, length=surrogate.length)
    if not held:
        observed = partial(observe, length=surrogate.length, compliance=surrogate.compliance)
    for one, run in zip(design.moved, _moved(geometry, recipe, design, held), strict=True):
        curve = with_layer(geometry, one.curve)
        still = replace(run, geometry=geometry, curve=curve, origin=None)
        if run not in solved or still not in solved:
            continue
        curves, samples = counted(
            [still.curve, run.curve], [solved[still], solved[run]], design.units
        )
        if not is_answered(curves[0], design.span):
            continue
        first, second = map(observed, curves, samples)
        if first is None or second is None:
            continue
        away = departed(first, second)
        if away is not None:
            found.append((one, away))
    return found


# ---- a campaign, its time and its progress

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
    """Estimate the time of what is left of a campaign, within seconds.

    If runs of a mesh were timed, here or before, their median is used; otherwise the time of one
    factorization of its tangent, of which a curve takes about `FACTORIZATIONS`.
    """
    counts = Counter(run.resolution for run in campaign.left())
    seconds, timed = campaign.store.seconds(), dict[Resolution, list[float]]()
    for run in dict.fromkeys((*campaign.runs, *campaign.alike)):
        if run.key() in seconds:
            timed.setdefault(run.resolution, []).append(seconds[run.key()])
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
        left = 0.0
        for mesh, number in self.expectation.left.items():
            # the expectation counts as one run
            spent = self.expectation.each[mesh] + self._spent.get(mesh, 0.0)
            each = spent / (1 + self._solved[mesh])
            left += max(0, number - self._solved[mesh]) * each
        while_ = max(self.expectation.each.values(), default=1.0)
        elapsed = self.clock() - self._start
        done = sum(self._spent.values())
        pace = (done + self.expectation.workers * while_) / (elapsed + while_)
        return left / pace


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
