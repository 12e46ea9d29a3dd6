"""Ribbed and cylindrical segments: channels in one or both halves, and a layer between.

The families differ in their channels and in the elements that these require.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from bayesdeg.actuator.moulded import (
    Box,
    Moulded,
    Planes,
    mirrored,
    order_is_kept,
    planes_of,
    volume_without,
)
from bayesdeg.actuator.round import RoundSection, core_of
from bayesdeg.actuator.status import FINE, Resolution
from bayesdeg.data.families import Constraint, CylindricalDimensions, Kind, RibbedDimensions

Boxes = tuple[Box, ...]
Sizes = tuple[float, float, float]

MOST_ALONG, MOST_UP = 100, 30  # approximate numbers of elements where channels are small
# of a fine mesh about straight channels: along, where nothing changes; in a channel's smaller side;
# and at most in half the width and in the height where channels are small
ALONG, IN_CHANNEL, MOST_ACROSS, MOST_HIGH = 8, 4, 10, 14


def slits(d: RibbedDimensions, wall_factor: float) -> Boxes:
    """Return slits across the upper half, and the passage that joins them [mm].

    Cover, ribs and side walls are ``wall_factor`` times as thick; all slits stay equal.
    """
    starts = d.end_wall + d.pitch * np.arange(d.channels, dtype=np.float64)
    rib = d.pitch - d.channel_length if d.channels > 1 else 0.0
    thicker = 0.5 * (wall_factor - 1.0) * rib
    spans = [(float(x + thicker), float(x + d.channel_length - thicker)) for x in starts]
    across = (0.0, d.width / 2 - wall_factor * d.side_wall)
    upward = (d.floor, d.height - wall_factor * d.cover)
    found: list[Box] = [(span, across, upward) for span in spans]
    if d.channels > 1:
        along = (spans[0][0], spans[-1][1])
        found.append((along, (0.0, d.passage_width / 2), (d.floor, d.floor + d.passage_height)))
    return tuple(found)


def sizes_about_slits(d: RibbedDimensions) -> Sizes:
    """Return sizes of elements of a fine mesh along, across and up [mm].

    There are two per rib, seven across and ten to twelve in the height: on the default segment
    75,600 degrees of freedom, whose curvatures are 1.1 to 1.7 % below those with 164,800.
    """
    along = max(d.channel_length, 0.5 * (d.pitch - d.channel_length), d.length / MOST_ALONG)
    return along, d.width / 7.0, max(0.52 * d.channel_height, d.height / MOST_UP)


def straight_channels(d: CylindricalDimensions, wall_factor: float) -> Boxes:
    """Return channels along the upper half, one in the middle cut in two [mm].

    The cover and the walls between channels are ``wall_factor`` times as thick.
    """
    wall = d.pitch - d.channel_width if d.channels > 1 else 0.0
    reach = 0.5 * (d.channel_width - (wall_factor - 1.0) * wall)
    along = (d.end_wall, d.end_wall + d.channel_length)
    upward = (d.floor, d.height - wall_factor * d.cover)
    return tuple(
        (along, (max(0.0, middle - reach), middle + reach), upward)
        for middle in d.channel_middles
        if middle > -0.5 * d.channel_width
    )


def sizes_about_straight_channels(d: CylindricalDimensions) -> Sizes:
    """Return sizes of elements of a fine mesh along, across and up [mm].

    Widening of the section matters most: there are four in a channel's smaller side.
    """
    side = min(d.channel_width, d.channel_height) / IN_CHANNEL
    return d.length / ALONG, max(side, 0.5 * d.width / MOST_ACROSS), max(side, d.height / MOST_HIGH)


class Layout(NamedTuple):
    """Layout of a family of segments, and whether its elements are graded at edges."""

    channels: Callable[[Any, float], Boxes]
    sizes: Callable[[Any], Sizes]
    graded: bool


LAYOUTS: Mapping[Kind, Layout] = {
    "ribbed": Layout(slits, sizes_about_slits, graded=False),
    "cylindrical": Layout(straight_channels, sizes_about_straight_channels, graded=True),
}


@dataclass(frozen=True)
class SegmentGeometry(Moulded):
    """The half segment as moulded.

    The channels of the upper half are under pressure, which bends the segment downwards: towards
    the constraint layer, and the passive half below it. Those of the lower half open into a tube,
    not to the soil. The cover and the walls beside channels have the wall factor; the floor of the
    channels does not move.

    Examples
    --------
    >>> ribbed = SegmentGeometry(RibbedDimensions())
    >>> len(ribbed.cavities), ribbed.line_height, round(ribbed.volume)
    (14, 9.25, 20294)
    >>> straight = SegmentGeometry(CylindricalDimensions())
    >>> len(straight.cavities), straight.line_height, round(straight.volume)
    (1, 9.8, 39557)
    """

    dimensions: RibbedDimensions | CylindricalDimensions
    wall_factor: float = 1.0
    erosion: float = 0.0
    constraint: Constraint = field(default_factory=Constraint)

    def change_problems(self) -> tuple[str, ...]:
        """Say why walls cannot be changed by this factor and erosion; empty if they can."""
        d, w, e = self.dimensions, self.wall_factor, self.erosion
        if w == 1.0 and e == 0.0:
            return ()
        nominal = self.changed(wall_factor=1.0, erosion=0.0)
        before, after = ((*one.faces, *one._core) for one in (nominal, self))
        if order_is_kept(before, after) and (self.rounded is None or self.rounded.holds_core):
            return ()
        return (
            f"a wall factor of {w:g} and {e:g} mm of erosion remove a wall or a channel "
            f"(cover {d.cover:g} mm, pitch {d.pitch:g} mm, channels {d.channel_length:g} mm long, "
            f"{d.channel_width:g} mm wide and {d.channel_height:g} mm high)",
        )

    @property
    def _layout(self) -> Layout:
        return LAYOUTS[self.dimensions.kind]

    @property
    def rounded(self) -> RoundSection | None:
        """The outline across the length, if round."""
        d = self.dimensions
        if not (isinstance(d, CylindricalDimensions) and d.is_round):
            return None
        axis = 0.5 * d.height
        faces = {self.line_height, *(z for _, _, heights in self.slab for z in heights)}
        levels = tuple(sorted(z - axis for z in faces))
        size = 0.5 * d.width - self.erosion, axis - self.erosion
        return RoundSection(*size, core_of(d), axis, levels)

    @property
    def _core(self) -> Boxes:
        """The core of a round section, around which its ring is bent [mm]."""
        section = self.rounded
        if section is None:
            return ()
        across, up = section.core
        return (((0.0, 0.0), (0.0, across), (section.axis - up, section.axis + up)),)

    @property
    def upper(self) -> Boxes:
        """Boxes of air in the upper half [mm]."""
        return self._layout.channels(self.dimensions, self.wall_factor)

    @property
    def lower(self) -> Boxes:
        """Their mirror images in the lower half; none if it has no channels [mm]."""
        d = self.dimensions
        return mirrored(self.upper, d.height) if d.is_mirrored else ()

    @property
    def cavities(self) -> Boxes:
        """Boxes of air under pressure [mm]."""
        return self.upper + (self.lower if self.dimensions.passive == "pressurised" else ())

    @property
    def voids(self) -> Boxes:
        """Boxes of unpressurised air [mm]."""
        return self.lower if self.dimensions.passive == "open" else ()

    @property
    def volume(self) -> float:
        """Volume of the material of the whole segment [mm³]."""
        planes, channels = self.planes(), (*self.cavities, *self.voids)
        if self.rounded is None:
            return 2.0 * volume_without(planes, channels)
        air = volume_without(planes, ()) - volume_without(planes, channels)
        return self.rounded.area * self.outer[0][1] - 2.0 * air

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return the resolution equivalent to one of the default pneunet."""
        along, across, up = self._layout.sizes(self.dimensions)
        return Resolution(
            along * usual.along / FINE.along,
            across * usual.across / FINE.across,
            up * usual.up / FINE.up,
            usual.grading if self._layout.graded else 0.0,
        )

    def planes(self) -> Planes:
        """Return the coordinates of all planes along x, y and z between bricks [mm]."""
        channels = (*self.cavities, *self.voids)
        if not self._core:
            return planes_of(self.outer, (*self.slab, *channels), self.line_height)
        # of the rectangle from which the section is bent, twice as large as the core
        (_, (_, across), upward) = self._core[0]
        axis = 0.5 * sum(upward)
        outer = self.outer[0], (0.0, 2.0 * across), (2.0 * upward[0] - axis, 2.0 * upward[1] - axis)
        flat = tuple((x, (0.0, across), z) for x, _, z in self.slab)
        return planes_of(outer, (*flat, *self._core, *channels), self.line_height)

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the segment with thicker or thinner walls and faces eroded [–, mm]."""
        return replace(self, wall_factor=wall_factor, erosion=erosion)

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on, as written and hashed."""
        own = {"kind": self.dimensions.kind, "constraint": self.constraint_record}
        return asdict(self) | own
