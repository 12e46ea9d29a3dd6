"""Compare the outputs of runs and of every command with those of an earlier state, byte for byte.

    uv run python benchmarks/frozen_runs.py write FOLDER
    uv run python benchmarks/frozen_runs.py compare FOLDER

`write` runs five studies at quick effort, then each command on the run of gelatin_actuator, and
keeps in FOLDER what must not change when code is rearranged: verdict.json, run.json without times,
every CSV, and exit code and JSON of each command. `compare` does the same in a folder of its own
and prints what differs. Only one machine gives the same bytes twice, so FOLDER is not committed.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
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
#: Fields of run.json and of answers that tell of the moment or the machine.
OF_THE_MOMENT = {"durations_s", "started", "finished", "cpu_count", "peak_memory_mb"}
NEW_READINGS = "specimen_id,pressure_kPa,curvature_per_m,degradation_pct\nnew,100,6.1,10\n"


def commands(gelatin: Path, study: Path, place: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield a name and the arguments of each call."""
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
    for name in ("fall_times",):
        run = gelatin.parent / name
        yield f"predict_{name}", ["predict", str(run), "--x", "height=1.0", "--json"]


def call(arguments: Iterable[str]) -> subprocess.CompletedProcess[str]:
    """Call the program in this environment."""
    program = str(Path(sys.executable).parent / "bayesdeg")
    return subprocess.run(
        [program, *arguments], capture_output=True, text=True, cwd=ROOT, check=False
    )


def without_moment(value: object) -> object:
    """Return a JSON value without what tells of the moment."""
    if isinstance(value, dict):
        return {k: without_moment(v) for k, v in value.items() if k not in OF_THE_MOMENT}
    return [without_moment(one) for one in value] if isinstance(value, list) else value


def kept(source: Path, to: Path) -> None:
    """Copy what is compared of a run or study folder."""
    for file in sorted(source.rglob("*")):
        target = to / file.relative_to(source)
        if file.name in {"verdict.json", "run.json"}:
            target.parent.mkdir(parents=True, exist_ok=True)
            plain = without_moment(json.loads(file.read_text(encoding="utf-8")))
            target.write_text(json.dumps(plain, indent=1), encoding="utf-8")
        elif file.suffix == ".csv" or file.name == "study.toml":
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)


def write(folder: Path, work: Path) -> None:
    """Run everything in ``work`` and keep in ``folder`` what is compared."""
    runs = work / "runs"
    codes: dict[str, int] = {}
    for name, study in STUDIES.items():
        done = call(
            ["run", str(study), "--effort", "quick", "--yes", "--out", str(runs / name), "--quiet"]
        )
        codes[f"run {name}"] = done.returncode
        kept(runs / name, folder / name)
        print(f"run {name}: exit code {done.returncode}", done.stderr[-500:], sep="\n")
    study, gelatin = STUDIES["gelatin_actuator"], runs / "gelatin_actuator"
    answers = folder / "commands"
    answers.mkdir(parents=True, exist_ok=True)
    for name, arguments in commands(gelatin, study, work):
        done = call(arguments)
        codes[name] = done.returncode
        said = done.stdout.replace(str(work), "WORK").replace(str(ROOT), "ROOT")
        (answers / f"{name}.txt").write_text(said, encoding="utf-8")
        print(f"{name}: exit code {done.returncode}")
    for made in ("updated", "virtual", "begun"):
        if (work / made).is_dir():
            kept(work / made, folder / made)
    (folder / "exit_codes.json").write_text(json.dumps(codes, indent=1), encoding="utf-8")


def differing(one: Path, other: Path) -> list[str]:
    """Return which files are not the same in both folders."""
    names = {
        str(f.relative_to(place)) for place in (one, other) for f in place.rglob("*") if f.is_file()
    }
    return [
        name
        for name in sorted(names)
        if not (one / name).is_file()
        or not (other / name).is_file()
        or (one / name).read_bytes() != (other / name).read_bytes()
    ]


def main() -> None:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["write", "compare"])
    parser.add_argument("folder", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        work = Path(place).resolve()
        if asked.what == "write":
            write(asked.folder, work)
            return
        now = asked.folder.with_name(asked.folder.name + "_now")
        shutil.rmtree(now, ignore_errors=True)
        write(now, work)
        for name in (found := differing(asked.folder, now)):
            print("differs:", name)
        print(f"{len(found)} files differ; this state is in {now}")


if __name__ == "__main__":
    main()
