"""MKL's solver PARDISO where it is installed, found at once.

Left to itself pypardiso searches every folder of the environment for the library, at its import and
again for each solver, which takes longer than a solution.
"""

import os
import sys
from collections.abc import MutableMapping
from pathlib import Path

# of the wheel ``mkl``, under sys.prefix: Linux, macOS, Windows
PLACES = ("lib/libmkl_rt.so*", "lib/libmkl_rt*.dylib", "Library/bin/mkl_rt*.dll")
VARIABLE = "PYPARDISO_MKL_RT"
LAYER = "MKL_THREADING_LAYER"  # one thread a process: no threading runtime has to be there


def name_library(
    prefix: Path = Path(sys.prefix), environment: MutableMapping[str, str] = os.environ
) -> None:
    """Tell pypardiso where the library is, unless the user did; where it is not, let it search.

    Parameters
    ----------
    prefix : Path
        Of the environment.
    environment : mapping
        Gets ``PYPARDISO_MKL_RT``, also for worker processes.
    """
    found = [path for place in PLACES for path in prefix.glob(place)]
    if found:
        environment.setdefault(VARIABLE, str(min(found, key=lambda path: len(path.name))))


name_library()
os.environ.setdefault(LAYER, "SEQUENTIAL")
try:  # MKL exists for x86-64 only
    import pypardiso as pypardiso
except ImportError:  # pragma: no cover - depends on the machine
    pypardiso = None
