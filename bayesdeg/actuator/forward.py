"""Inputs to prediction: the exact forward map, and the protocol that every forward map follows."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.equilibrium import Effort, Status, follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.system import Material, System

Floats = NDArray[np.float64]

# raised whenever a change of the model changes its numbers: stored solutions then count no more
MODEL_VERSION = "1"


@dataclass(frozen=True)
class Inputs:
    """What the mechanics needs; the arrays broadcast over walkers × specimens × pressures.

    Parameters
    ----------
    pressure : array
        True gauge pressure in the chambers [kPa], not negative.
    c1, c2, c3 : array
        Yeoh constants [MPa].
    linear_scale : array
        Size over moulded size [–].
    paper_stiffness : array
        Et of the paper [N/m].
    reference_pressure : array
        True gauge pressure at which the reading was set to zero [kPa].
    """

    pressure: Floats
    c1: Floats
    c2: Floats
    c3: Floats
    linear_scale: Floats
    paper_stiffness: Floats
    reference_pressure: Floats | None = None


@dataclass(frozen=True)
class Prediction:
    """What a forward map answers; all arrays have the shape that the inputs broadcast to.

    Parameters
    ----------
    curvature : array
        Bend angle over deformed arc length of the bottom line, less that at the reference
        pressure [1/m]; nan where ``status`` is not 0.
    bend_angle : array
        Rotation of the free end face [deg].
    peak_stretch : array
        Largest principal stretch that 99 % of the volume stays below [–].
    slope : array
        p ∂κ/∂p, the change of curvature for a relative change of pressure [1/m]. It is nearly
        that for a relative loss of stiffness, which also changes the paper's group; the exact
        map takes differences over the loads that were asked for.
    sd : array
        Standard error of the map's own curvature [1/m].
    status : array of int
        ``Status`` of each value.
    """

    curvature: Floats
    bend_angle: Floats
    peak_stretch: Floats
    slope: Floats
    sd: Floats
    status: NDArray[np.int64]


class ForwardMap(Protocol):
    """Exact or emulated: the same call."""

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction for the inputs."""


@dataclass(frozen=True)
class Curve:
    """The inputs of one pressure curve in dimensionless groups.

    Parameters
    ----------
    loads : tuple of float
        p/C1, rising, above 0 [–].
    material : Material
        The other groups.
    """

    loads: tuple[float, ...]
    material: Material


@dataclass(frozen=True)
class CurveSolution:
    """One pressure curve at moulded size, as far as it was reached.

    Parameters
    ----------
    bend_angle, arc_length, peak_stretch : array, shape (n_reached,)
        [rad], [mm], [–].
    status : Status
        How the path ended.
    limit_load : float
        p/C1 of the limit point; inf if none was met [–].
    iterations : int
        Newton iterations spent.
    solver : str
        The direct solver that was used.
    """

    bend_angle: Floats
    arc_length: Floats
    peak_stretch: Floats
    status: Status
    limit_load: float
    iterations: int
    solver: str


def solve_curve(
    system: System, curve: Curve, *, effort: Effort | None = None, solver: str | None = None
) -> CurveSolution:
    """Solve one pressure curve on a mesh; failures are in the status."""
    factorization = open_factorization(system.upper, solver)
    try:
        path = follow(
            system, factorization, material=curve.material, loads=curve.loads, effort=effort
        )
    finally:
        factorization.close()
    angle, rows = 0.0, []
    for state in path.states:
        reading = read_state(system.mesh, state, previous_angle=angle)
        angle = reading.bend_angle
        rows.append((angle, reading.arc_length, reading.peak_stretch))
    table = np.array(rows).reshape(-1, 3)
    return CurveSolution(
        table[:, 0],
        table[:, 1],
        table[:, 2],
        path.status,
        path.limit_load,
        path.iterations,
        factorization.name,
    )


