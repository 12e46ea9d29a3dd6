"""An emulator is trained on a campaign of finite element runs: how long it takes, how far it is."""

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.status import Resolution, Status
from bayesdeg.emulator.campaign import Finished, build, complete, missing, runs
from bayesdeg.emulator.kept import Recipe, duration
from bayesdeg.emulator.solutions import ANSWERS, Run, SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.workers import Supervised
from bayesdeg.pipeline.progress import Progress

# runs that are solved to see how long one takes: the first of a process is slow, a fine one dear
FIRST_COARSE, FIRST_FINE = 4, 1


@dataclass(frozen=True)
class Campaign:
    """The finite element runs that an emulator of a geometry is trained on.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    recipe : Recipe
        Meshes and numbers of runs.
    store : SolutionStore
        Where solutions are kept, and looked for first.
    executor : Executor, optional
        Where to solve.
    timeout : float
        Time after which a run is given up, from its start [s].
    """

    geometry: Geometry
    recipe: Recipe
    store: SolutionStore
    executor: Executor | None = None
    timeout: float = np.inf

    @property
    def runs(self) -> list[Run]:
        """All runs, whether they are solved or not."""
        return runs(self.geometry, self.recipe)

    @property
    def workers(self) -> int:
        """How many runs are solved at a time."""
        return self.executor.workers if isinstance(self.executor, Supervised) else 1

    def left(self) -> list[Run]:
        """Return the runs that the store lacks."""
        return missing(self.runs, self.store, timeout=self.timeout)


@dataclass(frozen=True)
class Expectation:
    """What is left of a campaign.

    Parameters
    ----------
    left : mapping of Resolution to int
        Runs to be solved, by mesh.
    each : mapping of Resolution to float
        Measured time of one of them on one core [s].
    workers : int
        How many are solved at a time.
    """

    left: dict[Resolution, int]
    each: dict[Resolution, float]
    workers: int = 1

    @property
    def core_seconds(self) -> float:
        """Time of all runs that are left on one core [s]."""
        return sum(self.each[mesh] * number for mesh, number in self.left.items())

    @property
    def seconds(self) -> float:
        """Time that is left [s].

        Examples
        --------
        >>> coarse, fine = Resolution(3.0, 3.0, 3.0), Resolution(1.0, 1.0, 1.0)
        >>> Expectation({coarse: 100, fine: 10}, {coarse: 2.0, fine: 40.0}, workers=2).seconds
        300.0
        """
        return self.core_seconds / max(1, min(self.workers, sum(self.left.values())))

    def __str__(self) -> str:
        """Say how long it takes, and why."""
        runs = [
            f"{number} of {self.each[mesh]:.1f} s on a mesh of {mesh.along:g} mm"
            for mesh, number in self.left.items()
        ]
        at_once = "one at a time" if self.workers == 1 else f"{self.workers} at a time"
        return f"{duration(self.seconds)}: finite element curves, {' and '.join(runs)}, {at_once}"


def expect(campaign: Campaign, progress: Progress) -> Expectation:
    """Measure how long a campaign takes.

    A mesh of which no run was timed yet is tried on the first of its runs; the store keeps them.

    Parameters
    ----------
    campaign : Campaign
        Its solved runs are not repeated.
    progress : Progress
        Shows the runs that are tried.
    """
    left = campaign.left()
    timed = _timed(campaign)
    tried = [run for run in _first(campaign.recipe, left) if run.resolution not in timed]
    if tried:
        progress.stage("timing first curves", total=len(tried))
        complete(
            tried,
            campaign.store,
            executor=campaign.executor,
            timeout=campaign.timeout,
            on_run=lambda finished: progress.advance(1, f"{finished.seconds:.1f} s"),
        )
        solved = {run.key() for run in tried}
        left = [run for run in left if run.key() not in solved]
        timed = _timed(campaign)
    counts = Counter(run.resolution for run in left)
    each = {mesh: median(timed[mesh]) for mesh in counts}
    return Expectation(dict(counts), each, campaign.workers)


def _first(recipe: Recipe, left: list[Run]) -> list[Run]:
    """Return the runs to be timed: the fine one first, since it takes longest."""
    by_mesh = {recipe.fine_mesh: FIRST_FINE, recipe.coarse_mesh: FIRST_COARSE}
    return [
        run
        for mesh, number in by_mesh.items()
        for run in [run for run in left if run.resolution == mesh][:number]
    ]


def _timed(campaign: Campaign) -> dict[Resolution, list[float]]:
    seconds, by_mesh = campaign.store.seconds(), dict[Resolution, list[float]]()
    for run in campaign.runs:
        if run.key() in seconds:
            by_mesh.setdefault(run.resolution, []).append(seconds[run.key()])
    return by_mesh


@dataclass
class Meter:
    """Shows how far a campaign is, and how much longer it takes.

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

        The pace is core seconds done in a second. What was expected of it counts like a while of
        measurement, since runs that are under way are not counted before they end.
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
    """Solve what is left of a campaign and train the emulator, showing how far it is."""
    if expectation.left:
        on_run = Meter(expectation, progress)
    else:
        progress.stage("training on the curves")
        on_run = None
    return build(
        campaign.geometry,
        campaign.store,
        recipe=campaign.recipe,
        executor=campaign.executor,
        timeout=campaign.timeout,
        on_run=on_run,
    )


def endings(campaign: Campaign) -> list[tuple[Run, Status]]:
    """Return how every solved run of a campaign ended."""
    solved = [(run, campaign.store.get(run)) for run in campaign.runs]
    return [(run, solution.status) for run, solution in solved if solution is not None]
