"""Strain at every integration point of actuators on the fine mesh, at rising pressure.

    uv run python benchmarks/rupture_fields.py --worlds 8 --workers 2

A world is a material with its trends over the degradation rate, drawn as for the other virtual
studies; in each, actuators of six degradation rates are inflated by the finite element model on a
mesh finer than any that inference uses. The largest principal strain at each integration point, the
volume that it stands for, bend angle and arc length are kept in ``.cache/rupture``, a file a curve;
half a minute each. What is there is not solved again.

    uv run python benchmarks/rupture_fields.py --worlds 8 --skin

prints what a skin of 0.5 mm has of the Weibull strain of the whole, over all fields that are there,
their loads from a half of the largest on, and moduli of 8 to 30: if that is one number, ruptures
cannot tell flaws of the surface from those of the volume. ``--moduli`` prints by how much the
Weibull strain of a modulus between those that the emulator carries is off as it is interpolated.
"""

import argparse
import json
import os
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from hidden_studies import SOFTEST
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.demand import WEIBULL_MODULI, modulus_weights
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs, load_of, material_groups
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import FINE, build_mesh
from bayesdeg.actuator.outputs import StrainFields, read_state
from bayesdeg.actuator.status import MODEL_VERSION, Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.display import shown
from bayesdeg.files import written
from bayesdeg.laboratory.truth import Truth, drawn_truth
from bayesdeg.surrogate.workers import WorkerProcesses

Floats = NDArray[np.float64]

STORE = Path(".cache/rupture")
SEED = 77
LARGEST = {0.0: 200.0, 5.0: 240.0, 10.0: 300.0, 15.0: 360.0, 20.0: 430.0, 25.0: 500.0}
"""Degradation rates of the actuators [%], and the pressure up to which they are inflated [kPa]."""
SOFTER = 1.13  # of the softest specimen: three standard deviations of 4 %, in load
STEPS = 26  # loads at which the field is kept; between them its logarithm goes straight


@dataclass(frozen=True)
class Field:
    """What one material does under pressure, at moulded size.

    Parameters
    ----------
    load : array, shape (n_loads,)
        p/C1, rising from 0 [–].
    strain : array, shape (n_loads, n_points)
        Largest principal strain λ − 1 at the integration points of the half model [–].
    volume : array, shape (n_points,)
        That the points stand for [mm³].
    depth : array, shape (n_points,)
        Of the points under the nearest face that lies in the soil [mm].
    angle, length : array, shape (n_loads,)
        Bend angle [rad] and arc length of the bottom line [mm].
    """

    load: Floats
    strain: Floats
    volume: Floats
    depth: Floats
    angle: Floats
    length: Floats


def world_truth(world: int) -> Truth:
    """Draw the material of a world; those that would balloon are drawn anew."""
    if world < 0:
        return Truth()
    generator = np.random.default_rng((SEED, world))
    while True:
        truth = drawn_truth(generator)
        if truth.c1[0] >= SOFTEST:
            return truth


@cache
def _actuator() -> Actuator:
    return Actuator(build_mesh(Geometry(Dimensions()), FINE))


def solved(world: int, level: float) -> None:
    """Solve the field of a level of a world, unless it is there."""
    if path_of(world, level).exists():
        return
    loads, material = _asked(world_truth(world), level)
    above_rest = tuple(loads[1:].tolist())
    mesh, problem = _actuator().problem(Curve(above_rest, material))
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=above_rest)
    finally:
        factorization.close()
    if path.rest is None or path.status not in (Status.CONVERGED, Status.LIMIT_POINT):
        raise RuntimeError(f"world {world} at {level:g} %: {path.status.advice}")
    strains, readings, angle = [], [], 0.0
    for point in (path.rest, *path.points):
        angle, length = read_state(mesh, point.state, previous_angle=angle).values[:2]
        readings.append((angle, length))
        strains.append(StrainFields.of(mesh.body, point.state).largest.value.ravel() - 1.0)
    angles, lengths = np.array(readings).T
    with written(path_of(world, level)) as part, part.open("wb") as file:
        np.savez(
            file,
            load=loads[: len(strains)],
            strain=np.array(strains, dtype=np.float32),
            volume=mesh.body.weights.ravel(),
            depth=mesh.body.depth.ravel(),
            angle=angles,
            length=lengths,
        )