class ExactMap:
    """The finite element model as a forward map: one load path for each material.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    resolution : Resolution
        Of the mesh.
    executor : Executor, optional
        Where the curves are solved; by default here, one after another.
    on_curve : callable, optional
        Called after each curve, for a progress bar.
    """

    def __init__(
        self,
        geometry: Geometry,
        resolution: Resolution,
        *,
        executor: Executor | None = None,
        on_curve: Callable[[], None] | None = None,
    ) -> None:
        self.geometry, self.resolution = geometry, resolution
        self._executor = executor
        self._on_curve = on_curve or (lambda: None)

    def __call__(self, inputs: Inputs) -> Prediction:
        """Solve every curve; the last axis of the inputs runs over pressures."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        groups = dimensionless(inputs)
        shape = np.broadcast_shapes(*(np.shape(group) for group in groups))
        load, *rest = (np.broadcast_to(group, shape).reshape(-1, shape[-1]) for group in groups)
        curves = [_curve(row, *(other[i] for other in rest)) for i, row in enumerate(load)]
        scale = np.broadcast_to(inputs.linear_scale, shape).reshape(-1, shape[-1])
        parts = [
            _place(solution, curve, load[i], scale[i])
            for i, (curve, solution) in enumerate(zip(curves, self._solve(curves), strict=True))
        ]
        arrays = [np.stack(column).reshape(shape) for column in zip(*parts, strict=True)]
        curvature, angle, stretch, slope, status = arrays
        sd = np.zeros_like(curvature)
        return Prediction(curvature, angle, stretch, slope, sd, status.astype(np.int64))

    def _solve(self, curves: list[Curve]) -> list[CurveSolution]:
        tasks = [(self.geometry, self.resolution, curve) for curve in curves]
        apply = map if self._executor is None else self._executor.map
        solutions = []
        for solution in apply(solve_task, tasks):
            if len(solution.bend_angle) or solution.status != Status.CONVERGED:
                self._on_curve()  # a curve without loads is no work
            solutions.append(solution)
        return solutions


def dimensionless(inputs: Inputs) -> tuple[Floats, Floats, Floats, Floats]:
    """Return p/C1, C2/C1, C3/C1 and Et/(C1 s) [mm]: all that the curvature times s depends on.

    All are nan where C1 is not above 0, since ratios hide its sign.

    Examples
    --------
    >>> one = np.ones(1)
    >>> inputs = Inputs(240 * one, 0.3 * one, 0 * one, 0 * one, 0.8 * one, 3e4 * one)
    >>> [float(group[0]) for group in dimensionless(inputs)]
    [0.8, 0.0, 0.0, 125.0]
    """
    c1 = np.where(inputs.c1 > 0.0, inputs.c1, np.nan)
    load = inputs.pressure * 1e-3 / c1
    paper = inputs.paper_stiffness * 1e-3 / (c1 * inputs.linear_scale)
    return load, inputs.c2 / c1, inputs.c3 / c1, paper


def relative_to_reference(forward: ForwardMap, inputs: Inputs) -> Prediction:
    """Return the prediction with the curvature at the reference pressure taken off."""
    assert inputs.reference_pressure is not None
    plain = forward(replace(inputs, reference_pressure=None))
    zero = forward(replace(inputs, pressure=inputs.reference_pressure, reference_pressure=None))
    return replace(
        plain,
        curvature=plain.curvature - zero.curvature,
        bend_angle=plain.bend_angle - zero.bend_angle,
        slope=plain.slope - zero.slope,
        status=np.maximum(plain.status, zero.status),
    )


_SYSTEMS: dict[tuple[Geometry, Resolution], System] = {}


def solve_task(task: tuple[Geometry, Resolution, Curve]) -> CurveSolution:
    """Solve one curve, with this process's copy of the mesh built once."""
    geometry, resolution, curve = task
    key = (geometry, resolution)
    if key not in _SYSTEMS:
        _SYSTEMS[key] = System(build_mesh(geometry, resolution))
    return solve_curve(_SYSTEMS[key], curve)


def _curve(load: Floats, c2_ratio: Floats, c3_ratio: Floats, paper_group: Floats) -> Curve:
    for name, group in (("C2/C1", c2_ratio), ("C3/C1", c3_ratio), ("paper", paper_group)):
        if np.ptp(group) > 0.0:
            raise ValueError(f"{name} changes along a curve: a load path needs one material")
    loads = np.unique(load[load > 0.0])
    material = Material(float(c2_ratio[0]), float(c3_ratio[0]), float(paper_group[0]))
    return Curve(tuple(float(q) for q in loads), material)


def _place(
    solution: CurveSolution, curve: Curve, load: Floats, scale: Floats
) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.int64]]:
    """Put the solved loads, and rest at zero load, where they stand among the observations."""
    reached = len(solution.bend_angle)
    known = np.concatenate([[0.0], curve.loads])
    at = np.searchsorted(known, np.maximum(load, 0.0))
    ok = at <= reached
    angle = np.concatenate([[0.0], solution.bend_angle])
    kappa = np.concatenate([[0.0], solution.bend_angle / solution.arc_length * 1e3])
    stretch = np.concatenate([[1.0], solution.peak_stretch])
    slope = known[: reached + 1] * np.gradient(kappa, known[: reached + 1]) if reached else kappa
    take = np.minimum(at, reached)
    status = np.where(ok, int(Status.CONVERGED), int(solution.status))
    curvature, degrees, peak, change = (
        np.where(ok, values[take], np.nan) for values in (kappa, np.degrees(angle), stretch, slope)
    )
    return curvature / scale, degrees, peak, change / scale, status
