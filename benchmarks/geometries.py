"""How long it takes from a study of an actuator that was never seen to its verdict, and how wrong
the emulator is that was trained for it.

    uv run python benchmarks/geometries.py --json

Each geometry has a virtual study in ``benchmarks/geometries_studies``: films and 18 actuators of
the gelatin study on a finer mesh than any emulator's, an offset of the pressure hidden in it
(``--make`` makes it, some ten minutes on two cores). An emulator is trained where the study lies,
and the study is run with it. Curves at draws of the study's posterior, and others that it may ask
for before its readings are known, none of which training saw, are then solved on the emulator's own
mesh. What is solved is kept in ``.cache/geometries``; times of what was found there are those that
were measured then.

Keys, each the worst of the geometries: ``minutes`` from reading the study to the report,
``training_minutes`` of them, at draws of the posterior ``error_p95_pct`` of curvature and bend
angle over the largest value of a curve, ``stretch_p95_pct`` of the peak stretch less 1 likewise and
``limit_pct`` of pressures at which curves end, where some do, ``error_p95_before_pct`` of curvature
and bend angle at what may be asked before readings are known, ``posterior_shift`` the largest shift
of a posterior mean in sds when exact curves of the emulator's mesh take its place
(``emulator_posterior``).
"""

import argparse
import json
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from emulator_held_out import HeldOut
from emulator_posterior import posterior_shift
from numpy.typing import NDArray

from bayesdeg.actuator.curve import CurveSolution, ExactMap
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.status import Resolution
from bayesdeg.analysis.region import asked_of, posteriors_of
from bayesdeg.console import errors
from bayesdeg.data.study import Study, read_study
from bayesdeg.files import write_text
from bayesdeg.laboratory.experiment import design_of, run_experiment
from bayesdeg.laboratory.truth import Truth, parse_effects
from bayesdeg.laboratory.writing import Provenance, study_files
from bayesdeg.surrogate.campaign import complete
from bayesdeg.surrogate.local import InputDraws, curves_of, span_of
from bayesdeg.surrogate.solutions import Kind, Run, SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.workers import workplace
from bayesdeg.training import LOCAL, TrainingOptions, emulator_for

Floats = NDArray[np.float64]
Json = dict[str, Any]

CACHE = Path(".cache/geometries")
STUDIES = Path(__file__).parent / "geometries_studies"
TEMPLATE = Path("studies/gelatin_actuator")
# in each direction finer than the mesh that an emulator stands for
FINER = Resolution(along=1.1, across=0.9, up=0.95, grading=0.75)
HIDDEN = "pressure_offset=14"
SEED = 4242
LOADS = 60  # of a held-out curve: between fourteen, where it ends is uncertain by 3 %
DIMENSIONS = {
    "six_chambers": {"length": 60.0, "width": 12.0, "height": 12.0, "chambers": 6},
    "inner_channels": {"length": 50.0, "chambers": 5, "gap": 0.0},
    "long": {"length": 90.0, "width": 20.0, "height": 17.0, "chambers": 7, "floor": 3.0,
             "roof": 3.0, "side_wall": 3.0, "end_wall": 5.0, "chamber_wall": 2.0,
             "channel_width": 4.0, "channel_height": 2.5, "channel_roof": 2.0},
}  # fmt: skip


def template(name: str) -> Path:
    """Write the folder that says what is tested: films and actuators of the gelatin study."""
    folder = CACHE / name / "template"
    folder.mkdir(parents=True, exist_ok=True)
    for file in TEMPLATE.glob("*.csv"):
        if file.name != "summary.csv":
            (folder / file.name).write_bytes(file.read_bytes())
    lines = [f'title = "{name}"', f"seed = {SEED}", "", "[actuator]"]
    lines += [f"{key} = {value}" for key, value in DIMENSIONS[name].items()]
    (folder / "study.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def make(name: str, workers: int) -> None:
    """Write the virtual study of a geometry into ``STUDIES``, from finite elements."""
    design = read_study(template(name))
    geometry = geometry_of_study(design.settings)
    mesh = geometry.mesh_like(FINER)
    with workplace(workers, None) as executor:
        forward = ExactMap(
            geometry, mesh, executor=executor, on_curve=partial(errors.print, "a curve of", name)
        )
        experiment = run_experiment(
            design_of(design),
            Truth(),
            forward=forward,
            generator=np.random.default_rng(SEED),
            effects=parse_effects([HIDDEN]),
        )
    command = f"python benchmarks/geometries.py --make --only {name}"
    origin = Provenance(command=command, seed=SEED, mesh=vars(mesh))
    for file, text in study_files(experiment, design.settings, provenance=origin).items():
        write_text(STUDIES / name / file, text)


def _bayesdeg(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "bayesdeg", *map(str, arguments)], check=True)


def trained(name: str, study: Study, workers: int) -> tuple[Surrogate, float]:
    """Return the emulator of a study and the minutes that it took when it was trained."""
    begun, kept = time.perf_counter(), CACHE / name / "minutes.json"
    kept.parent.mkdir(parents=True, exist_ok=True)
    with workplace(workers, None) as executor:
        found = emulator_for(study, None, options=TrainingOptions(yes=True), executor=executor)
    assert found is not None
    if not kept.exists():
        minutes = (time.perf_counter() - begun) / 60.0
        kept.write_text(json.dumps({"training": minutes}), encoding="utf-8")
    return found, float(json.loads(kept.read_text(encoding="utf-8"))["training"])


