"""The pressure curve solved by every benchmark of the forward model, and its timing.

Twelve pressures on the default geometry, fresh and degraded material, with paper.
"""

import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Curve, CurveSolution
from bayesdeg.actuator.inputs import Inputs, load_of, material_groups
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.status import Status

Floats = NDArray[np.float64]

PRESSURES = np.arange(20.0, 250.0, 20.0)  # kPa
LINEAR_SCALE, PAPER_STIFFNESS = 0.843, 3e4  # –, N/m
PAPER_THICKNESS = 0.117 * LINEAR_SCALE  # mm: 0.117 mm at moulded size
CONSTANTS = {"fresh": (0.288, -0.004, 0.0012), "degraded": (1.588, -0.149, 0.1175)}  # MPa


def curve_of(name: str) -> Curve:
    """Return the curve of the fresh or of the degraded material."""
    one = np.ones_like(PRESSURES)
    c1, c2, c3 = (c * one for c in CONSTANTS[name])
    inputs = Inputs(
        PRESSURES,
        c1,
        c2,
        c3,
        LINEAR_SCALE * one,
        PAPER_STIFFNESS * one,
        paper_thickness=PAPER_THICKNESS * one,
    )
    groups = {key: float(group[0]) for key, group in material_groups(inputs).items()}
    return Curve(tuple(float(q) for q in load_of(inputs)), MaterialGroups(**groups))


def curvature_of(solution: CurveSolution) -> Floats:
    """Return the curvatures [1/m] of a curve that was solved to its end."""
    if solution.status != Status.CONVERGED:
        raise RuntimeError(f"{solution.status.name} after {len(solution.readings)} loads")
    return solution.bend_angle / solution.arc_length * 1e3 / LINEAR_SCALE


def largest_deviation_pct(values: Floats, truth: Floats) -> float:
    """Return the largest relative difference [%]."""
    return 100.0 * float(np.max(np.abs(values / truth - 1.0)))


def machine() -> dict[str, object]:
    """Return what a time depends on beside the program."""
    return {
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "platform": platform.platform(),
        "python": platform.python_version(),
        "date": time.strftime("%Y-%m-%d"),
    }


def say(text: str) -> None:
    """Write one line of progress to standard error."""
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def interleaved(
    tasks: Mapping[str, Callable[[], object]],
    *,
    repeats: int,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, list[float]]:
    """Run all tasks in turn, as often as asked, and return their times [s].

    In turn, because whatever else the machine does then hits all of them alike; and on one thread
    the processor's time leaves out what others took. Children's time is not in it.
    """
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for turn in range(repeats):
        for name, task in tasks.items():
            start = clock()
            task()
            times[name].append(clock() - start)
            say(f"  {name}, run {turn + 1} of {repeats}: {times[name][-1]:.3g} s")
    return times


def median_ratio(numerator: list[float], denominator: list[float]) -> float:
    """Return the median of the ratios of runs that stood next to each other."""
    return statistics.median(a / b for a, b in zip(numerator, denominator, strict=True))
