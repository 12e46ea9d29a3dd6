"""Solve one pressure curve: from dimensionless groups to readings and derivatives at every load."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.demand import MEASURES, demanded_strain, needed
from bayesdeg.actuator.equilibrium import LoadStep, Path, follow
from bayesdeg.actuator.families import with_dimensions
from bayesdeg.actuator.inputs import (
    Further,
    Inputs,
    Prediction,
    load_of,
    material_groups,
    relative_to_reference,
)
from bayesdeg.actuator.linear import Factorization, open_factorization
from bayesdeg.actuator.material import LayerGroups, MaterialGroups
from bayesdeg.actuator.mesh import (
    ActuatorMesh,
    build_mesh,
    moved_onto,
    reshaped,
    tip_edge,
    with_held_tip,
)
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.outputs import (
    OUTPUTS,
    PEAK,
    Reading,
    measured_strains,
    read_state,
    read_with_gradients,
)
from bayesdeg.actuator.problem import DiscreteEquations, Point, Problem, System
from bayesdeg.actuator.sensitivity import (
    INPUTS,
    Variation,
    derivatives,
    reaction_derivatives,
    variations,
)
from bayesdeg.actuator.status import MODEL_VERSION as MODEL_VERSION
from bayesdeg.actuator.status import Backend, PathEffort, Resolution, Status
from bayesdeg.actuator.weak_form import Spaces, WeakForm
from bayesdeg.errors import BayesdegError, GeometryError

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

VOLUME = OUTPUTS.index("cavity_volume")
CUBIC_MILLIMETRE = 1e-3  # ml


class PathRecord:
    """Records readings along a path, and derivatives while the solver holds the factors.

    The readings are the outputs or, if ``held``, the force at the held tip. ``shapes`` are
    variations of the mesh, None where it cannot vary; ``enough`` is the relative correction of an
    adjoint at convergence; derivatives of quantiles may be smooth, as in
    `outputs.read_with_gradients`.
    """

    def __init__(
        self,
        mesh: ActuatorMesh,
        problem: Problem,
        *,
        shapes: Sequence[Variation | None],
        held: bool,
        enough: float,
        is_smooth: bool,
    ) -> None:
        self._mesh, self._problem = mesh, problem
        self._shapes, self._held, self._enough = shapes, held, enough
        self._tip = tip_edge(mesh) if held else np.empty(0, np.int64)
        self._is_smooth = is_smooth
        self._angle = 0.0
        self.loads, self.readings = list[float](), list[Floats]()
        self.gradients = list[Floats]()

    def visit(self, step: LoadStep, solver: Factorization) -> None:
        """Record a converged step, whose factors the solver holds."""
        if step.factors is None or step.rate is None:
            return
        if self._held:
            share, held = self._mesh.share, self._tip
            residual = self._problem.linearise(step.state, tangent=False).force
            values = share * residual[held, 2].sum(keepdims=True)
            gradients = share * reaction_derivatives(
                self._problem,
                solver,
                state=step.state,
                factors=step.factors,
                held=held,
                shapes=self._shapes,
                enough=self._enough,
            )
        else:
            values, by_position = read_with_gradients(
                self._mesh, step.state, previous_angle=self._angle, is_smooth=self._is_smooth
            )
            self._angle = float(values[0])
            gradients = derivatives(
                self._problem,
                solver,
                state=step.state,
                rate=step.rate,
                factors=step.factors,
                readings=values,
                gradients=by_position,
                shapes=self._shapes,
                enough=self._enough,
            )
        self.loads.append(step.state.load)
        self.readings.append(values)
        self.gradients.append(gradients)


@dataclass(frozen=True)
class Curve:
    """The inputs of one pressure curve in dimensionless groups.

    Parameters
    ----------
    loads : tuple of float
        p/C1, increasing, above 0 [–].
    material : MaterialGroups
        The other groups.
    layer : LayerGroups, optional
        Material of a constraint layer of elastomer.
    """

    loads: tuple[float, ...]
    material: MaterialGroups
    layer: LayerGroups | None = None


def with_layer(geometry: Moulded, curve: Curve) -> Curve:
    """Return a curve with the constraint layer of its actuator, if it is an elastomer.

    The paper's group is then the layer's C1 over that of the body; its other constants keep their
    ratios to its C1.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import Constraint, RibbedDimensions
    >>> layer = Constraint("elastomer", thickness=1.0, c1=60.0, c2=6.0)
    >>> curve = Curve((1.0,), MaterialGroups(0.0, 0.01, 8.0))
    >>> with_layer(geometry_of(RibbedDimensions(), layer), curve).layer
    LayerGroups(c1=8.0, c2=0.8, c3=0.0)
    """
    if not geometry.constraint.is_slab:
        return curve
    c1, c2, c3 = geometry.constraint.constants
    ratio = curve.material.paper_group
    return replace(curve, layer=LayerGroups(ratio, ratio * c2 / c1, ratio * c3 / c1))


@dataclass(frozen=True)
class CurveSolution:
    """Solution of a pressure curve at moulded size, as far as reached.

    Parameters
    ----------
    readings : array, shape (n_reached, n_outputs)
        All readings, in the order of ``outputs.OUTPUTS``.
    rates : array, shape (n_reached, n_outputs)
        Their derivatives with respect to the load, as accurate as the path's interpolation.
    rest : array, shape (n_outputs,)
        The readings at zero pressure, under dead loads alone.
    rest_rates : array, shape (n_outputs,)
        Their derivatives with respect to the load there.
    status : Status
        Status of the path.
    limit_load : float
        p/C1 of the limit point; inf if none was reached [–].
    iterations : int
        Number of factorizations.
    solver : str
        The direct solver used.
    """

    readings: Floats
    rates: Floats
    rest: Floats
    rest_rates: Floats
    status: Status
    limit_load: float
    iterations: int
    solver: str

    @property
    def bend_angle(self) -> Floats:
        """Rotation of the free end face at every load [rad]."""
        return self.readings[:, 0]

    @property
    def arc_length(self) -> Floats:
        """Deformed length of the bottom line at every load [mm]."""
        return self.readings[:, 1]

    @property
    def peak_stretch(self) -> Floats:
        """99 % quantile over the volume of the largest principal stretch [–]."""
        return self.readings[:, 3]


@dataclass(frozen=True)
class PathSamples:
    """The equilibria visited by a path, with readings and derivatives.

    Parameters
    ----------
    loads : array, shape (n,)
        p/C1, the first 0 [–].
    readings : array, shape (n, n_outputs)
        In the order of ``outputs.OUTPUTS``.
    gradients : array, shape (n, n_outputs, n_inputs)
        Their derivatives by ``sensitivity.INPUTS``.
    status, limit_load, iterations, solver
        As in ``CurveSolution``.
    """

    loads: Floats
    readings: Floats
    gradients: Floats
    status: Status
    limit_load: float
    iterations: int
    solver: str


Read = Callable[[ActuatorMesh, DiscreteEquations, Sequence[Point]], tuple[Floats, Floats]]
"""From equilibria to readings and their rates along the path, each (n, n_outputs)."""


class Actuator:
    """A meshed actuator that can be solved for any material.

    The direct solver's symbolic analysis is done at the first curve and reused; ``close`` releases
    its memory. Curves are solved one at a time, from any thread.

    Parameters
    ----------
    mesh : ActuatorMesh
        Mesh of the nominal geometry.
    solver : {"pypardiso", "splu"}, optional
        The direct solver; by default the best available.
    backend : {"kernels", "scikit-fem"}
        Assembly of the equations; only the kernels give derivatives.
    held : bool
        Whether the tip is held in the bending direction, as `tip_forces` needs.

    Raises
    ------
    ValueError
        If scikit-fem is to assemble elements other than Q2/P1disc.
    """

    def __init__(
        self,
        mesh: ActuatorMesh,
        *,
        solver: str | None = None,
        backend: Backend | str = Backend.KERNELS,
        held: bool = False,
    ) -> None:
        mesh = with_held_tip(mesh) if held else mesh
        self.mesh, self.system, self.held = mesh, System(mesh.body), held
        self.backend = Backend(backend)
        self._spaces = Spaces.on(mesh.body) if self.backend is Backend.SCIKIT_FEM else None
        self._solver, self._lock = solver, Lock()
        self._factorization: Factorization | None = None

    def close(self) -> None:
        """Release the memory of the direct solver; the next curve reopens it."""
        with self._lock:
            if self._factorization is not None:
                self._factorization.close()
            self._factorization = None

    def solve(self, curve: Curve, *, effort: PathEffort | None = None) -> CurveSolution:
        """Solve one pressure curve; failures are reported by the status, not raised."""
        return self._solved(curve, effort, _outputs_at)

    def tip_forces(self, curve: Curve, *, effort: PathEffort | None = None) -> CurveSolution:
        """Return the forces that hold the tip of the half model up against bending.

        Like `solve`, with one reading, the force over C1 [mm²]: the internal forces at the held
        nodes that no load balances.

        Raises
        ------
        ValueError
            If the tip is not held.
        """
        if not self.held:
            raise ValueError("the tip of this actuator is not held")
        return self._solved(curve, effort, _forces_at, outputs=1)

    def _solved(
        self, curve: Curve, effort: PathEffort | None, read: Read, outputs: int = len(OUTPUTS)
    ) -> CurveSolution:
        try:
            mesh, problem = self.equations(curve)
        except (GeometryError, ValueError):
            return _empty(Status.INVALID_INPUT, outputs)
        by_load = replace(effort or PathEffort(), beyond=0.0)
        with self._lock:
            solver = self._opened()
            path = follow(problem, solver, loads=curve.loads, effort=by_load)
        return _solution(path, solver.name, partial(read, mesh, problem), outputs)

    def solve_with_gradients(
        self, curve: Curve, *, effort: PathEffort | None = None
    ) -> tuple[CurveSolution, Floats]:
        """Solve one pressure curve with the derivatives of every reading by every input.

        Returns
        -------
        solution : CurveSolution
            As by ``solve``, with an equilibrium at every load.
        gradients : array, shape (n_reached, n_outputs, n_inputs)
            In the orders of ``outputs.OUTPUTS`` and ``sensitivity.INPUTS``, as exact as the path's
            tangent (``effort.rate_tolerance``).

        Raises
        ------
        BayesdegError
            If scikit-fem assembles the equations.
        """
        if self.backend is not Backend.KERNELS:
            raise BayesdegError(
                f"{self.backend} gives no derivatives by the inputs; use {Backend.KERNELS}"
            )
        exact = replace(
            effort or PathEffort(tolerance=1e-6, rate_tolerance=1e-7), exact=True, beyond=0.0
        )
        try:
            mesh, problem = self.problem(curve)
        except (GeometryError, ValueError):
            return _empty(Status.INVALID_INPUT), _stacked([])
        with self._lock:
            record = self._recorder(problem, mesh, enough=exact.rate_tolerance)
            solver, loads = self._opened(), frozenset(curve.loads)

            def visit(step: LoadStep, solver: Factorization) -> None:
                if step.state.load in loads:
                    record.visit(step, solver)

            path = follow(problem, solver, loads=curve.loads, effort=exact, visit=visit)
        solution = _solution(path, solver.name, partial(_outputs_at, mesh, problem))
        return solution, _stacked(record.gradients)

    def sample(self, curve: Curve, *, effort: PathEffort | None = None) -> PathSamples:
        """Follow a curve to its last load; return readings and derivatives at its equilibria.

        All derivatives less than double the cost of a curve. They serve for training, so those of
        quantiles are smoothed: exact ones jump from load to load. Of derivatives by the shape, the
        part due to the body's motion is smooth, that due to the moved mesh is not. For a held tip
        only the force is read, as by `tip_forces`. If scikit-fem assembles the equations, the path
        is its own; derivatives by the inputs are those of the kernels on it.
        """
        outputs = 1 if self.held else len(OUTPUTS)
        try:
            mesh, problem = self.problem(curve)
        except (GeometryError, ValueError):
            none, gradients = np.empty((0, outputs)), _stacked([], outputs)
            return PathSamples(np.empty(0), none, gradients, Status.INVALID_INPUT, 0.0, 0, "")
        with self._lock:
            record = self._recorder(problem, mesh, enough=1e-4, is_smooth=True)
            solver, equations = self._opened(), self._assembled(mesh, problem)

            def visit(step: LoadStep, solver: Factorization) -> None:
                # with the kernels' couplings, whatever assembles the equations
                if equations is not problem and step.factors is not None:
                    step = replace(step, factors=problem.linearise(step.state))
                record.visit(step, solver)

            path = follow(equations, solver, loads=curve.loads, effort=effort, visit=visit)
        return PathSamples(
            np.array(record.loads),
            np.array(record.readings).reshape(-1, outputs),
            _stacked(record.gradients, outputs),
            path.status,
            path.limit_load,
            path.iterations,
            solver.name,
        )

    def _recorder(
        self, problem: Problem, mesh: ActuatorMesh, *, enough: float, is_smooth: bool = False
    ) -> PathRecord:
        return PathRecord(
            mesh,
            problem,
            shapes=variations(self.mesh, self.system, problem.material, problem.layer),
            held=self.held,
            enough=enough,
            is_smooth=is_smooth,
        )

    def _opened(self) -> Factorization:
        if self._factorization is None:
            self._factorization = open_factorization(self.system.upper, self._solver)
        return self._factorization

    def equations(self, curve: Curve) -> tuple[ActuatorMesh, DiscreteEquations]:
        """Return the mesh and the backend's equations; those of ``problem`` with the kernels."""
        mesh, problem = self.problem(curve)
        return mesh, self._assembled(mesh, problem)

    def _assembled(self, mesh: ActuatorMesh, problem: Problem) -> DiscreteEquations:
        """Return the kernels' equations as the backend assembles them."""
        if self._spaces is None:
            return problem
        spaces = self._spaces if mesh is self.mesh else Spaces.on(mesh.body)
        return WeakForm(problem.system, problem.material, spaces, layer=problem.layer)

    def problem(self, curve: Curve) -> tuple[ActuatorMesh, Problem]:
        """Return the mesh and the kernels' equations for a curve, walls and faces moved.

        Raises
        ------
        GeometryError
            If the wall factor or the erosion leaves no actuator.
        ValueError
            If an input is not finite or has an impossible sign.
        """
        material, layer = curve.material, curve.layer
        check_inputs(curve)
        if layer is not None:  # the stiffer one must be nearly incompressible too
            bulk = material.bulk_ratio * max(1.0, layer.c1)
            material = replace(material, bulk_ratio=bulk)
        if material.wall_factor == 1.0 and material.erosion == 0.0:
            return self.mesh, Problem(self.system, material, layer=layer)
        mesh = reshaped(self.mesh, wall_factor=material.wall_factor, erosion=material.erosion)
        return mesh, Problem(self.system.with_body(mesh.body), material, layer=layer)


