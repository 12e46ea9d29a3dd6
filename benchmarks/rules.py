"""How far the rules of causes are right: each fitted to the physics that it stands for.

    uv run python benchmarks/rules.py --json

An actuator of the default geometry is tested at degradation rates of 0, 12.5 and 25 % with
materials that have a field with a memory (`physics.fields`), and the rule of the cause
is fitted to all curves at once by least squares, against the elastic actuator of the same mesh.
For each physics the answer holds

* ``size``: the fitted parameters of the cause;
* ``effect_pct``: the effect, and ``left_pct``: what the rule leaves of the readings, both as root
  mean squares of the change of curvature over the curvature [%];
* ``worst_pct``: the largest of what is left over its reading [%];
* ``share_left``: what is left over the effect.

``delamination`` is fitted once for each place from which paper comes off, by the share that is off
at 25 %; ``paper_softening`` fitted to the first of them says what tells the two causes apart.

``clamp`` says by how much the readings of an actuator change whose clamped end stands on springs,
by their stiffness, at two degradation rates and in three mounts, in percent: ``faces_pct`` the
curvature of the contract, whose bend angle is that between the end faces, and ``space_pct`` that
of the free end face in space, both less what they are at zero pressure; ``turned_deg`` is by how
much weight alone has turned the clamped face. ``force_pct`` is by how much the blocked tip force
falls, for small loads and without weight.

``drying`` says what water does in the fresh actuator within ``minutes``: the share of it that has
left, and the change of curvature [%] at the pressures of its path, without and with shrinkage.

``creep_in_an_arm`` holds the rule of `creep` against measured displacements of a silicone arm, of
which pressure, growth after the first second and length of the hold are known
(``studies/data/srl_arm_creep.csv``): what a rule cannot explain there is scatter too.
"""

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from physics.fields import (
    Diffusion,
    Drying,
    Elastic,
    Field,
    FieldActuator,
    FieldEquations,
    Memory,
    Schedule,
    Softened,
    Viscous,
    Water,
    reacted,
)
from physics.mounting import Bond, Clamp, cuts_of, detached
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import PAPER_THICKNESS, Inputs, gravity_direction
from bayesdeg.actuator.material import MaterialGroups, local_constants
from bayesdeg.actuator.mesh import COARSE, ActuatorMesh, build_mesh
from bayesdeg.actuator.problem import Problem
from bayesdeg.causes.catalogue import find
from bayesdeg.causes.cause import REFERENCE_DEGRADATION, Conditions
from bayesdeg.data.settings import Dimensions
from bayesdeg.laboratory.truth import Truth

ROOT = Path(__file__).resolve().parents[1]
ARM = ROOT / "studies" / "data" / "srl_arm_creep.csv"
LEVELS = (0.0, 12.5, 25.0)
UP = np.arange(20.0, 201.0, 20.0)
PATH = np.concatenate([UP, UP[-2::-1]])  # kPa
HELD = (8.0, 45.0)  # s at each pressure, while stress relaxes
DRIED = (30.0, 150.0)  # while water leaves
DENSE = np.arange(0.0, 261.0, 10.0)  # kPa, for the elastic curve
SHARE, RELAXATION = 0.11, 30.0  # of the stress that relaxes in the end, and its time [s]
SOFTENING, ENERGY, BETA = 8.0, 0.02, 0.1  # r, m [C1], beta of Ogden and Roxburgh
DIFFUSIVITY, TRANSFER = 1e-5, 2e-4  # mm²/s, mm/s
DRIER, STIFFER = 1.0, 0.15
DRYING, LONG = np.array([20.0, 80.0, 140.0, 200.0]), 405.0  # kPa, each held so long [s]
SHRINKAGE = 0.05  # of the volume, where dry
REACTION = 1.0  # mm that what degrades comes into the walls
SKINS = (0.0, 0.4, 0.8, 1.2)
AT_ONCE = 0.2  # s between onsets of markers in one recording, which move together
END = "disp_end_of_hold_mm"
SKIN, PAPER = "degraded_skin", "delamination"
OFF = {  # of the paper, at 25 %
    "from_end": Bond(off_end=0.6),
    "from_both_ends": Bond(off_end=0.3, off_clamp=0.3),
    "half_from_end": Bond(off_end=0.5),
    "from_edges": Bond(off_edges=0.6),
}
PAPERS = np.log(np.geomspace(3e-4, 1.0, 9))  # ln stiffness of the paper over that of the actuator
SPRINGS = (1.0, 0.1, 0.03, 0.01)  # of the clamp [MPa/mm]; a third of it along the face
WEIGHT = 12.0  # kN/m³
GIVING = np.array([0.0, 20.0, 120.0, 200.0])  # kPa
MOUNTS = ("horizontal", "hanging", "bending_down")
FLOOR = 0.1  # 1/m, below which a curvature is no measure of an error


