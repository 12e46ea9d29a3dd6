"""Record the outputs of runs and of every command, to compare before and after a rearrangement.

    uv run python benchmarks/frozen_runs.py FOLDER     # once before and once after a change
    diff -r BEFORE AFTER

Runs five studies at quick effort, then each command on the run of gelatin_actuator, and keeps in
FOLDER what a rearrangement of code must not change: verdict.json, run.json without times and
versions, every CSV, and exit code and output of each command. Only one machine gives the same
bytes twice, so FOLDER is not committed.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLANTED = ROOT / "tests" / "hidden_effects" / "studies"
STUDIES = {
    "gelatin_actuator": ROOT / "studies" / "gelatin_actuator",
    "fall_times": ROOT / "studies" / "fall_times",
    "marchese_ribbed": ROOT / "studies" / "marchese_ribbed",
    "planted_11": PLANTED / "11",
    "planted_19": PLANTED / "19",
}
# Fields of run.json that differ between two runs of the same code.
VOLATILE = {"created", "seconds", "memory", "version", "versions"}
NEW_READINGS = (
    "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m\n"
    "new,10,0,100,10.5\n"
)


def commands(runs: Path, place: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield a name and the arguments of each call."""
    study, gelatin = STUDIES["gelatin_actuator"], runs / "gelatin_actuator"
    new, virtual = place / "new.csv", place / "virtual"
    new.write_text(NEW_READINGS, encoding="utf-8")
    pressures = ["--pressure", "60,160", "--degradation", "0,25"]
    duty = ["--pressure", "60", "--curvature", "10"]
    yield "check", ["check", str(study)]
    yield "check_without", ["check", str(place / "nothing")]
    yield "causes", ["causes", "--json"]
    yield "predict", ["predict", str(gelatin), *pressures, "--json"]
    yield "predict_base", ["predict", str(gelatin), *pressures, "--base", "--json"]
    yield "predict_hours", ["predict", str(gelatin), "--pressure", "100", "--hours", "4", "--json"]
    yield "predict_outside", ["predict", str(gelatin), "--pressure", "-5", "--json"]
    yield "control", ["control", str(gelatin), "--curvature", "8", "--degradation", "10", "--json"]
    yield "lifetime", ["lifetime", str(gelatin), *duty, "--hours", "0,4,8", "--json"]
    yield "next", ["next", str(gelatin), "--json"]
    update = ["update", str(gelatin), str(new), "--out", str(place / "updated"), "--json"]
    yield "update", update
    yield "report", ["report", str(gelatin)]
    offset = ["--cause", "pressure_offset=10"]
    yield "simulate", ["simulate", str(study), "--out", str(virtual), *offset, "--seed", "3"]
    yield "init", ["init", str(place / "begun")]
    own = runs / "fall_times"
    yield "predict_fall_times", ["predict", str(own), "--x", "height_m=1.0", "--json"]


def call(arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Call the program in this environment."""
    program = str(Path(sys.executable).parent / "bayesdeg")
    return subprocess.run(
        [program, *arguments], capture_output=True, text=True, cwd=ROOT, check=False
    )


def stable(value: object) -> object:
    """Return a JSON value without volatile fields."""
    if isinstance(value, dict):
        return {k: stable(v) for k, v in value.items() if k not in VOLATILE}
    return [stable(one) for one in value] if isinstance(value, list) else value


def kept(source: Path, to: Path) -> None:
    """Copy what is compared of a run or study folder."""
    for file in sorted(source.rglob("*")):
        target = to / file.relative_to(source)
        if file.name in {"verdict.json", "run.json"}:
            target.parent.mkdir(parents=True, exist_ok=True)
            plain = stable(json.loads(file.read_text(encoding="utf-8")))
            target.write_text(json.dumps(plain, indent=1), encoding="utf-8")
        elif file.suffix == ".csv" or file.name == "study.toml":
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)


def write(folder: Path, work: Path) -> None:
    """Run everything in ``work`` and keep in ``folder`` what is compared."""
    runs = work / "runs"
    codes: dict[str, int] = {}
    for name, study in STUDIES.items():
        arguments = ["run", str(study), "--effort", "quick", "--out", str(runs / name), "--quiet"]
        if (study / "emulator.npz").is_file():
            arguments += ["--emulator", str(study / "emulator.npz")]
        done = call(arguments)
        codes[f"run {name}"] = done.returncode
        kept(runs / name, folder / name)
        print(f"run {name}: exit code {done.returncode}", done.stderr[-500:], sep="\n")
    answers = folder / "commands"
    answers.mkdir(parents=True, exist_ok=True)
    for name, arguments in commands(runs, work):
        done = call(arguments)
        codes[name] = done.returncode
        said = (done.stdout + done.stderr).replace(str(work), "WORK").replace(str(ROOT), "ROOT")
        (answers / f"{name}.txt").write_text(said, encoding="utf-8")
        print(f"{name}: exit code {done.returncode}")
    for made in ("updated", "virtual", "begun"):
        if (work / made).is_dir():
            kept(work / made, folder / made)
    (folder / "exit_codes.json").write_text(json.dumps(codes, indent=1), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    with tempfile.TemporaryDirectory() as place:
        write(parser.parse_args().folder, Path(place).resolve())
