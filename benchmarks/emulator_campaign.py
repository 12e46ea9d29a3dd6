"""Two workers against one on the same campaign: processes of this machine, and Dask's."""

import json
import os
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from forward_case import say

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import complete
from bayesdeg.surrogate.solutions import Run, SolutionStore
from bayesdeg.surrogate.workers import WorkerProcesses, cluster_executor, solve

DASK = Path(sysconfig.get_path("scripts")) / "dask"
GEOMETRY = Geometry(Dimensions(length=20.0, chambers=2))
RUNS, TURNS = 40, 3
STARTING = 60.0  # how long a scheduler may take to start [s]


@dataclass(frozen=True)
class Turn:
    """One campaign: wall time, the runs' own time [s], and the solutions as written."""

    wall: float
    core: float
    contents: dict[str, bytes]


def wanted(count: int) -> list[Run]:
    """Return quick runs of stable materials."""
    loads = tuple((0.4 * (np.arange(1, 15) / 14.0) ** 1.3).tolist())
    runs = []
    for softening, stiffening, paper in np.random.default_rng(3).random((count, 3)).tolist():
        c3 = 0.002 * 50.0**stiffening
        c2 = (softening - 0.5) * float(np.sqrt(3.0 * c3))
        material = MaterialGroups(c2, c3, 10.0 * 20.0**paper, paper_thickness=0.12)
        runs.append(Run(GEOMETRY, COARSE, Curve(loads, material)))
    return runs


@contextmanager
def dask_cluster(workers: int) -> Iterator[str]:
    """Start scheduler and workers as processes of their own; give the scheduler's address."""
    started: list[subprocess.Popen[bytes]] = []
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder, file = Path(name), Path(name) / "scheduler.json"

        def start(role: str, *options: str) -> None:
            log = stack.enter_context((folder / f"{role}{len(started)}.log").open("wb"))
            command = [str(DASK), role, "--scheduler-file", str(file), "--no-dashboard", *options]
            started.append(subprocess.Popen(command, cwd=folder, stdout=log, stderr=log))

        try:
            start("scheduler", "--host", "127.0.0.1", "--port", "0")
            deadline = time.monotonic() + STARTING
            while not file.exists() or not file.read_text(encoding="utf-8"):
                if time.monotonic() > deadline:
                    raise RuntimeError("the Dask scheduler did not start")
                time.sleep(0.05)
            for _ in range(workers):
                start("worker", "--nthreads", "1", "--local-directory", str(folder))
            yield json.loads(file.read_text(encoding="utf-8"))["address"]
        finally:
            for process in reversed(started):
                process.terminate()
            for process in started:
                process.wait()


def warmed(executor: Executor, runs: list[Run], *, workers: int) -> None:
    """Let every worker import the package, mesh, analyse and compile."""
    deadline = time.monotonic() + STARTING
    while getattr(executor, "workers", workers) < workers and time.monotonic() < deadline:
        time.sleep(0.5)
        executor.check()  # type: ignore[attr-defined]
    for _ in range(2):
        some = runs[: 4 * workers]
        wait([executor.submit(solve, run, run.key(), 1e9) for run in some])


def one_turn(executor: Executor, runs: list[Run]) -> Turn:
    with tempfile.TemporaryDirectory() as name:
        store = SolutionStore(Path(name))
        start = time.perf_counter()
        complete(runs, store, executor=executor)
        wall = time.perf_counter() - start
        contents = {path.name: path.read_bytes() for path in Path(name).glob("*.npz")}
        return Turn(wall, sum(store.seconds().values()), contents)


def parallel_efficiency() -> tuple[dict[str, float], dict[str, object]]:
    """Run the campaign with one and with two workers in turn, of both kinds."""
    runs = wanted(RUNS)
    turns: dict[str, list[Turn]] = {}
    load = [os.getloadavg()[0]]
    with ExitStack() as stack:
        executors: dict[str, Executor] = {}
        for workers in (1, 2):
            executors[f"processes {workers}"] = stack.enter_context(WorkerProcesses(workers))
            address = stack.enter_context(dask_cluster(workers))
            executors[f"dask {workers}"] = stack.enter_context(cluster_executor(address))
        for name, executor in executors.items():
            warmed(executor, runs, workers=int(name.split()[1]))
            turns[name] = []
        for _ in range(TURNS):
            for name in sorted(executors):
                turns[name].append(one_turn(executors[name], runs))
                last = turns[name][-1]
                say(f"  {name}: {last.wall:.2f} s, of it {last.core:.2f} core seconds")
            load.append(os.getloadavg()[0])
    return _efficiencies(turns), _details(turns, load)


def _efficiencies(turns: dict[str, list[Turn]]) -> dict[str, float]:
    return {
        kind: statistics.median(
            one.wall / (2.0 * two.wall)
            for one, two in zip(turns[f"{kind} 1"], turns[f"{kind} 2"], strict=True)
        )
        for kind in ("processes", "dask")
    }


def _details(turns: dict[str, list[Turn]], load: list[float]) -> dict[str, object]:
    reference = turns["processes 1"][0].contents
    everything = [turn for some in turns.values() for turn in some]
    return {
        "runs": RUNS,
        "cores": os.cpu_count(),
        "load_average": load,
        "wall_seconds": {name: [turn.wall for turn in some] for name, some in turns.items()},
        "core_seconds": {name: [turn.core for turn in some] for name, some in turns.items()},
        # cores that share memory slow each other down; this is what the campaign itself loses
        "share_of_time_spent_solving": {
            name: statistics.median(turn.core / turn.wall / int(name.split()[1]) for turn in some)
            for name, some in turns.items()
        },
        "all_bytes_the_same": all(turn.contents == reference for turn in everything),
        "python": sys.version.split()[0],
    }
