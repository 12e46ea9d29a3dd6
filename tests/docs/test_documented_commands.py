"""Commands that the documents name: each is understood, and the quick ones run at their smallest.

Not run here, since they take minutes or solve finite elements: what `SMALLEST` does not name.
Their options are read by their own parsers, as they are written.
"""

import argparse
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdeg import cli
from bayesdeg.commands.interface import COMMANDS, Command

ROOT = Path(__file__).resolve().parents[2]
#: Programs without options, which would run: tables, schemas, and two whole studies.
WITHOUT_OPTIONS = {
    "benchmarks/structure.py",
    "docs/publish_reports.py",
    "docs/write_schemas.py",
    "docs/write_validation.py",
}
NAMES = {"FOLDER/cycle": "studies/gelatin_actuator", "FOLDER": "out", "NAME": "long"}
SMALLEST = (
    "benchmarks/verdict_studies.py --out OUT cycle",
    "benchmarks/hidden_effects.py --studies 510 --again 60 --draws 3 --markdown "
    "--record benchmarks/hidden_effects.jsonl",
    "benchmarks/scored_methods.py --record benchmarks/scored --json",
    *(
        pytest.param(line, marks=pytest.mark.long)
        for line in (
            "benchmarks/local_discrepancies.py --studies 1",
            "benchmarks/lying_parameters.py --studies 1 --without 0 --json",
            "benchmarks/material_laws.py --json",
            "benchmarks/recovery.py --studies 1 --workers 1 --json",
        )
    ),
)


class UnderstoodError(Exception):
    """A program read its options, and would begin to work."""


def documented():
    """Return commands after ``uv run``, of code blocks and of code within sentences."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "studies").rglob("*.md")]
    pages += [p for p in (ROOT / "docs").rglob("*.md") if not {"generated", "_build"} & {*p.parts}]
    found = set()
    for page in pages:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"uv run ((?:python|bayesdeg) [^`\n|&]+)", text):
            words = shlex.split(line, comments=True)
            found.add(" ".join(NAMES.get(word, word) for word in words))
    return sorted(found)


DOCUMENTED = documented()
PROGRAMS = [line.removeprefix("python ") for line in DOCUMENTED if line.startswith("python ")]
OF_PACKAGE = [line.split()[1:] for line in DOCUMENTED if line.startswith("bayesdeg ")]


@pytest.fixture
def reading_only(monkeypatch):
    """Let programs read their options and go no further."""
    read = argparse.ArgumentParser.parse_args

    def parse_args(self, *given):
        raise UnderstoodError(read(self, *given))

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)
    monkeypatch.chdir(ROOT)


def test_commands_are_found():
    assert len(PROGRAMS) > 25
    assert {words[0] for words in OF_PACKAGE} >= {"init", "check", "run", "predict", "emulate"}


@pytest.mark.parametrize("line", PROGRAMS)
def test_a_program_understands_its_options(line, reading_only, monkeypatch):
    name, *words = line.removeprefix("-m ").split()
    path = ROOT / (name if name.endswith(".py") else f"{name.replace('.', '/')}.py")
    assert path.is_file()
    if name in WITHOUT_OPTIONS:
        assert not words
        return
    words = ["gelatin" if word == "STUDY" else word for word in words]
    monkeypatch.setattr(sys, "argv", [name, *words])
    monkeypatch.syspath_prepend(str(path.parent))
    with pytest.raises(UnderstoodError):
        runpy.run_path(str(path), run_name="__main__")


@pytest.mark.parametrize("words", OF_PACKAGE, ids=" ".join)
def test_a_command_understands_its_options(words, monkeypatch, capsys):
    called = []
    works = property(lambda self: lambda **given: called.append(self.name))
    monkeypatch.setattr(Command, "work", works)
    monkeypatch.setattr(sys, "argv", ["bayesdeg", *words])
    assert cli.exit_code() == 0, capsys.readouterr().err
    assert called == [words[0]]
    assert words[0] in {command.name for command in COMMANDS}


@pytest.mark.slow
@pytest.mark.parametrize("line", SMALLEST, ids=lambda line: line.split()[0].split("/")[1])
def test_a_program_runs_at_its_smallest(line, tmp_path):
    assert line.split()[0] in {program.split()[0] for program in PROGRAMS}
    words = [str(tmp_path / "out") if word == "OUT" else word for word in line.split()]
    done = subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip() or any(tmp_path.iterdir())
