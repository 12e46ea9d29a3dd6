"""A recipe becomes an emulator: its finite element runs are solved, and it is trained on them."""

from collections.abc import Callable
from concurrent.futures import Executor
from math import inf

from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.emulator.campaign import Finished, Kind, Run, complete
from bayesdeg.emulator.design import second_stage, space_filling
from bayesdeg.emulator.recipe import Recipe
from bayesdeg.emulator.scaling import TrainingRange
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.training import train

# rms deviation of CONVERGED from vanishing elements on the default geometry, fresh and degraded,
# as printed by `python benchmarks/forward.py --json` (details of error_pct)
MESH_ERROR = 0.0065


def runs(geometry: Geometry, recipe: Recipe | None = None) -> list[Run]:
    """Return the runs that an emulator of a geometry is trained on, those of the coarse mesh first.

    Examples
    --------
    >>> from bayesdeg.measure.settings import Dimensions
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
