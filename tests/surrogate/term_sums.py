"""Small tables of terms, and the formulae of the map written out once more, slowly."""

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.surrogate.fit import summed
from bayesdeg.surrogate.scaling import CAUSES, GROUPS, NAMES, SECOND, TrainingRange
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.terms import Terms

SPAN = TrainingRange()
LARGEST = 14.0  # swelling that is trained
DEGREES = (6, 4, 4, 3, 2, 2, 2, 3, 2, 2, 2, 2, 2)
OPTIONAL = {
    "second_invariant": (0.0, 0.15),
    "skin": (0.05, 1.0),
    "paper_thickness": (0.05, 0.18),
    "paper_slack": (0.002, 0.04),
    "paper_mismatch": (-0.015, 0.025),
    "weight_along": (-12.0, 12.0),
    "weight_up": (-12.0, 12.0),
    "wall_factor": (0.85, 1.15),
    "erosion": (0.02, 0.25),
}
TOGETHER = 1e-3  # slack and mismatch of a paper up to which they may go together
COMPLIANCE = 0.006
END, GROWTH = 0.995, 2.0  # of the largest load, and growth up to which a mesh error is known


def random_terms(generator, count, outputs, *, size):
    """Terms of decaying size, the constant among them; each has at most two causes."""
    orders = np.zeros((count, 13), dtype=np.int64)
    for row in orders[1:]:
        axes = generator.choice(4, 2, replace=False)
        row[axes] = [generator.integers(0, DEGREES[a] + 1) for a in axes]
        if generator.random() < 0.6:
            causes = 4 + generator.choice(9, generator.integers(1, 3), replace=False)
            row[causes] = [generator.integers(1, DEGREES[c] + 1) for c in causes]
    orders = np.unique(orders, axis=0)
    falling = 1.0 / (1.0 + orders.sum(axis=1)) ** 2
    return Terms(orders, size * falling * generator.normal(size=(outputs, len(orders))))


def small_surrogate(*, count=120, seed=3, mesh_error=0.002):
    """An emulator of which about half of the materials balloon within the trained loads."""
    generator = np.random.default_rng(seed)
    error, load_error = (
        random_terms(generator, 40, k, size=size) for k, size in ((3, 0.5), (1, 2.0))
    )
    error.coefficients[:, 0] -= 11.0
    load_error.coefficients[:, 0] -= 11.0
    load = random_terms(generator, 60, 1, size=0.3)
    # Y_q falls by 1.2 ln(1 + t), more or less by the stiffness
    slopes = np.zeros((4, 13), dtype=np.int64)
    slopes[1, 0] = slopes[2, 0] = slopes[2, 2] = slopes[3, 2] = 1
    slope = 0.57 * math.log1p(LARGEST)
    known = Terms(slopes, np.array([[-slope, -slope, 0.9, 0.9]]))
    return Surrogate(
        length=50.0,
        compliance=COMPLIANCE,
        span=SPAN,
        load=summed(load, known),
        load_error=load_error,
        terms=random_terms(generator, count, 3, size=0.5),
        error=error,
        strains=random_terms(generator, count, 6, size=0.5),
        strain_error=random_terms(generator, 12, 6, size=0.5),
        mesh_error=mesh_error,
        record='{"design": "by hand"}',
    )


def taken(inputs, at):
    """The same inputs at some places of all arrays."""
    arrays = {n: v[at] for n, v in vars(inputs).items() if isinstance(v, np.ndarray)}
    return replace(inputs, **arrays)


