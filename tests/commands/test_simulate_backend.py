"""``bayesdeg simulate --backend``: the same virtual experiment from either assembly."""

import json

import pytest

from bayesdeg.actuator.status import Resolution
from bayesdeg.commands import simulate
from tests.run.study_files import SETTINGS, study_in
from tests.run.tiny_campaign import TABLE

ACTUATOR = (
    "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m\n"
    "a0,0,0.5,0,0.0\na0,0,0.5,40,2.0\n"
)


@pytest.fixture
def command(monkeypatch, tmp_path, bayesdeg):
    """Run simulate in this process on a tiny mesh; gives exit code and what was written."""
    monkeypatch.setattr(simulate, "FINE", Resolution(9.0, 9.0, 9.0))
    study = tmp_path / "study"
    study.mkdir()
    study_in(study, {"study.toml": SETTINGS + TABLE, "actuator.csv": ACTUATOR})

    def call(name, *options):
        out = tmp_path / name
        words = ("--out", out, "--workers", 1, "--quiet", *options)
        code, *_ = bayesdeg("simulate", study, *words)
        return code, {path.name: path.read_text("utf-8") for path in out.glob("*.*")}

    return call


@pytest.mark.fem
def test_readings_are_the_same_with_either_backend(command):
    (code, ours), (other, theirs) = command("a"), command("b", "--backend", "scikit-fem")
    assert code == other == 0
    assert set(ours) == {"study.toml", "truth.json", "actuator.csv", "break.csv", "tensile.csv"}
    lines = [files["actuator.csv"].splitlines() for files in (ours, theirs)]
    assert lines[0][1:] == lines[1][1:]
    assert len(lines[0]) > 2
    assert lines[1][0].split(" (seed")[0].endswith("--backend scikit-fem")
    assert "--backend" not in lines[0][0]
    truths = [json.loads(files["truth.json"]) for files in (ours, theirs)]
    assert truths[0]["actuators"] == truths[1]["actuators"]
