"""Coordinates in which the map is nearly a polynomial, their derivatives, and rows of inputs.

A curve is followed by its swelling t = ΔV/(c L³), the volume that the cavity swept, with c such
that t ≈ p/M at first: unlike pressure it grows through ballooning. It enters as ln(1 + t). Slack
paper matters until the actuator has stretched it, by about e = k t/(P + P₀), P being the paper's
group: it enters as φ = s/(s + e), which is 0 for a tight paper and 1 for one without any effect.

Where the tip is held, p/M takes the place of t.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.surrogate.scaling import (
    CAUSES,
    GROUPS,
    LOAD,
    MATERIAL,
    NAMES,
    TrainingRange,
    groups_of,
)

Floats = NDArray[np.float64]

N_MATERIAL, N_CAUSES = len(MATERIAL), len(CAUSES)
SLACK = NAMES.index("paper_slack")
THICKNESS = NAMES.index("paper_thickness")
PAPER = NAMES.index("log_paper")
SECOND_INVARIANT = NAMES.index("second_invariant")
MISMATCH = NAMES.index("paper_mismatch")
ALONG, UP = NAMES.index("gravity_along"), NAMES.index("gravity_up")
LARGEST_SWELLING = 14.0  # range of t [–]
STRAIN, GIVE = 2.9, 30.0  # k [mm] and P₀ [mm] of the paper's strain
LARGEST_SLACK_AND_MISMATCH = 1e-3  # largest slack and mismatch that may occur together [–]
ROOM = 1e-9  # tolerance of a range for rounding, as a share of it
GRAVITY_STRAIN = 60.0  # strain at rest over the group of gravity [mm]

WHOLE = math.log1p(LARGEST_SWELLING)
_LOW, _HIGH = (np.array([getattr(g, end) for g in GROUPS]) for end in ("low", "high"))
_WIDTH = _HIGH - _LOW


@dataclass(frozen=True)
class Coordinates:
    """Points in the coordinates of the polynomials.

    Parameters
    ----------
    points : array, shape (n, 13)
        Swelling and material on [−1, 1]; causes scaled to at most 1 in size, 0 if neutral; in
        the order of ``NAMES``.
    jacobian : array, shape (n, 13, 13)
        Derivatives of the points by swelling and groups, ``jacobian[:, point, group]``.
    """

    points: Floats
    jacobian: Floats


def scaled_material(values: Floats) -> Floats:
    """Map the material's groups (…, 3) from their whole ranges to [−1, 1]."""
    low, high = _LOW[:N_MATERIAL], _HIGH[:N_MATERIAL]
    scaled: Floats = (2.0 * values - (low + high)) / (high - low)
    return scaled


def scaled_cause(name: str, value: Floats) -> tuple[Floats, Floats]:
    """Return a cause's group scaled to at most 1 in size and 0 if neutral, and its derivative.

    The paper's thickness enters squared, like its bending stiffness.
    """
    group = next(cause for cause in CAUSES if cause.name == name)
    if name == "paper_thickness":
        size = group.high**2 - group.neutral**2
        return (value**2 - group.neutral**2) / size, 2.0 * value / size
    size = max(group.high - group.neutral, group.neutral - group.low)
    return (value - group.neutral) / size, np.full(np.shape(value), 1.0 / size)


def unit_swelling(swelling: Floats) -> Floats:
    """Map t from its range to [−1, 1].

    Examples
    --------
    >>> unit_swelling(np.array([0.0, LARGEST_SWELLING])).round(12).tolist()
    [-1.0, 1.0]
    """
    unit: Floats = 2.0 / WHOLE * np.log1p(swelling) - 1.0
    return unit


def unit_rate(swelling: Floats) -> Floats:
    """Return the derivative of `unit_swelling` by ln t."""
    rate: Floats = 2.0 / WHOLE * swelling / (1.0 + swelling)
    return rate


def paper_give(log_paper: Floats) -> Floats:
    """Return e/t = k/(P + P₀): strain of the paper over the swelling [–]."""
    give: Floats = STRAIN / (np.exp(log_paper) + GIVE)
    return give


