"""What tests of all packages share: commands, run in this process."""

import pytest

from bayesdeg.cli import exit_code


@pytest.fixture
def bayesdeg(monkeypatch, capsys):
    """Run a command as the command line does; return its exit code, output and messages."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["bayesdeg", *map(str, arguments)])
        code = exit_code()
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run
