"""A public data set of studies with hidden effects and separate truths, for testing any method.

    uv run python benchmarks/hidden_dataset.py --studies 100 --seed 97 --physics 6 \
        --out hidden/studies --truths hidden/truths.jsonl

writes folders ``0001``, ``0002``, … in the form of the contract, a ``README.md`` with the task, and
``manifest.json`` with the hashes of all files and of the truths, which go to one file of their own.
With the same numbers every byte is the same. Curvatures come from the second surrogate of the fine
finite element model (``fine_library.py``), and ``--physics`` studies from fields of material that
are solved (`physics.fields`), a minute or more each.

Who knows the seed can make the truths; one who wants them kept takes a seed of many digits and
publishes the folder, in which it is not. What is hidden follows from no name, order or number of a
study. Its design tells something: creep shows only where time passes.
"""

import argparse
import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from hidden_effects import library, visible
from hidden_studies import (
    HIDDEN,
    ONLY_IN,
    OUTSIDE,
    REFUSED,
    SIZES,
    HiddenStudy,
    MadeStudy,
    _sized,
    designs,
    experimented,
)
from physical_effects import from_surfaces, softened, viscous
from physics.fields import (
    FieldActuator,
    FieldMap,
    Memory,
)
from planted_studies import LEVELS, REACH, RELAXATION, SHARE, SOFTENED
from threadpoolctl import threadpool_limits
from unknown_effects import FORMS, _cause

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.mesh import COARSE
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.settings import Dimensions, Settings
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import Design
from bayesdeg.laboratory.hidden import HiddenTruth, Origin, lines_of
from bayesdeg.laboratory.truth import HiddenEffect
from bayesdeg.laboratory.writing import TRUTH_FILE, Provenance, study_files

KINDS = {"single": 0.55, "pair": 0.15, "none": 0.15, "outside": 0.15}
#: Of effects that show in many designs; those with little scatter show what others do not.
ANY_DESIGN = ("careful", "careful", "angle", "curvature", "history", "mounts")
#: Designs that have studies with fewer actuators too: fields are solved for no more.
SOME_ARE_SMALL = ("careful", "history")
SMALL_SHARE, SMALL_COPIES = 0.3, 2
COMMAND = "benchmarks/hidden_dataset.py"
#: Multiples of the usual size of an effect that is planted by physics.
PLANTED_SIZES = (1.0, 1.5)


@dataclass(frozen=True)
class Plan:
    """A study before it is made.

    Parameters
    ----------
    study : HiddenStudy
        What is hidden by functions, and the name of the design.
    origin : Origin
        By what.
    small : bool
        Whether fewer actuators are tested.
    planted : str
        Name of the cause that is planted by physics; empty if none.
    """

    study: HiddenStudy
    origin: Origin
    small: bool = False
    planted: str = ""


def plans(count: int, *, seed: int, physics: int) -> list[Plan]:
    """Return studies in an order that tells nothing; the first ones drawn are those by physics."""
    causes = np.random.default_rng((seed, 0)).permutation(HIDDEN)
    drawn = [
        _by_physics(number, seed) if number <= physics else _drawn(number, seed, causes)
        for number in range(1, count + 1)
    ]
    return [drawn[place] for place in np.random.default_rng((seed, 1)).permutation(count)]


def _drawn(number: int, seed: int, causes: np.ndarray) -> Plan:
    generator = np.random.default_rng((seed, 2, number))
    kind = str(generator.choice(list(KINDS), p=list(KINDS.values())))
    design, effects, size = _effects(kind, str(causes[number % len(causes)]), generator)
    small = design in SOME_ARE_SMALL and bool(generator.random() < SMALL_SHARE)
    origins = {"none": Origin.NOTHING, "outside": Origin.OUTSIDE}
    study = HiddenStudy(number, kind, design, effects, size)
    return Plan(study, origins.get(kind, Origin.RULE), small)


def _effects(
    kind: str, first: str, generator: np.random.Generator
) -> tuple[str, tuple[HiddenEffect, ...], float]:
    """Return design, effects and size; every cause in turn is the first one."""
    if kind == "none":
        return str(generator.choice(list(designs()))), (), 0.0
    if kind == "outside":
        return _outside(generator)
    design = ONLY_IN.get(first) or str(generator.choice(ANY_DESIGN))
    size, chosen = float(generator.choice(SIZES)), [first]
    if kind == "pair":
        beside = [
            name
            for name in HIDDEN
            if name != first
            and ONLY_IN.get(name, design) == design
            and {name, first} not in REFUSED
        ]
        chosen.append(str(generator.choice(beside)))
        size = max(size, 1.0)
    return design, tuple(_sized(name, size, generator) for name in chosen), size


