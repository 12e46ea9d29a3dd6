"""An actuator in closed form, to stand in for finite element curves."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import brentq
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.curve import CurveSolution, PathSamples
from bayesdeg.actuator.inputs import PAPER_THICKNESS, Inputs, Prediction
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate.design import space_filling
from bayesdeg.surrogate.fit import WHOLE, FitPlan, train
from bayesdeg.surrogate.regression import ANGLES as ANGLE_OUTPUTS
from bayesdeg.surrogate.regression import EQUIVALENT, LOADS, WEIBULL, Prior
from bayesdeg.surrogate.regression import STRETCH as STRETCH_OUTPUTS
from bayesdeg.surrogate.scaling import TrainingRange
from bayesdeg.surrogate.terms import Family

LENGTH = 50.0
SPAN = TrainingRange()
COARSE_EXCESS = 0.04  # a coarse mesh is too stiff or too soft by a factor that depends on swelling
STEP = 1e-30  # imaginary: derivatives are exact to rounding


@dataclass(frozen=True)
class Box:
    """Range of the load and of softening, ln(C3/M) and ln of the paper's group."""

    load: float = 0.96
    lower: tuple[float, ...] = tuple(SPAN.lower[:3].tolist())
    upper: tuple[float, ...] = tuple(SPAN.upper[:3].tolist())


BOX = Box()


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


# ---- the same kind of actuator by its swelling, with all causes

LARGEST, TURN = 15.0, 1.9  # of 1 + t, and where a curve bends over in it
FILLED, EMPTY = 0.006, 430.0  # swept volume over L³ t; that of the half cavity at rest [mm³]
POINTS = 13  # equilibria of a path
BEYOND, FURTHEST = 1.1, 20.0  # swelling at which a path stops: over that at its limit, and at most


@dataclass(frozen=True)
class Place:
    """Groups over M, the first three also on [-1, 1], and effects of causes."""

    modulus: complex
    paper: complex
    second: complex
    a: complex
    b: complex
    c: complex
    weight: complex

    @classmethod
    def of(cls, m):
        second = m["second_invariant_ratio"] / (2.0 * math.sqrt(3.0))
        modulus = 1.0 + second
        c3, paper = m["c3_ratio"] / modulus, m["paper_group"] / modulus
        _, a, b, c = unit_coordinates(0.0, m["c2_ratio"] / modulus / np.sqrt(3.0 * c3), c3, paper)
        weight = size_of(m["gravity_along"], m["gravity_up"]) / modulus
        return cls(modulus, paper, second / modulus, a, b, c, weight)


def size_of(*parts):
    """Length of a vector, without a derivative where it vanishes."""
    square = sum(part**2 for part in parts)
    return np.sqrt(square) if np.real(square) > 0.0 else 0.0


def softer_walls(m):
    """ln of the factor by which a load acts like more load."""
    return -0.06 * m["skin"] / 1.2 - 2.0 * (m["wall_factor"] - 1.0) + 0.9 * m["erosion"]


def slack_left(t, m, place):
    """Share of the slack that swelling has not taken up; nothing of a tight paper."""
    if m["paper_slack"] == 0.0:
        return 0.0 * t
    return m["paper_slack"] / (m["paper_slack"] + 2.9 * t / (place.paper + 30.0))


def cause_gain(t, m, place):
    """What causes add to ln(κ s L/t); 0 for the paper that a base model assumes."""
    thickness = m["paper_thickness"] ** 2 - (PAPER_THICKNESS / 0.853) ** 2
    return (
        0.5 * place.second
        - (0.05 + 0.02 * place.b) * m["skin"]
        - 0.8 * thickness
        - 0.3 * slack_left(t, m, place)
        + (2.0 + 0.5 * place.b) * m["paper_mismatch"]
        - 400.0 * m["gravity_up"] / (1.0 + 0.2887 * m["second_invariant_ratio"])
        + 300.0 * m["gravity_along"] * m["skin"]
    )


