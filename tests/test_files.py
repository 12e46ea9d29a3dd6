"""What is read and written, and what is refused: pipes, devices, sizes, depth, a full disk."""

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdeg import cli
from bayesdeg.data.settings import parse_settings
from bayesdeg.data.study import read_study
from bayesdeg.errors import BayesdegError, ResumableError, StudyError
from bayesdeg.files import LIMIT, parse_json, read_bytes, too_deep, write_bytes, write_text, written
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.left_out import Guard
from bayesdeg.signals import SIGNALS
from bayesdeg.surrogate.trained import read_trained

TABLE = "specimen_id,degradation_pct,stretch,stress_MPa\na,0,1.2,0.1\na,0,1.4,0.2\n"


def study_with(folder, *, settings="", table=TABLE):
    (folder / "study.toml").write_text(settings)
    (folder / "tensile.csv").write_text(table)
    return folder


def faults_of(folder):
    with pytest.raises(StudyError) as caught:
        read_study(folder)
    return str(caught.value)


# ---- what is no regular file, or too large

SPECIAL = {
    "pipe": (os.mkfifo, "it is a named pipe, not a regular file"),
    "endless": (lambda path: path.symlink_to("/dev/zero"), "it is a device, not a regular file"),
    "folder": (Path.mkdir, "it is a folder, not a regular file"),
}


@pytest.mark.parametrize(("make", "why"), SPECIAL.values(), ids=SPECIAL)
def test_what_is_no_regular_file_is_never_opened(tmp_path, make, why):
    study_with(tmp_path)
    for name in ("tensile.csv", "study.toml"):
        (tmp_path / name).unlink()
        make(tmp_path / name)
    said = faults_of(tmp_path)
    assert said.count(why) == 2
    make(tmp_path / "emulator.npz")
    with pytest.raises(BayesdegError, match=why):
        read_trained(tmp_path / "emulator.npz")
    for name in ("run.json", "bands.csv", "posterior.nc"):
        make(tmp_path / name)
    folder = RunFolder(tmp_path)
    for read, name in (
        (folder.read_json, "run"),
        (folder.read_table, "bands"),
        (folder.read_posterior, "posterior"),
    ):
        with pytest.raises(BayesdegError, match=why):
            read(name)
    make(tmp_path / "base.npz")
    assert Checkpoints(tmp_path, "x").load("base") is None
    (tmp_path / "chain-base").mkdir()
    make(tmp_path / "chain-base" / "ensemble-0-000.npz")
    assert Checkpoints(tmp_path, "x").chain("base").load(0, 0, "key") is None


def test_a_file_that_is_too_large_is_refused_after_the_limit_which_can_be_raised(
    tmp_path, monkeypatch
):
    path = tmp_path / "tensile.csv"
    with path.open("wb") as file:
        file.truncate(209_000_000)
    study_with(tmp_path)
    with path.open("r+b") as file:
        file.truncate(209_000_000)
    said = faults_of(tmp_path)
    for part in ("209 MB", "20 MB", LIMIT):
        assert part in said
    small = tmp_path / "small"
    small.write_bytes(b"x" * 2000)
    with pytest.raises(OSError, match="above the limit"):
        read_bytes(small, most_mb=0.001)
    monkeypatch.setenv(LIMIT, "0.01")
    assert len(read_bytes(small, most_mb=0.001)) == 2000
    for wrong in ("much", "-1", "nan", "inf"):
        monkeypatch.setenv(LIMIT, wrong)
        with pytest.raises(BayesdegError, match="not a size"):
            read_bytes(small, most_mb=0.001)


# ---- depth and size of numbers

DEEP_TOML = {
    "lists": "a = " + 100_000 * "[" + 100_000 * "]",
    "lists that can be parsed": "a = " + 200 * "[" + 200 * "]",
    "a key of many parts": "a" + 50_000 * ".a" + " = 1",
    "a table of many parts": "[a" + 50_000 * ".a" + "]",
}


