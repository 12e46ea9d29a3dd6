"""Commands killed (SIGKILL) at random moments until they are done: the results must be the same.

    python benchmarks/kills.py --kills 25 --json

Each of `run` (a film study; the gelatin study), `emulate`, `update` and `trace` first runs
undisturbed. Then it is killed at moments drawn evenly over that time and begun again in the same
folders, until it ends before its moment; what it wrote must then be the same bits, but for dates,
durations and sizes of memory. Every second kill hits the command alone, as the kernel does when
memory is short, the others its worker processes too; workers that are left must end by themselves.
`emulate` has a recipe of a few small finite element runs.
"""

import argparse
import hashlib
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py
import numpy as np
from photograph_scenes import scene

ROOT = Path(__file__).resolve().parents[1]
VOLATILE = {"created", "seconds", "memory", "folder", "posteriors"}
#: When a posterior was made, and so the hash of its file; its arrays are compared.
VOLATILE_ATTRIBUTES = {"created_at"}
#: Of a page: when it was made, how long that took, and what memory.
VOLATILE_HTML = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\+00:00| UTC)?"
    r"|<details><summary>Wall time per stage</summary>.*?</details>"
    r"|<dt>memory, [^<]*</dt><dd>[^<]*</dd>",
    re.DOTALL,
)
#: An actuator of one chamber, as in `tests.run.tiny_campaign`.
TABLE = "[actuator]\nlength = 14.0\nchambers = 1\n"
PATIENCE = 20.0  # s until workers whose command was killed must be gone
TINY = """
import sys
from dataclasses import replace
from tests.run.tiny_campaign import RECIPE, build
from bayesdeg import cli
from bayesdeg import training
from bayesdeg.surrogate import campaign
more = replace(RECIPE, coarse_runs=24, fine_runs=8)
training.RECIPE, training.LOCAL, campaign.build = more, lambda _: more, build
sys.argv = ["bayesdeg", *sys.argv[1:]]
if __name__ == "__main__":
    sys.exit(cli.exit_code())
"""


@dataclass(frozen=True)
class Case:
    """A command; it is given a folder to work in."""

    name: str
    command: Callable[[Path], list[str]]


def _bayesdeg(*words: object) -> list[str]:
    return [sys.executable, "-m", "bayesdeg", *map(str, words)]


def cases(inputs: Path) -> list[Case]:
    """Return the commands, with what they read prepared."""
    shutil.copytree(ROOT / "studies" / "gelatin_actuator", inputs / "gelatin")
    finished = inputs / "finished"
    _done(_bayesdeg("run", inputs / "gelatin", "--effort", "quick", "--out", finished), inputs)
    (inputs / "new.csv").write_text(
        "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n"
        + "".join(f"new,10,{p},{k}\n" for p, k in ((40, 1.1), (80, 2.4), (120, 4.1), (160, 6.4))),
        encoding="utf-8",
    )
    photographs = _photographs(inputs / "photographs")
    (inputs / "tiny.toml").write_text(TABLE, encoding="utf-8")
    (inputs / "tiny_emulate.py").write_text(TINY, encoding="utf-8")
    films, gelatin = ROOT / "studies" / "treloar_uniaxial", inputs / "gelatin"
    tiny = [sys.executable, str(inputs / "tiny_emulate.py"), "emulate", str(inputs / "tiny.toml")]
    return [
        Case("run, films", lambda at: _bayesdeg("run", films, "--effort", "quick", *_out(at))),
        Case("run, gelatin", lambda at: _bayesdeg("run", gelatin, "--effort", "quick", *_out(at))),
        Case(
            "emulate",
            lambda at: [*tiny, "--store", f"{at}/store", "--yes", "--out", f"{at}/made.npz"],
        ),
        Case("update", lambda at: _bayesdeg("update", finished, inputs / "new.csv", *_out(at))),
        Case("trace", lambda at: _bayesdeg("trace", *photographs, "--grid", "5", *_out(at))),
    ]


def _out(folder: Path) -> tuple[str, str]:
    return "--out", str(folder / "made")


def _photographs(folder: Path, count: int = 8) -> list[Path]:
    """Render photographs with a checkerboard in them."""
    folder.mkdir()
    seeds = (seed for seed in range(10_000) if scene(seed, megapixels=3).target == "grid")
    paths = []
    for seed in itertools.islice(seeds, count):
        paths.append(folder / f"{seed}.jpg")
        cv2.imwrite(str(paths[-1]), scene(seed, megapixels=3).image)
    return paths


