"""The fitted actuator solved by finite elements, for the report's picture and for ParaView."""

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body
from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.families import with_dimensions
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs, load_of, material_groups
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import COARSE, PathEffort, Resolution
from bayesdeg.analysis.calibrate import Fit, Listener
from bayesdeg.assembly.assemble import level_grid
from bayesdeg.criticism.fit.side_by_side import later
from bayesdeg.data.settings import Dimensions
from bayesdeg.data.uncertain import PREFIX, dimensions_among
from bayesdeg.errors import GeometryError
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.surface import (
    NodalFields,
    Shape,
    Surface,
    clear_solved,
    faces_of,
    nodal_fields,
    shape_of,
    vtu_name,
    write_surface,
    write_vtu,
)
from bayesdeg.prediction.predictive import at_conditions
from bayesdeg.surrogate.workers import block_sigint, end_with_parent

Floats = NDArray[np.float64]

# some 730 bricks on the default geometry: a few seconds a state
PICTURE_MESH = Resolution(along=1.7, across=1.3, up=2.1)
STEPS = 8
# half a minute at most: near ballooning the steps of a path become ever smaller; the last state
# reached is as good a picture
ENOUGH = PathEffort(total=60)


@dataclass(frozen=True)
class Case:
    """One actuator to solve.

    Parameters
    ----------
    degradation : float
        Degradation rate [%].
    pressures : array, shape (n,)
        As read by the sensor, rising, the last of them drawn [kPa].
    curve : Curve
        The same in dimensionless groups.
    linear_scale : float
        True size over moulded size [–].
    c1 : float
        Unit of stress [MPa].
    """

    degradation: float
    pressures: Floats
    curve: Curve
    linear_scale: float
    c1: float


@dataclass(frozen=True)
class Solved:
    """An equilibrium of a case.

    Parameters
    ----------
    case : Case
        What was solved.
    body : Body
        As the material left it.
    surface : Surface
        Its faces, without a shape.
    nodes : array of int
        Of the surface.
    fields : NodalFields
        At the nodes.
    pressure : float
        As read by the sensor; the last one that has an equilibrium [kPa].
    """

    case: Case
    body: Body
    surface: Surface
    nodes: NDArray[np.int64]
    fields: NodalFields
    pressure: float

    @property
    def shape(self) -> Shape:
        """The data of the figure."""
        return shape_of(
            self.body,
            self.fields,
            self.nodes,
            linear_scale=self.case.linear_scale,
            degradation=self.case.degradation,
            pressure=self.pressure,
        )


type Begun = Callable[[], list[Solved]]


def begin(
    fit: Fit,
    geometry: Moulded,
    executor: Executor | None = None,
    *,
    resolution: Resolution | None = None,
) -> Begun:
    """Start solving the actuators of a figure; return a function that waits for the solutions.

    Parameters
    ----------
    fit, geometry, resolution
        As of `write_deformed`.
    executor : Executor, optional
        Where to solve, each case by itself, beside other work; by default when they are asked for.
    """
    geometry = fitted_geometry(geometry, fit)
    work = partial(solve, geometry, resolution or geometry.mesh_like(PICTURE_MESH))
    cases = [later(partial(work, case), executor) for case in fitted_cases(fit)]
    return partial(_those_solved, cases)


def _those_solved(cases: list[Callable[[], Solved | None]]) -> list[Solved]:
    return [found for found in (case() for case in cases) if found is not None]


def write_deformed(
    folder: RunFolder,
    fit: Fit,
    geometry: Moulded,
    *,
    resolution: Resolution | None = None,
    begun: Begun | None = None,
) -> None:
    """Solve the fitted actuator at the lowest and highest degradation rate, and write it.

    Parameters are posterior medians; the pressure is the highest applied. If there is no
    equilibrium at it, the last one below is written, or nothing if there is none.

    Parameters
    ----------
    folder : RunFolder
        Gets the surface of all states for the report, and a VTU file of each.
    fit : Fit
        Of a model with actuator readings.
    geometry : Moulded
        The actuator as moulded.
    resolution : Resolution, optional
        Of the mesh; by default one that is to the actuator what ``PICTURE_MESH`` is to the default.
    begun : callable, optional
        What `begin` returned, where they are being solved already.
    """
    clear_solved(folder.path)
    solved = (begun or begin(fit, geometry, resolution=resolution))()
    for one in solved:
        file = folder.path / vtu_name(one.case.degradation)
        scale = one.case.linear_scale
        write_vtu(file, one.body, one.fields, linear_scale=scale, c1=one.case.c1)
    if solved:
        shapes = tuple(one.shape for one in solved)
        write_surface(folder.path, replace(solved[0].surface, shapes=shapes))


