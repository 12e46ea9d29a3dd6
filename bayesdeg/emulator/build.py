"""The recipe of an emulator: which meshes, how many curves, in which order."""

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import CONVERGED, Resolution
from bayesdeg.emulator.campaign import Run, complete, space_filling
from bayesdeg.emulator.scaling import TrainingBox
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.training import train

TRAINING_MESH = Resolution(along=2.5, across=2.5, up=2.1)
CORRECTION_MESH = CONVERGED
COARSE_CURVES = 256
FINE_CURVES = 32
SEED = 1
# rms deviation of CONVERGED from vanishing elements on the default geometry, fresh and degraded,
# as printed by `python benchmarks/forward.py --json` (details of error_pct)
MESH_ERROR = 0.0065


def runs(geometry: Geometry, box: TrainingBox | None = None) -> tuple[list[Run], list[Run]]:
    """Return the coarse and the fine runs that an emulator of a geometry is trained on."""
    box = box or TrainingBox()
    coarse = space_filling(box, COARSE_CURVES, seed=SEED)
    fine = coarse[:FINE_CURVES]
    return (
        [Run(geometry, TRAINING_MESH, curve) for curve in coarse],
        [Run(geometry, CORRECTION_MESH, curve) for curve in fine],
    )


def build(
    geometry: Geometry,
    store: Path,
    *,
    executor: Executor | None = None,
    on_run: Callable[[], None] | None = None,
) -> Surrogate:
    """Solve what the store lacks and train an emulator of a geometry.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    store : Path
        Folder of finite element solutions; an interrupted campaign goes on from it.
    executor : Executor, optional
        Where to solve.
    on_run : callable, optional
        Called after each solution.
    """
    box = TrainingBox()
    coarse, fine = runs(geometry, box)
    solved = complete([*coarse, *fine], store, executor=executor, on_run=on_run)
    return train(
        ([run.curve for run in coarse], solved[: len(coarse)]),
        ([run.curve for run in fine], solved[len(coarse) :]),
        box=box,
        length=geometry.dimensions.length,
        mesh_error=MESH_ERROR,
        record={
            "design": "scrambled Sobol'",
            "seed": SEED,
            "coarse_mesh_mm": vars(TRAINING_MESH),
            "fine_mesh_mm": vars(CORRECTION_MESH),
            "dimensions_mm": vars(geometry.dimensions),
        },
    )
