"""A command whose machine is suspended, or whose worker is killed from outside."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool

import pytest

from bayesdeg import cli
from bayesdeg.pages.folder import RunFolder
from tests.run.study_files import study_in


def run(folder, out):
    return subprocess.Popen(
        [sys.executable, "-m", "bayesdeg", "run", folder, "--effort", "quick", "--out", out],
        cwd=folder.parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.mark.long
@pytest.mark.slow
def test_a_suspended_run_goes_on_and_ends_with_the_same_draws(tmp_path):
    films = tmp_path / "films"
    films.mkdir()
    study_in(films, without=("actuator.csv", "summary.csv"))
    draws = []
    for suspended in (False, True):
        out = tmp_path / f"out {suspended}"
        with run(films, out) as running:
            for pause in (4.0, 1.0) if suspended else ():
                time.sleep(pause)
                os.killpg(running.pid, signal.SIGSTOP)
                time.sleep(1.5)
                os.killpg(running.pid, signal.SIGCONT)
            said = running.communicate()[1]
        assert running.returncode == 0, said
        draws.append(RunFolder(out).read_posterior("posterior")["posterior"].to_dataset())
    assert draws[0].equals(draws[1])


def test_a_worker_that_was_killed_from_outside_is_one_line(monkeypatch, capsys):
    def command(**_):
        raise BrokenProcessPool("A process in the process pool was terminated abruptly")

    monkeypatch.setattr(cli, "app", command)
    assert cli.exit_code() == cli.STOPPED
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert "worker" in said
