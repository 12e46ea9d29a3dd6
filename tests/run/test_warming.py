import os
import subprocess
import sys

import pytest

from bayesdeg.run.deformed import is_compiled

SCRIPT = """
from bayesdeg.actuator import kernels, paper
from bayesdeg.run import deformed

deformed.end_with_parent = lambda: None  # this process has no parent of multiprocessing's
deformed.compile_kernels()
used = (kernels.solid, kernels.solid_products, paper.membrane, kernels.cavity_volume)
assert all(kernel.signatures for kernel in used)
print(kernels.solid.stats.cache_path)
"""


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.fem
def test_a_process_beside_the_fits_leaves_the_kernels_of_a_picture_in_the_cache(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
        timeout=600,
    )
    folder = tmp_path / done.stdout.strip().rsplit("/", 1)[-1]
    assert is_compiled(folder)


def test_an_empty_cache_is_not_compiled(tmp_path):
    assert not is_compiled(tmp_path)
    (tmp_path / "kernels.solid-23.py313.nbi").touch()
    assert is_compiled(tmp_path)
