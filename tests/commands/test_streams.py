"""Every command: its result goes to standard output, all else to standard error."""

import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest

from bayesdeg import api, cli, training
from bayesdeg.commands import run as run_command
from bayesdeg.commands import simulate as simulating
from bayesdeg.commands.interface import COMMANDS
from bayesdeg.laboratory.hidden import lines_of
from bayesdeg.pages.record import TakenInEntry, UpdateEntry, VerdictRecord
from bayesdeg.run.update import Update
from bayesdeg_camera import command as tracing
from tests.commands.test_predict_and_control import buried, models, report
from tests.commands.test_score_command import ANSWERS, TRUTHS
from tests.pages.synthetic_run import write_full
from tests.photographs.traced_folder import photograph

__all__ = ["buried", "models", "report"]
STUDIES = Path(__file__).parents[2] / "studies"
MOVED = {"parameter": "c1", "unit": "kPa", "mean": 2.0, "sd": 0.1} | {
    "mean_before": 1.0,
    "sd_before": 0.2,
    "shift_sd": 5.0,
}
# arguments of each command, and words of its result
ASKED = {
    "init": (("mine",), "wrote a study to mine"),
    "run": (("rubber", "--workers", "1"), "adequate all is explained report: index.html"),
    "check": (("rubber",), "without actuator.csv"),
    "causes": ((), "pressure_offset"),
    "report": (("full",), "wrote full/index.html"),
    "simulate": (
        ("rubber", "--out", "made", "--workers", "1"),
        "wrote a virtual experiment to made",
    ),
    "emulate": (("--out", "made.npz", "--workers", "1"), "wrote made.npz"),
    "predict": (("buried", "--pressure", "80", "--degradation", "0"), "Small"),
    "control": (("buried", "--curvature", "4", "--degradation", "0"), "Small"),
    "lifetime": (("buried", "--pressure", "80", "--curvature", "4", "--hours", "0:20:10"), "Small"),
    "next": (("full",), "expected"),
    "update": (("full", "new.csv"), "updated run: full"),
    "score": (("answers.csv", "truths.jsonl"), "combinations said"),
    "trace": (("one.png", "--length", "40", "--out", "made"), "1 of 1 photographs traced"),
}
QUIET = [
    name for name in ASKED if name not in {"init", "check", "causes", "report", "score", "trace"}
]


@pytest.fixture
def call(tmp_path, monkeypatch, capsys, buried):
    """Run a command whose long work is left out; gives standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(STUDIES / "treloar_uniaxial", "rubber")
    shutil.copytree(buried, "buried")
    write_full(tmp_path / "full", "ambiguous")
    Path("answers.csv").write_text(ANSWERS, encoding="utf-8")
    Path("truths.jsonl").write_text(lines_of(TRUTHS), encoding="utf-8")
    cv2.imwrite("one.png", np.full((480, 640, 3), 200, np.uint8))
    verdict = VerdictRecord(outcome="adequate", explanation="all is explained")
    monkeypatch.setattr(run_command, "run_study", lambda *_, **__: verdict)
    monkeypatch.setattr(run_command, "add_page", lambda *_: (verdict, Path("index.html")))
    monkeypatch.setattr(simulating, "run_experiment", lambda *_, **__: None)
    monkeypatch.setattr(simulating, "_filed", lambda *_: None)
    monkeypatch.setattr(simulating, "study_files", lambda *_, **__: {})
    monkeypatch.setattr(training, "train", lambda *_: None)
    entry = UpdateEntry(posteriors={"final": TakenInEntry(method="weights", effective=9.0)})
    updated = Update(Path("full"), entry, pd.DataFrame([MOVED]), ("not judged",))
    monkeypatch.setattr(api, "update", lambda *_, **__: updated)
    found = SimpleNamespace(plane=SimpleNamespace(target=None))
    monkeypatch.setattr(tracing, "trace", lambda *_, **__: found)
    monkeypatch.setattr(tracing, "recorded", lambda *_: photograph("one.png", b""))
    monkeypatch.setattr(tracing, "write_overlay", lambda *_: None)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["bayesdeg", *arguments])
        code, printed = cli.exit_code(), capsys.readouterr()
        assert code == 0, printed.err
        return printed

    return run


def words_of(printed):
    return " ".join("".join(c for c in printed if not 0x2500 <= ord(c) < 0x2580).split())


def test_every_command_is_here():
    assert list(ASKED) == [command.name for command in COMMANDS]


@pytest.mark.parametrize("name", ASKED)
def test_the_result_goes_to_standard_output(call, name):
    arguments, result = ASKED[name]
    printed = call(name, *arguments)
    assert result in words_of(printed.out)
    assert "..." not in printed.out
    assert result not in words_of(printed.err)


@pytest.mark.parametrize("name", QUIET)
def test_quiet_prints_the_result_and_nothing_else(call, name):
    arguments, _ = ASKED[name]
    loud, quiet = call(name, *arguments), call(name, *arguments, "--quiet")
    assert quiet.out == loud.out
    assert quiet.err == ""
