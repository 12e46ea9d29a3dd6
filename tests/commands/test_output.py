"""Where commands write: what is refused before the work, and what is locked."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from bayesdeg import cli
from bayesdeg.commands import run as command
from bayesdeg.commands import simulate as simulating
from bayesdeg.data.study import read_study
from bayesdeg.errors import BayesdegError
from bayesdeg.laboratory.writing import VIRTUAL_FILES
from bayesdeg.pages import output
from bayesdeg.pages.output import claimed, is_virtual, output_file, run_folder, virtual_study

STUDIES = Path(__file__).parents[2] / "studies"


class BegunError(Exception):
    """The work has begun."""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a study; the work itself only says that it began."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(STUDIES / "treloar_uniaxial", tmp_path / "rubber")

    def begin(*_args, **_options):
        raise BegunError

    monkeypatch.setattr(command, "run_study", begin)
    monkeypatch.setattr(simulating, "run_experiment", begin)
    return tmp_path


@pytest.fixture
def call(bayesdeg):
    """Run a command in this process; gives its exit code and what it said."""
    return lambda *arguments: bayesdeg(*arguments, "--workers", 1)[::2]


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(said):
    """One line, no traceback."""
    assert "Traceback" not in said
    assert len(said.strip().splitlines()) == 1
    return said


@pytest.mark.parametrize("out", ["rubber", "rubber/out", "rubber/../rubber", "rubber/a/b", "link"])
@pytest.mark.parametrize("name", ["run", "simulate"])
def test_nothing_is_written_into_a_study(here, call, name, out):
    (here / "link").symlink_to(here / "rubber")
    before = contents(here / "rubber")
    code, said = call(name, "rubber", "--out", out)
    assert code == cli.INPUT_FAULT
    assert "--out" in refused(said)
    assert contents(here / "rubber") == before


def test_another_study_is_no_place_either(here, call):
    shutil.copytree(here / "rubber", here / "other")
    code, said = call("run", "rubber", "--out", "other")
    assert code == cli.INPUT_FAULT
    assert "is the study" in refused(said)


def test_files_that_no_run_wrote_are_not_overwritten(here, call):
    (here / "data").mkdir()
    (here / "data" / "tensile.csv").write_text("mine")
    code, said = call("run", "rubber", "--out", "data")
    assert code == cli.INPUT_FAULT
    assert "holds tensile.csv" in refused(said)
    assert contents(here / "data") == {Path("tensile.csv"): b"mine"}


def test_studies_of_one_name_do_not_share_a_folder(here, call):
    (here / "a").mkdir()
    shutil.copytree(here / "rubber", here / "a" / "rubber")
    with (here / "a" / "rubber" / "study.toml").open("a") as settings:
        settings.write("\n[sampling]\neffort = 'quick'\n")
    call("run", "rubber")
    assert (here / "reports" / "rubber" / output.OWNER).exists()
    code, said = call("run", "a/rubber")
    assert code == cli.INPUT_FAULT
    assert "different study, ../../rubber," in refused(said)
    assert "a/rubber" in refused(said)
    # the study's own run goes on, with other data too, and so does one that was moved
    with (here / "rubber" / "study.toml").open("a") as settings:
        settings.write("\n# edited\n")
    assert call("run", "rubber")[0] == cli.OUR_FAULT  # begun
    shutil.move(here / "rubber", here / "moved")
    study = replace(read_study(here / "moved"), name="rubber")
    with run_folder(here / "reports" / "rubber", study) as folder:
        assert folder.path.is_dir()


def test_a_published_run_of_an_earlier_version_is_known_by_its_name(here):
    published = here / "published"
    published.mkdir()
    study = read_study(here / "rubber")
    for name in ("rubber", "another"):
        (published / "run.json").write_text(json.dumps({"study": name}))
        if name == "rubber":
            with run_folder(published, study):
                pass
            (published / output.OWNER).unlink()
        else:
            with pytest.raises(BayesdegError, match="different"), run_folder(published, study):
                pass


WRONG_PLACES = {
    "a file": ("file", "file is not a folder"),
    "under a file": ("file/run", "is not a folder"),
    "too long": (300 * "a", "File name too long"),
    "not to be made": ("/proc/nowhere/run", "No such file"),
    "a named pipe": ("pipe", "pipe is not a folder"),
    "markup": ("file/[/red]:100:", "[/red]:100:"),
}


@pytest.mark.parametrize(("out", "why"), WRONG_PLACES.values(), ids=WRONG_PLACES)
@pytest.mark.parametrize("name", ["run", "simulate"])
def test_a_place_that_cannot_be_written_to_is_refused_before_the_work(here, call, name, out, why):
    (here / "file").write_text("mine")
    os.mkfifo(here / "pipe")
    before = sorted(here.rglob("*"))
    code, said = call(name, "rubber", "--out", out)
    assert code == cli.INPUT_FAULT
    assert why in refused(said)
    assert sorted(here.rglob("*")) == before


def test_a_folder_without_permission_is_refused(here, call, monkeypatch):
    def read_only(path, *_args, **_options):
        raise OSError(30, "Read-only file system", str(path))

    monkeypatch.setattr(output, "_locked", read_only)
    code, said = call("run", "rubber", "--out", "new/run")
    assert code == cli.INPUT_FAULT
    assert "(Read-only file system)" in refused(said)
    assert not (here / "new").exists()


HOLD = """
import sys, time
from pathlib import Path
from bayesdeg.pages.output import claimed
with claimed(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_in_use_is_refused_until_its_user_ends_even_if_killed(tmp_path):
    target = tmp_path / "run"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(target)], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(BayesdegError, match="another command"), claimed(target):
            pass
        other.kill()
    assert (target / output.LOCK).exists()
    with claimed(target):
        pass
    assert not (target / output.LOCK).exists()