def check_inputs(curve: Curve) -> None:
    """Refuse inputs that give no valid equation.

    Raises
    ------
    ValueError
        If a load or a group is not finite, loads do not rise from above 0, or the paper's
        stiffness, thickness or slack is below 0.
    """
    values = vars(curve.material)
    wrong = [f"{name} is {value}" for name, value in values.items() if not np.isfinite(value)]
    for name in ("paper_group", "paper_thickness", "paper_slack", "erosion"):
        if values[name] < 0.0:
            wrong.append(f"{name} is {values[name]:g}, below 0")
    loads = np.asarray(curve.loads, dtype=np.float64)
    if not (np.all(np.isfinite(loads)) and np.all(np.diff(loads, prepend=0.0) > 0.0)):
        wrong.append("the loads do not rise from above 0")
    if wrong:
        raise ValueError("; ".join(wrong))


def _empty(status: Status, outputs: int = len(OUTPUTS)) -> CurveSolution:
    none, missing = np.empty((0, outputs)), np.full(outputs, np.nan)
    return CurveSolution(none, none, missing, missing, status, 0.0, 0, "")


def _stacked(gradients: Sequence[Floats], outputs: int = len(OUTPUTS)) -> Floats:
    return np.array(gradients).reshape(-1, outputs, len(INPUTS))