def coordinates(groups: Floats) -> Coordinates:
    """Return coordinates and derivatives at swelling and groups, (n, 13) in the order of ``NAMES``.

    The swelling is in the place of the load.
    """
    count = len(groups)
    points, jacobian = np.zeros((count, len(NAMES))), np.zeros((count, len(NAMES), len(NAMES)))
    swelling, material = groups[:, 0], slice(1, 1 + N_MATERIAL)
    points[:, 0] = unit_swelling(swelling)
    jacobian[:, 0, 0] = 2.0 / WHOLE / (1.0 + swelling)
    points[:, material] = scaled_material(groups[:, material])
    for k, group in enumerate(MATERIAL, start=1):
        jacobian[:, k, k] = 2.0 / (group.high - group.low)
    for k, cause in enumerate(CAUSES, start=1 + N_MATERIAL):
        points[:, k], jacobian[:, k, k] = scaled_cause(cause.name, groups[:, k])
    # φ = s/(s + e) replaces the scaled slack
    slack, log_paper = groups[:, SLACK], groups[:, PAPER]
    give = paper_give(log_paper)
    strain = give * swelling
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
    return Coordinates(points, jacobian)


def inside(groups: Floats, span: TrainingRange) -> NDArray[np.bool_]:
    """Return whether each value of (n, 12) groups lies in its range, (n, 12).

    Paper both slack and mismatched is not trained: the mismatch consumes the slack, or adds to it,
    with a kink where it is used up. The slack then counts as out of range.
    """
    room = ROOM * _WIDTH
    within: NDArray[np.bool_] = (groups >= span.lower - room) & (groups <= span.upper + room)
    mismatched = np.abs(groups[:, MISMATCH - 1]) > LARGEST_SLACK_AND_MISMATCH
    within[:, SLACK - 1] &= ~(mismatched & (groups[:, SLACK - 1] > LARGEST_SLACK_AND_MISMATCH))
    return within


Flags = NDArray[np.bool_]

_STIFFENING = NAMES.index("log_stiffening")
_CAUSES = frozenset(cause.name for cause in CAUSES)
_NEUTRAL = np.array([0.0, *(group.neutral for group in GROUPS)])