def _done(command: list[str], at: Path) -> float:
    """Run a command to its end; return the seconds that it took."""
    begun = time.perf_counter()
    done = subprocess.run(
        command, cwd=ROOT, env=_environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(
            f"{' '.join(command)} in {at} ended with {done.returncode}:\n{done.stderr}"
        )
    return time.perf_counter() - begun


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def contents(folder: Path) -> dict[str, str]:
    """Return a hash of every file but locks and durations, without what differs between runs."""
    files = [p for p in folder.rglob("*") if p.is_file() and p.suffix not in (".lock", ".seconds")]
    return {
        str(path.relative_to(folder)): hashlib.sha256(_lasting(path)).hexdigest() for path in files
    }


def _lasting(path: Path) -> bytes:
    if path.suffix == ".html":
        return VOLATILE_HTML.sub("", path.read_text(encoding="utf-8")).encode()
    if path.suffix == ".nc":
        return repr(_arrays(path)).encode()
    if path.suffix == ".json":
        document = json.loads(path.read_bytes())
        return json.dumps({k: v for k, v in document.items() if k not in VOLATILE}).encode()
    return path.read_bytes()


def _arrays(path: Path) -> list[tuple[str, str, object]]:
    found: list[tuple[str, str, object]] = []

    def add(name: str, node: h5py.Group | h5py.Dataset) -> None:
        kept = {n: str(v) for n, v in node.attrs.items() if n not in VOLATILE_ATTRIBUTES}
        values = node[()] if isinstance(node, h5py.Dataset) else b""
        content = values.tobytes() if isinstance(values, np.ndarray) else bytes(values)
        if isinstance(values, np.ndarray) and values.dtype == object:
            content = repr(values.tolist()).encode()
        found.append((name, repr(kept), hashlib.sha256(content).hexdigest()))

    with h5py.File(path, "r") as file:
        file.visititems(add)
    return found


def killed_after(command: list[str], seconds: float, *, alone: bool) -> bool:
    """Begin a command and kill it; return false if it was done before."""
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env=_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as running:
        try:
            said = running.communicate(timeout=seconds)[1]
        except subprocess.TimeoutExpired:
            (os.kill if alone else os.killpg)(running.pid, signal.SIGKILL)
            running.wait()
            _await_workers(running.pid)
            return True
    if running.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {running.returncode}:\n{said}")
    return False


def _await_workers(session: int) -> None:
    """Wait until the killed command's workers have ended; fail if they stay."""
    until = time.perf_counter() + PATIENCE
    while time.perf_counter() < until:
        try:
            os.killpg(session, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.killpg(session, signal.SIGKILL)
    raise SystemExit(f"workers went on for {PATIENCE:.0f} s after their command was killed")


def one_case(case: Case, kills: int, rng: np.random.Generator, folder: Path) -> dict[str, object]:
    """Kill one command so often; return what came of it."""
    command = case.command(folder)
    _done(command, folder)
    shutil.rmtree(folder)  # the first one may have compiled
    folder.mkdir()
    took = _done(command, folder)
    wanted = contents(folder)
    shutil.rmtree(folder)
    folder.mkdir()
    hits, ends, differing = 0, 0, set[str]()
    while hits < kills or not ends:
        moment = rng.uniform(0.05, took) if hits < kills else 1e4
        if killed_after(command, float(moment), alone=hits % 2 == 1):
            hits += 1
            continue
        ends += 1
        found = contents(folder)
        names = wanted.keys() | found.keys()
        differing |= {name for name in names if wanted.get(name) != found.get(name)}
        shutil.rmtree(folder)
        folder.mkdir()
    return {"seconds": round(took, 1), "kills": hits, "ends": ends, "differing": sorted(differing)}


def main() -> int:
    """Kill every command; print a line each, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=25, help="of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="commands whose name contains this")
    parser.add_argument("--json", action="store_true", help="print nothing but the result")
    asked = parser.parse_args()
    rng, told = np.random.default_rng(asked.seed), dict[str, dict[str, object]]()
    with tempfile.TemporaryDirectory() as name:
        inputs = Path(name) / "inputs"
        inputs.mkdir()
        for case in cases(inputs):
            if asked.only and asked.only not in case.name:
                continue
            folder = Path(name) / "work"
            folder.mkdir(exist_ok=True)
            told[case.name] = one_case(case, asked.kills, rng, folder)
            shutil.rmtree(folder)
            if not asked.json:
                print(f"{case.name}: {told[case.name]}", flush=True)
    if asked.json:
        print(json.dumps(told, indent=2))
    return int(any(found["differing"] for found in told.values()))


if __name__ == "__main__":
    sys.exit(main())