@pytest.mark.parametrize("text", DEEP_TOML.values(), ids=DEEP_TOML)
def test_a_deep_settings_file_is_one_fault(text):
    (fault,) = parse_settings(text.encode())[1]
    assert "nested too deeply" in str(fault)


@pytest.mark.parametrize("depth", [200, 200_000])
@pytest.mark.parametrize("ends", ["[]", ('{"a":', "}")])
def test_a_deep_document_of_a_run_is_refused(tmp_path, depth, ends):
    text = depth * ends[0] + "1" + depth * ends[1]
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(BayesdegError, match="nested too deeply"):
        RunFolder(tmp_path).read_run()


def test_what_is_not_deep_is_read():
    assert parse_json('{"a": [[1, 2]]}') == {"a": [[1, 2]]}
    assert not too_deep(parse_json(json.dumps({"a": [{"b": [1.0]}]})))


@pytest.mark.parametrize(
    "settings",
    [
        "seed = -1",
        "seed = 99999999999999999999999",
        f"seed = {5000 * '9'}",
        "[actuator]\nlength = 1e300",
        f"[actuator]\nlength = {400 * '9'}",
        "[actuator]\nlength = 3000",
        "[actuator]\nfloor = 1e-9",
        "[actuator]\nchambers = 10000",
        "[paper]\nthickness = 1e308",
        "[noise]\ndegradation_sd_pct = 1e300",
        '[priors]\nc1_at_0 = { law = "normal", mean = 1e300, sd = 1.0 }',
        f'[priors]\nc1_at_0 = {{ law = "normal", mean = {400 * "9"}, sd = 1.0 }}',
        '[tensile]\nfit_modes = ["planar"]',
    ],
)
def test_impossible_settings_are_one_short_line(tmp_path, settings):
    said = faults_of(study_with(tmp_path, settings=settings))
    assert len(said.splitlines()) == 1
    assert said.startswith("study.toml")
    assert len(said) < 500


@pytest.mark.parametrize(
    ("table", "why"),
    [
        (TABLE.replace("1.2,", "120,").replace("1.4,", "140,"), "1.5 = 150 %"),
        (TABLE.replace("0.1\n", "0\n").replace("0.2\n", "0.0\n"), "like all others"),
        (TABLE.replace("0.1\n", "1e308\n"), "too large"),
    ],
)
def test_impossible_readings_are_refused(tmp_path, table, why):
    assert why in faults_of(study_with(tmp_path, table=table))


def test_pressures_that_are_all_zero_are_refused(tmp_path):
    study_with(tmp_path)
    header = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n"
    (tmp_path / "actuator.csv").write_text(f"{header}a,0,0,0\nb,0,0.0,0.1\n")
    said = faults_of(tmp_path)
    assert "actuator.csv, row 2, column pressure_kPa" in said
    assert len(said.splitlines()) == 1


# ---- names that begin with #


def test_comments_that_look_like_rows_are_counted_and_names_in_quotes_are_read(tmp_path):
    header, *rows = TABLE.splitlines()
    hashed = [f"#{row}" for row in rows]
    notes = ["# a note, with commas, three, of them", "#", "# digitised, 2019"]
    study_with(tmp_path, table="\n".join([*notes, header, *rows, *hashed, *notes]))
    study = read_study(tmp_path)
    assert study.passed_over == {"tensile.csv": 2}
    assert len(study.tensile) == 2
    study_with(tmp_path, table="\n".join([header, *hashed]))
    assert "2 lines begin with #" in faults_of(tmp_path)
    quoted = [row.replace("a,", '"#a",') for row in rows]
    study = read_study(study_with(tmp_path, table="\n".join([header, *quoted])))
    assert set(study.tensile["specimen_id"]) == {"#a"}
    assert study.passed_over == {}


# ---- writing