def random_inputs(generator, shape, *, given=(), columns=1):
    """Materials of a shape with the named optional fields, and loads along further columns.

    Of a paper both slack and mismatched one of the two is small, in turn.
    """
    shape = (*shape, 1)
    c1 = generator.uniform(0.2, 0.6, shape)
    c3 = c1 * np.exp(generator.uniform(np.log(1e-3), np.log(0.1), shape))
    softening = generator.uniform(-0.55, 0.5, shape)
    scale = generator.uniform(0.75, 1.0, shape)
    paper = 1e3 * c1 * scale * np.exp(generator.uniform(np.log(5.0), np.log(900.0), shape))
    fields = {name: generator.uniform(*OPTIONAL[name], shape) for name in given}
    if {"paper_slack", "paper_mismatch"} <= set(fields):
        turn = np.arange(c1.size).reshape(shape) % 2 == 0
        little = generator.uniform(0.3 * TOGETHER, 0.9 * TOGETHER, shape)
        fields["paper_slack"] = np.where(turn, little, fields["paper_slack"])
        fields["paper_mismatch"] = np.where(turn, fields["paper_mismatch"], little)
    load = generator.uniform(0.02, 0.35, (*shape[:-1], columns))
    return Inputs(1e3 * c1 * load, c1, softening * np.sqrt(3 * c1 * c3), c3, scale, paper, **fields)


def value_of(inputs, name, index, default):
    field = getattr(inputs, name)
    return default if field is None else float(np.broadcast_to(field, index[0])[index[1]])


def groups_by_hand(inputs, index):
    """Load and groups of one point, from their definitions."""
    c1, c2, c3 = (value_of(inputs, name, index, None) for name in ("c1", "c2", "c3"))
    scale = value_of(inputs, "linear_scale", index, None)
    second = value_of(inputs, "second_invariant", index, 0.0)
    modulus = c1 + second / (2.0 * math.sqrt(3.0))
    weight = 1e-6 * scale / modulus
    return {
        "load": value_of(inputs, "pressure", index, None) * 1e-3 / modulus,
        "softening": c2 / math.sqrt(3.0 * c3 * modulus),
        "log_stiffening": math.log(c3 / modulus),
        "log_paper": math.log(
            value_of(inputs, "paper_stiffness", index, None) * 1e-3 / modulus / scale
        ),
        "second_invariant": second * SECOND / modulus,
        "skin": value_of(inputs, "skin", index, 0.0),
        "paper_thickness": value_of(inputs, "paper_thickness", index, 0.1) / scale,
        "paper_slack": value_of(inputs, "paper_slack", index, 0.0),
        "paper_mismatch": value_of(inputs, "paper_mismatch", index, 0.0),
        "gravity_along": value_of(inputs, "weight_along", index, 0.0) * weight,
        "gravity_up": value_of(inputs, "weight_up", index, 0.0) * weight,
        "wall_factor": value_of(inputs, "wall_factor", index, 1.0),
        "erosion": value_of(inputs, "erosion", index, 0.0) / scale,
    }


def slow_sum(terms, point):
    """Cosines and powers, one term after another; of points that are numbers or arrays."""
    total = 0.0
    for orders, a in zip(terms.orders, terms.coefficients.T, strict=True):
        factor = 1.0
        for axis in np.flatnonzero(orders):
            order, x = orders[axis], point[axis]
            factor = factor * (
                np.cos(order * np.arccos(np.clip(x, -1.0, 1.0))) if axis < 4 else x**order
            )
        total = total + np.multiply.outer(a, factor)
    return np.zeros(len(terms.coefficients)) + total if np.ndim(total) < 2 else total


def point_by_hand(at, t):
    """Coordinates of a material at a swelling, or several."""
    material = [2 * (at[g.name] - g.low) / (g.high - g.low) - 1 for g in GROUPS[:3]]
    causes = {}
    for group in CAUSES:
        if group.name == "paper_thickness":
            causes[group.name] = (at[group.name] ** 2 - group.neutral**2) / (
                group.high**2 - group.neutral**2
            )
        else:
            size = max(group.high - group.neutral, group.neutral - group.low)
            causes[group.name] = (at[group.name] - group.neutral) / size
    strain = 2.9 * t / (math.exp(at["log_paper"]) + 30.0)
    slack = at["paper_slack"]
    causes["paper_slack"] = slack / (slack + strain) if slack > 0 else 0.0 * t
    return [2 * np.log1p(t) / math.log1p(LARGEST) - 1, *material, *causes.values()]


