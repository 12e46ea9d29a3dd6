"""Sampling that is killed and goes on: the same chain, bit by bit, whatever was lost."""

import os
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.analysis.calibrate import Pace, calibrate, steps_left
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.sampling import Effort, SamplerStatus, sample
from bayesdeg.pages.checkpoints import Checkpoints
from tests.inference.test_ensemble import GaussianModel

EFFORT = Effort(effective=1e9, r_hat=1.0, chunk=5, longest=35, ensembles=2)
PIECES = sum(len(looks) for looks in EFFORT.periods(settled=True))  # of each ensemble


class KilledError(Exception):
    pass


@cache
def begun():
    generator, model = np.random.default_rng(0), GaussianModel()
    return evidence(model, approximate(model, generator), generator, draws=400)


def run(store=None, on_chunk=None):
    return sample(
        GaussianModel(),
        begun(),
        effort=EFFORT,
        seed=np.random.SeedSequence(4),
        store=store,
        on_chunk=on_chunk,
    )


@cache
def whole():
    return run()


def assert_same(chain):
    np.testing.assert_array_equal(chain.vectors, whole().vectors)
    np.testing.assert_array_equal(chain.log_prob, whole().log_prob)
    np.testing.assert_array_equal(chain.acceptance, whole().acceptance)
    assert chain.refusals == whole().refusals


def pieces(folder):
    return sorted((folder / "chain-base").glob("*.npz"))


def stored(tmp_path, fingerprint="this study"):
    return Checkpoints(tmp_path, fingerprint).chain("base")


def test_keeping_the_pieces_changes_nothing_and_each_is_a_file(tmp_path):
    assert_same(run(stored(tmp_path)))
    assert len(pieces(tmp_path)) == 2 * PIECES
    with np.load(pieces(tmp_path)[0]) as file:
        assert {"chain", "log_prob", "acceptance", "refusals", "random_keys"} <= set(file)
        assert file["chain"].shape == (5, 40, 3)


@pytest.mark.parametrize("after", range(2 * PIECES))
def test_killed_after_any_piece_it_ends_with_the_same_chain(tmp_path, after):
    store, saved = stored(tmp_path), []

    class Mortal:
        load = staticmethod(store.load)

        @staticmethod
        def save(*args):
            if len(saved) == after:
                raise KilledError
            store.save(*args)
            saved.append(args)

    with pytest.raises(KilledError):
        run(Mortal())
    assert len(pieces(tmp_path)) == after
    again = stored(tmp_path)
    assert_same(run(again))
    assert not again.damaged


def test_a_finished_chain_is_read_and_not_computed(tmp_path):
    run(stored(tmp_path))
    told, before = [], {path: path.stat().st_mtime_ns for path in pieces(tmp_path)}
    assert_same(run(stored(tmp_path), told.append))
    assert {path: path.stat().st_mtime_ns for path in pieces(tmp_path)} == before
    assert [state.resumed for state in told] == [state.steps for state in told]


