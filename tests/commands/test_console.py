"""Progress and messages where standard error is a file."""

import io

import pytest

from bayesdeg import console, display
from bayesdeg.data.settings import Dimensions
from bayesdeg.display import Lines, shown
from bayesdeg.surrogate.kept import rough_seconds

NAMES = ["[red]x[/blue]", ":100:", "[/]", "a [kPa]", "50%"]


@pytest.mark.parametrize("name", NAMES)
def test_a_stage_has_plain_lines_in_a_file(capsys, name):
    with shown(quiet=False) as progress:
        progress.stage(f"without {name}")
        progress.advance(note=name)
        progress.stage("report")
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f"without {name} ...",
        f"without {name}: done in 0:00, {name}",
        "report ...",
        "report: done in 0:00",
    ]


def test_a_long_stage_says_now_and_then_how_far_it_is():
    times, said = iter(float(second) for second in range(0, 10_000, 4)), []
    lines = Lines(said.append, clock=lambda: next(times))
    lines.stage("sampling")
    for draws in range(30):
        lines.advance(note=f"{draws} draws")
    lines.finish()
    assert said[0] == "sampling ..."
    assert said[1] == "sampling: 0:32, 7 draws"
    assert said[-1].endswith("2:04, 29 draws")
    assert len(said) == 5


def test_quiet_says_nothing(capsys):
    with shown(quiet=True) as progress:
        progress.stage("sampling")
        progress.advance()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", NAMES)
def test_names_are_printed_as_they_are_on_a_terminal_too(monkeypatch, name):
    written = io.StringIO()
    terminal = console.console(width=200)
    terminal.file, terminal._force_terminal = written, True
    monkeypatch.setattr(display, "errors", terminal)
    with shown(quiet=False) as progress:
        progress.stage(name)
        progress.advance(note=name)
    assert written.getvalue().count(name) >= 2


def test_a_larger_actuator_takes_longer_and_more_workers_less():
    small, large = Dimensions(), Dimensions(length=300.0)
    # meshes grow with the actuator, so six times the length has twice the elements at most
    assert 1.2 * rough_seconds(small) < rough_seconds(large) < 2.0 * rough_seconds(small)
    # fitting is not shared among workers
    assert rough_seconds(large, workers=4) < rough_seconds(large) / 2.0
    # elements grow with the actuator
    twice = Dimensions(length=100.0, width=20.0, height=20.0)
    assert rough_seconds(twice) < 1.1 * rough_seconds(small)
