"""Training that goes on where the posterior lies, killed at random moments: the bits stay."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdeg import training
from bayesdeg.analysis.region import FIRST
from bayesdeg.surrogate.kept import COARSE_RUNS, FINE_RUNS

ROOT = Path(__file__).resolve().parents[2]
KILLS = 8  # for more: `python -m tests.commands.adaptive_training FOLDER 24 SEED`


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_training_in_rounds_killed_at_random_moments_ends_with_the_same_bits(tmp_path):
    module = "tests.commands.adaptive_training"
    command = [sys.executable, "-m", module, str(tmp_path), str(KILLS), "20"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert set(told["exits"]) == {0}
    assert told["kills"] == KILLS
    # the kills hit training at work, and what it had done was never lost
    assert all(progress == sorted(progress) for progress in told["progress"])
    trained = COARSE_RUNS + FINE_RUNS
    trained += training.ROUNDS * (training.MORE_COARSE + training.MORE_FINE)
    # all curves of all rounds, those by which it is refined, and one emulator; where the posterior
    # of so rough an emulator goes depends on last digits, and what lies outside the range is put
    # on its ends, where draws of one load are one curve
    (files,) = set(told["files"])
    assert trained + 1 < files <= trained + 1 + FIRST
    assert told["same"]
