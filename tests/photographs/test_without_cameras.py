"""The core without the camera extra: it works, and says in one line what to install."""

import subprocess
import sys
from pathlib import Path

import pytest

STUDIES = Path(__file__).parents[2] / "studies"
LIBRARIES = ("cv2", "roifile", "ezc3d")
BLOCKED = """
import sys
sys.modules |= dict.fromkeys(sys.argv[1].split(","))
sys.argv[:2] = ["bayesdeg"]
from bayesdeg.cli import exit_code
sys.exit(exit_code())
"""
EVERY_NAME = """
import sys
sys.modules |= dict.fromkeys(sys.argv[1].split(","))
import bayesdeg
for name in bayesdeg.__all__:
    getattr(bayesdeg, name)
assert not [name for name in sys.modules if name.startswith("bayesdeg_camera")]
"""
TABLES = {
    "photos.csv": "file,specimen_id,degradation_pct,pressure_kPa\na.jpg,S1,0,40\n",
    "captures.csv": "file,specimen_id,degradation_pct,pressure_kPa\na.c3d,S1,0,40\n",
}


def without(*words, code=BLOCKED, libraries=LIBRARIES):
    command = [sys.executable, "-c", code, ",".join(libraries), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def said(*words, libraries=LIBRARIES):
    """The one line on which a command is refused."""
    done = without(*words, libraries=libraries)
    assert done.returncode == 2, done.stderr
    assert not done.stdout
    (line,) = done.stderr.splitlines()
    return line


def test_every_name_of_the_library_is_there():
    done = without(code=EVERY_NAME)
    assert done.returncode == 0, done.stderr


def test_a_study_is_checked():
    done = without("check", STUDIES / "gelatin_actuator", libraries=(*LIBRARIES, "PIL"))
    assert done.returncode == 0, done.stderr
    assert "actuator.csv" in done.stdout


@pytest.mark.parametrize(
    ("table", "missing", "extra"),
    [("photos.csv", "cv2", "camera"), ("photos.csv", "PIL", "camera"),
     ("photos.csv", "roifile", "camera"), ("captures.csv", "ezc3d", "motion"),
     ("photos.csv", "bayesdeg_camera", "camera")],
)  # fmt: skip
def test_a_study_that_needs_cameras_says_so_in_one_line(tmp_path, table, missing, extra):
    (tmp_path / table).write_text(TABLES[table], encoding="utf-8")
    (tmp_path / "study.toml").write_text("seed = 1\n", encoding="utf-8")
    line = said("check", tmp_path, libraries=(missing,))
    assert line.startswith(f"{table}: ")
    assert missing in line
    assert line.endswith(f"pip install 'bayesdeg[{extra}]'")


def test_the_command_says_so_too(tmp_path):
    line = said("trace", tmp_path / "a.jpg", "--grid", "5", "--out", tmp_path / "out")
    assert line.startswith("bayesdeg trace: ")
    assert line.endswith("pip install 'bayesdeg[camera]'")
    assert without("trace", "--help").returncode == 0