def _outputs_at(
    mesh: ActuatorMesh, _: DiscreteEquations, points: Sequence[Point]
) -> tuple[Floats, Floats]:
    """Return all outputs along a path, and their rates."""
    angle, found = 0.0, list[Reading]()
    for point in points:
        found.append(read_state(mesh, point.state, rate=point.rate, previous_angle=angle))
        angle = found[-1].bend_angle
    values = np.array([one.values for one in found]).reshape(-1, len(OUTPUTS))
    return values, np.array([one.rates for one in found]).reshape(-1, len(OUTPUTS))


def _forces_at(
    mesh: ActuatorMesh, problem: DiscreteEquations, points: Sequence[Point]
) -> tuple[Floats, Floats]:
    """Return the force at the held tip along a path, and its rate."""
    held, values, rates = tip_edge(mesh), list[float](), list[float]()
    for point in points:
        residual = problem.linearise(point.state, tangent=False).force
        ((change, _),) = problem.products(point.state, [point.rate])
        values.append(float(residual[held, 2].sum()))
        rates.append(float(change[held, 2].sum()))
    return mesh.share * np.array(values)[:, None], mesh.share * np.array(rates)[:, None]


def _solution(
    path: Path,
    solver: str,
    read: Callable[[Sequence[Point]], tuple[Floats, Floats]],
    outputs: int = len(OUTPUTS),
) -> CurveSolution:
    if path.rest is None:
        empty = _empty(path.status, outputs)
        return replace(empty, limit_load=path.limit_load, iterations=path.iterations)
    values, rates = read((path.rest, *path.points))
    end = (path.status, path.limit_load, path.iterations)
    return CurveSolution(values[1:], rates[1:], values[0], rates[0], *end, solver)


