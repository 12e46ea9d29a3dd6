"""A design of finite element runs over any executor; what stands in the store is never repeated."""

import hashlib
import json
import os
import tempfile
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from bayesdeg.actuator.curve import MODEL_VERSION, Curve, CurveSolution
from bayesdeg.actuator.forward import solve_task
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.actuator.status import Status
from bayesdeg.emulator.scaling import TrainingBox

Floats = NDArray[np.float64]

# dense where the curve starts, so that the initial slope is known
LOAD_SHARES = tuple(float(x) for x in (np.arange(1, 15) / 14.0) ** 1.3)


@dataclass(frozen=True)
class Run:
    """One finite element curve that a campaign wants.

    Parameters
    ----------
    geometry : Geometry
        As moulded.
    resolution : Resolution
        Of the mesh.
    curve : Curve
        Loads and material in dimensionless groups.
    """

    geometry: Geometry
    resolution: Resolution
    curve: Curve

    def key(self) -> str:
        """Return the content's name: code version, geometry, mesh and inputs, hashed."""
        content = json.dumps([MODEL_VERSION, asdict(self)], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()


def space_filling(box: TrainingBox, count: int, *, seed: int, skip: int = 0) -> list[Curve]:
    """Return curves over a scrambled Sobol' design of the material groups.

    Parameters
    ----------
    box : TrainingBox
        What the emulator shall cover.
    count : int
        Number of curves.
    seed : int
        Of the scrambling.
    skip : int
        Points of the sequence to leave out first, for a second set that shares none.

    Examples
    --------
    >>> len(space_filling(TrainingBox(), 3, seed=1)[0].loads)
    14
    """
    sampler = qmc.Sobol(len(box.lower), rng=np.random.default_rng(seed))
    points = sampler.random_base2(int(np.ceil(np.log2(count + skip))))[skip : skip + count]
    largest = box.largest_load(2.0 * points[:, 1] - 1.0)
    return [
        Curve(tuple(float(load * share) for share in LOAD_SHARES), box.material(point))
        for load, point in zip(largest, points, strict=True)
    ]


def complete(
    runs: Sequence[Run],
    store: Path,
    *,
    executor: Executor | None = None,
    on_run: Callable[[], None] | None = None,
) -> list[CurveSolution]:
    """Return the solutions of all runs, solving only those that the store lacks.

    Every solution is written as it comes, whole or not at all; so a campaign that was killed goes
    on where it stopped. A stored solution that cannot be read is named in a warning and solved
    again.

    Parameters
    ----------
    runs : sequence of Run
        What is wanted.
    store : Path
        Folder of solutions; made if need be. Several campaigns may share it.
    executor : Executor, optional
        Where to solve; by default here.
    on_run : callable, optional
        Called after each solution.
    """
    store.mkdir(parents=True, exist_ok=True)
    keys = [run.key() for run in runs]
    known = {key: _stored(store / f"{key}.npz") for key in set(keys)}
    missing = {key: run for key, run in zip(keys, runs, strict=True) if known[key] is None}
    tasks = [(run.geometry, run.resolution, run.curve) for run in missing.values()]
    apply = map if executor is None else executor.map
    for key, solved in zip(missing, apply(solve_task, tasks), strict=True):
        _write(store / f"{key}.npz", solved)
        known[key] = solved
        if on_run is not None:
            on_run()
    return [solution for key in keys if (solution := known[key]) is not None]


def read_solution(path: Path) -> CurveSolution:
    """Return a stored solution."""
    # opened here because np.load leaves a truncated archive open
    with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
        return CurveSolution(
            readings=stored["readings"],
            rates=stored["rates"],
            rest=stored["rest"],
            rest_rates=stored["rest_rates"],
            status=Status(int(stored["status"])),
            limit_load=float(stored["limit_load"]),
            iterations=int(stored["iterations"]),
            solver=str(stored["solver"]),
        )


def _stored(path: Path) -> CurveSolution | None:
    if not path.exists():
        return None
    try:
        return read_solution(path)
    except (ValueError, KeyError, TypeError, EOFError, BadZipFile) as fault:
        warnings.warn(f"{path} is damaged and is solved again: {fault}", stacklevel=3)
        return None


def _write(path: Path, solution: CurveSolution) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as part:
            arrays = {key: np.asarray(value) for key, value in vars(solution).items()}
            np.savez(part, allow_pickle=False, **arrays)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
