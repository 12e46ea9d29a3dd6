"""An actuator in closed form, to stand in for finite element curves."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from bayesdeg.actuator.curve import CurveSolution
from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.emulator.campaign import space_filling
from bayesdeg.emulator.scaling import TrainingBox
from bayesdeg.emulator.training import train

LENGTH = 50.0
BOX = TrainingBox()
COARSE_EXCESS = 0.04  # a coarse mesh is too stiff or too soft by a factor that depends on load


def unit_coordinates(load, softening, c3_ratio, paper):
    """Place load and groups on [-1, 1], written out once more."""
    raw = (softening, np.log(c3_ratio), np.log(paper))
    z = [
        (2.0 * value - low - high) / (high - low)
        for value, low, high in zip(raw, BOX.lower, BOX.upper, strict=True)
    ]
    return 2.0 * load / BOX.load - 1.0, *z


def log_gain(u, a, b, c):
    """ln(κ s L / q)."""
    return 0.7 + 0.25 * u + 0.1 * u**2 - 0.15 * a - 0.2 * b - 0.1 * c + 0.05 * u * b + 0.03 * a * b


def growth(load, u, b):
    """d ln κ / d ln q, of ``log_gain`` by hand."""
    return 1.0 + 2.0 * load / BOX.load * (0.25 + 0.2 * u + 0.05 * b)


def stretch_excess(load, u, b):
    return load * np.exp(0.1 + 0.3 * u + 0.1 * b)


def arc_excess(load, u, a):
    return load * (0.05 + 0.02 * u + 0.01 * a)


def limit_load(a, b):
    """p/C1 at which the closed form balloons."""
    return 0.9 * math.exp(0.5 * a + 0.6 * (b + 1.0))


def solve(curve, *, fine=True):
    """Answer one curve as the finite element model would."""
    m = curve.material
    softening = m.c2_ratio / math.sqrt(3.0 * m.c3_ratio)
    q = np.array(curve.loads)
    u, a, b, c = unit_coordinates(q, softening, m.c3_ratio, m.paper_group)
    limit = limit_load(a, b)
    met = limit <= q[-1]
    kept = q < limit
    q, u = q[kept], u[kept]
    excess = 0.0 if fine else COARSE_EXCESS * (1.0 + 0.5 * u + 0.3 * b)
    arc = LENGTH * (1.0 + arc_excess(q, u, a))
    kappa = q * np.exp(log_gain(u, a, b, c) + excess) / LENGTH
    return solution(
        kappa * arc,
        arc,
        1.0 + stretch_excess(q, u, b),
        status=Status.LIMIT_POINT if met else Status.CONVERGED,
        limit_load=limit if met else math.inf,
    )


def solution(angle, arc, stretch, *, status=Status.CONVERGED, limit_load=math.inf):
    """A solved curve of these readings; what no emulator uses is left out."""
    readings = np.full((len(angle), len(OUTPUTS)), np.nan)
    readings[:, 0], readings[:, 1], readings[:, 3] = angle, arc, stretch
    rest = np.full(len(OUTPUTS), np.nan)
    rest[[0, 1, 3]] = 0.0, LENGTH, 1.0
    return CurveSolution(
        readings=readings,
        rates=np.full_like(readings, np.nan),
        rest=rest,
        rest_rates=np.full_like(rest, np.nan),
        status=status,
        limit_load=limit_load,
        iterations=3 * len(angle),
        solver="closed form",
    )


@dataclass(frozen=True)
class ClosedFormMap:
    """The same actuator as a forward map, with a standard error of its own."""

    relative_error: float = 0.004

    def __call__(self, inputs: Inputs) -> Prediction:
        assert inputs.reference_pressure is None
        with np.errstate(all="ignore"):
            q = inputs.pressure / (1e3 * inputs.c1)
            softening = inputs.c2 / np.sqrt(3.0 * inputs.c1 * inputs.c3)
            paper = inputs.paper_stiffness / (1e3 * inputs.c1 * inputs.linear_scale)
            u, a, b, c = unit_coordinates(q, softening, inputs.c3 / inputs.c1, paper)
            kappa = q * np.exp(log_gain(u, a, b, c)) / LENGTH
            curvature = 1e3 * kappa / inputs.linear_scale
            shape = curvature.shape
            angle = np.degrees(kappa * LENGTH * (1.0 + arc_excess(q, u, a)))
            stretch = 1.0 + stretch_excess(q, u, b)
            slope = curvature * growth(q, u, b)
        outside = ~np.isfinite(curvature) | (q > BOX.load)
        return Prediction(
            curvature=np.where(outside, np.nan, curvature),
            bend_angle=np.broadcast_to(angle, shape),
            peak_stretch=np.broadcast_to(stretch, shape),
            slope=np.where(outside, np.nan, slope),
            sd=self.relative_error * np.where(outside, np.nan, curvature),
            status=np.where(outside, int(Status.OUTSIDE_TRAINING), 0),
        )


@cache
def trained(*, mesh_error=0.0):
    """Train a small surrogate on the closed form: 64 coarse curves, 24 fine ones."""
    curves = space_filling(BOX, 64, seed=5)
    few = curves[:24]
    return train(
        (curves, [solve(curve, fine=False) for curve in curves]),
        (few, [solve(curve) for curve in few]),
        box=BOX,
        length=LENGTH,
        mesh_error=mesh_error,
        record={"design": "closed form"},
    )