def path_of(world: int, level: float) -> Path:
    """Return where a field is kept."""
    return STORE / f"{MODEL_VERSION}-{STEPS}-{world:03d}-{level:04.1f}.npz"


def field_of(world: int, level: float) -> Field:
    """Return a field that was solved."""
    with np.load(path_of(world, level)) as kept:
        found = {name: kept[name].astype(np.float64) for name in kept.files}
    return Field(**found | {"strain": np.maximum(found["strain"], 0.0)})  # rounding, at rest


def _asked(truth: Truth, level: float) -> tuple[Floats, MaterialGroups]:
    c1, c2, c3 = truth.constants([level])[0]
    one = np.ones(1)
    inputs = Inputs(
        pressure=SOFTER * LARGEST[level] * one,
        c1=c1 * one,
        c2=c2 * one,
        c3=c3 * one,
        linear_scale=np.cbrt(truth.volume_ratio) * one,
        paper_stiffness=truth.paper_stiffness * one,
        paper_thickness=truth.paper_thickness * one,
    )
    groups = {name: float(np.ravel(group)[0]) for name, group in material_groups(inputs).items()}
    largest = float(load_of(inputs)[0])
    return np.linspace(0.0, largest, STEPS), MaterialGroups(**groups)


SKIN = 0.5  # mm under the faces in the soil
MODULI = (8.0, 12.0, 20.0, 30.0)
BETWEEN = (6.0, 7.0, 8.0, 12.0, 14.0, 17.0, 24.0, 28.0, 33.0)


def skin_ratios(worlds: list[int]) -> dict[str, tuple[float, float]]:
    """Return the range of the skin's over the whole's Weibull strain, by modulus."""
    fields = [field_of(w, level) for w in worlds for level in LARGEST if path_of(w, level).exists()]
    found = {}
    for modulus in MODULI:
        ratios = [
            _weibull(one, modulus, one.depth < SKIN) / _weibull(one, modulus, one.depth >= 0.0)
            for one in fields
        ]
        found[f"{modulus:g}"] = (float(np.min(ratios)), float(np.max(ratios)))
    return found


def interpolation_errors(worlds: list[int]) -> dict[str, float]:
    """Return the largest error of interpolated Weibull strains, by modulus [%]."""
    found = dict.fromkeys(BETWEEN, 0.0)
    for world, level in ((w, level) for w in worlds for level in LARGEST):
        field = field_of(world, level)
        whole = field.depth >= 0.0
        known = np.log([_weibull(field, m, whole) for m in WEIBULL_MODULI])
        for modulus in BETWEEN:
            between = np.exp(modulus_weights(np.array(modulus)) @ known)
            error = np.abs(between / _weibull(field, modulus, whole) - 1.0)
            found[modulus] = max(found[modulus], float(100.0 * np.max(error)))
    return {f"{modulus:g}": error for modulus, error in found.items()}


def _weibull(field: Field, modulus: float, part: NDArray[np.bool_]) -> Floats:
    strain = field.strain[len(field.load) // 2 :, part]
    mean: Floats = strain**modulus @ field.volume[part] / np.sum(field.volume[part])
    return mean ** (1.0 / modulus)


def solve_all(worlds: list[int], executor: Executor) -> None:
    """Solve what is missing, with a progress bar."""
    asked = [(world, level) for world in worlds for level in LARGEST]
    missing = [one for one in asked if not path_of(*one).exists()]
    STORE.mkdir(parents=True, exist_ok=True)
    with shown(quiet=False) as progress:
        progress.stage("finite element fields", len(missing))
        for done in as_completed([executor.submit(solved, *one) for one in missing]):
            done.result()
            progress.advance()


def main() -> None:
    """Solve the fields of some worlds."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--worlds", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--skin", action="store_true", help="compare the skin with the whole")
    parser.add_argument("--moduli", action="store_true", help="errors of interpolated moduli")
    given = parser.parse_args()
    looks = [skin_ratios] * given.skin + [interpolation_errors] * given.moduli
    if looks:
        worlds = list(range(-1, given.worlds))
        print(json.dumps([look(worlds) for look in looks], indent=1))
        return
    with WorkerProcesses(given.workers) as executor:
        solve_all(list(range(-1, given.worlds)), executor)


if __name__ == "__main__":
    main()