# of a campaign: by volume to just beyond a limit point; paths beyond this many factorizations are
# not suitable for training
SAMPLING = PathEffort(total=150, beyond=0.1, first_step=0.06)
LEARNED_STEPS = 3
"""Fewest equilibria of a training path: a stiff part would reach its last load in one step, which
does not show the course in between."""


class ExactMap:
    """The finite element model as a forward map: one load path for each specimen.

    If material, weight or shape vary between a specimen's readings, as in several mounts, one path
    for each of them.

    Parameters
    ----------
    geometry : Moulded
        The actuator as moulded.
    resolution : Resolution
        Resolution of the mesh.
    executor : Executor, optional
        Executor for the curves; by default serial, in this process.
    backend : {"kernels", "scikit-fem"}
        Assembly of the equations.
    on_start, on_curve : callable, optional
        Called with the number of curves at the start, and after each curve, for a progress bar.
    """

    def __init__(
        self,
        geometry: Moulded,
        resolution: Resolution,
        *,
        executor: Executor | None = None,
        backend: Backend | str = Backend.KERNELS,
        on_start: Callable[[int], None] | None = None,
        on_curve: Callable[[], None] | None = None,
    ) -> None:
        self.geometry, self.resolution = geometry, resolution
        self.backend = Backend(backend)
        self._executor = executor
        self._on_start = on_start or (lambda count: None)
        self._on_curve = on_curve or (lambda: None)

    def __call__(self, inputs: Inputs) -> Prediction:
        """Solve every curve; the last axis of the inputs is pressure."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        curvature, angle, stretch, slope, status, swept, swelling, *strains = self._answers(inputs)
        shape = curvature.shape
        further = None
        if inputs.asked == "cavity_volume":
            further = Further(swept, swelling, np.zeros(shape))
        elif inputs.asked == "tip_force":
            further = self.tip_force(inputs)
        if inputs.criterion != "principal_stretch":
            seen = np.stack([strains[k] for k in needed(inputs.criterion)])
            stretch = 1.0 + demanded_strain(inputs, seen)
        return Prediction(
            curvature=curvature,
            bend_angle=angle,
            peak_stretch=stretch,
            slope=slope,
            sd=np.zeros(shape),
            bend_angle_sd=np.zeros(shape),
            peak_stretch_sd=np.zeros(shape),
            status=status.astype(np.int64),
            further=further,
        )

    def tip_force(self, inputs: Inputs) -> Further:
        """Return the force that holds the tip of the whole actuator in the bending direction [N].

        The lower edge of its free end rests on a load cell; the force is relative to zero pressure,
        and nan where the curve was not reached.

        Raises
        ------
        ValueError
            If there is a reference pressure; call the map with ``asked="tip_force"`` for that.
        """
        if inputs.reference_pressure is not None:
            raise ValueError(
                "tip_force is over zero pressure; call the map for a reference pressure"
            )
        value, slope = self._answers(inputs, held=True)
        return Further(value, slope, np.zeros(value.shape))

    def _answers(self, inputs: Inputs, *, held: bool = False) -> Floats:
        """Solve every curve; return that of `_place`, (7 + n_measures, …), or `_place_force`."""
        load, groups, dimensions = load_of(inputs), material_groups(inputs), inputs.dimensions or {}
        given = (*groups.values(), *dimensions.values())
        shape = np.broadcast_shapes(load.shape, *map(np.shape, given))

        def flat(values: Floats) -> Floats:
            return np.broadcast_to(values, shape).reshape(-1, shape[-1])

        load, scale, c1 = flat(load), flat(inputs.linear_scale), flat(inputs.c1)
        rows = {name: flat(group) for name, group in groups.items()}
        sizes = {name: flat(size) for name, size in dimensions.items()}
        # a layer has its own constants, of which only ratios to C1 matter
        constraint = self.geometry.constraint
        apart = rows | sizes | ({"c1": c1} if constraint.is_slab else {})
        places, curves, shapes = list[tuple[int, Indices]](), list[Curve](), list[Moulded]()
        for i in range(len(load)):
            # readings of a specimen with the same material, weight and shape share a curve
            columns = np.stack([group[i] for group in apart.values()])
            which = np.unique(columns, axis=1, return_inverse=True)[1].ravel()
            for k in range(int(which.max(initial=-1)) + 1):
                at = np.flatnonzero(which == k)
                loads = np.unique(load[i, at][(load[i, at] > 0.0) | ~np.isfinite(load[i, at])])
                material = {name: float(group[i, at[0]]) for name, group in rows.items()}
                layer = None
                if constraint.is_slab:
                    layer = LayerGroups(
                        *(part / float(c1[i, at[0]]) for part in constraint.constants)
                    )
                moved = {name: float(size[i, at[0]]) for name, size in sizes.items()}
                places.append((i, at))
                curves.append(Curve(tuple(map(float, loads)), MaterialGroups(**material), layer))
                shapes.append(with_dimensions(self.geometry, moved))
        found = np.empty((2 if held else 7 + len(MEASURES), *load.shape))
        solved = self._solve(curves, shapes, held=held)
        for (i, at), curve, solution in zip(places, curves, solved, strict=True):
            if held:
                size = 2.0 * c1[i, at] * scale[i, at] ** 2  # N, of both halves
                found[:, i, at] = _place_force(solution, curve, load[i, at], size)
            else:
                found[:, i, at] = _place(solution, curve, load[i, at], scale[i, at])
        return found.reshape(-1, *shape)

    def _solve(
        self, curves: list[Curve], shapes: list[Moulded], *, held: bool = False
    ) -> list[CurveSolution]:
        tasks = [
            (shape, self.resolution, curve) for shape, curve in zip(shapes, curves, strict=True)
        ]
        apply = map if self._executor is None else self._executor.map
        # a curve without loads needs no work
        self._on_start(sum(len(curve.loads) > 0 for curve in curves))
        solutions = []
        solve = partial(solve_task, backend=self.backend, held=held, origin=self.geometry)
        for curve, solution in zip(curves, apply(solve, tasks), strict=True):
            if curve.loads:
                self._on_curve()
            solutions.append(solution)
        return solutions


MESHES = 3  # cached by a process; factors of a fine one take some hundred megabytes


_HELD: dict[tuple[object, ...], Actuator] = {}


def _actuator(
    geometry: Moulded, resolution: Resolution, backend: Backend, held: bool, origin: Moulded | None
) -> Actuator:
    """Return one of this process's last meshed actuators; older ones are closed."""
    meshed = geometry if origin is None else origin
    key = (geometry, resolution, backend, held, meshed)
    found = _HELD.pop(key, None)
    if found is None:
        mesh = build_mesh(meshed, resolution)
        mesh = mesh if meshed == geometry else moved_onto(mesh, geometry)
        found = Actuator(mesh, backend=backend, held=held)
    _HELD[key] = found
    while len(_HELD) > MESHES:
        _HELD.pop(next(iter(_HELD))).close()
    return found