class Part(NamedTuple):
    """The actuator at one degradation rate."""

    level: float
    actuator: FieldActuator
    c1: float
    scale: float
    elastic: CubicSpline
    steepness: float  # d ln C1/dD [1/%]

    def curvature(self, readings: np.ndarray) -> np.ndarray:
        """Return 1/m from what the model reads."""
        return np.asarray(readings[:, 0] / readings[:, 1] * 1e3 / self.scale, dtype=np.float64)

    def load(self, pressure: np.ndarray) -> np.ndarray:
        """Return p/C1."""
        return pressure * 1e-3 / self.c1

    def tested(self, memory: Memory, held: float = 0.0) -> np.ndarray:
        """Return the curvature along the path [1/m]."""
        schedule = Schedule(self.load(PATH), np.full(len(PATH), held))
        return self.curvature(self.actuator.tested(memory, schedule))


def part(level: float, truth: Truth) -> Part:
    """Return the actuator at a degradation rate, with its elastic curve."""
    c1, c2, c3 = truth.constants([level])[0]
    scale = float(np.cbrt(truth.volume_ratio))
    material = MaterialGroups(
        c2_ratio=c2 / c1,
        c3_ratio=c3 / c1,
        paper_group=truth.paper_stiffness * 1e-3 / (c1 * scale),
        paper_thickness=PAPER_THICKNESS / scale,
    )
    actuator = FieldActuator(build_mesh(Geometry(Dimensions()), COARSE), material)
    bare = Part(level, actuator, c1, scale, CubicSpline([0, 1], [0, 1]), 0.0)
    schedule = Schedule(bare.load(DENSE[1:]), np.zeros(len(DENSE) - 1))
    read = bare.curvature(actuator.tested(Elastic(Field(actuator.body.constants)), schedule))
    known = np.isfinite(read)
    if not known[DENSE[1:] <= UP[-1]].all():
        raise RuntimeError(f"no elastic curve at {level:g} %")
    curve = CubicSpline(DENSE[: known.sum() + 1], np.append(0.0, read[known]), extrapolate=True)
    ends = np.log(truth.constants([level - 1.0, level + 1.0])[:, 0])
    return bare._replace(elastic=curve, steepness=float(ends[1] - ends[0]) / 2.0)


Curves = list[tuple[Part, float, np.ndarray]]
"""Each with the time that a pressure was held, and the curvature that the physics gives."""


def of_creep(parts: list[Part]) -> Curves:
    """Return curves of a body whose stress relaxes, on paper that does not."""
    return [
        (one, held, one.tested(Viscous(one.actuator.body.constants, (SHARE,), (RELAXATION,)), held))
        for one in parts
        for held in HELD
    ]


def of_mullins(parts: list[Part]) -> Curves:
    """Return curves of a body that each point's own largest energy has softened."""
    return [
        (one, 0.0, one.tested(Softened(one.actuator.body.constants, SOFTENING, ENERGY, BETA)))
        for one in parts
    ]


def of_drying(parts: list[Part]) -> Curves:
    """Return curves of a body from which water diffuses, without shrinkage."""
    water = Water(DIFFUSIVITY, TRANSFER, DRIER, STIFFER)
    found = []
    for one in parts:
        diffusion = Diffusion.on(one.actuator.mesh.body)
        for held in DRIED:
            memory = Drying(diffusion, one.actuator.body.constants, water, step=75.0)
            found.append((one, held, one.tested(memory, held)))
    return found


def dried(one: Part) -> dict[str, Any]:
    """Return what drying does to an actuator, without shrinkage and with some."""
    diffusion = Diffusion.on(one.actuator.mesh.body)
    load, held = one.load(DRYING), np.full(len(DRYING), LONG)
    constants = one.actuator.body.constants
    changes = {}
    for shrinkage in (0.0, SHRINKAGE):
        water = Water(DIFFUSIVITY, TRANSFER, DRIER, STIFFER, shrinkage)
        memory = Drying(diffusion, constants, water, step=60.0)
        read = one.curvature(one.actuator.tested(memory, Schedule(load, held)))
        change = 100.0 * (read / one.elastic(DRYING) - 1.0)
        changes[f"shrinkage {shrinkage:g}"] = change.round(1).tolist()
    span, count = 60.0, round(LONG * len(DRYING) / 60.0)
    content = np.zeros(diffusion.count)
    for _ in range(count):
        content = diffusion.later(content, Water(DIFFUSIVITY, TRANSFER, DRIER), span)
    left = -diffusion.at_points(content) * one.actuator.mesh.body.weights
    return {
        "minutes": count,
        "left_pct": round(100.0 * float(left.sum()) / one.actuator.mesh.body.volume, 1),
        "pressure_kPa": DRYING.tolist(),
        "curvature_pct": changes,
    }


