import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bayesdeg import cli
from bayesdeg.pages.folder import RunFolder

STUDIES = Path(__file__).parents[2] / "studies"


def process(*arguments, cwd):
    """Run a command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "bayesdeg.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=600,
        check=False,
    )


@pytest.fixture
def rubber(tmp_path):
    """Treloar's uniaxial curve."""
    folder = tmp_path / "rubber"
    shutil.copytree(STUDIES / "treloar_uniaxial", folder)
    return folder


def test_check_lists_every_fault_and_ends_with_2(rubber, bayesdeg):
    table = (rubber / "tensile.csv").read_text(encoding="utf-8")
    (rubber / "tensile.csv").write_text(
        table.replace("uniaxial,1.125,0.1344", "uniaxial,-1.125,0.1344"), encoding="utf-8"
    )
    settings = (rubber / "study.toml").read_text(encoding="utf-8")
    (rubber / "study.toml").write_text(settings.replace("seed =", "sead ="), encoding="utf-8")
    code, printed, said = bayesdeg("check", rubber)
    assert (code, printed) == (2, "")
    assert "Traceback" not in said
    lines = said.strip().splitlines()
    assert len(lines) == 2
    place = ("tensile.csv", "row 5", "column stretch", "value '-1.125'")
    assert any(all(part in line for part in place) for line in lines)
    assert any("sead" in line and "seed" in line for line in lines)


def test_a_sound_study_passes_the_check(rubber):
    done = process("check", rubber, cwd=rubber.parent)
    assert done.returncode == 0
    assert "without actuator.csv" in done.stdout
    assert "no faults" not in done.stderr


def test_simulate_suggests_the_nearest_cause(rubber, bayesdeg):
    asked = ("simulate", rubber, "--cause", "presure_offset=3", "--out", rubber.parent / "out")
    code, _, said = bayesdeg(*asked)
    assert code == 2
    assert "pressure_offset" in said


def test_causes_shows_units_and_priors(bayesdeg):
    code, printed, _ = bayesdeg("causes")
    assert code == 0
    for word in ("pressure_offset", "kPa", "Normal", "revealed by"):
        assert word in printed


def test_an_unknown_prior_is_named(rubber, bayesdeg, monkeypatch):
    settings = (rubber / "study.toml").read_text(encoding="utf-8")
    wrong = settings.replace('"c1_at_0"', '"c1_at_9"')
    (rubber / "study.toml").write_text(wrong, encoding="utf-8")
    monkeypatch.chdir(rubber.parent)
    code, _, said = bayesdeg("run", rubber)
    assert code == 2
    assert "c1_at_9" in said
    assert "c1_at_0" in said


def draws_of(folder):
    return RunFolder(folder).read_posterior("posterior")["posterior"].to_dataset()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A run in one process, with the study beside it; what it said, and its draws."""
    study = tmp_path_factory.mktemp("undisturbed") / "rubber"
    shutil.copytree(STUDIES / "treloar_uniaxial", study)
    asked = ("run", study, "--effort", "quick", "--workers", 1, "--quiet", "--json")
    done = process(*asked, cwd=study.parent)
    assert done.returncode == 0, done.stderr
    target = study.parent / "reports" / "rubber"
    return study, done, target, draws_of(target)


@pytest.mark.slow
def test_run_writes_the_folder_prints_json_and_resumes(undisturbed):
    study, first, target, draws = undisturbed
    assert first.stderr == ""
    assert json.loads(first.stdout)["outcome"] == "ambiguous"
    for name in ("index.html", "verdict.json", "posterior.nc", "posterior_base.nc", "run.json"):
        assert (target / name).exists()
    again = process("run", study, "--effort", "quick", cwd=study.parent)
    assert "interrupted run" in again.stderr
    assert draws.equals(draws_of(target))
    (target / "index.html").unlink()
    assert process("report", target, cwd=study.parent).returncode == 0
    assert (target / "index.html").exists()


@pytest.mark.long
@pytest.mark.slow
def test_workers_do_not_change_the_result(undisturbed, tmp_path):
    study, _, target, draws = undisturbed
    asked = ("run", study, "--effort", "quick", "--workers", 3, "--out", tmp_path / "out")
    done = process(*asked, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert draws.equals(draws_of(tmp_path / "out"))
    verdicts = [RunFolder(path).read_json("verdict") for path in (target, tmp_path / "out")]
    assert verdicts[0] == verdicts[1]


PATIENCE = 60.0  # s; on a busy machine the interpreter alone takes seconds to begin


def await_answer(process):
    """Wait until the command answers signals: before, it is Python's own to end."""
    status, bit = Path(f"/proc/{process.pid}/status"), 1 << (signal.SIGTERM - 1)
    end = time.monotonic() + PATIENCE
    while status.exists() and time.monotonic() < end:
        caught = re.search(r"SigCgt:\s*(\w+)", status.read_text(encoding="utf-8"))
        if caught is not None and int(caught[1], 16) & bit:
            return
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.8, 5.0])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_ends_with_3_and_one_line(rubber, number, seconds):
    """Ctrl-C goes to the workers too, which say nothing."""
    with subprocess.Popen(
        [sys.executable, "-m", "bayesdeg", "run", str(rubber), "--workers", "2", "--quiet"],
        cwd=rubber.parent,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as running:
        await_answer(running)
        time.sleep(seconds)
        os.killpg(running.pid, number)
        said = running.communicate(timeout=60)[1]
    assert running.returncode == 3
    assert len(said.splitlines()) == 1
    assert said.startswith("stopped")
    assert not list((rubber.parent / "reports").rglob(".lock"))


def test_a_fault_after_a_request_to_end_is_that_request(monkeypatch, capsys):
    """A pool whose workers heard the signal too, or a cut import, may raise what it likes."""

    def command(**_):
        with contextlib.suppress(KeyboardInterrupt):
            cli._stop(signal.SIGINT, None)
        raise SystemError("returned NULL without setting an exception")

    monkeypatch.setattr(cli, "app", command)
    monkeypatch.setattr(cli, "_requests", [])
    assert cli.exit_code() == 3
    assert capsys.readouterr().err.startswith("stopped")


@pytest.mark.slow
def test_a_killed_run_leaves_nothing_broken_and_goes_on(rubber, undisturbed):
    command = [sys.executable, "-m", "bayesdeg.cli", "run", str(rubber), "--effort", "quick"]
    for seconds in (2.0, 5.0):
        with subprocess.Popen(command, cwd=rubber.parent, stderr=subprocess.DEVNULL) as running:
            time.sleep(seconds)
            running.send_signal(signal.SIGKILL)
    done = process("run", rubber, "--effort", "quick", cwd=rubber.parent)
    assert done.returncode == 0, done.stderr
    assert not list((rubber.parent / "reports").rglob("*.part"))
    assert undisturbed[3].equals(draws_of(rubber.parent / "reports" / "rubber"))