def test_a_refused_study_leaves_no_folder(here, call):
    settings = here / "rubber" / "study.toml"
    settings.write_text(settings.read_text().replace('"c1_at_0"', '"c1_at_9"'))
    with claimed(here / "new" / "run"):
        assert (here / "new" / "run").is_dir()
    assert not (here / "new").exists()


def test_real_data_are_never_overwritten_by_a_virtual_experiment(tmp_path):
    """Published statistics in a virtual study are real, and are not written."""
    virtual = tmp_path / "virtual"
    shutil.copytree(STUDIES / "gelatin_actuator", virtual)
    assert "summary.csv" not in VIRTUAL_FILES
    assert all(is_virtual(virtual / name) for name in VIRTUAL_FILES if (virtual / name).exists())
    with virtual_study(virtual, VIRTUAL_FILES):
        pass
    shutil.copy(STUDIES / "treloar" / "tensile.csv", virtual)
    with (
        pytest.raises(BayesdegError, match=r"tensile\.csv is not"),
        virtual_study(virtual, VIRTUAL_FILES),
    ):
        pass


@pytest.mark.parametrize(
    ("name", "beside", "why"),
    [
        ("tensile.csv", "study.toml", "data of a"),
        ("bands.csv", "run.json", "results of a"),
    ],
)
def test_a_table_does_not_overwrite_data_or_results(tmp_path, name, beside, why):
    (tmp_path / beside).write_text("")
    (tmp_path / name).write_text("mine")
    with pytest.raises(BayesdegError, match=why):
        output_file(tmp_path / name)
    assert output_file(tmp_path / "table.csv") == tmp_path / "table.csv"
    assert not (tmp_path / "table.csv").exists()


@pytest.mark.parametrize("name", ["pipe", "folder", "none/table.csv", 300 * "a"])
def test_a_file_that_cannot_be_written_is_refused(tmp_path, name):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    with pytest.raises(BayesdegError, match="cannot be written"):
        output_file(tmp_path / name)


@pytest.mark.parametrize("name", ["run", "check"])
def test_rows_that_are_read_as_comments_are_told(here, monkeypatch, capsys, name):
    table, row = here / "rubber" / "tensile.csv", ",0,uniaxial,1.9,"
    table.write_text(table.read_text().replace(f"treloar_uniaxial{row}", f"#1{row}"))
    monkeypatch.setattr(sys, "argv", ["bayesdeg", name, "rubber"])
    cli.exit_code()
    said = "".join(capsys.readouterr())
    assert "lines of tensile.csv" in said
    assert "(1 with" in said
    assert "in quotation marks" in said
