"""Commands on a study that belongs to the test."""

import pytest


@pytest.fixture
def command(monkeypatch, tmp_path, bayesdeg):
    """Run a command on the folder ``study``; gives its exit code and all that it printed."""
    study = tmp_path / "study"
    study.mkdir()
    monkeypatch.chdir(tmp_path)

    def call(name, *options):
        code, *said = bayesdeg(name, "study", *options)
        return code, "".join(said)

    call.study = study
    return call
