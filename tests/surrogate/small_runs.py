"""Runs of small actuators, and made-up solutions of runs where none need be solved."""

import numpy as np

from bayesdeg.actuator.curve import Curve, CurveSolution, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, Resolution
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.solutions import Kind, Run

ONE_CHAMBER = Geometry(Dimensions(length=14.0, chambers=1))
TWO_CHAMBERS = Geometry(Dimensions(length=20.0, chambers=2))
COARSEST = Resolution(9.0, 9.0, 9.0)


def curves(count, seed=3):
    """Stable materials, and loads dense where the curve starts."""
    rng = np.random.default_rng(seed)
    drawn = []
    for softening, stiffening, paper in rng.random((count, 3)).tolist():
        c3 = 0.002 * 50.0**stiffening
        material = MaterialGroups(
            c2_ratio=(softening - 0.5) * float(np.sqrt(3.0 * c3)),
            c3_ratio=c3,
            paper_group=10.0 * 20.0**paper,
            paper_thickness=0.12,
        )
        loads = 0.4 * (np.arange(1, 15) / 14.0) ** 1.3
        drawn.append(Curve(tuple(loads.tolist()), material))
    return drawn


def runs(count, seed=3, kind=Kind.CURVE):
    """Runs of one chamber on the coarsest mesh."""
    return [Run(ONE_CHAMBER, COARSEST, curve, kind) for curve in curves(count, seed)]


def real_runs(count):
    """Of both kinds: most some fifteenth of a second each, and two of a larger actuator."""
    small = [Run(ONE_CHAMBER, COARSEST, curve, kind) for curve in curves(count) for kind in Kind]
    large = [Run(TWO_CHAMBERS, COARSE, curves(1)[0], kind) for kind in Kind]
    return [*small[:count], *large, *small[count:]]


def made_up(run, *, status=Status.CONVERGED, points=None, seed=1):
    """Return numbers that depend on the run and on the seed, in the shapes of a solution."""
    rng = np.random.default_rng([seed, int(run.key()[:12], 16)])
    n = len(run.curve.loads) if points is None else points
    readings = rng.random((n, len(OUTPUTS)))
    if run.kind is Kind.CURVE:
        rest, rates = rng.random((2, len(OUTPUTS))), rng.random(readings.shape)
        return CurveSolution(readings, rates, *rest, status, np.inf, 23, "pypardiso")
    gradients = rng.random((n, len(OUTPUTS), len(INPUTS)))
    loads = np.arange(float(n))
    return PathSamples(loads, readings, gradients, status, 0.7, 23, "pypardiso")


def assert_same(left, right):
    """Two solutions agree in every bit."""
    assert type(left) is type(right)
    for name, value in vars(left).items():
        other = getattr(right, name)
        assert type(value) is type(other)
        if isinstance(value, np.ndarray):
            assert (value.dtype, value.shape) == (other.dtype, other.shape)
            assert value.tobytes() == other.tobytes()
        else:
            assert value == other


def assert_all_same(left, right):
    """Two lists of solutions agree in every bit."""
    for a, b in zip(left, right, strict=True):
        assert_same(a, b)


def contents(folder):
    """The bytes of every solution in a store."""
    return {path.name: path.read_bytes() for path in folder.glob("*.npz")}