def test_what_cannot_be_written_leaves_the_old_file_and_can_be_resumed(tmp_path):
    path = tmp_path / "run.json"
    write_text(path, "old")

    def fail():
        with written(path) as part:
            part.write_text("half")
            raise OSError(28, "No space left")

    with pytest.raises(ResumableError, match=r"\(No space left"):
        Guard(strict=False).attempt("bands.csv", fail)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("run.json", "old")]


def test_a_limit_on_the_size_of_files_stops_a_run_in_one_line(tmp_path):
    """As a full disk does: the system refuses in the midst of writing."""
    done = subprocess.run(
        [sys.executable, "-c", TOO_LARGE, str(tmp_path / "posterior.nc")],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    assert done.returncode == cli.STOPPED
    assert "File too large" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


TOO_LARGE = """
import sys
from pathlib import Path
from bayesdeg import cli
from bayesdeg.files import write_bytes
cli.app = lambda **_: write_bytes(Path(sys.argv[1]), bytes(5000))
cli.main()
"""


@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        (OSError(28, "No space left on device", "x"), cli.STOPPED, "no space left for x"),
        (OSError(36, "File name too long", 300 * "a"), cli.INPUT_FAULT, "too long"),
        (MemoryError(), cli.STOPPED, "not enough memory"),
        (OSError(5, "Input/output error"), cli.OUR_FAULT, "Input/output error"),
    ],
)
def test_what_the_system_refuses_ends_with_its_code(monkeypatch, capsys, fault, code, words):
    def refuse(**_options):
        raise fault

    monkeypatch.setattr(cli, "app", refuse)
    assert cli.exit_code() == code
    said = capsys.readouterr().err
    assert words in said
    assert ("Traceback" in said) == (code == cli.OUR_FAULT)


def test_a_reader_that_has_seen_enough_is_no_fault():
    with subprocess.Popen(
        [sys.executable, "-m", "bayesdeg", "causes"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as running:
        running.stdout.close()
        said = running.stderr.read()
    assert running.returncode == cli.DONE
    assert said == b""


# ---- signals

START = """
import builtins, os, signal, sys
real, number, when = builtins.__import__, int(sys.argv.pop(1)), sys.argv.pop(1)
if number != signal.SIGINT:  # under nohup closed terminals are ignored, and stay so
    signal.signal(number, signal.SIG_DFL)
def importing(name, *rest, **named):
    if name == when:
        builtins.__import__ = real
        os.kill(os.getpid(), number)
    return real(name, *rest, **named)
builtins.__import__ = importing
from bayesdeg.__main__ import main
main()
"""


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("when", ["typer", "rich.console", "bayesdeg.errors", "numpy", "pandas"])
def test_a_signal_ends_the_command_with_3_from_its_first_import_on(tmp_path, number, when):
    done = subprocess.run(
        [sys.executable, "-c", START, str(int(number)), when, "run", "nowhere"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
        timeout=60,
    )
    assert done.returncode == cli.STOPPED
    assert done.stderr.startswith("stopped")
    assert len(done.stderr.splitlines()) == 1


def test_a_closed_terminal_ends_a_command_with_3(tmp_path):
    """Nothing can be said there any more, not even that it stopped."""
    ours, theirs = os.openpty()
    command = [sys.executable, "-c", START, str(int(signal.SIGHUP)), "numpy", "check", "nowhere"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=theirs, stderr=theirs) as running:
        os.close(theirs)
        os.close(ours)
        assert running.wait(60) == cli.STOPPED


def test_a_signal_after_the_work_changes_nothing(monkeypatch):
    """What is done is done, also while modules say goodbye."""
    known = {number: signal.getsignal(number) for number in SIGNALS}
    monkeypatch.setattr(cli, "app", lambda **_: 0)
    try:
        cli.main()
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        for number, handler in known.items():
            signal.signal(number, handler)


def test_bytes_are_written_whole(tmp_path):
    write_bytes(tmp_path / "new" / "file", b"12")
    assert (tmp_path / "new" / "file").read_bytes() == b"12"
