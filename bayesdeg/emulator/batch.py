"""Inputs of a forward map as rows of one material each, with a column for each load."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.emulator.coordinates import (
    LARGEST_WARPED,
    N_MATERIAL,
    PAPER,
    SLACK,
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
        within = np.all(inside(groups[1:].T, span), axis=1)
        scaled, warp = _scaled(groups, within, span)
        columns = shape[-1] if curves and shape else 1
        loads = np.broadcast_to(load, shape).reshape(-1, columns)
        return cls(shape, loads, groups, within, scaled, warp[:, None])

    def largest_load(self, span: TrainingRange) -> Floats:
        """Return the largest p/M that is trained, (n_rows,); of no meaning in rows outside."""
        warped = LARGEST_WARPED * np.exp(-self.warp[:, 0])
        return np.minimum(warped, span.largest_load(self.scaled[_STIFFENING]))

    def phi(self, loads: Floats) -> Floats | None:
        """Return φ = s/(s + e q) at loads (n_rows, n_columns); None if no paper is slack."""
        slack = np.where(self.within, self.groups[SLACK], 0.0)[:, None]
        if not np.any(slack > 0.0):
            return None
        paper = np.where(self.within, self.groups[PAPER], 0.0)[:, None]
        felt = np.where(slack > 0.0, slack, 1.0)
        return np.where(slack > 0.0, felt / (felt + paper_give(paper) * loads), 0.0)


def _scaled(groups: Floats, within: Flags, span: TrainingRange) -> tuple[Floats, Floats]:
    scaled = np.zeros_like(groups)
    material = slice(1, 1 + N_MATERIAL)
    with np.errstate(over="ignore"):
        scaled[material] = scaled_material(groups[material].T, span).T
        for k, cause in enumerate(CAUSES, start=1 + N_MATERIAL):
            scaled[k] = scaled_cause(cause.name, groups[k])[0]
    scaled = np.where(within, scaled, 0.0)
    return scaled, warp_of(scaled[1 + N_MATERIAL :].T)[0]
