"""A process that meshes and solves one pressure curve and prints its peak memory.

uv run python benchmarks/forward_memory.py converged
"""

import json
import resource
import subprocess
import sys

from forward_case import curvature_of, curve_of
from forward_meshes import named_mesh

from bayesdeg.actuator.curve import Actuator


def peak_mb() -> float:
    """Return the largest resident memory of this process so far [MB, 10⁶ bytes]."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def measured(mesh: str) -> dict[str, float]:
    """Run this file in a process of its own.

    On Linux a child begins with its parent's peak, so ask before anything large was done.
    """
    command = [sys.executable, __file__, mesh]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


if __name__ == "__main__":
    imported = peak_mb()
    mesh = named_mesh(sys.argv[1])
    meshed = peak_mb()
    actuator = Actuator(mesh)
    numbered = peak_mb()
    curvature_of(actuator.solve(curve_of("fresh")))
    stages = {"imported": imported, "meshed": meshed, "numbered": numbered, "solved": peak_mb()}
    print(json.dumps(stages))
