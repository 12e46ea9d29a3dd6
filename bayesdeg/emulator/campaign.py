"""Finite element runs over any executor; what stands in the store is never solved again."""

import os
import warnings
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field
from math import inf

from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.emulator.design import second_stage, space_filling
from bayesdeg.emulator.kept import Recipe
from bayesdeg.emulator.scaling import TrainingRange
from bayesdeg.emulator.solutions import Kind, Run, Solution, SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.training import train
from bayesdeg.emulator.workers import Supervised, solve
from bayesdeg.errors import BayesdegError

__all__ = ["Finished", "Kind", "Run", "Solution", "complete", "missing"]

# between looks at whether the workers can still be reached [s]
_PATIENCE = 2.0
# of a worker alone with one run, after which that run is given up
_DEATHS = 3


@dataclass(frozen=True)
class Finished:
    """What ``on_run`` is told of a run.

    Parameters
    ----------
    run : Run
        One that the store lacked when the campaign began.
    solution : Solution
        Whatever its status.
    seconds : float
        What it took; 0 if another campaign solved it in the meantime [s].
    """

    run: Run
    solution: Solution
    seconds: float


def missing(runs: Sequence[Run], store: SolutionStore, *, timeout: float = inf) -> list[Run]:
    """Return those of the runs that ``complete`` would solve, each once."""
    return [run for run in dict.fromkeys(runs) if store.get(run, timeout=timeout) is None]


def complete(
    runs: Sequence[Run],
    store: SolutionStore,
    *,
    executor: Executor | None = None,
    timeout: float = inf,
    on_run: Callable[[Finished], None] | None = None,
) -> list[Solution]:
    """Return the solutions of all runs, in their order, solving only those that the store lacks.

    Every solution is written as it comes, whole or not at all; so a campaign that was killed goes
    on where it stopped, and several may share one store. A run that fails or times out is a
    solution too: its status says so. All are solved with one thread of linear algebra, so that
    the numbers are the same wherever they were solved.

    Parameters
    ----------
    runs : sequence of Run
        What is wanted.
    store : SolutionStore
        A solution in it that is damaged is named in a warning and solved again; one that timed
        out is tried again if more time is allowed now.
    executor : Executor, optional
        Where to solve; by default here, one after another.
    timeout : float
        Wall time that a run may take where it is solved, from its start [s].
    on_run : callable, optional
        Called after each run that the store lacked.

    Raises
    ------
    BayesdegError
        If the store cannot be written, or if workers or scheduler are lost for good. What was
        solved stays in the store.
    RuntimeError
        If a worker raised; it names the run. Runs that were under way are stored before.
    """
    store.clean()
    known = {run: store.get(run, timeout=timeout) for run in dict.fromkeys(runs)}
    queue = deque(run for run, solution in known.items() if solution is None)
    campaign = _Campaign(store, timeout, on_run or (lambda _: None), queue)
    if executor is None:
        _solve_here(campaign)
    else:
        _solve_over(campaign, executor)
    found = known | campaign.solutions
    return [solution for run in runs if (solution := found[run]) is not None]


@dataclass
class _Campaign:
    """What is left to do, and what was found."""

    store: SolutionStore
    timeout: float
    on_run: Callable[[Finished], None]
    queue: deque[Run]
    solutions: dict[Run, Solution] = field(default_factory=dict)

    def next_run(self) -> Run | None:
        """Return the next run that nobody has solved in the meantime."""
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
            # another campaign is at work right here: go on far from it
            self.queue.rotate(-round(0.62 * len(self.queue)))
            solution = self.store.get(run) or solution
        self._found(Finished(run, solution, seconds))

    def _found(self, finished: Finished) -> None:
        self.solutions[finished.run] = finished.solution
        self.on_run(finished)


def _solve_here(campaign: _Campaign) -> None:
    while (run := campaign.next_run()) is not None:
        try:
            solution, seconds = solve(run, run.key(), campaign.timeout)
        except Exception as fault:
            raise _unexpected(run, fault) from fault
        campaign.finish(run, solution, seconds)


def _solve_over(campaign: _Campaign, executor: Executor) -> None:
    flight = _Flight(campaign, executor)
    try:
        while flight.launch():
            flight.land()
    finally:
        for future in flight.runs:
            future.cancel()
    if flight.failure is not None:
        raise flight.failure