def solve_task(
    task: tuple[Moulded, Resolution, Curve],
    *,
    effort: PathEffort | None = None,
    backend: Backend = Backend.KERNELS,
    held: bool = False,
    origin: Moulded | None = None,
) -> CurveSolution:
    """Solve one curve, with this process's copy of the mesh built once; its force for a held tip.

    The mesh is that of ``origin``, moved onto the actuator, if it is given.
    """
    geometry, resolution, curve = task
    actuator = _actuator(geometry, resolution, backend, held, origin)
    return (actuator.tip_forces if held else actuator.solve)(curve, effort=effort)


def sample_task(
    task: tuple[Moulded, Resolution, Curve],
    *,
    effort: PathEffort | None = None,
    backend: Backend = Backend.KERNELS,
    held: bool = False,
    origin: Moulded | None = None,
) -> PathSamples:
    """Sample one curve, with this process's copy of the mesh built once, its tip held or free."""
    geometry, resolution, curve = task
    actuator = _actuator(geometry, resolution, backend, held, origin)
    return actuator.sample(curve, effort=replace(effort or SAMPLING, steps=LEARNED_STEPS))


def _place_force(solution: CurveSolution, curve: Curve, load: Floats, size: Floats) -> list[Floats]:
    """Place forces minus that at rest, and p times their derivatives by p, at their loads."""
    values = np.concatenate([solution.rest, solution.readings[:, 0]])
    rates = np.concatenate([solution.rest_rates, solution.rates[:, 0]])
    known = np.concatenate([[0.0], curve.loads])
    at = np.searchsorted(known, load)
    ok = (at < len(values)) & (load >= 0.0)
    take = np.minimum(at, len(values) - 1)
    columns = (values - values[0], known[: len(values)] * rates)
    return [size * np.where(ok, column[take], np.nan) for column in columns]


