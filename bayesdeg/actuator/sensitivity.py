"""Exact derivatives of every reading by material, loads and the shape of walls and faces.

With R(u, m) = 0 the discrete equilibrium and g an output, dg/dm = −λᵀ ∂R/∂m with K λ = ∂g/∂u:
one solution with existing factors for each output, for any number of inputs.

All nodes move linearly with the wall factor and the erosion, so the mesh is moved slightly along
that direction, and everything is evaluated at the same displacement.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator import kernels, paper
from bayesdeg.actuator.linear import Factorization
from bayesdeg.actuator.material import LayerGroups, MaterialGroups, skin_profile
from bayesdeg.actuator.mesh import ActuatorMesh, reshaped
from bayesdeg.actuator.outputs import OUTPUTS, read_state
from bayesdeg.actuator.problem import Linearisation, MechanicalState, Problem, System
from bayesdeg.errors import GeometryError

Floats = NDArray[np.float64]

SHAPE_INPUTS = ("wall_factor", "erosion")
STEP = 1e-7  # of the wall factor [–] and of the erosion [mm]
APART = 1e-5  # between the two meshes whose difference is the direction


@dataclass(frozen=True)
class Variation:
    """A mesh and its equations at one shape input plus ``STEP``."""

    mesh: ActuatorMesh
    problem: Problem

    def derivatives(self, here: "Evaluated", adjoints: Sequence[MechanicalState]) -> Floats:
        """Return derivatives of all readings by the shape input at an equilibrium, (n_outputs,).

        dg/dm = ∂g/∂m − λᵤᵀ ∂R/∂m − λₚᵀ ∂r/∂m, with R the residual of the forces, r that of the
        volume, and (λᵤ, λₚ) the adjoint of the reading g. The partial derivatives are
        differences over ``STEP``, accurate to about 1e-7.
        """
        angle = float(here.readings[0])
        there = evaluated(self.mesh, self.problem, here.state, previous_angle=angle)
        force, volume = there.force - here.force, there.volume - here.volume
        through = [np.sum(a.displacement * force) + np.sum(a.pressure * volume) for a in adjoints]
        return (there.readings - here.readings - np.array(through)) / STEP

    def push(self, state: MechanicalState, here: Linearisation, adjoint: MechanicalState) -> float:
        """Return the derivative by the shape input of an adjoint's work on the residuals."""
        there = self.problem.linearise(state, tangent=False)
        force = np.sum(adjoint.displacement * (there.force - here.force))
        volume = np.sum(adjoint.pressure * (there.volume_residual - here.volume_residual))
        return float(force + volume) / STEP


@dataclass(frozen=True)
class Evaluated:
    """Readings and residuals of a mesh at a state."""

    state: MechanicalState
    readings: Floats
    force: Floats
    volume: Floats


def evaluated(
    mesh: ActuatorMesh, problem: Problem, state: MechanicalState, *, previous_angle: float
) -> Evaluated:
    """Return readings and residuals of a mesh at a state."""
    residual = problem.linearise(state, tangent=False)
    readings = read_state(mesh, state, previous_angle=previous_angle).values
    return Evaluated(state, readings, residual.force, residual.volume_residual)


def variations(
    nominal: ActuatorMesh,
    system: System,
    material: MaterialGroups,
    layer: LayerGroups | None = None,
) -> tuple[Variation | None, ...]:
    """Return the variations of ``SHAPE_INPUTS`` about a material's walls and erosion.

    Mesh and system are those before walls and faces are moved. None if the geometry does not allow
    an input to vary.
    """
    at = {"wall_factor": material.wall_factor, "erosion": material.erosion}
    here = reshaped(nominal, **at)
    # towards the neutral value, where an actuator certainly exists
    towards = {
        "wall_factor": APART if material.wall_factor < 1.0 else -APART,
        "erosion": -APART if material.erosion > APART else APART,
    }
    found: list[Variation | None] = []
    for name in SHAPE_INPUTS:
        try:
            other = reshaped(nominal, **at | {name: at[name] + towards[name]})
        except GeometryError:
            found.append(None)
            continue
        # moved by a share of the way to the other mesh
        share, body = STEP / towards[name], here.body
        nodes = body.nodes + share * (other.body.nodes - body.nodes)
        depth = body.depth + share * (other.body.depth - body.depth)
        moved = replace(here, body=replace(body.placed_at(nodes), depth=depth))
        problem = Problem(system.with_body(moved.body), material, layer=layer)
        found.append(Variation(moved, problem))
    return tuple(found)


MATERIAL_INPUTS = (
    "load",
    "c2_ratio",
    "c3_ratio",
    "second_invariant_ratio",
    "skin",
    "paper_group",
    "paper_thickness",
    "paper_slack",
    "paper_mismatch",
    "gravity_along",
    "gravity_up",
)
INPUTS = (*MATERIAL_INPUTS, *SHAPE_INPUTS)