@dataclass(frozen=True)
class Batch:
    """Rows of one material each.

    Parameters
    ----------
    shape : tuple of int
        Broadcast shape of the inputs.
    loads : array, shape (n_rows, n_columns)
        p/M [–].
    groups : array, shape (13, n_rows)
        Groups in the order of ``NAMES``, neutral where not given; the first is 0.
    within : array of bool, shape (n_rows,)
        Whether all groups of a row lie in their ranges.
    scaled : array, shape (13, n_rows)
        Material on [−1, 1] and scaled causes, the slack by its range; 0 in rows outside.
    """

    shape: tuple[int, ...]
    loads: Floats
    groups: Floats
    within: Flags
    scaled: Floats

    @classmethod
    def of(cls, inputs: Inputs, span: TrainingRange, *, one_by_one: bool = False) -> Self:
        """Return a row for each curve, or for each point if materials change along the last axis.

        Pressures are along the last axis. With ``one_by_one`` each point is a separate row.
        """
        given = groups_of(inputs)
        load = given.pop(LOAD)
        scale = np.shape(inputs.linear_scale)
        shape = np.broadcast_shapes(np.shape(load), scale, *(np.shape(v) for v in given.values()))
        curves = not one_by_one and all(np.shape(v)[-1:] in ((), (1,)) for v in given.values())
        rows = (*shape[:-1], 1) if curves else shape
        groups = np.empty((len(NAMES), math.prod(rows)))
        groups[:] = _NEUTRAL[:, None]
        for name, value in given.items():
            groups[NAMES.index(name)] = np.broadcast_to(value, rows).ravel()
        if "paper_slack" in given:  # which also depends on the mismatch
            within = np.asarray(np.all(inside(groups[1:].T, span), axis=1))
        else:
            within = np.ones(groups.shape[1], dtype=bool)
            for k in (NAMES.index(name) for name in given):
                room = ROOM * _WIDTH[k - 1]
                within &= groups[k] >= span.lower[k - 1] - room
                within &= groups[k] <= span.upper[k - 1] + room
        scaled = _scaled(groups, within, tuple(given))
        columns = shape[-1] if curves and shape else 1
        loads = np.broadcast_to(load, shape).reshape(-1, columns)
        return cls(shape, loads, groups, within, scaled)

    @classmethod
    def of_groups(cls, groups: Floats, loads: Floats, span: TrainingRange) -> Self:
        """Return a row for each of (n, 12) groups, with one load each (n,)."""
        within = np.asarray(np.all(inside(groups, span), axis=1))
        whole = np.vstack([np.zeros(len(loads)), groups.T])
        scaled = _scaled(whole, within, NAMES[1:])
        return cls((len(loads), 1), loads[:, None], whole, within, scaled)

    @property
    def row_shape(self) -> tuple[int, ...]:
        """Shape of the rows: that of the inputs, with one column unless each point is a row."""
        points = len(self.within) == np.prod(self.shape)
        return self.shape if points else (*self.shape[:-1], 1)

    def brought_inside(self, span: TrainingRange) -> tuple[Self, Floats]:
        """Return the batch with every group in its range, and how far outside each row was.

        Returns
        -------
        batch : Batch
            Batch; rows with nan groups stay outside.
        distance : array, shape (n_rows,)
            Root of the sum of squares over groups, in the widths of their whole ranges [–].
        """
        if self.within.all():
            return self, np.zeros(len(self.within))
        rows = ~self.within
        given = self.groups[1:, rows]
        inner = np.clip(given.T, span.lower, span.upper).T
        # a paper both slack and mismatched is not trained
        taken_up = ~inside(inner.T, span)[:, SLACK - 1]
        inner[SLACK - 1] = np.where(taken_up, np.minimum(inner[SLACK - 1], 0.0), inner[SLACK - 1])
        off = (given - inner) / _WIDTH[:, None]
        known = np.all(np.isfinite(given), axis=0)
        groups, within = self.groups.copy(), self.within.copy()
        scaled, distance = self.scaled.copy(), np.zeros(len(within))
        groups[1:, rows], within[rows] = np.where(known, inner, given), known
        scaled[:, rows] = _scaled(groups[:, rows], known, NAMES[1:])
        distance[rows] = np.where(known, np.sqrt(np.sum(off**2, axis=0)), 0.0)
        return replace(self, groups=groups, within=within, scaled=scaled), distance

    def largest_load(self, span: TrainingRange) -> Floats:
        """Return the largest trained p/M, (n_rows,); meaningless in rows outside."""
        return span.largest_load(self.scaled[_STIFFENING])

    def in_range(self, span: TrainingRange) -> Flags:
        """Return whether material and load lie in the range of the batch, of ``shape``.

        Curves may still end earlier.
        """
        found = self.within[:, None] & (self.loads <= self.largest_load(span)[:, None])
        return found.reshape(self.shape)

    def phi(self, swelling: Floats) -> Floats:
        """Return φ = s/(s + e) at t, (n_rows, n_columns); 0 for tight paper."""
        slack, give = (part[:, None] for part in self.slack)
        felt = np.where(slack > 0.0, slack, 1.0)
        return np.where(slack > 0.0, felt / (felt + give * swelling), 0.0)

    @property
    def slack(self) -> tuple[Floats, Floats]:
        """Slack s of the paper and its strain over the swelling e/t, (n_rows,); 0 in rows outside.

        The strain is 0 if no paper is slack.
        """
        slack = np.where(self.within, self.groups[SLACK], 0.0)
        if not np.any(slack > 0.0):
            return slack, np.zeros_like(slack)
        return slack, paper_give(np.where(self.within, self.groups[PAPER], 0.0))


def _scaled(groups: Floats, within: Flags, given: tuple[str, ...]) -> Floats:
    """Return the scaled groups; a cause not given is neutral, 0."""
    scaled = np.zeros_like(groups)
    material = slice(1, 1 + N_MATERIAL)
    with np.errstate(over="ignore"):
        scaled[material] = scaled_material(groups[material].T).T
        for name in _CAUSES.intersection(given):
            scaled[NAMES.index(name)] = scaled_cause(name, groups[NAMES.index(name)])[0]
    if not np.all(within):
        scaled[:, ~within] = 0.0
    return scaled
