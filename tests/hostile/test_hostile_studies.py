"""Every study and command line of the table is refused before anything is computed."""

import faulthandler
import shutil
import sys

import pytest

from bayesdeg.cli import exit_code
from tests.hostile.inputs import hostile_inputs, listing, spoil
from tests.pipeline.study_files import study_in

CASES = hostile_inputs()
LONGEST = 1200
"""Characters of a line that a user still reads."""
SECONDS = 240.0
"""After which a command that waits for ever ends the tests; those of the table take below 5 s."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    study_in(folder)
    return folder


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_hostile_input_is_refused(case, sound, tmp_path, monkeypatch, capsys):
    study = shutil.copytree(sound, tmp_path / "study")
    spoil(study, case)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    words = (word.format(study=study) for word in case.command.split())
    monkeypatch.setattr("sys.argv", ["bayesdeg", *words])
    before = listing(tmp_path)
    faulthandler.dump_traceback_later(SECONDS, exit=True, file=sys.__stderr__)
    try:
        code = exit_code()
    finally:
        faulthandler.cancel_dump_traceback_later()
    printed = capsys.readouterr()
    lines = printed.err.strip().splitlines()
    assert code in (2, 3), printed.err
    assert "Traceback" not in printed.err
    assert printed.out == ""
    assert lines
    assert max(map(len, lines)) <= LONGEST
    assert all(word in printed.err for word in case.said), printed.err
    assert "\x1b" not in printed.err
    assert listing(tmp_path) == before
