"""The script of the how-to on clusters that solves finite element runs over worker processes."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.surrogate.small_runs import contents
from tests.surrogate.test_cluster import dask_processes

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "howto" / "cluster.md").read_text(encoding="utf-8")
POOL = "pool(2)"


def run_script(folder, pool=POOL):
    """Run the script as a user would, in a folder of its own; return its lines and its store."""
    (text,) = re.findall(r"```py\n(.*?)```", PAGE, re.DOTALL)
    assert text.count(POOL) == 1
    folder.mkdir(exist_ok=True)
    script = folder / "my_campaign.py"
    script.write_text(text.replace(POOL, pool), encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, script.name],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines(), contents(folder / ".cache" / "my_campaign")


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_the_script_gives_the_same_bytes_over_two_processes_and_in_one(tmp_path):
    lines, store = run_script(tmp_path / "two")
    groups, statuses, angles = zip(*(line.split(maxsplit=2) for line in lines), strict=True)
    assert groups == ("50.0", "100.0", "200.0")
    assert set(statuses) == {"CONVERGED"}
    for angle in angles:
        bend = [float(value) for value in angle.strip("[]").split(",")]
        assert 0.0 < bend[0] < bend[1] < bend[2]
    assert len(store) == 3
    assert run_script(tmp_path / "two") == (lines, store)
    assert run_script(tmp_path / "one", "pool(1)") == (lines, store)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_the_script_gives_the_same_bytes_over_a_cluster(tmp_path):
    with dask_processes(tmp_path, workers=2) as dask:
        over_dask = run_script(tmp_path / "dask", f'pool(2, "{dask.address}")')
    assert run_script(tmp_path / "one", "pool(1)") == over_dask
