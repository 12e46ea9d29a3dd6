"""Effects hidden in actuators for which there is no emulator yet: is the right cause named?

    uv run python benchmarks/other_actuators.py --studies 8 --json

Each study has an actuator of its own: length, section, walls, slots and number of chambers are
drawn, as are its material, its specimens and what is hidden in it by physics of a laboratory
(``physical_effects.py``), never by the rule of the entry that explains it; in every fifth there is
nothing. Pressures go to three quarters of those at which a fresh actuator balloons on a coarse
mesh, 240 kPa at most; in some studies that is beyond the end of what an emulator answers. Readings
come from finite elements on a mesh that is finer in each direction than that for which the study's
emulator stands. Then an emulator is trained where the study lies, and the study is judged from its
folder alone, as ``bayesdeg run`` does at quick effort. Studies that were made are kept in
``.cache/other_actuators`` and not made again.

Keys are those of ``hidden_effects.py``; visible sizes are those of the entries' rules. With
``--record FILE`` studies in the file are not judged again, and the file is written anew;
``other_actuators.jsonl`` beside this script holds the studies of the published figures.
"""

import argparse
import json
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from geometries import FINER
from hidden_effects import examined
from hidden_record import read_record, write_record
from hidden_studies import SOFTEST
from hidden_summary import summary
from physical_effects import CHEAP, DESIGN_OF, HAPPENS, SIZES, PhysicalStudy, written

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import COARSE
from bayesdeg.actuator.status import Status
from bayesdeg.assembly.reach import assemble_within_reach
from bayesdeg.causes.catalogue import find
from bayesdeg.console import errors
from bayesdeg.data.settings import Dimensions
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import Design
from bayesdeg.laboratory.truth import HiddenEffect, Truth, drawn_truth
from bayesdeg.surrogate.workers import workplace
from bayesdeg.training import TrainingOptions, emulator_for

Json = dict[str, Any]

STORE = Path(".cache/other_actuators")
SEED = 6
FIRST = 2000  # number of the first study: none of `hidden_effects.py` has it
WITHOUT = 5  # in every fifth nothing is hidden
HIDDEN = tuple(name for name in CHEAP if DESIGN_OF.get(name) != "mounts")
"""What may be hidden: effects for which no field is solved, in one mount."""
LEVELS = (5.0, 10.0, 15.0, 20.0)  # %, of which two are tested beside 0 and 25
STEPS, TOP, SHARE = 12, 240.0, 0.75  # pressures; the largest [kPa], of which share ballooning lies
SHORTEST = 3.0  # mm, of a chamber
OF_DIMENSIONS = 2**32 - 1  # beside the numbers of draws of the material


