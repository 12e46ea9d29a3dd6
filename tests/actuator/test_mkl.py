import os
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdeg.actuator.linear import VARIABLE, name_library, pypardiso


def test_the_library_of_the_environment_is_named(tmp_path):
    library = tmp_path / "lib" / "libmkl_rt.so.3"
    library.parent.mkdir()
    library.touch()
    environment = {}
    name_library(tmp_path, environment)
    assert environment == {VARIABLE: str(library)}


def test_what_the_user_named_stays(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libmkl_rt.so.3").touch()
    environment = {VARIABLE: "mine.so"}
    name_library(tmp_path, environment)
    assert environment == {VARIABLE: "mine.so"}


def test_where_there_is_none_nothing_is_named(tmp_path):
    environment = {}
    name_library(tmp_path, environment)
    assert environment == {}


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="libraries are listed on Linux")
@pytest.mark.skipif(pypardiso is None, reason="no MKL on this machine")
def test_no_threading_runtime_is_loaded():
    """The project leaves them out of its environment: 300 MB for one thread."""
    script = (
        "import numpy as np, scipy.sparse as sp\n"
        "from bayesdeg.actuator import linear\n"
        "matrix = sp.csr_matrix(np.diag([1.0, 2.0, 4.0]))\n"
        "print(linear.pypardiso.spsolve(matrix, np.ones(3)))\n"
        "print([m for m in open('/proc/self/maps') if 'iomp' in m or 'libtbb' in m])\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "MKL_THREADING_LAYER"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == ["[1.   0.5  0.25]", "[]"]
