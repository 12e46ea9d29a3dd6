"""How long a verdict takes, and how that grows with the study.

    uv run python benchmarks/verdict_seconds.py --json

Seconds by the clock on the wall, of two worker processes that are warm, from the fitted base model
to the verdict as `bayesdeg run` asks for it. The keys of the document:

gelatin_quick, gelatin_standard   the study of the README at either effort
cycle_quick, cycle_standard       18 actuators, loading and unloading, 23 readings each, creep
cycle_none_quick                  the same with nothing hidden
cycle_outside_quick               the same with an effect that no cause describes
edge_quick                        the same with actuators that are about to balloon
specimens_100                     100 actuators, 12 readings each, at standard effort
fit_seconds                       mode and evidence of the gelatin study's base model
old_over_new                      the gelatin study's verdict at quick effort by an older version
                                  over that by this one, medians of runs in turns
growth                            with --sizes: seconds against readings, specimens and causes
details                           seconds of the fits, outcomes, faults

The studies are drawn by their names and a seed, see `verdict_studies.py`. A figure is null where
its study took longer than the limit, or failed; details say which. ``--old`` is a checkout with its
own environment; without it the commit `OLD` of this repository is unpacked and installed, which
needs git and uv.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from fine_library import shipped_library
from forward_case import machine, say
from verdict_studies import SEED, TimedStudy, of_size, studies, write

Json = dict[str, Any]

ROOT = Path(__file__).parents[1]
CHILD = Path(__file__).with_name("verdict_timed.py")
OLD = "5a7c3c1"  # before verdicts were made faster
GELATIN = "studies/gelatin_actuator"
LIMIT = 300.0  # s that one study may take, its fit included
TURNS = 3  # of old and new; a median needs as many
# key: study and effort
TIMED = {
    "gelatin_quick": (GELATIN, "quick"),
    "gelatin_standard": (GELATIN, "standard"),
    "cycle_quick": ("cycle", "quick"),
    "cycle_standard": ("cycle", "standard"),
    "cycle_none_quick": ("cycle_none", "quick"),
    "cycle_outside_quick": ("cycle_outside", "quick"),
    "edge_quick": ("edge", "quick"),
    "specimens_100": ("specimens_100", "standard"),
}
OTHERS = ("fit_seconds", "old_over_new")


@dataclass(frozen=True)
class Bench:
    """Where studies are made and what each may take.

    Parameters
    ----------
    folder : Path
        Temporary; holds the studies that are drawn.
    seed : int
        Of the draws.
    limit : float
        Of one study [s].
    workers : int
        Processes of a verdict.
    python : tuple of str
        The interpreter that judges, and what comes before it.
    """

    folder: Path
    seed: int
    limit: float
    workers: int
    python: tuple[str, ...] = (sys.executable,)
    made: dict[str, Path] = field(default_factory=dict)

    def study(self, name: str, study: TimedStudy | None = None) -> Path:
        """Return the folder of a study, made when it is first asked for."""
        if name == GELATIN:
            return ROOT / GELATIN
        if name not in self.made:
            self.made[name] = self.folder / name.replace(" ", "_")
            drawn = studies()[name] if study is None else study
            write(drawn, name, self.made[name], forward=shipped_library(), seed=self.seed)
        return self.made[name]

    def told(self, study: Path, *arguments: str) -> Json:
        """Judge one study in a process of its own and return all that it told."""
        command = (*self.python, str(CHILD), str(study), *arguments)
        return _told((*command, "--workers", str(self.workers)), self.limit)


def _told(command: Sequence[str], limit: float) -> Json:
    """Run a command that tells one JSON object a line, and join these; end it at the limit."""
    with tempfile.TemporaryFile("w+", encoding="utf-8") as faults:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=faults, text=True, start_new_session=True
        )
        joined: Json = {}
        try:
            said, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)  # its workers too
            said, _ = process.communicate()
            joined["fault"] = f"took longer than {limit:g} s"
        for line in said.splitlines():
            joined |= json.loads(line)
        if process.returncode > 0:
            faults.seek(0)
            joined["fault"] = (faults.read().strip().splitlines() or ["it failed"])[-1]
    return joined


def verdicts(bench: Bench, chosen: Sequence[str], document: Json) -> Json:
    """Time the verdicts of the chosen keys."""
    details: Json = {}
    for key in (key for key in TIMED if key in chosen):
        name, effort = TIMED[key]
        told = bench.told(bench.study(name), "--effort", effort)
        document[key], details[key] = told.get("verdict"), told
        say(f"{key}: {_in_words(told)}")
    return details


def _in_words(told: Json) -> str:
    if "fault" in told:
        return str(told["fault"])
    causes = " ".join(told["causes"])
    return f"verdict {told['verdict']:.1f} s, fit {told['fit']:.1f} s: {told['outcome']} {causes}"


def fits(bench: Bench, document: Json) -> Json:
    """Time mode and evidence of the gelatin study's base model."""
    told = bench.told(bench.study(GELATIN), "--fit-only")
    document["fit_seconds"] = statistics.median(told["fits"]) if "fits" in told else None
    say(f"fit_seconds: {told.get('fault', document['fit_seconds'])}")
    return told