def of_skin(parts: list[Part]) -> Curves:
    """Return curves of a body that is degraded from its surfaces inwards."""
    found = []
    for one in parts[1:]:
        diffusion = Diffusion.on(one.actuator.mesh.body)
        rate = reacted(diffusion, REACTION, one.level)
        factor = np.exp(one.steepness * (rate - one.level))
        field = Field(one.actuator.body.constants * factor[..., None])
        found.append((one, 0.0, one.tested(Elastic(field))))
    return found


def of_delamination(parts: list[Part], off: Bond) -> Curves:
    """Return curves of actuators whose paper is bonded in part, further off where degraded more.

    Against the same mesh bonded all over, since its planes follow the paper.
    """
    found = []
    for one in parts:
        bond = off.grown(one.level, REFERENCE_DEGRADATION)
        geometry = Geometry(Dimensions())
        mesh = build_mesh(geometry, COARSE, cuts=cuts_of(geometry, bond))
        whole, loose = (_elastic(one, mesh_now) for mesh_now in (mesh, detached(mesh, bond)))
        found.append((one, 0.0, one.elastic(PATH) * loose / whole))
    return found


def _elastic(one: Part, mesh: ActuatorMesh) -> np.ndarray:
    """Return the curvature along the path of an elastic actuator; down as up."""
    actuator = FieldActuator(mesh, one.actuator.material)
    schedule = Schedule(one.load(UP), np.zeros(len(UP)))
    up = one.curvature(actuator.tested(Elastic(Field(actuator.body.constants)), schedule))
    return np.concatenate([up, up[-2::-1]])


def by_paper(name: str, parts: list[Part]) -> Callable[[np.ndarray, Part, float], np.ndarray]:
    """Return the curvature that the rule gives of a cause that changes the paper's stiffness."""
    cause, known = find(name), {}
    for one in parts:
        papers = np.exp(PAPERS) * one.actuator.material.paper_group
        materials = [replace(one.actuator.material, paper_group=float(g)) for g in papers]
        actuators = [FieldActuator(one.actuator.mesh, material) for material in materials]
        curves = [_elastic(one._replace(actuator=a), one.actuator.mesh) for a in actuators]
        known[one.level] = CubicSpline(PAPERS, np.array(curves))

    def ruled(sizes: np.ndarray, one: Part, held: float) -> np.ndarray:
        conditions = Conditions(PATH[None], np.array([[one.level]]))
        values = zip(cause.parameters, sizes, strict=True)
        effect = cause.effect({cause.qualified(p.name): np.array([v]) for p, v in values})
        unit = np.ones((1, 1, 1))
        paper = 1e3 * one.actuator.material.paper_group * one.c1 * one.scale * unit
        inputs = Inputs(
            PATH[None, None], one.c1 * unit, 0 * unit, 0 * unit, one.scale * unit, paper
        )
        assert cause.on_inputs is not None
        met = cause.on_inputs(inputs, conditions, effect).paper_stiffness
        return known[one.level](float(np.log(met / paper)[0, 0, 0]))

    return ruled


def detachments(parts: list[Part]) -> dict[str, Any]:
    """Return how far the rule of paper that comes off is right, and how like soft paper it is."""
    degraded = parts[1:]  # nothing has come off fresh ones
    curves = {where: of_delamination(degraded, off) for where, off in OFF.items()}
    rule = by_paper(PAPER, degraded)
    found = {where: compared(one, rule, {"looseness": 0.5}) for where, one in curves.items()}
    softened = by_paper("paper_softening", degraded)
    first = next(iter(OFF))
    alike = compared(curves[first], softened, {"softening": 1.0, "growth": 2.0})
    return {**found, f"paper_softening to {first}": alike}


