"""The finite element kernels are compiled beside the fits, where a machine has not done so before.

A run solves its actuator for a picture at the end. On a fresh installation the kernels take longer
to compile than anything that is solved with them; numba keeps them for later processes.
"""

import multiprocessing
import os
from pathlib import Path

import numpy as np

from bayesdeg.actuator import kernels
from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import Material
from bayesdeg.actuator.status import COARSE
from bayesdeg.data.settings import Dimensions
from bayesdeg.emulator.workers import deaf_to_interrupts, end_with_parent
from bayesdeg.pipeline.deformed import Case, solve

BEHIND = 10  # niceness: the fits go first


def is_compiled(cache: Path) -> bool:
    """Return whether numba's cache in a folder holds the largest of the kernels."""
    return any(cache.glob("kernels.solid-*.nbi"))


def compile_beside() -> None:
    """Compile the kernels in a process of their own, behind all others, unless that was done."""
    if not is_compiled(Path(kernels.solid.stats.cache_path)):
        context = multiprocessing.get_context("spawn")
        with deaf_to_interrupts():
            context.Process(target=compile_kernels, daemon=True).start()


def compile_kernels() -> None:
    """Solve a coarse actuator with paper under a small load: all that a picture needs."""
    end_with_parent()
    if hasattr(os, "nice"):
        os.nice(BEHIND)
    load = 1e-3
    material = Material(c2_ratio=0.0, c3_ratio=0.0, paper_group=1.0)
    case = Case(0.0, np.array([1.0]), Curve((load,), material), linear_scale=1.0, c1=1.0)
    solve(Geometry(Dimensions()), COARSE, case)
