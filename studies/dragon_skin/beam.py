"""The cantilever by finite elements: a box of bricks under its weight and a weight at its tip.

Lengths in mm, stresses in units of C1. The body is neo-Hookean (Yeoh's law with C2 = C3 = 0 unless
``hardening`` says otherwise) with K/C1 = 10⁴, of triquadratic bricks with discontinuous linear
pressure. The solution depends on the groups ρ g s/C1 and F/(C1 s²) alone.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.body import box
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.linear import Factorization, open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.problem import MechanicalState, Problem, System
from bayesdeg.actuator.status import PathEffort
from dragon_skin.balls import PATCHES, carried
from dragon_skin.grid import graded, mean_weights, weights_at
from dragon_skin.record import DENSITY, GRAVITY, HEIGHT, LENGTH, NOMINAL, TIP, TIP_LOADS, WIDTH

Floats = NDArray[np.float64]
Divisions = tuple[int, int, int]

#: Where the weight acts: the upper 4 mm of the end face, the edge itself, a strip of the top of
#: 4 mm around 4 mm from the tip, or the whole end face.
Grip = Literal["upper_face", "edge", "top", "face"]

STRIP = 4.0  # [mm]
GROWTH = 1.25  # of bricks from both ends to the middle
WEIGHT = DENSITY * GRAVITY * 1e-9  # ρ g [N/mm³]
KILOPASCAL = 1e-3  # [N/mm²]
EFFORT = PathEffort(tolerance=2e-5, iterations=20)


@dataclass(frozen=True)
class Load:
    """What bends the beam.

    Parameters
    ----------
    c1 : float
        [kPa].
    force : float
        Weight at the tip [N].
    pitch : float
        Angle of the beam below the horizontal [°].
    hardening : float
        C2/C1 [–].
    """

    c1: float
    force: float
    pitch: float = 0.0
    hardening: float = 0.0

    @property
    def down(self) -> Floats:
        """Unit vector of gravity in beam axes."""
        angle = np.deg2rad(self.pitch)
        return np.array([np.sin(angle), 0.0, -np.cos(angle)])


def loads_of(c1: float, pitch: float = 0.0) -> list[Load]:
    """Return the three load cases."""
    return [Load(c1, force, pitch) for force in TIP_LOADS]


class Beam:
    """A mesh of the cantilever, made ready to be solved many times.

    Parameters
    ----------
    divisions : tuple of int
        Bricks along, across and up.
    length : float
        Free length [mm].
    """

    def __init__(self, divisions: Divisions, length: float = LENGTH) -> None:
        self.divisions, self.length = divisions, length
        self._rows = [
            graded(size, n, GROWTH if axis == 0 else 1.0)
            for axis, (size, n) in enumerate(zip((length, WIDTH, HEIGHT), divisions, strict=True))
        ]
        even = box((length, WIDTH, HEIGHT), divisions=divisions)
        steps = np.array([length, WIDTH, HEIGHT]) / (2 * np.array(divisions))
        self._place = tuple(np.rint(even.nodes / steps).astype(np.int64).T)
        nodes = np.stack([row[i] for row, i in zip(self._rows, self._place, strict=True)], axis=1)
        self.system = System(even.placed_at(nodes))
        self.solver: Factorization = open_factorization(self.system.upper)

    @property
    def unknowns(self) -> int:
        """Number of displacements that are solved for."""
        return len(self.system.free)

    def close(self) -> None:
        """Free the factors."""
        self.solver.close()

    def problem(self, load: Load, grip: Grip = "upper_face", share: float = 1.0) -> Problem:
        """Return the equations, a share of the weight on a grip and the rest on the upper face."""
        stress = load.c1 * KILOPASCAL
        material = MaterialGroups(
            c2_ratio=load.hardening,
            c3_ratio=0.0,
            paper_group=0.0,
            gravity_along=WEIGHT / stress * load.down[0],
            gravity_up=WEIGHT / stress * load.down[2],
        )
        usual = self.unit_force(load, "upper_face")
        shares = usual + share * (self.unit_force(load, grip) - usual)
        force = load.force / stress * shares
        return Problem(self.system, material, nodal_force=force)

    def unit_force(self, load: Load, grip: Grip) -> Floats:
        """Return the nodal shares of a unit weight that acts evenly across the beam."""
        along, across, up = self._rows
        grid = np.zeros([len(row) for row in self._rows])
        level = mean_weights(across, 0.0, WIDTH)
        if grip == "upper_face":
            grid[-1] = level[:, None] * mean_weights(up, HEIGHT - STRIP, HEIGHT)
        elif grip == "face":
            grid[-1] = level[:, None] * mean_weights(up, 0.0, HEIGHT)
        elif grip == "edge":
            grid[-1, :, -1] = level
        else:
            middle = self.length - STRIP
            strip = mean_weights(along, middle - 0.5 * STRIP, middle + 0.5 * STRIP)
            grid[:, :, -1] = strip[:, None] * level
        share: Floats = grid[self._place]
        return share[:, None] * load.down

    def solve(self, load: Load, grip: Grip = "upper_face", share: float = 1.0) -> MechanicalState:
        """Return the equilibrium.

        Raises
        ------
        ArithmeticError
            If none is found.
        """
        path = follow(self.problem(load, grip, share), self.solver, loads=(), effort=EFFORT)
        if path.rest is None:
            raise ArithmeticError(f"no equilibrium at {load}: {path.status.advice}")
        return path.rest.state

    def responses(self, load: Load, state: MechanicalState, forces: list[Floats]) -> list[Floats]:
        """Return displacements (n_nodes, 3) per unit of further nodal forces, to first order.

        Parameters
        ----------
        load : Load
            What holds the state in equilibrium.
        state : MechanicalState
            Equilibrium.
        forces : list of array, shape (n_nodes, 3)
            [C1 mm²].
        """
        self.solver.factorize(self.problem(load).linearise(state).tangent)
        free = self.system.free
        return [self.system.expand(self.solver.solve(force.ravel()[free])) for force in forces]

    def hardening_force(self, load: Load, state: MechanicalState) -> Floats:
        """Return the nodal force that replaces C2/C1, per unit of it: −∂(internal force)/∂C2."""
        step = 1e-3
        soft = self.problem(load).linearise(state, tangent=False).force
        hard = Load(load.c1, load.force, load.pitch, load.hardening + step)
        return (soft - self.problem(hard).linearise(state, tangent=False).force) / step

    def field_at(self, field: Floats, points: Floats) -> Floats:
        """Return a nodal field (n_nodes, 3) at points (n, 3) of beam axes, x from the tip."""
        grid = np.zeros((*(len(row) for row in self._rows), 3))
        grid[self._place] = field
        places = points + np.array([self.length, 0.0, 0.0])
        weights = [
            np.array([weights_at(row, x) for x in places[:, axis]])
            for axis, row in enumerate(self._rows)
        ]
        value: Floats = np.einsum("pi,pj,pk,ijkc->pc", *weights, grid, optimize=True)
        return value

    def balls(self, displacement: Floats) -> tuple[Floats, Floats]:
        """Return centres [mm] and rotation vectors [rad] of the balls on the tip, each (3, 3)."""
        moved = PATCHES + self.field_at(displacement, PATCHES.reshape(-1, 3)).reshape(PATCHES.shape)
        pairs = [carried(*three) for three in zip(PATCHES, moved, NOMINAL[TIP], strict=True)]
        return np.array([ball for ball, _ in pairs]), np.array([turn for _, turn in pairs])

    def clamp_moment(self, load: Load, state: MechanicalState) -> float:
        """Return the bending moment about the middle of the clamped face [N mm]."""
        force = self.problem(load).dead_force * load.c1 * KILOPASCAL
        arm = self.system.body.nodes + state.displacement - [0.0, WIDTH / 2.0, HEIGHT / 2.0]
        return float(np.sum(arm[:, 2] * force[:, 0] - arm[:, 0] * force[:, 2]))
