"""The fitted actuator solved by finite elements, for the report's picture and for ParaView."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs, dimensionless, material_groups
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import Material
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.errors import GeometryError
from bayesdeg.pipeline.assemble import level_grid
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.listening import Listener
from bayesdeg.prediction.bands import at_conditions
from bayesdeg.report.actuator_fields import nodal_fields
from bayesdeg.report.actuator_files import clear_solved, vtu_name, write_surface, write_vtu
from bayesdeg.report.actuator_surface import Shape, faces_of, shape_of
from bayesdeg.report.folder import RunFolder

Floats = NDArray[np.float64]

# some 730 bricks on the default geometry: a few seconds a state
PICTURE_MESH = Resolution(along=1.7, across=1.3, up=2.1)
STEPS = 8


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


def write_deformed(
    folder: RunFolder, fit: Fit, geometry: Geometry, *, resolution: Resolution = PICTURE_MESH
) -> None:
    """Solve the fitted actuator at the lowest and highest degradation rate; write what it shows.

    The parameters are posterior medians, the pressure is the highest that was applied. Where
    there is no equilibrium at it, the last one below is written; where there is none, nothing.

    Parameters
    ----------
    folder : RunFolder
        Gets the surface of all states for the report, and a VTU file of each.
    fit : Fit
        Of a model with actuator readings.
    geometry : Geometry
        The actuator as moulded.
    resolution : Resolution
        Of the mesh.
    """
    clear_solved(folder.path)
    actuator = Actuator(build_mesh(geometry, resolution))
    surface, nodes = faces_of(actuator.mesh.body)
    shapes = [
        shape
        for case in fitted_cases(fit)
        if (shape := _solve(folder, actuator, case, nodes)) is not None
    ]
    if shapes:
        write_surface(folder.path, replace(surface, shapes=tuple(shapes)))


def fitted_cases(fit: Fit) -> list[Case]:
    """Return the actuator at posterior medians, at the lowest and highest degradation rate."""
    assert fit.model.actuator is not None
    levels = np.unique(level_grid(fit.model)[[0, -1]])
    pressures = np.linspace(0.0, float(np.max(fit.model.actuator.pressure)), STEPS + 1)[1:]
    inputs = fitted_inputs(fit, levels, pressures)
    shape = (len(levels), len(pressures))
    groups = {
        name: np.broadcast_to(values, (1, *shape))[0, :, 0]
        for name, values in material_groups(inputs).items()
    }
    loads, scale, c1 = (
        np.broadcast_to(values, (1, *shape))[0]
        for values in (dimensionless(inputs)[0], inputs.linear_scale, inputs.c1)
    )
    return [
        Case(
            degradation=float(level),
            pressures=pressures[loads[i] > 0.0],
            curve=Curve(
                tuple(loads[i][loads[i] > 0.0].tolist()),
                Material(**{name: float(group[i]) for name, group in groups.items()}),
            ),
            linear_scale=float(scale[i, 0]),
            c1=float(c1[i, 0]),
        )
        for i, level in enumerate(levels)
    ]


def fitted_inputs(fit: Fit, degradation: Floats, pressure: Floats) -> Inputs:
    """Return what the mechanics is told at posterior medians, all causes at work.

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
    assert model.forward is not None
    listener = Listener(model.forward)
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    values = model.table.named(np.median(vectors, axis=0)[None])
    replace(model, forward=listener).curvature(values)
    return listener.heard[0]


def _solve(
    folder: RunFolder, actuator: Actuator, case: Case, nodes: NDArray[np.int64]
) -> Shape | None:
    """Write the VTU file of a case and return its shape; None if it has no equilibrium."""
    try:
        _, problem = actuator.problem(case.curve)
    except (GeometryError, ValueError):
        return None
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=case.curve.loads)
    finally:
        factorization.close()
    if not path.points:
        return None
    fields, body = nodal_fields(problem, path.points[-1].state), problem.system.body
    file = folder.path / vtu_name(case.degradation)
    write_vtu(file, body, fields, linear_scale=case.linear_scale, c1=case.c1)
    return shape_of(
        body,
        fields,
        nodes,
        linear_scale=case.linear_scale,
        degradation=case.degradation,
        pressure=float(case.pressures[len(path.points) - 1]),
    )
