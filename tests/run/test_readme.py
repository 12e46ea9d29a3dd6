"""What the first page says must be so."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.cli import app
from bayesdeg.commands.interface import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LARGEST_BYTES = 6000


def test_it_is_short():
    assert len(README.encode()) <= LARGEST_BYTES


@pytest.mark.parametrize("command", ["run bayesdeg run studies/gelatin_actuator", "run pytest"])
def test_it_begins_with_two_commands(command):
    assert re.search(rf"^.* && uv {command}\b", README, re.MULTILINE)


def test_its_commands_are_those_that_exist():
    shown = set(re.findall(r"uv run bayesdeg (\w+)", README))
    assert {"init", "check", "run"} <= shown <= {command.name for command in COMMANDS}
    for name in shown:
        assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0


def test_its_links_lead_somewhere():
    links = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    assert len(links) > 15
    for target in links:
        assert (ROOT / target).exists(), target


def test_it_counts_the_causes():
    assert re.findall(r"catalogue of (\d+)", README) == [str(len(CATALOGUE))]


def test_its_rates_are_those_of_the_recorded_verdicts(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from hidden_record import read_record  # noqa: PLC0415
    from hidden_summary import summary_of_record  # noqa: PLC0415

    record = read_record(ROOT / "benchmarks" / "hidden_effects.jsonl").values()
    found = summary_of_record(record)
    shown = re.findall(r"^\| [^|]+ \| (\d+) \| (\d\.\d\d) \([^|]+ \|$", README, re.MULTILINE)
    keys = {
        "visible_studies": "named_correctly",
        "single_studies": "wrongly_named",
        "none_studies": "false_name_rate",
        "outside_studies": "outside_catalogue_named",
        "pair_studies": "two_causes_both_named",
    }
    assert shown == [(str(found[of]), f"{found[key]:.2f}") for of, key in keys.items()]


def test_what_its_reports_say_is_published():
    verdict = json.loads((ROOT / "reports/gelatin_actuator/verdict.json").read_text())
    (size,) = verdict["candidates"][0]["effect"].values()
    assert verdict["causes"] == ["pressure_offset"]
    assert f"{size['mean']:.1f} kPa" in README
