"""Dimensions of the actuator and what follows from them: planes, cavities, slots."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError

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
    wall_factor : float
        Thickness of roof and walls over the nominal one; the outer faces stay where they are [–].
    erosion : float
        Thickness lost from every face exposed to the soil: all outer faces and slots but for the
        bottom, which the paper covers, and the clamped end [mm].

    Raises
    ------
    GeometryError
        If no actuator can be made of the dimensions; the message lists every reason.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> round(Geometry(Dimensions()).chamber_length, 3)
    4.8
    """

    dimensions: Dimensions
    wall_factor: float = 1.0
    erosion: float = 0.0

    def __post_init__(self) -> None:
        """Refuse impossible dimensions."""
        problems = self.dimensions.problems() or self._changed_problems()
        if problems:
            raise GeometryError("; ".join(problems))

    def _changed_problems(self) -> tuple[str, ...]:
        d, w, e = self.dimensions, self.wall_factor, self.erosion
        if not (w > 0.0 and e >= 0.0):
            return (f"wall factor {w:g} and erosion {e:g} mm must be above 0 and not below 0",)
        walls = {"roof": d.roof, "side_wall": d.side_wall, "end_wall": d.end_wall}
        if self.slot_spans:
            walls |= {"chamber_wall": d.chamber_wall, "channel_roof": d.channel_roof / w}
        wrong = [
            f"{name} of {thickness:g} mm is lost to a wall factor of {w:g} and {e:g} mm of erosion"
            for name, thickness in walls.items()
            if not w * thickness > e
        ]
        if not wrong and min(self._room()) <= 0.0:
            wrong.append(f"walls {w:g} times as thick leave no room in the chambers")
        return tuple(wrong)

    def _room(self) -> tuple[float, ...]:
        """Return what must stay above 0: lengths of chambers, over and beside the channel [mm]."""
        d, w = self.dimensions, self.wall_factor
        top, half = d.height - w * d.roof, d.width / 2 - w * d.side_wall
        along = min(b - a for a, b in self.chamber_spans)
        if d.chambers == 1:
            return along, half, top - d.floor
        # where the channel ends inside the chambers nothing may come to pass it
        same_top = np.isclose(d.floor + d.channel_height, d.height - d.roof)
        same_side = np.isclose(d.channel_width, d.width - 2 * d.side_wall)
        over = 1.0 if same_top and w == 1.0 else top - d.floor - d.channel_height
        beside = 1.0 if same_side and w == 1.0 else half - d.channel_width / 2
        return along, over, beside

    @property
    def length(self) -> float:
        """Length that is left [mm]."""
        return self.dimensions.length - self.erosion

    @property
    def half_width(self) -> float:
        """Half of the width that is left [mm]."""
        return self.dimensions.width / 2 - self.erosion

    @property
    def height(self) -> float:
        """Height that is left [mm]."""
        return self.dimensions.height - self.erosion

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
        """Height at which the slots end: over the roof of the channel [mm]."""
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
    def volume(self) -> float:
        """Volume of the gel of the whole actuator [mm³].

        Examples
        --------
        >>> from bayesdeg.data.settings import Dimensions
        >>> round(Geometry(Dimensions()).volume, 6)
        3636.0
        """
        planes = self.planes()
        middles = np.meshgrid(*(0.5 * (p[1:] + p[:-1]) for p in planes), indexing="ij")
        sizes = np.einsum("i,j,k->ijk", *(np.diff(p) for p in planes))
        solid = np.ones(sizes.shape, dtype=bool)
        for box in (*self.cavities, *self.slots):
            inside = [(a < m) & (m < b) for m, (a, b) in zip(middles, box, strict=True)]
            solid &= ~np.logical_and.reduce(inside)
        return 2.0 * float(sizes[solid].sum())

    def planes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the coordinates of all planes along x, y and z between which bricks stand [mm]."""
        boxes = (*self.cavities, *self.slots)
        outer = ((0.0, self.length), (0.0, self.half_width), (0.0, self.height))
        x, y, z = (
            _distinct([*outer[axis], *(edge for box in boxes for edge in box[axis])])
            for axis in range(3)
        )
        return x, y, z


def _distinct(values: list[float], tolerance: float = 1e-9) -> NDArray[np.float64]:
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    distinct: NDArray[np.float64] = ordered[np.concatenate([[True], np.diff(ordered) > tolerance])]
    return distinct
