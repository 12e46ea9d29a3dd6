"""Small tables of terms, and the formulae of the map written out once more, slowly."""

import math
from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.surrogate.scaling import CAUSES, GROUPS, NAMES, SECOND, TrainingRange
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.terms import Terms

SPAN = TrainingRange()
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
LIMIT_ERRORS = 2.0  # standard errors that are kept away from a limit


def random_terms(generator, count, outputs, *, size, with_load=True):
    """Terms of decaying size, the constant among them; each has at most two causes."""
    orders = np.zeros((count, 13), dtype=np.int64)
    for row in orders[1:]:
        axes = generator.choice(4, 2, replace=False)
        row[axes] = [generator.integers(0, DEGREES[a] + 1) for a in axes]
        if generator.random() < 0.6:
            causes = 4 + generator.choice(9, generator.integers(1, 3), replace=False)
            row[causes] = [generator.integers(1, DEGREES[c] + 1) for c in causes]
    if not with_load:
        orders[:, 0] = 0
    orders = np.unique(orders, axis=0)
    falling = 1.0 / (1.0 + orders.sum(axis=1)) ** 2
    return Terms(orders, size * falling * generator.normal(size=(outputs, len(orders))))


def small_surrogate(*, count=120, seed=3, mesh_error=0.002):
    generator = np.random.default_rng(seed)
    error = random_terms(generator, 12, 3, size=0.5)
    error.coefficients[:, 0] -= 11.0
    limit = random_terms(generator, 12, 2, size=0.2, with_load=False)
    limit.coefficients[0, 0] -= 0.3
    limit.coefficients[1] *= 0.6
    limit.coefficients[1, 0] = 0.03
    return Surrogate(
        length=50.0,
        span=SPAN,
        terms=random_terms(generator, count, 3, size=0.5),
        error=error,
        limit=limit,
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
    """Cosines and powers, one term after another."""
    total = np.zeros(len(terms.coefficients))
    for orders, a in zip(terms.orders, terms.coefficients.T, strict=True):
        factor = 1.0
        for axis, (order, x) in enumerate(zip(orders, point, strict=True)):
            if axis < 4:
                x = min(max(x, -1.0), 1.0)
                factor *= math.cos(order * math.acos(x))
            else:
                factor *= x**order
        total += a * factor
    return total


def point_by_hand(at, warp, largest_warped=1.5):
    """Coordinates of one point; ``warp`` of scaled causes by name."""
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
    exponent = sum(a * causes[name] + b * causes[name] ** 2 for name, (a, b) in warp.items())
    strain = 2.9 * at["load"] / (math.exp(at["log_paper"]) + 30.0)
    slack = at["paper_slack"]
    by_range = list(causes.values())
    causes["paper_slack"] = slack / (slack + strain) if slack > 0 else 0.0
    x = at["load"] * math.exp(exponent)
    return [2 * x / largest_warped - 1, *material, *causes.values()], exponent, x, by_range


def predict_by_hand(surrogate, at, scale, warp):
    """The outputs of one point, their standard errors, and whether it is allowed."""
    point, exponent, x, by_range = point_by_hand(at, warp)
    y = slow_sum(surrogate.terms, point)
    share = [
        math.hypot(math.exp(e / 2), surrogate.mesh_error) for e in slow_sum(surrogate.error, point)
    ]
    log_limit, limit_error = slow_sum(surrogate.limit, [0.0, *point[1:4], *by_range])
    safe = math.exp(log_limit - LIMIT_ERRORS * limit_error)
    load = at["load"]
    offset = abs(at["paper_mismatch"]) + 60 * math.hypot(at["gravity_along"], at["gravity_up"])
    curvature = load * math.exp(exponent + y[0]) / (scale * surrogate.length) * 1e3
    angle = math.degrees(load * math.exp(exponent + y[1]))
    stretch = (load + offset) * math.exp(exponent + y[2])
    inside = all(g.low <= at[g.name] <= g.high for g in GROUPS) and (
        at["paper_slack"] <= TOGETHER or abs(at["paper_mismatch"]) <= TOGETHER
    )
    largest = float(SPAN.largest_load(np.array(point[2])))
    return {
        "allowed": inside and 0 <= load <= largest and x <= min(safe, 1.5),
        "curvature": curvature,
        "bend_angle": angle,
        "peak_stretch": 1 + stretch,
        "sd": curvature * share[0],
        "bend_angle_sd": angle * share[1],
        "peak_stretch_sd": stretch * share[2],
        "limit": math.exp(log_limit - exponent),
        "limit_error": limit_error,
    }


assert len(DEGREES) == len(NAMES)
