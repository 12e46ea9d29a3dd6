"""Files changed at random, and what commands make of them.

    python -m tests.fuzz.fuzzing --seconds 3600

A command may refuse a file with one of its exit codes (2, or 3) and without writing anything, or
take it. A traceback, a crash of the interpreter, more than `SECONDS` of computing or more than
`MEGABYTES` of further memory is a failure, and the files that led to it are kept, by default in
`.cache/fuzz`. Those that were mended go to `tests/fuzz/corpus`, which `test_fuzz.py` tries again.

What reaches lines of the package that nothing before reached is kept for further changes, so the
search works its way past the first checks (as coverage-guided fuzzers do, here by
`sys.monitoring`).
"""

import argparse
import contextlib
import faulthandler
import functools
import hashlib
import io
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import bayesdeg
from bayesdeg.cli import exit_code
from tests.fuzz.mutations import spoilt
from tests.fuzz.subjects import SUBJECTS, Subject

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = str(Path(bayesdeg.__file__).parent)
CORPUS = Path(__file__).parent / "corpus"
FOUND = ROOT / ".cache" / "fuzz"
SECONDS = 10.0  # of the processor, for an answer or a refusal; refusals are wanted within 5
MEGABYTES = 1024.0
HUNG = 120.0  # s by the clock, after which the interpreter is ended
KEPT = 300  # inputs of a subject that are changed further
UNDER_WAY = "under way"  # a file that is left where the interpreter was ended: a hang, a crash
TOOL = 4  # of `sys.monitoring`: not one of those that are reserved

type Changes = Mapping[str, bytes]


class Coverage:
    """Which lines of the package have run; a line costs time the first time only."""

    def __init__(self) -> None:
        self.lines = 0
        monitoring = sys.monitoring
        monitoring.use_tool_id(TOOL, "fuzzing")
        monitoring.register_callback(TOOL, monitoring.events.LINE, self._line)
        monitoring.set_events(TOOL, monitoring.events.LINE)

    def _line(self, code: object, _line: int) -> object:
        self.lines += code.co_filename.startswith(PACKAGE)
        return sys.monitoring.DISABLE


@dataclass
class Pool:
    """Inputs of one subject that each reached something new."""

    subject: Subject
    folder: Path
    rng: np.random.Generator
    kept: list[Changes] = field(default_factory=lambda: [{}])

    def drawn(self) -> Changes:
        """Return an input that was kept, with one or two of its files changed further."""
        rng = self.rng
        changes = dict(self.kept[rng.integers(len(self.kept))])
        for name in rng.choice(self.subject.files, 1 + int(rng.random() < 0.2), replace=False):
            before = changes.get(name)
            content = (self.folder / name).read_bytes() if before is None else before
            changes[str(name)] = spoilt(str(name), content, rng)
        return changes

    def add(self, changes: Changes) -> None:
        """Keep an input; the oldest but the sound one goes where there are too many."""
        self.kept.append(changes)
        if len(self.kept) > KEPT:
            del self.kept[1]


def restore(folder: Path, sound: Path) -> None:
    """Make a folder what its sound copy is."""
    left, right = ({path.relative_to(top) for path in _files(top)} for top in (folder, sound))
    for name in left - right:
        (folder / name).unlink()
    changed = {n for n in right if n not in left or _state(folder / n) != _state(sound / n)}
    for name in changed:
        shutil.copy2(sound / name, folder / name)


def _files(top: Path) -> Iterator[Path]:
    return (path for path in top.rglob("*") if path.is_file())


def _state(path: Path) -> tuple[int, int]:
    return path.stat().st_size, path.stat().st_mtime_ns


def called(command: Iterable[str]) -> tuple[int, str]:
    """Run a command in this process; return its exit code and what it said of faults."""
    said, argv = io.StringIO(), sys.argv
    sys.argv = ["bayesdeg", *command]
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = exit_code()
    finally:
        sys.argv = argv
    return code, said.getvalue()