def _outside(generator: np.random.Generator) -> tuple[str, tuple[HiddenEffect, ...], float]:
    known = {one.name: one for one in OUTSIDE} | {form: _cause(form) for form in FORMS}
    name = str(generator.choice(list(known)))
    of_form = FORMS[name][3] if name in FORMS else ("curvature", "angle", "careful")
    size = float(generator.choice(PLANTED_SIZES))
    values = {key: size * value for key, value in known[name].typical.items()}
    return str(generator.choice(of_form)), (HiddenEffect(known[name], values),), size


def _by_physics(number: int, seed: int) -> Plan:
    generator = np.random.default_rng((seed, 3, number))
    name = list(PHYSICS)[number % len(PHYSICS)]
    size = float(generator.choice(PLANTED_SIZES))
    study = HiddenStudy(number, "single", PHYSICS[name], (), size)
    return Plan(study, Origin.PHYSICS, small=True, planted=name)


#: Causes that can be planted by physics, with the design in which they show.
PHYSICS = {"degraded_skin": "careful", "mullins": "history", "creep": "history"}


def memory_of(name: str, size: float, actuator: FieldActuator, level: float) -> Memory:
    """Return a material with a cause in it, at a degradation rate [%]."""
    of = {
        "creep": viscous(SHARE * size, RELAXATION),
        "mullins": softened(SOFTENED * size),
        "degraded_skin": from_surfaces(REACH / size),
    }
    return of[name](actuator, level)


def sizes_of(name: str, size: float) -> Mapping[str, float]:
    """Return what parameters of the catalogue a planted field comes to; none where none does."""
    if name == "creep":
        share = SHARE * size
        return {"amount": share / (1.0 - share), "time_constant": RELAXATION / (1.0 - share)}
    return {"softening": SOFTENED * size} if name == "mullins" else {}


def design_of(plan: Plan) -> Design:
    """Return the tests of a study."""
    whole = designs()[plan.study.design]
    if not plan.small:
        return whole
    table = whole.actuator
    copy = table["specimen_id"].str[-1].astype(int)
    kept = table["degradation_pct"].isin(LEVELS) & (copy <= SMALL_COPIES)
    return replace(whole, actuator=table[kept].reset_index(drop=True))


def forward_of(plan: Plan, design: Design) -> ForwardMap:
    """Return the mechanics of a study."""
    if not plan.planted:
        return library()
    tests = [test for _, test in design.actuator.groupby("specimen_id", sort=False)]
    levels = [float(test["degradation_pct"].iloc[0]) for test in tests]
    held = np.zeros((len(tests), len(tests[0])))
    if "time_s" in design.actuator:
        held = np.stack([np.diff(test["time_s"], prepend=0.0) for test in tests])

    def remembering(actuator: FieldActuator, place: int) -> Memory:
        return memory_of(plan.planted, plan.study.size, actuator, levels[place])

    return FieldMap(Geometry(Dimensions()), COARSE, held, remembering, finer=library())


def write_study(plan: Plan, name: str, folder: Path, *, seed: int) -> HiddenTruth:
    """Make one study, write its folder, and return what is hidden in it."""
    design = design_of(plan)
    made = experimented(plan.study, forward=forward_of(plan, design), seed=seed, design=design)
    own = int(hashlib.sha256(f"{seed}/{name}".encode()).hexdigest()[:7], 16)
    settings = Settings(title=f"Study {name}", seed=own, priors=made.priors)
    settings = replace(settings, virtual=True, note="Simulated; see README.md beside the folders.")
    provenance = Provenance(command=COMMAND, seed=own, mesh={})
    texts = study_files(made.experiment, settings, provenance=provenance)
    folder.mkdir(parents=True)
    for file, text in texts.items():
        if file != TRUTH_FILE:
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
    return truth_of(plan, name, folder, made)


def truth_of(plan: Plan, name: str, folder: Path, made: MadeStudy) -> HiddenTruth:
    """Return the line of the truths; how far an effect shows is seen from the base model's fit."""
    hidden = {one.cause.name: dict(one.values) for one in plan.study.effects}
    shows = {}
    if plan.study.effects:
        with threadpool_limits(limits=1):
            model = assemble(read_study(folder)).model
            base = base_without_chain(model, np.random.SeedSequence(0))
            shows = visible(base, plan.study.effects, made.truth)
    if plan.planted:
        hidden = {plan.planted: dict(sizes_of(plan.planted, plan.study.size))}
    mechanism = plan.study.effects[0].cause.mechanism if plan.origin is Origin.OUTSIDE else ""
    return HiddenTruth(
        study=name,
        origin=plan.origin,
        design=plan.study.design,
        hidden={cause: _rounded(sizes) for cause, sizes in hidden.items()},
        visible=_rounded(shows),
        mechanism=mechanism,
    )


def _rounded(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: float(f"{value:.6g}") for name, value in numbers.items()}