VOLUME = OUTPUTS.index("cavity_volume")
CORRECTIONS = 8
ALIKE = 1e-10  # of the largest: adjoint directions that differ less add only rounding errors
SMALLEST = np.finfo(float).tiny  # at rest some readings do not change, and their adjoints are zero


def derivatives(
    problem: Problem,
    solver: Factorization,
    *,
    state: MechanicalState,
    rate: MechanicalState,
    factors: Linearisation,
    readings: Floats,
    gradients: Floats,
    shapes: Sequence[Variation | None],
    enough: float,
) -> Floats:
    """Return derivatives of outputs by the inputs, shape (n_outputs, n_inputs).

    The solver holds the factors of a tangent at, or next to, the equilibrium; ``factors`` is that
    tangent's linearisation. ``rate`` is d(state)/d(load), the adjoint of the cavity volume: K λ =
    ∂V/∂u is the effect of the pressure. ``readings`` (n_outputs,) and ``gradients`` (n_outputs,
    n_nodes, 3) come from ``outputs.read_with_gradients``, ``shapes`` are the variations of
    ``SHAPE_INPUTS``, and ``enough`` is the relative correction of an adjoint at convergence.
    Columns are in the order of ``INPUTS``, nan where the geometry cannot vary; outputs depend
    directly on the shape only.
    """
    others = np.delete(gradients, VOLUME, axis=0)
    adjoints = adjoint_states(
        problem, solver, state=state, factors=factors, gradients=others, enough=enough
    )
    adjoints.insert(VOLUME, rate)
    fields = np.stack([adjoint.displacement for adjoint in adjoints])
    by_material = -np.einsum("oni,mni->om", fields, residual_rates(problem, state), optimize=True)
    residual = problem.linearise(state, tangent=False)
    here = Evaluated(state, readings, residual.force, residual.volume_residual)
    unknown = np.full(len(adjoints), np.nan)
    by_shape = [unknown if s is None else s.derivatives(here, adjoints) for s in shapes]
    return np.column_stack([by_material, *by_shape])


def reaction_derivatives(
    problem: Problem,
    solver: Factorization,
    *,
    state: MechanicalState,
    factors: Linearisation,
    held: NDArray[np.int64],
    shapes: Sequence[Variation | None],
    enough: float,
) -> Floats:
    """Return derivatives by the inputs of the upward force on held nodes, (1, n_inputs).

    F = vᵀR with v = 1 up at these nodes, so that dF/dm = μᵀ ∂R/∂m, with μ = v there and K μ = 0 at
    the unknowns: the response of the body to lifting them.

    ``held`` are the nodes held in z; the other arguments are those of `derivatives`.
    """
    lifted = np.zeros_like(problem.system.body.nodes)
    lifted[held, 2] = 1.0
    adjoint = MechanicalState(lifted, np.zeros_like(factors.volume_residual), 0.0)
    for _ in range(1 + CORRECTIONS):
        ((force, volume),) = problem.products(state, [adjoint])
        move = problem.system.expand(-solver.solve(problem.condensed(force, volume, factors)))
        change = problem.pressure_increment(factors, move, volume)
        adjoint = adjoint.moved(move, change)
        if _largest(move) <= enough:  # of a lift of 1
            break
    by_material = np.einsum("ni,mni->m", adjoint.displacement, residual_rates(problem, state))
    residual = problem.linearise(state, tangent=False)
    by_shape = [np.nan if s is None else s.push(state, residual, adjoint) for s in shapes]
    return np.concatenate([by_material, by_shape])[None]


def adjoint_states(
    problem: Problem,
    solver: Factorization,
    *,
    state: MechanicalState,
    factors: Linearisation,
    gradients: Floats,
    enough: float,
) -> list[MechanicalState]:
    """Return the adjoints of outputs: the mixed problem's tangent inverted, times (g, 0).

    Solutions with a nearby tangent's factors are corrected by the defect of the mixed problem's
    equations, after the best combination of all adjoints was found: they usually err in the same
    soft motions of the body. The corrections decrease by a constant ratio, so the next is predicted
    from the last two; iteration ends when that changes less than ``enough``.
    """
    right = np.column_stack([problem.system.on_free(g) for g in gradients])
    fields = [problem.system.expand(column) for column in solver.solve(right).T]
    adjoints = [MechanicalState(u, problem.pressure_increment(factors, u), 0.0) for u in fields]
    before, sizes = np.ones(len(fields)), np.array([_largest(field) for field in fields])
    for _ in range(CORRECTIONS):
        adjoints, products = combined(adjoints, problem.products(state, adjoints), gradients)
        defects = [(f - g, v) for (f, v), g in zip(products, gradients, strict=True)]
        right = np.column_stack([problem.condensed(f, v, factors) for f, v in defects])
        moves = [problem.system.expand(-column) for column in solver.solve(right).T]
        adjoints = [
            a.moved(u, problem.pressure_increment(factors, u, v))
            for a, u, (_, v) in zip(adjoints, moves, defects, strict=True)
        ]
        now = np.array([_largest(u) for u in moves]) / np.maximum(sizes, SMALLEST)
        if np.all(now * np.minimum(now / np.maximum(before, SMALLEST), 1.0) <= enough):
            break
        before = now
    return adjoints


