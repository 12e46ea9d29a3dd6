"""Inputs of a forward map as rows of one material each, with a column for each load."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.emulator.coordinates import (
    LARGEST_WARPED,
    N_MATERIAL,
    PAPER,
    ROOM,
    SLACK,
    WARP,
    inside,
    paper_give,
    scaled_cause,
    scaled_material,
    warp_of,
)
from bayesdeg.emulator.scaling import CAUSES, GROUPS, LOAD, NAMES, TrainingRange, groups_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_STIFFENING = NAMES.index("log_stiffening")
_CAUSES = frozenset(cause.name for cause in CAUSES)


@dataclass(frozen=True)
class Batch:
    """Rows of one material each.

    Parameters
    ----------
    shape : tuple of int
        To which the inputs broadcast.
    loads : array, shape (n_rows, n_columns)
        p/M [–].
    groups : array, shape (13, n_rows)
        Groups in the order of ``NAMES``, neutral where the inputs are silent; the first is 0.
    within : array of bool, shape (n_rows,)
        Whether all groups of a row lie in their ranges.
    scaled : array, shape (13, n_rows)
        Material on [−1, 1] and scaled causes, the slack by its range; 0 in rows outside.
    warp : array, shape (n_rows, 1)
        W [–].
    """

    shape: tuple[int, ...]
    loads: Floats
    groups: Floats
    within: Flags
    scaled: Floats
    warp: Floats

    @classmethod
    def of(cls, inputs: Inputs, span: TrainingRange, *, one_by_one: bool = False) -> Self:
        """Return a row for each curve, or for each point if materials change along the last axis.

        Parameters
        ----------
        inputs : Inputs
            Whose pressures run along the last axis.
        span : TrainingRange
            Of the emulator.
        one_by_one : bool
            Whether each point is a row in any case.
        """
        given = groups_of(inputs)
        load = given.pop(LOAD)
        scale = np.shape(inputs.linear_scale)
        shape = np.broadcast_shapes(np.shape(load), scale, *(np.shape(v) for v in given.values()))
        curves = not one_by_one and all(np.shape(v)[-1:] in ((), (1,)) for v in given.values())
        rows = (*shape[:-1], 1) if curves else shape
        neutral = np.array([0.0, *(group.neutral for group in GROUPS)])
        groups = np.repeat(neutral[:, None], int(np.prod(rows)), axis=1)
        for name, value in given.items():
            groups[NAMES.index(name)] = np.broadcast_to(value, rows).ravel()
        within = _within(groups, tuple(given), span)
        scaled, warp = _scaled(groups, within, tuple(given), span)
        columns = shape[-1] if curves and shape else 1
        loads = np.broadcast_to(load, shape).reshape(-1, columns)
        return cls(shape, loads, groups, within, scaled, warp[:, None])

    def brought_inside(self, span: TrainingRange) -> tuple[Self, Floats]:
        """Return the batch with every group in its range, and how far outside each row was.

        Returns
        -------
        batch : Batch
            Rows of groups that are no numbers stay outside.
        distance : array, shape (n_rows,)
            Root of the sum of squares over groups, in the widths of their ranges [–].
        """
        if self.within.all():
            return self, np.zeros(len(self.within))
        given = self.groups[1:]
        groups = np.clip(given.T, span.lower, span.upper).T
        # a paper both slack and mismatched is not trained
        taken_up = ~inside(groups.T, span)[:, SLACK - 1]
        groups[SLACK - 1] = np.where(
            taken_up, np.minimum(groups[SLACK - 1], 0.0), groups[SLACK - 1]
        )
        off = (given - groups) / (span.upper - span.lower)[:, None]
        known = np.all(np.isfinite(given), axis=0)
        groups = np.vstack([self.groups[:1], np.where(known, groups, given)])
        scaled, warp = _scaled(groups, known, NAMES[1:], span)
        inner = replace(self, groups=groups, within=known, scaled=scaled, warp=warp[:, None])
        return inner, np.where(known, np.sqrt(np.sum(off**2, axis=0)), 0.0)

    def largest_load(self, span: TrainingRange) -> Floats:
        """Return the largest p/M that is trained, (n_rows,); of no meaning in rows outside."""
        warped = LARGEST_WARPED * np.exp(-self.warp[:, 0])
        return np.minimum(warped, span.largest_load(self.scaled[_STIFFENING]))

    def phi(self, loads: Floats) -> Floats | None:
        """Return φ = s/(s + e q) at loads (n_rows, n_columns); None if no paper is slack."""
        slack, give = (part[:, None] for part in self.slack)
        if not np.any(slack > 0.0):
            return None
        felt = np.where(slack > 0.0, slack, 1.0)
        return np.where(slack > 0.0, felt / (felt + give * loads), 0.0)

    @property
    def slack(self) -> tuple[Floats, Floats]:
        """The paper's slack s and its strain over the load e/q, each (n_rows,); 0 in rows outside.

        The strain is 0 if no paper is slack.
        """
        slack = np.where(self.within, self.groups[SLACK], 0.0)
        if not np.any(slack > 0.0):
            return slack, np.zeros_like(slack)
        return slack, paper_give(np.where(self.within, self.groups[PAPER], 0.0))


def _within(groups: Floats, given: tuple[str, ...], span: TrainingRange) -> Flags:
    """Return whether all groups of each row lie in their ranges; what is not given does."""
    places = [NAMES.index(name) - 1 for name in given]
    if SLACK - 1 in places:  # of which the mismatch has a say
        return np.asarray(np.all(inside(groups[1:].T, span), axis=1))
    low, high = span.lower[places, None], span.upper[places, None]
    room = ROOM * (high - low)
    values = groups[1:][places]
    return np.asarray(np.all((values >= low - room) & (values <= high + room), axis=0))


def _scaled(
    groups: Floats, within: Flags, given: tuple[str, ...], span: TrainingRange
) -> tuple[Floats, Floats]:
    """Return the scaled groups and W; a cause that is not given is neutral, which is 0."""
    scaled = np.zeros_like(groups)
    material = slice(1, 1 + N_MATERIAL)
    with np.errstate(over="ignore"):
        scaled[material] = scaled_material(groups[material].T, span).T
        for name in _CAUSES.intersection(given):
            scaled[NAMES.index(name)] = scaled_cause(name, groups[NAMES.index(name)])[0]
    if not np.all(within):
        scaled[:, ~within] = 0.0
    if not set(WARP).intersection(given):
        return scaled, np.zeros(len(within))
    return scaled, warp_of(scaled[1 + N_MATERIAL :].T)[0]