@dataclass
class _Flight:
    """The runs that an executor was given: never many more than it has workers.

    If a worker dies, all runs that its pool was given are suspect; they are tried again one at a
    time, so that the one that kills is found.
    """

    campaign: _Campaign
    executor: Executor
    runs: dict[Future[tuple[Solution, float]], Run] = field(default_factory=dict)
    suspects: deque[Run] = field(default_factory=deque)
    alone: bool = False
    deaths: Counter[Run] = field(default_factory=Counter)
    failure: Exception | None = None

    def launch(self) -> bool:
        """Submit what there is room for; return whether anything is under way."""
        while self.failure is None and len(self.runs) < self._room():
            self.alone = bool(self.suspects)
            run = self.suspects.popleft() if self.suspects else self.campaign.next_run()
            if run is None:
                break
            try:
                future = self.executor.submit(solve, run, run.key(), self.campaign.timeout)
            except BrokenExecutor as fault:
                raise BayesdegError(
                    "a worker process died, and the executor opens no new one; what is solved so "
                    "far stays in the store: repeat the command to go on"
                ) from fault
            self.runs[future] = run
        return bool(self.runs)

    def _room(self) -> int:
        if self.suspects or (self.alone and self.runs):
            return 1
        # a second run for each worker, so that none waits for results to be stored
        workers = self.executor.workers if isinstance(self.executor, Supervised) else None
        return 2 * (workers or os.cpu_count() or 1)

    def land(self) -> None:
        """Wait for results, store them, and see to those that did not come."""
        done, _ = wait(self.runs, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
        if any(_broken(future) for future in done):
            done, _ = wait(self.runs)  # a broken pool ends them all
        broken = [self.runs[future] for future in done if _broken(future)]
        for future in done:
            run = self.runs.pop(future)
            if not _broken(future):
                self._take(run, future)
        if broken:
            self._suspect(broken)
        if isinstance(self.executor, Supervised):
            self.executor.check()

    def _take(self, run: Run, future: Future[tuple[Solution, float]]) -> None:
        fatal = self.executor.fatal if isinstance(self.executor, Supervised) else ()
        if future.cancelled():
            self.failure = self.failure or BayesdegError(f"{run} was cancelled from elsewhere")
        elif (fault := future.exception()) is None:
            self.campaign.finish(run, *future.result())
        elif isinstance(fault, fatal):
            self.failure = self.failure or _deadly(run)
        else:
            self.failure = self.failure or _unexpected(run, fault)

    def _suspect(self, runs: list[Run]) -> None:
        warnings.warn(
            f"a worker process died; {len(runs)} runs are tried again, one at a time", stacklevel=5
        )
        self.suspects.extend(runs)
        if len(runs) == 1:
            self.deaths[runs[0]] += 1
            if self.deaths[runs[0]] >= _DEATHS:
                self.failure = self.failure or _deadly(runs[0])


def _broken(future: Future[tuple[Solution, float]]) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def _unexpected(run: Run, fault: BaseException) -> Exception:
    if isinstance(fault, BayesdegError):  # says by itself what to do
        return fault
    error = RuntimeError(f"{run} raised {fault!r}")
    error.__cause__ = fault
    return error


def _deadly(run: Run) -> BayesdegError:
    return BayesdegError(
        f"worker processes die whenever they solve the {run}: perhaps memory is short, then take "
        "fewer workers or a coarser mesh; all other solutions stay in the store"
    )


# rms deviation of CONVERGED from vanishing elements on the default geometry, fresh and degraded,
# as printed by `python benchmarks/forward.py --json` (details of error_pct)
MESH_ERROR = 0.0065


def runs(geometry: Geometry, recipe: Recipe | None = None) -> list[Run]:
    """Return the runs that an emulator of a geometry is trained on, those of the coarse mesh first.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> len(runs(Geometry(Dimensions()), Recipe(coarse_runs=4, fine_runs=2)))
    6
    """
    recipe = recipe or Recipe()
    coarse, fine = _curves(recipe)
    return [
        *(Run(geometry, recipe.coarse_mesh, curve, Kind.SAMPLES) for curve in coarse),
        *(Run(geometry, recipe.fine_mesh, curve, Kind.SAMPLES) for curve in fine),
    ]


def _curves(recipe: Recipe) -> tuple[list[Curve], list[Curve]]:
    """Return the curves for the coarse and the fine mesh, which are among the former."""
    span = TrainingRange()
    coarse = space_filling(span, recipe.coarse_runs, seed=recipe.seed)
    fine = coarse[: recipe.fine_runs]
    if not recipe.has_second_stage:
        return coarse, fine
    further, finer = second_stage(span, coarse, recipe.fine_runs)
    return [*coarse, *further], [*fine, *finer]


def build(
    geometry: Geometry,
    store: SolutionStore,
    *,
    recipe: Recipe | None = None,
    executor: Executor | None = None,
    timeout: float = inf,
    on_run: Callable[[Finished], None] | None = None,
) -> Surrogate:
    """Solve what the store lacks and train an emulator of a geometry.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    store : SolutionStore
        Finite element solutions; an interrupted campaign goes on from it.
    recipe : Recipe, optional
        Meshes and numbers of curves.
    executor : Executor, optional
        Where to solve.
    timeout : float
        Time after which a run is given up, from its start [s].
    on_run : callable, optional
        Called after each run that the store lacked.
    """
    recipe = recipe or Recipe()
    wanted = runs(geometry, recipe)
    found = complete(wanted, store, executor=executor, timeout=timeout, on_run=on_run)
    solved = [solution for solution in found if isinstance(solution, PathSamples)]
    curves, many = [run.curve for run in wanted], len(_curves(recipe)[0])
    # sums of several threads depend on their number
    with threadpool_limits(1):
        return train(
            (curves[:many], solved[:many]),
            (curves[many:], solved[many:]),
            span=TrainingRange(),
            length=geometry.dimensions.length,
            mesh_error=MESH_ERROR,
            record={
                "design": "scrambled Sobol' over the material, none to four causes at work in each",
                "seed": recipe.seed,
                "coarse_mesh_mm": vars(recipe.coarse_mesh),
                "fine_mesh_mm": vars(recipe.fine_mesh),
                "dimensions_mm": vars(geometry.dimensions),
            },
        )
