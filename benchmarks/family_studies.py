"""Virtual studies of actuators of different families, from their files to a verdict.

    uv run python benchmarks/family_studies.py --make      # a minute or two
    uv run python benchmarks/family_studies.py --json      # runs both at quick effort

``straight_channels`` is a block of silicone with two channels along it and nothing that keeps its
bottom from stretching; ``layer`` a pneunet of the same silicone with a stiffer elastomer under it.
Four actuators each and three films; the exact map solves them on a mesh finer than any that
training uses, with scatter of specimens and errors of reading. The gauge that was read shows
1.5 kPa more than there is in the channels: it is hidden by that, not by the rule of a cause. Keys:
``minutes`` from an empty folder to the verdict, each the worst, and what was concluded of each.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.study import read_study
from bayesdeg.files import write_text
from bayesdeg.laboratory.experiment import design_of, run_experiment
from bayesdeg.laboratory.truth import Truth
from bayesdeg.laboratory.writing import NOTE, Provenance, study_files

STUDIES = Path(__file__).parent / "family_studies"
CACHE = Path(".cache/family_studies")
OFFSET = 1.5  # kPa, of the gauge
SEED = 2718
SAID = (
    "This is a virtual experiment: all specimens were simulated by the fine finite element model, "
    "with scatter of specimens and errors of reading. What is hidden in it stands in "
    "benchmarks/family_studies.py."
)
# kPa; that of Ecoflex 00-50 is about as stiff
SILICONE = Truth(
    c1=(2.0e-2, 2.1e-2, 2.2e-2),
    c2_ratio=(-0.1, -0.1, -0.1),
    c3=(4e-5, 4e-5, 4e-5),
    elongation=(900.0, 900.0, 900.0),
    volume_ratio=1.0,
    tensile_noise_floor=2e-4,
    curvature_noise_floor=0.05,
)
PRIORS = """
[priors]
"c1_at_0" = { law = "lognormal", median = 0.02, sigma = 0.5 }
"c3_at_0" = { law = "lognormal", median = 4e-5, sigma = 0.7 }

[noise]
degradation_sd_pct = 0.0
"""
ACTUATORS = {
    "straight_channels": """
[actuator]
kind = "cylindrical"
length = 60.0
width = 14.0
height = 12.0
channels = 2
channel_length = 50.0
channel_width = 3.0
channel_height = 3.0
pitch = 6.0
offset = 8.0
passive = "none"

[constraint]
kind = "none"
""",
    "layer": """
[actuator]
roof = 2.0
side_wall = 2.0

[constraint]
kind = "elastomer"
thickness = 1.5
C1 = 200.0
""",
}
LARGEST = {"straight_channels": 20.0, "layer": 8.0}  # kPa
STEPS, SPECIMENS, FILMS = 10, 4, 3


def template(name: str) -> Path:
    """Write the folder that says what is tested."""
    folder = CACHE / name / "template"
    folder.mkdir(parents=True, exist_ok=True)
    head = f'title = "{name}"\nseed = {SEED}\n'
    (folder / "study.toml").write_text(head + ACTUATORS[name] + PRIORS, encoding="utf-8")
    pressures = np.linspace(0.0, LARGEST[name], STEPS + 1)
    rows = [f"a{k},0,{p:g},{0.1 * p:g}" for k in range(SPECIMENS) for p in pressures]
    header = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n"
    (folder / "actuator.csv").write_text(header + "\n".join(rows) + "\n", encoding="utf-8")
    films = [f"f{k},0,uniaxial,{s:g},{0.04 * (s - 1.0):g},nominal"
             for k in range(FILMS) for s in np.linspace(1.1, 2.5, 8)]  # fmt: skip
    header = "specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure\n"
    (folder / "tensile.csv").write_text(header + "\n".join(films) + "\n", encoding="utf-8")
    return folder


def finer(name: str) -> Resolution:
    """Return a mesh finer in the section than that of training."""
    if name == "layer":
        return Resolution(along=1.1, across=0.9, up=0.95, grading=0.75)
    return Resolution(along=7.5, across=0.6, up=0.6, grading=0.75)


def make(name: str) -> None:
    """Write the virtual study of an actuator."""
    design = read_study(template(name))
    exact = ExactMap(geometry_of_study(design.settings), finer(name))

    def forward(inputs: Inputs) -> Prediction:
        return exact(replace(inputs, pressure=np.maximum(inputs.pressure - OFFSET, 0.0)))

    truth = replace(SILICONE, paper_thickness=design.settings.paper.thickness)
    experiment = run_experiment(
        design_of(design), truth, forward=forward, generator=np.random.default_rng(SEED)
    )
    command = f"python benchmarks/family_studies.py --make --only {name}"
    origin = Provenance(command=command, seed=SEED, mesh=vars(finer(name)))
    made = study_files(experiment, design.settings, provenance=origin)
    for file in ("study.toml", "actuator.csv", "tensile.csv"):
        write_text(STUDIES / name / file, made[file].replace(NOTE, SAID))


def run(name: str) -> dict[str, Any]:
    """Run a study in a folder where nothing was solved yet."""
    place = CACHE / name / f"run_{os.getpid()}"
    place.mkdir(parents=True)
    begun = time.perf_counter()
    command = [sys.executable, "-m", "bayesdeg", "run", str((STUDIES / name).resolve())]
    options = ["--out", "reports", "--workers", "2", "--yes", "--effort", "quick"]
    done = subprocess.run([*command, *options], cwd=place, check=False, capture_output=True,
                          text=True, env={**os.environ, "PYTHONPATH": str(Path.cwd())})  # fmt: skip
    minutes = (time.perf_counter() - begun) / 60.0
    (place / "stderr.txt").write_text(done.stderr, encoding="utf-8")
    if done.returncode != 0:
        return {"minutes": minutes, "outcome": f"exit code {done.returncode}: {place}"}
    found = json.loads((place / "reports" / "verdict.json").read_text(encoding="utf-8"))
    return {"minutes": minutes, "outcome": found["outcome"], "causes": found["causes"],
            "place": str(place)}  # fmt: skip


def main() -> None:
    """Make or run the studies."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(ACTUATORS))
    parser.add_argument("--make", action="store_true")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if asked.make:
        for name in asked.only:
            make(name)
        return
    found = {name: run(name) for name in asked.only}
    worst = max(one["minutes"] for one in found.values())
    print(json.dumps({"minutes": worst, "details": found}))


if __name__ == "__main__":
    main()
