"""The store of solutions: plain files, whole or absent, named by content, damage noticed."""

import errno
import json
import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.campaign import complete
from bayesdeg.surrogate.solutions import Kind, SolutionStore, encode
from tests.surrogate.small_runs import assert_same, made_up, runs


def wanted(kind=Kind.CURVE, curve=0):
    return runs(3, kind=kind)[curve]


@pytest.fixture
def store(tmp_path):
    return SolutionStore(tmp_path / "store")


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("points", [None, 0, 2])
def test_what_is_put_is_got_bit_by_bit(store, kind, points):
    run = wanted(kind)
    status = Status.CONVERGED if points is None else Status.LIMIT_POINT
    solution = made_up(run, status=status, points=points)
    assert store.get(run) is None
    assert store.put(run, solution, seconds=1.5)
    assert_same(store.get(run), solution)
    assert store.get(wanted(kind, curve=1)) is None


@pytest.mark.parametrize("kind", Kind)
def test_a_file_says_what_it_is_without_this_package_and_without_pickle(store, kind):
    run = wanted(kind)
    store.put(run, made_up(run))
    (path,) = store.folder.glob("*.npz")
    with np.load(path, allow_pickle=False) as arrays:
        record = json.loads(str(arrays["record"]))
        assert arrays["readings"].shape == (14, len(OUTPUTS))
    assert path.stem == run.key()
    assert record["status"] == "CONVERGED"
    assert record["run"] == run.parameters()
    assert record["run"]["curve"]["loads"] == list(run.curve.loads)
    assert record["run"]["geometry"]["dimensions"]["length"] == 14.0


def test_bytes_depend_on_the_solution_alone(store, monkeypatch, tmp_path):
    run, solution = wanted(), made_up(wanted())
    store.put(run, solution, seconds=1.0)
    monkeypatch.setattr(time, "time", lambda: 2e9)
    again = SolutionStore(tmp_path / "another")
    again.put(run, solution, seconds=99.0, timeout=50.0)
    first, second = (next(s.folder.glob("*.npz")).read_bytes() for s in (store, again))
    assert first == second
    assert store.seconds() == {run.key(): 1.0}
    assert again.seconds() == {run.key(): 99.0}


def test_what_stands_there_is_not_written_again(store):
    run = wanted()
    assert store.put(run, made_up(run, seed=1))
    assert not store.put(run, made_up(run, seed=2))
    assert_same(store.get(run), made_up(run, seed=1))


def test_a_run_that_timed_out_gives_way_to_a_better_one_and_to_no_worse(store):
    run = wanted()
    late = made_up(run, status=Status.TIMED_OUT, points=3)
    assert store.put(run, late, timeout=10.0)
    assert store.get(run, timeout=10.0) is not None
    assert store.get(run, timeout=11.0) is None
    assert not store.put(run, late, timeout=5.0)
    assert store.put(run, late, timeout=20.0)
    assert store.get(run, timeout=11.0) is not None
    assert store.put(run, made_up(run))
    assert not store.put(run, late, timeout=40.0)
    assert_same(store.get(run, timeout=np.inf), made_up(run))


def test_failures_are_listed_with_their_runs(store):
    endings = {0: Status.EFFORT_EXHAUSTED, 1: Status.TIMED_OUT, 2: Status.LIMIT_POINT}
    for curve, status in endings.items():
        run = wanted(curve=curve)
        store.put(run, made_up(run, status=status, points=2), timeout=3.0)
    assert {(f.run, f.status) for f in store.failures()} == {
        (wanted(curve=curve), endings[curve]) for curve in (0, 1)
    }


def test_listing_passes_over_what_is_not_its_own(store):
    store.put(wanted(), made_up(wanted(), status=Status.TIMED_OUT), seconds=1.0)
    (store.folder / "notes.npz").write_bytes(b"mine")
    (store.folder / "broken.seconds").write_text("1.2.3")
    assert len(store.failures()) == 1
    assert list(store.seconds()) == [wanted().key()]


# ---- damage


