"""What the first page says must be so."""

import doctest
import re
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.cli import app
from bayesdeg.measure.settings_file import parse_settings
from bayesdeg.measure.tables import TABLES

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_its_examples_run(monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for block in filter(lambda text: ">>>" in text, blocks("python")):
        example = doctest.DocTestParser().get_doctest(block, names, "README.md", "README.md", 0)
        runner = doctest.DocTestRunner()
        runner.run(example, clear_globs=False)
        names = example.globs
        assert runner.failures == 0
        assert runner.tries > 0


def test_its_commands_are_those_that_exist():
    shown = set(re.findall(r"^\| `bayesdeg (\w+)", README, re.MULTILINE))
    there = {command.name or command.callback.__name__ for command in app.registered_commands}
    assert shown == there
    for name in shown:
        assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0


def test_its_study_file_is_understood():
    (text,) = blocks("toml")
    assert tomllib.loads(text)
    settings, faults = parse_settings(text.encode())
    assert not faults
    assert settings.fit_modes == ("uniaxial",)


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda table: table.file)
def test_it_lists_every_column(table):
    start = README.index(f"\n| {table.file} |")
    rows = re.split(r"\n\| \w+\.csv \|", README[start + 1 :], maxsplit=1)[0]
    missing = [c.name for c in table.columns if f"`{c.name}`" not in rows]
    assert not missing


def test_it_says_which_causes_there_are():
    count, names = re.findall(r"\*\*The catalogue\*\* holds (\d+) causes: (.*?)\. ", README)[0]
    assert int(count) == len(CATALOGUE)
    assert set(re.findall(r"`(\w+)`", names)) == set(CATALOGUE)


def test_its_links_lead_somewhere():
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
