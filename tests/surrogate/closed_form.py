"""An actuator in closed form, to stand in for finite element curves."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from bayesdeg.actuator.curve import CurveSolution, PathSamples
from bayesdeg.actuator.inputs import PAPER_THICKNESS, Inputs, Prediction
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate.design import space_filling
from bayesdeg.surrogate.fit import WHOLE, FitPlan, train
from bayesdeg.surrogate.regression import Prior
from bayesdeg.surrogate.scaling import TrainingRange
from bayesdeg.surrogate.terms import Family

LENGTH = 50.0
SPAN = TrainingRange()
COARSE_EXCESS = 0.04  # a coarse mesh is too stiff or too soft by a factor that depends on load
READ = (0, 1, *range(3, len(OUTPUTS)))  # bend angle, arc length, peak stretch, measures of strain
VOLUME, EMPTY = 2, 430.0  # of the half cavity at rest [mm³]
STEP = 1e-30  # imaginary: derivatives are exact to rounding


@dataclass(frozen=True)
class Box:
    """Range of the load and of softening, ln(C3/M) and ln of the paper's group."""

    load: float = SPAN.load
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


def limit_load(a, b):
    """q at which the closed form balloons, were the walls as thick as the base model's."""
    return 0.75 * math.exp(0.3 * a + 0.4 * (b + 1.0))


def slack_left(load, slack, paper):
    """Share of the slack that the load has not taken up; nothing of a tight paper."""
    if slack == 0.0:
        return 0.0 * load
    return slack / (slack + 2.9 * load / (paper + 30.0))


def softer_walls(m):
    """ln of the factor by which a load acts like more load."""
    return -0.06 * m["skin"] / 1.2 - 2.0 * (m["wall_factor"] - 1.0) + 0.9 * m["erosion"]


def cause_gain(m, g, phi, b):
    """What the other causes add to ``log_gain``; 0 for the paper that a base model assumes."""
    thickness = m["paper_thickness"] ** 2 - (PAPER_THICKNESS / 0.853) ** 2
    return (
        0.5 * g
        - (0.05 + 0.02 * b) * m["skin"]
        - 0.8 * thickness
        - 0.3 * phi
        + (2.0 + 0.5 * b) * m["paper_mismatch"]
        - 400.0 * m["gravity_up"] / (1.0 + 0.2887 * m["second_invariant_ratio"])
        + 300.0 * m["gravity_along"] * m["skin"]
    )


def readings_at(load, m, *, fine=True):
    """Bend angle, arc length and peak stretch, of real or complex inputs."""
    second = m["second_invariant_ratio"] / (2.0 * math.sqrt(3.0))
    modulus = 1.0 + second
    q, c3, paper = load / modulus, m["c3_ratio"] / modulus, m["paper_group"] / modulus
    w = softer_walls(m)
    x = q * np.exp(w)
    u, a, b, c = unit_coordinates(x, m["c2_ratio"] / modulus / np.sqrt(3.0 * c3), c3, paper)
    excess = 0.0 if fine else COARSE_EXCESS * (1.0 + 0.5 * u + 0.3 * b)
    effect = cause_gain(m, second / modulus, slack_left(q, m["paper_slack"], paper), b)
    # body forces and misfit bend and stretch the actuator at rest
    weight = np.sqrt(m["gravity_along"] ** 2 + m["gravity_up"] ** 2) / modulus
    misfit = np.sqrt(m["paper_mismatch"] ** 2)
    rest = 0.8 * m["paper_mismatch"] + 500.0 * m["gravity_up"] / modulus
    kappa = (rest + x * np.exp(log_gain(u, a, b, c) + excess + effect)) / LENGTH
    arc = LENGTH * (1.0 + arc_excess(x, u, a))
    pulled = stretch_excess(1.0, u, b) * np.exp(w + 0.5 * effect)
    return kappa * arc, arc, 1.0 + (q + misfit + 60.0 * weight) * pulled