def spoiled(content):
    half, other = len(content) // 2, made_up(wanted(), points=15)
    yield "empty", b""
    yield "garbage", b"not an archive"
    yield "truncated", content[:half]
    yield "end missing", content[:-1]
    yield "array missing", content.replace(b"limit_load", b"limit_lead")
    yield "wrong magic", b"\x93NUMPY" + content[6:]
    yield "zeros in the middle", content[:half] + bytes(512) + content[half + 512 :]
    yield "another run", encode(wanted(curve=1), made_up(wanted(curve=1)))
    yield "another kind", encode(wanted(Kind.SAMPLES), made_up(wanted(Kind.SAMPLES)))
    yield "too many loads", encode(wanted(), other)
    at = content.find(made_up(wanted()).readings.tobytes())
    flipped = bytearray(content)
    flipped[at + 3] ^= 1
    assert at > 0
    yield "flipped bit", bytes(flipped)


DAMAGE = dict(spoiled(encode(wanted(), made_up(wanted()))))


@pytest.mark.parametrize("kind_of_damage", DAMAGE)
def test_a_damaged_file_is_named_and_replaced(store, kind_of_damage):
    run, solution = wanted(), made_up(wanted())
    store.put(run, solution)
    (path,) = store.folder.glob("*.npz")
    sound = path.read_bytes()
    path.write_bytes(DAMAGE[kind_of_damage])
    with pytest.warns(UserWarning, match=f"{run.key()}.npz is damaged"):
        assert store.get(run) is None
    assert store.failures() == []
    assert store.put(run, solution)
    assert path.read_bytes() == sound


def test_any_changed_byte_is_noticed_or_of_no_consequence(store):
    run, solution = wanted(), made_up(wanted())
    store.put(run, solution)
    (path,) = store.folder.glob("*.npz")
    sound = path.read_bytes()
    rng = np.random.default_rng(4)
    noticed = 0
    for at in rng.integers(len(sound), size=400):
        changed = bytearray(sound)
        changed[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(changed))
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = store.get(run)
        if found is None:
            noticed += 1
            assert any(run.key() in str(w.message) for w in told)
        else:
            assert_same(found, solution)
    assert noticed > 300


# ---- disk


def test_a_write_that_is_cut_short_leaves_nothing_behind(store, monkeypatch):
    run = wanted()
    store.put(run, made_up(run), seconds=1.0)
    before = {path: path.read_bytes() for path in store.folder.iterdir()}

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(BayesdegError, match="No space left") as raised:
            store.put(wanted(curve=1), made_up(wanted(curve=1)), seconds=2.0)
    assert str(store.folder) in str(raised.value)
    assert {path: path.read_bytes() for path in store.folder.iterdir()} == before
    assert store.put(wanted(curve=1), made_up(wanted(curve=1)))


WRITE_UNTIL_FULL = """
import resource, signal, sys
from pathlib import Path
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.errors import BayesdegError
from tests.surrogate.small_runs import made_up, runs

first, second = runs(2)

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
store = SolutionStore(Path(sys.argv[1]))
store.put(first, made_up(first))
resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))  # a solution has some 8 kB
try:
    store.put(second, made_up(second), seconds=1.0)
except BayesdegError as fault:
    print(fault)
"""


def test_a_limit_of_the_system_in_mid_file_leaves_no_part_of_it(tmp_path):
    command = [sys.executable, "-c", WRITE_UNTIL_FULL, str(tmp_path)]
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    assert str(tmp_path) in done.stdout
    assert "File too large" in done.stdout
    assert [path.stem for path in tmp_path.glob("*.npz")] == [wanted(curve=0).key()]
    assert not list(tmp_path.glob("*.part"))
    assert_same(SolutionStore(tmp_path).get(wanted(curve=0)), made_up(wanted(curve=0)))


def test_a_folder_that_cannot_be_is_a_clear_error(tmp_path):
    file = tmp_path / "a file"
    file.write_text("in the way")
    for store in (SolutionStore(file), SolutionStore(file / "below")):
        with pytest.raises(BayesdegError, match="a file"):
            store.put(wanted(), made_up(wanted()))


def test_parts_of_files_are_ignored_and_old_ones_removed(store):
    run = wanted()
    store.put(run, made_up(run))
    young, old = store.folder / ".young-1.part", store.folder / ".old-1.part"
    for path in (young, old):
        path.write_bytes(b"half a fi")
    os.utime(old, (time.time() - 7200.0,) * 2)
    (found,) = complete([run], store)
    assert_same(found, made_up(run))
    assert young.exists()
    assert not old.exists()
    assert store.failures() == []
