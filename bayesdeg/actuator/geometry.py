"""Dimensions of the actuator and what follows from them: planes, cavities, slots."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bayesdeg.errors import GeometryError
from bayesdeg.measure.settings import Dimensions

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Geometry:
    """The half actuator as moulded, cut at its plane of symmetry y = 0.

    x runs along the actuator from the clamped end, y across from the plane of symmetry, z up
    from the paper.

    Parameters
    ----------
    dimensions : Dimensions
        As moulded [mm].

    Raises
    ------
    GeometryError
        If no actuator can be made of the dimensions; the message lists every reason.

    Examples
    --------
    >>> from bayesdeg.measure.settings import Dimensions
    >>> round(Geometry(Dimensions()).chamber_length, 3)
    4.8
    """

    dimensions: Dimensions

    def __post_init__(self) -> None:
        """Refuse impossible dimensions."""
        problems = self.dimensions.problems()
        if problems:
            raise GeometryError("; ".join(problems))

    @property
    def chamber_length(self) -> float:
        """Length of one chamber along the actuator [mm]."""
        d = self.dimensions
        dividers = (d.chambers - 1) * (2 * d.chamber_wall + d.gap)
        return (d.length - 2 * d.end_wall - dividers) / d.chambers

    @property
    def chamber_spans(self) -> tuple[tuple[float, float], ...]:
        """First and last x of every chamber [mm]."""
        d = self.dimensions
        pitch = self.chamber_length + 2 * d.chamber_wall + d.gap
        starts = d.end_wall + pitch * np.arange(d.chambers)
        return tuple((float(x), float(x + self.chamber_length)) for x in starts)

    @property
    def slot_spans(self) -> tuple[tuple[float, float], ...]:
        """First and last x of every open slot between chambers [mm]; empty if ``gap`` is 0."""
        wall, gap = self.dimensions.chamber_wall, self.dimensions.gap
        if gap == 0.0:
            return ()
        return tuple((a[1] + wall, b[0] - wall) for a, b in pairwise(self.chamber_spans))

    @property
    def slot_bottom(self) -> float:
        """Height at which the slots end: over the roof of the channel [mm]."""
        d = self.dimensions
        return d.floor + d.channel_height + d.channel_roof

    @property
    def cavities(self) -> tuple[Box, ...]:
        """Boxes of air in the half model: the chambers, and the channel that joins them [mm]."""
        d = self.dimensions
        half = d.width / 2 - d.side_wall
        heights = (d.floor, d.height - d.roof)
        chambers: list[Box] = [(span, (0.0, half), heights) for span in self.chamber_spans]
        if d.chambers == 1:
            return tuple(chambers)
        along = (self.chamber_spans[0][0], self.chamber_spans[-1][1])
        channel: Box = (along, (0.0, d.channel_width / 2), (d.floor, d.floor + d.channel_height))
        return (*chambers, channel)

    @property
    def slots(self) -> tuple[Box, ...]:
        """Boxes cut out from the top between neighbouring chambers [mm]."""
        d = self.dimensions
        return tuple(
            (span, (0.0, d.width / 2), (self.slot_bottom, d.height)) for span in self.slot_spans
        )

    def planes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the coordinates of all planes along x, y and z between which bricks stand [mm]."""
        d = self.dimensions
        boxes = (*self.cavities, *self.slots)
        outer = ((0.0, d.length), (0.0, d.width / 2), (0.0, d.height))
        x, y, z = (
            _distinct([*outer[axis], *(edge for box in boxes for edge in box[axis])])
            for axis in range(3)
        )
        return x, y, z


def _distinct(values: list[float], tolerance: float = 1e-9) -> NDArray[np.float64]:
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    distinct: NDArray[np.float64] = ordered[np.concatenate([[True], np.diff(ordered) > tolerance])]
    return distinct
