"""What a command says of an input."""

import faulthandler
import shutil
import sys

import pytest

from bayesdeg.cli import exit_code
from tests.hostile.inputs import listing, spoil

LONGEST = 1200
"""Characters of a line that a user still reads."""
SECONDS = 240.0
"""After which a command that waits for ever ends the tests; those of the table take below 5 s."""


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Try an input on a copy of a sound folder: refused, said so, and nothing written."""

    def run(case, sound, redraw=None):
        shutil.copytree(sound, tmp_path / case.subject)
        own = {"study": tmp_path / "study", "report": tmp_path / "report"}
        own |= {"run": tmp_path / "run" / "run", "emulator": tmp_path / "run" / "emulator.npz"}
        spoil(own[case.subject], case, redraw)
        (tmp_path / "here").mkdir()
        monkeypatch.chdir(tmp_path / "here")
        words = (word.format(**own) for word in case.command.split())
        monkeypatch.setattr("sys.argv", ["bayesdeg", *words])
        before = listing(tmp_path)
        faulthandler.dump_traceback_later(SECONDS, exit=True, file=sys.__stderr__)
        try:
            code = exit_code()
        finally:
            faulthandler.cancel_dump_traceback_later()
        printed = capsys.readouterr()
        lines = printed.err.strip().splitlines()
        assert code in case.codes, printed.err
        assert "Traceback" not in printed.err
        assert printed.out == ""
        assert lines
        assert max(map(len, lines)) <= LONGEST
        said = " ".join(printed.err.split())
        assert all(word in said for word in case.said), printed.err
        assert "\x1b" not in printed.err
        assert not listing(tmp_path) ^ before

    return run