def write_dataset(
    out: Path, truths: Path, *, studies: int, seed: int, physics: int = 0
) -> list[HiddenTruth]:
    """Write a data set: folders, README, manifest, and the truths in a file of their own.

    Raises
    ------
    FileExistsError
        If the folder or the file is there: a data set is never mixed with another.
    ValueError
        If the truths would lie in the folder that is published.
    """
    if out.resolve() in (truths.resolve(), *truths.resolve().parents):
        raise ValueError(f"{truths} lies in {out}, which is published; name a file elsewhere")
    for path in (out, truths):
        if path.exists():
            raise FileExistsError(f"{path} is there already; name another, or remove it")
    part = out.with_name(f".{out.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    found = []
    for number, plan in enumerate(plans(studies, seed=seed, physics=physics), start=1):
        name = f"{number:04d}"
        found.append(write_study(plan, name, part / name, seed=seed))
    (part / "README.md").write_text(README.format(studies=studies), encoding="utf-8", newline="\n")
    text = lines_of(found)
    (part / "manifest.json").write_text(_manifest(part, text), encoding="utf-8", newline="\n")
    truths.parent.mkdir(parents=True, exist_ok=True)
    truths.write_text(text, encoding="utf-8", newline="\n")
    part.rename(out)
    return found


def _manifest(folder: Path, truths: str) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    content = {
        "made_by": COMMAND,
        "studies": sum(path.is_dir() for path in folder.iterdir()),
        "truths_sha256": hashlib.sha256(truths.encode()).hexdigest(),
        "files_sha256": {
            path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in files
        },
    }
    return json.dumps(content, indent=1) + "\n"


README = """\
# Hidden effects in experiments on soft actuators

{studies} virtual studies of actuators that bend under pressure and degrade. In each nothing, one
cause, two, or something that has no name in the catalogue makes the readings differ from what a
finite element model says. **The task: say which.**

## What is here

A folder for each study, `0001` and so on, with `study.toml` (title, seed of the analysis, what is
known beforehand) and CSV files. Lines that begin with `#` are comments.

| file | columns |
|---|---|
| `moisture.csv` | `film_id`, `time_h`, `mass_equilibrated_g`, `mass_dry_g`: degradation in soil |
| `shrinkage.csv` | `film_id`, masses poured, cured and conditioned [g]: volume ratio of the gel |
| `tensile.csv` | stress [MPa] against stretch of films at degradation rates [%] |
| `break.csv` | elongation at break [%] of films |
| `actuator.csv` | `curvature_per_m`, in some studies `bend_angle_deg`, against `pressure_kPa` at \
degradation rates; in some also time, cycle, branch, humidity, mount |

`bayesdeg causes` lists the catalogue with mechanisms, parameters, units and priors. The model is \
the finite element model of the package; any other will do. Some effects were put in by the very \
rule by which the package explains them, some by another physics, some by something outside the \
catalogue. Specimens scatter, and errors of reading are alike along a curve.

## How to answer

One row a study, in a CSV file:

| column | content |
|---|---|
| `study` | name of the folder |
| `outcome` | `adequate` (nothing is wrong), `named`, `ambiguous` (causes that cannot be told \
apart), `unexplained` (something is wrong that no cause explains) |
| `causes` | a product of sets: `creep\\|mullins;gravity` is creep or mullins, and gravity \
besides; empty for the other outcomes |
| `p_value` | optional: of the misfit without a cause |
| `sizes` | optional: `pressure_offset.offset=14[13.2:14.8];…`, mean and 5 and 95 % |
| `probabilities` | optional: that each cause acts, `creep=0.9;mullins=0.1`; 0 where not listed |

Or JSON lines (`answers.jsonl`), as `docs/schemas/hidden-answer.json` has them. Every study needs \
its row. `bayesdeg score answers.csv truths.jsonl` scores it: a set is right if it holds the \
cause, and counts for one over the number of its members, so that naming everything wins nothing.

## Rules

Each study is answered from its own folder. Nothing is learnt from truths of this data set; \
another one, for practice, is made with another seed. `manifest.json` has the hashes of all files \
and of the truths.

Licence: MIT, as the repository's.
"""


def main() -> None:
    """Write a data set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=100)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--physics", type=int, default=0, help="of them planted by solved fields")
    parser.add_argument("--out", type=Path, required=True, help="folder that is published")
    parser.add_argument("--truths", type=Path, required=True, help="file that is kept")
    options = parser.parse_args()
    if not 0 <= options.physics <= options.studies or options.studies < 1:
        parser.error("--studies must be 1 or more, and --physics no more than that")
    try:
        found = write_dataset(
            options.out,
            options.truths,
            studies=options.studies,
            seed=options.seed,
            physics=options.physics,
        )
    except (OSError, ValueError) as fault:
        parser.error(str(fault))
    print(f"{len(found)} studies in {options.out}, truths in {options.truths}")


if __name__ == "__main__":
    main()