def load_at(t, m, *, fine=True):
    """p/C1 at a swelling: of soft materials it has a largest value, of stiff ones none."""
    place = Place.of(m)
    v, stiff = np.log(1.0 + t / TURN), 1.0 + place.b
    y = (
        0.15 * place.a
        + 0.2 * place.b
        + 0.05 * place.c
        - (1.3 - 0.1 * place.a) * v
        + (0.012 * stiff + 0.04 * stiff**2) * v**2
        - softer_walls(m)
        - 0.15 * slack_left(t, m, place)
        + 0.3 * place.second
    )
    if not fine:
        y = y + 0.5 * COARSE_EXCESS * (1.0 + 0.4 * v - 0.2 * place.b)
    return place.modulus * t * np.exp(y)


def readings_at(t, m, *, fine=True):
    """All readings at swellings (n,), of real or complex inputs, (n, n_outputs)."""
    place = Place.of(m)
    u, v = 2.0 * np.log(1.0 + t) / math.log(LARGEST) - 1.0, np.log(1.0 + t / TURN)
    excess = 0.0 if fine else COARSE_EXCESS * (1.0 + 0.3 * u + 0.3 * place.b)
    effect = cause_gain(t, m, place)
    # body forces and misfit bend and stretch the actuator at rest
    rest = 0.8 * m["paper_mismatch"] + 500.0 * m["gravity_up"] / place.modulus
    bent = 0.25 - 0.35 * u + 0.05 * u**2 - 0.15 * place.a + 0.1 * place.b - 0.1 * place.c
    bent = bent + 0.05 * u * place.b + 0.03 * place.a * place.b + excess + effect
    kappa = (rest + t * np.exp(bent)) / LENGTH
    arc = LENGTH * (1.0 + (0.08 + 0.02 * place.a) * v)
    offset = size_of(m["paper_mismatch"]) + 60.0 * place.weight
    pulled = np.exp(-0.6 - 0.5 * u + 0.1 * place.b + 0.5 * effect)
    stretch = 1.0 + (t + offset) * pulled
    # each measure of strain is another function of the peak
    strains = [
        measured + (0.5 + 0.1 * k) * (stretch - 1.0) * (1.0 + 0.02 * k * (stretch - 1.0))
        for k, measured in enumerate((0.0, 0.0, 0.0, 0.0, 1.0, 1.0))
    ]
    volume = EMPTY + 40.0 * m["paper_mismatch"] + FILLED * LENGTH**3 * t
    return np.column_stack(np.broadcast_arrays(kappa * arc, arc, volume, stretch, *strains))


def largest_of(m, *, fine=True):
    """Swelling and load at which a material balloons, found by brute force; inf where it never."""
    grid = np.expm1(np.linspace(0.0, math.log(40.0), 400))
    falls = np.flatnonzero(np.diff(load_at(grid, m, fine=fine)) < 0.0)
    if len(falls) == 0:
        return math.inf, math.inf
    low, high = grid[max(falls[0] - 1, 0)], grid[falls[0] + 2]

    def rate(t):
        return float(np.imag(load_at(t + 1j * STEP, m, fine=fine)))

    t = brentq(lambda t: rate(t) / STEP, low, high, xtol=1e-14, rtol=1e-14)
    return t, float(load_at(t, m, fine=fine))


def swelling_at(load, m, *, fine=True):
    """Swelling of the rising part at a load below the largest, by brute force."""
    end = min(largest_of(m, fine=fine)[0], 1e9)
    return brentq(lambda t: load_at(t, m, fine=fine) - load, 0.0, end, xtol=1e-300, rtol=1e-15)