def _place(solution: CurveSolution, curve: Curve, load: Floats, scale: Floats) -> list[Floats]:
    """Place results of solved loads, and of rest at zero load, among the observations.

    Curvature, bend angle, peak stretch, slope, status, cavity volume of both halves minus that at
    rest [ml], q times its derivative by q, and the strains of ``MEASURES``.
    """
    values = np.vstack([solution.rest, solution.readings])
    rates = np.vstack([solution.rest_rates, solution.rates])
    angle, length = values[:, 0], values[:, 1]
    kappa = angle / length * 1e3
    known = np.concatenate([[0.0], curve.loads])
    reached = known[: len(kappa)]
    slope = reached * (rates[:, 0] - angle / length * rates[:, 1]) / length * 1e3
    at = np.searchsorted(known, load)
    solved = np.isfinite(solution.rest[0])
    ok = (at < len(kappa)) & (load >= 0.0) & solved
    take = np.minimum(at, len(kappa) - 1)
    failed = np.where(load >= 0.0, int(solution.status), int(Status.INVALID_INPUT))
    status = np.where(ok, int(Status.CONVERGED), failed)
    strains = measured_strains(values).T
    halves = 2.0 * CUBIC_MILLIMETRE
    volume = halves * (values[:, VOLUME] - values[0, VOLUME])
    columns = (
        *(kappa - kappa[0], np.degrees(angle - angle[0]), values[:, PEAK], slope),
        *(volume, halves * reached * rates[:, VOLUME], *strains),
    )
    curvature, degrees, peak, change, swept, swelling, *measured = (
        np.where(ok, column[take], np.nan) for column in columns
    )
    whole = (swept * scale**3, swelling * scale**3)
    return [curvature / scale, degrees, peak, change / scale, status, *whole, *measured]