def clamped(one: Part) -> dict[str, Any]:
    """Return what a clamp that gives does to the readings of an actuator."""
    weight = 1e-6 * WEIGHT * one.scale / one.c1
    clamps = {
        f"{k:g} MPa/mm": Clamp(k * one.scale / one.c1, k * one.scale / one.c1 / 3.0)
        for k in SPRINGS
    }
    firm = _blocked(one, None)
    found: dict[str, Any] = {
        "force_pct": {
            name: round(100.0 * (_blocked(one, clamp) / firm - 1.0), 1)
            for name, clamp in clamps.items()
        }
    }
    for mount in MOUNTS:
        along, up = (weight * share for share in gravity_direction(mount))
        heavy = replace(one.actuator.material, gravity_along=along, gravity_up=up)
        held, *_ = _readings(one, heavy, None)
        by_clamp: dict[str, Any] = {}
        for name, clamp in clamps.items():
            faces, space, turned = _readings(one, heavy, clamp)
            by_clamp[name] = {
                "faces_pct": (100.0 * (faces / held - 1.0)).round(2).tolist(),
                "space_pct": (100.0 * (space / held - 1.0)).round(2).tolist(),
                "turned_deg": round(turned, 2),
            }
        found[mount] = by_clamp
    return found


def _blocked(one: Part, clamp: Clamp | None) -> float:
    """Return the force that holds the tip for a unit of pressure, linear about rest [mm²].

    What the pressure moves the middle of the end face by, over what a unit of force does.
    """
    actuator = FieldActuator(one.actuator.mesh, one.actuator.material, clamp=clamp)
    body = actuator.body
    equations = FieldEquations(Problem(body.system, one.actuator.material), support=body.support)
    state, tip = body.system.rest(), np.zeros_like(body.body.nodes)
    nodes = np.unique(actuator.mesh.free_end)
    tip[nodes, 2] = 1.0 / len(nodes)
    body.solver.factorize(equations.linearise(state).tangent)
    loads = [body.system.on_free(load) for load in (equations.cavity_gradient(state), tip)]
    moved = body.solver.solve(np.column_stack(loads)).T @ loads[1]
    return float(moved[0] / moved[1])