def sample(curve, *, fine=True):
    """Answer one curve as the finite element model would, with exact derivatives.

    The path goes on to a tenth beyond the swelling at which it balloons.
    """
    m = vars(curve.material)
    at_limit, limit = largest_of(m, fine=fine)
    met = limit < curve.loads[-1]
    end = BEYOND * at_limit if met else swelling_at(curve.loads[-1], m, fine=fine)
    end = min(end, FURTHEST)
    t = np.expm1(math.log1p(end) * np.linspace(0.0, 1.0, POINTS) ** 1.2)
    values = both_at(t, m, fine=fine)
    along = both_at(t + 1j * STEP, m, fine=fine).imag / STEP
    gradients = np.empty((POINTS, len(OUTPUTS), len(INPUTS)))
    by_load = along[:, 1:] / along[:, :1]
    for k, name in enumerate(INPUTS):
        if name == "load":
            gradients[:, :, k] = by_load
            continue
        # of a tight paper no use is made of the derivative by its slack
        is_tight = name == "paper_slack" and m[name] == 0.0
        moved = m if is_tight else m | {name: m[name] + 1j * STEP}
        change = both_at(t, moved, fine=fine).imag / STEP
        gradients[:, :, k] = change[:, 1:] - by_load * change[:, :1]
    return PathSamples(
        loads=values[:, 0],
        readings=values[:, 1:],
        gradients=gradients,
        status=Status.LIMIT_POINT if met else Status.CONVERGED,
        limit_load=limit if met else math.inf,
        iterations=3 * POINTS,
        solver="closed form",
    )


def both_at(t, m, *, fine=True):
    """Load and readings at swellings, (n, 1 + n_outputs)."""
    load = load_at(t, m, fine=fine)
    return np.column_stack([load, readings_at(t, m, fine=fine)])


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
    """The base model's actuator as a forward map, with a standard error of its own."""

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
            bend_angle_sd=self.relative_error * np.broadcast_to(angle, shape),
            peak_stretch_sd=self.relative_error * np.broadcast_to(stretch - 1.0, shape),
            status=np.where(outside, int(Status.OUTSIDE_TRAINING), 0),
        )


POWERS = (1, 2, 2, 2, 1, 1, 2, 2, 2)
ONCE = (1, 1, 0, 1, 1, 1, 1, 1, 1)
ANGLES = FitPlan(
    ANGLE_OUTPUTS,
    True,
    Family((5, 2, 2, 2), (3, 1, 1, 1), POWERS, (1, 0, 1, 0)),
    Family((2, 1, 1, 0), (1, 0, 0, 0), ONCE),
    Prior(noise=1e-3),
    Prior(noise=1e-3),
)
STRETCH = FitPlan(
    STRETCH_OUTPUTS,
    False,
    Family((3, 2, 2, 1), (1, 0, 1, 0), POWERS),
    Family((1, 1, 1, 0), (0, 0, 0, 0), (0,) * 9),
    Prior(noise=1e-2),
    Prior(noise=1e-2),
)
LOAD = replace(
    ANGLES,
    outputs=LOADS,
    family=Family((8, 3, 4, 2), (4, 1, 1, 1), POWERS, (1, 0, 1, 0)),
    correction=Family((3, 1, 2, 1), (1, 0, 0, 0), ONCE),
)
PLANS = (
    *(ANGLES, STRETCH),
    *(replace(ANGLES, outputs=WEIBULL), replace(STRETCH, outputs=EQUIVALENT)),
    LOAD,
)
RECORD = {"design": "closed form"}


def training_runs(coarse, fine, *, seed=5):
    """Curves of a design and what was solved of them, on either mesh."""
    curves = space_filling(SPAN, coarse, seed=seed)
    few = curves[:fine]
    return (curves, [sample(curve, fine=False) for curve in curves]), (
        few,
        [sample(curve) for curve in few],
    )


@cache
def trained(*, mesh_error=0.0):
    """Train a small surrogate on the closed form: 96 coarse curves, 24 fine ones."""
    with threadpool_limits(1):
        return train(
            *training_runs(96, 24),
            span=SPAN,
            length=LENGTH,
            mesh_error=mesh_error,
            record=RECORD,
            terms=replace(WHOLE, plans=PLANS),
        )
