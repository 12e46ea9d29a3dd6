"""Files changed at random end in an answer or in one clear refusal, and so do those that failed."""

import json
import subprocess
import sys

import pytest

from tests.fuzz.fuzzing import CORPUS, ROOT, fault_of, sound_folder
from tests.fuzz.subjects import SUBJECTS

# the same ones each time: a search that is worth its name takes an hour, with another seed each
# time (`python -m tests.fuzz.fuzzing --seconds 3600`)
INPUTS, CHANCE = 12, 1
BY_NAME = {subject.name: subject for subject in SUBJECTS}
KEPT = sorted(path.parent for path in CORPUS.glob("*/*/command.txt"))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    top = tmp_path_factory.mktemp("fuzz")
    made = {}

    def folder(name):
        if name not in made:
            made[name] = sound_folder(BY_NAME[name], top)
        return made[name]

    return folder


@pytest.mark.parametrize("kept", KEPT, ids=lambda path: f"{path.parent.name} {path.name}")
def test_what_once_failed_is_answered_or_refused(kept, folders):
    names = [path for path in kept.rglob("*") if path.is_file() and path.name != "command.txt"]
    changes = {str(path.relative_to(kept)): path.read_bytes() for path in names}
    command = (kept / "command.txt").read_text(encoding="utf-8").strip()
    assert not fault_of(folders(kept.parent.name), command, changes)


@pytest.mark.long
@pytest.mark.slow
def test_a_short_search_finds_no_fault(tmp_path):
    words = ("--inputs", str(INPUTS), "--seed", str(CHANCE), "--found", str(tmp_path / "found"))
    command = [sys.executable, "-m", "tests.fuzz.fuzzing", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    faults = [path.read_text() for path in (tmp_path / "found").rglob("fault.txt")]
    assert done.returncode == 0, "\n".join([done.stdout, done.stderr, *faults])
    told = json.loads(done.stdout[done.stdout.index("{") :])
    assert set(told) - {"seed"} == set(BY_NAME)
    assert all(told[name]["inputs"] == INPUTS for name in BY_NAME)