def _readings(
    one: Part, material: MaterialGroups, clamp: Clamp | None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return curvatures between faces and in space less those at rest, and the clamp's turn."""
    actuator = FieldActuator(one.actuator.mesh, material, clamp=clamp)
    memory = Elastic(Field(actuator.body.constants))
    schedule = Schedule(one.load(GIVING), np.zeros(len(GIVING)))
    read = [actuator.tested(memory, schedule, to_horizontal=space) for space in (False, True)]
    faces, space = (one.curvature(now) - one.curvature(now)[0] for now in read)
    turned = np.degrees(read[1][0, 0] - read[0][0, 0])
    return faces[1:], space[1:], float(turned)


def by_pressure(name: str) -> Callable[[np.ndarray, Part, float], np.ndarray]:
    """Return the curvature that a rule gives which changes the pressure."""
    cause = find(name)

    def ruled(sizes: np.ndarray, one: Part, held: float) -> np.ndarray:
        time = held * np.arange(1, len(PATH) + 1)
        back = np.arange(len(PATH)) >= len(UP)
        degradation = np.array([[one.level]])
        conditions = Conditions(
            PATH[None], degradation, time=np.asarray(time[None], np.float64), unloading=back[None]
        )
        values = zip(cause.parameters, sizes, strict=True)
        effect = cause.effect({cause.qualified(p.name): np.array([v]) for p, v in values})
        unit = np.ones((1, 1, 1))
        inputs = Inputs(PATH[None, None], one.c1 * unit, unit, unit, unit, unit)
        assert cause.on_inputs is not None
        return one.elastic(cause.on_inputs(inputs, conditions, effect).pressure[0, 0])

    return ruled


def by_skin(parts: list[Part]) -> Callable[[np.ndarray, Part, float], np.ndarray]:
    """Return the curvature that the rule of `degraded_skin` gives: one size for every rate."""
    known = {}
    for one in parts[1:]:
        curves = []
        for skin in SKINS:
            material = replace(one.actuator.material, skin=skin)
            local = local_constants(material, one.actuator.mesh.body)
            curves.append(one.tested(Elastic(Field(local))))
        known[one.level] = CubicSpline(SKINS, np.array(curves))

    def ruled(sizes: np.ndarray, one: Part, held: float) -> np.ndarray:
        return known[one.level](sizes[0] * one.level / 25.0)

    return ruled


def compared(
    curves: Curves,
    rule: Callable[[np.ndarray, Part, float], np.ndarray],
    start: Mapping[str, float],
) -> dict[str, Any]:
    """Fit a rule to the curves of a physics; return its size and what it leaves."""

    def left(logs: np.ndarray) -> np.ndarray:
        sizes = np.exp(logs)
        return np.concatenate(
            [_over(rule(sizes, o, held) - read, read) for o, held, read in curves]
        )

    effect = np.concatenate([_over(read - one.elastic(PATH), read) for one, _, read in curves])
    fit = least_squares(left, np.log(list(start.values())))
    rest = left(fit.x)
    rms = [float(np.sqrt(np.mean(values**2))) for values in (effect, rest)]
    return {
        "size": dict(zip(start, np.exp(fit.x).round(4).tolist(), strict=True)),
        "effect_pct": round(100.0 * rms[0], 2),
        "left_pct": round(100.0 * rms[1], 2),
        "worst_pct": round(100.0 * float(np.max(np.abs(rest))), 2),
        "share_left": round(rms[1] / rms[0], 3),
    }


def _over(change: np.ndarray, reading: np.ndarray) -> np.ndarray:
    return change / np.maximum(np.abs(reading), FLOOR)


def in_an_arm(path: Path = ARM) -> dict[str, Any]:
    r"""Fit the rule of creep to the growth of displacements under held pressure.

    At a pressure that is set at once and held, :math:`u(t) = U(p (1 + a (1 - e^{-t/\tau})))`, with
    U the curve of the displacements after one second, whose slope in logarithms is that of the
    table itself. The arm and its single segment are two specimens. Markers whose onset was found
    elsewhere than that of the others in their recording are left out.
    """
    table = pd.read_csv(path, comment="#")
    onset = table.groupby("file")["onset_s"].transform("median")
    table = table[(table["onset_s"] - onset).abs() < AT_ONCE].reset_index(drop=True)
    part = np.where(table["file"].str.startswith("segment"), "segment", "arm")
    return {str(name): _crept(rows) for name, rows in table.groupby(part)}


def _crept(table: pd.DataFrame) -> dict[str, Any]:
    first = table["disp_1s_after_onset_mm"]
    logs = table.assign(x=np.log(table["p_mbar"]), y=np.log(first))
    slopes = {m: np.polyfit(g["x"], g["y"], 1)[0] for m, g in logs.groupby("marker")}
    slope = table["marker"].map(slopes).to_numpy()
    seen = [np.log((table[name] / first).to_numpy()) for name in ("disp_2s_mm", END)]
    held = (2.0, table["hold_s"].to_numpy())

    def left(sizes: np.ndarray) -> np.ndarray:
        amount, constant = np.exp(sizes)
        late = [np.log1p(-amount * np.expm1(-np.asarray(t) / constant)) for t in (1.0, *held)]
        return np.concatenate(
            [slope * (end - late[0]) - growth for end, growth in zip(late[1:], seen, strict=True)]
        )

    bounds = np.log([1e-4, 0.1]), np.log([2.0, 60.0])
    fit = least_squares(left, np.log([0.1, 3.0]), bounds=bounds)
    growth, rest = np.concatenate(seen), left(fit.x)
    rms = [float(np.sqrt(np.mean(values**2))) for values in (growth, rest)]
    return {
        "recordings": int(table["file"].nunique()),
        "displacements": len(growth),
        "size": dict(
            zip(("amount", "time_constant"), np.exp(fit.x).round(3).tolist(), strict=True)
        ),
        "effect_pct": round(100.0 * rms[0], 2),
        "left_pct": round(100.0 * rms[1], 2),
        "worst_pct": round(100.0 * float(np.max(np.abs(rest))), 2),
        "share_left": round(rms[1] / rms[0], 3),
    }


def main() -> None:
    """Compare every rule with its physics."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print nothing but the result")
    parser.add_argument("--only", nargs="*", help="causes; by default all, and the arm")
    options = parser.parse_args()
    parts = [part(level, Truth()) for level in LEVELS]
    sizes = {
        "creep": {"amount": 0.1, "time_constant": 30.0},
        "mullins": {"softening": 0.1, "onset": 0.1},
        "humidity_drift": {"stiffening": 0.05, "time_constant": 900.0},
    }
    physics = {"creep": of_creep, "mullins": of_mullins, "humidity_drift": of_drying}
    found: dict[str, Any] = {}
    wanted = options.only or [*sizes, SKIN, PAPER, "clamp", "drying", "creep_in_an_arm"]
    for name, start in sizes.items():
        if name not in wanted:
            continue
        found[name] = compared(physics[name](parts), by_pressure(name), start)
        if not options.json:
            print(name, found[name], flush=True)
    if SKIN in wanted:
        found[SKIN] = compared(of_skin(parts), by_skin(parts), {"skin_stiffening": 0.5})
    if PAPER in wanted:
        found[PAPER] = detachments(parts)
    if "clamp" in wanted:
        found["clamp"] = {f"{one.level:g} %": clamped(one) for one in parts[::2]}
    if "drying" in wanted:
        found["drying"] = dried(parts[0])
    if "creep_in_an_arm" in wanted:
        found["creep_in_an_arm"] = in_an_arm()
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