def memory() -> float:
    """Return the most memory that this process had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def fault_of(folder: Path, command: str, changes: Changes) -> str:
    """Put changed files into a sound folder; return what is wrong with a command's answer to them.

    An empty text where nothing is. The folder is sound again afterwards.
    """
    sound, made = folder.with_name(f"{folder.name} sound"), folder / "made"
    for name, content in changes.items():
        (folder / name).write_bytes(content)
    before, most, begun = {*_files(folder)}, memory(), time.process_time()
    states = {path: _state(path) for path in before}
    faulthandler.dump_traceback_later(HUNG, exit=True, file=sys.__stderr__)
    try:
        code, said = called(word.format(folder=folder, made=made) for word in command.split())
    finally:
        faulthandler.cancel_dump_traceback_later()
    took, more = time.process_time() - begun, memory() - most
    wrote = states != {path: _state(path) for path in _files(folder)}
    restore(folder, sound)
    if "Traceback" in said or code not in (0, 2, 3):
        return f"exit code {code}\n{said}"
    if code and wrote:
        return f"exit code {code}, but files were written or changed\n{said}"
    if code and not said.strip():
        return f"exit code {code} without a word"
    if took > SECONDS:
        return f"took {took:.1f} s"
    return f"took {more:.0f} MB" if more > MEGABYTES else ""


def keep(subject: str, changes: Changes, command: str, fault: str, found: Path) -> Path:
    """Write an input that led to a fault, the command and the fault; return the folder."""
    digest = hashlib.sha256(b"".join(changes[name] for name in sorted(changes))).hexdigest()[:12]
    folder = found / subject / digest
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in changes.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    (folder / "command.txt").write_text(f"{command}\n", encoding="utf-8")
    (folder / "fault.txt").write_text(fault, encoding="utf-8")
    return folder


def sound_folder(subject: Subject, top: Path) -> Path:
    """Make the sound folder of a subject, and call its commands once: they must be content."""
    folder = top / subject.name
    folder.mkdir(parents=True)
    subject.make(folder)
    shutil.copytree(folder, top / f"{subject.name} sound")
    for command in subject.commands:
        words = (word.format(folder=folder, made=folder / "made") for word in command.split())
        code, said = called(words)
        assert code == 0, f"{command} on what is sound: {said}"
        restore(folder, top / f"{subject.name} sound")
    return folder


@dataclass
class Search:
    """A search over subjects; faults go to a folder, and are told."""

    pools: list[Pool]
    found: Path
    say: Callable[[str], None]
    coverage: Coverage = field(default_factory=Coverage)
    told: dict[str, dict[str, int]] = field(default_factory=dict)
    seen: set[str] = field(default_factory=set)

    def once(self, pool: Pool) -> None:
        """Try one input of a subject."""
        one = self.told.setdefault(pool.subject.name, {"inputs": 0, "new": 0, "faults": 0})
        changes, before = pool.drawn(), self.coverage.lines
        command = str(pool.rng.choice(pool.subject.commands))
        fault = fault_of(pool.folder, command, changes)
        one["inputs"] += 1
        if fault:
            one["faults"] += 1
            if (last := fault.strip().splitlines()[-2:][0]) not in self.seen:
                self.seen.add(last)
                where = keep(pool.subject.name, changes, command, fault, self.found)
                self.say(f"{where}: {last}")
        elif self.coverage.lines > before:
            one["new"] += 1
            pool.add(changes)

    def for_seconds(self, seconds: float) -> None:
        """Search for so long; a subject has a second at a time, that slow ones are not all."""
        until = time.monotonic() + seconds
        for pool in itertools.cycle(self.pools):
            turn = time.monotonic() + 1.0
            while time.monotonic() < min(turn, until):
                self.once(pool)
            if time.monotonic() >= until:
                return

    def of_each(self, inputs: int) -> None:
        """Try so many inputs of each subject: the same ones for a seed, however fast it goes."""
        for pool in self.pools:
            for _ in range(inputs):
                self.once(pool)


def fuzz(
    subjects: Iterable[Subject],
    search: Callable[[Search], None],
    seed: int,
    found: Path,
    say: Callable[[str], None],
) -> dict[str, dict[str, int]]:
    """Search; return by subject how many inputs, further ones and faults there were."""
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        mark = Path(name).parent / UNDER_WAY
        mark.touch()
        pools = [
            Pool(one, sound_folder(one, Path(name)), np.random.default_rng([seed, number]))
            for number, one in enumerate(subjects)
        ]
        searched = Search(pools, found, say)
        search(searched)
        mark.unlink()
    return searched.told


def supervised(arguments: list[str]) -> int:
    """Run the search in a process of its own, whose crash is a failure that leaves its input."""
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, "-m", "tests.fuzz.fuzzing", "--inner", *arguments]
        # threads of linear algebra cost more than they give on matrices as small as these
        own = {"TMPDIR": name, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(command, cwd=ROOT, env={**os.environ, **own}, check=False)
        if not (Path(name) / UNDER_WAY).exists():
            return done.returncode
        left = FOUND / "crash"
        shutil.rmtree(left, ignore_errors=True)
        shutil.copytree(name, left)  # the folders as they were, with the files that led to it
        print(f"the interpreter ended with {done.returncode}; its folders are in {left}")
    return 1


def main() -> int:
    """Search for so many seconds; print what was tried, and exit with 1 if there were faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--inputs", type=int, help="of each subject, in place of --seconds")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="by default the time")
    parser.add_argument("--only", nargs="*", default=[], help="names of subjects")
    parser.add_argument("--found", type=Path, default=FOUND, help="where faults go")
    parser.add_argument("--inner", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if not asked.inner:
        return supervised([*sys.argv[1:], "--seed", str(asked.seed)])
    chosen = [one for one in SUBJECTS if not asked.only or one.name in asked.only]
    search = functools.partial(Search.for_seconds, seconds=asked.seconds)
    if asked.inputs:
        search = functools.partial(Search.of_each, inputs=asked.inputs)
    say = functools.partial(print, flush=True)
    told = fuzz(chosen, search, asked.seed, asked.found, say)
    print(json.dumps({"seed": asked.seed, **told}, indent=1))
    return int(any(one["faults"] for one in told.values()))


if __name__ == "__main__":
    sys.exit(main())