def all_readings_at(load, m, *, fine=True):
    """The same with Weibull strains and equivalent stretches, each another function of the peak."""
    angle, arc, stretch = np.broadcast_arrays(*readings_at(load, m, fine=fine))
    strains = [
        measured + (0.5 + 0.1 * k) * (stretch - 1.0) * (1.0 + 0.2 * k * (stretch - 1.0))
        for k, measured in enumerate((0.0, 0.0, 0.0, 0.0, 1.0, 1.0))
    ]
    return np.column_stack([angle, arc, stretch, *strains])


def volume_at(load, m, *, fine=True):
    """Volume of the half cavity [mm³]: weight and misfit fill it a little at rest."""
    modulus = 1.0 + m["second_invariant_ratio"] / (2.0 * math.sqrt(3.0))
    q, c3 = load / modulus, m["c3_ratio"] / modulus
    x = q * np.exp(softer_walls(m))
    softening = m["c2_ratio"] / modulus / np.sqrt(3.0 * c3)
    u, a, b, _ = unit_coordinates(x, softening, c3, m["paper_group"] / modulus)
    excess = 0.0 if fine else 0.5 * COARSE_EXCESS * (1.0 + 0.3 * u)
    swelling = x * np.exp(0.2 + 0.4 * u - 0.2 * a - 0.1 * b + 0.1 * m["skin"] + excess)
    return EMPTY + 40.0 * m["paper_mismatch"] + 0.005 * LENGTH**3 * swelling


def limit_of(m):
    """p/C1 at which a material balloons."""
    modulus = 1.0 + m["second_invariant_ratio"] / (2.0 * math.sqrt(3.0))
    c3 = m["c3_ratio"] / modulus
    softening = m["c2_ratio"] / modulus / math.sqrt(3.0 * c3)
    _, a, b, _ = unit_coordinates(0.0, softening, c3, m["paper_group"] / modulus)
    return modulus * limit_load(a, b) * math.exp(-softer_walls(m))


def sample(curve, *, fine=True):
    """Answer one curve as the finite element model would, with exact derivatives."""
    m = vars(curve.material)
    limit = limit_of(m)
    loads = np.array([0.0, *(q for q in curve.loads if q < limit)])
    met = len(loads) <= len(curve.loads)
    readings = np.full((len(loads), len(OUTPUTS)), np.nan)
    readings[:, READ] = all_readings_at(loads, m, fine=fine)
    readings[:, VOLUME] = volume_at(loads, m, fine=fine)
    gradients = np.full((*readings.shape, len(INPUTS)), np.nan)
    for k, name in enumerate(INPUTS):
        load = loads + 1j * STEP if name == "load" else loads
        moved = m if name == "load" else m | {name: m[name] + 1j * STEP}
        if name == "paper_slack" and m[name] == 0.0:
            moved = m  # of a tight paper no use is made of this derivative
        gradients[:, READ, k] = all_readings_at(load, moved, fine=fine).imag / STEP
        gradients[:, VOLUME, k] = np.imag(volume_at(load, moved, fine=fine)) / STEP
    return PathSamples(
        loads=loads,
        readings=readings,
        gradients=gradients,
        status=Status.LIMIT_POINT if met else Status.CONVERGED,
        limit_load=limit if met else math.inf,
        iterations=3 * len(loads),
        solver="closed form",
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
    (0, 1),
    True,
    Family((4, 2, 2, 2), (2, 1, 1, 1), POWERS, (1, 0, 1, 0)),
    Family((2, 1, 1, 0), (1, 0, 0, 0), ONCE),
    Prior(noise=1e-3),
    Prior(noise=1e-3),
)
STRETCH = FitPlan(
    (2,),
    False,
    Family((3, 2, 2, 1), (1, 0, 1, 0), POWERS),
    Family((1, 1, 1, 0), (0, 0, 0, 0), (0,) * 9),
    Prior(noise=1e-2),
    Prior(noise=1e-2),
)
PLANS = (
    *(ANGLES, STRETCH),
    *(replace(ANGLES, outputs=(3, 4, 5, 6)), replace(STRETCH, outputs=(7, 8))),
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
    return train(
        *training_runs(96, 24),
        span=SPAN,
        length=LENGTH,
        mesh_error=mesh_error,
        record=RECORD,
        terms=replace(WHOLE, plans=PLANS, volume=replace(ANGLES, outputs=(9,))),
    )