def old_over_new(bench: Bench, old: tuple[str, ...], turns: int, document: Json) -> Json:
    """Time the gelatin study's verdict by an older version and by this one, in turns.

    One turn before those that count, so that compiled code is in the cache.
    """
    times: dict[str, list[float]] = {"old": [], "new": []}
    user: dict[str, list[float]] = {"old": [], "new": []}  # start and fit included
    for turn in range(turns + 1):
        for name, python in (("old", old), ("new", bench.python)):
            told = replace(bench, python=python).told(bench.study(GELATIN))
            if "fault" in told:
                document["old_over_new"] = None
                return {"fault": f"{name}: {told['fault']}", **times}
            if turn > 0:
                times[name].append(told["verdict"])
                user[name].append(told["user_seconds"])
            say(f"old_over_new, turn {turn} of {turns}, {name}: {told['verdict']:.1f} s")
    ratio = statistics.median(times["old"]) / statistics.median(times["new"])
    document["old_over_new"] = ratio
    return {**times, "user_seconds": user}


@contextmanager
def old_python(path: Path | None) -> Iterator[tuple[str, ...]]:
    """Give the interpreter of an older checkout, which is made if there is none."""
    if path is not None:
        yield _python_of(path)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        say(f"old_over_new: unpacking and installing {OLD}")
        archive = subprocess.run(("git", "archive", OLD), cwd=ROOT, check=True, capture_output=True)
        subprocess.run(("tar", "-x", "-C", name), input=archive.stdout, check=True)
        subprocess.run(("uv", "sync", "--quiet"), cwd=folder, check=True, env=_outside())
        yield _python_of(folder)


def _python_of(folder: Path) -> tuple[str, ...]:
    python = folder / ".venv" / "bin" / "python"
    if not python.exists():
        raise SystemExit(f"{folder} has no .venv: run 'uv sync' there")
    return (str(python),)


def _outside() -> dict[str, str]:
    """Return the environment without the one that this process runs in."""
    return {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}


def growth(bench: Bench) -> Json:
    """Time quick verdicts of studies that differ in one number each, and fit powers of it."""
    found: Json = {}
    for what, by_size in of_size().items():
        rows = []
        for size, study in by_size.items():
            told = bench.told(bench.study(f"{what} {size}", study))
            say(f"{size} {what}: {_in_words(told)}")
            rows.append({what: size, "rows": len(study.design.actuator), **told})
        powers = {key: power(rows, what, key) for key in ("verdict", "fit")}
        found[what] = {"studies": rows, "powers": powers}
    return found


def power(rows: Sequence[Json], what: str, key: str) -> float | None:
    """Return the slope of log seconds over log size; None where fewer than two were timed.

    Examples
    --------
    >>> power([{"n": 10, "s": 2.0}, {"n": 100, "s": 20.0}, {"n": 1000}], "n", "s")
    1.0
    """
    known = [(row[what], row[key]) for row in rows if key in row]
    if len(known) < 2:
        return None
    x, y = np.log(np.array(known, dtype=np.float64)).T
    return round(float(np.polyfit(x, y, 1)[0]), 2)


def measured(bench: Bench, options: argparse.Namespace) -> Json:
    """Return the document of all that was chosen."""
    chosen = (*TIMED, *OTHERS) if options.only is None else options.only
    document: Json = {}
    details: Json = {"machine": machine(), "seed": bench.seed, "limit": bench.limit}
    details |= verdicts(bench, chosen, document)
    if "fit_seconds" in chosen:
        details["fit_seconds"] = fits(bench, document)
    if "old_over_new" in chosen:
        with old_python(options.old) as python:
            details["old_over_new"] = old_over_new(bench, python, options.turns, document)
    if options.sizes:
        document["growth"] = growth(bench)
    return document | {"details": details}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--only", nargs="*", choices=(*TIMED, *OTHERS), help="keys to measure")
    parser.add_argument("--sizes", action="store_true", help="measure the growth too")
    parser.add_argument("--old", type=Path, help="checkout of an older version, installed")
    parser.add_argument("--turns", type=int, default=TURNS, help="of old and new")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--limit", type=float, default=LIMIT, help="of one study [s]")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), options.seed, options.limit, options.workers)
        document = measured(bench, options)
    if options.json:
        print(json.dumps(document, indent=1))
        return
    for key in (*TIMED, *OTHERS):
        if key in document:
            value = document[key]
            print(f"{key:24} {'null' if value is None else format(value, '.3g')}")


if __name__ == "__main__":
    main()
