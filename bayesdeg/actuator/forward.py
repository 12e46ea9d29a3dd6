"""Inputs to prediction: the exact forward map, and the protocol that every forward map follows."""

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Actuator, Curve, CurveSolution, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import (
    Inputs,
    Prediction,
    dimensionless,
    material_groups,
    relative_to_reference,
)
from bayesdeg.actuator.material import Material
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.status import Effort, Resolution, Status

Floats = NDArray[np.float64]

# of a campaign: beyond so many factorizations a path is not one that an emulator should learn
SAMPLING = Effort(total=150)


class ExactMap:
    """The finite element model as a forward map: one load path for each specimen.

    Where its material, weight or shape is not the same in all readings, as in several mounts, one
    for each of them.

    Parameters
    ----------
    geometry : Geometry
        The actuator as moulded.
    resolution : Resolution
        Of the mesh.
    executor : Executor, optional
        Where the curves are solved; by default here, one after another.
    on_start, on_curve : callable, optional
        Called with the number of curves before, and after each curve, for a progress bar.
    """

    def __init__(
        self,
        geometry: Geometry,
        resolution: Resolution,
        *,
        executor: Executor | None = None,
        on_start: Callable[[int], None] | None = None,
        on_curve: Callable[[], None] | None = None,
    ) -> None:
        self.geometry, self.resolution = geometry, resolution
        self._executor = executor
        self._on_start = on_start or (lambda count: None)
        self._on_curve = on_curve or (lambda: None)

    def __call__(self, inputs: Inputs) -> Prediction:
        """Solve every curve; the last axis of the inputs runs over pressures."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        load, *_ = dimensionless(inputs)
        groups = material_groups(inputs)
        shape = np.broadcast_shapes(load.shape, *(np.shape(group) for group in groups.values()))
        load = np.broadcast_to(load, shape).reshape(-1, shape[-1])
        rows = {
            name: np.broadcast_to(group, shape).reshape(-1, shape[-1])
            for name, group in groups.items()
        }
        scale = np.broadcast_to(inputs.linear_scale, shape).reshape(-1, shape[-1])
        places = [(i, at) for i in range(len(load)) for at in _alike(rows, i)]
        curves = [
            _curve(load[i, at], {name: group[i, at[0]] for name, group in rows.items()})
            for i, at in places
        ]
        found = np.empty((5, *load.shape))
        for (i, at), curve, solution in zip(places, curves, self._solve(curves), strict=True):
            found[:, i, at] = _place(solution, curve, load[i, at], scale[i, at])
        curvature, angle, stretch, slope, status = found.reshape(5, *shape)
        return Prediction(
            curvature=curvature,
            bend_angle=angle,
            peak_stretch=stretch,
            slope=slope,
            sd=np.zeros(shape),
            bend_angle_sd=np.zeros(shape),
            peak_stretch_sd=np.zeros(shape),
            status=status.astype(np.int64),
        )

    def _solve(self, curves: list[Curve]) -> list[CurveSolution]:
        tasks = [(self.geometry, self.resolution, curve) for curve in curves]
        apply = map if self._executor is None else self._executor.map
        # a curve without loads is no work
        self._on_start(sum(len(curve.loads) > 0 for curve in curves))
        solutions = []
        for curve, solution in zip(curves, apply(solve_task, tasks), strict=True):
            if curve.loads:
                self._on_curve()
            solutions.append(solution)
        return solutions


MESHES = 3  # held by a process; factors of a fine one take some hundred megabytes


class _Held:
    """The meshes last used by this process, with their solvers; older ones are closed."""

    def __init__(self) -> None:
        self._actuators: dict[tuple[Geometry, Resolution], Actuator] = {}

    def get(self, geometry: Geometry, resolution: Resolution) -> Actuator:
        key = (geometry, resolution)
        found = self._actuators.pop(key, None) or Actuator(build_mesh(geometry, resolution))
        self._actuators[key] = found
        while len(self._actuators) > MESHES:
            self._actuators.pop(next(iter(self._actuators))).close()
        return found


_HELD = _Held()


def solve_task(
    task: tuple[Geometry, Resolution, Curve], *, effort: Effort | None = None
) -> CurveSolution:
    """Solve one curve, with this process's copy of the mesh built once."""
    geometry, resolution, curve = task
    return _HELD.get(geometry, resolution).solve(curve, effort=effort)


def sample_task(
    task: tuple[Geometry, Resolution, Curve], *, effort: Effort | None = None
) -> PathSamples:
    """Sample one curve, with this process's copy of the mesh built once."""
    geometry, resolution, curve = task
    return _HELD.get(geometry, resolution).sample(curve, effort=effort or SAMPLING)


def _alike(rows: dict[str, Floats], row: int) -> list[NDArray[np.intp]]:
    """Return which readings of a specimen have the same material, weight and shape."""
    columns = np.stack([group[row] for group in rows.values()])
    which = np.unique(columns, axis=1, return_inverse=True)[1].ravel()
    return [np.flatnonzero(which == k) for k in range(int(which.max(initial=-1)) + 1)]


def _curve(load: Floats, groups: dict[str, Floats]) -> Curve:
    loads = np.unique(load[(load > 0.0) | ~np.isfinite(load)])
    material = Material(**{name: float(group) for name, group in groups.items()})
    return Curve(tuple(float(q) for q in loads), material)


def _place(
    solution: CurveSolution, curve: Curve, load: Floats, scale: Floats
) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.int64]]:
    """Put the solved loads, and rest at zero load, where they stand among the observations."""
    values = np.vstack([solution.rest, solution.readings])
    rates = np.vstack([solution.rest_rates, solution.rates])
    angle, length = values[:, 0], values[:, 1]
    kappa = angle / length * 1e3
    known = np.concatenate([[0.0], curve.loads])
    slope = known[: len(kappa)] * (rates[:, 0] - angle / length * rates[:, 1]) / length * 1e3
    at = np.searchsorted(known, load)
    solved = np.isfinite(solution.rest[0])
    ok = (at < len(kappa)) & (load >= 0.0) & solved
    take = np.minimum(at, len(kappa) - 1)
    failed = np.where(load >= 0.0, int(solution.status), int(Status.INVALID_INPUT))
    status = np.where(ok, int(Status.CONVERGED), failed)
    curvature, degrees, peak, change = (
        np.where(ok, column[take], np.nan)
        for column in (kappa - kappa[0], np.degrees(angle - angle[0]), values[:, 3], slope)
    )
    return curvature / scale, degrees, peak, change / scale, status
