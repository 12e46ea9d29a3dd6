"""numpyro in an environment of its own, so that a plain installation goes without its 350 MB.

`uv` lays the packages of the group `peers` over the project's environment for one process, and
keeps them in its cache. The density goes there through a pipe, the draws come back through one.
"""

import importlib.util
import io
import os
import pickle
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def requirements():
    """Return the group `peers`, each package as the project pins it for development."""
    wanted = PROJECT["dependency-groups"]["peers"]
    pins = {name_of(pin): pin for pin in PROJECT["tool"]["uv"]["constraint-dependencies"]}
    return [pins.get(name_of(package), package) for package in wanted]


def name_of(requirement):
    return re.match(r"[\w.-]+", requirement)[0]


def command():
    """Return what starts Python with numpyro; this one where it is installed."""
    if importlib.util.find_spec("numpyro"):
        return [sys.executable]
    uv = os.environ.get("UV") or shutil.which("uv")  # `uv run` tells where it is
    if uv is None:
        pytest.skip("needs numpyro, or uv to fetch it")
    packages = [part for package in requirements() for part in ("--with", package)]
    there = [uv, "run", "--no-sync", *packages, "python"]
    if "CI" not in os.environ:  # where nothing may be missing
        skip_if_out_of_reach(there)
    return there


def skip_if_out_of_reach(there):
    """Skip where the packages cannot be fetched, as without a network."""
    probe = subprocess.run([*there, "-c", "import numpyro"], capture_output=True, check=False)
    if probe.returncode != 0:
        pytest.skip(f"numpyro cannot be fetched: {probe.stderr.decode().strip()[-200:]}")


def nuts(density, start, covariance, **settings):
    """Do what `numpyro_nuts.nuts` does, there; its fields as a mapping."""
    asked = pickle.dumps((density, np.asarray(start), np.asarray(covariance), settings))
    done = subprocess.run(
        [*command(), "-m", __name__], input=asked, capture_output=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    found = np.load(io.BytesIO(done.stdout))
    return {name: found[name] if found[name].ndim else found[name].item() for name in found}


def answer():
    """Sample what comes in, and send the draws out."""
    from tests.peers import numpyro_nuts  # noqa: PLC0415  only here is numpyro

    density, start, covariance, settings = pickle.load(sys.stdin.buffer)
    found = numpyro_nuts.nuts(density, start, covariance, **settings)
    np.savez(sys.stdout.buffer, **asdict(found))


if __name__ == "__main__":
    answer()
