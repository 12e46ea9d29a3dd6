"""Geometry of a pneunet: planes, cavities and slots from its dimensions."""

from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.moulded import (
    Box,
    Planes,
    bottom_is_exposed,
    change_problems,
    constraint_record,
    line_height,
    planes_of,
    slab_of,
    volume_without,
)
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint
from bayesdeg.data.settings import Dimensions, relative_size
from bayesdeg.errors import GeometryError


@dataclass(frozen=True)
class Geometry:
    """The half pneunet as moulded, cut at its plane of symmetry y = 0.

    x runs along the actuator from the clamped end, y across from the plane of symmetry, z up
    from the paper.

    Parameters
    ----------
    dimensions : Dimensions
        As moulded [mm].
    wall_factor : float
        Thickness of roof and walls over the nominal one; the outer faces do not move [–].
    erosion : float
        Thickness lost from every face exposed to the soil: all outer faces and slots except the
        bottom, where paper covers it, and the clamped end [mm].
    constraint : Constraint
        The inextensible layer; by default the paper on the bottom.

    Raises
    ------
    GeometryError
        If no actuator can have these dimensions; the message lists every reason.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> round(Geometry(Dimensions()).chamber_length, 3)
    4.8
    """

    dimensions: Dimensions
    wall_factor: float = 1.0
    erosion: float = 0.0
    constraint: Constraint = field(default_factory=Constraint)
    rounded: ClassVar[None] = None
    is_boxes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse impossible dimensions."""
        problems = (
            self.dimensions.problems()
            or self.constraint.problems(self.dimensions)
            or self._changed_problems()
        )
        if problems:
            raise GeometryError("; ".join(problems))

    def _changed_problems(self) -> tuple[str, ...]:
        d, w, e = self.dimensions, self.wall_factor, self.erosion
        if wrong_change := change_problems(w, e):
            return wrong_change
        walls = {"roof": d.roof, "side_wall": d.side_wall, "end_wall": d.end_wall}
        if self.slot_spans:
            walls |= {"chamber_wall": d.chamber_wall, "channel_roof": d.channel_roof / w}
        if self.bottom > 0.0:
            walls |= {"floor": d.floor / w}
            walls |= (
                {"height of the constraint": self.line_height / w}
                if self.constraint.is_there
                else {}
            )
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
    def length(self) -> float:
        """Remaining length [mm]."""
        return self.dimensions.length - self.erosion

    @property
    def half_width(self) -> float:
        """Half the remaining width [mm]."""
        return self.dimensions.width / 2 - self.erosion

    @property
    def height(self) -> float:
        """Remaining height [mm]."""
        return self.dimensions.height - self.erosion

    @property
    def line_height(self) -> float:
        """Height of the constraint's plane, along whose middle the curvature is read [mm]."""
        return line_height(self.constraint, self.dimensions, self.erosion)

    @property
    def bottom(self) -> float:
        """Height of the remaining bottom [mm]."""
        return self.erosion if bottom_is_exposed(self.constraint, self.dimensions) else 0.0

    @property
    def outer(self) -> Box:
        """Remaining block after erosion [mm]."""
        return (0.0, self.length), (0.0, self.half_width), (self.bottom, self.height)

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
    def slots(self) -> tuple[Box, ...]:
        """Boxes cut out from the top between neighbouring chambers [mm]."""
        across, upward = (0.0, self.half_width), (self.slot_bottom, self.height)
        return tuple((span, across, upward) for span in self.slot_spans)

    @property
    def voids(self) -> tuple[Box, ...]:
        """The slots: air that is not under pressure [mm]."""
        return self.slots

    @property
    def exposed(self) -> tuple[Box, ...]:
        """The slots, which are open to the outside [mm]."""
        return self.slots

    @property
    def slab(self) -> tuple[Box, ...]:
        """The box of a constraint layer of elastomer, if it is one [mm]."""
        return slab_of(self.constraint, self.dimensions, self.outer)

    @property
    def volume(self) -> float:
        """Volume of the gel of the whole actuator [mm³].

        Examples
        --------
        >>> from bayesdeg.data.settings import Dimensions
        >>> round(Geometry(Dimensions()).volume, 6)
        3636.0
        """
        return 2.0 * volume_without(self.planes(), (*self.cavities, *self.slots))

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return a mesh resolution scaled from the default pneunet."""
        return usual.scaled(relative_size(self.dimensions))

    def planes(self) -> Planes:
        """Return the coordinates of all planes along x, y and z between bricks [mm]."""
        return planes_of(self.outer, (*self.slab, *self.cavities, *self.slots), self.line_height)

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the actuator with thicker or thinner walls and faces eroded [–, mm]."""
        return replace(self, wall_factor=wall_factor, erosion=erosion)

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on, as written and hashed.

        The usual constraint, on the bottom, is not named, for compatibility with stored solutions.
        """
        named = asdict(self)
        del named["constraint"]
        if not bottom_is_exposed(self.constraint, self.dimensions):
            return named
        return named | {"constraint": constraint_record(self.constraint, self.dimensions)}