def held_out(study: Study, asked: InputDraws, count: int, workers: int) -> list[HeldOut]:
    """Return curves at draws, on the mesh that the study's emulator stands for."""
    geometry = geometry_of_study(study.settings)
    curves = [
        replace(curve, loads=tuple(curve.loads[-1] * (np.arange(LOADS) + 1.0) / LOADS))
        for curve in curves_of(asked, span_of(asked, wider=0.0), count, seed=SEED)
    ]
    store, mesh = SolutionStore(CACHE / "held_out"), LOCAL(geometry.dimensions).fine_mesh
    runs = [Run(geometry, mesh, curve, Kind.CURVE) for curve in curves]
    with workplace(workers, None) as executor:
        found = complete(runs, store, executor=executor, on_run=lambda f: errors.print(f.seconds))
    return [
        HeldOut(run.curve, solution, 0.0)
        for run, solution in zip(runs, found, strict=True)
        if isinstance(solution, CurveSolution) and len(solution.readings) > 1
    ]


def errors_of(surrogate: Surrogate, curves: list[HeldOut]) -> tuple[Floats, list[float]]:
    """Return largest errors of each curve over its largest value, (n, 3), and those of its end."""
    worst, ends = [], []
    for one in curves:
        answer = surrogate(one.inputs)
        found = np.stack([answer.curvature, answer.bend_angle, answer.peak_stretch - 1.0])
        known = np.isfinite(found[0])
        if known.any():
            gap = np.abs(found - one.truth)[:, known].max(axis=1)
            worst.append(100.0 * gap / np.abs(one.truth).max(axis=1))
        limit, known = surrogate.limit_pressure(one.inputs).pressure.item(), one.solution.limit_load
        if np.isfinite(known) and np.isfinite(limit):
            ends.append(100.0 * abs(limit / (1e3 * known) - 1.0))
    return np.array(worst), ends


def shifted(study: Study, surrogate: Surrogate, workers: int, exact_draws: int) -> float:
    """Return the largest shift of a posterior mean by exact curves [sd]; see the module's head."""
    mesh, store = LOCAL(study.settings.dimensions).fine_mesh, SolutionStore(CACHE / "held_out")
    with workplace(workers, None) as executor:
        shift, facts = posterior_shift(
            surrogate, store, exact_draws=exact_draws, study=study, mesh=mesh, executor=executor
        )
    errors.print(f"{facts['parameter']} moves most, by {shift:.2f} sd", soft_wrap=True)
    return shift


def judged(name: str, workers: int, curves: int, exact_draws: int) -> Json:
    """Train, run, compare: what is found of one geometry."""
    folder = STUDIES / name
    study = read_study(folder)
    surrogate, training = trained(name, study, workers)
    out, begun = CACHE / name / "report", time.perf_counter()
    _bayesdeg("run", folder, "--out", out, "--workers", workers, "--yes", "--fresh")
    running = (time.perf_counter() - begun) / 60.0
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    seen = held_out(study, posteriors_of(study, surrogate, SEED).asked, curves, workers)
    worst, ends = errors_of(surrogate, seen)
    earlier = held_out(study, asked_of(study, SEED), curves, workers)
    before, _ = errors_of(surrogate, earlier)
    shift = shifted(study, surrogate, workers, exact_draws) if exact_draws else None
    p95 = np.quantile(worst, 0.95, axis=0)
    record = json.loads(surrogate.record)
    return {
        "minutes": training + running,
        "training_minutes": training,
        "error_p95_pct": float(p95[:2].max()),
        "stretch_p95_pct": float(p95[2]),
        "limit_pct": max(ends, default=None),
        "error_p95_before_pct": float(np.quantile(before[:, :2].max(axis=1), 0.95)),
        "posterior_shift": shift,
        "curves_answered": f"{len(worst)} of {len(seen)}",
        "coarse_and_fine_curves": [record["coarse_curves"], record["fine_curves"]],
        "left_out_p95_pct": record["accuracy"]["curvature"]["p95_pct"],
        "outcome": verdict["outcome"],
        "causes": verdict["causes"],
    }


def main() -> None:
    """Judge the geometries and print the worst of each figure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    made = [name for name in DIMENSIONS if (STUDIES / name).exists()]
    parser.add_argument("--only", choices=list(DIMENSIONS), nargs="*", default=made)
    parser.add_argument("--curves", type=int, default=8, help="held out, of each geometry")
    parser.add_argument(
        "--exact-draws", type=int, default=2, help="curves a rate for posterior_shift; 0: not asked"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--make", action="store_true", help="make the virtual studies, and end")
    given = parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    if given.make:
        for name in given.only:
            make(name, given.workers)
        return
    found = {
        name: judged(name, given.workers, given.curves, given.exact_draws) for name in given.only
    }
    keys = (
        "minutes",
        "training_minutes",
        "error_p95_pct",
        "stretch_p95_pct",
        "limit_pct",
        "error_p95_before_pct",
        "posterior_shift",
    )
    worst = {
        key: max((one[key] for one in found.values() if one[key] is not None), default=None)
        for key in keys
    }
    document = worst | {"geometries": found}
    print(json.dumps(document, indent=1) if given.json else document)


if __name__ == "__main__":
    main()