def spoil(path, how):
    content = bytearray(path.read_bytes())
    if how == "cut":
        content = content[: len(content) // 2]
    elif how == "empty":
        content = bytearray()
    elif how == "no such file":
        content = bytearray(b"chain\n1 2 3\n")
    elif how == "one array":
        np.save(path.with_suffix(".npy"), np.zeros(3))
        content = bytearray(path.with_suffix(".npy").read_bytes())
        path.with_suffix(".npy").unlink()
    else:  # one bit of one draw
        with np.load(path) as file:
            where = bytes(content).index(file["chain"].tobytes())
        content[where + 100] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("how", ["cut", "empty", "no such file", "one array", "one bit"])
@pytest.mark.parametrize("which", [0, 3, 2 * PIECES - 1])
def test_a_damaged_piece_is_named_and_computed_again(tmp_path, how, which):
    run(stored(tmp_path))
    path = pieces(tmp_path)[which]
    good = path.read_bytes()
    spoil(path, how)
    store = stored(tmp_path)
    assert_same(run(store))
    assert store.damaged == [path]
    with np.load(path) as file:
        assert file["chain"].tobytes() in good


def test_pieces_of_other_inputs_are_not_taken(tmp_path):
    run(stored(tmp_path))
    store, told = stored(tmp_path, "another study"), []
    assert_same(run(store, told.append))
    assert told[-1].resumed == 0
    assert not store.damaged


def test_pieces_of_another_seed_are_not_taken(tmp_path):
    sample(
        GaussianModel(),
        begun(),
        effort=EFFORT,
        seed=np.random.SeedSequence(5),
        store=stored(tmp_path),
    )
    assert_same(run(stored(tmp_path)))


def test_forgetting_leaves_no_piece_and_no_part(tmp_path):
    run(stored(tmp_path))
    (tmp_path / "chain-base" / ".ensemble-0-000.npz.1.part").write_bytes(b"half")
    Checkpoints(tmp_path, "this study").clear()
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


PROGRAM = """
import sys
from pathlib import Path
from tests.run.test_resumed_sampling import run, stored
from bayesdeg.inference.sampling import digest
if __name__ == "__main__":
    chain = run(stored(Path(sys.argv[1])))
    print(digest({"chain": chain.vectors, "log_prob": chain.log_prob}))
"""


SLOWLY = """
import sys, time
from pathlib import Path
from tests.run.test_resumed_sampling import run, stored
run(stored(Path(sys.argv[1])), lambda standing: time.sleep(0.04))
"""
ROOT = Path(__file__).parents[2]


def digest_of(tmp_path, threads):
    environment = os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


class Heard:
    def __init__(self):
        self.notes, self.steps = [], 0.0

    def stage(self, name, total=None):
        self.notes.append(name)

    def advance(self, steps=1.0, note=""):
        self.steps += steps
        self.notes.append(note)


def calibrated(tmp_path, effort):
    heard = Heard()
    fit = calibrate(
        GaussianModel(),
        "base",
        effort=effort,
        seed=np.random.SeedSequence(6),
        checkpoints=Checkpoints(tmp_path, "this study"),
        progress=heard,
    )
    return fit, heard


def test_a_calibration_says_how_far_it_is_and_what_it_found_damaged(tmp_path):
    effort = Effort(effective=3000.0, r_hat=1.01, chunk=20, longest=2000)
    fit, heard = calibrated(tmp_path, effort)
    assert any(note.endswith("20 steps") for note in heard.notes)
    smallest = f"{min(fit.diagnosis.ess_bulk):.0f} effective draws"
    assert heard.notes[-1].startswith(smallest)
    assert f"R-hat {max(fit.diagnosis.r_hat):.3f}" in heard.notes[-1]
    assert any(" left" in note for note in heard.notes)
    assert heard.steps == pytest.approx(100.0)
    path = pieces(tmp_path)[2]
    spoil(path, "one bit")
    again, heard = calibrated(tmp_path, effort)
    assert "damaged" in heard.notes[-1]
    assert path.name in heard.notes[-1]
    np.testing.assert_array_equal(again.chain.vectors, fit.chain.vectors)
    third, heard = calibrated(tmp_path, effort)
    assert "interrupted run" in heard.notes[-1]
    assert third.diagnosis == fit.diagnosis
    np.testing.assert_array_equal(third.evidence.draws, fit.evidence.draws)
    np.testing.assert_array_equal(third.laplace.covariance, fit.laplace.covariance)


@pytest.mark.long
@pytest.mark.slow
def test_killed_in_the_midst_again_and_again_it_ends_with_the_same_chain(tmp_path):
    generator, before = np.random.default_rng(7), 0
    killed = 0
    while killed < 4:
        process = subprocess.Popen([sys.executable, "-c", SLOWLY, str(tmp_path)], cwd=ROOT)
        while process.poll() is None and len(pieces(tmp_path)) == before:
            time.sleep(1e-3)
        time.sleep(generator.uniform(0.0, 0.05))
        process.kill()
        if process.wait() == 0:
            break
        killed, before = killed + 1, len(pieces(tmp_path))
    assert killed > 1
    store, told = stored(tmp_path), []
    assert_same(run(store, told.append))
    assert told[-1].resumed > 0
    assert not store.damaged


@pytest.mark.long
@pytest.mark.slow
def test_one_thread_and_two_give_the_same_chain(tmp_path):
    assert digest_of(tmp_path / "one", "1") == digest_of(tmp_path / "two", "2")


def test_time_left_is_unknown_while_moves_are_fitted_and_never_beyond_the_limit():
    effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
    assert np.isnan(steps_left(SamplerStatus(50), effort))
    assert np.isnan(Pace().left(SamplerStatus(50), effort))
    hopeless = SamplerStatus(250, kept=100, effective=5.0, r_hat=2.0, times=0.1)
    assert steps_left(hopeless, effort) == 750
    # nothing was computed: how long a step takes is not known
    assert np.isnan(Pace().left(SamplerStatus(250, 100, 300.0, 1.02, 5.0, resumed=250), effort))