def drawn(number: int, *, seed: int) -> PhysicalStudy:
    """Draw what is hidden: each of `HIDDEN` in turn, in an order of the seed's own."""
    generator = np.random.default_rng((seed, number))
    place = number - FIRST
    if place % WITHOUT == WITHOUT - 1:
        return PhysicalStudy(number, "none", "angle", (), 0.0)
    order = np.random.default_rng(seed).permutation(HIDDEN)
    name = str(order[(place - place // WITHOUT) % len(order)])
    size = float(generator.choice(SIZES))
    happens = HAPPENS[name](size, generator)
    effect = HiddenEffect(find(name), happens.values)
    design = DESIGN_OF.get(name, "angle")
    return PhysicalStudy(number, "single", design, (effect,), size, physics=(happens,))


def drawn_dimensions(generator: np.random.Generator) -> Dimensions:
    """Draw an actuator that can be made, to a tenth of a millimetre; one in three has no slots."""
    between = {
        "length": (40.0, 75.0),
        "width": (8.0, 14.0),
        "height": (8.0, 14.0),
        "floor": (1.5, 2.5),
        "roof": (1.5, 2.5),
        "side_wall": (1.5, 2.5),
        "end_wall": (2.5, 4.0),
        "chamber_wall": (1.2, 2.0),
        "channel_width": (1.5, 2.5),
        "channel_height": (1.0, 2.0),
        "channel_roof": (0.8, 1.5),
    }
    while True:
        sizes = {name: round(generator.uniform(*ends), 1) for name, ends in between.items()}
        gap = round(generator.uniform(1.0, 2.5), 1) if generator.random() < 2.0 / 3.0 else 0.0
        found = Dimensions(**sizes, gap=gap, chambers=int(generator.integers(3, 7)))
        if not found.problems() and Geometry(found).chamber_length >= SHORTEST:
            return found


def tests_of(geometry: Geometry, truth: Truth, generator: np.random.Generator) -> Design:
    """Return tests of three actuators at each of four rates, as far as fresh ones bear it."""
    c1, c2, c3 = truth.constants([0.0])[0]
    pressures = np.linspace(20.0, TOP / SHARE, 16)
    scale, paper = np.asarray(truth.volume_ratio ** (1 / 3)), np.asarray(truth.paper_stiffness)
    fresh = ExactMap(geometry, geometry.mesh_like(COARSE))(
        Inputs(pressures[None], c1, c2, c3, scale, paper)
    )
    borne = pressures[fresh.status.ravel() == Status.CONVERGED]
    steps = np.round(SHARE * borne.max() * (np.arange(STEPS) + 1.0) / STEPS)
    design = Design()
    rates = [0.0, *generator.choice(LEVELS, 2, replace=False), 25.0]
    specimens = design.actuator.drop(columns="pressure_kPa").drop_duplicates()
    kept = specimens[specimens["degradation_pct"].isin(rates)]
    table = kept.merge(pd.DataFrame({"pressure_kPa": steps}), how="cross")
    return replace(design, actuator=table)


def made(study: PhysicalStudy, folder: Path, *, seed: int, workers: int) -> Truth:
    """Write the folder of a study; return what is true of it."""
    drawn_truths = (drawn_truth(np.random.default_rng((seed, study.number, k))) for k in count())
    material = next(truth for truth in drawn_truths if truth.c1[0] >= SOFTEST)
    generator = np.random.default_rng((seed, study.number, OF_DIMENSIONS))
    geometry = Geometry(drawn_dimensions(generator))
    mesh = geometry.mesh_like(FINER)
    with workplace(workers, None) as executor:
        return written(
            study,
            study.physics,
            folder,
            forward=ExactMap(geometry, mesh, executor=executor),
            seed=seed,
            command=f"benchmarks/other_actuators.py, study {study.number}",
            tests=tests_of(geometry, material, generator),
            dimensions=geometry.dimensions,
            mesh=mesh,
        )


def judged(number: int, *, seed: int, workers: int) -> Json:
    """Make a study, train its emulator, judge it."""
    study, folder = drawn(number, seed=seed), STORE / f"seed-{seed}" / str(number)
    kept = folder.with_suffix(".truth.json")
    if not kept.exists():
        truth = made(study, folder, seed=seed, workers=workers)
        kept.write_text(json.dumps(asdict(truth)), encoding="utf-8")
    errors.print(f"study {number} is made")
    values = json.loads(kept.read_text(encoding="utf-8"))
    known: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    truth = Truth(**known)
    read = read_study(folder)
    with workplace(workers, None) as executor:
        surrogate = emulator_for(read, None, options=TrainingOptions(yes=True), executor=executor)
    assembly = assemble_within_reach(read, surrogate)
    found = examined(study, folder, truth, {}, effort="quick", seed=seed, assembly=assembly)
    return found | {"dimensions": vars(read.settings.dimensions)}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--studies", type=int, default=8)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", type=Path, help="file of studies that were judged, to go on")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    record = read_record(given.record)
    found = []
    for number in range(FIRST, FIRST + given.studies):
        key = (given.seed, "quick", number, 0)
        if key not in record:
            record[key] = judged(number, seed=given.seed, workers=given.workers)
            if given.record is not None:
                write_record(given.record, record.values())
        found.append(record[key])
        said = (found[-1]["hidden"], "->", found[-1]["outcome"], found[-1]["causes"])
        errors.print(number, *said, soft_wrap=True)
    figures = summary(found, [])
    print(json.dumps(figures, indent=1) if given.json else figures)


if __name__ == "__main__":
    main()
