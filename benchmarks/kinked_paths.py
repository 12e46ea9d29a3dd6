"""What a guess by the last tangent saves where paths have kinks: where paper begins to wrinkle.

    uv run python benchmarks/kinked_paths.py --json

follows curves of the actuator of 90 × 20 × 17 mm on a coarse mesh twice: as the package does, and
with each step that fails halved, as it did before. Keys: ``factorizations`` of all curves, before
over now, ``seconds`` the same of the time, in one run, ``apart_pct`` the largest difference of a
curvature, over the largest of its curve, at loads that both reach, and ``ends``, how each ended.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
from geometries import DIMENSIONS

from bayesdeg.actuator.curve import SAMPLING, Actuator, Curve, CurveSolution
from bayesdeg.actuator.equilibrium import LoadStep, StepControl
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.data.settings import Dimensions

LOADS = 14
# (C2/C1, C3/C1, stiffness of the paper over C1, last p/C1): about those of the gelatin study
CURVES = (
    (-0.0119, 0.0102, 162.0, 0.81),
    (-0.0133, 0.0104, 128.0, 0.81),
    (-0.0133, 0.0104, 125.0, 0.87),
    (-0.0162, 0.0106, 122.0, 0.84),
    (-0.0170, 0.0105, 131.0, 0.61),
)


def halved(control: StepControl, trial: LoadStep) -> StepControl:
    """Return the control after a step that failed, as it was before."""
    return replace(control, step=0.5 * control.step)


def curve_of(c2: float, c3: float, paper: float, last: float) -> Curve:
    """Return a curve."""
    material = MaterialGroups(c2_ratio=c2, c3_ratio=c3, paper_group=paper)
    return Curve(tuple(last * (np.arange(LOADS) + 1.0) / LOADS), material)


def timed(solve: Callable[[], CurveSolution]) -> tuple[CurveSolution, float]:
    """Return a solution and the seconds that it took."""
    begun = time.perf_counter()
    return solve(), time.perf_counter() - begun


def apart(one: CurveSolution, other: CurveSolution) -> float:
    """Return the largest difference of a curvature over the largest, where both are known [%]."""
    reached = min(len(one.readings), len(other.readings))
    first, second = (found.bend_angle / found.arc_length for found in (one, other))
    return float(100.0 * np.abs(first[:reached] - second[:reached]).max() / first[:reached].max())


def main() -> None:
    """Follow the curves both ways."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    sizes: dict[str, Any] = {**DIMENSIONS["long"]}
    geometry = Geometry(Dimensions(**sizes))
    actuator = Actuator(build_mesh(geometry, geometry.mesh_like(COARSE)))
    actuator.solve(curve_of(*CURVES[0][:3], 0.1))  # compiles
    totals = np.zeros((2, 2))
    worst, ends = 0.0, []
    for values in CURVES:
        solve = partial(actuator.solve, curve_of(*values), effort=SAMPLING)
        now, seconds = timed(solve)
        with mock.patch.object(StepControl, "failed", halved):
            before, longer = timed(solve)
        totals += [[before.iterations, longer], [now.iterations, seconds]]
        worst = max(worst, apart(before, now))
        ends.append([before.status.name, now.status.name])
    figures = {
        "factorizations": totals[0, 0] / totals[1, 0],
        "seconds": totals[0, 1] / totals[1, 1],
        "apart_pct": worst,
        "ends": ends,
    }
    print(json.dumps(figures, indent=1) if given.json else figures)


if __name__ == "__main__":
    main()