def combined(
    adjoints: Sequence[MechanicalState],
    products: Sequence[tuple[Floats, Floats]],
    gradients: Floats,
) -> tuple[list[MechanicalState], list[tuple[Floats, Floats]]]:
    """Return Galerkin's solutions of K λ = (g, 0) in the span of approximate ones.

    With X the approximate adjoints as columns and G the right-hand sides, λ = X (1 + c), where
    (Xᵀ K X) c = Xᵀ (G − K X).

    Given are X, K X from ``Problem.products``, and G (n_adjoints, n_nodes, 3); returned λ and K λ.
    """
    parts = (
        np.stack([adjoint.displacement for adjoint in adjoints]),
        np.stack([adjoint.pressure for adjoint in adjoints]),
        np.stack([force for force, _ in products]),
        np.stack([volume for _, volume in products]),
    )
    along, pressures, forces, volumes = (part.reshape(len(adjoints), -1) for part in parts)
    work = along @ forces.T + pressures @ volumes.T
    wanted = along @ gradients.reshape(len(adjoints), -1).T
    # no energy: at rest some adjoints are zero; or negative, near a limit point
    energy = np.diag(work)
    scale = np.where(energy > 0.0, 1.0 / np.sqrt(np.where(energy > 0.0, energy, 1.0)), 0.0)
    missing = scale[:, None] * (wanted - work)
    scaled = work * np.outer(scale, scale)
    change = scale[:, None] * np.linalg.lstsq(scaled, missing, rcond=ALIKE)[0]
    fields, inner, pushed, swollen = (p + np.tensordot(change.T, p, axes=1) for p in parts)
    states = [MechanicalState(u, p, 0.0) for u, p in zip(fields, inner, strict=True)]
    return states, list(zip(pushed, swollen, strict=True))


def _largest(field: Floats) -> float:
    return float(np.max(np.abs(field)))


def residual_rates(problem: Problem, state: MechanicalState) -> Floats:
    """Return ∂R/∂m of the uncondensed residual for ``MATERIAL_INPUTS``, (n_inputs, n_nodes, 3).

    The volume equation depends on none of these inputs. With an elastomer layer, the paper's group
    is the layer's C1 over that of the body, to which all its constants are proportional; the growth
    of its bulk modulus is ignored: half a percent of this derivative of a bend angle.
    """
    system, body, material = problem.system, problem.system.body, problem.material
    placed = body.nodes + state.displacement
    bricks = np.ones(len(body.elements), dtype=bool)
    by_layer = np.zeros_like(body.nodes)
    if problem.layer is not None:
        bricks = ~body.layer
        relative = _rates_of(problem, state, body.layer, np.ones_like(body.weights))[3]
        by_layer = relative / problem.layer.c1
    solid = _rates_of(problem, state, bricks, skin_profile(body))
    membrane = np.zeros((3, len(body.nodes), 3))
    paper.membrane_rate(placed, body.nodes, body.paper, *problem.face, problem.paper_law, membrane)
    bend = (system.bending @ state.displacement.ravel()).reshape(-1, 3)
    plate = bend * material.paper_thickness / (12.0 * (1.0 - material.paper_poisson**2))
    gravity = -problem.share * system.volumes
    along, up = np.zeros_like(placed), np.zeros_like(placed)
    along[:, 0], up[:, 2] = gravity, gravity
    return np.stack(
        [
            -problem.cavity_gradient(state),
            *solid,
            membrane[0] + plate * material.paper_thickness + by_layer,
            2.0 * plate * material.paper_group,
            membrane[1],
            problem.share * membrane[2],
            along,
            up,
        ]
    )


def _rates_of(
    problem: Problem, state: MechanicalState, bricks: NDArray[np.bool_], profile: Floats
) -> Floats:
    """Return the rates by C2, C3, r and the logarithm of all constants times a profile."""
    body = problem.system.body
    found = np.zeros((len(body.nodes), 12))
    kernels.constant_rates(
        state.displacement,
        body.elements[bricks],
        body.gradients[bricks],
        body.weights[bricks],
        problem.constants[bricks],
        profile[bricks],
        found,
    )
    rates: Floats = np.moveaxis(found.reshape(-1, 4, 3), 1, 0)
    return rates