def load_by_hand(surrogate, at, t):
    """p/M at a swelling."""
    return t * np.exp(slow_sum(surrogate.load, point_by_hand(at, t))[0])


def first_limit(surrogate, at):
    """Swelling and load of the first maximum below the largest swelling; inf without one."""
    grid = np.expm1(np.linspace(0.0, math.log1p(LARGEST), 2001))
    loads = load_by_hand(surrogate, at, grid)
    falls = np.flatnonzero(np.diff(loads) < 0.0)
    if len(falls) == 0:
        return math.inf, math.inf
    k = int(falls[0])
    ends = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, 2000)])
    found = minimize_scalar(
        lambda t: -load_by_hand(surrogate, at, t), bounds=ends, options={"xatol": 1e-9}
    )
    return found.x, -found.fun


def swelling_by_hand(surrogate, at, load, last):
    """Swelling below the last one at a load."""
    return brentq(
        lambda t: load_by_hand(surrogate, at, t) - load, 0.0, last, xtol=1e-300, rtol=1e-15
    )


def limit_by_hand(surrogate, at):
    """p/M at which a material balloons, and its relative standard error, that at the end."""
    at_limit, limit = first_limit(surrogate, at)
    largest = float(SPAN.largest_load(np.array(point_by_hand(at, 0.0)[2])))
    if limit > largest:
        return math.inf, math.inf
    t = swelling_by_hand(surrogate, at, END * limit, at_limit)
    of_load = math.exp(slow_sum(surrogate.load_error, point_by_hand(at, t))[0])
    return limit, math.sqrt(of_load + (surrogate.mesh_error / GROWTH) ** 2)


def predict_by_hand(surrogate, at, scale):
    """The outputs of one point, their standard errors, and whether it is allowed."""
    inside = all(g.low <= at[g.name] <= g.high for g in GROUPS) and (
        at["paper_slack"] <= TOGETHER or abs(at["paper_mismatch"]) <= TOGETHER
    )
    load = at["load"]
    largest = float(SPAN.largest_load(np.array(point_by_hand(at, 0.0)[2])))
    at_limit, limit = first_limit(surrogate, at) if inside else (math.inf, math.inf)
    last = min(at_limit, LARGEST)
    end = min(END * limit, largest, load_by_hand(surrogate, at, last))
    if not (inside and 0 <= load <= end):
        return {"allowed": False}
    t = swelling_by_hand(surrogate, at, load, last)

    def logarithms(ln_t):
        point = point_by_hand(at, math.exp(ln_t))
        return slow_sum(surrogate.terms, point)[0], slow_sum(surrogate.load, point)[0]

    h, ln_t = 1e-4, math.log(t)
    (bent, loaded), (less_bent, less) = logarithms(ln_t + h), logarithms(ln_t - h)
    growth = (1 + (bent - less_bent) / (2 * h)) / (1 + (loaded - less) / (2 * h))
    point = point_by_hand(at, t)
    y = slow_sum(surrogate.terms, point)
    of_load = math.exp(slow_sum(surrogate.load_error, point)[0])
    mesh = surrogate.mesh_error * max(1.0, growth / GROWTH)
    share = [
        math.sqrt(math.exp(e) + growth**2 * of_load + mesh**2)
        for e in slow_sum(surrogate.error, point)
    ]
    offset = abs(at["paper_mismatch"]) + 60 * math.hypot(at["gravity_along"], at["gravity_up"])
    curvature = t * math.exp(y[0]) / (scale * surrogate.length) * 1e3
    angle = math.degrees(t * math.exp(y[1]))
    stretch = (t + offset) * math.exp(y[2])
    return {
        "allowed": True,
        "curvature": curvature,
        "bend_angle": angle,
        "peak_stretch": 1 + stretch,
        "slope": curvature * growth,
        "sd": curvature * share[0],
        "bend_angle_sd": angle * share[1],
        "peak_stretch_sd": stretch * share[2],
    }


assert len(DEGREES) == len(NAMES)
