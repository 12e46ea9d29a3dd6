"""A campaign of a few real finite element runs, below a second each."""

import json
from dataclasses import asdict, replace

from bayesdeg.actuator.curve import MODEL_VERSION
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import complete, runs
from bayesdeg.surrogate.kept import FIT_VERSION, Recipe
from bayesdeg.surrogate.workers import solve
from tests.surrogate.closed_form import trained

TABLE = "[actuator]\nlength = 14.0\nchambers = 1\n"
GEOMETRY = Geometry(Dimensions(length=14.0, chambers=1))
COARSE, FINE = Resolution(8.0, 8.0, 8.0), Resolution(5.0, 8.0, 8.0)
RECIPE = Recipe(coarse_mesh=COARSE, fine_mesh=FINE, coarse_runs=6, fine_runs=2)
ACCURACY = {"curvature": {"rms_pct": 0.25, "p95_pct": 0.5, "max_pct": 1.25, "coverage_90": 0.91}}


SOLVED = {}


def solve_once(run, key, timeout):
    """`solve`, which solves a curve once for all tests of this process."""
    if (key, timeout) not in SOLVED:
        SOLVED[key, timeout] = solve(run, key, timeout)
    return SOLVED[key, timeout]


def emulator(geometry=GEOMETRY, *, version=MODEL_VERSION):
    """An emulator that says that it is of this geometry, though it stands for a closed form."""
    record = {
        "design": "closed form",
        "model_version": version,
        "fit_version": FIT_VERSION,
        "coarse_curves": 6,
        "fine_curves": 2,
        "dimensions_mm": asdict(geometry.dimensions),
        "accuracy": ACCURACY,
    }
    return replace(trained(), length=geometry.dimensions.length, record=json.dumps(record))


def build(geometry, store, *, recipe, executor, timeout, on_run, design=None):
    """Solve the campaign in earnest; in place of training on so few curves, take a closed form."""
    complete(
        runs(geometry, recipe, design), store, executor=executor, timeout=timeout, on_run=on_run
    )
    return emulator(geometry)
