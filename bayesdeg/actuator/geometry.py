"""Geometry of a pneunet: planes, cavities and slots from its dimensions."""

from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.moulded import Box, Moulded
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint
from bayesdeg.data.settings import Dimensions, relative_size


@dataclass(frozen=True)
class Geometry(Moulded):
    """The half pneunet as moulded.

    Its roof and walls have the wall factor; the slots between chambers are exposed to the soil.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> round(Geometry(Dimensions()).chamber_length, 3), round(Geometry(Dimensions()).volume, 6)
    (4.8, 3636.0)
    """

    dimensions: Dimensions
    wall_factor: float = 1.0
    erosion: float = 0.0
    constraint: Constraint = field(default_factory=Constraint)

    def change_problems(self) -> tuple[str, ...]:
        """Say why walls cannot be changed by this factor and erosion; empty if they can."""
        d, w, e = self.dimensions, self.wall_factor, self.erosion
        walls = {"roof": d.roof, "side_wall": d.side_wall, "end_wall": d.end_wall}
        if self.slot_spans:
            walls |= {"chamber_wall": d.chamber_wall, "channel_roof": d.channel_roof / w}
        bottom = self.outer[2][0]
        if bottom > 0.0:
            walls |= {"floor": d.floor / w}
            if self.constraint.is_there:
                walls |= {"height of the constraint": self.line_height / w}
        wrong = [
            f"{name} of {thickness:g} mm vanishes at a wall factor of {w:g} and {e:g} mm erosion"
            for name, thickness in walls.items()
            if not w * thickness > e
        ]
        if not wrong and min(self._room()) <= 0.0:
            wrong.append(f"walls {w:g} times as thick leave no room in the chambers")
        return tuple(wrong)

    def _room(self) -> tuple[float, ...]:
        """Return lengths that must stay above 0: chambers, above and beside the channel [mm]."""
        d, w = self.dimensions, self.wall_factor
        top, half = d.height - w * d.roof, d.width / 2 - w * d.side_wall
        along = min(b - a for a, b in self.chamber_spans)
        if d.chambers == 1:
            return along, half, top - d.floor
        # no wall may pass the channel where it ends inside the chambers
        same_top = np.isclose(d.floor + d.channel_height, d.height - d.roof)
        same_side = np.isclose(d.channel_width, d.width - 2 * d.side_wall)
        over = 1.0 if same_top and w == 1.0 else top - d.floor - d.channel_height
        beside = 1.0 if same_side and w == 1.0 else half - d.channel_width / 2
        return along, over, beside

    @property
    def chamber_length(self) -> float:
        """Nominal length of one chamber along the actuator [mm]."""
        d = self.dimensions
        dividers = (d.chambers - 1) * (2 * d.chamber_wall + d.gap)
        return (d.length - 2 * d.end_wall - dividers) / d.chambers

    @property
    def chamber_spans(self) -> tuple[tuple[float, float], ...]:
        """First and last x of every chamber [mm]."""
        d = self.dimensions
        starts, thicker = self._nominal_starts(), self.wall_factor - 1.0
        walls = np.full(d.chambers + 1, d.chamber_wall)
        walls[[0, -1]] = d.end_wall
        first = starts + thicker * walls[:-1]
        last = starts + self.chamber_length - thicker * walls[1:]
        return tuple((float(a), float(b)) for a, b in zip(first, last, strict=True))

    def _nominal_starts(self) -> NDArray[np.float64]:
        d = self.dimensions
        pitch = self.chamber_length + 2 * d.chamber_wall + d.gap
        starts: NDArray[np.float64] = d.end_wall + pitch * np.arange(d.chambers, dtype=np.float64)
        return starts

    @property
    def slot_spans(self) -> tuple[tuple[float, float], ...]:
        """First and last x of every open slot between chambers [mm]; empty if ``gap`` is 0."""
        wall, gap = self.dimensions.chamber_wall, self.dimensions.gap
        if gap == 0.0:
            return ()
        starts, e = self._nominal_starts(), self.erosion
        return tuple(
            (float(a + self.chamber_length + wall - e), float(b - wall + e))
            for a, b in pairwise(starts)
        )

    @property
    def slot_bottom(self) -> float:
        """Height at which the slots end: above the roof of the channel [mm]."""
        d = self.dimensions
        return d.floor + d.channel_height + d.channel_roof - self.erosion

    @property
    def cavities(self) -> tuple[Box, ...]:
        """Boxes of air in the half model: the chambers, and the channel that joins them [mm]."""
        d = self.dimensions
        half = d.width / 2 - self.wall_factor * d.side_wall
        heights = (d.floor, d.height - self.wall_factor * d.roof)
        chambers: list[Box] = [(span, (0.0, half), heights) for span in self.chamber_spans]
        if d.chambers == 1:
            return tuple(chambers)
        along = (self.chamber_spans[0][0], self.chamber_spans[-1][1])
        channel: Box = (along, (0.0, d.channel_width / 2), (d.floor, d.floor + d.channel_height))
        return (*chambers, channel)

    @property
    def voids(self) -> tuple[Box, ...]:
        """The slots, cut out from the top between neighbouring chambers [mm]."""
        _, across, (_, top) = self.outer
        return tuple((span, across, (self.slot_bottom, top)) for span in self.slot_spans)

    @property
    def exposed(self) -> tuple[Box, ...]:
        """The slots, which are open to the outside [mm]."""
        return self.voids

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return a mesh resolution scaled from the default pneunet."""
        return usual.scaled(relative_size(self.dimensions))

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the actuator with thicker or thinner walls and faces eroded [–, mm]."""
        return replace(self, wall_factor=wall_factor, erosion=erosion)

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on, as written and hashed.

        The usual constraint, on the bottom, is not named, for compatibility with stored solutions.
        """
        named = asdict(self)
        del named["constraint"]
        return named | ({"constraint": self.constraint_record} if self.bottom_is_exposed else {})