def fitted_geometry(geometry: Moulded, fit: Fit) -> Moulded:
    """Return the actuator with uncertain dimensions at their posterior medians."""
    table = fit.model.table
    draws = table.named(fit.chain.vectors)
    names = dimensions_among(table.names)
    found = {name: float(np.median(draws[f"{PREFIX}{name}"])) for name in names}
    return with_dimensions(geometry, found) if found else geometry


def fitted_cases(fit: Fit) -> list[Case]:
    """Return the actuator at posterior medians, at the lowest and highest degradation rate."""
    levels = np.unique(level_grid(fit.model)[[0, -1]])
    pressures = np.linspace(
        0.0, float(np.max(fit.model.data_of(Curvature).tests.pressure)), STEPS + 1
    )[1:]
    inputs = fitted_inputs(fit, levels, pressures)
    shape = (len(levels), len(pressures))
    groups = {
        name: np.broadcast_to(values, (1, *shape))[0, :, 0]
        for name, values in material_groups(inputs).items()
    }
    loads, scale, c1 = (
        np.broadcast_to(values, (1, *shape))[0]
        for values in (load_of(inputs), inputs.linear_scale, inputs.c1)
    )
    return [
        Case(
            degradation=float(level),
            pressures=pressures[loads[i] > 0.0],
            curve=Curve(
                tuple(loads[i][loads[i] > 0.0].tolist()),
                MaterialGroups(**{name: float(group[i]) for name, group in groups.items()}),
            ),
            linear_scale=float(scale[i, 0]),
            c1=float(c1[i, 0]),
        )
        for i, level in enumerate(levels)
    ]


def fitted_inputs(fit: Fit, degradation: Floats, pressure: Floats) -> Inputs:
    """Return the inputs of the mechanics at posterior medians, with all causes active.

    Parameters
    ----------
    fit : Fit
        Of a model with actuator readings.
    degradation, pressure : array, shape (n_levels,) and (n_pressures,)
        [%], and as read by the sensor [kPa].

    Returns
    -------
    Inputs
        Arrays broadcast to (1, n_levels, n_pressures).
    """
    model = at_conditions(fit.model, degradation, pressure)
    assert model.world.forward is not None
    listener = Listener(model.world.forward)
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    values = model.table.named(np.median(vectors, axis=0)[None])
    kind, listening = model.data_of(Curvature), model.with_world(forward=listener)
    kind.predicted(listening.tests(values))
    return listener.heard[0]


def solve(geometry: Moulded, resolution: Resolution, case: Case) -> Solved | None:
    """Solve a case; None if it has no equilibrium.

    Parameters
    ----------
    geometry : Moulded
        The actuator as moulded.
    resolution : Resolution
        Of the mesh.
    case : Case
        MaterialGroups and pressures.
    """
    actuator = Actuator(build_mesh(geometry, resolution))
    surface, nodes = faces_of(actuator.mesh.body)
    try:
        _, problem = actuator.problem(case.curve)
    except (GeometryError, ValueError):
        return None
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=case.curve.loads, effort=ENOUGH)
    finally:
        factorization.close()
    if not path.points:
        return None
    fields = nodal_fields(problem, path.points[-1].state)
    pressure = float(case.pressures[len(path.points) - 1])
    return Solved(case, problem.system.body, surface, nodes, fields, pressure)


BEHIND = 10  # niceness: the fits go first


def is_compiled(cache: Path) -> bool:
    """Return whether numba's cache in a folder holds the largest of the kernels."""
    return any(cache.glob("kernels.solid-*.nbi"))


def compile_beside() -> None:
    """Compile the kernels in a separate, low-priority process, unless already done."""
    if not is_compiled(Path(kernels.solid.stats.cache_path)):
        context = multiprocessing.get_context("spawn")
        with block_sigint():
            context.Process(target=compile_kernels, daemon=True).start()


def compile_kernels() -> None:
    """Solve a coarse actuator with paper under a small load: compiles all that a figure needs."""
    end_with_parent()
    if hasattr(os, "nice"):
        os.nice(BEHIND)
    load = 1e-3
    material = MaterialGroups(c2_ratio=0.0, c3_ratio=0.0, paper_group=1.0)
    case = Case(0.0, np.array([1.0]), Curve((load,), material), linear_scale=1.0, c1=1.0)
    solve(Geometry(Dimensions()), COARSE, case)
