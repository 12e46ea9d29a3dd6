"""Coordinates in which the map is nearly a polynomial, and their derivatives by the groups.

Thin walls act like more pressure: the load enters as x = q e^W, with W the logarithm of how much
a cause changes the first slope of the curve. Slack paper is felt until the pressure has stretched
it, by about e = k q/(P + P₀), P being the paper's group: it enters as φ = s/(s + e), which is 0
for a tight paper and 1 for one that is not felt at all.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.emulator.scaling import CAUSES, MATERIAL, NAMES, TrainingRange

Floats = NDArray[np.float64]

N_MATERIAL, N_CAUSES = len(MATERIAL), len(CAUSES)
SLACK = NAMES.index("paper_slack")
THICKNESS = NAMES.index("paper_thickness")
PAPER = NAMES.index("log_paper")
SECOND_INVARIANT = NAMES.index("second_invariant")
MISMATCH = NAMES.index("paper_mismatch")
ALONG, UP = NAMES.index("gravity_along"), NAMES.index("gravity_up")
LARGEST_WARPED = 1.5  # range of x [–]
STRAIN, GIVE = 2.9, 30.0  # k [mm] and P₀ [mm] of the paper's strain
TAKEN_UP = 1e-3  # slack and mismatch up to which they may go together [–]
ROOM = 1e-9  # share of a range that rounding may overstep it by
SAGGING = 60.0  # strain at rest over the group of gravity [mm]

# first and second order of W in the scaled causes, from first slopes of the default geometry
WARP = {
    "second_invariant": (0.0, 0.0),
    "skin": (-0.05, 0.0),
    "wall_factor": (-0.42, 0.0),
    "erosion": (0.4, 0.03),
}
_FIRST = np.array([WARP.get(cause.name, (0.0, 0.0))[0] for cause in CAUSES])
_SECOND = np.array([WARP.get(cause.name, (0.0, 0.0))[1] for cause in CAUSES])


@dataclass(frozen=True)
class Coordinates:
    """Points as polynomials take them.

    Parameters
    ----------
    points : array, shape (n, 13)
        Warped load and material on [−1, 1]; causes scaled to at most 1 in size, 0 if neutral; in
        the order of ``NAMES``.
    warp : array, shape (n,)
        W [–].
    jacobian : array, shape (n, 13, 13)
        Derivatives of the points by load and groups, ``jacobian[:, point, group]``.
    warp_gradient : array, shape (n, 13)
        Derivatives of W by load and groups.
    """

    points: Floats
    warp: Floats
    jacobian: Floats
    warp_gradient: Floats


def scaled_material(values: Floats, span: TrainingRange) -> Floats:
    """Map the material's groups (…, 3) from their ranges to [−1, 1]."""
    low, high = span.lower[:N_MATERIAL], span.upper[:N_MATERIAL]
    scaled: Floats = (2.0 * values - (low + high)) / (high - low)
    return scaled


def scaled_cause(name: str, value: Floats) -> tuple[Floats, Floats]:
    """Return a cause's group scaled to at most 1 in size and 0 if neutral, and its derivative.

    The paper's thickness enters by its square, as its bending stiffness does.
    """
    group = next(cause for cause in CAUSES if cause.name == name)
    if name == "paper_thickness":
        size = group.high**2 - group.neutral**2
        return (value**2 - group.neutral**2) / size, 2.0 * value / size
    size = max(group.high - group.neutral, group.neutral - group.low)
    return (value - group.neutral) / size, np.full(np.shape(value), 1.0 / size)


def warp_of(causes: Floats) -> tuple[Floats, Floats]:
    """Return W and its derivative by the scaled causes (…, 9)."""
    value: Floats = causes @ _FIRST + (causes * causes) @ _SECOND
    return value, _FIRST + 2.0 * _SECOND * causes


def paper_give(log_paper: Floats) -> Floats:
    """Return e/q = k/(P + P₀): strain of the paper over the load [–]."""
    give: Floats = STRAIN / (np.exp(log_paper) + GIVE)
    return give


def coordinates(groups: Floats, span: TrainingRange) -> Coordinates:
    """Return coordinates and derivatives at loads and groups, (n, 13) in the order of ``NAMES``."""
    count = len(groups)
    points, jacobian = np.zeros((count, len(NAMES))), np.zeros((count, len(NAMES), len(NAMES)))
    material = slice(1, 1 + N_MATERIAL)
    points[:, material] = scaled_material(groups[:, material], span)
    for k, group in enumerate(MATERIAL, start=1):
        jacobian[:, k, k] = 2.0 / (group.high - group.low)
    slopes = np.zeros((count, N_CAUSES))
    for k, cause in enumerate(CAUSES):
        points[:, 1 + N_MATERIAL + k], slopes[:, k] = scaled_cause(
            cause.name, groups[:, 1 + N_MATERIAL + k]
        )
    causes = slice(1 + N_MATERIAL, None)
    warp, by_causes = warp_of(points[:, causes])
    warp_gradient = np.zeros((count, len(NAMES)))
    warp_gradient[:, causes] = by_causes * slopes
    at = np.arange(1 + N_MATERIAL, len(NAMES))
    jacobian[:, at, at] = slopes
    scale = 2.0 / LARGEST_WARPED * np.exp(warp)
    points[:, 0] = scale * groups[:, 0] - 1.0
    jacobian[:, 0, 0] = scale
    jacobian[:, 0, 1:] = (scale * groups[:, 0])[:, None] * warp_gradient[:, 1:]
    _enter_slack(groups, points, jacobian)
    return Coordinates(points, warp, jacobian, warp_gradient)


def _enter_slack(groups: Floats, points: Floats, jacobian: Floats) -> None:
    """Replace the scaled slack by φ = s/(s + e q)."""
    load, slack, log_paper = groups[:, 0], groups[:, SLACK], groups[:, PAPER]
    give = paper_give(log_paper)
    strain = give * load
    felt = np.where(slack > 0.0, slack, 1.0)
    phi = np.where(slack > 0.0, felt / (felt + strain), 0.0)
    jacobian[:, SLACK, :] = 0.0
    points[:, SLACK] = phi
    with np.errstate(divide="ignore", invalid="ignore"):
        by_strain = np.where(slack > 0.0, -phi / (felt + strain), 0.0)
        # at zero slack the one-sided derivative
        jacobian[:, SLACK, SLACK] = np.where(
            slack > 0.0, (1.0 - phi) / (felt + strain), 1.0 / np.where(strain > 0.0, strain, np.inf)
        )
    paper = np.exp(log_paper)
    jacobian[:, SLACK, 0] = by_strain * give
    jacobian[:, SLACK, PAPER] = by_strain * strain * (-paper / (paper + GIVE))


def inside(groups: Floats, span: TrainingRange) -> NDArray[np.bool_]:
    """Return whether each value of (n, 12) groups lies in its range, (n, 12).

    A paper both slack and mismatched is not trained: the mismatch takes up the slack, or adds to
    it, with a corner where it is used up. The slack then counts as out of range.
    """
    room = ROOM * (span.upper - span.lower)
    within: NDArray[np.bool_] = (groups >= span.lower - room) & (groups <= span.upper + room)
    mismatched = np.abs(groups[:, MISMATCH - 1]) > TAKEN_UP
    within[:, SLACK - 1] &= ~(mismatched & (groups[:, SLACK - 1] > TAKEN_UP))
    return within
